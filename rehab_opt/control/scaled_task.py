"""The QP that keeps the direction of a reference motion and slows it to its bounds; `MirrorTracker` has it."""

from __future__ import annotations

import math
from abc import abstractmethod
from functools import partial
from typing import ClassVar, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.limit import PostureLimits
from rehab_opt.control.pose_inputs import PoseInputs
from rehab_opt.control.reference_velocity import CALMING, MISSED, ReferenceVelocity
from rehab_opt.control.stopping import VelocityBounds, nearest_to_rest
from rehab_opt.control.velocity_controller import checked_number
from rehab_opt.kinematics.chain import SerialChain, per_joint
from rehab_opt.kinematics.plausible import check_speeds, checked_posture
from rehab_opt.kinematics.rigid import is_rigid
from rehab_opt.optim.qp import Statement
from rehab_opt.optim.rows import parameter, variable, within
from rehab_opt.symbolic import Compile
from rehab_opt.symbolic.tick import Stages

__all__ = ["Inputs", "Rows", "ScaledTask", "TickSolution"]

DIRECTION_KEEPING = 1e-5
"""Price of slowing down against leaving the reference direction: at a twentieth of the speed it is left by 0.01 deg."""
STEADYING = 1e-5
"""Weight of the joint velocities against the squared twist error: for what the task leaves open."""
DRIFT_SPEED = 0.1
"""Fraction of the velocity limits at which a redundant chain drifts to its posture."""
DRIFT_SIZE = 1e-2
"""[m] Joint velocities count as this much of a hand speed each."""
TINY = 1e-12
"""[m/s] A speed that is no motion."""
POSE, TWIST = 16, 6
"""Numbers of each."""

Array = NDArray[np.float64]


class Inputs(NamedTuple):
    """Inputs of a tick, as expressions."""

    q: ca.SX
    target: ca.SX
    """(4, 4)"""
    twist: ca.SX
    others: list[ca.SX]
    """Further inputs of a tracker with more bounds."""
    moving: ca.SX
    """Numbers of the moving capsules, none where there are no such."""
    memory: ca.SX

    @property
    def last(self) -> ca.SX:
        """(n,) the last velocity."""
        return self.memory[: self.q.numel()]


class Rows(NamedTuple):
    """Linear bounds R q' <= r on the joint velocities of a tick, and intervals that have room for them."""

    matrix: ca.SX
    """(m, n) R"""
    upper: ca.SX
    """(m,) r"""
    bounds: VelocityBounds
    posture: tuple[ca.SX, ...] = ()
    """Further quantities of the posture, for `outcome`."""


class TickSolution(NamedTuple):
    """Solution of a tick, as expressions."""

    velocity: ca.SX
    """(n,)"""
    scale: ca.SX
    """Fraction of the reference velocity; zero of none."""
    speed: ca.SX
    """Size of the reference velocity."""
    delivered: ca.SX
    """(6,) twist of the command, weighted."""
    commanded: ca.SX
    """(6,) twist, with all feedback, weighted."""
    rows: Rows


