"""What the table `[plant]` of a problem file may say, and what each key means."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal, Self, get_args

from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from rehab_opt.session.schema import Section, refusal

__all__ = ["KINDS", "ChairPlant", "HandPlant", "JointPlant", "Kind", "PlantTable", "Simulated"]

Simulated = Literal["ideal", "mujoco"]
Kind = Literal["ideal", "mujoco", "ur", "franka", "ros2"]
KINDS: tuple[Simulated, ...] = get_args(Simulated)
"""What `--plant` takes: a robot that is there has an address, which stands in the file."""
DEVICES: tuple[Kind, ...] = ("ur", "franka", "ros2")
DEVICE_KEYS = frozenset({"kind", "address", "delay_ms"})
Milliseconds = Annotated[float, Field(ge=0, le=1000)]


class PlantTable(Section):
    """Which robot, and how late and noisy the way to it is. The defaults are a choice: a usual network servo."""

    kind: Kind = "ideal"
    """Which robot."""
    command_delay_ms: Milliseconds = 3.0
    """A command acts so long after it was sent."""
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
    """An arm whose joints have servos; trackers are told of its delays and servos (`JointFeedback`)."""

    kind: Kind = "ideal"
    """Joints that move exactly as commanded, a robot with mass in MuJoCo, or one that is there, for `loop` and `live`:
    of Universal Robots, Franka's, or of ROS 2, its joints named as here. `--plant` goes before it. An ideal robot has
    no other keys, one that is there the next two."""
    address: str | None = Field(default=None, min_length=1)
    """Of that robot's controller."""
    delay_ms: float | None = Field(default=None, ge=0, le=200)
    """From a command until the motion is seen there, as `rehab-opt delay FILE` measures it."""
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
    contact_m: float = Field(default=0.001, gt=0, le=0.05)
    """`JointFeedback`'s `contact`: an arm of much friction that stops by itself needs more, and presses harder."""

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
        return f"{noise:g} mrad of noise, a {self.servo} servo of {self.servo_hz:g} Hz; trackers know delays and servo"


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
        noise, lag = (
            f"{1e3 * self.position_noise_rad:g} mrad of noise",
            f"{self.wheel_lag_ms:g} ms of lag of the wheels",
        )
        return f"{noise}, {lag}; the optimised law knows delays and servo"
