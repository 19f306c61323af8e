"""QP of a mirrored hand: the QP of `PoseTracker` with a manipulability floor and planes as further limits."""

from __future__ import annotations

from functools import reduce

import casadi as ca

from rehab_opt.control.command import Relaxed
from rehab_opt.control.hand_bounds import HandBounds
from rehab_opt.control.pose_tracker import PoseTracker

__all__ = ["CALM", "SPARE", "WHOLE", "MirrorStatement"]

WHOLE = 0.999
"""Pace from which the reference counts as not slowed."""
CALM = 0.45
"""Fraction of the largest deviation up to which the clock keeps its pace."""
SPARE = 0.95
"""Fraction of the hand's largest speeds that the reference may use; the rest is for catching up."""

STANDS = 1e-6
"""[rad/s or m/s] Joint speeds below which a robot is at rest."""


class MirrorStatement(PoseTracker):
    """A `PoseTracker` that also reports w / w_max, and whether its next tick needs no clock."""

    max_deviation: float
    max_turn: float
    hand_bounds: HandBounds

    def told(self, q: ca.SX, error: ca.SX, twist: ca.SX, command: ca.SX, report: ca.SX) -> ca.SX:
        """Report of `PoseTracker`, then whether the reference may keep its pace, and w / w_max after the tick.

        The reported scale is 0 for a robot that is blocked and at rest, else 1.
        """
        moves = ca.logic_or(report[1] > 0, ca.mmax(ca.fabs(command)) > STANDS)
        usual = [
            moves,
            ca.logic_or(report[0] == int(Relaxed.NOTHING), report[0] == int(Relaxed.TASK)),
            ca.sumsqr(error[:3]) <= (CALM * self.max_deviation) ** 2,
            ca.sumsqr(error[3:]) <= (CALM * self.max_turn) ** 2,
            ca.sumsqr(twist[:3]) <= (SPARE * self.linear_speed) ** 2,
            ca.sumsqr(twist[3:]) <= (SPARE * self.angular_speed) ** 2,
        ]
        then = self.chain.manipulability_expression(q + self.dt * command) / self.hand_bounds.max_manipulability
        return ca.vertcat(report[0], moves, report[2:], reduce(ca.logic_and, usual), then)
