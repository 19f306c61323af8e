"""Where a hand comes to rest that is led to a pose which the arm may not have: at the nearest one that it may.

`PoseTracker` and `MirrorTracker` with joint limits, limits of a user's own, several distances in each, a plane
below a probe on the arm and the manipulability floor, all drawn around the start. Judged: each distance in every tick, also while braking; the
barrier; and that the hand stands in the end, where no motion that the active limits leave leads it nearer (the
multipliers of the judge's own gradients, by non-negative least squares), places and turns weighed as was asked.

Not judged at rest: two distances of one limit that are met at once, of which the least alone makes a row; and a curved
limit that `PoseTracker` rests at, where its joints were seen to shake by up to 0.26 rad/s instead.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from rehab_opt import Interaction, KeepOut, Limit, LinkCapsule, MirrorTracker, PoseTracker, ur5
from tests.judge.numbering import numbered
from tests.judge.references import good_posture, minimum_jerk
from tests.judge.ur5_numbers import LARGEST, LIMIT, frames, hand_twist, jacobian, manipulability, tool, turn_between
from tests.judge.verdict import Promise, Verdict

PROMISES = (
    Promise("rehab_opt/control/wanted.py", "Without it, keeping the direction of an undeliverable motion would stop "
            "the arm where going on to the nearest pose is wanted."),
    Promise("rehab_opt/control/mirror.py", "[m/rad] what a turn of the hand counts for against its place where both "
            "cannot be had."),
    Promise("rehab_opt/control/limit.py", "every distance h(q) at zero or above, at the end of every tick. h(q) >= 0, "
            "met as the barrier grad h . q' >= -rate h"),
    Promise("rehab_opt/control/limit.py", "kept by the QP, the shortened step and the safe command."),
    Promise("rehab_opt/control/pose_tracker.py", "They come before accelerations and hold while braking, too."),
)  # fmt: skip
LEAST = {"the floor is active at rest": 10_000,
         "mirror, at rest beyond a limit": 50_000, "tracker, at rest beyond a limit": 5000,
         "a user's limit is active at rest": 20_000, "the plane is active at rest": 10_000,
         "a joint limit is active at rest": 20_000, "several are active at rest": 5000, "braking near a limit": 200,
         "another distance is the least one": 500}  # fmt: skip
CI_TICKS = 1200
SHARE = 0.3
Array = NDArray[np.float64]
MOVING, HELD = 1.0, 4.0
"""[s] in which the reference goes to its end, and for which it is held there."""
LEAST_W = 0.05
"""Of w / w_max: nearer to singular postures the last of a way takes longer than is waited for."""
ACTIVE = 2e-3
"""[rad, m] before a limit it is active: a user's own is met a square of the joints' way in a tick before it."""


class Own(NamedTuple):
    """A user's limit: planes and a ball in the space of the joints."""

    ways: Array
    """(k, 6) unit normals."""
    rooms: Array
    """(k,) [rad] at the start."""
    middle: Array
    """(6,) of the ball."""
    radius: float
    rate: float | None

    def distances(self, start: Array) -> Any:
        """As `Limit` wants it."""

        def found(_: object, q: ca.SX) -> ca.SX:
            planes = ca.DM(self.ways) @ (q - ca.DM(start)) + ca.DM(self.rooms)
            return ca.vertcat(planes, (self.radius**2 - ca.sumsqr(q - ca.DM(self.middle))) / (2 * self.radius))

        return found

    def numbers(self, q: Array, start: Array) -> Array:
        """(N, k + 1) the distances at q (N, 6)."""
        ball = (self.radius**2 - ((q - self.middle) ** 2).sum(axis=1)) / (2 * self.radius)
        return np.column_stack([(q - start) @ self.ways.T + self.rooms, ball])

    def slopes(self, q: Array) -> Array:
        """(N, k + 1, 6) of them."""
        planes = np.repeat(self.ways[None], len(q), axis=0)
        return np.concatenate([planes, -((q - self.middle) / self.radius)[:, None]], axis=1)


class Probe(NamedTuple):
    """A ball on a link, and a plane that it stays above."""

    frame: int
    place: Array
    radius: float
    normal: Array
    offset: float

    def heights(self, q: Array) -> Array:
        """(N,) [m] at q (N, 6)."""
        poses = frames(q)[:, self.frame]
        centres = poses[:, :3, :3] @ self.place + poses[:, :3, 3]
        return np.asarray(centres @ self.normal - self.offset - self.radius)


