"""The QP of chair and arm for one set of task rows: Honzik's Eq. (1) with bounds."""

from __future__ import annotations

from functools import cached_property
from typing import Literal

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.asked_motion import PROGRESS, AskedMotion
from rehab_opt.control.command import Bound, Command, Status
from rehab_opt.control.easing import Easing
from rehab_opt.control.easing_branches import eased_and_unhindered, where_the_way_begins
from rehab_opt.control.obstacles import NUMBERS
from rehab_opt.control.room import Surroundings
from rehab_opt.control.velocity_controller import VelocityController
from rehab_opt.kinematics.mobile_arm import CHAIR, MobileArm
from rehab_opt.optim.factor import symmetric
from rehab_opt.optim.qp import PLAUSIBLE, Statement, equal, parameter, variable
from rehab_opt.symbolic import BufferedFunction

__all__ = ["ChairAndArm", "Drive"]

Array = NDArray[np.float64]
Drive = Literal["mecanum", "differential"]
UNKNOWN = -1.0
"""In place of the frame: 0 for the chassis frame, 1 for the world, this where no twist is remembered."""
ROUNDS = 2
"""Corrections of the last tick's active set: it is the same in 95 % of the ticks in which any bound is active."""
ITERATIONS = 20
"""Cap on qrqp's active-set changes: most ticks need three, and what takes more than this cycles."""


