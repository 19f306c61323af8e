"""What a problem file of `system = "ardis"` may say, and what each key means."""

from __future__ import annotations

from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator

from rehab_opt.kinematics import DRIVES, DriveName
from rehab_opt.session.clearance import ClearanceSection
from rehab_opt.session.plant import ChairPlant
from rehab_opt.session.schema import Length, Problem, Section, SolverName, Triple, refusal

__all__ = ["DRIVES", "ArdisProblem", "DriveName", "GoalSection", "RobotSection", "RunSection", "StickSection"]

RowName = Literal["x", "y", "z", "rx", "ry", "rz", "roll7"]

Pair = Annotated[list[Length], Field(min_length=2, max_length=2)]
Angle = Annotated[float, Field(ge=-360, le=360)]
ARDIS_JOINTS = 4


class RobotSection(Section):
    """The robot and how it stands when the run begins."""

    file: str | None = Field(default=None, min_length=1)
    """A robot file whose `mount_m`, `mount_deg` say where the arm's base stands in the chassis frame; by default
    ARDIS's arm. Chair, user, chassis limits and rotors (0.05 kg m^2 a joint) are those of `ardis` and `arm_on_chair`,
    assumptions."""
    start_m: Pair = Field(default=[0.0, 0.0])
    """Where the chair's turning point stands."""
    heading_deg: Angle = 0.0
    """Counterclockwise from above."""
    arm_deg: Annotated[list[Angle], Field(min_length=4, max_length=100)] | None = None
    """`[shoulder flexion, shoulder rotation, elbow, wrist]`, by default `ARDIS_READY`; with a robot file required, a
    value for each of its joints."""
    mount_height_m: float = Field(default=0.70, ge=0.2, le=1.5)
    """Of the shoulder; the robot file's where there is one."""
    chair_mass_kg: float = Field(default=120.0, ge=20, le=500)
    """Of the chair with its user."""
    payload_kg: float = Field(default=0.0, ge=0, le=20)
    """In the hand; the robot file's where there is one."""

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
    """What the user calls it."""
    rows: Annotated[list[RowName], Field(min_length=2, max_length=2)]
    """What forward and left move: two of x, y, z, rx, ry, rz (chair's frame), roll7."""
    speeds: Annotated[list[Annotated[float, Field(ge=-2, le=2)]], Field(min_length=2, max_length=2)]
    """Of these at full deflection [m/s, rad/s]."""
    held: Annotated[list[RowName], Field(max_length=5)] = Field(default=[])
    """Rows that do not move meanwhile: `["rx", "ry"]` keeps a cup level."""


class StickSection(Section):
    """Which drives are run, who moves the stick of each, and how the stick is read."""

    simulated: Annotated[list[DriveName], Field(max_length=4)] = Field(default=[])
    """Drives whose stick a simulated user moves. Each controller has a user of its own, who watches the hand and steers
    it to the goals, one after the other, and gives up after 60 s for one of them."""
    mecanum: str | None = Field(default=None, min_length=1)
    """Recording for four mecanum wheels, a `.csv` with the header `t_s,forward,left,switch,gripper`: deflections -1 to
    1, buttons 0 or 1; each row is held until the next. Each controller gets the
    same, since it does not react."""
    differential: str | None = Field(default=None, min_length=1)
    """For two wheels on one axle, which cannot go sideways."""
    omnidirectional: str | None = Field(default=None, min_length=1)
    """For a base that takes its own twist as command and goes in every direction."""
    fixed: str | None = Field(default=None, min_length=1)
    """For a base that stands, where the arm moves alone."""
    dead_zone: float | None = Field(default=None, ge=0, lt=1)
    """By default `Joystick`'s (0.12)."""
    rate_per_s: float | None = Field(default=None, gt=0, le=1000)
    """By default `Joystick`'s (3)."""
    modes: Annotated[list[ModeSection], Field(min_length=1, max_length=8)] | None = None
    """By default `Joystick`'s; the switch goes round."""

    @model_validator(mode="after")
    def a_drive_is_run(self) -> Self:
        """Refuse a problem that has no stick for any drive, or two for one."""
        if not self.drives:
            raise refusal("simulated", [], f"a simulated user or a recording for one of {', '.join(DRIVES)}")
        if twice := sorted({*self.simulated} & {*self.recordings}):
            raise refusal(twice[0], self.recordings[twice[0]], "no recording for a drive of stick.simulated")
        return self

    @property
    def recordings(self) -> dict[DriveName, str]:
        """The recording of each drive that has one."""
        return {drive: file for drive in DRIVES if (file := getattr(self, drive)) is not None}

    @property
    def drives(self) -> tuple[DriveName, ...]:
        """Those that are run."""
        return tuple(drive for drive in DRIVES if drive in self.simulated or drive in self.recordings)


