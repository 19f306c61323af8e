"""How `PoseTracker` brakes and rests: `python -m bench.braking [--parts ...]`, default arguments, what is judged is
computed here.

- law: random limits, ticks of 1 to 20 ms, targets that jump, move, or lie beyond reach or limits
- held: a UR5 of 1 to 1.7 rad/s^2, a target held out of reach for 25 s: how fast its joints are in the last 4 s
- limits: planes and a ball as limits of a user's own, targets beyond them
- way: point to point in reach, over the shortest time that speeds and accelerations allow joint by joint; and how far
  the hand goes beside the straight line, over its length
- servos: a target beyond a joint limit on UR5 and iiwa 14 in MuJoCo, velocity servos of 24 Hz late by 0 to 8 ms and
  position servos late by 0.1 s, encoders with 0.15 mrad of noise
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from bench.physics.geometry import frames, jacobians
from rehab_opt import Limit, PoseTracker, SerialChain, ur5

__all__ = ["PARTS", "main"]

Array = NDArray[np.float64]
Rows = Iterator[tuple[str, dict[str, float]]]
"""What was run, and what was measured."""
READY = np.array([0.0, -1.2, 1.5, -1.8, -1.57, 0.0])
BASE = ur5()
STILL = np.zeros(6)


class Hop(NamedTuple):
    """A target and how it moves."""

    pose: Array
    twist: Array
    ticks: int


def place(chain: SerialChain, q: Array) -> Array:
    """(4, 4) pose of the tool."""
    return np.asarray(frames(chain, q[None])[0, -1])


def least(h: ca.Function, q: Array) -> float:
    """Of the distances at a posture."""
    return float(np.array(h(q)).min())


class Seen:
    """What is counted of a run, tick by tick."""

    def __init__(self, chain: SerialChain, dt: float, linear: float, limits: ca.Function | None = None) -> None:
        self.chain, self.dt, self.linear, self.limits = chain, dt, linear, limits
        self.worst = {"acceleration": 0.0, "beyond a joint limit [rad]": 0.0, "hand speed": 0.0}
        if limits is not None:
            self.worst["below a limit"] = 0.0
        self.shakes = self.ticks = 0
        self.distance, self.q, self.v, self._change = 0.0, np.zeros(6), np.zeros(6), np.zeros(6)

    def tick(self, u: Array, target: Array) -> None:
        """Take a command at `q`."""
        chain, dt, worst, then = self.chain, self.dt, self.worst, self.q + self.dt * u
        change = u - self.v
        worst["acceleration"] = max(worst["acceleration"], np.abs(change / (chain.acceleration * dt)).max())
        low, high = np.minimum(chain.lower, self.q), np.maximum(chain.upper, self.q)
        beyond = "beyond a joint limit [rad]"
        worst[beyond] = max(worst[beyond], float(np.maximum(then - high, low - then).max()))
        if self.ticks % 3 == 0:
            hand = jacobians(chain, np.array([self.q, then]))[:, :3] @ u
            worst["hand speed"] = max(worst["hand speed"], float(np.linalg.norm(hand, axis=1).max()) / self.linear)
            self.distance += min(float(np.linalg.norm(target[:3, 3] - place(chain, then)[:3, 3])), 1.0)
        if self.limits is not None:
            worst["below a limit"] = max(worst["below a limit"], -least(self.limits, then))
        large = 0.5 * chain.acceleration * dt
        back = (change * self._change < 0) & (np.abs(change) > large) & (np.abs(self._change) > large)
        self.shakes += bool(back.any())
        self.q, self.v, self._change, self.ticks = then, u, change, self.ticks + 1


def follow(tracker: Any, seen: Seen, hops: Sequence[Hop]) -> None:
    """Hop after hop from `seen.q`."""
    for hop in hops:
        pose = hop.pose.copy()
        for _ in range(hop.ticks):
            seen.tick(tracker.step(seen.q, pose, hop.twist).value, pose)
            pose[:3, 3] += seen.dt * hop.twist[:3]


def law(seed: int) -> Seen:
    """One run of random limits and hops."""
    rng = np.random.default_rng(seed)
    dt, linear = (
        float(rng.choice([1e-3, 5e-3, 1e-2, 2e-2], p=[0.1, 0.3, 0.3, 0.3])),
        float(rng.choice([0.05, 0.25, 1.0])),
    )
    acceleration = np.exp(rng.uniform(0, np.log(20), 6)) if rng.random() < 0.5 else np.exp(rng.uniform(0, np.log(20)))
    middle, half = rng.uniform(-1.5, 1.5, 6), rng.uniform(0.3, 3.0, 6)
    lower, upper = np.maximum(middle - half, BASE.lower), np.minimum(middle + half, BASE.upper)
    chain = ur5(lower=lower, upper=upper, velocity=rng.uniform(0.5, 3.0), acceleration=acceleration)
    seen = Seen(chain, dt, linear)
    seen.q = rng.uniform(lower, upper)
    hops = []
    for _ in range(6):
        pose, how = (
            place(chain, rng.uniform(lower, upper) if rng.random() < 0.4 else rng.uniform(-3, 3, 6)),
            rng.random(),
        )
        if how < 0.3:
            pose[:3, 3] *= rng.uniform(1, 4)
        twist = np.r_[rng.normal(size=3) * rng.choice([0.05, 0.5]), 0, 0, 0] if rng.random() < 0.3 else STILL
        hops.append(Hop(pose, twist, int((rng.uniform(0.5, 3.0) if dt > 2e-3 else rng.uniform(0.2, 0.6)) / dt)))
    follow(PoseTracker(chain, dt=dt, linear_speed=linear, compile=False), seen, hops)
    return seen


def limits(seed: int) -> Seen:
    """One run with one to four limits of a user's own."""
    rng, q = np.random.default_rng(seed), ca.SX.sym("q", 6)
    every: list[Callable[[SerialChain, ca.SX], ca.SX]] = [
        lambda chain, q: chain.frames_expression(q)[2][2, 3] - 0.25,
        lambda chain, q: chain.pose_expression(q)[2, 3] - 0.1,
        lambda chain, q: 0.55 - chain.pose_expression(q)[0, 3],
        lambda chain, q: ca.sumsqr(chain.pose_expression(q)[:3, 3] - ca.DM([0.4, 0.2, 0.4])) - 0.04,
    ]
    chosen = [each for each in every if rng.random() < 0.6] or [every[int(rng.integers(4))]]
    h = ca.Function("h", [q], [ca.vertcat(*(each(BASE, q) for each in chosen))])
    chain = ur5(velocity=rng.uniform(0.8, 3), acceleration=np.exp(rng.uniform(np.log(1.5), np.log(15))))
    dt, linear = float(rng.choice([0.005, 0.01, 0.02])), float(rng.choice([0.25, 1.0]))
    seen = Seen(chain, dt, linear, h)
    while least(h, seen.q) <= 0.02:
        seen.q = rng.uniform(-2, 2, 6)
    hops = []
    for _ in range(4):
        pose = place(chain, rng.uniform(-2, 2, 6))
        if rng.random() < 0.6:
            pose[:3, 3] = rng.uniform([0.3, -0.5, -0.3], [1.2, 0.5, 0.8])
        hops.append(Hop(pose, STILL, int(rng.uniform(1, 4) / dt)))
    tracker = PoseTracker(chain, dt=dt, linear_speed=linear, limits=[Limit(each) for each in chosen], compile=False)
    follow(tracker, seen, hops)
    return seen


