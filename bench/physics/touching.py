"""A hand that runs into a wall, a sensor that freezes, a person who pushes."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from bench.physics.following import follow
from bench.physics.setting import Array, Numbers, Setting
from rehab_opt import Interaction, MirrorTracker, PoseTracker, Status
from rehab_opt.plants.contacts import Wall
from rehab_opt.plants.mujoco_arm import MujocoArm
from rehab_opt.plants.plant import Measurement, Plant

__all__ = ["blocked", "frozen", "pushed"]

SPEED = 0.25
"""[m/s] of the hand towards the wall."""
STOPPED = (Status.BRAKING, Status.HOLDING)
TOLERANCE = 0.02
"""[rad] A following error that is certainly one."""
PUSH, BACK = 28.0, 2.0
"""[N] for two seconds, and [s] to come back in."""


def blocked(setting: Setting) -> Numbers:
    """The hand moves into a wall and on, and again with commands that end as it touches: what any controller could."""
    state = setting.rng.bit_generator.state  # the same draws for both
    found = _blocked(setting)
    setting.rng.bit_generator.state = state
    return found | {"blocked: stopped at once": _blocked(setting, stops=True)["blocked: peak"]}


def _blocked(setting: Setting, *, stops: bool = False) -> Numbers:
    """As far as its target goes; after a second the wall is taken away. With `stops` nobody has to notice the wall."""
    rng, arm, rate = setting.rng, setting.arm, setting.cell.rate
    chain, start = arm.chain, arm.start(rng, 0.15)
    first = chain.pose(start)
    way = rng.normal(size=3)
    way /= np.linalg.norm(way)
    near = 0.05
    wall = Wall(first[:3, 3] + near * way, -way)
    plant = setting.plant(contacts=(wall,))
    tracker, touched = setting.controller(PoseTracker, chain, linear_speed=SPEED), False
    ticks, gone, deepest = round(2.5 * rate), round((near / SPEED + 1.2) * rate), 0.15

    def step(k: int, seen: Measurement):  # type: ignore[no-untyped-def]
        nonlocal touched
        pose, twist = first.copy(), np.zeros(6)
        along = SPEED * k / rate
        touched = touched or bool(stops and plant.truth.force.any())
        if along < deepest:
            twist[:3] = SPEED * way
        pose[:3, 3] += min(along, deepest) * way
        command = tracker.step(seen.position, pose, twist)
        return command._replace(value=np.zeros(chain.n)) if touched else command

    def each(k: int, now: Plant) -> None:
        if k == gone and isinstance(now, MujocoArm):
            now.contacts = ()

    run = follow(plant, chain, start, ticks, step, each=each)
    force = np.linalg.norm(run.force, axis=1)
    if not force[:gone].any():
        return {"blocked: peak": 0.0, "blocked: after 0.5 s": 0.0, "release": 0.0}
    touch = int(np.flatnonzero(force)[0])
    later = force[touch + round(0.5 * rate) : gone]
    return {
        "blocked: peak": float(force[:gone].max()),
        "blocked: after 0.5 s": float(later.max(initial=0.0)),
        "release": float(run.hand_speed(slice(gone, None)).max()),
    }


def frozen(setting: Setting) -> Numbers:
    """Encoders that stand still while their stamps go on: how soon the arm is told to brake, led and as measured."""
    state = setting.rng.bit_generator.state  # the same draws for both
    found = {"frozen encoder": _late(setting)}
    setting.rng.bit_generator.state = state
    return found | {"frozen encoder, measured": _late(replace(setting, feedback="measured"))}


def _late(setting: Setting) -> float:
    """[s] by which braking comes later than the fastest joint takes to `TOLERANCE`."""
    rng, arm, rate = setting.rng, setting.arm, setting.cell.rate
    chain, start = arm.chain, arm.start(rng, 0.15)
    first, way = chain.pose(start), rng.normal(size=3)
    way *= 0.1 / np.linalg.norm(way)
    tracker = setting.controller(PoseTracker, chain)
    when, ticks = round(0.5 * rate), round(2.0 * rate)
    held: list[Array] = []

    def step(k: int, seen: Measurement):  # type: ignore[no-untyped-def]
        if k == when:
            held.append(seen.position)
        pose, twist = first.copy(), np.zeros(6)
        pose[:3, 3] += way * k / rate
        twist[:3] = way
        return tracker.step(held[0] if held else seen.position, pose, twist, stamp=seen.stamp + setting.dt)

    run = follow(setting.plant(), chain, start, ticks, step)
    fastest = float(np.abs(run.velocity[when]).max())
    braking = [k for k, status in enumerate(run.status) if k >= when and status in STOPPED]
    late = (braking[0] - when) / rate if braking else math.inf
    return late - TOLERANCE / max(fastest, 1e-3)


def pushed(setting: Setting) -> Numbers:
    """28 N with 2 N of noise for two seconds on an arm that holds still, with `Interaction`'s defaults."""
    rng, arm, rate = setting.rng, setting.arm, setting.cell.rate
    chain, law = arm.chain, Interaction()
    tracker = setting.controller(MirrorTracker, chain, interaction=law)
    start = arm.start(rng, 0.1)
    pose, still = chain.pose(start), np.zeros(6)
    way = rng.normal(size=3)
    way /= np.linalg.norm(way)
    begin, end = round(0.3 * rate), round(2.3 * rate)
    run = follow(
        setting.plant(),
        chain,
        start,
        end + round(BACK * rate),
        lambda _, seen: tracker.step(seen.position, pose, still, force=seen.force),
        each=lambda k, _: PUSH * way if begin <= k < end else None,
    )
    gone = (run.hand - pose[:3, 3]) @ way
    held = gone[begin + round(rate) : end]
    changes = sum(a is not b for a, b in zip(run.status, run.status[1:], strict=False))
    return {
        "push: gives way": float(held.min()) * law.stiffness / PUSH,
        "push: gives way, most": float(held.max()) * law.stiffness / PUSH,
        "push: stiffness": PUSH / max(float(held.mean()), 1e-6),
        "push: speed": float(run.hand_speed().max()),
        "push: back": float(np.linalg.norm(run.hand[-1] - pose[:3, 3])),
        "push: changes": float(changes),
    }