def run(ticks: int, seed: int, *, only: int | None = None) -> Verdict:
    """Both trackers in turn."""
    verdict = Verdict("limits_rest", seed, LEAST)
    for number, rng in numbered(verdict, ticks, only):
        one_run(verdict, number, rng)
    verdict.seldom_beyond_the_dual_method()
    return verdict


def own(rng: np.random.Generator, start: Array) -> Own:
    """One of two to four distances, some way off."""
    ways = rng.standard_normal((int(rng.integers(1, 4)), 6))
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    radius, out = rng.uniform(0.3, 1.0), rng.standard_normal(6)
    middle = start + (radius - rng.uniform(0.02, 0.1)) * out / np.linalg.norm(out)
    rate = None if rng.random() < 0.5 else float(rng.uniform(5.0, 30.0))
    return Own(ways, rng.uniform(0.02, 0.15, len(ways)), middle, radius, rate)


def probe(rng: np.random.Generator, start: Array) -> Probe | None:
    """A probe that stands out towards some plane; None where none was found."""
    found = frames(start[None])[0]
    for _ in range(100):
        frame, place, radius = int(rng.integers(4, 7)), rng.uniform(-0.25, 0.25, 3), float(rng.uniform(0.01, 0.04))
        normal = rng.standard_normal(3)
        normal /= np.linalg.norm(normal)
        lowest = float((found[frame, :3, :3] @ place + found[frame, :3, 3]) @ normal) - radius
        if lowest < (found[1:, :3, 3] @ normal).min() - 0.1:
            return Probe(frame, place, radius, normal, lowest - float(rng.uniform(0.005, 0.03)))
    return None