class ScaledTask(PoseInputs):
    """Joint velocities for a tool that follows a pose and a twist in the desired direction.

    min  |J (q' - s w)|^2 + small |q' - s w|^2 + price |w|^2 (1 - s)^2   over q', 0 <= s <= 1
    s.t. lower(q, q'_last) <= q' <= upper(q, q'_last),  R q' <= r  of `rows`

    w are the joint velocities that would deliver the reference twist, or as much of it as the arm can at this pose
    (`ReferenceVelocity`); s slows the motion down where the bounds demand, so that its direction is kept.

    Parameters
    ----------
    chain : the arm, whose limits the others replace. gain : [1/s] rate at which a pose error decays.
    linear_speed, angular_speed : [m/s, rad/s] largest hand speeds.
    task_weights : (6,) weights of the twist's components in the base frame.
    posture : (n,) joint positions that a redundant chain drifts to where the task leaves it free, or None.
    limits : what else the posture keeps. The others are as for `PoseTracker`.
    """

    def __init__(
        self,
        chain: SerialChain,
        *,
        linear_speed: float,
        angular_speed: float,
        task_weights: ArrayLike,
        limits: PostureLimits,
        dt: float,
        recovery_speed: float,
        lower: ArrayLike | None = None,
        upper: ArrayLike | None = None,
        velocity: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
        gain: float = 50.0,
        posture: ArrayLike | None = None,
        solver: str = "qrqp",
        backup: str | None = None,
        tolerance: float = 1e-8,
        max_age: float | None = None,
        compile: Compile = None,
    ) -> None:
        self.gain = checked_number("gain", gain, above=0.0)
        self.linear_speed = checked_number("linear_speed", linear_speed, above=0.0)
        self.angular_speed = checked_number("angular_speed", angular_speed, above=0.0)
        self.task_weights = per_joint("task_weights", task_weights, 6, finite=True)
        limited = chain.with_limits(lower=lower, upper=upper, velocity=velocity, acceleration=acceleration)
        check_speeds(limited, linear=self.linear_speed, angular=self.angular_speed)
        self.posture = checked_posture("posture", posture, chain)
        self.limits = limits
        super().__init__(
            limited, dt=dt, recovery_speed=recovery_speed, solver=solver, backup=backup, tolerance=tolerance,
            max_age=max_age, compile=compile,
        )  # fmt: skip

    def statement(self) -> Statement:
        """The QP of one tick; parameters q (n,), pose (16, by rows), twist (6,); memory as `VelocityController`."""
        tick, n, weights = Stages(), self.chain.n, ca.sqrt(ca.DM(self.task_weights))
        q, entries, twist, others = parameter("q", n), parameter("pose", POSE), parameter("twist", TWIST), self.others()
        memory = parameter("memory", self._memory_size)
        target = ca.reshape(entries, 4, 4).T
        inputs = Inputs(q, target, twist, others, others[-1] if self.limits.moving else ca.SX(0, 1), memory)

        J = tick.once(ca.diag(weights) @ self.chain.jacobian_expression(q))
        reference = self.reference_twist(self.chain.pose_expression(q), target, twist)
        commanded = tick.once(weights * reference)
        rows = tick.once(self.rows(tick, inputs, self.bounds(q, memory)))
        w, delivered = ReferenceVelocity(
            J, commanded, self._drift(q), rows.bounds, self.chain.velocity, self.chain.locked, rows.matrix, rows.upper
        ).stated(tick, q, inputs.last, excess=partial(self.excess, inputs, J))

        velocity = variable("velocity", n, lower=rows.bounds.lower, upper=rows.bounds.upper)
        # Progress is s times the size of the reference velocity: in units of velocity like the rest, so that one
        # tolerance fits all variables. A drift that moves no hand is a motion, too.
        speed = ca.sqrt(ca.sumsqr(delivered) + DRIFT_SIZE**2 * ca.sumsqr(w))
        progress = variable("progress", 1, lower=0, upper=speed)
        u, s = velocity.symbol, progress.symbol / ca.fmax(speed, TINY)
        # What damps the reference where rows leave some of it undone damps here, too: a joint that its acceleration
        # holds back would else swing all others, by the scale and by directions that hardly matter.
        left = ca.norm_2(commanded - delivered) - MISSED * ca.norm_2(commanded)
        calm = CALMING * ca.fmax(left, 0) if self.among_bodies else 0
        cost = (
            ca.sumsqr(J @ u - s * delivered)
            + (STEADYING + calm) * ca.sumsqr(u - s * w)
            + (DIRECTION_KEEPING + calm) * ca.sumsqr(progress.symbol - speed)
        )
        report, remember = self.outcome(tick, inputs, TickSolution(u, s, speed, J @ u, commanded, rows))
        return Statement(
            name=self.name, parameters=[q, entries, twist, *others], variables=[velocity, progress], minimise=cost / 2,
            subject_to=[within(rows.matrix @ u, -ca.inf, rows.upper)], active_set=True, requires=[is_rigid(target)],
            analytic=ca.vertcat(w, speed), tick=tick, report=report, memory=memory, remember=remember,
        )  # fmt: skip

    @abstractmethod
    def rows(self, tick: Stages, inputs: Inputs, bounds: VelocityBounds) -> Rows:
        """The linear bounds, and the intervals `bounds` opened where they have to yield."""

    @abstractmethod
    def reference_twist(self, pose: ca.SX, target: ca.SX, twist: ca.SX) -> ca.SX:
        """(6,) twist plus feedback on the error from the pose to the target (4, 4)."""

    @abstractmethod
    def excess(self, inputs: Inputs, jacobian: ca.SX, velocity: ca.SX) -> ca.SX:
        """By how much a reference velocity (n,) is too fast, at the weighted Jacobian (6, n): it is slowed by that."""

    @abstractmethod
    def outcome(self, tick: Stages, inputs: Inputs, motion: TickSolution) -> tuple[ca.SX, ca.SX]:
        """The report of a tick, what was relaxed and the scale first; and the memory that it leaves."""

    memory_extra: ClassVar[int] = 0
    """Numbers remembered besides velocity and position."""

    @property
    def _memory_size(self) -> int:
        return 2 * self.chain.n + self.memory_extra

    def others(self) -> list[ca.SX]:
        """Parameters besides q, pose and twist."""
        return [parameter("obstacles", self.limits.moving_size)] if self.limits.moving else []

    def bounds(self, q: ca.SX, memory: ca.SX) -> VelocityBounds:
        """Intervals of the joint velocities; beyond a `Limit` is outside, too."""
        found = super().bounds(q, memory)
        return found._replace(outside=ca.logic_or(found.outside, self.limits.beyond(q)))

    @property
    def among_bodies(self) -> bool:
        """Whether a `Clearance` is among the limits, whose rows come and go."""
        return self.limits.clearance is not None

    def contacts(self, tick: Stages, q: ca.SX, last: ca.SX, moving: ca.SX) -> ca.SX:
        """Nearest contacts within a tick, see `PostureLimits.contacts`."""
        if not self.limits.contacts_size:
            return ca.SX(0, 1)
        given = [ca.MX.sym(name, each.numel()) for name, each in (("q", q), ("last", last), ("moving", moving))]
        nearest = ca.Function("contacts", given, [self.limits.contacts(*given)])
        return tick.call(nearest, q, last, moving)[0]

    def braking(self) -> ca.Function:
        """As a controller's of joints alone; among bodies by what keeps clear of them, moving ones a third input."""
        if not self.among_bodies:
            return super().braking()
        tick, q, memory = Stages(), ca.SX.sym("q", self.chain.n), ca.SX.sym("memory", self._memory_size)
        last, moving = memory[: self.chain.n], ca.SX.sym("moving", self.limits.moving_size)
        bounds, contacts = self.bounds(q, memory), self.contacts(tick, q, last, moving)
        u = tick.once(self.limits.slower(q, last, bounds, contacts, rest=nearest_to_rest(bounds)))
        rest = tick.call(self.limits.keeping, q, moving, u, u)[0]
        outside = ca.logic_or(bounds.outside, self.limits.inside(contacts))
        report = self.report(last, rest, ca.SX(0), ca.SX(1), outside)  # nothing of the task is delivered
        inputs = [q, memory, moving] if self.limits.moving else [q, memory]
        return tick.function("braking", inputs, [self.memory_after(q, last, rest), report])

    def _drift(self, q: ca.SX) -> ca.SX:
        """(n,) towards the posture, slowed as a whole so that its direction is kept."""
        if self.posture is None:
            return ca.SX.zeros(self.chain.n)
        drift = ca.DM(~self.chain.locked * self.settling) * (ca.DM(self.posture) - q)
        return drift / ca.fmax(ca.mmax(ca.fabs(drift) / ca.DM(DRIFT_SPEED * self.chain.velocity)), 1)

    def _unweighted(self, jacobian: ca.SX) -> ca.SX:
        """(6, n) Jacobian, from the weighted one."""
        return ca.diag(1 / ca.sqrt(ca.DM(self.task_weights))) @ jacobian

    @property
    def settling(self) -> float:
        """[1/s] what removes a fraction 1 - exp(-gain dt) of the error in one tick: never an overshoot, at any dt."""
        return (1 - math.exp(-self.gain * self.dt)) / self.dt
