"""Which robot a problem is run on: the table `[plant]`, the option `--plant` that goes before it, and their plants."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self, TypeVar, get_args

from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.kinematics.drive import Drive
from rehab_opt.kinematics.mobile_arm import MobileArm
from rehab_opt.kinematics.ur5 import ur5
from rehab_opt.plants.channel import Channel
from rehab_opt.plants.ideal import IdealJoints
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.live.problem import DeviceAddress
from rehab_opt.session.schema import Problem, Section, refusal

if TYPE_CHECKING:
    from rehab_opt.plants.plant import Plant
    from rehab_opt.plants.wheelchair import Wheelchair

__all__ = [
    "KINDS",
    "ChairPlant",
    "HandPlant",
    "JointPlant",
    "Kind",
    "PlantTable",
    "Simulated",
    "chair_plant",
    "channel_of",
    "device_of",
    "joint_plant",
    "ms",
    "on_plant",
    "plant_note",
]

P = TypeVar("P", bound=Problem)

Simulated = Literal["ideal", "mujoco"]
Kind = Literal["ideal", "mujoco", "ur", "franka", "ros2"]
KINDS: tuple[Simulated, ...] = get_args(Simulated)
"""What `--plant` takes: a robot that is there has an address, which stands in the file."""
DEVICES: tuple[Kind, ...] = ("ur", "franka", "ros2")
DEVICE_KEYS = frozenset({"kind", "address"})
Milliseconds = Annotated[float, Field(ge=0, le=1000)]


class PlantTable(Section):
    """Which robot, and how late and noisy the way to it is. The defaults are a choice: a usual network servo."""

    kind: Kind = "ideal"
    """Which robot."""
    command_delay_ms: Milliseconds = 3.0
    """From a command until it acts."""
    command_jitter_ms: Milliseconds = 0.0
    """Up to so much longer, drawn evenly; no command overtakes another."""
    measurement_delay_ms: Milliseconds = 2.0
    """So old is what a controller sees."""
    measurement_jitter_ms: Milliseconds = 0.0
    """Up to so much older, likewise."""
    physics_step_ms: float = Field(default=0.5, ge=0.01, le=5)
    """At most; delays are exact to it, and never shorter."""
    seed: int = Field(default=0, ge=0, le=2**31)
    """Of jitter and noise."""

    @property
    def keys(self) -> frozenset[str]:
        """That a robot of this kind has."""
        if self.kind == "ideal":
            return frozenset({"kind"})
        return frozenset(type(self).model_fields) - DEVICE_KEYS | {"kind"} if self.kind == "mujoco" else DEVICE_KEYS

    @model_validator(mode="after")
    def each_kind_has_its_keys(self) -> Self:
        """Refuse delays and noise of a robot that has none, rather than leave them out unsaid."""
        if said := sorted(self.model_fields_set - self.keys):
            others = '"ur", "franka" or "ros2"' if said[0] in DEVICE_KEYS else '"mujoco"'
            raise refusal(said[0], getattr(self, said[0]), f"no such key but for kind = {others}")
        return self

    told_truly: ClassVar[str] = "places and speeds are"
    """What the numbers and figures of a run have of the true robot."""

    @property
    def imperfections(self) -> str:
        """Noise and lags besides the delays, in words."""
        raise NotImplementedError

    @model_serializer(mode="wrap")
    def without_keys_of_others(self, whole: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Those of its kind alone, written as read."""
        written: dict[str, Any] = whole(self)
        return {key: value for key, value in written.items() if key in self.keys}


class JointPlant(PlantTable):
    """An arm whose joints have servos."""

    kind: Kind = "ideal"
    """Joints that move exactly as commanded, a robot with mass in MuJoCo, or one that is there, for `loop` and `live`:
    of Universal Robots, Franka's, or of ROS 2, its joints named as here. `--plant` goes before it. An ideal robot has
    no other keys, one that is there the next one."""
    address: str | None = Field(default=None, min_length=1)
    """Of that robot's controller."""
    servo: Literal["velocity", "position"] = "velocity"
    """A proportional-integral servo of each joint's speed, or a critically damped spring to the position that the
    commands add up to."""
    servo_hz: float = Field(default=24.0, gt=0, le=500)
    """Where the servo follows by 3 dB less."""
    position_noise_rad: float = Field(default=1e-4, ge=0, le=0.1)
    """Standard deviation of the encoders' noise."""
    position_resolution_rad: float = Field(default=0.0, ge=0, le=0.1)
    """One count of the encoders."""
    payload_kg: float = Field(default=0.0, ge=0, le=10)
    """At the tool, unknown to the servos but for its weight."""

    @model_validator(mode="after")
    def a_robot_that_is_there_has_an_address(self) -> Self:
        """Refuse one without."""
        if self.kind in DEVICES and self.address is None:
            raise refusal("address", None, f"the address of the robot of kind {self.kind!r}")
        return self

    @property
    def imperfections(self) -> str:
        """Of encoders and servos."""
        noise = 1e3 * self.position_noise_rad
        return f"{noise:g} mrad of noise, a {self.servo} servo of {self.servo_hz:g} Hz"


