"""A stick, a controller and a robot: the closed loop of `system = "ardis"`."""

from __future__ import annotations

import math
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rehab_opt.control.command import Command, Relaxed, Status
from rehab_opt.control.joystick import Joystick, StickCommand
from rehab_opt.kinematics.mobile_arm import CHAIR, MobileArm
from rehab_opt.plants.plant import Measurement, Plant
from rehab_opt.published.pseudoinverse_law import PseudoinverseLaw
from rehab_opt.session.ardis.stick import LET_GO, Moment, StickRecording
from rehab_opt.session.ardis.user import SimulatedUser
from rehab_opt.session.live.problem import LiveControl, LiveInputs
from rehab_opt.session.outcome import Array

NO_ANSWER = "no answer"


class Published:
    """The published controller, Eq. (1) of Honzik; if the equation has no solution, the robot rests."""

    def __init__(self, law: PseudoinverseLaw) -> None:
        self._law = law

    def step(
        self, q: Array, twist: Array, rows: tuple[str, ...], frame: str, *, enable: object, stamp: float | None
    ) -> Command:
        """Command of Eq. (1) for the stick's twist; `enable` and `stamp` have no effect."""
        velocity = np.full(len(q), math.nan)
        with suppress(np.linalg.LinAlgError):
            velocity = self._law.rate(q, twist, rows, frame)
        answered = bool(np.all(np.isfinite(velocity)))
        status, reason = (Status.OK, "") if answered else (Status.HOLDING, NO_ANSWER)
        velocity = velocity if answered else np.zeros(len(q))
        wheels = self._law.wheels(q, velocity)
        return Command(velocity, status, "", math.inf, -1, reason, Relaxed.NOTHING, 1.0, wheels)


class Steering(LiveControl):
    """The closed loop of a stick, a controller and a robot.

    Parameters
    ----------
    law : a `RedundancyResolver`, or `Published`.
    stick : recording or simulated user, which moves the robot without a live user; the simulated user is not shared.
    plant : takes joint velocities; if `wheels` is true, it takes wheel speeds and the arm's joint velocities.
    start : (n,) joint positions [m, rad].

    Attributes
    ----------
    law : controller, replaceable by one of the same class. ticks_let_go : ticks since the last release of the stick.
    """

    def __init__(
        self,
        robot: MobileArm,
        law: Any,
        joystick: Joystick,
        stick: StickRecording | SimulatedUser,
        *,
        plant: Plant,
        start: Array,
        wheels: bool,
    ) -> None:
        super().__init__(plant, start)
        self._robot, self._joystick, self.law, self._stick, self._wheels = robot, joystick, law, stick, wheels
        self.mode, self.ticks_let_go = joystick.mode.name, 0
        self.commanded: StickCommand

    def untouched(self, time: float) -> LiveInputs:
        """Inputs of the stick at `time` [s]; a simulated user sees the true state of the robot."""
        now = self.plant.truth.position
        inputs = self._stick.at(Moment(time, now, self._robot.chain.pose(now)[:3, 3], self.mode))
        self.ticks_let_go += inputs is None
        return LET_GO if inputs is None else inputs

    def step(self, inputs: LiveInputs, seen: Measurement) -> Command:
        """The controller's command for the stick's twist."""
        # NaN while `enable` is released; afterwards the stick moves nothing until it has been released once.
        axes = inputs.stick if inputs.enable else (math.nan, math.nan)
        self.axes = inputs.stick
        commanded = self.commanded = self._joystick.step(axes, switch=inputs.switch, gripper=inputs.gripper)
        self.mode = self._joystick.mode.name
        how: dict[str, Any] = {"enable": inputs.enable, "stamp": self.stamp(seen)}
        command: Command = self.law.step(seen.position, commanded.twist, commanded.rows, commanded.frame, **how)
        return command._replace(reason=commanded.reason) if inputs.enable and not command.reason else command

    def plant_command(self, command: Command) -> Array:
        """Wheel speeds instead of the chair's velocity, if the plant has wheels."""
        if not self._wheels or command.wheels is None:
            return command.value
        return np.concatenate([command.wheels, command.value[CHAIR:]])

    def shown(self) -> dict[str, ArrayLike]:
        """Numbers for the page: joint positions, force on the hand, and state of the gripper."""
        truth = self.plant.truth
        return {"q": truth.position, "force": truth.force, "closed": self.commanded.gripper_closed}
