"""Keys of a problem file of `system = "ardis"`, with their meaning."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator

from rehab_opt.kinematics import DRIVES, DriveName
from rehab_opt.session.clearance import ClearanceSection
from rehab_opt.session.plant import ChairPlant
from rehab_opt.session.schema import Length, Problem, Section, SolverName, Triple, refusal

RowName = Literal["x", "y", "z", "rx", "ry", "rz", "roll7"]

Pair = Annotated[list[Length], Field(min_length=2, max_length=2)]
Angle = Annotated[float, Field(ge=-360, le=360)]
ARDIS_JOINTS = 4


class RobotSection(Section):
    """The robot and its starting posture."""

    FILES: ClassVar = ("file",)
    file: str | None = Field(default=None, min_length=1)
    """A robot file whose `mount_m` and `mount_deg` place the arm's base in the chassis frame; by default ARDIS's arm.
    Chair, user, chassis limits and rotor inertias (0.05 kg m^2 for each joint) are the assumptions of `ardis` and
    `arm_on_chair`."""
    start_m: Pair = Field(default=[0.0, 0.0])
    """Starting position of the point about which the chair turns."""
    heading_deg: Angle = 0.0
    """Starting heading, counterclockwise from above."""
    arm_deg: Annotated[list[Angle], Field(min_length=4, max_length=100)] | None = None
    """Starting angles `[shoulder flexion, shoulder rotation, elbow, wrist]`, by default `ARDIS_READY`. With a robot
    file, a value for each of its joints is required."""
    mount_height_m: float = Field(default=0.70, ge=0.2, le=1.5)
    """Height of the shoulder; not allowed with a robot file, which defines the height itself."""
    chair_mass_kg: float = Field(default=120.0, ge=20, le=500)
    """Mass of the chair with its user."""
    payload_kg: float = Field(default=0.0, ge=0, le=20)
    """Mass in the hand; not allowed with a robot file, which defines this mass itself."""

    @model_validator(mode="after")
    def said_once(self) -> Self:
        """Refuse keys that the robot file defines itself, and starting angles that are missing or of wrong number."""
        if self.file is None:
            if self.arm_deg is not None and len(self.arm_deg) != ARDIS_JOINTS:
                raise refusal("arm_deg", self.arm_deg, f"{ARDIS_JOINTS} entries")
            return self
        for key, own in (("mount_height_m", "mount_m"), ("payload_kg", "payload_kg")):
            if key in self.model_fields_set:
                raise refusal(key, getattr(self, key), f"no such key beside file: the robot file has {own}")
        if self.arm_deg is None:
            raise refusal("arm_deg", None, "where the arm of the robot file begins, an entry for each of its joints")
        return self


class ModeSection(Section):
    """What the two axes of the stick (forward and left) move in one mode."""

    name: str = Field(min_length=1, max_length=20)
    """The user's name for the mode."""
    rows: Annotated[list[RowName], Field(min_length=2, max_length=2)]
    """The two quantities that the forward and the left axis move, of x, y, z, rx, ry, rz (in the chair's frame) and
    roll7."""
    speeds: Annotated[list[Annotated[float, Field(ge=-2, le=2)]], Field(min_length=2, max_length=2)]
    """Speeds of these two quantities at full deflection [m/s, rad/s]."""
    held: Annotated[list[RowName], Field(max_length=5)] = Field(default=[])
    """Quantities whose speed stays zero in this mode; `["rx", "ry"]` keeps a cup level."""


