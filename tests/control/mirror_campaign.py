"""Random hand paths through singular regions against MirrorTracker, judged by plain numpy.

    python -m tests.control.mirror_campaign --paths 200

Each path passes through a singular posture of the UR5 (elbow, wrist, shoulder, or two at once) and comes back another
way, at hand speeds up to 1 m/s, four times what the hand may do. It is followed at 1, 5 and 20 ms, once undisturbed and
once with faults. Manipulability is judged by its closed form, which shares nothing with the controller.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from rehab_opt import Command, MirrorTracker, Relaxed, SerialChain, ur5
from rehab_opt.symbolic import Compile
from tests.control.campaign import Array, Tally, main

FLOOR, DEVIATION, SPEED = 0.3, 0.05, 0.25
TICKS = (1e-3, 5e-3, 2e-2)
LARGEST = 0.11987995741622055
"""Of the closed form, by Nelder-Mead over its two angles."""
FAULTS = ("nan pose", "nan q", "repeated", "disabled", "jump", "twist", "flip", "force", "mirrored")


def closed_form(q: Array) -> float:
    """W of the UR5 over its maximum: |a2 a3 s3 s5 (a2 c2 + a3 c23 + d5 s234)|."""
    a2, a3, d5 = -0.425, -0.39225, 0.09465
    reach = a2 * math.cos(q[1]) + a3 * math.cos(q[1] + q[2]) + d5 * math.sin(q[1] + q[2] + q[3])
    return abs(a2 * a3 * math.sin(q[2]) * math.sin(q[4]) * reach) / LARGEST


def singular_postures(rng: np.random.Generator) -> Array:
    """A UR5 posture with w = 0: elbow, wrist or shoulder singular, sometimes two of them."""
    q = rng.uniform(-1, 1, 6) * [2.0, 1.0, 2.4, 2.0, 2.6, 2.0] + [0, -1.3, 0, -1.5, 0, 0]
    kind = rng.integers(4)
    if kind in (0, 3):
        q[2] = 0.0
    if kind in (1, 3):
        q[4] = 0.0
    if kind == 2:  # the wrist centre above the first axis
        best = min(np.linspace(-2.8, -0.2, 400), key=lambda x: closed_form(np.array([0, x, q[2], q[3], 1.57, 0])))
        q[1] = best
    return q


def start_above(rng: np.random.Generator, fraction: float) -> Array:
    """A posture with w at least `fraction` of the maximum."""
    while True:
        q = rng.uniform(-1, 1, 6) * [2.0, 1.0, 2.4, 2.0, 2.6, 2.0] + [0, -1.3, 0, -1.5, 0, 0]
        if closed_form(q) >= fraction:
            return q


def random_path(
    chain: SerialChain, rng: np.random.Generator, dt: float, *, below: bool = False
) -> tuple[Array, Array, Array]:
    """Start (6,), poses (N, 4, 4) and twists (N, 6) of a motion from a good posture through a singular one and back."""
    start = singular_postures(rng) + 0.02 * rng.standard_normal(6) if below else start_above(rng, 0.35)
    middle = singular_postures(rng)
    middle = start + (middle - start) * min(1.0, 1.2 / float(np.abs(middle - start).max()) * rng.uniform(0.5, 2.0))
    end = start + 0.5 * rng.standard_normal(6)
    seconds = rng.uniform(1.0, 4.0)
    knots = [start, middle, end, start]
    q = []
    for a, b in itertools.pairwise(knots):
        u = np.linspace(0, 1, max(round(seconds / 3 / dt), 3), endpoint=False)[:, None]
        q.append(a + (b - a) * u**3 * (10 - 15 * u + 6 * u**2))
    joints = np.concatenate(q)
    speeds = np.gradient(joints, dt, axis=0)
    poses = np.array([chain.pose(each) for each in joints])
    twists = np.array([chain.jacobian(each) @ speed for each, speed in zip(joints, speeds, strict=True)])
    return start, poses, twists


def follow(
    tracker: MirrorTracker,
    path: tuple[Array, Array, Array],
    tally: Tally,
    *,
    rng: np.random.Generator | None = None,
    label: str = "",
    rest: float = 1.0,
) -> tuple[Array, Array]:
    """Follow one path, with faults where `rng` is given; joint positions and references of each tick."""
    chain, dt = tracker.chain, tracker.dt
    q, poses, twists = path
    tracker.reset()
    last, stamp, joints, references = np.zeros(chain.n), 0.0, [], []
    fault, left = "", 0
    for k in range(len(poses) + round(rest / dt)):
        pose = poses[min(k, len(poses) - 1)].copy()
        twist = twists[k].copy() if k < len(poses) else np.zeros(6)
        given, enable, force = q.copy(), True, None
        before, stamp = stamp, stamp + dt
        shown = stamp
        if rng is not None:
            if left == 0 and rng.random() < 0.2 * dt / 0.02:
                fault, left = str(rng.choice(FAULTS)), int(rng.integers(1, max(round(0.3 / dt), 2)))
                tally.faults[fault] += 1
            if left:
                left -= 1
                stamps = before, stamp
                force, enable, shown = _spoilt(fault, rng, pose, twist, given, stamps)
        command = tracker.step(given, pose, twist, force=force, enable=enable, stamp=shown)
        judge(tracker, q, last, command, given, tally, f"{label} tick {k} fault {fault if left else ''}")
        last = command.value.copy()
        q = q + last * dt
        joints.append(q)
        references.append(tracker.reference)
    tally.seen.update(tracker.counts)
    tracker.counts.clear()
    return np.array(joints), np.array(references)


def _spoilt(
    fault: str, rng: np.random.Generator, pose: Array, twist: Array, given: Array, stamps: tuple[float, float]
) -> tuple[Array | None, bool, float]:
    """Force, enable and stamp of a tick with a fault; poses, twist and positions are spoilt in place."""
    if fault == "nan pose":
        pose[rng.integers(3), rng.integers(4)] = math.nan
    elif fault == "nan q":
        given[rng.integers(6)] = rng.choice([math.nan, math.inf, 1e300])
    elif fault == "jump":
        pose[:3, 3] += [0.4, -0.3, 0.2]
    elif fault == "twist":
        twist[rng.integers(6)] = rng.choice([math.nan, 1e5, -1e4, math.inf])
    elif fault == "flip":
        pose[:3, :3] = pose[:3, :3] @ np.diag([1.0, -1.0, -1.0])
    elif fault == "mirrored":
        pose[:3, :3] = -pose[:3, :3]
    force = rng.standard_normal(3) * rng.choice([1.0, 10.0, 40.0]) if fault == "force" else None
    return force, fault != "disabled", stamps[0 if fault == "repeated" else 1]


def judge(
    tracker: MirrorTracker, q: Array, last: Array, command: Command, given: Array, tally: Tally, where: str
) -> None:
    """Every bound, written down once more without the controller's arithmetic."""
    chain, dt, v = tracker.chain, tracker.dt, command.value
    tally.count(command)

    def check(holds: bool, claim: str) -> None:
        if not holds:
            tally.broken.append(f"{claim}: {where}, w {now:.5f} -> {then:.5f}, {command}")

    ahead = q + v * dt
    now, then = closed_form(q), closed_form(ahead)
    check(bool(np.all(np.isfinite(v))), "finite")
    check(bool(np.all(np.abs(v) <= chain.velocity)), "velocity")
    check(bool(np.all((ahead <= chain.upper + 1e-9) & (ahead >= chain.lower - 1e-9))), "position")
    seen = bool(np.all(np.abs(given) <= 1e6))
    # Without a position the arm is where the last command led, which this plant does exactly.
    tally.worst("below the floor", min(FLOOR, now) - then)
    check(then >= min(FLOOR, now) - 1e-9, "floor")
    over = float(np.max(np.abs(v - last) - chain.acceleration * dt))
    if not command.relaxed & Relaxed.ACCELERATION:
        tally.worst("acceleration over", over)
        check(over <= 1e-9, "acceleration")
    elif over > 0:
        tally.worst("acceleration yielded [rad/s^2]", over / dt)
    hand, there = chain.pose(q)[:3, 3], chain.pose(ahead)[:3, 3]
    tally.worst("hand speed [m/s]", math.dist(hand, there) / dt)
    check(math.dist(hand, there) <= SPEED * dt * (1 + 1e-6), "hand speed")
    away = math.dist(there, tracker.reference[:3, 3]) - tracker.short[0]
    if not math.isnan(away):
        tally.worst("deviation from what can be done [m]", away)
        check(away <= DEVIATION + 1e-9, "deviation")
    check(seen or not command.status.certified, "a position that is no number is not acted on")
    check(command.status.certified or command.reason != "", "reason")


def run(paths: int, seed: int, *, ticks: tuple[float, ...] = TICKS, compile: Compile = None) -> Tally:
    """Follow `paths` random paths, every fourth started near a singular posture, at each tick length."""
    tally, chain = Tally(), ur5()
    for dt in ticks:
        tracker = MirrorTracker(
            chain,
            floor=FLOOR,
            max_deviation=DEVIATION,
            linear_speed=SPEED,
            dt=dt,
            max_manipulability=LARGEST,
            compile=compile,
        )
        for number in range(paths):
            rng = np.random.default_rng((seed, number))
            path = random_path(chain, rng, dt, below=number % 4 == 3)
            label = f"dt {dt:g} path {number}"
            follow(tracker, path, tally, label=label)
            follow(tracker, path, tally, rng=rng, label=label + " with faults")
    return tally


if __name__ == "__main__":
    main(run, __doc__, unit="paths", many=200)
