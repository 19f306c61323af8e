"""Plant of a problem: the table `[plant]`, the option `--plant` that overrides it, and how the plant is made."""

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

P = TypeVar("P", bound=Problem)

Simulated = Literal["ideal", "mujoco"]
Kind = Literal["ideal", "mujoco", "ur", "franka", "ros2"]
KINDS: tuple[Simulated, ...] = get_args(Simulated)
"""Values of `--plant`; a real robot needs an address, so only the problem file can choose one."""
DEVICES: tuple[Kind, ...] = ("ur", "franka", "ros2")
DEVICE_KEYS = frozenset({"kind", "address"})
Milliseconds = Annotated[float, Field(ge=0, le=1000)]


class PlantTable(Section):
    """Kind of robot, and delays and noise of its connection, by default those of a usual network servo."""

    kind: Kind = "ideal"
    """Kind of robot."""
    command_delay_ms: Milliseconds = 3.0
    """Time from sending a command until the command acts."""
    command_jitter_ms: Milliseconds = 0.0
    """Largest random addition to the delay of a command, uniformly distributed; commands keep their order."""
    measurement_delay_ms: Milliseconds = 2.0
    """Age of a measurement when the controller gets it."""
    measurement_jitter_ms: Milliseconds = 0.0
    """Largest random addition to the age of a measurement, uniformly distributed; measurements keep their order."""
    physics_step_ms: float = Field(default=0.5, ge=0.01, le=5)
    """Largest step of the physics simulation; delays are rounded up to a multiple of the step."""
    seed: int = Field(default=0, ge=0, le=2**31)
    """Seed of jitter and noise."""

    @property
    def keys(self) -> frozenset[str]:
        """Keys that the kind of robot allows."""
        if self.kind == "ideal":
            return frozenset({"kind"})
        return frozenset(type(self).model_fields) - DEVICE_KEYS | {"kind"} if self.kind == "mujoco" else DEVICE_KEYS

    @model_validator(mode="after")
    def each_kind_has_its_keys(self) -> Self:
        """Refuse keys that the kind of robot does not have, such as delays of an ideal robot."""
        if said := sorted(self.model_fields_set - self.keys):
            others = '"ur", "franka" or "ros2"' if said[0] in DEVICE_KEYS else '"mujoco"'
            raise refusal(said[0], getattr(self, said[0]), f"no such key except for kind = {others}")
        return self

    told_truly: ClassVar[str] = "positions and speeds are"
    """Text for a note: the quantities that metrics and figures take from the true state."""

    @property
    def imperfections(self) -> str:
        """Text with noise and lags of the plant, besides the delays."""
        raise NotImplementedError

    @model_serializer(mode="wrap")
    def without_keys_of_others(self, whole: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Write only the keys that the kind of robot allows."""
        written: dict[str, Any] = whole(self)
        return {key: value for key, value in written.items() if key in self.keys}


class JointPlant(PlantTable):
    """An arm whose joints have servos."""

    kind: Kind = "ideal"
    """Kind of robot: joints that move exactly as commanded (`ideal`), a robot with mass simulated in MuJoCo, or, for
    `loop` and `live`, a real robot: Universal Robots (`ur`), Franka, or a robot with ROS 2 and this file's joint names.
    The
    option `--plant` overrides this key. An ideal robot has no other keys, a real robot only `address`."""
    address: str | None = Field(default=None, min_length=1)
    """Network address of the real robot's controller."""
    servo: Literal["velocity", "position"] = "velocity"
    """Servo of the joints: `velocity` is a proportional-integral loop of each joint's speed; `position` is a critically
    damped spring to the integrated velocity commands."""
    servo_hz: float = Field(default=24.0, gt=0, le=500)
    """Bandwidth (-3 dB) of the servo."""
    position_noise_rad: float = Field(default=1e-4, ge=0, le=0.1)
    """Standard deviation of the encoder noise."""
    position_resolution_rad: float = Field(default=0.0, ge=0, le=0.1)
    """Resolution of the encoders; 0 for exact positions."""
    payload_kg: float = Field(default=0.0, ge=0, le=10)
    """Mass at the tool; the servos compensate only the weight of this mass."""

    @model_validator(mode="after")
    def a_robot_that_is_there_has_an_address(self) -> Self:
        """Refuse a real robot without an address."""
        if self.kind in DEVICES and self.address is None:
            raise refusal("address", None, f"the address of the robot of kind {self.kind!r}")
        return self

    @property
    def imperfections(self) -> str:
        """Text with the encoder noise and the servos' bandwidth."""
        noise = 1e3 * self.position_noise_rad
        return f"{noise:g} mrad of noise, a {self.servo} servo of {self.servo_hz:g} Hz"


class HandPlant(PlantTable):
    """A planar robot whose force on the hand is commanded."""

    kind: Simulated = "ideal"
    """Kind of robot: `ideal` (no delays), or a robot simulated in MuJoCo with delays and noise. The option `--plant`
    overrides this key. An ideal robot has no other keys."""

    force_lag_ms: Milliseconds = 3.0
    """Time constant of the motor force, in addition to the dynamics of the robot's force loop."""
    position_noise_m: float = Field(default=2e-5, ge=0, le=0.01)
    """Standard deviation of the noise of the position sensor."""
    position_resolution_m: float = Field(default=0.0, ge=0, le=0.01)
    """Resolution of the position sensor; 0 for exact positions."""

    @property
    def imperfections(self) -> str:
        """Text with the sensor noise and the lag of the motor force."""
        return f"{1e3 * self.position_noise_m:g} mm of noise, {self.force_lag_ms:g} ms of lag of the force"


class ChairPlant(PlantTable):
    """A wheelchair with an arm."""

    kind: Simulated = "ideal"
    """Kind of robot: wheels and joints that move exactly as commanded (`ideal`), or a robot with mass simulated in
    MuJoCo. The option `--plant` overrides this key. An ideal robot has no other keys."""

    physics_step_ms: float = Field(default=1.0, ge=0.01, le=5)
    """Largest step of the physics simulation; delays are rounded up to a multiple of the step."""
    wheel_lag_ms: Milliseconds = 80.0
    """Time constant of each wheel's speed."""
    servo_hz: float = Field(default=24.0, gt=0, le=500)
    """Bandwidth (-3 dB) of the velocity servo of the arm's joints."""
    position_noise_rad: float = Field(default=1e-4, ge=0, le=0.1)
    """Standard deviation of the encoder noise."""

    told_truly: ClassVar[str] = "places are"

    @property
    def imperfections(self) -> str:
        """Text with the encoder noise and the wheels' lag."""
        noise, lag = 1e3 * self.position_noise_rad, self.wheel_lag_ms
        return f"{noise:g} mrad of noise, {lag:g} ms of lag of the wheels"


def on_plant(config: ProblemFile[P], kind: str | None) -> ProblemFile[P]:
    """The problem with the kind of plant of the option `--plant`, or unchanged if `kind` is None.

    Raises
    ------
    ConfigurationError : the kind is unknown, or MuJoCo is not installed.
    """
    if kind is not None and kind not in KINDS:
        raise ConfigurationError("--plant", kind, f"one of {', '.join(KINDS)}")
    table: PlantTable = config.problem.plant  # type: ignore[attr-defined]  # of every system that takes the option
    if kind is not None and kind != table.kind:
        # Another kind of plant has other keys, so the table's other values are dropped.
        table = type(table).model_validate({"kind": kind})
        config = replace(config, problem=config.problem.model_copy(update={"plant": table}))
    if table.kind == "mujoco":
        from rehab_opt.plants.mujoco_arm import mujoco_module  # noqa: PLC0415  (loads slowly)

        mujoco_module()
    return config


def joint_plant(table: JointPlant, chain: SerialChain, dt: float) -> Plant:
    """A simulated arm that takes joint velocities [rad/s, m/s].

    In MuJoCo, the arm is a UR5 or an arm whose robot file has masses and efforts.

    Raises
    ------
    ConfigurationError : MuJoCo needs masses or efforts that the robot file lacks, or the table is of a real robot.
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
    """Address of the real robot in a table; None for a simulated robot."""
    return None if table.address is None else DeviceAddress(table.kind, table.address)


def chair_plant(table: ChairPlant, robot: MobileArm, wheels: Drive, dt: float, *, own_arm: bool = False) -> Wheelchair:
    """A simulated wheelchair with an arm that takes wheel speeds and joint velocities [rad/s].

    `own_arm` says whether the arm is from a robot file; otherwise the arm is that of ARDIS.

    Raises
    ------
    ConfigurationError : the robot file of the arm has no masses, or lacks the effort of a joint.
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
    """Channel with the delays, jitter and noise of a table."""
    known = {each.name for each in fields(Channel)}
    return Channel(**{name: value for name, value in table.arguments().items() if name in known})


def plant_note(table: PlantTable, ideal: str) -> str:
    """Note on the simulated robot; `ideal` is the note for an ideal robot."""
    if table.kind == "ideal":
        return ideal
    both = table.command_delay_ms + table.measurement_delay_ms
    return (
        f"the robot is simulated in MuJoCo: {both:g} ms of delay (commands {table.command_delay_ms:g}, measurements "
        f"{table.measurement_delay_ms:g}), {table.imperfections}; {table.told_truly} the true ones"
    )


def ms(milliseconds: float) -> float:
    """Convert milliseconds to seconds."""
    return 1e-3 * milliseconds
