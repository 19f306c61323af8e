"""A switch, or sip and puff: only the lit option moves, only while it is pressed, and how fast.

Judged against a model of its own: which option is lit when, from when on a press counts, and how the speed grows.
"""

from __future__ import annotations

import math

import numpy as np

from rehab_opt.control.scanning import Scanning
from tests.judge.joystick_stick import MODES
from tests.judge.numbering import Runs, judging, run_length
from tests.judge.verdict import Verdict

GUARANTEES = ("G15",)
LEAST = {"moving": 50_000, "gripper changed": 100, "to be let go first": 500, "numbers that are none": 500,
         "between threshold and letting go": 5000}  # fmt: skip
CI_TICKS = 12_000
SHARE = 0.2
WAVERS = 0.7
DEBOUNCE = 0.15
USUAL = 0.3
"""Threshold where none is told."""
NO_NUMBERS = (math.nan, math.inf, -math.inf, "1.0", None, b"1")


def options(sip: bool) -> list[tuple[str, tuple[str, ...], int, float]]:
    """Name, rows, axis and speed of each option but the gripper."""
    found, known = [], set()
    for _, rows, speeds in MODES:
        for axis, row in enumerate(rows):
            if row not in known:
                known.add(row)
                signs = [("", 1.0)] if sip else [("+", 1.0), ("-", -1.0)]
                found += [(row + suffix, rows, axis, sign * speeds[axis]) for suffix, sign in signs]
    return found


def pressures(rng: np.random.Generator, ticks: int, dt: float, threshold: float, sip: bool) -> np.ndarray:
    """Presses of 0.2 to 2 s of wavering strength, with bounces, now and then none that is a number."""
    found = np.full(ticks, 0.0, dtype=object)
    k = int(rng.uniform(0.0, 1.0) / dt)
    while k < ticks:
        lasts, way = max(round(rng.uniform(0.2, 2.0) / dt), 2), -1.0 if rng.random() < (0.5 if sip else 0.1) else 1.0
        strength = threshold * rng.choice([0.6, 0.75, 0.95, 1.0, 1.3, 2.0], lasts, p=[0.03, 0.1, 0.1, 0.17, 0.3, 0.3])
        strength[0] = threshold * rng.choice([0.8, 1.0, 1.5])
        found[k : k + lasts] = (way * strength)[: ticks - k]
        k += lasts + int(rng.uniform(0.02, 1.5) / dt)
    for k in np.flatnonzero(rng.random(ticks) < 0.002):
        found[k] = NO_NUMBERS[rng.integers(len(NO_NUMBERS))]
    return found


def one_run(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """One switch."""
    dt, dwell = float(rng.choice([0.01, 0.02])), float(rng.choice([0.05, 0.2, 1.0]))
    sip, threshold, rate = bool(rng.random() < 0.5), float(rng.choice([0.2, USUAL, 0.5])), rng.uniform(1.0, 8.0)
    besides = {} if threshold == USUAL else {"threshold": threshold}
    switch = Scanning(MODES, dt=dt, dwell=dwell, sip=sip, rate=rate, **besides)  # type: ignore[arg-type]
    ticks = run_length(rng, number, dt)
    verdict.begin(number, f"dt {dt:g}, dwell {dwell:g}{', sip' * sip}")
    given, moves = pressures(rng, ticks, dt, threshold, sip), options(sip)
    lit = np.empty(ticks, dtype=object)
    found = []
    for k in range(ticks):
        lit[k] = switch.lit.name
        found.append(switch.step(given[k]))
    verdict.ticks += ticks

    way = at = shown = 0
    free, closed, size, bounce = False, False, 0.0, math.ceil(DEBOUNCE / dt)
    quiet, down = {1: bounce, -1: bounce}, dict[int, bool | None]({1: None, -1: None})
    expected = np.zeros((ticks, 2))
    names, rows, reasons, grips, wavering = [], [], [], [], np.zeros(ticks, dtype=bool)
    for k, value in enumerate(given):
        bad = not isinstance(value, float) or not math.isfinite(value)
        strength = 0.0 if bad else abs(value) if sip or value > 0 else 0.0
        side = -1 if not bad and sip and value < 0 else 1
        wavering[k] = way == side and WAVERS * threshold <= strength < threshold
        way = side if strength >= threshold * (WAVERS if way == side else 1.0) else 0
        names.append([*moves, ("gripper",)][at][0])
        reason, acts = "", way
        if way == 0:
            free = not bad
            reason = "pressure is not finite" if bad else ""
            shown += 1
            if shown >= math.ceil(dwell / dt):
                at, shown = (at + 1) % (len(moves) + 1), 0
        elif not free:
            acts, reason = 0, "the switch must be let go first"
        else:
            shown = 0
        for each in (1, -1):
            now = acts == each
            begins = now and down[each] is False and quiet[each] >= bounce
            quiet[each] = 0 if down[each] is not None and now != down[each] else quiet[each] + 1
            down[each] = now
            closed ^= begins and at == len(moves)
        if acts and at < len(moves):
            size = acts * min(size * acts + rate * dt, 1.0)
            expected[k, moves[at][2]] = size * moves[at][3]
        else:
            size = 0.0
        rows.append(moves[at][1] if at < len(moves) else MODES[0][1])
        reasons.append(reason)
        grips.append(closed)
    twist = np.array([each.twist for each in found])
    verdict.holds("the lit option is the one whose turn it is", lit == np.array(names, dtype=object))
    verdict.within("twist away from a model of its own [m/s]", np.abs(twist - expected), 1e-9)
    verdict.holds("rows are those of the lit option", [each.rows == one for each, one in zip(found, rows, strict=True)])
    verdict.holds(
        "why nothing is asked for is told", [each.reason == one for each, one in zip(found, reasons, strict=True)]
    )
    told = np.array([each.gripper_closed for each in found])
    verdict.holds("the gripper changes once a press", told == np.array(grips))
    verdict.holds("the frame is the chair's", [each.frame == "chassis" for each in found])
    verdict.during("moving", twist.any(axis=1), dt)
    verdict.during("gripper changed", np.r_[False, np.diff(told.astype(int)) != 0], dt)
    reason = np.array(reasons)
    verdict.during("to be let go first", reason == "the switch must be let go first", dt)
    verdict.during("numbers that are none", reason == "pressure is not finite", dt)
    verdict.during("between threshold and letting go", wavering, dt)


run = judging(__name__, LEAST, Runs(one_run))