def counted(runs: Callable[[int], Seen], seeds: Sequence[int]) -> Rows:
    """The worst of all runs, how many ticks shake and the mean distance from the target."""
    all_of_it = [runs(seed) for seed in seeds]
    found = {key: max(each.worst[key] for each in all_of_it) for key in all_of_it[0].worst}
    ticks = sum(each.ticks for each in all_of_it)
    yield (
        runs.__name__,
        found
        | {
            "runs with a hand above 1.02": sum(each.worst["hand speed"] > 1.02 for each in all_of_it),
            "ticks that shake, of 10^5": 1e5 * sum(each.shakes for each in all_of_it) / ticks,
            "mean distance [m]": float(np.mean([3 * each.distance / each.ticks for each in all_of_it])),
        },
    )


def held(seeds: Sequence[int]) -> Rows:
    """Fastest joint in the last 4 s of 25 s towards a target out of reach."""
    tails = []
    for seed in seeds:
        rng, dt = np.random.default_rng(seed), 0.01
        chain, q = ur5(acceleration=rng.uniform(1.0, 1.7)), rng.uniform(-2, 2, 6)
        pose, way, tail = place(chain, rng.uniform(-2, 2, 6)), rng.normal(size=3), 0.0
        pose[:3, 3] = way / np.linalg.norm(way) * rng.uniform(0.95, 2.5)
        tracker = PoseTracker(chain, dt=dt, linear_speed=0.5, compile=False)
        for k in range(2500):
            u = tracker.step(q, pose, STILL).value
            q, tail = q + dt * u, max(tail, float(np.abs(u).max())) if k >= 2100 else 0.0
        tails.append(tail)
    yield "held", {
        "fastest joint at last [rad/s]": max(tails), "arms above 0.05 rad/s": sum(each > 0.05 for each in tails),
    }  # fmt: skip


