"""Runs of the chair: which robot, from where, what is asked when; every tick recorded, nothing judged."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from rehab_opt import Command, MovingCapsule, RedundancyResolver
from rehab_opt.kinematics.ardis import ARDIS_READY
from tests.judge.chair_robot import LACKING, WHEEL_LIMIT, Array, Chair, Obstacles

READY = np.array(ARDIS_READY)
SETS = (("x", "y", "z"), ("x", "y"), ("z", "roll7"))
OTHER_SETS = (("x", "y", "z", "rz"), ("x", "z"), ("rx", "y"), ("x", "y", "z", "roll7"))


class Part(NamedTuple):
    """A stretch of a run with one set of rows and one set of obstacles."""

    rows: tuple[str, ...]
    frame: str
    twist: Array
    """(n, k) asked in each tick."""
    enable: object = True
    """The dead-man input; anything but True releases it."""
    obstacles: Obstacles | Callable[[Array], Obstacles] | None = None
    """Set at its begin, or made then from where the chair is; None leaves them."""
    target: Array | None = None
    """(3,) where `reach` leads the hand, in place of `step` and the twist."""
    hostile: Array | None = None
    """(n, 7) what is added to the q that the controller is told: no numbers, or ones too large."""
    fault: bool = False
    """Whether every tick is told what is no usable number."""


@dataclass
class Run:
    """What was asked, what was answered, and where the robot was: numbers of n ticks."""

    chair: Chair
    dt: float
    start: Array
    """(7,) u before the first tick."""
    parts: list[Part]
    arcs: bool
    """Whether the chair's velocity turned with the chair within a tick, as that of rolling wheels does."""
    moving: list[list[MovingCapsule]] | None = None
    """What moves, in each tick."""
    q: Array = field(init=False)
    """(n + 1, 7)"""
    ends: Array = field(init=False)
    """(n, 7) where each tick ended by its command: the next q."""
    commands: list[Command] = field(default_factory=list)

    @property
    def slices(self) -> list[slice]:
        """Ticks of each part."""
        ends = np.cumsum([len(part.twist) for part in self.parts])
        return [slice(int(end) - len(part.twist), int(end)) for part, end in zip(self.parts, ends, strict=True)]


def record(controller: RedundancyResolver, run: Run, q: Array) -> Run:
    """Drive the chair from q (7,) through all parts."""
    dt, commands, arcs = run.dt, run.commands, run.arcs
    run.q = np.empty((sum(len(part.twist) for part in run.parts) + 1, len(q)))
    run.ends = run.q[1:]
    run.q[0] = q
    k, step = 0, controller.step
    controller.reset(run.chair.world(q, run.start), heading=float(q[2]))
    for number, each in enumerate(run.parts):
        part = each._replace(obstacles=each.obstacles(q)) if callable(each.obstacles) else each
        run.parts[number] = part
        if part.obstacles is not None:
            controller.obstacles = tuple(part.obstacles)
        for i, twist in enumerate(part.twist):
            wrong = 0.0 if part.hostile is None else part.hostile[i]
            told = q + wrong
            around = None if run.moving is None else run.moving[k]
            if part.target is None:
                command = step(told, twist, part.rows, part.frame, moving=around, enable=part.enable)
            else:
                command = controller.reach(told, part.target, moving=around, enable=part.enable)
            commands.append(command)
            q = q + (rolled(command.value, dt) if arcs else dt * command.value)
            run.q[k + 1] = q
            k += 1
    return run


def rolled(value: Array, dt: float) -> Array:
    """(7,) way within a tick of a chair that turns as it goes: along a circle, whose chord is turned by half."""
    way = dt * value
    half = way[2] / 2
    shrink = math.sin(half) / half if abs(half) > 1e-9 else 1.0
    c, s = shrink * math.cos(half), shrink * math.sin(half)
    way[0], way[1] = c * way[0] - s * way[1], s * way[0] + c * way[1]
    return way


