"""Runs of the campaign that were broken once: they stay claims."""

from __future__ import annotations

import pytest

from tests.judge import limits_rest

pytestmark = pytest.mark.nightly


def test_a_hand_held_beyond_the_floor_in_ticks_of_20_ms_does_not_go_to_and_fro() -> None:
    verdict = limits_rest.run(250, 20281231, only=82)
    assert verdict.ticks == 250
    assert "joint speed at rest [rad/s]" not in {each.claim for each in verdict.broken}
    assert not verdict.kinds


@pytest.mark.parametrize(("seed", "run"), [(20281231, 66), (505, 92)])
def test_a_hand_where_a_plane_and_curved_limits_meet_stands_at_the_nearest_pose(seed: int, run: int) -> None:
    verdict = limits_rest.run(250, seed, only=run)
    assert verdict.ticks == 250
    assert not verdict.kinds
    assert verdict.seen["several are active at rest"].ticks == 250
    assert verdict.worst["a nearer pose is left aside, gradient"][0] < 1e-6
    assert not any("shortened" in situation for situation in verdict.seen)


@pytest.mark.parametrize(("seed", "run"), [(61001, 6), (194004, 66), (95005, 72)])
def test_a_hand_at_a_curved_limit_does_not_go_to_and_fro(seed: int, run: int) -> None:
    verdict = limits_rest.run(250, seed, only=run)
    assert verdict.ticks == 250
    assert verdict.seen["mirror, at rest beyond a limit"].ticks == 250
    assert not verdict.kinds


@pytest.mark.parametrize(("run", "ticks"), [(24, 500), (70, 250)])
def test_what_hardly_changes_the_error_does_not_creep(run: int, ticks: int) -> None:
    verdict = limits_rest.run(ticks, 21320704, only=run)
    assert verdict.ticks == ticks  # it was not waited for
    assert not verdict.kinds
    assert verdict.worst["joint speed at rest [rad/s]"][0] < 1e-3


def test_a_hand_on_a_flat_way_to_its_nearest_pose_is_waited_for_and_comes_nearer() -> None:
    verdict = limits_rest.run(250, 21320704, only=110)
    assert 250 < verdict.ticks < 750
    assert not verdict.kinds
    nearer, before = verdict.worst["who goes on comes nearer, squared error"]
    assert nearer < before
