"""What a problem file of `system = "mirror"` may say; `problems/README.md` says what each key means."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from rehab_opt.session.arm_keys import OneRange, SegmentsSection
from rehab_opt.session.plant.tables import JointPlant
from rehab_opt.session.pose_tracking.problem import RobotSection
from rehab_opt.session.schema import (
    Positive,
    Problem,
    Section,
    Side,
    Triple,
    refusal,
)

__all__ = [
    "AStarSection",
    "ConditioningSection",
    "KeepOutSection",
    "LedRobotSection",
    "MirrorProblem",
    "MirrorTrackerSection",
    "PatientArmSection",
    "PatientSection",
    "PoseRecordingSection",
    "VrPlacementSection",
]

Axis = Literal["+x", "-x", "+y", "-y", "+z", "-z"]
Columns = Annotated[int, Field(ge=1, le=1000)]
Turns = Annotated[list[Annotated[float, Field(ge=-360, le=360)]], Field(min_length=3, max_length=3)]


class PoseRecordingSection(Section):
    """Poses of the healthy hand, and what the axes of its frame mean."""

    file: str = Field(min_length=1)
    hand: Side
    frame: Literal["unity", "robot"]
    fingers: Axis
    back: Axis
    rate_hz: float | None = Field(default=None, ge=1, le=2000)
    position_columns: Annotated[list[Columns], Field(min_length=3, max_length=3)] | None = None
    quaternion_columns: Annotated[list[Columns], Field(min_length=4, max_length=4)] | None = None
    rows: Annotated[list[Annotated[int, Field(ge=1)]], Field(min_length=2, max_length=2)] | None = None

    @model_validator(mode="after")
    def axes_and_columns_differ(self) -> Self:
        """Refuse fingers that point out of the back of the hand, half of the columns, and rows in reverse."""
        if self.fingers[1] == self.back[1]:
            raise refusal("back", self.back, f"an axis across fingers = {self.fingers}")
        if (self.position_columns is None) != (self.quaternion_columns is None):
            missing = "quaternion_columns" if self.quaternion_columns is None else "position_columns"
            raise refusal(missing, None, "both position_columns and quaternion_columns, or neither")
        if self.position_columns is not None and self.quaternion_columns is not None:
            columns = [*self.position_columns, *self.quaternion_columns]
            if len(set(columns)) < len(columns):
                raise refusal("quaternion_columns", self.quaternion_columns, "each column once")
            if self.rate_hz is None:
                raise refusal("rate_hz", None, "the sampling rate: a file read by column numbers has no time stamps")
        if self.rows is not None and self.rows[1] < self.rows[0] + 2:
            raise refusal("rows", self.rows, "[first, last], counted from 1, at least three rows")
        return self


class ConditioningSection(Section):
    """What happens to the tracker's samples on the way in."""

    cutoff_hz: float = Field(default=8.0, gt=0, le=1000)
    max_gap_s: float = Field(default=0.1, gt=0, le=10)
    largest_speed_m_s: float = Field(default=5.0, gt=0, le=100)
    largest_turn_deg_s: float = Field(default=1720.0, gt=0, le=36000)


class VrPlacementSection(Section):
    """How the recording's frame, its axes turned to the robot's kind, lies in the robot's frame."""

    calibration_file: str | None = Field(default=None, min_length=1)
    origin_m: Triple | None = None
    turn_deg: float = Field(default=0.0, ge=-360, le=360)
    recorded_arm_m: float | None = Field(default=None, gt=0, le=10)
    arm_m: float | None = Field(default=None, ge=0.1, le=2)

    @model_validator(mode="after")
    def frame_is_said_once(self) -> Self:
        """Refuse two frames or none, and half of a scale."""
        if self.calibration_file is None and self.origin_m is None:
            raise refusal("origin_m", None, "either calibration_file or origin_m")
        if self.calibration_file is not None:
            if self.origin_m is not None or self.turn_deg:
                key, value = ("origin_m", self.origin_m) if self.origin_m is not None else ("turn_deg", self.turn_deg)
                raise refusal(key, value, "no such key beside calibration_file, which says where the frame lies")
            if self.recorded_arm_m is not None or self.arm_m is not None:
                raise refusal("arm_m", self.arm_m, "no such key beside calibration_file: its lengths are true")
        if (self.recorded_arm_m is None) != (self.arm_m is None):
            missing = "arm_m" if self.arm_m is None else "recorded_arm_m"
            raise refusal(missing, None, "both recorded_arm_m and arm_m, or neither")
        return self

    @property
    def scale(self) -> float:
        """Lengths of the patient over those of the recording."""
        return self.arm_m / self.recorded_arm_m if self.arm_m and self.recorded_arm_m else 1.0


class PatientArmSection(Section):
    """The arm that is led, to whose range of motion the reference is limited."""

    shoulder_m: Triple
    range_of_motion: OneRange
    segments: SegmentsSection = SegmentsSection()


class PatientSection(Section):
    """Where the patient sits, and which way they look."""

    sagittal_point_m: Triple
    facing_deg: float = Field(ge=-360, le=360)
    arm: PatientArmSection | None = None


class LedRobotSection(RobotSection):
    """The robot, and how it holds the hand."""

    grip_m: Triple = Field(default=[0.0, 0.0, 0.0])
    grip_deg: Turns = Field(default=[0.0, 0.0, 0.0])


class KeepOutSection(Section):
    """A plane that no part of the arm crosses."""

    point_m: Triple
    normal: Triple


class MirrorTrackerSection(Section):
    """The law, `MirrorTracker`."""

    rate_hz: float = Field(default=200.0, ge=10, le=10000)
    floor: float = Field(default=0.3, gt=0, lt=1)
    max_deviation_mm: float = Field(default=50.0, gt=0, le=1000)
    max_turn_deg: float = Field(default=45.0, gt=0, lt=180)
    linear_speed_m_s: float = Field(default=0.25, gt=0, le=3)
    angular_speed_deg_s: float = Field(default=86.0, gt=0, le=720)
    catch_up: float = Field(default=0.5, ge=0, lt=10)
    patience: float = Field(default=10.0, ge=1, le=100)
    keep_out: list[KeepOutSection] = Field(default=[], max_length=10)


class AStarSection(Section):
    """The published search, run beside as the yardstick."""

    resolution_mm: float = Field(ge=0.5, le=50)
    stretch_mm: Positive = Field(default=30.0, le=1000)
    pull: float = Field(default=4.0, ge=0, le=1000)
    most: int = Field(default=200_000, ge=1, le=10_000_000)


class MirrorProblem(Problem):
    """A hand led along the other hand's mirrored path."""

    system: Literal["mirror"]
    recording: PoseRecordingSection
    conditioning: ConditioningSection = ConditioningSection()
    placement: VrPlacementSection
    patient: PatientSection
    robot: LedRobotSection
    tracker: MirrorTrackerSection = MirrorTrackerSection()
    plant: JointPlant = JointPlant()
    astar: AStarSection | None = None