class GoalSection(Section):
    """What the user is to bring about, one after the other."""

    name: str = Field(min_length=1, max_length=40)
    """What tables and figures call it."""
    hand_m: Triple
    """Where the hand is to be, in the world frame."""
    within_m: float = Field(default=0.03, gt=0, le=1)
    """Reached when the hand is within this, the gripper as stated."""
    gripper: Literal["open", "closed"] | None = None
    """As it has to be, where it matters."""

    def met(self, hand: ArrayLike, closed: ArrayLike) -> NDArray[np.bool_]:
        """(...) whether a hand (..., 3) [m] with its gripper closed or not (...) is as asked."""
        near = np.linalg.norm(np.asarray(hand) - self.hand_m, axis=-1) <= self.within_m
        as_asked = self.gripper is None or np.asarray(closed) == (self.gripper == "closed")
        return np.asarray(near & as_asked)


class WallSection(Section):
    """A wall: points p of the floor with normal . p > offset are not free, normal being of length one."""

    normal: Pair
    """Of length 1."""
    offset_m: Annotated[float, Field(ge=-100, le=100)]
    """Along the normal, from the world's origin."""

    @model_validator(mode="after")
    def normal_is_a_direction(self) -> Self:
        """Refuse a wall that faces nowhere, and one whose offset would be in another unit."""
        if abs(self.normal[0] ** 2 + self.normal[1] ** 2 - 1) > 1e-3:
            raise refusal("normal", self.normal, "two numbers, a direction of length 1")
        return self


class PostSection(Section):
    """Something round that stands on the floor."""

    centre_m: Pair
    """On the floor."""
    radius_m: float = Field(ge=0, le=10)
    """Of the post."""


class RoomSection(Section):
    """What the chair must not run into."""

    walls: Annotated[list[WallSection], Field(max_length=20)] = Field(default=[])
    """Straight ones."""
    posts: Annotated[list[PostSection], Field(max_length=40)] = Field(default=[])
    """Round ones."""


class RunSection(Section):
    """How often, and with what."""

    rate_hz: float = Field(default=100.0, ge=50, le=1000)
    """Ticks a second."""
    self_motion: float = Field(default=1.0, ge=0, le=100)
    """Weight of the posture in Eq. (1), of both laws."""
    solver: SolverName | None = None
    """By default `RedundancyResolver`'s; `--solver` replaces it."""


class ArdisProblem(Problem):
    """A hand that is moved to its goals by one stick."""

    system: Literal["ardis"]
    robot: RobotSection = RobotSection()
    """The chair with its arm."""
    stick: StickSection
    """The user's stick, and the drives that are run."""
    goals: Annotated[list[GoalSection], Field(max_length=20)] = Field(default=[])
    """Reached one after the other."""
    room: RoomSection = RoomSection()
    """What is around."""
    run: RunSection = RunSection()
    """How it is run."""
    clearance: ClearanceSection | None = None
    """What the arm keeps clear of besides chair and user, in the world frame; left out where there is no such table."""
    plant: ChairPlant = ChairPlant()
    """On which robot it runs: see the plant's keys."""

    @model_validator(mode="after")
    def a_user_has_a_goal(self) -> Self:
        """Refuse a simulated user who has nowhere to steer to."""
        if self.stick.simulated and not self.goals:
            raise refusal("goals", [], "a goal for the simulated user of stick.simulated")
        return self