@lru_cache(maxsize=64)
def resolver(drive: str, sets: tuple[tuple[str, ...], ...], dt: float, max_obstacles: int) -> tuple[Chair, Any]:
    """The default robot and its resolver; kept, since building one takes seconds."""
    chair = Chair(drive)
    return chair, RedundancyResolver(chair.robot(), drive=drive, row_sets=sets, dt=dt, max_obstacles=max_obstacles)  # type: ignore[arg-type]


def other_resolver(rng: np.random.Generator, dt: float, max_obstacles: int, sets: Any) -> tuple[Chair, Any]:
    """A random robot and its resolver, not compiled: that would take a minute for each."""
    slow, hurry = rng.choice([0.5, 1.0, 1.6], 2)
    middle = np.deg2rad([-60.0, 0.0, 5.0, 0.0])
    wide = rng.uniform(0.5, 1.0, (2, 4)) * np.deg2rad([100.0, 100.0, 80.0, 170.0])
    chair = Chair(
        str(rng.choice(["mecanum", "differential", "omnidirectional", "fixed"])),
        a3=rng.uniform(0.0, 0.2),
        d4=rng.uniform(0.33, 0.45),
        d5=rng.uniform(0.35, 0.5),
        d7=rng.uniform(0.35, 0.55),
        lower=middle - wide[0],
        upper=middle + wide[1],
        velocity=slow * np.array([0.8, 0.8, 1.0, 1.0, 1.0, 1.2, 1.5]),
        acceleration=hurry * np.array([1.0, 1.0, 1.5, 4.0, 4.0, 4.0, 6.0]),
        chair_mass=rng.uniform(60, 200),
        payload=float(rng.choice([0.0, 2.0])),
    )
    made = RedundancyResolver(
        chair.robot(), drive=chair.drive, row_sets=sets, dt=dt, max_obstacles=max_obstacles, compile=False,  # type: ignore[arg-type]
        self_motion=float(rng.choice([0.0, 1.0, 3.0])),
    )  # fmt: skip
    return chair, made


def posture(chair: Chair, rng: np.random.Generator, *, ready: float = 0.3) -> Array:
    """(7,) a place in the world and an arm inside its limits, off keep-outs; at times the ready one."""
    q = np.zeros(7)
    for _ in range(1000):
        q[:3] = *rng.uniform(-0.3, 0.3, 2), rng.uniform(-3, 3)
        q[3:] = READY[3:] if rng.random() < ready else rng.uniform(chair.lower, chair.upper)
        if rng.random() < 0.4:  # often one joint is near a limit
            joint, near = rng.integers(4), 10 ** rng.uniform(-3.0, -0.5)
            q[3 + joint] = rng.choice([chair.lower[joint] + near, chair.upper[joint] - near])
        inside = np.all(q[3:] > chair.lower) and np.all(q[3:] < chair.upper)
        if inside and np.min(chair.arm_gaps(q)) > 0:
            return q
    raise ValueError("no free posture found")


def motion(chair: Chair, q: Array, rng: np.random.Generator, dt: float, obstacles: Obstacles = ()) -> Array:
    """(7,) a random u from which the whole robot can brake together; rest if none is found."""
    for _ in range(20):
        u = rng.uniform(-1, 1, len(q)) * chair.velocity * rng.choice([0.1, 0.3, 0.7, 1.0])
        u[LACKING[chair.drive]] = 0.0
        u[:2] /= max(1.0, math.hypot(u[0], u[1]) / chair.velocity[0] / 0.999)
        u[:3] /= max(1.0, float(np.max(np.abs(chair.wheels(u)), initial=0.0)) / WHEEL_LIMIT[chair.drive] / 0.999)
        if chair.brakes_in_time(q, u, obstacles, dt):
            return u
    return np.zeros(len(q))


def command(rng: np.random.Generator, rows: Sequence[str], low: float = 0.05, high: float = 0.2) -> Array:
    """(k,) a random direction of these rows, at a speed between the two [m/s, rad/s]."""
    direction = rng.standard_normal(len(rows))
    return np.asarray(rng.uniform(low, high) * direction / np.linalg.norm(direction))


def held(twist: Array, seconds: float, dt: float) -> Array:
    """(n, k) the same twist in every tick."""
    return np.tile(twist, (max(1, round(seconds / dt)), 1))
