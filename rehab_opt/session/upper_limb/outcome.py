"""What the controllers did along a recorded path, its columns, and what a reader of its numbers has to know."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.smoothing import SmoothPath
from rehab_opt.session.outcome import Array, Column, MovementOutcome, joint_columns, point_columns

__all__ = ["DRIVEN_DEG", "ArmOutcome", "DrivenArm", "LawResult", "drive_note", "hurried", "law_notes"]


class DrivenArm(NamedTuple):
    """What a drive does with the joints of N samples, in M ticks."""

    path: SmoothPath
    """Its joints (M, n) [rad], and where it is in the recording."""
    hand: Array
    """(M, 3) [m]."""
    passes: Array
    """(N,) [s] when it passes each sample."""
    q: Array
    """(N, n) [rad] its joints there."""
    position_error: Array
    """(N,) [m] largest distance of the hand from the path while it is nearest to this sample."""
    handle_tilt: Array
    """(N,) [rad] largest angle of the handle from the vertical then."""


@dataclass(frozen=True, eq=False)
class LawResult:
    """One controller's run along a path of N samples.

    Parameters
    ----------
    law : "optimised" or "published".
    q : (N, n) joint values [rad].
    hand : (N, 3) hand positions [m].
    position_error : (N,) [m] distance of the hand from the path.
    handle_tilt : (N,) [rad] angle of the handle from the vertical.
    status : (N,) the controller's status of each sample.
    reason : (N,) why, where that is not a plain ok; empty otherwise, and where the controller gives none.
    seconds : (N,) time it took [s].
    metrics : its numbers.
    drive : what a drive would do with its joints; None until that is known.
    """

    law: str
    q: Array
    hand: Array
    position_error: Array
    handle_tilt: Array
    status: tuple[str, ...]
    reason: tuple[str, ...]
    seconds: Array
    metrics: Mapping[str, Any]
    drive: DrivenArm | None = None


@dataclass(frozen=True, eq=False)
class ArmOutcome(MovementOutcome):
    """A hand path followed by an arm: path (N, 3) [m], the controllers that followed it, and where it can be reached.

    `reachable` (N,) is None where the optimised controller, which alone finds it, was not run.
    """

    path: Array = field(kw_only=True)
    laws: tuple[LawResult, ...] = field(kw_only=True)
    reachable: NDArray[np.bool_] | None = field(kw_only=True)
    handle_tilt_limit: float = field(kw_only=True)
    gaps: tuple[tuple[float, float], ...] = field(default=(), kw_only=True)
    """(from, to) [s] where the recording has no samples."""

    def trace(self) -> Iterator[Column]:
        """One row a sample."""
        yield "t_s", self.time.tolist()
        yield from point_columns("path", self.path)
        if self.reachable is not None:
            yield "reachable", self.reachable.astype(int).tolist()
        for run in self.laws:
            yield from point_columns(f"{run.law}_hand", run.hand)
            yield f"{run.law}_position_error_m", run.position_error.tolist()
            yield f"{run.law}_handle_tilt_rad", run.handle_tilt.tolist()
            yield f"{run.law}_status", run.status
            yield f"{run.law}_solve_time_s", run.seconds.tolist()
            yield from joint_columns(f"{run.law}", self.chain, run.q, "rad")
            if run.drive is not None:
                yield f"{run.law}_drive_t_s", run.drive.passes.tolist()
                yield f"{run.law}_drive_position_error_m", run.drive.position_error.tolist()
                yield f"{run.law}_drive_handle_tilt_rad", run.drive.handle_tilt.tolist()
                yield from joint_columns(f"{run.law}_drive", self.chain, run.drive.q, "rad")


DRIVEN_DEG = 0.01  # by which a drive may tilt further: it goes on between the samples that the law is asked for


def law_notes(run: LawResult, *, within_reach: bool) -> Iterator[str]:
    """Notes on a controller's run; `within_reach` is True if the whole path is known to be in reach."""
    if run.law == "published":
        yield from _published(run, within_reach=within_reach)
    for reason, count in run.metrics["reasons"].items():
        yield f"the {run.law} law, {count} of {len(run.q)} samples: {reason}"
    yield from hurried(run)
    yield from _tilted(run)


def hurried(run: LawResult) -> list[str]:
    """What to say where a controller's joints are faster than the arm may be: between samples nothing bounds them."""
    ratio = run.metrics["joint_speed_max_fraction_of_limit"]
    if ratio <= 1:
        return []
    joint, late = run.metrics["joint_speed_max_joint"].replace("_", " "), run.metrics["drive"]["delay_s"]
    return [
        f"the {run.law} controller moves {joint} at {ratio:.1f} times its speed limit: a drive takes {late:.3g} s "
        "longer than the recording"
    ]


def drive_note(bounds: dict[str, float]) -> str:
    """Within which bounds the joints of both controllers are driven."""
    return (
        f"driven at 1 kHz within {bounds['speed_deg_s']:.0f} deg/s, {bounds['acceleration_deg_s2']:.0f} deg/s^2, "
        f"{bounds['jerk_deg_s3']:.0f} deg/s^3: speed and acceleration are the smaller of the file's and the arm's; "
        "where a joint is too slow all of them wait, and the path is kept"
    )


def _tilted(run: LawResult) -> Iterator[str]:
    tilt, limit = run.metrics["drive"]["handle_tilt_max_deg"], run.metrics["handle_tilt_limit_deg"]
    if tilt > limit + DRIVEN_DEG:
        yield (
            f"HANDLE BEYOND ITS TILT: driven along the {run.law} controller's joints it tilts by up to {tilt:.3g} deg, "
            f"{limit:g} allowed; between two samples that are far apart no controller bounds it"
        )


def _published(run: LawResult, *, within_reach: bool) -> Iterator[str]:
    chosen = run.metrics["parameters"]
    yield (
        f"the published controller runs with k0 = {chosen['gain_per_s']:g}/s and mu = {chosen['damping']:g}: the paper "
        "gives no values, and its numbers depend on them; `python -m bench.tangent_law` prints those of a grid"
    )
    if not within_reach:
        yield (
            "the published controller winds up: after a sample out of its reach its joints may stay at their limits, "
            "and samples within reach be missed too"
        )
