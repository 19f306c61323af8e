"""What a problem file of `system = "pose_tracking"` may say, and what each key means."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from rehab_opt.session.clearance import ClearanceSection
from rehab_opt.session.plant import JointPlant
from rehab_opt.session.robot_file import RobotSection
from rehab_opt.session.schema import Problem, RecordedSection, Section, SolverName, Triple, refusal

__all__ = ["MAX_TICKS", "CircleSection", "PathSection", "PoseTracking"]

MAX_TICKS = 2_000_000


class CircleSection(Section):
    """A circle of the tool through its starting point, from rest to rest."""

    radius_m: float = Field(gt=0, le=1)
    """Of the tool's path."""
    normal: Triple = Field(default=[0.0, 0.0, 1.0])
    """Axis of the circle; the tool sets out along normal x towards."""
    towards: Triple = Field(default=[1.0, 0.0, 0.0])
    """From the start to the centre (its part across `normal`)."""
    turns: float = Field(default=1.0, gt=0, le=100)
    """How often round, from rest to rest."""
    duration_s: float = Field(gt=0, le=600)
    """Of all turns together."""
    swing_deg: float = Field(default=0.0, ge=0, le=90)
    """Largest turn of the tool about its own z axis."""

    @model_validator(mode="after")
    def directions_differ(self) -> Self:
        """Refuse a circle without a plane."""
        (a, b, c), (x, y, z) = self.normal, self.towards
        if (b * z - c * y) ** 2 + (c * x - a * z) ** 2 + (a * y - b * x) ** 2 < 1e-12:
            raise PydanticCustomError("no_plane", "normal and towards neither zero nor parallel")
        return self


class PathSection(RecordedSection):
    """A path of the tool, which keeps its starting orientation, from rest to rest; what is not seen is bridged."""

    from_start: bool = True
    """The first point lies where the tool starts; where false, points are in the robot's base frame, and the tool
    comes to the first one, straight and at 0.1 m/s, before the path begins."""
    cutoff_hz: float = Field(default=8.0, gt=0, le=1000)
    """Of the two equal poles of the filter that smooths it; the tool is as much later."""


class TrackerSection(Section):
    """The tracking law, `PoseTracker`."""

    rate_hz: float = Field(default=1000.0, ge=10, le=10000)
    """Ticks a second."""
    gain_per_s: float | None = Field(default=None, gt=0, le=10000)
    """Rate at which a pose error decays, by default `PoseTracker`'s."""
    linear_speed_m_s: float = Field(default=1.0, gt=0, le=10)
    """Largest speed of the tool."""
    solver: SolverName | None = None
    """By default `PoseTracker`'s; `--solver` replaces it."""


class PoseTracking(Problem):
    """A robot whose tool follows a moving pose."""

    system: Literal["pose_tracking"]
    robot: RobotSection
    """The robot."""
    circle: CircleSection | None = None
    """The path, or `[path]`."""
    path: PathSection | None = None
    """The path, of a file, or `[circle]`."""
    tracker: TrackerSection = TrackerSection()
    """The controller."""
    clearance: ClearanceSection | None = None
    """What the arm keeps clear of; left out where there is no such table."""
    plant: JointPlant = JointPlant()
    """On which robot it runs: see the plant's keys."""

    @model_validator(mode="after")
    def one_path_fits_into_memory(self) -> Self:
        """Refuse a run that is as long as it is dense, and two paths or none."""
        if (self.circle is None) == (self.path is None):
            raise refusal("circle", self.circle, "a table [circle] or a table [path], one of them")
        rate, duration = self.tracker.rate_hz, 0.0 if self.circle is None else self.circle.duration_s
        if rate * duration > MAX_TICKS:
            raise refusal("tracker.rate_hz", rate, f"at most {MAX_TICKS} ticks in circle.duration_s = {duration:g}")
        return self
