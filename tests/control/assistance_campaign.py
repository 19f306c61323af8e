"""Hostile hands and broken sensors against Assistance, judged by plain numpy that shares nothing with the controller.

    python -m tests.control.assistance_campaign --cases 1000000

One case is one tick of one of several controllers (modes, tick lengths, budgets, with and without velocity and stamps).
The hand is never where the sensor says only because the sensor says so: energy is counted on the true motion. Prints
what was checked, the largest excess over each bound and how often each rung answered.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import shapely

from rehab_opt import Assistance, Command, PotentialField, Relaxed, Workspace
from rehab_opt.control.hand import MAX_SCATTER, SCATTER_PEAK
from rehab_opt.symbolic import Compile
from tests.control.campaign import HOSTILE, ROUNDING, Array, Tally, main

FAULTS = ("position", "velocity", "glitch", "nudge", "frozen", "repeated", "stamp", "same stamp", "disabled", "dropped",
          "burst")  # fmt: skip
COMFORTABLE = Workspace(shapely.box(-0.18, 0.365, -0.06, 0.435), accuracy=1e-3)


def path() -> Array:
    """From inside the comfortable workspace to a target outside."""
    s = np.linspace(0, 1, 200)
    return np.column_stack([-0.15 + 0.3 * s, 0.4 + 0.03 * np.sin(3 * s)])


@dataclass
class Plant:
    """What an observer of hand, clock and force knows."""

    name: str
    assistance: Assistance
    budget: float
    gives_velocity: bool
    stamped: bool
    bursts: bool
    noise: float
    """[m] by how much a position may be noise."""
    position: Array
    force: Array = field(default_factory=lambda: np.zeros(2))
    velocity: Array = field(default_factory=lambda: np.zeros(2))
    time: float = 0.0
    shown: Array | None = None
    frozen: int = 0
    last_stamp: float = 0.0
    delivered: float = 0.0
    allowed: float = 0.0
    """[J] beyond the budget: what fast motions and undetectable lies of the sensor excuse."""
    lie: float = 0.0
    habit: int = 0
    seen: bool = False
    """The last tick was given a true, fresh position."""
    too_fast: bool = False
    """The hand has moved faster than the cap since then, and the sensors say so."""


def run(cases: int, seed: int, *, compile: Compile = None) -> Tally:
    """Judge `cases` ticks."""
    rng = np.random.default_rng(seed)
    tally = Tally()
    plants = _plants(compile)
    for i in range(cases):
        plant = plants[i % len(plants)]
        if rng.random() < 0.001:
            _begin(plant, rng)
        _one_tick(plant, rng, tally)
    return tally


def _plants(compile: Compile) -> list[Plant]:
    options = {"width": 0.025, "stiffness": 1500.0, "damping": 10.0, "compile": compile}
    lead = PotentialField(path(), drag=200.0, **options)
    fields = {
        "stretch": PotentialField(path(), **options), "assist": lead, "follow": PotentialField(path(), **options),
        "resist": PotentialField(path(), drag=100.0, drag_along="travelled", **options),
        "hold": PotentialField(path()[:1], **options),
    }  # fmt: skip
    plants = []
    for i, (mode, each) in enumerate(fields.items()):
        for j, (dt, budget) in enumerate(((1e-3, 3.0), (5e-3, 12.0), (2e-2, 30.0))):
            bursts = (i + j) % 3 == 0
            learns = (i + 2 * j) % 4 == 0
            assistance = Assistance(
                each, comfortable=COMFORTABLE, mode=mode, dt=dt, energy_budget=budget, compile=compile,
                solver="proxqp" if i == j == 1 else "qrqp", position_noise=None if learns else 0.0,
            )  # fmt: skip
            name = f"{mode} dt={dt:g} budget={budget:g}"
            noise = SCATTER_PEAK * MAX_SCATTER if learns else 0.0
            plant = Plant(name, assistance, budget, (i + j) % 2 == 0, (i + 2 * j) % 3 != 0, bursts, noise, np.zeros(2))
            _begin(plant, np.random.default_rng(0))
            plants.append(plant)
    return plants


def _begin(plant: Plant, rng: np.random.Generator) -> None:
    """Somewhere else, with a full tank."""
    plant.assistance.reset()
    plant.position = rng.uniform((-0.25, 0.3), (0.25, 0.5))
    plant.force, plant.velocity, plant.shown = np.zeros(2), np.zeros(2), None
    plant.delivered = plant.allowed = plant.lie = plant.time = plant.last_stamp = 0.0
    plant.frozen = 0
    plant.seen = plant.too_fast = False


def _motion(plant: Plant, rng: np.random.Generator, seconds: float) -> Array:
    """Where the hand goes while the force acts: it has seen the force."""
    cap = plant.assistance.speed_cap
    size = np.linalg.norm(plant.force)
    if rng.random() < 0.01:
        plant.habit = int(rng.integers(6))
    heading = rng.standard_normal(2)
    speed = cap * rng.choice([1.0, 0.3, 0.01])
    if plant.habit == 0 and size > 0:
        heading, speed = plant.force, cap  # draws what it can
    elif plant.habit == 1 and size > 0:
        heading = -plant.force
    elif plant.habit == 2:
        heading = np.array([0.0, 0.4]) - plant.position + 0.1 * rng.standard_normal(2)
    elif plant.habit == 3 and size > 0:
        heading, speed = plant.force * rng.choice([-1, 1]), cap
    elif plant.habit == 4:
        speed = 0.0
    direction = heading / max(float(np.linalg.norm(heading)), 1e-300)
    return 0.9999999 * speed * seconds * direction


def _one_tick(plant: Plant, rng: np.random.Generator, tally: Tally) -> None:
    assistance = plant.assistance
    cap, dt = assistance.speed_cap, assistance.dt
    fault = str(rng.choice(FAULTS)) if rng.random() < 0.1 else "none"
    # What happened since the last command.
    seconds = dt * (rng.uniform(0.5, 1.5) if plant.stamped else 1.0)
    moved = _motion(plant, rng, seconds)
    if fault == "dropped" and plant.stamped:
        extra = dt * int(rng.integers(1, 3))
        if seconds + extra <= 0.05:
            moved, seconds = moved * (1 + extra / seconds), seconds + extra
    if fault == "burst" and plant.bursts:
        moved = moved + rng.standard_normal(2) * rng.choice([1e-3, 0.01, 0.05])
        too_far = float(np.linalg.norm(moved)) - cap * seconds
        # math.md 5: beyond the cap, the force limit times the jump; a position in between may have been unseen.
        plant.allowed += assistance.force_limit * (float(np.linalg.norm(moved)) if too_far > 0 else 0.0)
    plant.too_fast = plant.seen and float(np.linalg.norm(moved)) > 1.001 * cap * max(seconds, dt) + plant.noise
    plant.position = plant.position + moved
    plant.delivered += float(plant.force @ moved)
    plant.velocity = moved / seconds
    plant.time += seconds
    x, v, stamp, enable = _told(plant, fault, rng)
    lie = math.hypot(*(x - plant.position)) if fault in ("nudge", "glitch") else 0.0
    # A position that lies by no more than a hand can move is believed, and counted with the force of the wrong tick.
    if fault in ("nudge", "glitch"):
        plant.allowed += 4 * assistance.slew_limit * dt * min(lie, cap * dt)
    tally.faults[fault] += 1
    command = assistance.step(
        x, v if plant.gives_velocity else None, enable=enable, stamp=stamp if plant.stamped else None
    )
    plant.last_stamp = stamp
    # An exact rest may be a frozen sensor: what comes after it counts as the motion of all that time.
    clean = fault in ("none", "burst", "dropped") or not plant.stamped
    plant.seen = clean and bool(moved.any() and np.all(x == plant.position))
    plant.too_fast &= plant.seen
    _judge(plant, command, x, fault, tally)
    plant.seen &= command.status.certified
    plant.force = command.value.copy()


def _told(plant: Plant, fault: str, rng: np.random.Generator) -> tuple[Array, Array, float, bool]:
    """Position, velocity, stamp and switch, as sensors give them."""
    cap, dt = plant.assistance.speed_cap, plant.assistance.dt
    x, v, stamp, enable = plant.position.copy(), plant.velocity.copy(), plant.time, True
    if fault == "position":
        x[rng.integers(2)] = rng.choice(HOSTILE)
    elif fault == "velocity":
        v[rng.integers(2)] = rng.choice(HOSTILE)
    elif fault == "glitch":
        x = x + rng.choice([0.2, 1.0, 100.0]) * rng.standard_normal(2)
    elif fault == "nudge":
        x = x + rng.uniform(0, 1) * cap * dt * rng.standard_normal(2)
    elif fault == "frozen" and not plant.frozen:
        plant.frozen = int(rng.integers(2, 100))
    elif fault == "stamp":
        stamp = float(rng.choice(HOSTILE))
    elif fault == "same stamp":
        stamp = plant.last_stamp
    elif fault == "disabled":
        enable = False
    shown = plant.shown
    if shown is not None and (plant.frozen or fault == "repeated"):
        x = shown
    plant.frozen = max(0, plant.frozen - 1)
    if np.all(np.isfinite(x)):
        plant.shown = x
    return x, v, stamp, enable


def _judge(plant: Plant, command: Command, x: Array, fault: str, tally: Tally) -> None:
    assistance = plant.assistance
    force, last, limit = command.value, plant.force, assistance.force_limit
    slew = assistance.slew_limit * assistance.dt
    tally.count(command)

    def check(holds: bool, claim: str) -> None:
        if not holds:
            tally.broken.append(f"{claim}: {plant.name}, fault {fault}, {command}, last {last}, hand {plant.position}")

    check(force.shape == (2,) and bool(np.all(np.isfinite(force))), "finite")
    check(not force.flags.writeable, "frozen")
    size = math.hypot(*force)
    check(tally.worst("force", size - limit) <= 0.0, "the force bound never yields")
    change = float(np.linalg.norm(force - last))
    if command.relaxed & Relaxed.SLEW:
        tally.seen[command.reason.split(" ")[0]] += 1
        check(size == 0.0, "only a release breaks the slew bound")
        check(not command.status.certified and command.reason != "", "a release says why")
    else:
        check(tally.worst("slew", change - slew) <= ROUNDING, "slew")
    judged = plant.too_fast and "stale" not in command.reason
    check(not judged or (size == 0.0 and not command.status.certified), "a hand beyond the cap is let go")
    over = plant.delivered - plant.budget - plant.allowed
    check(tally.worst("energy", over) <= ROUNDING, "energy")
    tally.worst("share of a budget", (plant.delivered - plant.allowed) / plant.budget)
    if command.status.certified:
        check(0.0 <= command.residual <= assistance.tolerance and 0.0 <= command.scale <= 1.0, "certified")
        check(bool(np.all(np.isfinite(x))), "no answer to what is no position")
    else:
        check(command.reason != "", "reason given")
        check(math.hypot(*force) <= math.hypot(*last), "a release never grows")
    if fault in ("position", "disabled") or (fault == "same stamp" and plant.stamped and plant.last_stamp > 0):
        check(not command.status.certified or x is plant.shown, "a fault releases")
    therapy = assistance.mode in ("stretch", "assist", "resist")
    if therapy and np.all(np.isfinite(x)) and assistance.comfortable.contains(x):
        check(size <= math.hypot(*last) + 1e-12, "inside, the force never grows")


if __name__ == "__main__":
    main(run, __doc__)
