"""A stretch of a mirrored motion as one nonlinear programme: what `MirrorTracker` decides tick by tick, all at once.

Over the joints q_1 ... q_K at knots h apart, from where the arm is (q_0) and was a knot before (q_-1),

    min   sum over k of  1/2 |p(q_k) - p_k|^2 + 1/4 L^2 |R(q_k) - R_k|^2 + c/2 |q_k - 2 q_k-1 + q_k-2|^2
    s.t.  |q_k - q_k-1| <= v_max h,   |q_k - 2 q_k-1 + q_k-2| <= a_max h^2,   lower <= q_k <= upper,
          w(q_k) / w_max >= min(floor, w(q_0) / w_max),   |p(q_k) - p(q_k-1)| <= v_hand h,
          |p(q_k) - p_k| <= max(d, |p(q_0) - p_1|)

with p, R the tool's place and orientation, p_k, R_k the reference's, w Yoshikawa's measure. |R - R_k|^2 / 4 is half the
square of the turn between them, but for its fourth power, and smooth everywhere. Bounds, expressions and units are
those of `HandBounds` and the chain; the programme looks ahead where the tick's QP looks at a tangent.
"""

from __future__ import annotations

from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.hand_bounds import HandBounds
from rehab_opt.control.velocity_controller import checked_number
from rehab_opt.errors import ConfigurationError
from rehab_opt.optim.nlp import NLP
from rehab_opt.optim.rows import parameter, variable, within

__all__ = ["MirrorWindow"]

Array = NDArray[np.float64]

STEADYING = 1e-3
"""[m^2/rad^2] c: what a change of velocity costs beside the error; it makes the answer unique."""
MAX_KNOTS = 100


class MirrorWindow:
    """The programme for one arm and its bounds.

    Parameters
    ----------
    bounds : of the arm that leads the hand; its planes are not stated.
    linear_speed, deviation : [m/s, m] of the hand, and from its reference. dt : [s] h, from knot to knot.
    knots : K.
    turn_length : [m/rad] L, as in `MirrorTracker`.

    Raises
    ------
    ConfigurationError : an argument that cannot be used.
    """

    def __init__(
        self, bounds: HandBounds, *, linear_speed: float, deviation: float, dt: float, knots: int,
        turn_length: float = 0.1,
    ) -> None:  # fmt: skip
        if not isinstance(knots, int) or not 1 <= knots <= MAX_KNOTS:
            raise ConfigurationError("knots", knots, f"an integer from 1 to {MAX_KNOTS}")
        if bounds.planes:
            raise ConfigurationError("bounds", len(bounds.planes), "no planes")
        self.bounds, self.knots = bounds, knots
        self.linear_speed, self.deviation, self.dt = linear_speed, deviation, dt
        self.turn_length = checked_number("turn_length", turn_length, above=0.0)

    @cached_property
    def nlp(self) -> NLP:
        """Parameters: q_0, q_-1 (n,), and the poses of K knots (16 K, by rows). Report: each knot's w / w_max."""
        bounds, chain, n = self.bounds, self.bounds.chain, self.bounds.chain.n
        here, before = parameter("here", n), parameter("before", n)
        poses = parameter("poses", 16 * self.knots)
        lower, upper = np.tile(chain.lower, self.knots), np.tile(chain.upper, self.knots)
        joints = variable("joints", n * self.knots, lower=lower, upper=upper)
        steps = ca.horzsplit(ca.reshape(joints.symbol, n, self.knots))
        wanted = [ca.reshape(each, 4, 4).T for each in ca.vertsplit(poses, 16)]
        pose = ca.Function("pose", [here], [chain.pose_expression(here)])
        measure = ca.Function("measure", [here], [bounds.manipulability(here)[0]])

        cost, rows, fractions = ca.SX(0), [], []
        last, last_but_one, last_hand = here, before, pose(here)[:3, 3]
        least = ca.fmin(bounds.floor, measure(here))
        away = ca.fmax(self.deviation, ca.norm_2(last_hand - wanted[0][:3, 3]))
        reach = self.linear_speed * self.dt
        for q, target in zip(steps, wanted, strict=True):
            tool, fraction, step = pose(q), measure(q), q - last
            error, turn = tool[:3, 3] - target[:3, 3], tool[:3, :3] - target[:3, :3]
            change, moved = step - (last - last_but_one), tool[:3, 3] - last_hand
            cost += ca.sumsqr(error) / 2 + self.turn_length**2 * ca.sumsqr(turn) / 4 + STEADYING * ca.sumsqr(change) / 2
            speed, hurry = chain.velocity * self.dt, np.minimum(chain.acceleration * self.dt**2, 1e3)
            rows += [
                within(step, -speed, speed),
                within(change, -hurry, hurry),
                within(fraction, least, ca.inf),
                # Squares over the length they are bounded by, so that their slopes are of order one like the others'.
                within(ca.sumsqr(moved) / (2 * reach), -ca.inf, reach / 2),
                within(ca.sumsqr(error) / (2 * away), -ca.inf, away / 2),
            ]
            fractions.append(fraction)
            last, last_but_one, last_hand = q, last, tool[:3, 3]
        return NLP(
            "mirror_window", parameters=[here, before, poses], variables=[joints], minimise=cost, subject_to=rows,
            report=ca.vertcat(*fractions),
        )  # fmt: skip

    def parameters_of(self, here: ArrayLike, before: ArrayLike, poses: ArrayLike) -> Array:
        """(2 n + 16 K,) of the programme, from q_0 and q_-1 (n,) and the reference's poses (K, 4, 4)."""
        parts = [np.asarray(each, dtype=np.float64).reshape(-1) for each in (here, before, poses)]
        return np.concatenate(parts)

    def standing(self, here: ArrayLike) -> Array:
        """(n K,) start that knows nothing: the arm stays where it is."""
        return np.tile(np.asarray(here, dtype=np.float64), self.knots)
