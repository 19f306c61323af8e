"""What a problem file of `system = "pose_tracking"` may say; `problems/README.md` says what each key means."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from rehab_opt.session.plant.tables import JointPlant
from rehab_opt.session.schema import Problem, Section, SolverName, Triple, refusal

__all__ = ["CircleSection", "PoseTracking", "RobotSection", "TrackerSection"]

MOST_TICKS = 2_000_000
UR5_JOINTS = 6


class RobotSection(Section):
    """Which robot, and from where it starts."""

    model: Literal["ur5"] | None = None
    file: str | None = Field(default=None, min_length=1)
    start_deg: Annotated[list[Annotated[float, Field(ge=-360, le=360)]], Field(min_length=1, max_length=100)]
    joint_speed_deg_s: Annotated[float, Field(gt=0, le=180)] = 180.0
    joint_acceleration_deg_s2: Annotated[float, Field(gt=0, le=1e5)] | None = None

    @model_validator(mode="after")
    def one_robot(self) -> Self:
        """Refuse two robots or none, and a UR5 of other than six joints."""
        if (self.model is None) == (self.file is None):
            key, value = ("model", None) if self.file is None else ("file", self.file)
            raise refusal(key, value, "either model = 'ur5', or file = a robot file")
        if self.model is not None and len(self.start_deg) != UR5_JOINTS:
            raise refusal("start_deg", self.start_deg, f"{UR5_JOINTS} entries")
        return self


class CircleSection(Section):
    """A circle of the tool through its starting point, from rest to rest."""

    radius_m: float = Field(gt=0, le=1)
    normal: Triple = Field(default=[0.0, 0.0, 1.0])
    towards: Triple = Field(default=[1.0, 0.0, 0.0])
    turns: float = Field(default=1.0, gt=0, le=100)
    duration_s: float = Field(gt=0, le=600)
    swing_deg: float = Field(default=0.0, ge=0, le=90)

    @model_validator(mode="after")
    def directions_differ(self) -> Self:
        """Refuse a circle without a plane."""
        (a, b, c), (x, y, z) = self.normal, self.towards
        if (b * z - c * y) ** 2 + (c * x - a * z) ** 2 + (a * y - b * x) ** 2 < 1e-12:
            raise PydanticCustomError("no_plane", "normal and towards neither zero nor parallel")
        return self


class TrackerSection(Section):
    """The tracking law, `PoseTracker`."""

    rate_hz: float = Field(default=1000.0, ge=10, le=10000)
    gain_per_s: float | None = Field(default=None, gt=0, le=10000)
    solver: SolverName | None = None


class PoseTracking(Problem):
    """A robot whose tool follows a moving pose."""

    system: Literal["pose_tracking"]
    robot: RobotSection
    circle: CircleSection
    tracker: TrackerSection = TrackerSection()
    plant: JointPlant = JointPlant()

    @model_validator(mode="after")
    def ticks_fit_into_memory(self) -> Self:
        """Refuse a run that is as long as it is dense."""
        rate, duration = self.tracker.rate_hz, self.circle.duration_s
        if rate * duration > MOST_TICKS:
            raise refusal("tracker.rate_hz", rate, f"at most {MOST_TICKS} ticks in circle.duration_s = {duration:g}")
        return self
