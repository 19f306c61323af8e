"""The QP of chair and arm for one set of task rows: Honzik's Eq. (1) with bounds."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.chair_limits import ChairLimits, Limits
from rehab_opt.control.command import Bound, Command, Status
from rehab_opt.control.hand_task import AHEAD, PROGRESS, HandTask, Last
from rehab_opt.control.joint_feedback import JointFeedback
from rehab_opt.control.limit import Limits as OwnLimits
from rehab_opt.control.obstacles import NUMBERS
from rehab_opt.control.velocity_controller import VelocityController
from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.drive_name import DriveName
from rehab_opt.kinematics.mobile_arm import CHAIR, MobileArm
from rehab_opt.optim.certificate import all_true
from rehab_opt.optim.factor import symmetric
from rehab_opt.optim.qp import Statement
from rehab_opt.optim.rows import PLAUSIBLE, Instance, Row, equal, parameter, variable, within
from rehab_opt.symbolic import BufferedFunction, Compile

__all__ = ["ChairAndArm"]

Array = NDArray[np.float64]
UNKNOWN = -1.0
"""In place of the frame: 0 for the chassis frame, 1 for the world, this where no hand velocity is remembered."""
OFF = 20.0
"""How many times more a m/s off the commanded direction costs than one that is missing along it.

What is off goes no faster than braking takes it away, and it adds up: at 10 times, a chair that turned fast beside a
keep-out had its hand more than 0.05 of the command across for 0.93 s, to keep 0.97 of it; now it slows down instead.
"""
STEADY = 0.01
"""Weight of a steady velocity beside what braking leaves of it, as a share of the chair's mass; of a change in a tick,
by T/dt more. Light joints would else go from one end of their acceleration to the other, tick by tick, where bounds are
met: what is best turns with the rows of the way to the stop posture, and those with u.
"""
CURVED = 2.0
"""How many times progress pays for the bow that a joint's turn in a tick makes of the hand's way, reach dt u^2 / 2.

Where a stretched arm gives none, tangents promise some to either side: the arm then overshoots that place in every tick
by as much as it is beyond it or more, unless this is above 1. One swung at 20 rad/s^2, its hand at 0.3 m/s.
"""
GOING = 10.0
"""Ticks of acceleration in which a joint gets to a speed from which on all of that share counts: at rest, what is left
of the command decides.
"""
ROUNDS = 2
"""Corrections of the last tick's active set: it is the same in 95 % of the ticks in which any bound is active."""
ITERATIONS = 20
"""Cap on qrqp's active-set changes: most ticks need three, and what takes more than this cycles."""
TINY = 1e-12
"""[m/s, rad/s] A change of velocity that is none."""


