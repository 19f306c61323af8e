"""Runs of `MirrorTracker` on a UR5 whose joints go where they are told: references, planes, pushes and faults drawn."""

from __future__ import annotations

import math
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rehab_opt import Command, Interaction, KeepOut, LinkCapsule, MirrorTracker, ur5
from tests.judge.numbering import judged, run_length
from tests.judge.references import KINDS, good_posture, reference, singular_posture
from tests.judge.sensor_faults import STAMPS, Schedule, schedule, spoilt
from tests.judge.ur5_numbers import LARGEST, LIMIT, frames, links, manipulability, tool

Array = NDArray[np.float64]

DTS = (1e-3, 1e-3, 5e-3, 1e-2, 2e-2)
FAULTS = ("q", "pose", "twist", "all", "not rigid", "disabled", *STAMPS)
REST = 6.0
"""[s] for which the last pose is held at the end of a run, where the run is long enough."""


class Settings(NamedTuple):
    """What the tracker was told."""

    dt: float
    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    floor: float
    max_deviation: float
    linear_speed: float
    angular_speed: float
    planes: list[tuple[Array, float]]
    """Unit normal (3,) towards where the arm may be, and normal . x of the plane's points."""
    slow_from: float
    force_limit: float
    stop_at: float
    recovery_speed: float
    narrow: bool
    spike: tuple[int, Array, float] | None
    """What a user has mounted on a link: the frame it moves with, its place (3,) there and its radius [m]."""


class Run(NamedTuple):
    """One run, one row a tick; what is of the tracker was read after its tick."""

    settings: Settings
    kind: str
    q: Array
    """(N + 1, 6) where the joints were."""
    commands: list[Command]
    poses: Array
    references: Array
    """(N, 4, 4) the pose that the clock stands at."""
    clock: Array
    """(N, 3) time scale, lag [s], w / w_max where the command leads."""
    forces: Array
    """(N,) [N] size of the force that was measured; NaN for none measured."""
    faults: Schedule
    counts: dict[str, int]
    begun: Array
    """(6,) [rad/s] what the joints did before the first tick."""

    @property
    def where(self) -> str:
        """What it is."""
        return f"{self.kind}, dt {self.settings.dt:g}"


def draw(rng: np.random.Generator, start: Array, *, planes: bool) -> Settings:
    """A robot and its tracker; a third of the time with narrow joint limits around the start."""
    lower, upper = -LIMIT, LIMIT.copy()
    narrow = bool(rng.random() < 0.33)
    if narrow:
        lower = np.maximum(lower, start - rng.uniform(0.1, 1.5, 6))
        upper = np.minimum(upper, start + rng.uniform(0.1, 1.5, 6))
    slow_from = float(rng.choice([0.0, 8.0, 8.0, 15.0]))
    force_limit = slow_from + float(rng.choice([5.0, 22.0]))
    beside = _planes(rng, start) if planes else []
    return Settings(
        dt=float(rng.choice(DTS)),
        lower=lower,
        upper=upper,
        velocity=rng.uniform(0.8, math.pi, 6),
        acceleration=rng.uniform(3.0, 30.0, 6) if rng.random() < 0.5 else np.full(6, 15.0),
        floor=float(rng.choice([0.1, 0.3, 0.3, 0.5])),
        max_deviation=float(rng.choice([0.02, 0.05, 0.05, 0.1])),
        linear_speed=float(rng.choice([0.1, 0.25, 0.25, 0.5, 1.0])),
        angular_speed=float(rng.choice([0.5, 1.5, 3.0])),
        planes=beside,
        slow_from=slow_from,
        force_limit=force_limit,
        stop_at=force_limit * float(rng.choice([1.0, 1.4, 4.0])),
        recovery_speed=float(rng.choice([0.05, 0.1, 0.3])),
        narrow=narrow,
        spike=_spike(rng, start, beside) if planes else None,
    )


def _spike(
    rng: np.random.Generator, start: Array, planes: list[tuple[Array, float]]
) -> tuple[int, Array, float] | None:
    """Half of the time something on a link that begins clear of every plane, and nearest to one of them."""
    for _ in range(int(rng.integers(2)) * 300):
        frame, radius = int(rng.integers(2, 7)), float(rng.uniform(0.01, 0.06))
        spike = frame, rng.uniform(-0.4, 0.4, 3), radius
        if 0.02 < min(spike_heights(spike, start[None], *plane)[0] for plane in planes) < 0.05:
            return spike
    return None


def spike_heights(spike: tuple[int, Array, float], q: Array, normal: Array, offset: float) -> Array:
    """(N,) [m] of it above a plane at q (N, 6)."""
    frame, place, radius = spike
    poses = frames(q)[:, frame]
    return np.asarray((poses[:, :3, :3] @ place + poses[:, :3, 3]) @ normal - offset - radius)


def _planes(rng: np.random.Generator, start: Array) -> list[tuple[Array, float]]:
    """One or two planes, some clear of the whole arm by a tenth of a metre, some with parts of it behind them."""
    found = []
    for _ in range(rng.integers(1, 3)):
        normal = rng.standard_normal(3)
        normal /= np.linalg.norm(normal)
        lowest = float((links(start[None])[0, 1:] @ normal).min())
        found.append((normal, lowest - float(rng.choice([0.11, 0.13, 0.2]))))
    return found


def _before_the_hand(rng: np.random.Generator) -> tuple[Array, tuple[Array, float]]:
    """A posture whose hand is further out than the arm, and a plane before it, across the hand but for a tilt."""
    while True:
        start = good_posture(rng, 0.35)
        normal = 0.2 * rng.standard_normal(3) - tool(start[None])[0, :3, 2]
        normal /= np.linalg.norm(normal)
        heights = links(start[None])[0] @ normal
        if heights[:-1].min() > heights[-1] + 0.05:
            return start, (normal, float(heights[-1] - rng.uniform(0.04, 0.15)))


