"""Arms whose servos are late and whose encoders are noisy, led by `PoseTracker` as it comes.

Robots of the judge's own: commands act some ticks later, by velocity loops with integral action or by joints that chase
a commanded position. Judged by where joints truly are: how far beyond a limit they are led, and that they stand there,
once slow ways to it are over. Who follows, with a delay of up to 0.1 s and a lag of up to 0.1 s behind it, is not said
to be stuck, who stands still is. No command is made of samples that cannot be, for however long they come, and it goes
on behind them; nor another of encoders that count turns otherwise, whichever of them fails. Who is pushed comes back.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from rehab_opt import Command, PoseTracker, SerialChain, ur5
from tests.judge.numbering import Runs, judging
from tests.judge.references import good_posture, minimum_jerk, reference
from tests.judge.ur5_numbers import LIMIT, hand_twist, manipulability, tool
from tests.judge.verdict import Verdict

GUARANTEES = ("G09",)
LEAST = {
    "a bad sample in motion": 130, "a servo of positions": 29_000, "all still, named": 3500, "back after a push": 900,
    "blocked, named": 2900, "encoder still, named": 3400, "later than 8 ms": 11_000, "noise": 24_000,
    "other turns": 5000, "stands at a limit": 3000, "reason no joint can have come to these positions": 100,
}  # fmt: skip
CI_TICKS = 56_000
SHARE = 0.3
Array = NDArray[np.float64]
STOPPED = ("blocked", "encoder still", "all still")
KINDS = ("limits", "blocked", "bad samples", "pushed", "turns", "encoder still", "follows", "all still", "limits")
NAMES = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
POLE = 2 * math.pi * 24 / math.sqrt(3 + math.sqrt(10))
"""[1/s] both poles of a velocity loop of 24 Hz."""
SECONDS, LED, BEGINS = 2.0, 4.0, 0.4
"""[s] of a run; of one against limits; at which things begin to go wrong."""
LATE, SLOWEST = 0.1, 10.0
"""[s] of delay, [1/s] of a servo of positions: the worst that are followed."""
LOST = 0.6
"""[s] for which samples are wrong, at most."""
FAST, PUSHED, BACK = 0.05, (0.05, 0.5), 1.0
"""[rad/s] of a joint that is stopped; [s] that a push takes, and until it is made up."""
BEYOND, STILL, RETURNED, ABLE = 1e-3, 5e-4, 5e-3, 0.05
"""[rad] beyond a limit, peak to peak of who stands, left of a push; w / w_max: less able hands swing and wait more."""
TINY = 1e-12
"""[rad] zero."""
CALM, NOISY = 1e-3, 15.0
"""[rad/s, 1/s] sent to who stands: of slow ways, and of noise."""
WAY, PATIENCE = 0.045, 0.15
"""[rad] that a joint that stands is commanded one way, and [s] after that, until it is named; and two ticks."""


class Plan(NamedTuple):
    """What a run is; commands are so many ticks late, `rate` [1/s] is 0 for a velocity loop."""

    kind: str
    dt: float
    late: int
    rate: float
    noise: float
    normal: bool
    arm: SerialChain


class Robot:
    """Joints that are late."""

    def __init__(self, plan: Plan, start: Array) -> None:
        self.dt, self.q, self.under_way = plan.dt, start.copy(), [np.zeros(6) for _ in range(plan.late)]
        self.state, k = np.zeros((2, 6)), plan.rate
        """Speed [rad/s], and by how much the position is behind the commanded one [rad]."""
        loop = [[-k, 0.0], [-1.0, 0.0]] if k else [[-2 * POLE, POLE**2], [-1.0, 0.0]]
        self.fade, self.trails = expm(plan.dt * np.array(loop)), 1 / k if k else 0.0

    def move(self, command: Array) -> None:
        """One tick."""
        self.under_way.append(command)
        arrived = self.under_way.pop(0)
        rest = np.stack([arrived, self.trails * arrived])
        after = rest + self.fade @ (self.state - rest)
        self.q, self.state = self.q + self.dt * arrived + self.state[1] - after[1], after


def draw(rng: np.random.Generator, kind: str, start: Array) -> Plan:
    """A robot."""
    dt, lower, upper = float(rng.choice([1e-3, 2e-3, 5e-3, 1e-2])), -LIMIT, LIMIT
    latest = LATE if kind not in STOPPED and rng.random() < 0.5 else 0.008
    if kind in ("limits", "turns") or rng.random() < 0.3:
        room = rng.uniform(0.02, rng.choice([0.3, 1.0]), (2, 6)) if kind == "limits" else rng.uniform(0.3, 3.0, (2, 6))
        lower, upper = np.maximum(lower, start - room[0]), np.minimum(upper, start + room[1])
    arm = ur5(lower=lower, upper=upper, velocity=rng.uniform(0.5, 3.0, 6), acceleration=rng.uniform(3.0, 20.0, 6))
    rate, noise = (
        rng.choice([0.0, rng.uniform(20.0 if kind in STOPPED else SLOWEST, 120.0)]),
        rng.choice([0.0, rng.uniform(0.0, 2e-4)]),
    )
    late = int(rng.integers(0, round(latest / dt) + 1))
    return Plan(kind, dt, late, float(rate), float(noise), bool(rng.random() < 0.5), arm)


def asked(rng: np.random.Generator, plan: Plan, start: Array) -> tuple[Array, Array, Array]:
    """Poses, twists and the last posture."""
    dt, arm, goal, moving = plan.dt, plan.arm, start.copy(), round(rng.choice([0.0, 1.0]) / plan.dt)
    if plan.kind == "limits":
        room, beyond = rng.uniform(0.02, 0.3, 6), rng.permutation(6)[: rng.integers(1, 4)]
        goal = np.clip(start + rng.uniform(-0.5, 0.5, 6), arm.lower + room, arm.upper - room)
        goal[beyond] = np.where(rng.random(6) < 0.5, arm.upper + room, arm.lower - room)[beyond]
    elif plan.kind != "pushed":
        kind = ("sines", "person", "moving on")[int(rng.integers(3))]
        return *reference(rng, kind, start, round(SECONDS / dt), dt), goal
    part = np.ones(round((LED if plan.kind == "limits" else SECONDS) / dt))
    part[:moving] = minimum_jerk(moving)[:moving]
    way = start + part[:, None] * (goal - start)
    return tool(way), hand_twist(way, np.gradient(way, dt, axis=0) * (part < 1)[:, None]), goal


def spoils(rng: np.random.Generator, plan: Plan, ticks: int) -> Array:
    """(ticks, 6) what is added to samples; all six are put in place of them."""
    spoilt = np.zeros((ticks, 6))
    free = round(BEGINS / plan.dt)
    while plan.kind in ("bad samples", "turns") and (free := free + 1 + int(rng.geometric(0.1))) < ticks:
        lasts = 1 if plan.kind == "turns" or rng.random() < 0.5 else 1 + round(rng.uniform(0, LOST) / plan.dt)
        number = rng.choice([np.nan, np.inf] if plan.kind == "turns" else [np.nan, np.inf, -1.0, 1.0, TINY, TINY])
        spoilt[free : free + lasts, slice(6) if number == TINY else int(rng.integers(6))] = number
        free += lasts + 20
    return spoilt


def one_run(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """One robot."""
    kind, start = KINDS[number % len(KINDS)], good_posture(rng, 0.3)
    plan = draw(rng, kind, start)
    dt, (poses, twists, goal) = plan.dt, asked(rng, plan, start)
    verdict.begin(number, f"{kind}, dt {dt:g}, {plan.late} ticks late, {plan.rate:.0f} /s, noise {plan.noise:.2g}")
    control, twin = (PoseTracker(plan.arm, dt=dt, compile=False) for _ in range(2))
    robot, ticks, joint, able, turns = Robot(plan, start), len(poses), -1, True, 2 * math.pi * rng.integers(-3, 4, 6)
    aside, springs = rng.choice([0.015, 0.05]) * rng.uniform(-1, 1, 6), rng.random() < 0.5
    takes, begins, spoilt = rng.uniform(*PUSHED), round(BEGINS / dt), spoils(rng, plan, ticks)
    push = np.diff(minimum_jerk(round(takes / dt) + 1))
    true, last, told = np.empty((ticks + 1, 6)), np.zeros(6), start
    wrong, commands = np.zeros(ticks, dtype=bool), list[Command]()
    for k in range(ticks):
        true[k], before = robot.q, told
        told = robot.q + plan.noise * (rng.standard_normal(6) if plan.normal else rng.uniform(-1, 1, 6))
        wrong[k], told = spoilt[k].any(), (0 if spoilt[k].all() else told) + spoilt[k]
        if joint < 0 and k >= begins and np.abs(last).max() > FAST:
            joint = int(np.argmax(np.abs(last)))
        wrong[k] |= joint >= 0 and kind in STOPPED
        if wrong[k] and kind in ("encoder still", "all still"):
            told = np.where((np.arange(6) == joint) | (kind == "all still"), before, told)
        commands.append(control.step(told, poses[k], twists[k]))
        last = commands[-1].value
        able = able and manipulability(robot.q[None])[0] > ABLE
        if kind == "turns" and able:  # singular postures amplify what a turn rounds
            apart = np.abs(twin.step(told + turns, poses[k], twists[k]).value - last)
            verdict.within("away from the command of other turns [rad/s]", apart, 1e-9)
        robot.move(last)
        if wrong[k] and kind == "blocked":
            robot.q[joint] = true[k, joint]
        if kind == "pushed" and 0 <= k - begins < len(push):
            robot.q = robot.q + push[k - begins] * aside
            robot.state[1] -= springs * push[k - begins] * aside
    true[ticks] = robot.q
    answers = verdict.answers(commands, dt)
    value, last = answers.value, np.vstack([np.zeros(6), answers.value[:-1]])
    hard = np.abs(value - last) / (plan.arm.acceleration * dt)
    verdict.within("joint speed", np.abs(value) / plan.arm.velocity, 1 + 1e-12)
    verdict.within("change of speed that is not flagged", hard * (answers.relaxed & 2 == 0)[:, None], 1 + 1e-9)
    safe, tells = np.isin(answers.status, ("braking", "holding")), np.char.find(answers.reason, "does not follow") >= 0
    broken_number = wrong if kind == "turns" else np.zeros(ticks, dtype=bool)
    verdict.within("change of speed where a number is missing", hard[broken_number], 1 + 1e-9)
    verdict.holds("who follows is not said not to", ~tells | wrong)
    verdict.holds("what can be is acted on", ~safe | wrong | tells)
    if kind == "limits":
        limits(verdict, plan, true, value)
    elif kind in STOPPED and joint >= 0:
        stopped(verdict, plan, value, [each.reason for each in commands], int(np.argmax(wrong)), joint)
    elif kind == "bad samples":
        verdict.holds("what cannot be is braked for", ~wrong | (safe & (answers.reason != "")))
        gains = np.abs(value - last / 2) > np.abs(last / 2) + 1e-12
        verdict.holds("no joint gains speed by it or turns round", ~gains | ~wrong[:, None])
        verdict.during("a bad sample in motion", wrong & (np.abs(last).max(axis=1) > FAST), dt)
    elif kind == "pushed":
        back = np.arange(ticks) * dt > BEGINS + takes + BACK
        verdict.within("left of a push [rad]", np.abs(true[:-1] - goal).max(axis=1) * back, RETURNED)
        verdict.during("back after a push", back, dt)
    for situation, there in (("other turns", kind == "turns"), ("a servo of positions", plan.rate > 0),
                             ("later than 8 ms", plan.late * dt > 0.0081), ("noise", plan.noise > 0)):  # fmt: skip
        verdict.during(situation, np.full(ticks, there), dt)


def limits(verdict: Verdict, plan: Plan, true: Array, value: Array) -> None:
    """Who is led against limits."""
    beyond, second = np.maximum(true - plan.arm.upper, plan.arm.lower - true), round(1 / plan.dt)
    able = manipulability(true).min() > ABLE
    verdict.within("a joint beyond its limit [rad]", beyond, BEYOND if able else 3 * BEYOND)
    before, after = true[-2 * second : -second].reshape(2, -1, 6).mean(axis=1)
    if np.abs(after - before).max() < STILL and able:
        verdict.within("peak to peak of who stands at limits [rad]", np.ptp(true[-second:], axis=0), STILL)
        verdict.within("speed sent to who stands [rad/s]", np.abs(value[-second:]), CALM + NOISY * plan.noise)
        verdict.during("stands at a limit", beyond[-second:].max(axis=1) > -1e-3, plan.dt)


def stopped(verdict: Verdict, plan: Plan, value: Array, reasons: list[str], first: int, joint: int) -> None:
    """Who stands, or is said to, from a tick on, while it is commanded."""
    tells, dt, every = np.array(["does not follow" in each for each in reasons]), plan.dt, plan.kind == "all still"
    named = int(np.argmax(tells)) if tells.any() else len(value)
    way, long, longest = np.zeros((3, 6))
    for each in value[first:named]:
        way = np.where(way * each < 0, 0.0, way) + dt * each
        long = np.where(np.abs(way) > WAY, long + dt, 0.0)
        longest = np.maximum(longest, long)
    judged = longest.max() if every else longest[joint]
    verdict.within("commanded after that way, until it is named [s]", judged, PATIENCE + 2 * dt)
    if tells.any():
        rests = named + math.ceil(float((np.abs(value[named - 1]) / plan.arm.acceleration).max()) / dt - 1e-6)
        verdict.holds("the joint that stands is named", every or NAMES[joint] in reasons[named])
        verdict.holds("who is named rests in time", ~value[rests:].any(axis=1))
        verdict.holds("it stays named", tells[named:])
    verdict.during(f"{plan.kind}, named", tells, dt)


run = judging(__name__, LEAST, Runs(one_run))