class StickSection(Section):
    """The drives to run, the stick of each, and its processing."""

    FILES: ClassVar = DRIVES
    simulated: Annotated[list[DriveName], Field(max_length=4)] = Field(default=[])
    """Drives whose stick a simulated user moves. Each controller has its own user, who watches the hand and steers it
    to one goal after the other. If a goal takes more than 60 s, the user releases the stick for good."""
    mecanum: str | None = Field(default=None, min_length=1)
    """Recording for four mecanum wheels, a `.csv` with the header `t_s,forward,left,switch,gripper`: deflections -1 to
    1, buttons 0 or 1; each row holds until the next. All controllers get the same recording, which does not react to
    them."""
    differential: str | None = Field(default=None, min_length=1)
    """Recording for two wheels on one axle, which cannot move sideways."""
    omnidirectional: str | None = Field(default=None, min_length=1)
    """Recording for a base that moves in every direction; its command is a twist."""
    fixed: str | None = Field(default=None, min_length=1)
    """Recording for a fixed base, where only the arm moves."""
    dead_zone: float | None = Field(default=None, ge=0, lt=1)
    """Dead zone of the stick; default: `Joystick`'s (0.12)."""
    rate_per_s: float | None = Field(default=None, gt=0, le=1000)
    """Rate of the stick's filter; default: `Joystick`'s (3)."""
    modes: Annotated[list[ModeSection], Field(min_length=1, max_length=8)] | None = None
    """Modes of the stick; default: `Joystick`'s; the switch cycles through the modes."""

    @model_validator(mode="after")
    def a_drive_is_run(self) -> Self:
        """Refuse a problem without a stick for any drive, and two sticks for one drive."""
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
        """The drives to run."""
        return tuple(drive for drive in DRIVES if drive in self.simulated or drive in self.recordings)


class GoalSection(Section):
    """A goal of the user; goals are reached in order."""

    name: str = Field(min_length=1, max_length=40)
    """Name in tables and figures."""
    hand_m: Triple
    """Position of the hand at the goal, in the world frame."""
    within_m: float = Field(default=0.03, gt=0, le=1)
    """The goal is reached if the hand is within this distance, and the gripper is as required."""
    gripper: Literal["open", "closed"] | None = None
    """Required state of the gripper, if any."""

    def met(self, hand: ArrayLike, closed: ArrayLike) -> NDArray[np.bool_]:
        """Whether the goal is reached, for hand positions (..., 3) [m] and gripper states `closed` (...)."""
        near = np.linalg.norm(np.asarray(hand) - self.hand_m, axis=-1) <= self.within_m
        as_asked = self.gripper is None or np.asarray(closed) == (self.gripper == "closed")
        return np.asarray(near & as_asked)


class WallSection(Section):
    """A wall, which occupies the points p of the floor with normal . p > offset; the normal has length one."""

    normal: Pair
    """Unit normal."""
    offset_m: Annotated[float, Field(ge=-100, le=100)]
    """Distance along the normal from the world's origin."""

    @model_validator(mode="after")
    def normal_is_a_direction(self) -> Self:
        """Refuse a normal that is not of length 1."""
        if abs(self.normal[0] ** 2 + self.normal[1] ** 2 - 1) > 1e-3:
            raise refusal("normal", self.normal, "two numbers, a direction of length 1")
        return self


class PostSection(Section):
    """A round post on the floor."""

    centre_m: Pair
    """Position on the floor."""
    radius_m: float = Field(ge=0, le=10)
    """Radius of the post."""


class RoomSection(Section):
    """Obstacles for the chair."""

    walls: Annotated[list[WallSection], Field(max_length=20)] = Field(default=[])
    """Straight walls."""
    posts: Annotated[list[PostSection], Field(max_length=40)] = Field(default=[])
    """Round posts."""


class RunSection(Section):
    """Rate and solver of the run."""

    rate_hz: float = Field(default=100.0, ge=50, le=1000)
    """Ticks per second."""
    self_motion: float = Field(default=1.0, ge=0, le=100)
    """Weight of the posture term in Eq. (1), for both controllers."""
    solver: SolverName | None = None
    """Solver of the QP; default: `RedundancyResolver`'s; `--solver` overrides it."""


class ArdisProblem(Problem):
    """A wheelchair with an arm, whose hand one stick moves to its goals."""

    system: Literal["ardis"]
    robot: RobotSection = RobotSection()
    """The chair with its arm."""
    stick: StickSection
    """The user's stick, and the drives that are run."""
    goals: Annotated[list[GoalSection], Field(max_length=20)] = Field(default=[])
    """The goals, reached one after the other."""
    room: RoomSection = RoomSection()
    """The obstacles around the chair."""
    run: RunSection = RunSection()
    """The run."""
    clearance: ClearanceSection | None = None
    """Bodies that the arm avoids besides chair and user, in the world frame; may be left out."""
    plant: ChairPlant = ChairPlant()
    """The plant, see the plant's keys."""

    @model_validator(mode="after")
    def a_user_has_a_goal(self) -> Self:
        """Refuse a simulated user without a goal."""
        if self.stick.simulated and not self.goals:
            raise refusal("goals", [], "a goal for the simulated user of stick.simulated")
        return self
