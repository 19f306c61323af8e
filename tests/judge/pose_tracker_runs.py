"""Runs of `PoseTracker` on a UR5 whose joints go where they are told, sometimes put elsewhere; settings are drawn."""

from __future__ import annotations

import math
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rehab_opt import Command, PoseTracker, ur5
from tests.judge.numbering import judged, run_length
from tests.judge.references import KINDS, good_posture, reference
from tests.judge.sensor_faults import STAMPS, Schedule, schedule, spoilt
from tests.judge.ur5_numbers import LIMIT

Array = NDArray[np.float64]

DTS = (1e-3, 1e-3, 2e-3, 5e-3, 1e-2, 2e-2)
FAULTS = ("q", "pose", "twist", "all", "not rigid", "disabled", *STAMPS)


BEYOND = 0.29
"""[rad] beyond its limits a joint is put at most."""


class Settings(NamedTuple):
    """What the tracker was told."""

    dt: float
    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    gain: float
    linear_speed: float
    angular_speed: float
    weights: Array
    posture: Array | None
    recovery_speed: float
    max_age: float | None
    jerk: Array | None = None


class Run(NamedTuple):
    """One run, one row a tick; `q` (N + 1, 6) is where the joints truly were, `before` (N, 6) the speed before."""

    settings: Settings
    kind: str
    q: Array
    commands: list[Command]
    poses: Array
    twists: Array
    faults: Schedule
    pushed: NDArray[np.bool_]
    """(N,) whether the joints were put elsewhere after this tick, which `reset` is told with their speeds."""

    @property
    def where(self) -> str:
        """What it is."""
        return f"{self.kind}, dt {self.settings.dt:g}"


def draw(rng: np.random.Generator, start: Array) -> Settings:
    """A robot and its tracker; half of the time with narrow joint limits around the start."""
    lower, upper = -LIMIT, LIMIT.copy()
    if rng.random() < 0.5:
        lower = np.maximum(lower, start - rng.uniform(0.05, 1.5, 6))
        upper = np.minimum(upper, start + rng.uniform(0.05, 1.5, 6))
    if rng.random() < 0.15:
        lower[5] = upper[5] = start[5]
    acceleration = rng.uniform(1.0, 30.0, 6) if rng.random() < 0.85 else np.full(6, math.inf)
    weights = np.ones(6)
    if rng.random() < 0.25:
        weights = rng.choice([0.0, 0.01, 1.0], 6) + np.eye(6)[rng.integers(6)]
    return Settings(
        dt=float(rng.choice(DTS)),
        lower=lower,
        upper=upper,
        velocity=rng.uniform(0.3, math.pi, 6),
        acceleration=acceleration,
        gain=float(rng.choice([5.0, 20.0, 50.0, 100.0])),
        linear_speed=float(rng.choice([0.1, 0.25, 1.0])),
        angular_speed=float(rng.choice([0.5, math.pi])),
        weights=weights,
        posture=start + 0.3 * rng.standard_normal(6) if rng.random() < 0.2 else None,
        recovery_speed=float(rng.choice([0.05, 0.1, 0.3])),
        max_age=(None, 0.3, 0.025, None)[int(rng.integers(4))],
    )


def with_jerk(rng: np.random.Generator, given: Settings) -> Settings:
    """The same with drives that bound jerk: 1 to 200 ticks to the acceleration; the gain that the docstring allows."""
    acceleration = np.minimum(given.acceleration, 30.0)
    jerk = acceleration / (given.dt * 10 ** rng.uniform(0.0, 2.0) * rng.uniform(1.0, 2.0, 6))
    gain = min(given.gain, 0.25 * float(np.min(jerk / acceleration)))
    return given._replace(acceleration=acceleration, jerk=jerk, gain=gain)


def tracker(given: Settings) -> PoseTracker:
    """A tracker made so."""
    return PoseTracker(
        ur5(lower=given.lower, upper=given.upper, velocity=given.velocity, acceleration=given.acceleration),
        gain=given.gain, linear_speed=given.linear_speed, angular_speed=given.angular_speed, posture=given.posture,
        task_weights=given.weights, jerk=given.jerk, dt=given.dt, recovery_speed=given.recovery_speed,
        max_age=given.max_age, compile=False,
    )  # fmt: skip


def follow(
    rng: np.random.Generator, number: int, *, faults: float = math.inf, pushes: float = math.inf, jerk: bool = False
) -> Run:
    """One run: a fault each `faults` s, joints put elsewhere each `pushes` s."""
    start = good_posture(rng, 0.1)
    given, kind = draw(rng, start), KINDS[number % len(KINDS)]
    given = with_jerk(rng, given) if jerk else given
    dt, control = given.dt, tracker(given)
    ticks = run_length(rng, number, dt)
    poses, twists = reference(rng, kind, start, ticks, dt)
    gap = 2.0 if given.max_age is None else max(1.2 * given.max_age, given.max_age + 2 * dt)
    wrong = schedule(rng, ticks, dt, FAULTS, every=faults, gap=gap)
    pushed = (rng.random(ticks) < dt / pushes) & np.append(wrong.kind[1:] == "", False)
    kinds, free = wrong.kind.tolist(), not math.isfinite(faults)
    q = np.empty((ticks + 1, 6))
    q[0], commands = start, []
    for k in range(ticks):
        here, pose, twist = q[k], poses[k], twists[k]
        if kinds[k]:
            here, pose, twist = spoilt(wrong, k, here, pose, twist)
        if free:
            command = control.step(here, pose, twist)
        else:
            command = control.step(here, pose, twist, enable=wrong.enable[k], stamp=wrong.stamp[k])
        commands.append(command)
        q[k + 1] = q[k] + dt * command.value
        if pushed[k]:
            q[k + 1] += rng.choice([1e-3, 0.03, 0.3]) * rng.standard_normal(6)
            if rng.random() < 0.5:  # the fastest joint to where it has no room left to stop in
                i = int(np.argmax(np.abs(command.value)))
                left = 0.5 * dt * command.value[i]
                q[k + 1, i] = (given.upper[i] if left > 0 else given.lower[i]) - left
            # Farther off, a joint could as well be another turn's.
            q[k + 1] = np.clip(q[k + 1], given.lower - BEYOND, given.upper + BEYOND)
            control.reset(command.value)
    return Run(given, kind, q, commands, poses, twists, wrong, pushed)


followed = partial(judged, follow)


def speeds(run: Run) -> tuple[Array, Array]:
    """(N, 6) joint speeds that were sent, and those before each."""
    value = np.array([command.value for command in run.commands])
    return value, np.vstack([np.zeros(6), value[:-1]])
