"""A hand that something holds: from which following error on that is noticed, and how far it is led on then.

`PoseTracker` with a `JointFeedback` on a UR5 whose joints move as commanded. The hand goes on steadily until the
encoders jump back along its way, as where something stops the arm, and stand. Judged by the judge's own kinematics:
what is less than the sentence's bound is no held hand, what is more is one in the second tick; and how far ahead the
joints are led in the end is the bound's fraction. Where a hand usually is changes a little in those two ticks; two
bounds on the same way tell the fraction without it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rehab_opt import JointFeedback, PoseTracker, ur5
from tests.judge.numbering import Runs, judging
from tests.judge.references import good_posture
from tests.judge.ur5_numbers import jacobian, tool
from tests.judge.verdict import Verdict

Array = NDArray[np.float64]

GUARANTEES = ("G10",)
LEAST = {"held": 200_000, "left behind by less": 20_000, "one sample that lies": 50_000}
CI_TICKS = 1200
SHARE = 0.25
FREE, STANDS = 40, 220
"""Ticks in which the hand goes on steadily, and in which it then is where it was stopped."""
LESS, MORE = 0.97, 1.6
"""Of the bound: what is left behind by the first is none, by the second it is one, also a tick later, when the bound
is more by what the speed has changed."""
HELD = "held back"
ROBOT = {"velocity": np.full(6, 3.0), "acceleration": np.full(6, 300.0)}


def one_run(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """One way of a hand, with two bounds."""
    start, dt = good_posture(rng, 0.3), float(rng.choice([1e-3, 2e-3]))
    way = rng.normal(size=3)
    way *= rng.uniform(0.05, 0.2) / np.linalg.norm(way)
    delay = dt * int(rng.integers(0, 4))
    large = rng.uniform(2e-3, 6e-3)
    verdict.begin(number, f"dt {dt:g}, {np.linalg.norm(way):.2g} m/s, late by {delay:g} s, contact {large:.3g} m")
    ahead, contacts = [], (large, large * rng.uniform(0.4, 0.6))
    for contact in contacts:
        control = PoseTracker(ur5(**ROBOT), dt=dt, linear_speed=1.0, compile=False, feedback=JointFeedback(
            delay=delay, servo_hz=math.inf, correction=1e-3, contact=contact, tolerance=1.0, patience=1e3))  # fmt: skip
        if contact == large:
            for fraction in (LESS, MORE):
                stopped(verdict, control, start, way, contact, fraction, once=fraction == MORE)
        ahead.append(stopped(verdict, control, start, way, contact, MORE * large / contact))
    verdict.within("how far a held hand is led on, over 0.75 contact, away from 1",
                   abs((ahead[0] - ahead[1]) / (0.75 * (contacts[0] - contacts[1])) - 1), 4e-3)  # fmt: skip


def stopped(
    verdict: Verdict,
    control: PoseTracker,
    start: Array,
    way: Array,
    contact: float,
    fraction: float,
    *,
    once: bool = False,
) -> float:
    """[m] how far ahead of the hand the joints are led in the end; of encoders that jump back by so much of the bound.

    The joints swing about that a little: it is the median of the last half.

    Where it is `once`, that is one sample that lies.
    """
    dt, feedback = control.dt, control.feedback
    assert feedback is not None
    under_way = [np.zeros(6) for _ in range(round(feedback.delay / dt))]
    model, measured, off = start.copy(), start.copy(), np.zeros(6)
    control.reset(np.zeros(6))
    first, target = tool(start[None])[0], tool(start[None])[0]
    commands, held, ahead, direction, rows = [], [], [], np.zeros(3), np.zeros((3, 6))
    for k in range(FREE + STANDS):
        target = first.copy()
        target[:3, 3] += way * dt * k
        commands.append(control.step(measured, target, np.r_[way, 0.0, 0.0, 0.0]))
        held.append(HELD in commands[-1].reason)
        under_way.insert(0, commands[-1].value)
        arrived = under_way.pop()
        model = model + dt * arrived
        led = model + dt * np.sum(under_way, axis=0)
        rows = jacobian(led[None])[0][:3]
        if k in (FREE, FREE + 1):  # the way that it is held on is that of the second tick
            direction = rows @ arrived
            direction /= np.linalg.norm(direction)
        if k == FREE:
            lever = min(float(np.linalg.norm(rows.T @ direction)), 1.0)
            off = -np.linalg.pinv(rows) @ direction * fraction * lever * contact
            measured = model + off
        elif k < FREE or once:
            measured = model.copy()
        ahead.append(float(rows @ (model - measured) @ direction))
    verdict.answers(commands, dt)
    verdict.holds("a hand that goes on steadily is not held", not any(held[: FREE + 1]))
    if once or fraction < 1:
        if once:
            verdict.holds("one sample that lies is no held hand", not any(held))
        else:
            verdict.holds("a hand left behind by less than is said is not held", not any(held[: FREE + 3]))
    else:
        verdict.holds("a hand left behind by more than is said is held in the second tick", held[FREE + 2])
    name = "one sample that lies" if once else "left behind by less" if fraction < 1 else "held"
    verdict.during(name, np.arange(len(held)) > FREE, dt)
    return float(np.median(ahead[-STANDS // 2 :]))


run = judging(__name__, LEAST, Runs(one_run))
