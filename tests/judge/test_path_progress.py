"""A run of the judge in which help along a crossing path skipped half of it stays a claim."""

from tests.judge import path_progress


def test_a_hand_that_was_let_go_is_taken_in_by_the_first_branch_that_it_comes_to() -> None:
    verdict = path_progress.run(600, 21311126, only=9)
    assert verdict.ticks == 600
    assert not verdict.kinds
