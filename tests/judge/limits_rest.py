"""Where a hand comes to rest that is led to a pose which the arm may not have: at the nearest one that it may.

Hands stand after `HELD`. Only where no motion that is left changes half the squared error to first order, and one
hardly to second (2e-4 m^2/rad^2 was seen, near a saddle), descent takes as long as that is flat: who goes on then is
waited for up to `WAITED`, stands for a second like all others, no further from the pose than before; and this is rare.

`PoseTracker` and `MirrorTracker` with joint limits, limits of a user's own, several distances in each, a plane
below a probe on the arm and the manipulability floor, all drawn around the start. Judged: each distance in every tick,
also while braking; and that the hand stands in the end, where no motion that the active limits leave leads
it nearer (the multipliers of the judge's own gradients, by non-negative least squares), places and turns weighed as was
asked.

Not judged at rest: four distances of one limit, or four points and the plane, that are met at once, of which the
three least make rows.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from rehab_opt import Command, MirrorTracker
from tests.judge.limited_arms import Arm, draw
from tests.judge.numbering import Runs, judging
from tests.judge.references import minimum_jerk
from tests.judge.ur5_numbers import hand_twist, jacobian, manipulability, tool, turn_between
from tests.judge.verdict import Verdict

GUARANTEES = ("G07",)
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
WAITED, SELDOM, MANY = 40.0, 0.02, 200_000
"""[s] for which a hand that goes on after `HELD` is waited for; largest share of ticks waited, of at least so many."""
STILL, NEAREST = 5e-3, 1e-3
"""[rad/s] of a joint, and [m^2/rad] of half the squared error: what the slowest motions leave after `HELD`.