class HandPlant(PlantTable):
    """A robot in the plane whose force on the hand is commanded."""

    kind: Simulated = "ideal"
    """Joints that move exactly as commanded, or a robot with mass in MuJoCo; `--plant` goes before it. An ideal robot
    has no other keys."""

    force_lag_ms: Milliseconds = 3.0
    """Time constant of the motors' force, behind the robot's own force loop."""
    position_noise_m: float = Field(default=2e-5, ge=0, le=0.01)
    """Standard deviation of the sensor's noise."""
    position_resolution_m: float = Field(default=0.0, ge=0, le=0.01)
    """One count of the sensor."""

    @property
    def imperfections(self) -> str:
        """Of the sensor and the motors."""
        return f"{1e3 * self.position_noise_m:g} mm of noise, {self.force_lag_ms:g} ms of lag of the force"


class ChairPlant(PlantTable):
    """A wheelchair with an arm."""

    kind: Simulated = "ideal"
    """Joints that move exactly as commanded, or a robot with mass in MuJoCo; `--plant` goes before it. An ideal robot
    has no other keys."""

    physics_step_ms: float = Field(default=1.0, ge=0.01, le=5)
    """At most; delays are exact to it, and never shorter."""
    wheel_lag_ms: Milliseconds = 80.0
    """Time constant of each wheel's speed."""
    servo_hz: float = Field(default=24.0, gt=0, le=500)
    """Where the velocity servo of the arm's joints follows by 3 dB less."""
    position_noise_rad: float = Field(default=1e-4, ge=0, le=0.1)
    """Standard deviation of the encoders' noise."""

    told_truly: ClassVar[str] = "places are"

    @property
    def imperfections(self) -> str:
        """Of the sensors and the wheels."""
        noise, lag = 1e3 * self.position_noise_rad, self.wheel_lag_ms
        return f"{noise:g} mrad of noise, {lag:g} ms of lag of the wheels"


def on_plant(config: ProblemFile[P], kind: str | None) -> ProblemFile[P]:
    """The problem on the kind of plant of `--plant`; without that option, on the file's.

    Raises
    ------
    ConfigurationError : there is no such kind, or what it needs is not installed.
    """
    if kind is not None and kind not in KINDS:
        raise ConfigurationError("--plant", kind, f"one of {', '.join(KINDS)}")
    table: PlantTable = config.problem.plant  # type: ignore[attr-defined]  # of every system that takes the option
    if kind is not None and kind != table.kind:
        # A robot that moves as commanded has no delays: those of the file are left out with it.
        table = type(table).model_validate({"kind": kind})
        config = replace(config, problem=config.problem.model_copy(update={"plant": table}))
    if table.kind == "mujoco":
        from rehab_opt.plants.mujoco_arm import mujoco_module  # noqa: PLC0415  (loads slowly)

        mujoco_module()
    return config


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
    from rehab_opt.plants.plant import PositionStream  # noqa: PLC0415

    servo = VelocityServo if table.servo == "velocity" else PositionServo
    arm = MujocoArm(
        (ur5_model if chain.rows == ur5().rows else own_arm_model)(chain, payload=table.payload_kg),
        dt=dt,
        drive=servo(table.servo_hz),
        channel=channel_of(table),
        **table.arguments("seed", "physics_step_ms"),
    )
    return arm if table.servo == "velocity" else PositionStream(arm)


def device_of(table: JointPlant) -> DeviceAddress | None:
    """Where the robot of a table is; None of a simulated one."""
    return None if table.address is None else DeviceAddress(table.kind, table.address)


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
        drive=VelocityServo(table.servo_hz),
        arm=own_chair_arm_model(robot) if own_arm else None,
        channel=channel_of(table),
        **table.arguments("wheel_lag_ms", "seed", "physics_step_ms"),
    )


def channel_of(table: PlantTable) -> Channel:
    """Delays, jitter and noise of the table."""
    known = {each.name for each in fields(Channel)}
    return Channel(**{name: value for name, value in table.arguments().items() if name in known})


def plant_note(table: PlantTable, ideal: str) -> str:
    """What a reader has to know of the robot: `ideal` says it of one that does as commanded."""
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