def tracker(given: Settings) -> MirrorTracker:
    """A tracker made so."""
    capsules = ur5().capsules
    if given.spike is not None:
        frame, place, radius = given.spike
        x, y, z = place.tolist()
        capsules = (*capsules, LinkCapsule("spike", frame, (x, y, z), (x, y, z), radius))
    return MirrorTracker(
        ur5(lower=given.lower, upper=given.upper, velocity=given.velocity, acceleration=given.acceleration,
            capsules=capsules),
        floor=given.floor, max_deviation=given.max_deviation, linear_speed=given.linear_speed,
        max_manipulability=LARGEST, angular_speed=given.angular_speed,
        keep_out=[KeepOut.through(n * offset, n) for n, offset in given.planes],
        interaction=Interaction(slow_from=given.slow_from, limit=given.force_limit, stop_at=given.stop_at), dt=given.dt,
        recovery_speed=given.recovery_speed, compile=False,
    )  # fmt: skip


def follow(
    rng: np.random.Generator,
    number: int,
    *,
    faults: float = math.inf,
    planes: bool = False,
    pushed: bool = False,
    below: float = 0.2,
    least: float = 0.0,
    begun: float = 0.0,
    hand: bool = False,
    held: float = 0.0,
) -> Run:
    """One run: a fault each `faults` s; a share `below` of them begins below the floor.

    One of `least` s or more begins, and is held, where w has no gradient. All begin at a part `begun` of their joints'
    speeds at most, and then near the floor. The plane of a `hand` is before it. An arm of wide range that is `held` is
    so for that many s, after half of that at least.
    """
    under = bool(rng.random() < below)
    start = (
        singular_posture(rng) + rng.choice([0.0, 0.02]) * rng.standard_normal(6) if under else good_posture(rng, 0.35)
    )
    start = singular_posture(rng, 3) if least else start
    start, *before = _before_the_hand(rng) if hand else (start,)
    given, kind = draw(rng, start, planes=planes), KINDS[-1 - number % len(KINDS)]
    if hand:
        given = given._replace(planes=before, spike=None)
    if held:
        given = given._replace(dt=0.02, lower=-LIMIT, upper=LIMIT, narrow=False)
    if begun:
        given = given._replace(floor=float(manipulability(start[None])[0] - 10 ** rng.uniform(-2.5, -1.0)))
    if least:
        lower, upper = -LIMIT, LIMIT.copy()
        for bend in (2, 4):  # each joint that has to leave it, to one side or the other, or either
            side = int(rng.integers(3))
            lower[bend], upper[bend] = (
                start[bend] if side == 1 else lower[bend], start[bend] if side == 2 else upper[bend]
            )  # fmt: skip
        given = given._replace(dt=0.02, lower=lower, upper=upper, narrow=False)
    dt, control = given.dt, tracker(given)
    ticks = max(run_length(rng, number, dt), round(max(least, 1.5 * held) / dt))
    moving = ticks - round(held / dt) if held else max(ticks - round(REST / dt), ticks // 2)
    poses, twists = reference(rng, kind, start, moving, dt)
    if least:  # nothing of the reference leads out
        poses, twists = np.repeat(tool(start[None]), moving, axis=0), np.zeros((moving, 6))
    poses = np.concatenate([poses, np.repeat(poses[-1:], ticks - moving, axis=0)])
    twists = np.concatenate([twists, np.zeros((ticks - moving, 6))])
    wrong = schedule(rng, ticks, dt, FAULTS, every=faults)
    felt = _pushes(rng, ticks, dt, given.force_limit, given.stop_at) if pushed else np.full((ticks, 3), math.nan)
    kinds, stamped = wrong.kind.tolist(), math.isfinite(faults)
    velocity = begun * rng.uniform(-1, 1, 6) * given.velocity if begun else np.zeros(6)
    control.reset(velocity)
    q, references, clock = np.empty((ticks + 1, 6)), np.empty((ticks, 4, 4)), np.empty((ticks, 4))
    q[0], commands = start, []
    for k in range(ticks):
        here, pose, twist = q[k], poses[k], twists[k]
        if kinds[k]:
            here, pose, twist = spoilt(wrong, k, here, pose, twist)
        force = None if math.isnan(felt[k, 0]) else felt[k]
        options: dict[str, Any] = {"enable": wrong.enable[k], "stamp": wrong.stamp[k]} if stamped else {}
        command = control.step(here, pose, twist, force=force, **options)
        commands.append(command)
        references[k] = control.reference
        clock[k] = control.time_scale, control.lag, control.manipulability, control.short[0]
        q[k + 1] = q[k] + dt * command.value
    return Run(
        given, kind, q, commands, poses, references, clock, np.linalg.norm(felt, axis=1), wrong, dict(control.counts),
        velocity,
    )  # fmt: skip


def _pushes(rng: np.random.Generator, ticks: int, dt: float, limit: float, stop: float) -> Array:
    """(ticks, 3) [N] a person who pushes now and then, up to beyond the stop; NaN where nothing is measured."""
    found = np.full((ticks, 3), math.nan)
    k = 0
    while k < ticks:
        lasts = max(round(rng.uniform(0.1, 2.0) / dt), 1)
        if rng.random() < 0.6:
            way = rng.standard_normal(3)
            sizes = [*(limit * np.array([0.2, 0.6, 0.9, 1.001])), *(stop * np.array([0.8, 1.001, 1.5]))]
            found[k : k + lasts] = way / np.linalg.norm(way) * rng.choice(sizes)
        k += lasts
    return found


followed = partial(judged, follow)
