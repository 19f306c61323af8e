"""QP of chair and arm for one set of task rows: Honzik's Eq. 1 with bounds.

The QP is feasible in every tick: all rows hold at c, the velocity after one tick in which all joints brake together as
hard as possible. This braking satisfies the acceleration limits and does not change the stop posture z.
Every bound holds at z and on the way to z. The task rows hold with the slack variable off = |e|.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.chair_limits import ChairLimits, Limits
from rehab_opt.control.command import Command
from rehab_opt.control.hand_task import CALM, OFF, PRICE, HandTask, Task
from rehab_opt.control.obstacles import NUMBERS
from rehab_opt.control.velocity_controller import VelocityController
from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics import DriveName
from rehab_opt.kinematics.mobile_arm import CHAIR
from rehab_opt.optim.certificate import all_true
from rehab_opt.optim.qp import Statement
from rehab_opt.optim.rows import MAX_MAGNITUDE, Instance, equal, parameter, variable, within
from rehab_opt.symbolic import Compile
from rehab_opt.symbolic.matrices import symmetric
from rehab_opt.symbolic.tick import Stages

__all__ = ["ChairAndArm"]

Array = NDArray[np.float64]


TINY = 1e-12
"""[m/s, rad/s] Velocity changes below this count as zero."""


class ChairAndArm(VelocityController):
    """Joint velocities for a hand twist that is given in one set of task rows.

    min  1/2 (u - t)'W(u - t) + 0.01 T/dt |u - b|^2 + price (20 off - progress) + missing^2 + off^2
    s.t. J u = w + progress r/|r| + off e/|e|,   0 <= progress <= |r|,  0 <= off <= |e|
         |u - u_last| <= acceleration dt,  the bounds of `ChairLimits`,  and at the stop posture z
         -max(0.05 |r|, |w|) <= (r/|r|)'J(z) u,  |s'J(z) u| <= max(0.27 |r|, |w|) for s orthogonal to r,
         as tangents at u_last (1 - dt/T), relaxed so that this velocity and c (see the module) satisfy them

    - u: joint velocities; those of the chair are in the chassis frame (forward, left, turn). In this frame the rolling
      constraint, Eq. 4, is a left speed of zero.
    - r: commanded twist.
    - w: hand velocity off the direction of r that is still allowed in this tick.
    - e: further hand velocity off the direction of r that remains if the robot brakes.
    - z = q + T u: stop posture if all joints now brake together, see `BrakingTogether`. J: Jacobian at mid-tick.
    - t: joint velocities by Eq. 1, or the nearest ones that the accelerations allow (`HandTask`).
    - b: the answer t if it satisfies all bounds; otherwise t blended with u_last (1 - dt/T), so that a chair at rest
      stays at rest.

    Without a commanded twist all joints brake together as hard as the accelerations allow. For the parameters see
    `RedundancyResolver`.
    """

    requirement = "the rows are dependent at this posture"
    base = CHAIR

    def __init__(
        self,
        limits: ChairLimits,
        rows: tuple[str, ...],
        *,
        drive: DriveName,
        self_motion: float,
        solver: str,
        backup: str | None,
        tolerance: float,
        max_age: float | None,
        compile: Compile,
    ) -> None:
        robot, max_obstacles = limits.robot, limits.max_obstacles
        self.robot, self.rows, self.twist_rows, self.drive, self.max_obstacles = robot, rows, rows, drive, max_obstacles
        self.limits, self.wheelset = limits, limits.wheels
        n, k, wheels = robot.chain.n, len(rows), len(self.wheelset.rolling)
        self.surroundings = NUMBERS * max_obstacles + limits.own.moving_size
        self.shapes = ((k,), (1,), *([(self.surroundings,)] if self.surroundings else []))  # type: ignore[misc]
        self.task = HandTask(robot, rows, moving=self.limits.moving, self_motion=self_motion)
        if (rank := self.task.rank()) < k:
            raise ConfigurationError("row_sets", rows, f"independent rows; on a {drive} base {rank} of them are")
        # Memory: u, the position it leads to, the command, and the wheel speeds.
        self.command_slice: slice = slice(2 * n, 3 * n)
        self.wheels = slice(3 * n, 3 * n + wheels)
        self.motion = slice(2 * n, self.wheels.stop)
        super().__init__(
            robot.chain, dt=limits.dt, recovery_speed=limits.recovery_speed, solver=solver, backup=backup,
            tolerance=tolerance, max_age=max_age, compile=compile,
        )  # fmt: skip
        self._goes_on = self.going_on()

    @property
    def _memory_size(self) -> int:
        return 3 * self.robot.chain.n + len(self.wheelset.rolling)

    # --------------------------------------------------------------------------------------------- the task
    def statement(self) -> Statement:
        """The QP of one tick."""
        tick, n, k = Stages(), self.chain.n, len(self.rows)
        q, twist, world = parameter("q", n), parameter("twist", k), parameter("frame", 1)
        surroundings, memory = parameter("obstacles", self.surroundings), parameter("last", self._memory_size)
        last, moving = memory[:n], ca.sumsqr(twist) > 0

        limits = tick.once(self._limits(tick, q, last, surroundings, gives_way=moving))
        lower, upper = tick.once(self._acceleration_limited(last, limits, moving))
        task = tick.once(
            self.task.task(tick, q, twist, world, last=last, limits=limits, braking=self.limits.braking, dt=self.dt)
        )
        J, W, steady = task.jacobian, symmetric(task.inertia, n), CALM * self.limits.braking.time / self.dt
        velocity = variable("velocity", n, lower=lower, upper=upper)
        along = variable("progress", 1, lower=0, upper=task.speed)
        across = variable("off", 1, lower=0, upper=task.off)
        u, progress, off = velocity.symbol, along.symbol, across.symbol
        calm = tick.once(self._calm(last, task, limits, (lower, upper)))
        away, missing = u - task.target, task.speed - progress
        command = self.limits.kept(tick, q, surroundings, limits, ca.if_else(moving, u, limits.base))
        self._base = limits.base
        return Statement(
            name=f"chair_and_arm_{self.drive}_{'_'.join(self.rows)}",
            parameters=[q, twist, world, surroundings] if self.surroundings else [q, twist, world],
            variables=[velocity, along, across],
            # The quadratic term: solvers fail more often on a cost that is flat in a variable.
            minimise=(away.T @ W @ away + steady * ca.sumsqr(u - calm)) / 2
            + task.price * (OFF * off - progress)
            + PRICE * (missing**2 + off**2) / 2,
            subject_to=[
                equal(J @ u, task.turning + progress * task.direction + off * task.error),
                *limits.chassis.rows(u),
                within(task.ahead @ u, task.ahead_lower, task.ahead_upper),
                *limits.surrounding_rows(u),
            ],
            active_set=True,
            analytic=ca.vertcat(task.analytic, task.speed, 0),
            dual=ca.vertcat(task.dual, ca.SX.zeros(limits.row_count + k)),
            tick=tick,
            report=self.report(last, command, J @ command, twist, limits.outside),
            memory=memory,
            remember=self.remembered(q, command),
            violation=limits.violation(command),
        )

    def _limits(self, tick: Stages, q: ca.SX, last: ca.SX, surroundings: ca.SX, *, gives_way: ca.SX) -> Limits:
        return self.limits.limits(tick, q, last, surroundings, gives_way=gives_way)

    def _acceleration_limited(self, last: ca.SX, limits: Limits, moving: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Intervals of `limits`; with a command also within the accelerations, widened to include braking."""
        change = self.limits.braking.change
        lower = ca.fmax(limits.lower, ca.fmin(last - change, limits.base))
        upper = ca.fmin(limits.upper, ca.fmax(last + change, limits.base))
        return ca.if_else(moving, lower, limits.lower), ca.if_else(moving, upper, limits.upper)

    def _calm(self, last: ca.SX, task: Task, limits: Limits, ends: tuple[ca.SX, ca.SX]) -> ca.SX:
        """Analytic answer (n,), blended with braking the more it violates a bound or the intervals `ends`."""
        u, change = ca.SX.sym("u", self.chain.n), self.limits.braking.change
        finite = all_true(ca.fabs(task.analytic) <= MAX_MAGNITUDE)  # not at a singular posture
        analytic = ca.if_else(finite, task.analytic, 0)
        beyond = ca.if_else(finite, 0, ca.inf)
        ahead = within(task.ahead @ u, task.ahead_lower, task.ahead_upper)
        for row in (within(u, *ends), ahead, *limits.chassis.rows(u), *limits.surrounding_rows(u)):
            matrix = ca.jacobian(row.expression, u)
            there = matrix @ analytic
            over = ca.fmax(there - row.upper, row.lower - there) / ca.fmax(ca.fabs(matrix) @ change, TINY)
            beyond = ca.fmax(beyond, ca.mmax(over))
        slower = self.limits.braking.slower(last)
        return slower + ca.if_else(beyond > 0, task.done * ca.fmax(1 - beyond, 0), 1) * (analytic - slower)

    # ------------------------------------------------------------------------------------------ what is remembered
    def remembered(self, q: ca.SX, u: ca.SX) -> ca.SX:
        """Memory for the next tick: u, the position that u leads to, the command, and the wheel speeds."""
        cos, sin = ca.cos(q[2]), ca.sin(q[2])
        value = ca.vertcat(cos * u[0] - sin * u[1], sin * u[0] + cos * u[1], u[2:])
        wheels = self.wheelset.wheel_speeds_expression(u[:CHAIR])
        return ca.densify(ca.vertcat(u, q + value * self.dt, value, wheels))

    def fallback_law(self) -> ca.Function:
        """Function of the fallback command: one tick in which all joints brake together."""
        stated = self.stated
        return stated.finish_at(ca.vertcat(self._base, 0, 0))

    def beginning(self) -> ca.Function:
        """Function: velocity (n,), heading [rad] -> initial state, whether the joints may be that fast.

        The chair's components of the velocity are in the chassis frame.
        """
        velocity, heading = ca.SX.sym("velocity", self.chain.n), ca.SX.sym("heading")
        state, possible = super().beginning()(velocity)
        state[self.memory_at + self.chain.n + 2] = heading  # used if the first position is invalid
        return ca.Function("begin", [velocity, heading], [state, all_true(possible, ca.fabs(heading) < MAX_MAGNITUDE)])

    def braking(self) -> ca.Function:
        """Function: q, memory, obstacles -> memory after the fallback command, and its report."""
        tick, q = Stages(), ca.SX.sym("q", self.chain.n)
        surroundings, memory = ca.SX.sym("obstacles", self.surroundings), ca.SX.sym("memory", self._memory_size)
        limits = self._limits(tick, q, memory[: self.chain.n], surroundings, gives_way=ca.SX(0))
        command = self.limits.kept(tick, q, surroundings, limits, limits.base)
        report = self.report(memory[: self.chain.n], command, ca.SX(0), ca.SX(1), limits.outside)  # no task
        remembered = self.remembered(q, command)
        inputs = [q, memory, surroundings] if self.surroundings else [q, memory]
        return tick.function("braking", inputs, [remembered, report])

    # ----------------------------------------------------------------------------------------- for the resolver
    def set_obstacles(self, numbers: Array) -> None:
        """Set the obstacles for all ticks until the next call."""
        if self.max_obstacles:
            self._inputs[2][: numbers.size] = numbers

    def set_inputs(self, q: ArrayLike, twist: ArrayLike, world: float, moving: Array | None) -> None:
        """Set q, twist, frame and moving capsules of a tick; a wrong shape or type raises `ConfigurationError`."""
        if moving is not None:
            self._inputs[2][-moving.size :] = moving.reshape(-1)
        views = self._views
        try:
            # View to view: twice as fast as numpy, and refuses any other type or size.
            views[0][:] = q  # type: ignore[assignment]
            views[1][:] = twist  # type: ignore[assignment]
            views[2][0] = world
        except (ValueError, TypeError):
            self._write((q, twist, [world], *self._inputs[2:]))

    tick = VelocityController._tick
    """Take one step with the inputs that were set."""

    def brake(self, reason: str) -> Command:
        """Fallback command for the inputs that were set."""
        return self._safe(reason)

    def reset(self, velocity: ArrayLike | None = None, heading: float = 0.0) -> None:
        """Reset to rest, or to a velocity (n,) whose chair components are in the chassis frame."""
        self._began(np.zeros(self.chain.n) if velocity is None else velocity, heading)

    def take_over(self, other: ChairAndArm) -> None:
        """Take over velocity, position and state checks from the controller of another set of task rows."""
        self._solvers.everything[:] = self._going_on_after(other)

    def instance_after(self, other: ChairAndArm, *inputs: ArrayLike) -> Instance:
        """QP, as numerical data, of a tick that follows a tick of `other`."""
        memory = self._solvers.memory if other is self else self._going_on_after(other)[self.memory_at :]
        return self.stated.instance(*inputs, memory=memory[: self._memory_size].copy())

    def going_on(self) -> ca.Function:
        """Function: own state, memory of another row set, `judged_memory` -> own state that continues from there."""
        size, n, command_slice = self.stated.state_size, self.chain.n, self.command_slice
        ours, own = ca.SX.sym("ours", size + self.judged.size), ca.SX.sym("own", self.judged.size)
        theirs, memory = ca.SX.sym("theirs", command_slice.stop), ours[self.memory_at : size]
        memory[: 2 * n], memory[command_slice] = theirs[: 2 * n], theirs[command_slice]
        after = ca.vertcat(ca.SX.zeros(self.memory_at), memory, own)
        return ca.Function("going_on", [ours, theirs, own], [ca.densify(after)])

    def _going_on_after(self, other: ChairAndArm) -> Array:
        theirs = other._solvers.memory[: self.command_slice.stop], other._judge.inputs[2]
        return np.asarray(self._goes_on(self._solvers.everything, *theirs)).ravel()  # any thread may inspect

    @property
    def memory_at(self) -> int:
        """Index at which the memory begins in the column of the state."""
        return self.stated.state_size - self._memory_size

    @property
    def velocity(self) -> Array:
        """Last command (n,); the chair's components are in the chassis frame."""
        return self._last.copy()
