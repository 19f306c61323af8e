"""The robot of a problem's run: the table `[plant]`, the option `--plant` that overrides it, and the plants."""

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
"""Values of `--plant`; a real robot needs an address, so it can only be set in the file."""
DEVICES: tuple[Kind, ...] = ("ur", "franka", "ros2")
DEVICE_KEYS = frozenset({"kind", "address"})
Milliseconds = Annotated[float, Field(ge=0, le=1000)]


class PlantTable(Section):
    """Kind of robot, and delays and noise of its connection; by default those of a usual network servo."""

    kind: Kind = "ideal"
    """Kind of robot."""
    command_delay_ms: Milliseconds = 3.0
    """Time from a command until it acts."""
    command_jitter_ms: Milliseconds = 0.0
    """Largest extra delay, uniformly distributed; commands keep their order."""
    measurement_delay_ms: Milliseconds = 2.0
    """Age of a measurement when the controller gets it."""
    measurement_jitter_ms: Milliseconds = 0.0
    """Largest extra age, uniformly distributed; measurements keep their order."""
    physics_step_ms: float = Field(default=0.5, ge=0.01, le=5)
    """Largest step of the physics; delays are multiples of it, rounded up."""
    seed: int = Field(default=0, ge=0, le=2**31)
    """Seed of jitter and noise."""

    @property
    def keys(self) -> frozenset[str]:
        """Keys of this kind of robot."""
        if self.kind == "ideal":
            return frozenset({"kind"})
        return frozenset(type(self).model_fields) - DEVICE_KEYS | {"kind"} if self.kind == "mujoco" else DEVICE_KEYS

    @model_validator(mode="after")
    def each_kind_has_its_keys(self) -> Self:
        """Refuse delays and noise for a kind of robot without them, instead of ignoring them."""
        if said := sorted(self.model_fields_set - self.keys):
            others = '"ur", "franka" or "ros2"' if said[0] in DEVICE_KEYS else '"mujoco"'
            raise refusal(said[0], getattr(self, said[0]), f"no such key except for kind = {others}")
        return self

    told_truly: ClassVar[str] = "positions and speeds are"
    """Quantities of the true robot that a run's numbers and figures use."""

    @property
    def imperfections(self) -> str:
        """Noise and lags besides the delays, as text."""
        raise NotImplementedError

    @model_serializer(mode="wrap")
    def without_keys_of_others(self, whole: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Write only the keys of its own kind."""
        written: dict[str, Any] = whole(self)
        return {key: value for key, value in written.items() if key in self.keys}


class JointPlant(PlantTable):
    """An arm whose joints have servos."""

    kind: Kind = "ideal"
    """Joints that move exactly as commanded (`ideal`), a robot with mass in MuJoCo, or, for `loop` and `live`, a real
    robot: of Universal Robots, of Franka, or with ROS 2 and the joint names of this file. `--plant` overrides it. An
    ideal robot has no other keys, a real robot only the next one."""
    address: str | None = Field(default=None, min_length=1)
    """Network address of the real robot's controller."""
    servo: Literal["velocity", "position"] = "velocity"
    """A proportional-integral servo of each joint's speed, or a critically damped spring to the integrated commands."""
    servo_hz: float = Field(default=24.0, gt=0, le=500)
    """Bandwidth (-3 dB) of the servo."""
    position_noise_rad: float = Field(default=1e-4, ge=0, le=0.1)
    """Standard deviation of the encoder noise."""
    position_resolution_rad: float = Field(default=0.0, ge=0, le=0.1)
    """One count of the encoders."""
    payload_kg: float = Field(default=0.0, ge=0, le=10)
    """Mass at the tool; the servos compensate only its weight."""

    @model_validator(mode="after")
    def a_robot_that_is_there_has_an_address(self) -> Self:
        """Refuse a real robot without an address."""
        if self.kind in DEVICES and self.address is None:
            raise refusal("address", None, f"the address of the robot of kind {self.kind!r}")
        return self

    @property
    def imperfections(self) -> str:
        """Noise and lags of encoders and servos, as text."""
        noise = 1e3 * self.position_noise_rad
        return f"{noise:g} mrad of noise, a {self.servo} servo of {self.servo_hz:g} Hz"


class HandPlant(PlantTable):
    """A robot in the plane whose force on the hand is commanded."""

    kind: Simulated = "ideal"
    """Joints that move exactly as commanded (`ideal`), or a robot with mass in MuJoCo; `--plant` overrides it. An ideal
    robot has no other keys."""

    force_lag_ms: Milliseconds = 3.0
    """Time constant of the motor force, in addition to the robot's own force loop."""
    position_noise_m: float = Field(default=2e-5, ge=0, le=0.01)
    """Standard deviation of the sensor noise."""
    position_resolution_m: float = Field(default=0.0, ge=0, le=0.01)
    """One count of the sensor."""

    @property
    def imperfections(self) -> str:
        """Noise and lags of sensor and motors, as text."""
        return f"{1e3 * self.position_noise_m:g} mm of noise, {self.force_lag_ms:g} ms of lag of the force"


class ChairPlant(PlantTable):
    """A wheelchair with an arm."""

    kind: Simulated = "ideal"
    """Joints that move exactly as commanded (`ideal`), or a robot with mass in MuJoCo; `--plant` overrides it. An ideal
    robot has no other keys."""

    physics_step_ms: float = Field(default=1.0, ge=0.01, le=5)
    """Largest step of the physics; delays are multiples of it, rounded up."""
    wheel_lag_ms: Milliseconds = 80.0
    """Time constant of each wheel's speed."""
    servo_hz: float = Field(default=24.0, gt=0, le=500)
    """Bandwidth (-3 dB) of the velocity servo of the arm's joints."""
    position_noise_rad: float = Field(default=1e-4, ge=0, le=0.1)
    """Standard deviation of the encoder noise."""

    told_truly: ClassVar[str] = "places are"

    @property
    def imperfections(self) -> str:
        """Noise and lags of sensors and wheels, as text."""
        noise, lag = 1e3 * self.position_noise_rad, self.wheel_lag_ms
        return f"{noise:g} mrad of noise, {lag:g} ms of lag of the wheels"


def on_plant(config: ProblemFile[P], kind: str | None) -> ProblemFile[P]:
    """The problem with the kind of plant of `--plant`, or else of the file.

    Raises
    ------
    ConfigurationError : unknown kind, or a package that it needs is not installed.
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
    """A simulated arm for joint velocities [rad/s]: a UR5, or an arm whose robot file has masses and efforts.

    Raises
    ------
    ConfigurationError : physics for a robot file without masses or efforts; a real robot.
    """
    if table.kind in DEVICES:
        expected = f"one of {', '.join(KINDS)}, by --plant: a real robot runs with `rehab-opt loop` or `live`"
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
    """Address of the robot of a table; None for a simulated robot."""
    return None if table.address is None else DeviceAddress(table.kind, table.address)


def chair_plant(table: ChairPlant, robot: MobileArm, wheels: Drive, dt: float, *, own_arm: bool = False) -> Wheelchair:
    """A simulated chair for wheel speeds and joint velocities [rad/s]: ARDIS, or with an arm from a robot file.

    Raises
    ------
    ConfigurationError : the file of the arm has no masses, or a joint without an effort.
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
    """Delays, jitter and noise from the table."""
    known = {each.name for each in fields(Channel)}
    return Channel(**{name: value for name, value in table.arguments().items() if name in known})


def plant_note(table: PlantTable, ideal: str) -> str:
    """Note about the robot for a reader of the results; `ideal` is the text for an ideal robot."""
    if table.kind == "ideal":
        return ideal
    both = table.command_delay_ms + table.measurement_delay_ms
    return (
        f"the robot is simulated in MuJoCo: {both:g} ms of delay (commands {table.command_delay_ms:g}, measurements "
        f"{table.measurement_delay_ms:g}), {table.imperfections}; {table.told_truly} the true ones"
    )


def ms(milliseconds: float) -> float:
    """Milliseconds in [s]."""
    return 1e-3 * milliseconds
