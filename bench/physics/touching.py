"""A hand that runs into a wall, a sensor that freezes, a person who pushes."""

from __future__ import annotations

import math

import numpy as np

from bench.physics.following import follow
from bench.physics.setting import Array, Numbers, Setting
from rehab_opt import Interaction, MirrorTracker, PoseTracker, Status
from rehab_opt.control.reasons import NUMBER, REASONS
from rehab_opt.plants.contacts import Wall
from rehab_opt.plants.drives import DriveState, VelocityServo
from rehab_opt.plants.mujoco_arm import MujocoArm
from rehab_opt.plants.plant import Measurement, Plant

__all__ = ["blocked", "frozen", "pushed"]

NOT_FOLLOWED = str(REASONS[NUMBER["NOT_FOLLOWED"]].python)
SPEED = 0.25
"""[m/s] of the hand towards the wall."""
STOPPED = (Status.BRAKING, Status.HOLDING)
TOLERANCE = 0.02
"""[rad] A following error that is certainly one."""
STIFF = 200.0
"""[1/s] Rate of what a jammed joint stands in, with the joint's own inertia."""
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


class Jammed(VelocityServo):
    """Servos of which one joint is jammed at some time: a brake that closes by itself, whatever the motor does."""

    joint: int = -1
    """Negative for none."""

    def start(self, position: Array, inertia: Array, limit: Array, step: float) -> Array:
        """As of sound ones."""
        self._heavy, self._at = inertia * STIFF**2, None
        return super().start(position, inertia, limit, step)

    def torque(self, command: Array, state: DriveState, feedforward: Array) -> Array:
        """With that of the brake."""
        given = super().torque(command, state, feedforward)
        if self.joint >= 0:
            i = self.joint
            self._at = float(state.position[i]) if self._at is None else self._at
            given[i] = self._heavy[i] * (self._at - state.position[i] - 2 / STIFF * state.velocity[i]) + feedforward[i]
        return given


def frozen(setting: Setting) -> Numbers:
    """Encoders that stand still while their stamps go on, or a jammed joint: how soon the arm is told to brake."""
    state = setting.rng.bit_generator.state  # the same draws for all
    found = {}
    for what, jams in (("frozen encoder", False), ("blocked joint", True)):
        setting.rng.bit_generator.state = state
        found[what] = -math.inf if jams and setting.ideal else _late(setting, jams=jams)
    return found


def _late(setting: Setting, *, jams: bool) -> float:
    """[s] by which braking comes later than the fastest joint takes to `TOLERANCE`."""
    rng, arm, rate = setting.rng, setting.arm, setting.cell.rate
    chain, start = arm.chain, arm.start(rng, 0.15)
    first, way = chain.pose(start), rng.normal(size=3)
    way *= 0.1 / np.linalg.norm(way)
    tracker = setting.controller(PoseTracker, chain)
    when, ticks = round(0.5 * rate), round(2.0 * rate)
    held: list[Array] = []
    drive = Jammed()

    def step(k: int, seen: Measurement):  # type: ignore[no-untyped-def]
        if k == when and not jams:
            held.append(seen.position)
        pose, twist = first.copy(), np.zeros(6)
        pose[:3, 3] += way * k / rate
        twist[:3] = way
        return tracker.step(held[0] if held else seen.position, pose, twist, stamp=seen.stamp + setting.dt)

    def each(k: int, now: Plant) -> None:
        if k == when and jams:
            drive.joint = int(np.abs(now.truth.velocity).argmax())

    run = follow(setting.plant(drive=drive), chain, start, ticks, step, each=each)
    fastest = float(np.abs(run.velocity[when]).max())
    braking = [
        k for k, (status, reason) in enumerate(zip(run.status, run.reason, strict=True))
        if k >= when and status in STOPPED and NOT_FOLLOWED in reason
    ]  # fmt: skip
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