class ChairAndArm(VelocityController):
    """Joint velocities for a hand twist in one set of rows.

    min  1/2 u'W u + v(|r|) (W grad c)'u - price progress     over u, 0 <= progress <= |r|
    s.t. J u = progress r/|r|,  and the bounds below: `Room`

    u are the joint velocities with the chair's in the chassis frame (forward, left, turn), in which neither W nor the
    arm's Jacobian knows where the chair stands: that a turned or shifted scene changes nothing is by construction, and
    the rolling row, Eq. (4), is a left speed of zero. r is the asked twist, led there from the twist of the last
    command as fast as the accelerations allow: r = r_last + share (asked - r_last). u = 0 is always feasible. The QP's
    own variables are u in `units`, which differ by what each joint weighs.

    Where the answer changes a joint faster than its acceleration allows after all, `Easing` goes only a part of the
    way from the last command to it. The result is certified again, against all bounds, before it is sent.

    The parameters are q (7,), twist (k,), frame (1,), obstacles (4 each,). See `RedundancyResolver` for the rest.
    """

    requirement = "the rows are dependent at this posture"

    def __init__(
        self,
        robot: MobileArm,
        rows: tuple[str, ...],
        *,
        drive: Drive,
        self_motion: float,
        slots: int,
        dt: float,
        return_speed: float,
        solver: str,
        backup: str | None,
        tolerance: float,
        max_age: float | None,
        compile: bool | None,
    ) -> None:
        self.robot, self.rows, self.drive, self.slots = robot, rows, drive, slots
        self.self_motion = self_motion
        self.wheelset = getattr(robot, drive)
        self.surroundings = Surroundings(robot, self.wheelset, slots=slots, dt=dt, return_speed=return_speed)
        n, k, wheels = robot.chain.n, len(rows), len(self.wheelset.rolling)
        self.shapes = ((k,), (1,), (NUMBERS * slots,))  # type: ignore[misc]
        self.shapes = self.shapes if slots else self.shapes[:2]  # type: ignore[misc]
        self._asked = AskedMotion(robot, rows, moving=self.surroundings.moving, self_motion=self_motion, dt=dt)
        # What is remembered: u, where it leads, what is sent, the wheels' share of it, r, what of it was delivered, and
        # in which frame.
        self.sent, self.wheels = slice(2 * n, 3 * n), slice(3 * n, 3 * n + wheels)
        self.limited = slice(3 * n + wheels, 3 * n + wheels + k)
        super().__init__(
            robot.chain, dt=dt, return_speed=return_speed, solver=solver, backup=backup, tolerance=tolerance,
            max_age=max_age, compile=compile,
        )  # fmt: skip
        full, memory = ca.MX.sym("p", self.stated.parameter_size), ca.MX.sym("memory", self.stated.memory.numel())
        complete = self.stated.complete(full, memory)
        outputs = self.stated.finish.call([complete, memory, self._slowed(complete, memory)])
        self._slowed_law = BufferedFunction(ca.Function("slowed_law", [full, memory], outputs))

    # --------------------------------------------------------------------------------------------- the task
    @cached_property
    def units(self) -> Array:
        """(7,) sizes in which velocities are decided: such that each, in mid-range, has the robot's kinetic energy.

        A wrist weighs a ten-thousandth of a chair; without this qrqp gives up on a quarter of random states.
        """
        middle = np.zeros(self.chain.n)
        middle[CHAIR:] = (self.chain.lower[CHAIR:] + self.chain.upper[CHAIR:]) / 2
        sizes: Array = np.sqrt(self.robot.mass / np.diag(self.robot.inertia(middle)))
        return sizes

    def statement(self) -> Statement:
        """The QP of one tick."""
        n, k, name = self.chain.n, len(self.rows), "_".join(self.rows)
        q, twist, world = parameter("q", n), parameter("twist", k), parameter("frame", 1)
        obstacles = parameter("obstacles", NUMBERS * self.slots)
        size = 3 * n + len(self.wheelset.rolling) + 2 * k + 1
        memory = parameter("last", size)
        parameters = [q, twist, world, obstacles] if self.slots else [q, twist, world]

        room = self.surroundings.room(q, memory[:n], obstacles)
        prepared = {**self._asked.columns(q, twist, world, memory, room), **room.columns()}
        columns = [parameter(key, value.numel()) for key, value in prepared.items()]
        given = dict(zip(prepared, columns, strict=True))
        jacobian = ca.reshape(given["jacobian"], k, n)
        room = room.like(given)
        weight = symmetric(given["inertia"], n)

        unit = ca.DM(self.units)
        decided = variable("velocity", n, lower=room.lower / unit, upper=room.upper / unit)
        u = unit * decided.symbol
        progress = variable("progress", 1, lower=0, upper=given["speed"])
        kinetic = u.T @ weight @ u / 2
        # Steeper the more is missing, since solvers fail more often on a cost that is flat in a variable.
        missing = given["speed"] - progress.symbol
        reward = -given["price"] * progress.symbol + PROGRESS * missing**2 / 2
        base, eased, unhindered = parameter("base", n), parameter("eased", n), parameter("unhindered", 1)
        easing = Easing(self.robot, self.dt, room, base=base)
        wanted = ca.if_else(given["speed"] > 0, u, 0)  # exactly, whichever solver answers
        sent = easing.waiting(memory[:n], eased, unhindered)
        share = room.share_of(given["guess"])
        slowed = ca.vertcat(share * given["guess"] / unit, share * given["speed"])
        self._slowed = ca.Function("slowed", [ca.vertcat(*parameters, *columns, base), memory], [slowed], {"cse": True})
        return Statement(
            name=f"chair_and_arm_{self.drive}_{name}",
            parameters=parameters,
            variables=[decided, progress],
            minimise=kinetic + given["self_motion"].T @ u + reward,
            subject_to=[
                equal(jacobian @ u, given["direction"] * progress.symbol),  # the direction of the hand is kept
                *room.rows(u),
            ],
            seldom=room.towards.size1() + room.closing.size1(),
            rounds=ROUNDS,
            iterations=ITERATIONS,
            guess=ca.vertcat(given["guess"] / unit, given["speed"]),
            multipliers=ca.vertcat(given["multipliers"], ca.SX.zeros(room.row_count)),
            prepared=[*columns, base],
            prepare=_completed(ca.vertcat(*parameters), memory, prepared, columns, Easing(self.robot, self.dt, room)),
            settled=[eased, unhindered],
            settle=eased_and_unhindered(
                ca.vertcat(*parameters, *columns, base),
                memory,
                ca.vertcat(decided.symbol, progress.symbol),
                easing,
                wanted,
            ),
            report=self.report(memory[:n], sent, jacobian @ sent, twist, room.outside),
            memory=memory,
            remember=self.remembered(q, sent, given["direction"] * given["speed"], jacobian @ sent, world),
            violation=room.violation(sent),
        )

    # ------------------------------------------------------------------------------------------ what is remembered
    def remembered(self, q: ca.SX, u: ca.SX, limited: ca.SX, delivered: ca.SX, frame: ca.SX) -> ca.SX:
        """The memory: see `__init__`."""
        cos, sin = ca.cos(q[2]), ca.sin(q[2])
        value = ca.vertcat(cos * u[0] - sin * u[1], sin * u[0] + cos * u[1], u[2:])
        wheels = self.wheelset.wheel_speeds_expression(u[:CHAIR])
        return ca.densify(ca.vertcat(u, q + value * self.dt, value, wheels, limited, delivered, frame))

    def lesser_command(self) -> Command | None:
        """Eq. (1) slowed as a whole into the bounds: not the best that they allow, but as safe."""
        law, ladder = self._slowed_law, self._ladder
        if not ladder.sound[0]:
            return None
        law.inputs[0][:], law.inputs[1][:] = ladder.parameters, ladder.memory
        law()
        (yielded, scale), memory, (violation,) = law.outputs
        if not 0.0 <= violation <= self.tolerance:
            return None
        ladder.memory[:] = memory
        ladder.start_from(0.0)
        value, wheels = self._sent_now()
        bound, reason = Bound(int(yielded)), f"{self._fault()}: Eq. (1), slowed into the bounds"
        return Command(value, Status.BACKUP, "slowed law", float(violation), -1, reason, bound, float(scale), wheels)

    def braking(self) -> ca.Function:
        """q, memory, obstacles -> what is remembered of the safe command, and its report."""
        n = self.chain.n
        q, obstacles = ca.SX.sym("q", n), ca.SX.sym("obstacles", NUMBERS * self.slots)
        memory = ca.SX.sym("memory", self.stated.memory.numel())
        last = memory[:n]
        room = self.surroundings.room(q, last, obstacles)
        easing = Easing(self.robot, self.dt, room)
        rest = easing.towards(last, ca.SX.zeros(n), q[CHAIR:])
        report = self.report(last, rest, ca.SX(0), ca.SX(1), room.outside)  # nothing of the task is delivered
        nothing = ca.SX.zeros(len(self.rows))
        outputs = [self.remembered(q, rest, nothing, nothing, ca.SX(UNKNOWN)), report]
        inputs = [q, memory, obstacles] if self.slots else [q, memory]
        return ca.Function("braking", inputs, outputs, {"cse": True})

    def tell_braking(self, inputs: tuple[Array, ...]) -> None:
        """Also the obstacles, where they are usable: the chair could stop before them, and brakes."""
        super().tell_braking(inputs)
        if self.slots:
            told = self._inputs[-1]
            inputs[2][:] = told if np.all(np.abs(told) <= PLAUSIBLE) else 0.0

    # ----------------------------------------------------------------------------------------- for the resolver
    def tell_obstacles(self, numbers: Array) -> None:
        """Write the obstacles, for all ticks until the next call."""
        if self.slots:
            self._inputs[2][:] = numbers

    def tell(self, q: ArrayLike, twist: ArrayLike, world: float) -> None:
        """Write the other parameters of a tick.

        Raises
        ------
        ConfigurationError : an argument of the wrong shape, or no numbers.
        """
        views = self._views
        try:
            # From view to view: half of numpy's cost, and any other type or size is refused.
            views[0][:] = q  # type: ignore[assignment]
            views[1][:] = twist  # type: ignore[assignment]
            views[2][0] = world  # type: ignore[call-overload]
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
        self._last[:], self._predicted[:] = other._last, other._predicted
        self._ladder.memory[-1] = UNKNOWN
        self._ladder.start_from(0.0)
        self._watchdog, self._stamped = other._watchdog, other._stamped

    @property
    def velocity(self) -> Array:
        """(7,) last command, the chair's share in its own frame."""
        return self._last.copy()

    @property
    def limited_twist(self) -> Array:
        """(k,) what the last tick's twist became within the accelerations."""
        return self._ladder.memory[self.limited].copy()


def _completed(
    parameters: ca.SX, memory: ca.SX, prepared: dict[str, ca.SX], columns: list[ca.SX], easing: Easing
) -> ca.Function:
    """Parameters, memory -> `prepared`, of which `columns` are the symbols, and where the way begins."""
    first = ca.Function("prepared", [parameters, memory], [ca.densify(ca.vertcat(*prepared.values()))], {"cse": True})
    begins = where_the_way_begins(ca.vertcat(*columns), memory, easing)
    given = [ca.MX.sym("given", each.numel()) for each in (parameters, memory)]
    found = first(*given)
    return ca.Function("prepare", given, [ca.vertcat(found, begins(found, given[1]))])