def way(seeds: Sequence[int]) -> Rows:
    """Time to within 1 mm and 5 mrad over the time-optimal one of the joints; way beside the straight line."""
    ratios, aside = [], []
    for seed in seeds:
        rng, dt = np.random.default_rng(seed), 0.004
        speed, acceleration = rng.uniform(1, 3), float(rng.choice([2.0, 5.0, 15.0]))
        chain, q = ur5(velocity=speed, acceleration=acceleration), READY + 0.4 * rng.normal(size=6)
        goal = q + rng.choice([0.1, 0.3]) * rng.normal(size=6)
        pose, far = place(chain, goal), np.abs(goal - q)
        ramp, cruise = 2 * np.sqrt(far / acceleration), far / speed + speed / acceleration
        least = np.where(far <= speed**2 / acceleration, ramp, cruise).max()
        tracker, arrived = PoseTracker(chain, dt=dt, linear_speed=10.0, angular_speed=30.0, compile=False), 0
        begin, off = place(chain, q)[:3, 3], 0.0
        line = (pose[:3, 3] - begin) / np.linalg.norm(pose[:3, 3] - begin)
        for k in range(int(10 * least / dt)):
            q = q + dt * tracker.step(q, pose, STILL).value
            here = place(chain, q)
            off = max(off, float(np.linalg.norm(np.cross(here[:3, 3] - begin, line))))
            turn = np.arccos(np.clip((np.trace(pose[:3, :3].T @ here[:3, :3]) - 1) / 2, -1, 1))
            if np.linalg.norm(pose[:3, 3] - here[:3, 3]) > 1e-3 or turn > 5e-3:
                arrived = k + 1
        ratios.append((arrived + 1) * dt / least)
        aside.append(off / np.linalg.norm(pose[:3, 3] - begin))
    yield (
        "way",
        {
            f"{what}, {p} %": float(np.percentile(each, p))
            for what, each in (("time over the shortest", ratios), ("beside the line over its length", aside))
            for p in (50, 90, 100)
        },
    )


