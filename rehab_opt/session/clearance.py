"""`[clearance]` of problem files: bodies, their distances in a run, and a figure of both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from rehab_opt.control.clearance import Clearance
from rehab_opt.control.clearance_pairs import ClearancePairs
from rehab_opt.errors import ConfigurationError, ProblemFileError
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.kinematics.human_arm import ARM_REST, human_arm
from rehab_opt.kinematics.link_capsules import Capsule
from rehab_opt.kinematics.room import Box, KeepOut, arm_capsules
from rehab_opt.session.drawing import LIMIT, MM, OKABE_ITO, REFERENCE, THIN, framed, label_times, legend_below
from rehab_opt.session.live.bodies import ArmBodies, kept_off, moving_rows, sides
from rehab_opt.session.outcome import Array
from rehab_opt.session.robot_file import pose_of
from rehab_opt.session.schema import Section, Side, Triple

if TYPE_CHECKING:
    from matplotlib.figure import Figure
Name = Annotated[str, Field(min_length=1, max_length=60)]
Turns = Annotated[list[Annotated[float, Field(ge=-360, le=360)]], Field(min_length=3, max_length=3)]

SHOWN = 4
"""Number of pairs whose distance over time is drawn; these are the pairs that come closest."""
LINK, BODY = OKABE_ITO[0], OKABE_ITO[4]


class ClearPlaneSection(Section):
    """A half-space that no link enters."""

    point_m: Triple
    """A point of the plane."""
    normal: Triple
    """Normal of the plane, towards the side where the robot may be."""


class ClearCapsuleSection(Section):
    """A bar or ball at rest."""

    name: Name
    """Name in figures and numbers."""
    start_m: Triple
    """One end of its axis."""
    end_m: Triple | None = None
    """The other end; without it the body is a ball."""
    radius_m: float = Field(gt=0, le=5)
    """Radius of the capsule."""


class ClearMovingSection(ClearCapsuleSection):
    """A bar or ball that moves to and fro on a straight line, at rest at both ends; it starts with the run."""

    towards_m: Triple
    """Vector from the position given by the keys above to the other end of the line."""
    period_s: float = Field(gt=0, le=3600)
    """Time for one motion to the other end and back."""


class ClearBoxSection(Section):
    """A box at rest: a table top, a cupboard."""

    name: Name
    """Name in figures and numbers."""
    centre_m: Triple
    """Centre of the box."""
    size_m: Annotated[list[Annotated[float, Field(gt=0, le=20)]], Field(min_length=3, max_length=3)]
    """Edge lengths along the box's own axes."""
    turn_deg: Turns = Field(default=[0.0, 0.0, 0.0])
    """Rotation about the frame's x, then y, then z axis."""


class ClearPersonSection(Section):
    """A person's arm, held in one posture; its radii are assumptions (`ARM_RADII`)."""

    side: Side
    """The arm's side."""
    shoulder_m: Triple
    """Position of the shoulder."""
    facing_deg: float = Field(default=0.0, ge=-360, le=360)
    """Direction in which the person looks, counterclockwise from the frame's x axis."""
    angles_deg: Annotated[list[Annotated[float, Field(ge=-360, le=360)]], Field(min_length=8, max_length=8)] | None = (
        None
    )
    """Angles of the eight joints of Table I; by default the arm hangs."""


class ClearanceSection(Section):
    """Bodies that the robot's links (capsules) avoid, in the frame of the problem; links also avoid each other."""

    margin_mm: float = Field(default=20.0, ge=0, le=1000)
    """Distance to keep from planes, capsules, boxes and people."""
    self_margin_mm: float = Field(default=0.0, ge=0, le=1000)
    """Distance to keep between links."""
    pairs: Annotated[list[Annotated[list[Name], Field(min_length=2, max_length=2)]], Field(max_length=100)] | None = (
        None
    )
    """Pairs of links that avoid each other, by name; by default all pairs that can meet and are not neighbours."""
    rows: int = Field(default=8, ge=1, le=30)
    """Number of contacts that become rows of the QP; these are the nearest contacts."""
    planes: list[ClearPlaneSection] = Field(default=[], max_length=20)
    """Half-spaces."""
    capsules: list[ClearCapsuleSection] = Field(default=[], max_length=50)
    """Bars and balls."""
    boxes: list[ClearBoxSection] = Field(default=[], max_length=50)
    """Boxes."""
    person: list[ClearPersonSection] = Field(default=[], max_length=4)
    """Arms of people, at rest."""
    moving: list[ClearMovingSection] = Field(default=[], max_length=20)
    """Bars and balls that move; the controller gets their positions and velocities."""

    def moving_at(self, time: ArrayLike) -> Array:
        """Data (N, k, 14) of the k moving bodies at times (N,) [s] of the run, in the order of `moving_numbers`."""
        clock, found = np.atleast_1d(np.asarray(time, dtype=np.float64)), []
        for each in self.moving:
            way, rate = np.tile(each.towards_m, 2), 2 * np.pi / each.period_s
            ends = np.array([*each.start_m, *(each.end_m or each.start_m)])
            gone, speed = (1 - np.cos(rate * clock)) / 2, rate * np.sin(rate * clock) / 2
            rest = np.tile([each.radius_m, 1.0], (len(clock), 1))
            found.append(np.hstack([ends + gone[:, None] * way, speed[:, None] * way, rest]))
        return np.stack(found, axis=1) if found else np.zeros((len(clock), 0, 14))


