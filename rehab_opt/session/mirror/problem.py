"""Keys of a problem file of `system = "mirror"`, with their meaning."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from rehab_opt.session.arm_keys import OneRange, SegmentsSection
from rehab_opt.session.clearance import ClearanceSection, ClearPlaneSection
from rehab_opt.session.outcome import Array
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

Axis = Literal["+x", "-x", "+y", "-y", "+z", "-z"]
Columns = Annotated[int, Field(ge=1, le=1000)]
Turns = Annotated[list[Annotated[float, Field(ge=-360, le=360)]], Field(min_length=3, max_length=3)]


class PoseRecordingSection(Section):
    """Poses of the healthy hand, and the meaning of its frame's axes."""

    FILES: ClassVar = ("file",)
    file: str = Field(min_length=1)
    """A `.csv` with the header `t_s,x_m,y_m,z_m,qx,qy,qz,qw`, or rows of numbers without a header, with the columns
    below. An empty cell means that the tracker had lost the hand."""
    hand: Side
    """The recorded hand; the other hand is led."""
    frame: Literal["unity", "robot"]
    """`unity`: x right, y up, z forward, left-handed; `robot`: x forward, y left, z up."""
    fingers: Axis
    """Axis of the recorded hand frame that points to the fingertips, in the recording's own convention. It differs from
    tracker to tracker, and a wrong axis makes mirrored fingers point backwards: there is no default."""
    back: Axis
    """Axis that points out of the back of the hand."""
    rate_hz: float | None = Field(default=None, ge=1, le=2000)
    """Sampling rate for a file without time stamps; the notes name it as an assumption."""
    position_columns: Annotated[list[Columns], Field(min_length=3, max_length=3)] | None = None
    """Three column numbers from 1; needs `rate_hz`."""
    quaternion_columns: Annotated[list[Columns], Field(min_length=4, max_length=4)] | None = None
    """Column numbers of x, y, z, w, from 1; needs `rate_hz`."""
    rows: Annotated[list[Annotated[int, Field(ge=1)]], Field(min_length=2, max_length=2)] | None = None
    """`[first, last]` row to read, counted from 1; default: all."""
    separator: Separator = "comma"
    """Separator of the cells."""
    decimal: Decimal = "point"
    """Decimal sign of the numbers."""

    @model_validator(mode="after")
    def axes_and_columns_differ(self) -> Self:
        """Refuse `fingers` and `back` along one axis, only one of the keys for columns, and fewer than three rows."""
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
    """Filter and outlier limits for the tracker's samples."""

    cutoff_hz: float = Field(default=8.0, gt=0, le=1000)
    """Cut-off frequency of the low-pass filter (two equal poles), whose lag is reported."""
    max_gap_s: float = Field(default=0.1, gt=0, le=10)
    """Longer gaps count as a lost hand."""
    max_speed_m_s: float = Field(default=5.0, gt=0, le=100)
    """Faster samples count as a lost hand."""
    max_turn_rate_deg_s: float = Field(default=1720.0, gt=0, le=36000)
    """Samples that turn faster count as a lost hand."""


class VrPlacementSection(Section):
    """Position of the recording's frame in the robot's frame."""

    FILES: ClassVar = ("calibration_file",)
    calibration_file: str | None = Field(default=None, min_length=1)
    """A `.csv` with the header `vr_x_m,vr_y_m,vr_z_m,robot_x_m,robot_y_m,robot_z_m`: at least three points that
    both tracker and robot touched. The frame is the least-squares fit to them, and its residual is reported. Either
    this or `origin_m`."""
    origin_m: Triple | None = None
    """Position of the recording's origin in the robot's frame."""
    turn_deg: float = Field(default=0.0, ge=-360, le=360)
    """Rotation of the recording's axes about the vertical."""
    recorded_arm_m: float | None = Field(default=None, gt=0, le=10)
    """Length of a segment of the recorded arm, in the recording's unit; with `arm_m`, the recording is scaled by the
    ratio of the two lengths."""
    arm_m: float | None = Field(default=None, ge=0.1, le=2)
    """Length of the same segment of the patient's arm."""

    @model_validator(mode="after")
    def frame_is_said_once(self) -> Self:
        """Refuse both or neither of `calibration_file` and `origin_m`, and only one of the two lengths."""
        if self.calibration_file is None and self.origin_m is None:
            raise refusal("origin_m", None, "either calibration_file or origin_m")
        if self.calibration_file is not None:
            if self.origin_m is not None or self.turn_deg:
                key, value = ("origin_m", self.origin_m) if self.origin_m is not None else ("turn_deg", self.turn_deg)
                raise refusal(key, value, "no such key beside calibration_file, which defines the frame")
            if self.recorded_arm_m is not None or self.arm_m is not None:
                raise refusal("arm_m", self.arm_m, "no such key beside calibration_file: its lengths are true")
        if (self.recorded_arm_m is None) != (self.arm_m is None):
            missing = "arm_m" if self.arm_m is None else "recorded_arm_m"
            raise refusal(missing, None, "both recorded_arm_m and arm_m, or neither")
        return self

    @property
    def scale(self) -> float:
        """Ratio of the patient's lengths to the recording's."""
        return self.arm_m / self.recorded_arm_m if self.arm_m and self.recorded_arm_m else 1.0