def servos(seeds: Sequence[int]) -> Rows:
    """A target beyond a joint limit, approached for 5 s and held for 3 s; then one in reach for 4 s."""
    from bench.physics.arms import ARMS  # noqa: PLC0415  (loads MuJoCo)
    from rehab_opt.plants.channel import Channel  # noqa: PLC0415
    from rehab_opt.plants.drives import DriveState, PositionServo, VelocityServo  # noqa: PLC0415
    from rehab_opt.plants.mujoco_arm import MujocoArm  # noqa: PLC0415
    from rehab_opt.plants.plant import PositionStream  # noqa: PLC0415

    dt, arms = 1e-3, [each() for each in ARMS.values()]

    class Damped(PositionServo):
        """Spring and damper of the MuJoCo Menagerie's iiwa 14 (2000 Nm/rad, 200 Nms/rad), by each joint's torque."""

        def torque(self, command: Array, state: DriveState, feedforward: Array) -> Array:
            pull = self._limit / 320.0 * (2000.0 * (command - state.position) - 200.0 * state.velocity)
            return np.clip(feedforward + pull, -self._limit, self._limit)

    robots = [("velocity", delay) for delay in (0.0, 0.002, 0.005, 0.008)] + [("position", 0.0)]
    for servo, delay in robots:
        found = {"peak to peak at the limit [mrad]": 0.0, "beyond it [mrad]": 0.0, "short of it at rest [mrad]": 0.0,
                 "a target in reach, by the encoders [mm]": 0.0}  # fmt: skip
        for seed in seeds:
            rng, arm = np.random.default_rng(seed), arms[seed % len(arms)]
            chain, start, goal = arm.chain, arm.start(rng), arm.start(rng)
            joint, sign = int(rng.integers(chain.n)), float(rng.choice([-1.0, 1.0]))
            goal[joint] = (chain.upper if sign > 0 else chain.lower)[joint] + sign * rng.uniform(0.1, 0.4)
            channel = Channel(command_delay=delay / 2, measurement_delay=delay / 2, position_noise=1.5e-4)
            drive = VelocityServo() if servo == "velocity" else Damped()
            plant = MujocoArm(arm.model, dt=dt, drive=drive, channel=channel, seed=rng)
            plant = plant if servo == "velocity" else PositionStream(plant)
            tracker, seen = PoseTracker(chain, dt=dt, compile=False), plant.reset(start)
            q = np.empty((8000, chain.n))
            for k in range(len(q)):
                q[k] = plant.truth.position
                seen = plant.step(tracker.step(seen.position, place(chain, goal), STILL).value)
            over, rest = np.maximum(q - chain.upper, chain.lower - q), slice(-3000, None)
            near = np.abs(over[rest].max(axis=0)) < 5e-3
            reach, encoders = place(chain, arm.start(rng, 0.2)), []
            for k in range(4000):
                seen = plant.step(tracker.step(seen.position, reach, STILL).value)
                encoders += [seen.position] if k >= 3500 else []
            there = place(chain, np.mean(encoders, axis=0))
            numbers = (
                1e3 * np.ptp(q[rest], axis=0)[near].max(initial=0.0), 1e3 * over.max(),
                1e3 * -over[-1][near].min(initial=0.0), 1e3 * np.linalg.norm(there[:3, 3] - reach[:3, 3]),
            )  # fmt: skip
            found = {key: max(old, float(new)) for (key, old), new in zip(found.items(), numbers, strict=True)}
        yield f"velocity servos, {1e3 * delay:g} ms" if servo == "velocity" else "position servos 0.1 s late", found


PARTS: dict[str, Callable[[Sequence[int]], Rows]] = {
    "law": lambda seeds: counted(law, seeds), "held": held, "limits": lambda seeds: counted(limits, seeds), "way": way,
    "servos": servos,
}  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the parts and print a table of each."""
    parser = argparse.ArgumentParser(prog="python -m bench.braking", description=__doc__)
    parser.add_argument("--parts", nargs="+", choices=list(PARTS), default=list(PARTS))
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    for name in options.parts:
        rows = list(PARTS[name](range(options.seed, options.seed + options.runs)))
        table = Table("", *rows[0][1], title=f"{name}, {options.runs} runs from seed {options.seed}")
        for who, numbers in rows:
            table.add_row(who, *(f"{each:.4g}" for each in numbers.values()))
        Console(width=160).print(table)


if __name__ == "__main__":
    main()