@dataclass(frozen=True, eq=False)
class NearestBodies:
    """Distances between links and bodies during a run of N ticks.

    Parameters
    ----------
    pairs : k pairs of a link and a body, or of two links. section : table `[clearance]` of the problem.
    q : (N, n) joint positions [rad, m]. time : (N,) [s].
    distances : (N, k) [m] distance of every pair, minus the pair's margin.
    """

    pairs: ClearancePairs
    section: ClearanceSection
    q: Array
    time: Array
    distances: Array

    @property
    def names(self) -> tuple[tuple[str, ...], ...]:
        """Names of both bodies of every pair; moving bodies have their names from the problem file."""
        known = {f"moving {i}": each.name for i, each in enumerate(self.section.moving)}
        return tuple(tuple(known.get(name, name) for name in pair) for pair in self.pairs.names)

    @property
    def metrics(self) -> dict[str, Any]:
        """Smallest distance minus margin during the run, with the pair and the time at which it occurs."""
        tick, pair = np.unravel_index(np.argmin(self.distances), self.distances.shape)
        return {
            "min_beyond_margin_m": float(self.distances[tick, pair]),
            "of": list(self.names[pair]),
            "at_s": float(self.time[tick]),
            "margin_m": self.pairs.clearance.margin,
            "pairs": len(self.pairs.names),
        }

    @property
    def start_notes(self) -> tuple[str, ...]:
        """A note if the first posture is inside the margin of a pair of bodies; otherwise empty."""
        pair = int(np.argmin(self.distances[0]))
        within, names = -MM * float(self.distances[0, pair]), " and ".join(self.names[pair])
        return (f"the robot starts {within:.3g} mm within the margin: {names}",) if within > 0 else ()

    @property
    def note(self) -> str:
        """One sentence: the notes about the start, then the closest approach during the run."""
        of = self.metrics
        least, names = MM * of["min_beyond_margin_m"], " and ".join(of["of"])
        how = f"{-least:.3g} mm within" if least < 0 else f"no nearer than {least:.3g} mm beyond"
        said = f"bodies came {how} the margin: {names}, at {of['at_s']:.3g} s"
        return "; ".join((*self.start_notes, said))

    def figure(self, of: str = "") -> Figure:
        """Bodies at their closest approach, from above and from the side, and distances over time."""
        figure = framed(
            f"Links (blue) and bodies (orange){of} where they came nearest, from above and from the side; and over "
            f"time the distance that is left before the margin ({self.section.margin_mm:g} mm from bodies, "
            f"{self.section.self_margin_mm:g} mm between links), of the pairs that came nearest of "
            f"{len(self.pairs.names)}. n = {len(self.time)} ticks.",
            5.4,
        )
        panels = figure.subplot_mosaic([["above", "side"], ["over", "over"]])
        tick = int(self.distances.min(axis=1).argmin())
        for key, across, up in (("above", 0, 1), ("side", 0, 2)):
            _draw(panels[key], self.pairs, self.q[tick], self.section.moving_at(self.time[tick])[0], across, up)
        axes = panels["over"]
        nearest = np.argsort(self.distances.min(axis=0), kind="stable")[:SHOWN]
        for pair, colour in zip(nearest, OKABE_ITO, strict=False):
            label = " and ".join(self.names[pair]).replace("_", " ")
            axes.plot(self.time, MM * self.distances[:, pair], color=colour, label=label)
        axes.axhspan(-1e6, 0, color=LIMIT, alpha=0.4, linewidth=0, zorder=0, label="within the margin")
        axes.axvline(self.time[tick], color=REFERENCE, linewidth=THIN, linestyle=":", label="shown above")
        top = MM * max(float(self.distances[:, nearest].max()), 0.01)
        axes.set_ylim(-0.06 * top, 1.05 * top)
        label_times([axes], "distance less the margin [mm]")
        return legend_below(figure)


def planes_of(sections: Sequence[Any], file: str, key: str) -> list[KeepOut]:
    """The planes that a problem file defines under `key`. Raises `ProblemFileError` for a zero normal."""
    planes = []
    for i, each in enumerate(sections):
        try:
            planes.append(KeepOut.through(each.point_m, each.normal))
        except ConfigurationError as refused:
            raise ProblemFileError(file, f"{key}.{i}.normal", each.normal, "a direction") from refused
    return planes


