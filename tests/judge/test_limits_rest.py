"""A run of the campaign that was broken once: it stays a claim."""

from __future__ import annotations

from tests.judge import limits_rest


def test_a_hand_held_beyond_the_floor_in_ticks_of_20_ms_does_not_go_to_and_fro() -> None:
    verdict = limits_rest.run(250, 20281231, only=82)
    assert verdict.ticks == 250
    assert "joint speed at rest [rad/s]" not in {each.claim for each in verdict.broken}
    assert not verdict.kinds