def one_run(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """One arm, one pose."""
    mirror, dt = number % 2 == 0, float(rng.choice([0.01, 0.02]))
    start = good_posture(rng, 0.5)
    lower, upper = -LIMIT, LIMIT.copy()
    if rng.random() < 0.5:
        lower = np.maximum(lower, start - rng.uniform(0.02, 0.3, 6))
        upper = np.minimum(upper, start + rng.uniform(0.02, 0.3, 6))
    wishes = [own(rng, start) for _ in range(int(rng.integers(1, 3)))] if rng.random() < 0.7 or not mirror else []
    beside = probe(rng, start) if mirror and (rng.random() < 0.7 or not wishes) else None
    velocity, acceleration = rng.uniform(1.0, 2.5, 6), rng.uniform(5.0, 30.0, 6)
    length, deviation, rate = float(rng.choice([0.05, 0.1, 0.3])), 0.2, float(rng.choice([10.0, 20.0]))
    floor = float(manipulability(start[None])[0]) * float(rng.choice([0.1, 0.9, 0.98]))
    weights = np.r_[np.ones(3), np.full(3, length**2)]
    capsules = ()
    if beside is not None:
        x, y, z = beside.place.tolist()
        capsules = (LinkCapsule("probe", beside.frame, (x, y, z), (x, y, z), beside.radius),)  # type: ignore[assignment]
    arm = ur5(lower=lower, upper=upper, velocity=velocity, acceleration=acceleration, capsules=capsules)
    limits = [Limit(each.distances(start), rate=each.rate) for each in wishes]
    control: MirrorTracker | PoseTracker
    if mirror:
        control = MirrorTracker(
            arm, floor=floor, max_deviation=deviation, linear_speed=1.0, angular_speed=3.0, turn_length=length,
            max_manipulability=LARGEST, interaction=Interaction(), dt=dt, rate=rate, limits=limits, compile=False,
            keep_out=[] if beside is None else [KeepOut.through(beside.normal * beside.offset, beside.normal)],
        )  # fmt: skip
    else:
        control = PoseTracker(arm, task_weights=weights, dt=dt, limits=limits, compile=False)
        rate = 1.0 / max(float(np.max(velocity / acceleration)), dt)
    verdict.begin(number, f"{'mirror' if mirror else 'tracker'}, dt {dt:g}, {len(wishes)} own limits")
    away = rng.standard_normal(6)
    if beside is not None and rng.random() < 0.7:  # into the plane
        away = -np.linalg.pinv(jacobian(start[None])[0, :3]) @ beside.normal
    elif rng.random() < 0.4:  # to where the arm is less able
        away = 0.3 * away / np.linalg.norm(away) - _slope(manipulability, start)
    goal = start + float(rng.uniform(0.1, 0.4)) * away / np.linalg.norm(away)
    ticks = round((MOVING + HELD) / dt)
    part = np.r_[minimum_jerk(round(MOVING / dt)), np.ones(ticks - round(MOVING / dt))]
    way = start + part[:, None] * (goal - start)
    poses, twists = tool(way), hand_twist(way, np.gradient(way, dt, axis=0))
    q, commands, first = np.empty((ticks + 1, 6)), [], int(rng.integers(ticks // 4)) if rng.random() < 0.4 else ticks
    q[0] = start
    for k in range(ticks):
        commands.append(control.step(q[k], poses[k], twists[k], enable=not first <= k < first + 0.3 / dt))
        q[k + 1] = q[k] + dt * commands[-1].value
    answers = verdict.answers(commands, dt)
    value, ok = answers.value, np.isin(answers.status, ("ok", "backup", "blocked"))
    near, apiece, curved = np.zeros(ticks, dtype=bool), 0, False
    gradients = [np.eye(6)[i] for i in range(6) if q[-1, i] < lower[i] + ACTIVE]
    gradients += [-np.eye(6)[i] for i in range(6) if q[-1, i] > upper[i] - ACTIVE]
    held = {"a joint limit is active at rest": len(gradients)}
    for each in wishes:
        numbers, slopes = each.numbers(q, start), each.slopes(q[:-1])
        verdict.within("a user's distance below zero", -numbers, 1e-11)
        least = numbers[:-1].argmin(axis=1)
        apart = np.partition(numbers[:-1], 1, axis=1)
        decay = (1 - math.exp(-(rate if each.rate is None else each.rate) * dt)) / dt
        closing = -np.einsum("ni,ni->n", slopes[np.arange(ticks), least], value)
        if mirror:  # `PoseTracker`'s is about the middle of the tick
            verdict.within("a user's distance falls faster than its barrier", np.where(
                ok, closing - decay * np.maximum(apart[:, 0], 0.0), 0.0), 1e-9)  # fmt: skip
        verdict.during("another distance is the least one", least != least[0], dt)
        near |= apart[:, 0] < 0.02
        active = numbers[-1] < ACTIVE
        apiece, curved = max(apiece, int(active.sum())), curved or bool(active[-1])
        gradients += list(each.slopes(q[-1:])[0][active])
    held["a user's limit is active at rest"] = len(gradients) - sum(held.values())
    if beside is not None:
        verdict.within("the probe below the plane [m]", -beside.heights(q), 1e-9)
        if beside.heights(q[-1:])[0] < ACTIVE:
            gradients.append(_slope(beside.heights, q[-1]))
    held["the plane is active at rest"] = len(gradients) - sum(held.values())
    if mirror and manipulability(q[-1:])[0] < floor + ACTIVE:
        gradients.append(_slope(manipulability, q[-1]))
    held["the floor is active at rest"] = len(gradients) - sum(held.values())
    verdict.during("braking near a limit", ~ok & near, dt)
    late = isinstance(control, MirrorTracker) and (control.lag > 1e-6 or manipulability(q).min() < LEAST_W)
    if late or apiece > 1 or (curved and not mirror) or not ok[-50:].all():
        return
    here = tool(q[-1:])
    error = np.r_[poses[-1, :3, 3] - here[0, :3, 3], turn_between(poses[-1:, :3, :3], here[:, :3, :3])[0]]
    downhill = jacobian(q[-1:])[0].T @ (weights * error)
    left = nnls(-np.column_stack(gradients), downhill)[1] if gradients else float(np.linalg.norm(downhill))
    verdict.within("joint speed at rest [rad/s]", np.abs(value[-1]), 1e-6)
    verdict.within("a nearer pose is left aside, gradient", left, 1e-6)
    resting = np.full(ticks, bool(gradients))
    verdict.during(f"{'mirror' if mirror else 'tracker'}, at rest beyond a limit", resting, dt)
    verdict.during("several are active at rest", resting & (len(gradients) > 1), dt)
    for situation, count in held.items():
        verdict.during(situation, np.full(ticks, count > 0), dt)


def _slope(height: Any, q: Array, step: float = 1e-6) -> Array:
    """(6,) by finite differences."""
    return np.asarray((height(q + step * np.eye(6)) - height(q - step * np.eye(6))) / (2 * step))
