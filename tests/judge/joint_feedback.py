"""Late servos, noisy encoders, joints that do not follow: where they are led, and what is told of them.

Judged by a plant and an observer of its own: a line of commands under way, a servo in state space, encoders that lie.
The tracker must do what one on measured positions does at the reference that the observer finds.
"""

from __future__ import annotations

import math
import re
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from rehab_opt import Command, JointFeedback, PoseTracker, ur5
from tests.judge.numbering import Runs, judging
from tests.judge.references import good_posture, reference
from tests.judge.ur5_numbers import LIMIT, hand_twist, tool
from tests.judge.verdict import Verdict

LINEAR, ANGULAR = 0.5, 1.0
"""[m/s, rad/s] largest hand speeds."""
REACH = 1.2
"""[m] of a UR5's links in line: more than its hand's way bends in a tick."""
Array = NDArray[np.float64]

GUARANTEES = ("G09",)
KINDS = ("blocked", "nothing", "wrong way", "limits", "encoder still", "knocked", "offset", "blind", "drifting")
NAMES = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
FOR_GOOD = ("blocked", "wrong way", "encoder still")
LEAST = {"fault told": 30_000, "after a reset": 10_000, "a joint at its limit": 2000, "no numbers": 2000,
         "beyond the tolerance, no fault": 1000, "servo in the model": 50_000, "servo without integral action": 15_000,
         "late by more or less": 50_000,
         "compared with one that is not late": 150_000}  # fmt: skip
CI_TICKS = 4400
SHARE = 0.3
GAIN = 20.0
"""[1/s]"""
TICKS = 400
BEGINS, RESETS = 120, 320
"""Ticks of a run at which something goes wrong, and at which that ends and `reset` is called."""
ALIKE = 1e-6
POLE = 2.4818
"""-3 dB of a servo with both poles at -1: sqrt(3 + sqrt(10)), as near as the library has it."""
CLOSE = 0.4
"""[rad] of a limit, from which on these joints may be slowed down for it."""
OVERSHOOT = 1e-4
"""[rad] of a servo beyond a limit it was led to by its own model."""


class Servo:
    """Velocity loops of proportional and integral gain, both poles at -p, or q' = k (q_commanded - q), behind commands
    under way."""

    def __init__(self, q: Array, late: float, told: JointFeedback, dt: float) -> None:
        """Commands act `late` ticks later, which need be no whole number."""
        self.q, self.dt, self.lag = q.copy(), dt, np.zeros((2, len(q)))
        """Speed less the command [rad/s], and by how much the position is behind [rad]."""
        ticks = math.ceil(late - 1e-6)
        self.v, self.late = np.zeros(len(q)), [np.zeros(len(q)) for _ in range(ticks)]
        self.ahead = dt * max(ticks - late, 0.0)
        """[s] of a tick in which the next command acts already."""
        slow = slowness(told)
        self.trails = 0.0 if told.integral_action else slow
        self.fades = [faded(t / slow, slow, told) if slow else np.zeros((2, 2)) for t in (dt - self.ahead, self.ahead)]

    def set_out(self, velocity: Array) -> None:
        """It has moved like that for long."""
        self.v, self.lag = velocity.copy(), np.stack([np.zeros_like(velocity), self.trails * velocity])
        self.late = [velocity.copy() for _ in self.late]

    def move(self, command: Array) -> Array:
        """(n,) by how much the joints move in a tick."""
        self.late.insert(0, command.copy())
        parts = [(self.late.pop(), self.dt - self.ahead, self.fades[0])]
        if self.ahead:
            parts.append((self.late[-1], self.ahead, self.fades[1]))
        moved = np.zeros(len(self.q))
        for arrived, seconds, fades in parts:
            rest = np.stack([arrived, self.trails * arrived])
            after = rest + fades @ (np.stack([self.v, self.lag[1]]) - rest)
            moved += seconds * arrived + self.lag[1] - after[1]
            self.v, self.lag = after[0], after - [arrived, 0 * arrived]
        self.q = self.q + moved
        return moved

    @property
    def under_way(self) -> Array:
        """(n,) [rad] by how much they will still move."""
        acted = self.ahead * self.late[-1] if self.late else 0.0
        return np.asarray(self.dt * np.sum(self.late, axis=0) - acted + self.lag[1])


