"""What a problem file of `system = "mirror"` may say, and what each key means."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from rehab_opt.session.arm_keys import OneRange, SegmentsSection
from rehab_opt.session.clearance import ClearanceSection, ClearPlaneSection
from rehab_opt.session.plant import JointPlant
from rehab_opt.session.robot_file import RobotSection
from rehab_opt.session.schema import (
    Decimal,
    Positive,
    Problem,
    Section,
    Separator,
    Side,
    Triple,
    refusal,
)
from rehab_opt.session.upper_limb.problem import SmoothingSection

__all__ = ["MirrorProblem", "MirrorTrackerSection", "PatientSection", "PoseRecordingSection"]

Axis = Literal["+x", "-x", "+y", "-y", "+z", "-z"]
Columns = Annotated[int, Field(ge=1, le=1000)]
Turns = Annotated[list[Annotated[float, Field(ge=-360, le=360)]], Field(min_length=3, max_length=3)]


class PoseRecordingSection(Section):
    """Poses of the healthy hand, and what the axes of its frame mean."""

    file: str = Field(min_length=1)
    """A `.csv` with the header `t_s,x_m,y_m,z_m,qx,qy,qz,qw`, or rows of numbers without a header, with the columns
    below. Empty cells: the tracker had lost the hand."""
    hand: Side
    """Whose hand was recorded; the other one is led."""
    frame: Literal["unity", "robot"]
    """`unity`: x right, y up, z forward, left-handed; `robot`: x forward, y left, z up."""
    fingers: Axis
    """Axis of the recorded hand frame that points to the fingertips, in the recording's own frame. It differs from
    tracker to tracker, and mirrored fingers point backwards where it is wrong: there is no default."""
    back: Axis
    """Axis that points out of the back of the hand."""
    rate_hz: float | None = Field(default=None, ge=1, le=2000)
    """Instead of time stamps: an assumption, which the notes repeat."""
    position_columns: Annotated[list[Columns], Field(min_length=3, max_length=3)] | None = None
    """Three column numbers from 1; need `rate_hz`."""
    quaternion_columns: Annotated[list[Columns], Field(min_length=4, max_length=4)] | None = None
    """Four column numbers of x, y, z, w, likewise."""
    rows: Annotated[list[Annotated[int, Field(ge=1)]], Field(min_length=2, max_length=2)] | None = None
    """`[first, last]` of the rows of numbers, from 1; by default all."""
    separator: Separator = "comma"
    """Between the cells."""
    decimal: Decimal = "point"
    """Of the numbers."""

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
    """Of the filter's two equal poles; its lag is reported."""
    max_gap_s: float = Field(default=0.1, gt=0, le=10)
    """Longer gaps count as lost sight."""
    max_speed_m_s: float = Field(default=5.0, gt=0, le=100)
    """Faster samples count as lost sight."""
    max_turn_rate_deg_s: float = Field(default=1720.0, gt=0, le=36000)
    """Likewise."""


class VrPlacementSection(Section):
    """How the recording's frame, its axes turned to the robot's kind, lies in the robot's frame."""

    calibration_file: str | None = Field(default=None, min_length=1)
    """A `.csv` with the header `vr_x_m,vr_y_m,vr_z_m,robot_x_m,robot_y_m,robot_z_m`: at least three points touched with
    both; least squares, the residual is reported. Or `origin_m`."""
    origin_m: Triple | None = None
    """Where the recording's origin lies in the robot's frame."""
    turn_deg: float = Field(default=0.0, ge=-360, le=360)
    """How its axes are turned about the vertical."""
    recorded_arm_m: float | None = Field(default=None, gt=0, le=10)
    """Length of a stretch of arm in the recording's unit; with `arm_m` lengths are scaled by their ratio."""
    arm_m: float | None = Field(default=None, ge=0.1, le=2)
    """Length of the same stretch of the patient's arm."""

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
    """Shoulder of the led arm in the robot's frame."""
    start_deg: Annotated[list[Annotated[float, Field(ge=-360, le=360)]], Field(min_length=8, max_length=8)] | None = (
        None
    )
    """Live, where the future is not known: posture, as Table I counts, from which the model of this arm finds to the
    first pose; default the middle of its range. That model is local: from another posture it may come to more."""
    range_of_motion: OneRange
    """A range of Rossa et al. by name, a table of all eight joints' limits, or what a goniometer measured."""
    segments: SegmentsSection = SegmentsSection()
    """Lengths of the arm's segments."""


