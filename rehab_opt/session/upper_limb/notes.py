"""Sentences that a reader of a run's numbers has to know: what is a choice, what was not kept, what was not said."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from rehab_opt.session.cells import ROUNDING_DEG
from rehab_opt.session.upper_limb.outcome import LawResult

__all__ = ["hurried", "law_notes", "smoothing_note"]

TICKS_OK = "ok"


def law_notes(run: LawResult, *, within_reach: bool) -> Iterator[str]:
    """What to say of a law's run; `within_reach`: the whole path is known to be so."""
    if run.law == "published":
        yield from _published(run, within_reach=within_reach)
    for reason, count in run.metrics["reasons"].items():
        yield f"the {run.law} law, {count} of {len(run.q)} samples: {reason}"
    yield from hurried(run)
    yield from _tilted(run)
    yield from _braked(run)


def hurried(run: LawResult) -> list[str]:
    """What to say where a law's joints are faster than the arm may be: between samples nothing bounds them."""
    share = run.metrics["joint_speed_max_share_of_limit"]
    if share <= 1:
        return []
    joint, behind = run.metrics["joint_speed_max_joint"].replace("_", " "), run.metrics["smoothed"]
    return [
        f"the {run.law} law asks {joint} for {share:.1f} times its speed limit; smoothed within limits, the hand is "
        f"up to {1e3 * behind['hand_deviation_max_m']:.3g} mm from where the law has it"
    ]


def smoothing_note(bounds: dict[str, float]) -> str:
    """Within which bounds both laws were smoothed."""
    return (
        f"smoothed at 1 kHz within {bounds['speed_deg_s']:.0f} deg/s, {bounds['acceleration_deg_s2']:.0f} deg/s^2, "
        f"{bounds['jerk_deg_s3']:.0f} deg/s^3: speed and acceleration are the smaller of the file's and the arm's"
    )


def _tilted(run: LawResult) -> Iterator[str]:
    tilt, limit = run.metrics["smoothed"]["handle_tilt_max_deg"], run.metrics["handle_tilt_limit_deg"]
    if tilt > limit + ROUNDING_DEG:
        yield (
            f"SMOOTHED HANDLE BEYOND ITS TILT: behind the smoother the {run.law} law tilts it by up to {tilt:.3g} deg, "
            f"{limit:g} allowed; joints are smoothed one by one, which bounds no tilt"
        )


def _braked(run: LawResult) -> Iterator[str]:
    behind: dict[str, Any] = run.metrics["smoothed"]
    ticks = sum(behind["status"].values())
    for status, count in behind["status"].items():
        if status != TICKS_OK:
            yield f"the smoother of the {run.law} law was {status} in {count} of {ticks} ticks"
    for reason, count in behind["reasons"].items():
        yield f"the smoother of the {run.law} law, {count} of {ticks} ticks: {reason}"


def _published(run: LawResult, *, within_reach: bool) -> Iterator[str]:
    chosen = run.metrics["parameters"]
    yield (
        f"the published law runs with k0 = {chosen['gain_per_s']:g}/s and mu = {chosen['damping']:g}: choices, the "
        "paper gives no values, and its numbers depend on them (of the shipped figure_eight it follows 37.7 % with "
        "k0 = 50/s, 98.9 % with 200/s, 100 % with 500/s)"
    )
    if not within_reach:
        yield (
            "the published law winds up: after a sample out of its reach its joints may stay at their limits, "
            "and samples within reach be missed too"
        )