def faded(times: float, slow: float, told: JointFeedback) -> Array:
    """(2, 2) what is left of speed and position error after so many times `slow` [s]."""
    if not told.integral_action:
        return math.exp(-times) * np.array([[0.0, 1 / slow], [0.0, 1.0]])
    return np.asarray(expm(times * slow * np.array([[-2 / slow, slow**-2], [-1.0, 0.0]])))


def slowness(told: JointFeedback) -> float:
    """[s] 1/p, or 1/k without integral action."""
    with np.errstate(divide="ignore"):
        return float((POLE if told.integral_action else 1.0) / (2 * math.pi * np.float64(told.servo_hz)))


class Plan(NamedTuple):
    """What a run is: the robot as it is, as it is told, and what goes wrong."""

    kind: str
    dt: float
    told: JointFeedback
    late: float
    """Ticks that commands truly take."""
    noise: float
    joint: int
    size: float
    lower: Array
    upper: Array
    acceleration: Array

    @property
    def ticks(self) -> float:
        """Those that the model counts."""
        return round(self.told.delay / self.dt, 6)

    @property
    def exact(self) -> bool:
        """Whether the model is the robot."""
        return self.late == self.ticks and self.noise == 0.0 and self.kind in ("nothing", "limits")


def draw(rng: np.random.Generator, number: int, start: Array) -> Plan:
    """Half of them as the model says, the others up to 3 ms more or less late and with noise."""
    kind, other = KINDS[number % len(KINDS)], (number + number // len(KINDS)) % 2 == 1
    dt, ticks = float(rng.choice([2e-3, 5e-3] if other else [2e-3, 5e-3, 1e-2])), int(rng.integers(0, 9))
    told = JointFeedback(
        delay=(ticks + rng.uniform(-0.4, 0.4) * (ticks > 0)) * dt,
        servo_hz=float(rng.choice([math.inf, 10.0, 24.0, 60.0])) if kind != "limits" else float(rng.choice([10, 24])),
        integral_action=bool(rng.random() < 0.7),
        correction=float(rng.choice([0.05, 1.0, 20.0])),
        tolerance=float(rng.choice([0.03, 0.05])),
        patience=float(rng.choice([0.05, 0.1])),
        contact=1e3,  # what holds a hand is another matter
    )
    change = round(3e-3 / dt) * int(rng.choice([-1, 1]))
    late = round(told.delay / dt, 6)
    late += (change if late + change >= 0 else -change) if other else 0
    narrow = kind == "limits"
    room = rng.uniform(0.02, 0.2, (2, 6)) if narrow else np.full((2, 6), 9.0)
    return Plan(
        kind, dt, told, late, float(rng.choice([0.0, 1e-4, 1e-3])) if other else 0.0, int(rng.integers(6)),
        float(rng.choice([-1.0, 1.0])), np.maximum(start - room[0], -LIMIT), np.minimum(start + room[1], LIMIT),
        rng.uniform(5.0, 20.0, 6),
    )  # fmt: skip


def trackers(plan: Plan) -> list[PoseTracker]:
    """The one that is judged, and one on measured positions."""
    arm = ur5(lower=plan.lower, upper=plan.upper, velocity=np.full(6, 1.5), acceleration=plan.acceleration)
    return [
        PoseTracker(
            arm, dt=plan.dt, gain=GAIN, angular_speed=ANGULAR, linear_speed=LINEAR, feedback=each, compile=False
        )
        for each in (plan.told, None)
    ]


class Encoders:
    """What is measured of a robot in which something goes wrong."""

    def __init__(self, rng: np.random.Generator, plan: Plan, start: Array) -> None:
        self.rng, self.plan = rng, plan
        self.robot = Servo(start, plan.late, plan.told, plan.dt)
        self.shift, self.still = np.zeros(6), start.copy()

    def read(self, k: int, command: Array) -> Array:
        """(6,) after a tick of a command."""
        plan, j, before = self.plan, self.plan.joint, self.robot.q.copy()
        moved = self.robot.move(command)
        wrong = BEGINS <= k < RESETS
        if wrong and plan.kind in ("blocked", "wrong way"):
            self.robot.q[j] = before[j] - (moved[j] if plan.kind == "wrong way" else 0.0)
            if plan.kind == "blocked":
                self.robot.v[j] = self.robot.lag[:, j] = 0.0
        told = plan.told
        if plan.kind == "knocked":
            lasts = int(0.6 * told.patience / plan.dt)
            self.shift[j] = plan.size * 3.0 * told.tolerance if BEGINS <= k < BEGINS + lasts else 0.0
        elif plan.kind == "offset" and wrong:
            self.shift[j] = plan.size * 0.4 * told.tolerance
        elif plan.kind == "drifting" and wrong:
            self.shift[j] += plan.size * min(0.4 * told.correction * told.tolerance, 0.2) * plan.dt
        measured = self.robot.q + self.shift + plan.noise * self.rng.uniform(-1, 1, 6)
        if wrong and plan.kind == "encoder still":
            measured[j] = self.still[j]
        self.still = measured.copy()
        if (plan.kind == "blind" and self.rng.random() < 0.05) or (wrong and self.rng.random() < 0.02):
            measured[int(self.rng.integers(6))] = self.rng.choice([math.nan, math.inf, -math.inf])
        return measured


class Observer:
    """Where the joints are led, by the sentences of the docstring."""

    def __init__(self, plan: Plan, start: Array) -> None:
        self.told, self.dt = plan.told, plan.dt
        self.model = Servo(start, plan.ticks, plan.told, plan.dt)
        self.known = False
        self.error, self.strays = np.zeros((2, len(start)))
        """(n,) following error, and what the task knows of it."""

    def reset(self, velocity: Array) -> None:
        """Nothing is known but what the joints do now."""
        self.model.set_out(velocity)
        self.known, self.strays = False, np.zeros_like(self.strays)

    def reference(self, measured: Array, command: Array) -> Array:
        """(n,) after a tick of a command; what is no number stays so."""
        self.model.move(command)
        valid = np.isfinite(measured)
        self.error = measured - self.model.q if valid.all() and self.known else np.zeros_like(self.error)
        lively = min(float(np.abs(self.model.v).max()) / 0.1, 1.0) ** 2
        fraction = -math.expm1(-self.told.following * self.dt) * lively * valid.all()
        taken = fraction * (np.abs(self.error) <= self.told.tolerance)
        self.strays = self.strays + taken * (self.error - self.strays)
        if valid.all():
            if not self.known:
                self.model.q = measured.copy()
            self.known = True
            large = np.abs(self.error) > self.told.tolerance
            fraction = min(self.told.correction * self.dt, 1.0)
            self.model.q = self.model.q + np.where(large, 0.0, fraction * self.error)
        return np.asarray(np.where(valid, self.model.q + self.model.under_way, measured))


def seen_from(led: Array, there: Array, target: Array) -> Array:
    """(4, 4) pose that is as far from the hand at `led` (6,) as the target is from the hand at `there` (6,)."""
    if not np.isfinite(led).all():
        return target
    (here, away), pose = tool(np.stack([led, there])), target.copy()
    pose[:3, 3] += here[:3, 3] - away[:3, 3]
    pose[:3, :3] = target[:3, :3] @ away[:3, :3].T @ here[:3, :3]
    return pose


class Seen(NamedTuple):
    """One run, one row a tick."""

    commands: list[Command]
    led: Array
    """(N, 6) by the observer."""
    true: Array
    """(N, 6) where the joints were."""
    errors: Array
    """(N, 6) following errors by the observer."""
    blind: NDArray[np.bool_]
    tells: NDArray[np.bool_]
    """(N,) whether a joint was said not to follow."""


def one_run(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """One robot, which follows or does not."""
    start = good_posture(rng, 0.3)
    plan = draw(rng, number, start)
    dt, told = plan.dt, plan.told
    verdict.begin(number, f"{plan.kind}, dt {dt:g}, {told.servo_hz:g} Hz, late {plan.late - plan.ticks}")
    gains(verdict, told)
    control, twin = trackers(plan)
    way = ("sines", "person", "held", "moving on")[int(rng.integers(4))]
    poses, twists = reference(rng, way, start, TICKS, dt)
    encoders, observer = Encoders(rng, plan, start), Observer(plan, start)
    commands: list[Command] = []
    others, led, true, errors = np.zeros((4, TICKS, 6))
    blind, tells, last = np.zeros(TICKS, dtype=bool), np.zeros(TICKS, dtype=bool), np.zeros(6)
    for k in range(TICKS):
        if k == RESETS:
            for each in (control, twin):
                each.reset(last)
            observer.reset(last)
        measured = encoders.read(k, commands[-1].value if commands else last)
        led[k] = observer.reference(measured, last)
        command = control.step(measured, poses[k], twists[k])
        tells[k] = "does not follow" in command.reason
        early = 1.0 - math.expm1(-GAIN * dt) / dt * told.delay / 2
        pose = seen_from(led[k], led[k] + observer.strays, poses[k])
        other = twin.step(led[k], pose, early * twists[k])
        if "does not follow" in other.reason:  # it watches, too, but where joints are led is no measurement
            twin.reset(last)
            other = twin.step(led[k], pose, early * twists[k])
        others[k] = command.value if tells[k] else other.value
        commands.append(command)
        last, true[k], errors[k] = command.value, encoders.robot.q, observer.error
        blind[k] = not np.isfinite(measured).all()
    answers = verdict.answers(commands, dt)
    close = np.fmin(plan.upper - led, led - plan.lower).min(axis=1) < CLOSE
    free = ~np.logical_or.accumulate(close)  # how limits are approached differs from that of a robot that is not late
    apart = np.where(free[:, None], np.abs(answers.value - others), 0.0)
    verdict.within("away from the command at where the joints are led [rad/s]", apart, ALIKE)
    seen = Seen(commands, led, true, errors, blind, tells)
    faults(verdict, plan, seen)
    limits(verdict, plan, seen)
    verdict.during("fault told", tells, dt)
    verdict.during("after a reset", (np.arange(TICKS) >= RESETS) & (plan.kind in FOR_GOOD), dt)
    verdict.during("no numbers", blind, dt)
    verdict.during("beyond the tolerance, no fault", (np.abs(errors) > told.tolerance).any(axis=1) & ~tells, dt)
    verdict.during("compared with one that is not late", free, dt)
    modelled = math.isfinite(told.servo_hz)
    verdict.during("servo in the model", np.full(TICKS, modelled), dt)
    verdict.during("servo without integral action", np.full(TICKS, modelled and not told.integral_action), dt)
    verdict.during("late by more or less", np.full(TICKS, plan.late != plan.ticks), dt)


def gains(verdict: Verdict, told: JointFeedback) -> None:
    """What this robot leaves of a gain, by its numbers."""
    late, slow = np.float64(told.delay), np.float64(slowness(told))
    with np.errstate(divide="ignore"):
        due = 2 / (3 * (late + slow)), 1 / (3 * slow), late / 2
    said = told.max_gain, told.approach, told.command_delay
    verdict.holds("gains and delays are those that are said", np.isclose(said, due, rtol=1e-4, atol=0.0))


def faults(verdict: Verdict, plan: Plan, seen: Seen) -> None:
    """When a fault is told, what is said of it, and what is done."""
    dt, patience, tells = plan.dt, plan.told.patience, seen.tells
    over = np.abs(seen.errors) > plan.told.tolerance
    row, total = np.zeros((2, TICKS))
    for k in range(TICKS):
        anew = k in (0, RESETS)
        row[k] = (0 if anew else row[k - 1]) * (over[k].any() or seen.blind[k]) + over[k].any()
        total[k] = (0 if anew else total[k - 1]) + over[k].any()
    verdict.holds("a joint that does not follow is told in time", tells | (row * dt <= patience + 1.5 * dt))
    verdict.holds("no fault before the patience is over", ~tells | (total * dt > patience - 0.5 * dt))
    if plan.kind not in FOR_GOOD:
        # A reset in motion takes all that is under way for one speed, which it need not be.
        verdict.holds("no fault of a robot that follows", ~tells[:RESETS])
    held = tells[:-1] & (np.arange(1, TICKS) != RESETS)
    verdict.holds("a fault is told until reset", tells[1:] | ~held)
    verdict.holds("reset ends a fault", not tells[RESETS])
    if tells.any():
        first = int(np.argmax(tells))
        worst = int(np.argmax(np.abs(seen.errors[first])))
        reasons = [each.reason for each in seen.commands]
        verdict.holds("the reason names the joint", NAMES[worst] in reasons[first], reasons[first])
        number = float(re.findall(r"[\d.]+(?:e[-+]\d+)?", reasons[first].partition(":")[2])[0])
        verdict.within("error in the reason", abs(number / abs(seen.errors[first, worst]) - 1.0), 0.06)
        last = max(k for k in range(TICKS) if tells[k])
        verdict.holds("the reason stays", [each == reasons[first] for each in reasons[first : min(last + 1, RESETS)]])
    value = np.array([each.value for each in seen.commands])
    last = value[:-1]
    whole = np.sign(last) * np.maximum(np.abs(last) - plan.acceleration * dt, 0.0)
    # Where the hand would be faster than its bounds so, joints wait for the one that rests last.
    led = np.where(np.isfinite(seen.led[1:]), seen.led[1:], math.nan)
    hand, bend = hand_twist(led, whole), REACH * dt**2 * np.abs(whole).sum(axis=1) ** 3
    linear, angular = np.linalg.norm(hand[:, :3], axis=1) + bend, np.linalg.norm(hand[:, 3:], axis=1)
    waits = ~((linear < 0.99 * LINEAR) & (angular < 0.99 * ANGULAR))
    rests_last = np.arange(6) == np.argmax(np.abs(last) / plan.acceleration, axis=1)[:, None]
    slower = np.abs(np.where(waits[:, None] & ~rests_last, last, whole))
    verdict.within("speed while braking [rad/s]", np.where(tells[1:, None], np.abs(value[1:]) - slower, 0.0), 1e-9)
    safe = np.array([each.status.value in ("braking", "holding") for each in seen.commands])
    verdict.holds("a fault or no numbers are answered by the safe command", safe | ~(tells | seen.blind))


def limits(verdict: Verdict, plan: Plan, seen: Seen) -> None:
    """Where the joints are led, and where they are."""
    beyond = np.fmax(seen.led - plan.upper, plan.lower - seen.led)
    beyond = np.where(np.isfinite(beyond), beyond, -1.0)
    if plan.exact:
        verdict.within("led beyond a limit [rad]", beyond, 1e-9)
        verdict.within("a joint beyond its limit, where the model is true [rad]",
                       np.fmax(seen.true - plan.upper, plan.lower - seen.true), OVERSHOOT)  # fmt: skip
    elif plan.kind == "limits":
        far = np.maximum.accumulate(np.abs(seen.errors).max(axis=1))[:, None]
        verdict.within("led beyond a limit, over the following error [rad]", beyond - far, 1e-6)
        verdict.within("a joint beyond its limit, over the following error [rad]",
                       np.fmax(seen.true - plan.upper, plan.lower - seen.true) - 2 * far, OVERSHOOT)  # fmt: skip
    verdict.during("a joint at its limit", (beyond > -1e-3).any(axis=1), plan.dt)


run = judging(__name__, LEAST, Runs(one_run))