class PatientArmSection(Section):
    """The led arm; the reference is limited to its range of motion."""

    shoulder_m: Triple
    """Position of the led arm's shoulder in the robot's frame."""
    start_deg: Annotated[list[Annotated[float, Field(ge=-360, le=360)]], Field(min_length=8, max_length=8)] | None = (
        None
    )
    """Starting posture, in Table I's convention, of this arm's model in live runs, where the future is unknown;
    default:
    the middle of its range. The model searches near its last posture, so another start may reach more poses."""
    range_of_motion: OneRange
    """A named range of Rossa et al., a table of all eight joints' limits, or goniometer angles."""
    segments: SegmentsSection = SegmentsSection()
    """Lengths of the arm's segments."""


class PatientSection(Section):
    """Position and facing direction of the patient."""

    sagittal_point_m: Triple
    """A point of the sagittal plane, which is vertical."""
    facing_deg: float = Field(ge=-360, le=360)
    """Direction in which the patient looks, counterclockwise from the robot's x axis."""
    FILES: ClassVar = ("track_file",)
    track_file: str | None = Field(default=None, min_length=1)
    """File with poses of the patient's torso or helmet, one for each sample of `recording.file`, with the same stamps,
    columns, unit and frame. The sagittal plane moves with these poses, and is at the position given above for the
    first sample. Without this file, the plane stays there."""
    arm: PatientArmSection | None = None
    """The led arm: if given, the reference is limited to its range of motion."""

    @property
    def arm_start(self) -> Array | None:
        """(8,) [rad] Starting posture of the led arm's model, if given."""
        return None if self.arm is None or self.arm.start_deg is None else np.deg2rad(self.arm.start_deg)

    @model_validator(mode="after")
    def shoulder_stays(self) -> Self:
        """Refuse an arm (with a fixed shoulder) for a patient who moves."""
        if self.track_file is not None and self.arm is not None:
            raise refusal("track_file", self.track_file, "no such key beside patient.arm, whose shoulder does not move")
        return self


class LedRobotSection(RobotSection):
    """The robot and its grip."""

    grip_m: Triple = Field(default=[0.0, 0.0, 0.0])
    """Position of the tool in the frame of the led hand, after the rotation `grip_deg`. In this frame, x points to the
    fingertips, y out of the back of the hand, and z is the cross product of x and y."""
    grip_deg: Turns = Field(default=[0.0, 0.0, 0.0])
    """Rotation of the tool about the hand's fixed x, then y, then z axis."""


class KeepOutSection(ClearPlaneSection):
    """A plane that no part of the arm crosses."""


class MirrorTrackerSection(Section):
    """The controller, `MirrorTracker`."""

    rate_hz: float = Field(default=200.0, ge=10, le=10000)
    """Ticks per second."""
    floor: float = Field(default=0.3, gt=0, lt=1)
    """Manipulability floor: the least w / w_max, where w is the manipulability and w_max its largest value."""
    max_deviation_mm: float = Field(default=50.0, gt=0, le=1000)
    """Largest distance of the hand from the reference. Near this distance, the reference slows down and waits. While
    braking, and during the approach to the first pose, the distance may be larger."""
    max_turn_deg: float = Field(default=45.0, gt=0, lt=180)
    """Largest rotation of the hand from the reference, with the same exceptions."""
    linear_speed_m_s: float = Field(default=0.25, gt=0, le=3)
    """Largest speed of the hand."""
    angular_speed_deg_s: float = Field(default=86.0, gt=0, le=720)
    """Largest angular speed of the hand."""
    catch_up: float = Field(default=0.5, ge=0, lt=10)
    """Fraction by which the reference may run faster than recorded, to make up for a lag."""
    patience: float = Field(default=10.0, ge=1, le=100)
    """A run ends, incomplete, after this many durations of the recording."""
    keep_out: list[KeepOutSection] = Field(default=[], max_length=10)
    """Planes that no link of the robot crosses against their normal. Of links without capsules, only the joints are
    kept from crossing."""


class AStarSection(Section):
    """The published search, run for comparison."""

    resolution_mm: float = Field(ge=0.5, le=50)
    """Spacing of the search lattice."""
    stretch_mm: Positive = Field(default=30.0, le=1000)
    """Length of the path section that is searched at a time. This value and the next are our choices, since the paper's
    are lost."""
    pull: float = Field(default=4.0, ge=0, le=1000)
    """Weight, in the search's cost f, of the distance to the nearest reference position."""
    max_expansions: int = Field(default=200_000, ge=1, le=10_000_000)
    """Largest number of positions that the search expands for each section of the path."""


class MirrorProblem(Problem):
    """A hand that a robot leads along the other hand's mirrored path."""

    system: Literal["mirror"]
    recording: PoseRecordingSection
    """The recording of the healthy hand."""
    conditioning: ConditioningSection = ConditioningSection()
    """The filter for the recording."""
    placement: VrPlacementSection
    """Placement of the recording, in one of two forms."""
    patient: PatientSection
    """The patient."""
    robot: LedRobotSection
    """The robot."""
    tracker: MirrorTrackerSection = MirrorTrackerSection()
    """The controller."""
    smoothing: SmoothingSection = SmoothingSection()
    """The smoothing of the drive."""
    clearance: ClearanceSection | None = None
    """Bodies that the arm avoids; may be left out."""
    plant: JointPlant = JointPlant()
    """The plant, see the plant's keys."""
    astar: AStarSection | None = None
    """The published search; may be left out."""
