"""The plants that the tables stand for, and the option that goes before a file's."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from typing import TYPE_CHECKING, TypeVar

from rehab_opt.control.joint_feedback import JointFeedback
from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.ur5 import ur5
from rehab_opt.plants.channel import Channel
from rehab_opt.plants.ideal import IdealJoints
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.live.problem import DeviceAddress
from rehab_opt.session.plant.tables import DEVICES, KINDS, ChairPlant, JointPlant, PlantTable
from rehab_opt.session.schema import Problem

if TYPE_CHECKING:
    from rehab_opt.kinematics.chain import SerialChain
    from rehab_opt.kinematics.drive import Drive
    from rehab_opt.kinematics.mobile_arm import MobileArm
    from rehab_opt.plants.plant import Plant
    from rehab_opt.plants.wheelchair import Wheelchair

__all__ = [
    "chair_plant", "channel_of", "device_of", "joint_feedback", "joint_plant", "ms", "on_plant", "plant_note",
]  # fmt: skip

P = TypeVar("P", bound=Problem)


def on_plant(loaded: ProblemFile[P], kind: str | None) -> ProblemFile[P]:
    """The problem on the kind of plant that `--plant` asks for; as the file says where it asks for nothing.

    Raises
    ------
    ConfigurationError : there is no such kind, or what it needs is not installed.
    """
    if kind is not None and kind not in KINDS:
        raise ConfigurationError("--plant", kind, f"one of {', '.join(KINDS)}")
    table: PlantTable = loaded.problem.plant  # type: ignore[attr-defined]  # of every system that takes the option
    if kind is not None and kind != table.kind:
        # A robot that moves as commanded has no delays: those of the file are left out with it.
        table = type(table)(kind="ideal") if kind == "ideal" else type(table)(kind="mujoco")
        loaded = replace(loaded, problem=loaded.problem.model_copy(update={"plant": table}))
    if table.kind == "mujoco":
        from rehab_opt.plants.mujoco_arm import mujoco_module  # noqa: PLC0415  (loads slowly)

        mujoco_module()
    return loaded


def joint_plant(table: JointPlant, chain: SerialChain, dt: float) -> Plant:
    """A simulated arm that takes joint velocities [rad/s]: a UR5, or one whose robot file has masses and efforts.

    Raises
    ------
    ConfigurationError : physics of an arm from a robot file that has not; a robot that is there.
    """
    if table.kind in DEVICES:
        expected = (
            f"one of {', '.join(KINDS)}, by --plant: a robot that is there runs in time, `rehab-opt loop` or `live`"
        )
        raise ConfigurationError("plant.kind", table.kind, expected)
    if table.kind == "ideal":
        return IdealJoints(dt)
    from rehab_opt.plants.arm_model import own_arm_model, ur5_model  # noqa: PLC0415
    from rehab_opt.plants.drives import PositionServo, VelocityServo  # noqa: PLC0415  (loads MuJoCo)
    from rehab_opt.plants.mujoco_arm import MujocoArm  # noqa: PLC0415
    from rehab_opt.plants.streaming import PositionStream  # noqa: PLC0415

    servo = VelocityServo if table.servo == "velocity" else PositionServo
    arm = MujocoArm(
        (ur5_model if chain.rows == ur5().rows else own_arm_model)(chain, payload=table.payload_kg),
        dt=dt,
        drive=servo(table.servo_hz),
        channel=channel_of(table),
        seed=table.seed,
        physics_step=ms(table.physics_step_ms),
    )
    return arm if table.servo == "velocity" else PositionStream(arm)


def device_of(table: JointPlant) -> DeviceAddress | None:
    """Where the robot of a table is; None of a simulated one."""
    return None if table.address is None else DeviceAddress(table.kind, table.address)


def joint_feedback(table: JointPlant | ChairPlant) -> JointFeedback | None:
    """What a controller is told of that robot: its servos, and its mean delays with their jitter; None of ideal joints.

    A servo of the position counts as joints that move as commanded, later by as much as it trails.

    Raises
    ------
    ConfigurationError : the delay of a robot that is there is not known.
    """
    if table.kind == "ideal":
        return None
    if isinstance(table, JointPlant) and table.kind in DEVICES:
        if table.delay_ms is None:
            raise ConfigurationError("plant.delay_ms", None, "what `rehab-opt delay FILE` measures")
        return JointFeedback(delay=ms(table.delay_ms))
    jitter = table.command_jitter_ms + table.measurement_jitter_ms
    delay = ms(table.command_delay_ms + table.measurement_delay_ms + jitter / 2)
    if isinstance(table, ChairPlant):
        return JointFeedback(delay=delay, servo_hz=table.servo_hz)
    if table.servo == "velocity":
        return JointFeedback(delay=delay, servo_hz=table.servo_hz, contact=table.contact_m)
    from rehab_opt.plants.drives import PositionServo  # noqa: PLC0415  (loads MuJoCo)

    return JointFeedback(delay=delay + PositionServo(table.servo_hz).lag, servo_hz=math.inf, contact=table.contact_m)


def chair_plant(table: ChairPlant, robot: MobileArm, wheels: Drive, dt: float, *, own_arm: bool = False) -> Wheelchair:
    """A chair that takes wheel speeds, and its arm's joint velocities [rad/s]: ARDIS, or with an arm from a robot file.

    Raises
    ------
    ConfigurationError : the file of such an arm has no masses, or no effort of a joint.
    """
    from rehab_opt.plants.drives import VelocityServo  # noqa: PLC0415  (loads MuJoCo)
    from rehab_opt.plants.wheelchair import Wheelchair, own_chair_arm_model  # noqa: PLC0415

    return Wheelchair(
        robot,
        wheels,
        dt=dt,
        wheel_lag=ms(table.wheel_lag_ms),
        drive=VelocityServo(table.servo_hz),
        arm=own_chair_arm_model(robot) if own_arm else None,
        channel=channel_of(table),
        seed=table.seed,
        physics_step=ms(table.physics_step_ms),
    )


def channel_of(table: PlantTable) -> Channel:
    """Delays, jitter and noise of the table."""
    known = {each.name for each in fields(Channel)}
    return Channel(**{name: value for name, value in table.arguments().items() if name in known})


def plant_note(table: PlantTable, ideal: str) -> str:
    """What a reader has to know of the robot: `ideal` says it of one that does as it is told."""
    if table.kind == "ideal":
        return ideal
    both = table.command_delay_ms + table.measurement_delay_ms
    return (
        f"the robot is simulated in MuJoCo: {both:g} ms of delay (commands {table.command_delay_ms:g}, measurements "
        f"{table.measurement_delay_ms:g}), {table.imperfections}; {table.told_truly} the true ones"
    )


def ms(milliseconds: float) -> float:
    """[s]"""
    return 1e-3 * milliseconds
