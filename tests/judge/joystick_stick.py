"""A two-axis stick: what it asks for is no more than was shown, and nothing before it was let go.

Judged against a model of its own: the round dead zone by hypot, the change of deflection a tick, presses of two buttons
counted with the debounce. Deflections come as people move them, with tremor and with numbers that are none.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rehab_opt import Joystick
from tests.judge.numbering import Runs, judging, run_length
from tests.judge.references import reaches, tremor
from tests.judge.verdict import Verdict

GUARANTEES = ("G15",)
LEAST = {"moving": 57_000, "in the dead zone": 50_000, "to be let go first": 5000, "numbers that are none": 518,
         "mode changed": 500, "rate limited": 9000, "gripper changed": 1000}  # fmt: skip
CI_TICKS = 10_000
SHARE = 0.3
DEBOUNCE = 0.15
"""[s] A contact that opens for less is one that bounces."""
MODES = (
    ("plane", ("x", "y"), (0.25, 0.2)),
    ("lift", ("z", "roll7"), (0.15, -0.6)),
    ("turn", ("y", "roll7"), (0.1, 0.5)),
)


def one_run(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """One stick."""
    dt, dead, rate = (
        float(rng.choice([1e-3, 0.01, 0.02])),
        float(rng.choice([0.0, 0.05, 0.12, 0.3])),
        rng.uniform(0.5, 8),
    )
    stick = Joystick(MODES, dt=dt, dead_zone=dead, rate=rate)  # type: ignore[arg-type]
    ticks = run_length(rng, number, dt)
    verdict.begin(number, f"dead zone {dead:g}, dt {dt:g}")
    axes = reaches(rng, np.zeros(2), ticks, dt, size=1.4) + tremor(rng, ticks, dt, size=0.05, axes=2)
    axes *= (np.cumsum(rng.random(ticks) < dt / 0.7) % 3 != 2)[:, None]  # let go now and then
    bad = rng.random(ticks) < 0.003
    axes[bad, 0] = rng.choice([math.nan, math.inf, -math.inf], int(bad.sum()))
    axes[rng.random(ticks) < 0.002, 1] = 1e300
    pressed = (np.cumsum(rng.random(ticks) < dt / 0.5) % 5 == 4).tolist()
    grip = (np.cumsum(rng.random(ticks) < dt / rng.choice([0.1, 0.7])) % 3 == 2).tolist()  # some faster than contacts
    both = zip(axes, pressed, grip, strict=True)
    found = [stick.step(each, switch=down, gripper=held) for each, down, held in both]
    twist, modes = np.array([each.twist for each in found]), [each.rows for each in found]
    names: list[tuple[str, ...]] = [mode[1] for mode in MODES]
    mode = np.array([names.index(rows) for rows in modes])
    speeds = np.array([each[2] for each in MODES])[mode]
    reason = np.array([each.reason for each in found])
    verdict.ticks += ticks

    bad |= ~np.isfinite(axes).all(axis=1)
    shown = np.clip(np.where(bad[:, None], 0.0, axes), -1, 1)
    size = np.hypot(*shown.T)
    fraction = np.where(size > dead, np.minimum((size - dead) / (1 - dead), 1), 0.0)
    want = shown * (fraction / np.maximum(size, 1e-12))[:, None]
    changed = np.r_[False, np.diff(mode) != 0]
    free, may = False, np.zeros(ticks, dtype=bool)
    for k in range(ticks):  # let go since the beginning, the last fault and the last change of mode
        free = False if bad[k] or changed[k] else free
        free = free or (not bad[k] and fraction[k] == 0)
        may[k] = free
    want = np.where(may[:, None], want, 0.0)
    given = twist / speeds
    verdict.holds("what is asked for is finite", np.isfinite(twist))
    verdict.holds("nothing is asked for before the stick was let go, nor by a fault", (twist == 0).all(axis=1) | may)
    verdict.holds("letting go stops at once", (twist == 0).all(axis=1) | want.any(axis=1))
    verdict.holds("why nothing is asked for is told", (reason != "") == (bad | ~may))
    before = np.vstack([np.zeros(2), given[:-1]])
    before = np.where(changed[:, None], np.nan, before)
    step = np.linalg.norm(given - before, axis=1)
    moving = want.any(axis=1) & ~changed
    verdict.within("change of deflection over its rate", np.where(moving, step / (rate * dt), 0.0), 1 + 1e-9)
    left = np.linalg.norm(want - before, axis=1)
    model = np.where(
        (left <= rate * dt)[:, None], want, before + (want - before) * (rate * dt / np.maximum(left, 1e-12))[:, None]
    )
    verdict.within(
        "deflection away from a model of its own", np.where(moving[:, None], np.abs(given - model), 0.0), 1e-9
    )
    turn = np.diff(mode, prepend=0) % len(MODES)
    verdict.holds("the switch goes round by one", turn <= 1)
    starts = np.flatnonzero(np.diff(np.r_[pressed[:1], pressed].astype(int)) == 1)
    verdict.within("changes of mode over presses", int((turn == 1).sum()), len(starts))
    told = np.array([each.gripper_closed for each in found])
    verdict.holds("the gripper changes once a press", told == closed(grip, dt))
    verdict.during("gripper changed", np.r_[False, told[1:] != told[:-1]], dt)
    kinds = {"twist": np.ndarray, "rows": tuple, "frame": str, "gripper_closed": bool, "reason": str}
    typed = [all(type(getattr(each, name)) is kind for name, kind in kinds.items()) for each in found]
    verdict.holds("what comes back has the types that are documented", typed)
    verdict.holds("a twist cannot be written to", [not each.twist.flags.writeable for each in found])
    verdict.holds("the frame is the chair's", [each.frame == "chassis" for each in found])
    verdict.during("moving", twist.any(axis=1), dt)
    verdict.during("in the dead zone", fraction == 0, dt)
    verdict.during("to be let go first", reason == "the stick must be released first", dt)
    verdict.during("numbers that are none", bad, dt)
    verdict.during("mode changed", changed, dt)
    verdict.during("rate limited", moving & (left > rate * dt), dt)


def closed(grip: list[bool], dt: float) -> NDArray[np.bool_]:
    """(N,) whether presses so far have closed the gripper: each once, if the button was still for the debounce before.

    One that is down from the beginning is stuck, not pressed.
    """
    found, is_closed, down, quiet = np.zeros(len(grip), dtype=bool), False, grip[0], math.ceil(DEBOUNCE / dt)
    still = quiet
    for k, now in enumerate(grip):
        is_closed ^= now and not down and still >= quiet
        still, down = 0 if now != down else still + 1, now
        found[k] = is_closed
    return found


run = judging(__name__, LEAST, Runs(one_run))