Where several limits meet, one of them curved, `MirrorTracker` was seen to go on at 1e-5 rad/s for 20 s and more."""
CURVED = 2.0
"""Factor on `NEAREST` where a `PoseTracker` rests at a curved limit, which steps along its tangent would pass."""
LEAST_W = 0.05
"""Of w / w_max: nearer to singular postures the last of a way takes longer than is waited for."""
STANDING = ("ok", "backup", "blocked")
ACTIVE = 2e-3
"""[rad, m] before a limit it is active: a user's own is met a square of the joints' way in a tick before it."""


def one_run(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """One arm, one pose."""
    of = draw(rng, mirror=number % 2 == 0)
    dt, start = of.dt, of.start
    verdict.begin(number, f"{'mirror' if of.mirror else 'tracker'}, dt {dt:g}, {len(of.wishes)} own limits")
    away = rng.standard_normal(6)
    if of.beside is not None and rng.random() < 0.7:  # into the plane
        away = -np.linalg.pinv(jacobian(start[None])[0, :3]) @ of.beside.normal
    elif rng.random() < 0.4:  # to where the arm is less able
        away = 0.3 * away / np.linalg.norm(away) - _slope(manipulability, start)
    goal = start + float(rng.uniform(0.1, 0.4)) * away / np.linalg.norm(away)
    ticks = round((MOVING + HELD) / dt)
    part = np.r_[minimum_jerk(round(MOVING / dt)), np.ones(ticks - round(MOVING / dt))]
    way = start + part[:, None] * (goal - start)
    poses, twists = tool(way), hand_twist(way, np.gradient(way, dt, axis=0))
    at, commands = [start], list[Command]()
    first = int(rng.integers(ticks // 4)) if rng.random() < 0.4 else ticks
    for k in range(ticks + round(WAITED / dt)):
        if k == ticks and not (is_judged(of, at, commands, poses[-1]) and _fastest(commands[-1:]) > STILL):
            break
        if k > ticks + 50 and _fastest(commands[-50:]) <= STILL:
            break
        then = min(k, ticks - 1)
        commands.append(of.control.step(at[-1], poses[then], twists[then], enable=not first <= k < first + 0.3 / dt))
        at.append(at[-1] + dt * commands[-1].value)
    q, answers = np.array(at), verdict.answers(commands, dt)
    ok = np.isin(answers.status, STANDING)
    in_every_tick(verdict, of, q, answers.value, ok)
    if is_judged(of, at, commands, poses[-1]):
        at_rest(verdict, of, q, answers.value, poses[-1])
        verdict.during("goes on for longer", np.arange(len(commands)) >= ticks, dt)
        if len(commands) > ticks:
            before, after = (_squared_error(of, each, poses[-1]) for each in q[[ticks, -1]])
            verdict.within("who goes on comes nearer, squared error", after, before)


def seldom_waited(verdict: Verdict) -> None:
    """Of all ticks."""
    waited = verdict.count("goes on for longer") / max(verdict.ticks, MANY)
    verdict.within("ticks of hands that go on for longer, of all", waited, SELDOM)


def is_judged(of: Arm, at: list[Array], commands: list[Command], asked: Array) -> bool:
    """Whether the hand is led to the pose `asked` (4, 4) and judged at rest, having come through the postures `at`."""
    q = np.array(at)
    if any(each.status.value not in STANDING for each in commands[-50:]):
        return False
    if isinstance(of.control, MirrorTracker):
        led = float(np.abs(of.control.reference - asked).max()) < 1e-9  # a lag of a reference that rests is none
        if not led or manipulability(q).min() < LEAST_W:
            return False
    below, active = _met(of, q)
    return len(below) <= 3 and not any(each.sum() > 3 for each in active)


def in_every_tick(verdict: Verdict, of: Arm, q: Array, value: Array, ok: NDArray[np.bool_]) -> None:
    """Distances and barriers on the way."""
    near = np.zeros(len(value), dtype=bool)
    for each in of.wishes:
        numbers = each.numbers(q, of.start)
        verdict.within("a user's distance below zero", -numbers, 1e-9)
        least, room = numbers[:-1].argmin(axis=1), numbers[:-1].min(axis=1)
        verdict.during("another distance is the least one", least != least[0], of.dt)
        near |= room < 0.02
    if of.beside is not None:
        verdict.within("the probe, or a frame's origin, below the plane [m]", -of.beside.heights(q), 1e-9)
    verdict.during("braking near a limit", ~ok & near, of.dt)


def at_rest(verdict: Verdict, of: Arm, q: Array, value: Array, asked: Array) -> None:
    """Where the hand stands in the end, led to the pose `asked` (4, 4)."""
    last, dt, resting = q[-1], of.dt, np.ones(len(value), dtype=bool)
    below, active = _met(of, q)
    slopes = {
        "a joint limit is active at rest": [
            *np.eye(6)[last < of.lower + ACTIVE], *-np.eye(6)[last > of.upper - ACTIVE]
        ],
        "a user's limit is active at rest": [
            slope for each, met in zip(of.wishes, active, strict=True) for slope in each.slopes(q[-1:])[0][met]
        ],
        "the plane is active at rest": [
            _slope(lambda at, i=i: of.beside.heights(at)[:, i], last) for i in below  # type: ignore[union-attr]
        ],
        "the floor is active at rest": [_slope(manipulability, last)]
        if of.mirror and manipulability(q[-1:])[0] < of.floor + ACTIVE else [],
    }  # fmt: skip
    gradients = [slope for each in slopes.values() for slope in each]
    downhill = jacobian(q[-1:])[0].T @ (of.weights * _error(last, asked))
    left = nnls(-np.column_stack(gradients), downhill)[1] if gradients else float(np.linalg.norm(downhill))
    verdict.within("joint speed at rest [rad/s]", np.abs(value[-1]), STILL)
    curved = not of.mirror and any(each[-1] for each in active)
    verdict.within("a nearer pose is left aside, gradient", left, NEAREST * (CURVED if curved else 1))
    verdict.during(f"{'mirror' if of.mirror else 'tracker'}, at rest beyond a limit", resting & bool(gradients), dt)
    verdict.during("several are active at rest", resting & (len(gradients) > 1), dt)
    for i, many in enumerate(("two", "three"), 2):
        verdict.during(f"{many} of one limit are active at rest", resting & any(each.sum() >= i for each in active), dt)
    for situation, found in slopes.items():
        verdict.during(situation, resting & bool(found), dt)


def _met(of: Arm, q: Array) -> tuple[list[int], list[NDArray[np.bool_]]]:
    """Points that the last of these postures has at the plane, and each limit's distances that it is at."""
    below = [] if of.beside is None else np.flatnonzero(of.beside.heights(q[-1:])[0] < ACTIVE).tolist()
    return below, [each.numbers(q[-1:], of.start)[0] < ACTIVE for each in of.wishes]


def _fastest(commands: list[Command]) -> float:
    """[rad/s] of any joint."""
    return max(float(np.abs(each.value).max()) for each in commands)


def _error(q: Array, asked: Array) -> Array:
    """(6,) [m, rad] from the hand to the pose."""
    here = tool(q[None])
    turn = turn_between(asked[None, :3, :3], here[:, :3, :3])[0]
    return np.concatenate([asked[:3, 3] - here[0, :3, 3], turn])


def _squared_error(of: Arm, q: Array, asked: Array) -> float:
    """[m^2] as it is weighed."""
    return float(of.weights @ _error(q, asked) ** 2)


def _slope(height: Any, q: Array, step: float = 1e-6) -> Array:
    """(6,) by finite differences."""
    return np.asarray((height(q + step * np.eye(6)) - height(q - step * np.eye(6))) / (2 * step))


run = judging(
    __name__,
    LEAST,
    Runs(one_run),
    finish=(
        seldom_waited,
        Verdict.seldom_beyond_the_dual_method,
    ),
)
