"""Runs of a force on a simulated hand, and the hands: people, greedy ones, ones that jump, sensors that freeze."""

from __future__ import annotations

import math
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from rehab_opt import Assistance, Command, PotentialField, Workspace
from tests.judge.numbering import judged, run_length
from tests.judge.references import reaches, sudden, tremor
from tests.judge.sensor_faults import STAMPS, Schedule, schedule

Array = NDArray[np.float64]

DTS = (1e-3, 1e-3, 2e-3, 5e-3, 1e-2, 2e-2)
FAULTS = ("x", "v", "frozen", "frozen", "disabled", *STAMPS)
HANDS = ("person", "greedy", "shuttle", "held", "sudden", "fast")
THERAPY, TASK = ("stretch", "assist", "resist"), ("follow", "hold")
SPEED_CAP = 1.0
NOISE = 8e-3
"""[m] What is less beyond the fastest hand may be noise, which is learnt."""


class Settings(NamedTuple):
    """What the force was told."""

    dt: float
    mode: str
    force_limit: float
    slew_limit: float
    growth_limit: float
    budget: float
    speed_cap: float
    stiffness: float
    damping: float
    return_stiffness: float
    return_force: float
    outline: Array
    """(k, 2) [m] corners of the comfortable workspace."""
    unsure: float
    """[s] by which delay and lag may be more than the none that is told; in these runs there is none."""


class Run(NamedTuple):
    """One run, one row a tick."""

    settings: Settings
    hand: str
    x: Array
    """(N + 1, 2) [m] where the hand truly was at each tick, and after the last."""
    shown: Array
    """(N, 2) [m] where the sensor last said it was."""
    seconds: Array
    """(N,) [s] from each tick to the next."""
    commands: list[Command]
    desired_force: Array
    """(N, 2) [N]"""
    left: Array
    """(N,) [J]"""
    faults: Schedule
    velocity: Array
    """(N, 2) [m/s] that was told; NaN where none was."""
    fast: NDArray[np.bool_]
    """(N,) whether the hand was faster than the cap after this tick."""

    @property
    def where(self) -> str:
        """What it is."""
        return f"{self.settings.mode}, {self.hand} hand, dt {self.settings.dt:g}"


def outline(rng: np.random.Generator) -> Array:
    """(k, 2) a workspace about the origin, sometimes with a dent."""
    corners = int(rng.integers(4, 12))
    angle = np.linspace(0, 2 * math.pi, corners, endpoint=False) + 0.3 * rng.uniform(-1, 1, corners) / corners
    radius = rng.uniform(0.03, 0.09, corners)
    return np.asarray(radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]))