class ChairAndArm(VelocityController):
    """Joint velocities for a hand twist in one set of rows.

    min  1/2 (u - t)'W(u - t) + (0.005 T/dt + price reach dt) |u - b|^2 - price progress + 20 price off
    s.t. J u = w + progress r/|r| + off e/|e|,   0 <= progress <= |r|,  0 <= off <= |e|
         |u - u_last| <= acceleration dt,  the bounds of `ChairLimits`,  and for h of z and half-way to it
         -max(0.05 |r|, |w|) <= (r/|r|)'J(h) u,  |s'J(h) u| <= max(0.27 |r|, |w|) for s square to r,
         by their tangents at u_last (1 - dt/T), and no tighter than that and c below are

    u are the joint velocities with the chair's in the chassis frame (forward, left, turn), in which neither W nor the
    arm's Jacobian knows where the chair stands: that a turned or shifted scene changes nothing is by construction, and
    the rolling row, Eq. (4), is a left speed of zero. r is the commanded twist. z = q + T u is where the robot comes to
    rest if it brakes together from now on: see `BrakingTogether`. J is that of the middle of the tick, where a velocity
    that is held moves the hand as it does in the mean. t is Eq. (1) at q, and where joints cannot be so fast, as near
    singular postures, its direction; from one of its answers to a distant one, as after a turn of the stick, t is so
    far from u_last to Eq. (1) as the accelerations allow (`HandTask`). b is the
    answer of the first term alone where that keeps all bounds, so that it stays the answer; u_last after a tick of
    braking where an obstacle or keep-out is in its way, or it passes another bound by what a tick's accelerations can
    do; in between, between them: light joints stay calm. The price of progress grows while the hand creeps although its
    joints could be faster to good effect (`hand_task.CREEPS`).

    **What decreases.** Let d be the part of the hand's last velocity that is no part of r between none and all of it,
    and c one tick of the hardest braking together. c is feasible: its changes are within the accelerations, it lies on
    the way to z, which braking does not move, and every bound is kept at z and on that way. Of the hand's velocity it
    leaves J c = w + progress_c r/|r| + e, where w <= (1 - dt/T) d is what d is allowed to be now, so that off = |e|
    satisfies the task. So the QP has an answer in every tick, and what it delivers besides r lies between w and w + e,
    both of which are at most (1 - dt/T) |d|, but for what the change of the Jacobian within the tick adds, of order
    dt |u|^2: |d| shrinks by that factor a tick or faster. Along r the hand is never faster than |r| but for that. What
    was delivered never becomes a reference; it is only what must shrink. The rows at h are why e stays small while a
    bound or a singular posture stops the hand: it keeps to r while it brakes, also where joints bend its way.

    Without a command all joints brake together as hard as the accelerations allow, and then rest.

    The parameters are q (7,), twist (k,), frame (1,), obstacles (4 each,). See `RedundancyResolver` for the rest.
    """

    requirement = "the rows are dependent at this posture"
    base = CHAIR

    def __init__(
        self,
        robot: MobileArm,
        rows: tuple[str, ...],
        *,
        drive: DriveName,
        self_motion: float,
        max_obstacles: int,
        dt: float,
        recovery_speed: float,
        solver: str,
        backup: str | None,
        tolerance: float,
        max_age: float | None,
        compile: Compile,
        own: OwnLimits,
        feedback: JointFeedback | None = None,
    ) -> None:
        self.robot, self.rows, self.drive, self.max_obstacles = robot, rows, drive, max_obstacles
        self.wheelset = robot.drive(drive)
        self.limits = ChairLimits(
            robot, self.wheelset, max_obstacles=max_obstacles, dt=dt, recovery_speed=recovery_speed, own=own
        )
        n, k, wheels = robot.chain.n, len(rows), len(self.wheelset.rolling)
        self.surroundings = NUMBERS * max_obstacles + own.told
        """Numbers of the obstacles, and behind them of the moving capsules."""
        self.shapes = ((k,), (1,), *([(self.surroundings,)] if self.surroundings else []))  # type: ignore[misc]
        self.task = HandTask(robot, rows, moving=self.limits.moving, self_motion=self_motion)
        if (rank := self.task.rank()) < k:
            raise ConfigurationError("row_sets", rows, f"independent rows; on a {drive} base {rank} of them are")
        # What is remembered: u, where it leads, from where the arm is led to where it is, the command, the wheels' part
        # of it, and of the hand its velocity, the insistence on its progress, and the frame.
        first = 2 * n + (0 if feedback is None else n - CHAIR)
        self.sent, self.wheels = slice(first, first + n), slice(first + n, first + n + wheels)
        super().__init__(
            robot.chain, dt=dt, recovery_speed=recovery_speed, solver=solver, backup=backup, tolerance=tolerance,
            max_age=max_age, compile=compile, feedback=feedback,
        )  # fmt: skip
        full, memory = ca.MX.sym("p", self.stated.parameter_size), ca.MX.sym("memory", self.stated.memory.numel())
        complete = self.stated.complete(full, memory)
        outputs = self.stated.finish.call([complete, memory, self._braking_answer(complete)])
        self._braking_together = BufferedFunction(ca.Function("braking_law", [full, memory], outputs))

    @property
    def guidance_size(self) -> int:
        """How many numbers of the memory, behind velocity and position, say where the led joints are."""
        return 0 if self.feedback is None else self.chain.n - CHAIR

    def _apart(self, memory: ca.SX) -> ca.SX:
        """(n,) from where the joints are led to where they are."""
        n, size = self.chain.n, self.guidance_size
        return ca.vertcat(ca.SX.zeros(n - size), memory[2 * n : 2 * n + size])

    # --------------------------------------------------------------------------------------------- the task
    def statement(self) -> Statement:
        """The QP of one tick."""
        n, k, name = self.chain.n, len(self.rows), "_".join(self.rows)
        q, twist, world = parameter("q", n), parameter("twist", k), parameter("frame", 1)
        obstacles = parameter("obstacles", self.surroundings)
        memory = parameter("last", 3 * n + self.guidance_size + len(self.wheelset.rolling) + k + 2)
        parameters = [q, twist, world, obstacles] if self.surroundings else [q, twist, world]
        last = memory[:n]

        far = self.limits.far()
        keep_outs = parameter("keep_outs", sum(each.numel() for each in far))
        clearance = parameter("clearance", 1)
        closing = ca.reshape(keep_outs[: far[0].numel()], *far[0].shape), keep_outs[far[0].numel() :]
        around = parameter("around", self.max_obstacles * self.limits.obstacles.size)
        contacts = parameter("contacts", self.limits.own.contacts_size)
        moving = ca.sumsqr(twist) > 0
        apart = self._apart(memory)
        limits = self.limits.limits(
            q, last, around, closing, clearance, contacts=contacts, gives_way=moving, apart=apart
        )
        braking, remembered = self.limits.braking, Last(last, memory[-2 - k : -2], memory[-2], memory[-1])
        task = self.task.columns(q, twist, world, last=remembered, limits=limits, braking=braking, dt=self.dt)
        eased = limits._replace(
            lower=ca.if_else(
                moving, ca.fmax(limits.lower, ca.fmin(last - self.limits.braking.change, limits.base)), limits.lower
            ),
            upper=ca.if_else(
                moving, ca.fmin(limits.upper, ca.fmax(last + self.limits.braking.change, limits.base)), limits.upper
            ),
        )
        prepared = {**task, **limits.columns(), "calm": self._calm(last, task, limits, eased)}
        prepared |= {"eased_lower": eased.lower, "eased_upper": eased.upper}
        columns = [parameter(key, value.numel()) for key, value in prepared.items()]
        given = dict(zip(prepared, columns, strict=True))
        limits = limits.like(given)
        jacobian, weight = ca.reshape(given["jacobian"], k, n), symmetric(given["inertia"], n)

        decided = variable("velocity", n, lower=given["eased_lower"], upper=given["eased_upper"])
        progress = variable("progress", 1, lower=0, upper=given["speed"])
        off = variable("off", 1, lower=0, upper=given["off"])
        u, away = decided.symbol, decided.symbol - given["target"]
        steady = STEADY * braking.time / self.dt + CURVED * given["price"] * self.dt * self.limits.reach
        # Steeper the more is missing, since solvers fail more often on a cost that is flat in a variable.
        missing = given["speed"] - progress.symbol
        price = given["price"] * (OFF * off.symbol - progress.symbol) + PROGRESS * (missing**2 + off.symbol**2) / 2
        chassis, others = limits.chassis_rows(u), [self._hand_row(u, given), *limits.surrounding_rows(u)]
        sent = parameter("command", n)
        wanted = ca.if_else(
            moving, self.limits.outside(limits, u) if self.max_obstacles else u, limits.base
        )  # exactly, whichever solver answers
        complete = ca.vertcat(*parameters, *columns)
        self._braking_answer = ca.Function("braking_answer", [complete], [ca.vertcat(limits.base, 0, 0)])
        return Statement(
            name=f"chair_and_arm_{self.drive}_{name}",
            parameters=parameters,
            variables=[decided, progress, off],
            minimise=away.T @ weight @ away / 2 + steady * ca.sumsqr(u - given["calm"]) / 2 + price,
            subject_to=[
                equal(
                    jacobian @ u, given["turning"] + given["direction"] * progress.symbol + given["error"] * off.symbol
                ),
                *chassis,
                *others,
            ],
            lazy_rows=sum(row.expression.numel() for row in others),
            active_set_iterations=ROUNDS,
            iterations=ITERATIONS,
            analytic=ca.vertcat(given["guess"], given["speed"], 0),
            dual=ca.vertcat(given["multipliers"], ca.SX.zeros(limits.row_count + len(AHEAD) * k)),
            precomputed=columns,
            precompute=self._prepared(
                ca.vertcat(*parameters), memory, ca.vertcat(keep_outs, clearance, around, contacts), prepared
            ),
            postprocessed=[sent],
            postprocess=self._settled(
                complete, memory.numel(), ca.vertcat(u, progress.symbol, off.symbol), wanted, limits
            ),
            report=self.report(last, sent, jacobian @ sent, twist, limits.outside),
            memory=memory,
            remember=self.remembered(q, sent, jacobian @ sent, given["insistence"], world),
            violation=limits.violation(sent),
        )

    def _hand_row(self, u: ca.SX, task: Mapping[str, ca.SX]) -> Row:
        """The rows on u (7,) that keep the hand to its way while it brakes."""
        ahead = ca.reshape(task["ahead"], task["ahead_lower"].numel(), self.chain.n)
        return within(ahead @ u, task["ahead_lower"], task["ahead_upper"])

    def _calm(self, last: ca.SX, task: Mapping[str, ca.SX], limits: Limits, eased: Limits) -> ca.SX:
        """(7,) what steadies the command: b of the class."""
        guess, u, braking = task["guess"], ca.SX.sym("u", self.chain.n), self.limits.braking

        def over(row: Row, matrix: ca.SX) -> ca.SX:
            """By how much the guess passes each of its bounds."""
            there = matrix @ guess
            return ca.fmax(there - row.upper, row.lower - there)

        # Of its own bounds as a share of what the accelerations can do in a tick.
        beyond = ca.if_else(all_true(ca.fabs(guess) <= PLAUSIBLE), 0, ca.inf)
        for row in (within(u, eased.lower, eased.upper), *limits.chassis_rows(u), self._hand_row(u, task)):
            matrix = ca.jacobian(row.expression, u)
            shares = over(row, matrix) / ca.fmax(ca.fabs(matrix) @ braking.change, TINY)
            beyond = ca.fmax(beyond, ca.mmax(shares))
        surroundings = [over(row, ca.jacobian(row.expression, u)) for row in limits.surrounding_rows(u)]
        met = ca.mmax(ca.vertcat(ca.SX(0), *surroundings)) > 0
        going = ca.fmin(ca.mmax(ca.fabs(last) / braking.change) / GOING, 1)
        part = ca.if_else(beyond > 0, going * ca.fmax(1 - beyond, 0), 1)
        part = ca.if_else(met, 0, part)
        slower = braking.slower(last)
        return ca.if_else(part > 0, slower + part * (guess - slower), slower)

    def _prepared(
        self, parameters: ca.SX, memory: ca.SX, surroundings: ca.SX, prepared: dict[str, ca.SX]
    ) -> ca.Function:
        """Parameters, memory -> `prepared`; the rows of what is far are not made."""
        n, limits, cse = self.chain.n, self.limits, {"cse": True}
        arm, last = ca.SX.sym("arm", n - CHAIR), ca.SX.sym("last", n - CHAIR)
        near = ca.Function("near", [arm, last], list(limits.near(arm, last)), cse)
        every = [ca.vertcat(ca.vec(ca.densify(row)), free) for row, free in (limits.keep_outs(arm, last), limits.far())]
        some, none = (ca.Function("rows", [arm, last], [ca.densify(each)], cse) for each in every)
        rest = ca.Function(
            "rest", [parameters, memory, surroundings], [ca.densify(ca.vertcat(*prepared.values()))], cse
        )
        p, m = ca.MX.sym("p", parameters.numel()), ca.MX.sym("m", memory.numel())
        inputs = p[CHAIR:n], m[CHAIR:n]
        is_near, clearance = near.call(inputs)
        found = [ca.Function.if_else("keep_outs", some, none)(is_near, *inputs), clearance]
        first = parameters.numel() - self.surroundings
        if self.max_obstacles:
            one, place, chair = ca.SX.sym("one", NUMBERS), ca.SX.sym("place", CHAIR), ca.SX.sym("chair", CHAIR)
            given, obstacles = [one, place, chair], limits.obstacles
            close = ca.Function("close", given, [obstacles.near(*given)], cse)
            rows, nothing = obstacles.column(*given), obstacles.far()
            here, away = (ca.Function("rows", given, [each], cse) for each in (rows, nothing))
            either = ca.Function.if_else("obstacle", here, away)
            for i in range(self.max_obstacles):
                begin = first + NUMBERS * i
                each = p[begin : begin + NUMBERS], p[:CHAIR], m[:CHAIR]
                found.append(either(close(*each), *each))
        found.append(self._contacts(p[:n], m[:n], p[first + NUMBERS * self.max_obstacles :]))
        return ca.Function("prepare", [p, m], [rest(p, m, ca.vertcat(*found))])

    @cached_property
    def _contacts(self) -> ca.Function:
        """Q, last command (7,) with the chair's in its own frame, moving capsules -> see `Limits.contacts`."""
        own, n = self.limits.own, self.chain.n
        here, last = ca.SX.sym("q", n), ca.SX.sym("last", n)
        sent = ca.Function("sent", [here, last], [self.limits.world(here[2], n) @ last])
        inputs = [ca.MX.sym(name, size) for name, size in (("q", n), ("last", n), ("moving", own.told))]
        return ca.Function("contacts", inputs, [own.contacts(inputs[0], sent(*inputs[:2]), inputs[2])])

    def _settled(self, complete: ca.SX, size: int, x: ca.SX, wanted: ca.SX, limits: Limits) -> ca.Function:
        """Complete parameters, memory, x -> the command; the arm's true way is looked at only near a keep-out."""
        n = self.chain.n
        base, u, q = (ca.SX.sym(name, n) for name in ("base", "u", "q"))
        clear = self.limits.clear(wanted, limits.clearance)
        first = ca.Function(
            "wanted", [complete, x], [ca.densify(limits.base), ca.densify(wanted), clear], {"cse": True}
        )
        same = ca.Function("same", [base, u, q], [u])
        checked = self.limits.unhindered(base, u, q[CHAIR:]) if self.robot.keep_out else u
        looked = ca.Function("looked", [base, u, q], [ca.densify(checked)], {"cse": True})
        p, answer = ca.MX.sym("p", complete.numel()), ca.MX.sym("x", x.numel())
        memory = ca.MX.sym("memory", size)
        start, wish, is_clear = first(p, answer)
        command = ca.Function.if_else("unhindered", same, looked)(is_clear, start, wish, p[:n])
        end = n + sum(math.prod(shape) for shape in self.shapes)
        command = self.limits.keeping(p[:n], p[end - self.limits.own.told : end], command, start)
        return ca.Function("settle", [p, memory, answer], [command])

    # ------------------------------------------------------------------------------------------ what is remembered
    def remembered(self, q: ca.SX, u: ca.SX, hand: ca.SX, insistence: ca.SX, frame: ca.SX) -> ca.SX:
        """The memory: see `__init__`."""
        cos, sin = ca.cos(q[2]), ca.sin(q[2])
        value = ca.vertcat(cos * u[0] - sin * u[1], sin * u[0] + cos * u[1], u[2:])
        wheels = self.wheelset.wheel_speeds_expression(u[:CHAIR])
        led = ca.SX.zeros(self.guidance_size)
        return ca.densify(ca.vertcat(u, q + value * self.dt, led, value, wheels, hand, insistence, frame))

    def fallback_command(self) -> Command | None:
        """One tick of braking together: within all bounds, and the next tick may answer again."""
        law, ladder = self._braking_together, self._ladder
        if not ladder.sound[0]:
            return None
        law.inputs[0][:], law.inputs[1][:] = ladder.parameters, ladder.memory
        law()
        (yielded, scale), memory, (violation,) = law.outputs
        if not 0.0 <= violation <= self.tolerance:
            return None
        ladder.memory[:] = memory
        ladder.warm_start(0.0)
        value, wheels = self._sent_now()
        bound, reason = Bound(int(yielded)), f"{self._fault()}: braking together"
        return Command(
            value, Status.BACKUP, "braking together", float(violation), -1, reason, bound, float(scale), wheels
        )

    def braking(self) -> ca.Function:
        """q, memory, obstacles -> what is remembered of the safe command, and its report."""
        n, own = self.chain.n, self.limits.own
        q, obstacles = ca.SX.sym("q", n), ca.SX.sym("obstacles", self.surroundings)
        memory, contacts = ca.SX.sym("memory", self.stated.memory.numel()), ca.SX.sym("contacts", own.contacts_size)
        last, arm = memory[:n], q[CHAIR:]
        _, clearance = self.limits.near(arm, last[CHAIR:])
        each = [obstacles[NUMBERS * i : NUMBERS * (i + 1)] for i in range(self.max_obstacles)]
        around = ca.vertcat(ca.SX(0, 1), *(self.limits.obstacles.column(one, q[:CHAIR], last[:CHAIR]) for one in each))
        keep_outs = self.limits.keep_outs(arm, last[CHAIR:])
        limits = self.limits.limits(
            q, last, around, keep_outs, clearance, contacts=contacts, gives_way=ca.SX(0), apart=self._apart(memory)
        )
        rest = self.limits.unhindered(limits.base, limits.base, arm) if self.robot.keep_out else limits.base
        inputs = [q, memory, obstacles, contacts]
        slower = ca.Function("slower", inputs, [ca.densify(rest), limits.outside], {"cse": True})
        u, outside = ca.SX.sym("u", n), ca.SX.sym("outside")
        report = self.report(last, u, ca.SX(0), ca.SX(1), outside)  # nothing of the task is delivered
        remembered = self.remembered(q, u, ca.SX.zeros(len(self.rows)), ca.SX(0), ca.SX(UNKNOWN))
        told = ca.Function("told", [q, memory, u, outside], [remembered, ca.densify(report)], {"cse": True})
        here, before, room = (ca.MX.sym("p", each.numel()) for each in (q, memory, obstacles))
        bodies = room[NUMBERS * self.max_obstacles :]
        start, beyond = slower(here, before, room, self._contacts(here, before[:n], bodies))
        answer = told.call([here, before, self.limits.keeping(here, bodies, start, start), beyond])
        return ca.Function("braking", [here, before, room] if self.surroundings else [here, before], answer)

    # ----------------------------------------------------------------------------------------- for the resolver
    def tell_obstacles(self, numbers: Array) -> None:
        """Write the obstacles, for all ticks until the next call."""
        if self.max_obstacles:
            self._inputs[2][: numbers.size] = numbers

    def tell(self, q: ArrayLike, twist: ArrayLike, world: float, moving: Array | None) -> None:
        """Write the other parameters of a tick; `moving` by `moving_numbers`, where there are such.

        Raises
        ------
        ConfigurationError : an argument of the wrong shape, or no numbers.
        """
        if moving is not None:
            self._inputs[2][-moving.size :] = moving.reshape(-1)
        views = self._views
        try:
            # From view to view: half of numpy's cost, and any other type or size is refused.
            views[0][:] = q  # type: ignore[assignment]
            views[1][:] = twist  # type: ignore[assignment]
            views[2][0] = world
        except (ValueError, TypeError):
            self._write((q, twist, [world], *self._inputs[2:]))

    tick = VelocityController._tick
    """One step on what was told."""

    def brake(self, reason: str) -> Command:
        """The safe command at what was told."""
        return self._safe(reason)

    def begin(self, velocity: Array, heading: float) -> None:
        """Forget the past; `velocity` (7,) has the chair's share in its own frame."""
        self.reset(velocity)
        self._predicted[2] = heading  # should the first position be unusable
        self._ladder.memory[-1] = UNKNOWN

    def take_over(self, other: ChairAndArm) -> None:
        """Go on where another set of rows ends: its velocity, position and stamps are this one's."""
        self._ladder.memory[:] = self._memory_after(other)
        self._ladder.warm_start(0.0)
        self._watchdog, self.led = other._watchdog, other.led
        self._watch.take_over(other._watch)

    def instance_after(self, other: ChairAndArm, *inputs: ArrayLike) -> Instance:
        """The QP of a tick that goes on where `other` ends, as numbers; nothing changes."""
        return self.stated.instance(*inputs, memory=self._memory_after(other))

    def _memory_after(self, other: ChairAndArm) -> Array:
        """What this one remembers where it goes on after `other`: of the hand, nothing."""
        memory, first = self._ladder.memory.copy(), self.chain.n * 2
        if other is not self:
            theirs = other._ladder.memory.copy()
            memory[:first], memory[self.sent] = theirs[:first], theirs[self.sent]
            memory[-1] = UNKNOWN
        return memory

    @property
    def velocity(self) -> Array:
        """(7,) last command, the chair's share in its own frame."""
        return self._last.copy()
