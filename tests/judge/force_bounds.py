"""Size and slew of an assisting force, what faults and the dead-man switch do to it, and what it says of itself.

Judged in every tick. A slew beyond its bound must be flagged, with a reason; without jumps, with energy left and
without faults there is none. A force that every bound has room for is the wanted one. A state is of use up to the age
that goes with the tick.
"""

from __future__ import annotations

import math

import numpy as np

from rehab_opt import BoundedForce
from tests.judge.force_runs import Run, followed
from tests.judge.numbering import Runs, judging
from tests.judge.sensor_faults import STAMPS, expected, gaps
from tests.judge.verdict import Verdict

GUARANTEES = ("G01", "G05", "G21")
LEAST = {"solver closed form": 4.5e5,
         "at the force limit": 2000, "at the slew limit": 14_000, "held back by its growth": 5000, "relaxed slew": 50,
         "wanted in full": 14_000, "status releasing": 81, "status released": 5000, "reason not enabled": 300,
         "reason x is (#, #), not a valid position": 300,
         "held back by energy": 300, "a gap just too long": 800, "a gap not quite too long": 800}  # fmt: skip
CI_TICKS = 24_000
GAPS, NEAR = 20, 1e-3
"""Ticks of a run of stamps with gaps; by which part of the largest age these are longer or shorter than that."""
VELOCITY_LAG, LAGS = 0.01, 4
"""[s] of the estimated velocity, as documented; a hand that was faster than the cap no longer ago may be let go yet."""


