"""The columns of trace.csv of a followed path."""

from __future__ import annotations

from collections.abc import Iterator

from rehab_opt.session.systems import Column
from rehab_opt.session.trace_columns import joint_columns, point_columns
from rehab_opt.session.upper_limb.outcome import ArmOutcome

__all__ = ["arm_columns"]


def arm_columns(outcome: ArmOutcome) -> Iterator[Column]:
    """One row a sample."""
    yield "t_s", outcome.time.tolist()
    yield from point_columns("path", outcome.path)
    if outcome.reachable is not None:
        yield "reachable", outcome.reachable.astype(int).tolist()
    for run in outcome.laws:
        yield from point_columns(f"{run.law}_hand", run.hand)
        yield f"{run.law}_position_error_m", run.position_error.tolist()
        yield f"{run.law}_handle_tilt_rad", run.handle_tilt.tolist()
        yield f"{run.law}_status", run.status
        yield f"{run.law}_solve_time_s", run.seconds.tolist()
        yield from joint_columns(f"{run.law}", outcome.chain, run.q, "rad")
        if run.drive is not None:
            yield f"{run.law}_drive_t_s", run.drive.passes.tolist()
            yield f"{run.law}_drive_position_error_m", run.drive.position_error.tolist()
            yield f"{run.law}_drive_handle_tilt_rad", run.drive.handle_tilt.tolist()
            yield from joint_columns(f"{run.law}_drive", outcome.chain, run.drive.q, "rad")