def clearance_of(section: ClearanceSection | None, file: str, *, moving: bool = False) -> list[Any]:
    """The `Clearance` of a problem file, for the `limits` of a controller; empty without the table `[clearance]`.

    Raises
    ------
    ProblemFileError : a zero normal; moving bodies in a run that cannot move them (`moving` is false).
    """
    if section is None:
        return []
    if section.moving and not moving:
        expected = 'none: bodies that move are for runs of system = "pose_tracking"'
        raise ProblemFileError(file, "clearance.moving", [each.name for each in section.moving], expected)
    capsules = [
        Capsule(each.name, _point(each.start_m), _point(each.end_m or each.start_m), each.radius_m)
        for each in section.capsules
    ]
    for person in section.person:
        posture = ARM_REST if person.angles_deg is None else np.deg2rad(person.angles_deg)
        placement = pose_of([0.0, 0.0, person.facing_deg - 90.0], person.shoulder_m)  # the arm's frame looks along y
        parts = arm_capsules(human_arm(side=person.side), posture, placement=placement)
        capsules += [
            Capsule(f"{person.side} {name}", _point(np.asarray(part.start)), _point(np.asarray(part.end)), part.radius)
            for name, part in zip(("upper arm", "forearm", "hand"), parts, strict=True)
        ]
    return [
        Clearance(
            **section.arguments("margin_mm", "self_margin_mm"),
            planes=planes_of(section.planes, file, "clearance.planes"),
            capsules=capsules,
            boxes=[Box.at(each.name, pose_of(each.turn_deg, each.centre_m), each.size_m) for each in section.boxes],
            moving=len(section.moving),
            pairs=None if section.pairs is None else [(one, other) for one, other in section.pairs],
            max_contacts=section.rows,
        )
    ]


def clearance_key(argument: str) -> str | None:
    """Key of the problem file for an `argument` of the controller; None for an argument outside the clearance."""
    first, _, rest = argument.partition("limits[0]")
    if not first and rest:
        return "clearance" + rest.replace("[", ".").replace("]", "")
    return "clearance" if argument == "chain" else None


def nearest_bodies(
    section: ClearanceSection | None, file: str, chain: SerialChain, q: Array, time: Array
) -> NearestBodies | None:
    """Distances between links and bodies at postures q (N, n) and times (N,) [s]; None without `[clearance]`."""
    if section is None:
        return None
    pairs = ClearancePairs(clearance_of(section, file, moving=True)[0], chain)
    told = section.moving_at(time).reshape(len(q), -1)
    found = np.array(pairs.distances.map(len(q))(q.T, told.T, np.zeros((1, len(q)))))
    return NearestBodies(pairs, section, q, time, found.T)


def start_notes(section: ClearanceSection | None, file: str, chain: SerialChain, q: Array) -> tuple[str, ...]:
    """A note if a posture (n,) is inside the margin of a pair of bodies; otherwise empty."""
    near = nearest_bodies(section, file, chain, q[None], np.zeros(1))
    return () if near is None else near.start_notes


def _point(numbers: Any) -> tuple[float, float, float]:
    x, y, z = (float(each) for each in numbers)
    return x, y, z


def _draw(axes: Any, pairs: ClearancePairs, q: Array, told: Array, across: int, up: int) -> None:  # noqa: PLR0917
    """Draw the outlines of links and bodies, projected onto the axes `across` and `up`."""
    from shapely import MultiPoint  # noqa: PLC0415

    given, seen, links = pairs.clearance, [across, up], ArmBodies(pairs.chain).capsules(q, LINK)
    outlines = [
        (MultiPoint(MM * np.reshape(each[:6], (2, 3))[:, seen]).convex_hull.buffer(MM * each[6]), colour)
        for colour, rows in ((LINK, links), (BODY, kept_off(np.zeros(3), [given])["capsules"] + moving_rows(told)))
        for each in rows
    ]
    outlines += [(MultiPoint(MM * sides(box).reshape(-1, 3)[:, seen]).convex_hull, BODY) for box in given.boxes]
    for outline, colour in outlines:
        axes.fill(*outline.exterior.xy, facecolor=colour, edgecolor=colour, alpha=0.35, linewidth=1.0)
    axes.autoscale_view()
    for plane in given.planes:
        normal = np.array(plane.normal)
        if np.linalg.norm(normal[seen]) > 0.999:  # the plane is seen edge-on
            foot, way = MM * plane.offset * normal[seen], np.array([-normal[up], normal[across]])
            axes.axline(foot, foot + way, color=REFERENCE, linestyle="--")
    axes.set(aspect="equal", adjustable="datalim", xlabel=f"{'xyz'[across]} [mm]", ylabel=f"{'xyz'[up]} [mm]")