def draw(rng: np.random.Generator, number: int) -> Settings:
    """A mode, bounds and a person."""
    return Settings(
        dt=float(rng.choice(DTS)),
        mode=(THERAPY + TASK)[number % 5],
        force_limit=float(rng.choice([5.0, 30.0, 100.0])),
        slew_limit=float(rng.choice([50.0, 200.0, 1000.0, 5000.0])),
        growth_limit=(1e5, 200.0, 60.0)[number % 7 % 3],
        budget=float(rng.choice([0.05, 0.5, 2.0, 20.0])),
        speed_cap=float(rng.choice([0.5, SPEED_CAP, 2.0])),
        stiffness=float(rng.choice([200.0, 1000.0, 4000.0])),
        damping=float(rng.choice([0.0, 10.0])),
        return_stiffness=float(rng.choice([200.0, 500.0])),
        return_force=float(rng.choice([2.0, 10.0])),
        outline=outline(rng),
        unsure=(0.0, 0.003)[number // 2 % 2],
    )


def field_of(given: Settings, by: Array) -> PotentialField:
    """A field around a line through the workspace, or one point of it, carried by so much; the pull across is -S y."""
    if given.mode == "hold":
        return PotentialField(np.array([[0.1, 0.02]]) + by, stiffness=given.stiffness, damping=given.damping,
                              width=0.03, compile=False)  # fmt: skip
    drag, along = {"assist": (100.0, "remaining"), "resist": (60.0, "travelled")}.get(given.mode, (0.0, "remaining"))
    line = np.column_stack([np.linspace(-0.3, 0.3, 40), np.full(40, 0.02)])
    return PotentialField(line + by, stiffness=given.stiffness, width=0.025, damping=given.damping, drag=drag,
                          drag_along=along, rest_on_target=False, compile=False)  # type: ignore[arg-type]  # fmt: skip


def assistance(given: Settings, *, by: ArrayLike = (0.0, 0.0)) -> Assistance:
    """The force that is judged; its field stands `by` (2,) [m] from where `field_of` has it."""
    comfortable = Workspace(shapely.Polygon(given.outline), accuracy=0.0)
    options: dict[str, float] = {}
    if (given.return_stiffness, given.return_force) != (500.0, 10.0):  # which are what they are where nothing is said
        options |= {"return_stiffness": given.return_stiffness, "return_force": given.return_force}
    if given.unsure != 0.003:  # likewise
        options["actuation_uncertainty"] = given.unsure
    return Assistance(
        field_of(given, np.asarray(by)), comfortable=comfortable, mode=given.mode, force_limit=given.force_limit,  # type: ignore[arg-type]
        slew_limit=given.slew_limit, growth_limit=given.growth_limit, energy_budget=given.budget,
        speed_cap=given.speed_cap, dt=given.dt, compile=False, **options,
    )  # fmt: skip


def hand_path(rng: np.random.Generator, hand: str, ticks: int, dt: float) -> Array:
    """(ticks + 1, 2) where a hand would go whatever the force."""
    path = reaches(rng, rng.uniform(-0.1, 0.1, 2), ticks + 1, dt, size=float(rng.choice([0.05, 0.2])))
    path = path + tremor(rng, ticks + 1, dt, size=float(rng.choice([0.0, 2e-3, 0.01])), axes=2)
    if hand == "held":
        return np.repeat(path[:1] * rng.choice([0.2, 1.0, 3.0]), ticks + 1, axis=0)
    return sudden(rng, path, dt)[0] if hand == "sudden" else path


def follow(
    rng: np.random.Generator,
    number: int,
    *,
    faults: float = math.inf,
    late: bool = False,
    slips: bool = False,
) -> Run:
    """One run: a fault each `faults` s; with `late`, ticks that come late, and samples that are missed.

    A sensor that `slips` comes back from some of its frozen times a little further off than the fastest hand could be;
    the hand is greedy then, which takes all that the force gives while it is not seen.
    """
    given = draw(rng, number)
    force, dt, hand = assistance(given), given.dt, "greedy" if slips else HANDS[number % len(HANDS)]
    ticks = run_length(rng, number, dt)
    wrong = schedule(rng, ticks, dt, ("frozen",) if slips else FAULTS, every=faults)
    kinds, stamped = wrong.kind.tolist(), late or math.isfinite(faults)
    path, seconds = hand_path(rng, hand, ticks, dt), np.full(ticks, dt)
    if late:  # up to what the watchdog allows: 50 ms, or three ticks
        seconds = np.where(rng.random(ticks) < 0.05, rng.uniform(dt, max(0.05, 3 * dt), ticks), dt)
    stamps: list[Any] = np.cumsum(np.r_[dt, seconds[:-1]]).tolist() if late else wrong.stamp
    pace = given.speed_cap * rng.uniform(0.9 if slips else 0.3, 0.999)
    x, wanted, left = np.empty((ticks + 1, 2)), np.empty((ticks, 2)), np.empty(ticks)
    told, fast = np.full((ticks, 2), math.nan), np.zeros(ticks, dtype=bool)
    x[0], commands, tells, shown = path[0], [], rng.random() < 0.4, np.empty((ticks, 2))
    period = max(round(rng.uniform(0.02, 0.6) / dt), 1)
    off, seen = np.zeros(2), 0
    for k in range(ticks):
        if slips and k > 1 and kinds[k - 1] == "frozen" != kinds[k] and rng.random() < 0.5:
            way = x[k] + off - shown[k - 1]
            fastest = given.speed_cap * (k - seen) * dt + NOISE
            off = off + way * (rng.uniform(1.001, 1.1) * fastest / max(float(np.hypot(*way)), 1e-9) - 1.0)
        here, options = x[k] + off, {}
        if tells and k:
            told[k] = (x[k] - x[k - 1]) / seconds[k - 1]
            options["v"] = told[k]
        if kinds[k] == "frozen":  # a sensor that repeats itself while the hand goes on
            here = shown[k - 1]
        elif kinds[k] == "x":
            here = here.copy()
            here[wrong.index[k] % 2] = wrong.number[k]
        elif kinds[k] == "v" and tells and k:
            options["v"] = told[k].copy()
            options["v"][wrong.index[k] % 2] = wrong.number[k]
        if stamped:
            options.update(enable=wrong.enable[k], stamp=stamps[k])
        shown[k] = shown[k - 1] if kinds[k] == "x" else here
        seen = k if k == 0 or (shown[k] != shown[k - 1]).any() else seen
        command = force.step(here, **options)
        commands.append(command)
        wanted[k], left[k] = force.desired_force, force.energy_left
        there = np.array([0.12 if k // period % 2 else -0.12, 0.0])
        x[k + 1] = moved(hand, x[k], path[k + 1], command.value, pace * seconds[k], there)
        if hand == "fast" and rng.random() < 0.002:
            x[k + 1] += rng.uniform(-0.2, 0.2, 2)
    fast = np.linalg.norm(np.diff(x, axis=0), axis=1) > given.speed_cap * seconds * (1 + 1e-9)
    return Run(given, hand, x, shown, seconds, commands, wanted, left, wrong, told, fast)


followed = partial(judged, follow)


def moved(hand: str, x: Array, path: Array, force: Array, most: float, shuttle: Array) -> Array:
    """(2,) where a hand is next: no further than `most`, with the force where it is greedy; a shuttle goes to there."""
    way = path - x
    size = float(np.hypot(*force))
    if hand == "greedy" and size > 0.2:
        way = force * (most / size)
    elif hand == "shuttle":
        way = shuttle - x
        if size > 0.5 and way @ force < 0:
            way = force * (most / size)
    length = float(np.hypot(*way))
    return x + way * min(1.0, most / length) if length > 0 else x.copy()


def signed_distance(corners: Array, points: Array) -> tuple[Array, Array]:
    """(N,) [m] from a polygon's edge, negative inside, and the nearest points (N, 2) of the edge."""
    a, b = corners, np.roll(corners, -1, axis=0)
    way = b - a
    fraction = np.clip(np.einsum("nkx,kx->nk", points[:, None] - a, way) / (way**2).sum(1), 0, 1)
    feet = a + fraction[..., None] * way
    far = np.linalg.norm(points[:, None] - feet, axis=2)
    x, y = points[:, 0, None], points[:, 1, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        crosses = ((a[:, 1] > y) != (b[:, 1] > y)) & (x < (b[:, 0] - a[:, 0]) * (y - a[:, 1]) / way[:, 1] + a[:, 0])
    inside = crosses.sum(axis=1) % 2 == 1
    nearest = far.argmin(axis=1)
    rows = np.arange(len(points))
    return np.where(inside, -1.0, 1.0) * far[rows, nearest], feet[rows, nearest]
