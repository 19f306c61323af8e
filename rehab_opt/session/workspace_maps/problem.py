"""Keys of problem files with `system = "workspace_map"`."""

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
    """Rules and options of the maps."""

    rules: Annotated[list[Literal["safe", "polar"]], Field(min_length=1, max_length=2), Once] = Field(
        default=["safe", "polar"]
    )
    """Rules to compare: our `safe` rule, and the published `polar` rule."""
    directions: Literal["both", "forward"] = "both"
    """Whether both directions are mapped, or only source to target."""
    polar_landmarks: int = Field(default=20, ge=3, le=2000)
    """Number of landmark lines that the `polar` rule uses."""
    rotation_deg: Rotation = 0.0
    """Average angle by which the map rotates directions: 0 keeps them; `"best"` gives the least distortion."""
    audit_points: int = Field(default=20_000, ge=100, le=1_000_000)
    """Number of random points at which a map is audited."""
    seed: int = Field(default=0, ge=0, le=2**31)
    """Seed of the random points of the audit."""


class TrajectorySection(Section):
    """A movement in one of the sets, which is mapped to the other set."""

    name: str = Field(min_length=1, max_length=40)
    """Name of the movement in figures and `trace.csv`."""
    set: End
    """The set that contains the movement."""
    recording: RecordingSection
    """The recorded movement."""
    placement: PlanarPlacement
    """Position of the movement in the frame of the sets."""
    rate_hz: float = Field(default=100.0, ge=1, le=1000)
    """Samples per second of the mapped movement."""


class WorkspaceMapProblem(Problem):
    """A map between two workspaces, in one or both directions."""

    system: Literal["workspace_map"]
    source: MappedSet
    """The first set: a name in `arm.range_of_motion`, or a table with the keys of `[arm]` and one range of motion."""
    target: MappedSet
    """The second set, in the form of `source`."""
    arm: ArmOfRanges | None = None
    """The arm; required if `source` or `target` is a name."""
    map: MapSection = MapSection()
    """Rules and options of the maps."""
    trajectory: Annotated[list[TrajectorySection], Field(max_length=MAX_TRAJECTORIES)] = Field(default=[])
    """Movements to map, each in a table `[[trajectory]]`."""

    @model_validator(mode="after")
    def sets_are_there(self) -> Self:
        """Refuse a `source` or `target` that `arm.range_of_motion` does not have, and two trajectories of one name."""
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
