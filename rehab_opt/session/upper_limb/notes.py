"""Sentences that a reader of a run's numbers has to know: what is a choice, what was not kept, what was not said."""

from __future__ import annotations

from collections.abc import Iterator

from rehab_opt.session.upper_limb.outcome import LawResult

__all__ = ["DRIVEN_DEG", "drive_note", "hurried", "law_notes"]

DRIVEN_DEG = 0.01  # by which a drive may tilt further: it goes on between the samples that the law is asked for


def law_notes(run: LawResult, *, within_reach: bool) -> Iterator[str]:
    """What to say of a law's run; `within_reach`: the whole path is known to be so."""
    if run.law == "published":
        yield from _published(run, within_reach=within_reach)
    for reason, count in run.metrics["reasons"].items():
        yield f"the {run.law} law, {count} of {len(run.q)} samples: {reason}"
    yield from hurried(run)
    yield from _tilted(run)


def hurried(run: LawResult) -> list[str]:
    """What to say where a law's joints are faster than the arm may be: between samples nothing bounds them."""
    share = run.metrics["joint_speed_max_share_of_limit"]
    if share <= 1:
        return []
    joint, late = run.metrics["joint_speed_max_joint"].replace("_", " "), run.metrics["drive"]["delay_s"]
    return [
        f"the {run.law} law asks {joint} for {share:.1f} times its speed limit: a drive takes {late:.3g} s longer than "
        "the recording"
    ]


def drive_note(bounds: dict[str, float]) -> str:
    """Within which bounds the joints of both laws are driven."""
    return (
        f"driven at 1 kHz within {bounds['speed_deg_s']:.0f} deg/s, {bounds['acceleration_deg_s2']:.0f} deg/s^2, "
        f"{bounds['jerk_deg_s3']:.0f} deg/s^3: speed and acceleration are the smaller of the file's and the arm's; "
        "where a joint is too slow all of them wait, and the path is kept"
    )


def _tilted(run: LawResult) -> Iterator[str]:
    tilt, limit = run.metrics["drive"]["handle_tilt_max_deg"], run.metrics["handle_tilt_limit_deg"]
    if tilt > limit + DRIVEN_DEG:
        yield (
            f"HANDLE BEYOND ITS TILT: driven along the {run.law} law's joints it tilts by up to {tilt:.3g} deg, "
            f"{limit:g} allowed; between two samples that are far apart no law bounds it"
        )


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
