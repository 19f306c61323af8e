"""Keys of a problem file of `system = "workspace_map"`, with their meaning."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Discriminator, Field, Tag, model_validator

from rehab_opt.session.arm_keys import ArmOfOneRange, ArmOfRanges, ranges_by_name
from rehab_opt.session.schema import (
    NAME,
    TABLE,
    Once,
    PlanarPlacement,
    Problem,
    RecordingSection,
    Section,
    refusal,
)

__all__ = ["MapSection", "TrajectorySection", "WorkspaceMapProblem"]

MAX_TRAJECTORIES = 12

End = Literal["source", "target"]
MappedSet = Annotated[
    Annotated[str, Field(min_length=1), Tag(NAME)] | Annotated[ArmOfOneRange, Tag(TABLE)],
    Discriminator(lambda value: TABLE if isinstance(value, dict | ArmOfOneRange) else NAME),
]
Rotation = Annotated[
    Annotated[Literal["best"], Tag(NAME)] | Annotated[float, Field(ge=-360, le=360), Tag(TABLE)],
    Discriminator(lambda value: NAME if isinstance(value, str) else TABLE),
]


class MapSection(Section):
    """Rules and options of the map."""

    rules: Annotated[list[Literal["safe", "polar"]], Field(min_length=1, max_length=2), Once] = Field(
        default=["safe", "polar"]
    )
    """Landmark rules to compare."""
    directions: Literal["both", "forward"] = "both"
    """Both directions, or only from source to target."""
    polar_landmarks: int = Field(default=20, ge=3, le=2000)
    """Number of lines of the published rule."""
    rotation_deg: Rotation = 0.0
    """Average rotation of directions; 0 keeps them, `"best"` is the rotation with the least distortion."""
    audit_points: int = Field(default=20_000, ge=100, le=1_000_000)
    """Number of random points of the audit."""
    seed: int = Field(default=0, ge=0, le=2**31)
    """Seed of the audit's points."""


class TrajectorySection(Section):
    """A movement in one of the sets, which is mapped into the other."""

    name: str = Field(min_length=1, max_length=40)
    """Name in figures and `trace.csv`."""
    set: End
    """The set that contains it."""
    recording: RecordingSection
    """The recorded movement."""
    placement: PlanarPlacement
    """Its position in the frame of the sets."""
    rate_hz: float = Field(default=100.0, ge=1, le=1000)
    """Samples per second."""


class WorkspaceMapProblem(Problem):
    """A map between two workspaces, in one or both directions."""

    system: Literal["workspace_map"]
    source: MappedSet
    """A name of `arm.range_of_motion`, or a table with the keys of `[arm]` and one range."""
    target: MappedSet
    """The other set, in the same form."""
    arm: ArmOfRanges | None = None
    """The arm; needed if a set is given by name."""
    map: MapSection = MapSection()
    """Rules and options of the map."""
    trajectory: Annotated[list[TrajectorySection], Field(max_length=MAX_TRAJECTORIES)] = Field(default=[])
    """Movements to map, each a `[[trajectory]]`."""

    @model_validator(mode="after")
    def sets_are_there(self) -> Self:
        """Refuse names of ranges that `arm` lacks, and trajectories with the same name."""
        there = ranges_by_name(self.arm.range_of_motion) if self.arm is not None else {}
        for key in ("source", "target"):
            named = getattr(self, key)
            if isinstance(named, str) and named not in there:
                known = f"the name of a range of arm.range_of_motion ({', '.join(there) or 'there is none'})"
                raise refusal(key, named, f"{known}, or a table such as [arm] with one range")
        if self.source == self.target:
            raise refusal("target", self.target, "another set than the source")
        names = [trajectory.name for trajectory in self.trajectory]
        for i, trajectory in enumerate(self.trajectory):
            if trajectory.name in names[:i]:
                raise refusal(f"trajectory.{i}.name", trajectory.name, "each name once")
            if trajectory.set == "target" and self.map.directions == "forward":
                raise refusal(f"trajectory.{i}.set", "target", '"source", since map.directions = "forward"')
        return self
