"""What a problem file of `system = "ardis"` may say; `problems/README.md` says what each key means."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from rehab_opt.kinematics.drive_name import DRIVES, DriveName
from rehab_opt.session.plant.tables import ChairPlant
from rehab_opt.session.schema import Length, Problem, Section, SolverName, Triple, refusal

__all__ = [
    "DRIVES",
    "ArdisProblem",
    "DriveName",
    "GoalSection",
    "ModeSection",
    "PostSection",
    "RobotSection",
    "RoomSection",
    "RunSection",
    "StickSection",
    "WallSection",
]

RowName = Literal["x", "y", "z", "rx", "ry", "rz", "roll7"]

Pair = Annotated[list[Length], Field(min_length=2, max_length=2)]
Angle = Annotated[float, Field(ge=-360, le=360)]
ARDIS_JOINTS = 4


class RobotSection(Section):
    """The robot and how it stands when the run begins."""

    file: str | None = Field(default=None, min_length=1)
    start_m: Pair = Field(default=[0.0, 0.0])
    heading_deg: Angle = 0.0
    arm_deg: Annotated[list[Angle], Field(min_length=4, max_length=100)] | None = None
    mount_height_m: float = Field(default=0.70, ge=0.2, le=1.5)
    chair_mass_kg: float = Field(default=120.0, ge=20, le=500)
    payload_kg: float = Field(default=0.0, ge=0, le=20)

    @model_validator(mode="after")
    def said_once(self) -> Self:
        """Refuse what a robot file says beside one, and a start that does not fit the arm of ARDIS."""
        if self.file is None:
            if self.arm_deg is not None and len(self.arm_deg) != ARDIS_JOINTS:
                raise refusal("arm_deg", self.arm_deg, f"{ARDIS_JOINTS} entries")
            return self
        for key, own in (("mount_height_m", "mount_m"), ("payload_kg", "payload_kg")):
            if key in self.model_fields_set:
                raise refusal(key, getattr(self, key), f"no such key beside file: the robot file says {own}")
        if self.arm_deg is None:
            raise refusal("arm_deg", None, "where the arm of the robot file begins, an entry for each of its joints")
        return self


class ModeSection(Section):
    """What the two axes of the stick, forward and left, move in one mode."""

    name: str = Field(min_length=1, max_length=20)
    rows: Annotated[list[RowName], Field(min_length=2, max_length=2)]
    speeds: Annotated[list[Annotated[float, Field(ge=-2, le=2)]], Field(min_length=2, max_length=2)]
    held: Annotated[list[RowName], Field(max_length=5)] = Field(default=[])


class StickSection(Section):
    """Recordings of the stick, one for each drive that is run, and how it is read."""

    mecanum: str | None = Field(default=None, min_length=1)
    differential: str | None = Field(default=None, min_length=1)
    omnidirectional: str | None = Field(default=None, min_length=1)
    fixed: str | None = Field(default=None, min_length=1)
    dead_zone: float | None = Field(default=None, ge=0, lt=1)
    rate_per_s: float | None = Field(default=None, gt=0, le=1000)
    modes: Annotated[list[ModeSection], Field(min_length=1, max_length=8)] | None = None

    @model_validator(mode="after")
    def a_drive_is_run(self) -> Self:
        """Refuse a problem that has no stick for any drive."""
        if not self.recordings:
            raise refusal("mecanum", None, f"a recording for one of the drives {', '.join(DRIVES)}")
        return self

    @property
    def recordings(self) -> dict[DriveName, str]:
        """The recording of each drive that is run."""
        return {drive: file for drive in DRIVES if (file := getattr(self, drive)) is not None}


class GoalSection(Section):
    """What the user is to bring about, one after the other."""

    name: str = Field(min_length=1, max_length=40)
    hand_m: Triple
    within_m: float = Field(default=0.03, gt=0, le=1)
    gripper: Literal["open", "closed"] | None = None


class WallSection(Section):
    """A wall: points p of the floor with normal . p > offset are not free, normal being of length one."""

    normal: Pair
    offset_m: Annotated[float, Field(ge=-100, le=100)]

    @model_validator(mode="after")
    def normal_is_a_direction(self) -> Self:
        """Refuse a wall that faces nowhere, and one whose offset would be in another unit."""
        if abs(self.normal[0] ** 2 + self.normal[1] ** 2 - 1) > 1e-3:
            raise refusal("normal", self.normal, "two numbers, a direction of length 1")
        return self


class PostSection(Section):
    """Something round that stands on the floor."""

    centre_m: Pair
    radius_m: float = Field(ge=0, le=10)


class RoomSection(Section):
    """What the chair must not run into."""

    walls: Annotated[list[WallSection], Field(max_length=20)] = Field(default=[])
    posts: Annotated[list[PostSection], Field(max_length=40)] = Field(default=[])


class RunSection(Section):
    """How often, and with what."""

    rate_hz: float = Field(default=100.0, ge=20, le=1000)
    self_motion: float = Field(default=1.0, ge=0, le=100)
    solver: SolverName | None = None


class ArdisProblem(Problem):
    """A hand that is moved to its goals by one stick."""

    system: Literal["ardis"]
    robot: RobotSection = RobotSection()
    stick: StickSection
    goals: Annotated[list[GoalSection], Field(max_length=20)] = Field(default=[])
    room: RoomSection = RoomSection()
    run: RunSection = RunSection()
    plant: ChairPlant = ChairPlant()