class PatientSection(Section):
    """Where the patient sits, and which way they look."""

    sagittal_point_m: Triple
    """A point of the sagittal plane, which is upright."""
    facing_deg: float = Field(ge=-360, le=360)
    """Where the patient looks: 0 is the robot's x, counterclockwise."""
    track_file: str | None = Field(default=None, min_length=1)
    """Poses of the patient's torso or helmet, one for each sample of `recording.file`, with the same stamps, columns,
    unit and frame: the sagittal plane moves with them. Without it the plane stays where the keys above put it, which
    with it hold at the first sample."""
    arm: PatientArmSection | None = None
    """The arm that is led: with it the reference is limited to its range of motion."""

    @model_validator(mode="after")
    def shoulder_stays(self) -> Self:
        """Refuse an arm, whose shoulder is fixed, of a patient who moves."""
        if self.track_file is not None and self.arm is not None:
            raise refusal("track_file", self.track_file, "no such key beside patient.arm, whose shoulder does not move")
        return self


class LedRobotSection(RobotSection):
    """The robot, and how it holds the hand."""

    grip_m: Triple = Field(default=[0.0, 0.0, 0.0])
    """The tool in the frame of the led hand (x fingers, y back, z across, fingers x back), after the turn of
    `grip_deg`."""
    grip_deg: Turns = Field(default=[0.0, 0.0, 0.0])
    """Turns about the hand's x, then y, then z as they stood."""


class KeepOutSection(ClearPlaneSection):
    """A plane that no part of the arm crosses."""


class MirrorTrackerSection(Section):
    """The law, `MirrorTracker`."""

    rate_hz: float = Field(default=200.0, ge=10, le=10000)
    """Ticks a second."""
    floor: float = Field(default=0.3, gt=0, lt=1)
    """Least w / w_max, of the robot's own largest w."""
    max_deviation_mm: float = Field(default=50.0, gt=0, le=1000)
    """Distance to what is followed of the reference, which slows and waits as it comes near; while braking, and on the
    way to the first pose, it may be more."""
    max_turn_deg: float = Field(default=45.0, gt=0, lt=180)
    """Turn from the reference, likewise."""
    linear_speed_m_s: float = Field(default=0.25, gt=0, le=3)
    """Largest speed of the hand."""
    angular_speed_deg_s: float = Field(default=86.0, gt=0, le=720)
    """Largest turning of the hand."""
    catch_up: float = Field(default=0.5, ge=0, lt=10)
    """Share by which the clock may run fast to make up for a lag."""
    patience: float = Field(default=10.0, ge=1, le=100)
    """Durations of the recording after which a run ends, incomplete."""
    keep_out: list[KeepOutSection] = Field(default=[], max_length=10)
    """Planes that no link of the robot crosses against their normal; without capsules, no joint."""


class AStarSection(Section):
    """The published search, run beside as the yardstick."""

    resolution_mm: float = Field(ge=0.5, le=50)
    """Of the search's lattice."""
    stretch_mm: Positive = Field(default=30.0, le=1000)
    """Path searched at a time. This and the next are choices: the paper's numbers are lost."""
    pull: float = Field(default=4.0, ge=0, le=1000)
    """Weight of the reference path in f."""
    max_expansions: int = Field(default=200_000, ge=1, le=10_000_000)
    """Positions expanded a stretch at most."""


class MirrorProblem(Problem):
    """A hand led along the other hand's mirrored path."""

    system: Literal["mirror"]
    recording: PoseRecordingSection
    """The healthy hand."""
    conditioning: ConditioningSection = ConditioningSection()
    """The filter."""
    placement: VrPlacementSection
    """Where the recording lies; one of the two forms."""
    patient: PatientSection
    """Who is led."""
    robot: LedRobotSection
    """Which robot leads."""
    tracker: MirrorTrackerSection = MirrorTrackerSection()
    """The controller."""
    smoothing: SmoothingSection = SmoothingSection()
    """The drive."""
    clearance: ClearanceSection | None = None
    """What the arm keeps clear of; left out where there is no such table."""
    plant: JointPlant = JointPlant()
    """On which robot it runs: see the plant's keys."""
    astar: AStarSection | None = None
    """The published search; left out where there is no such table."""
