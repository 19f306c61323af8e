"""The columns of trace.csv of a followed pose."""

from __future__ import annotations

from collections.abc import Iterator

from rehab_opt.session.pose_tracking.outcome import RobotOutcome
from rehab_opt.session.systems import Column
from rehab_opt.session.trace_columns import joint_columns, point_columns

__all__ = ["robot_columns"]


def robot_columns(outcome: RobotOutcome) -> Iterator[Column]:
    """One row a tick."""
    yield "t_s", outcome.time.tolist()
    yield from point_columns("reference", outcome.reference)
    yield from point_columns("tool", outcome.tool)
    yield "position_error_m", outcome.position_error.tolist()
    yield "orientation_error_rad", outcome.orientation_error.tolist()
    yield "status", outcome.status
    yield from joint_columns("joint", outcome.chain, outcome.q, "rad")
    yield from joint_columns("command", outcome.chain, outcome.command, "rad_s")
    if outcome.motion is not None:
        yield from joint_columns("measured", outcome.chain, outcome.motion.measured, "rad")
        yield from joint_columns("velocity", outcome.chain, outcome.motion.velocity, "rad_s")