def stamps_apart(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """Where nobody says how old a state may be, of a tick of any length: gaps just below that, and just above."""
    dt = float(10 ** rng.uniform(-3.0, -0.7))
    gap = max(0.05, 3 * dt) * rng.choice([1 - NEAR, 1 + NEAR], GAPS)
    gap[rng.random(GAPS) < 0.3] = dt
    control = BoundedForce(lambda *_: (1.0, 0.0), dt=dt, trust_stillness=True, compile=False)
    verdict.begin(number, f"stamps with gaps, dt {dt:g}")
    answers = verdict.answers([control.step(np.zeros(2), stamp=stamp) for stamp in np.cumsum(gap).tolist()], dt)
    long, refused = gap > max(0.05, 3 * dt), np.isin(answers.status, ("releasing", "released"))
    long[0] = False  # nothing comes before
    verdict.holds("a state older than three ticks and 50 ms is not acted on", refused | ~long)
    verdict.holds("a state younger than three ticks or 50 ms is acted on", ~refused | long, str(set(answers.reason)))
    verdict.during("a gap just too long", long, dt)
    verdict.during("a gap not quite too long", ~long & (gap > dt), dt)


def judge(verdict: Verdict, one: Run) -> None:
    """Every bound of the force in every tick."""
    given, dt = one.settings, one.settings.dt
    answers = verdict.answers(one.commands, dt)
    force, reasons, status = answers.value, answers.reason, answers.status
    size = np.linalg.norm(force, axis=1)
    last = np.vstack([np.zeros(2), force[:-1]])
    step = given.slew_limit * dt
    change = np.linalg.norm(force - last, axis=1)
    verdict.holds("the command is finite", np.isfinite(force))
    verdict.within("force over its limit", size / given.force_limit, 1.0)
    felt = np.zeros(len(size))  # the largest force of late, of which half of the limit fades in a second
    for k in range(1, len(size)):
        felt[k] = max(size[k - 1], felt[k - 1] - 0.5 * given.force_limit * dt)
    grown = felt + given.growth_limit * dt
    verdict.within("force over what it may grow to", size / grown, 1 + 1e-9)
    verdict.during("held back by its growth", (size > 0.999 * grown) & (size < 0.999 * given.force_limit), dt)
    slewed = answers.relaxed & 8 != 0
    verdict.within("change of force over the slew bound", np.where(slewed, 0.0, change / step), 1 + 1e-9)
    verdict.holds("what is flagged is a release at once", ~slewed | ((size == 0) & (change > step * (1 - 1e-12))))
    sudden = np.isin(reasons, ("energy left does not afford a slower release", "hand moves at # m/s, at most # m/s",
                               "position moved # m in # s, at most # m/s"))  # fmt: skip
    verdict.holds("a release at once has its reason", ~slewed | sudden)
    told_fast = np.linalg.norm(np.nan_to_num(one.velocity), axis=1) > given.speed_cap
    jumped = np.r_[False, one.fast[:-1]] | told_fast
    dear = reasons == "energy left does not afford a slower release"
    quiet = one.faults.kind == ""  # after bad stamps a gap in them comes first, and then what was moved meanwhile
    strange = sudden & ~dear & quiet & np.r_[True, quiet[:-1]] & np.r_[True, True, quiet[:-2]]
    lately = np.convolve(jumped, np.ones(math.ceil(LAGS * VELOCITY_LAG / dt) + 1))[: len(size)] > 0
    verdict.holds("a hand is let go for its speed where it was fast", ~strange | lately)
    safe = np.isin(status, ("releasing", "released"))
    wrong = expected(one.faults) & ~((one.faults.kind == "v") & np.isnan(one.velocity[:, 0]))
    verdict.holds("what cannot be used is not acted on", safe | ~wrong)
    sound = one.faults.kind == ""
    # After a rest so exact that a sensor may have been frozen, a jump counts as the motion of all that time.
    still = np.r_[True, (np.diff(one.x[: len(force)], axis=0) == 0).all(axis=1)]
    rested = np.r_[False, still[:-1]] & ~told_fast
    # Nor is a hand seen in the first tick whose stamp is right again, where that is a gap.
    seen = sound & ~gaps(one.faults, max(0.05, 3 * dt))
    verdict.holds("a fast hand is let go", (size == 0) | ~jumped | rested | ~seen | np.r_[True, ~seen[:-1]])
    words = reasons.astype(str)
    short = np.char.startswith(words, "little energy is left") | np.char.startswith(words, "the position repeats")
    verdict.holds("a release has its reason, a plain answer none", (reasons != "") == ((status != "ok") | short))
    verdict.holds("released is no force, releasing is one", (status == "released") == (safe & (size == 0)))
    fallen = np.maximum(np.linalg.norm(last, axis=1) - step, 0.0)
    verdict.within("force while it is released [N]", np.where(safe, size - fallen, 0.0), 1e-9)
    turned = np.abs(last[:, 0] * force[:, 1] - last[:, 1] * force[:, 0])
    verdict.within("turn of a force that is released [N^2]", np.where(safe, turned, 0.0), 1e-8)
    calm = sound & np.r_[True, sound[:-1]] & np.r_[True, True, sound[:-2]] & ~lately & ~dear
    verdict.holds("sound inputs are acted on again", ~safe | ~calm, str(set(reasons[safe & calm])))

    # A hand that stood under force along a path is let go by a force that fades, of which nothing is wanted any more.
    stood = np.char.startswith(words, "the hand stood under force")
    safe, asked, flagged = safe | stood, one.desired_force, answers.relaxed & 4 != 0
    need, off = np.linalg.norm(asked, axis=1), np.linalg.norm(force - asked, axis=1)
    verdict.holds("a force other than the wanted one is flagged", flagged | (off <= 1.001e-6 * need + 2e-12) | safe)
    verdict.holds("what is flagged is another force", ~flagged | (off > 0.999e-6 * need + 0.9e-12) | safe)
    along = np.clip(np.einsum("ni,ni->n", force, asked) / np.maximum(need, 1e-12) ** 2, 0, 1)
    enough = 1e-3 * np.minimum(1.0, given.force_limit / np.maximum(need, 1e-12))
    sure = np.abs(along / enough - 1) > 1e-6  # but for rounding
    nothing = flagged & (need > 1e-12) & (along <= enough) & ~safe
    told = np.where(safe | nothing, 0.0, np.where(flagged & (need > 1e-12), along, 1.0))
    verdict.within("error of the scale", np.where(sure, np.abs(answers.scale - told), 0.0), 1e-9)
    verdict.holds("blocked is a force of which nothing is left", ((status == "blocked") == (nothing | stood)) | ~sure)
    verdict.during("nothing is left of the wanted force", nothing, dt)
    room = (need < 0.999 * np.minimum(given.force_limit, grown)) & (np.linalg.norm(asked - last, axis=1) < 0.999 * step)
    pieces = math.ceil(1.3 * 6.0 * given.unsure / dt) + 1 if given.unsure else 0  # that may still be under way
    total = np.cumsum(np.r_[np.zeros(pieces + 1), np.linalg.norm(last, axis=1) * np.r_[dt, one.seconds[:-1]]])
    under_way = total[pieces + 1 :] - total[1 : len(total) - pieces]
    draws = under_way + need * max(0.05, 3 * dt) + need**2 / given.slew_limit
    timed = np.convolve(np.isin(one.faults.kind, STAMPS), np.ones(pieces + 2))[: len(size)] == 0  # else no time went by
    rich = (one.left > given.speed_cap * draws) & (timed | (given.unsure == 0.0))
    rich &= one.left > 1.5 * need * given.speed_cap * dt
    verdict.holds("what energy alone holds back has its reason", ~(room & flagged & ~safe) | short)
    verdict.holds("what energy is said to hold back is less than what is wanted", ~short | (size < need))
    verdict.during("held back by energy", short & ~safe, dt)
    verdict.holds("the wanted force is sent where every bound has room for it", ~(room & rich) | safe | ~flagged)

    verdict.during("at the force limit", size > given.force_limit * (1 - 1e-9), dt)
    verdict.during("at the slew limit", change > step * (1 - 1e-9), dt)
    verdict.during("wanted in full", ~safe & ~flagged & (need > 0), dt)
    for name in (f"mode {given.mode}", f"hand {one.hand}"):
        verdict.during(name, np.ones(len(force), dtype=bool), dt)
    for kind in np.unique(one.faults.kind):
        if kind:
            verdict.during(f"fault {kind}", one.faults.kind == kind, dt)


run = judging(
    __name__,
    LEAST,
    Runs(followed(judge), 1 / 2),
    Runs(followed(judge, faults=0.3), 1 / 2, 1_000_000),
    Runs(stamps_apart, 1 / 100, 2_000_000),
    finish=(Verdict.seldom_by_backup,),
)
