"""One side of helper and participant, and messages as networks and other programs send them.

Messages come in turn, not at all, twice, late, and with numbers that nobody can mean. Judged by the judge's own account
of the tank: what each message may give away of it, and, as long as no force has acted, exactly gives; what it takes in;
and what a side does and says in the ticks in between.
"""

from __future__ import annotations

import math

import numpy as np

from rehab_opt import HelperSide, ParticipantSide
from rehab_opt.control.bilateral_sides import FromHelper, FromParticipant
from tests.judge.force_runs import hand_path
from tests.judge.numbering import Runs, judging, run_length
from tests.judge.pair_energy import SOURCE, TARGET, ellipse, mapped
from tests.judge.verdict import Verdict

GUARANTEES = ("G24",)
LEAST = {"no force so far": 100_000, "force": 100_000, "all given at once": 20_000, "message lost": 50_000,
         "message twice": 15_000, "message late": 15_000, "energy that nobody can mean": 15_000,
         "told a place": 100_000, "a full tank": 10_000, "a tank nearly empty": 10_000}  # fmt: skip
CI_TICKS = 1600
SHARE = 0.2
HANDS = ("person", "held", "sudden")
SLEW = 2500.0
"""[N/s] in which a force is released, where nothing is said of it."""
BROKEN = (math.nan, math.inf, -math.inf, -1.0, -1e9, -1e-3, 0.0)


def one_run(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """One side, one hand."""
    helps, dt, hand = number % 2 == 0, float(rng.choice([1e-3, 2e-3, 5e-3])), HANDS[number % len(HANDS)]
    exchange, budget = float(rng.choice([0.0, 5.0, 50.0, 5000.0])), float(rng.choice([0.05, 0.5, 5.0]))
    limit, speed_cap, workspace_map = float(rng.choice([10.0, 30.0])), 1.0, mapped().for_controller()
    unsure = (0.0, 0.003)[number // 2 % 2]  # known to act at once, or not
    bounds = {"dt": dt, "force_limit": limit, "energy_budget": budget, "exchange": exchange, "compile": False,
              "speed_cap": speed_cap, "damping": float(rng.choice([0.0, 2.0])),
              "actuation_uncertainty": unsure}  # fmt: skip
    side: HelperSide | ParticipantSide
    if helps:
        side = HelperSide(workspace_map, **bounds)  # type: ignore[arg-type]
    else:
        side = ParticipantSide(workspace_map, comfortable=ellipse(*TARGET), stiffness=float(rng.choice([50.0, 1000.0])),
                               **bounds)  # type: ignore[arg-type]  # fmt: skip
    verdict.begin(number, f"{'helper' if helps else 'participant'}, {hand}, exchange {exchange:g}, dt {dt:g}")
    ticks = min(run_length(rng, number, dt), 1500)
    centre, other = (SOURCE[1], TARGET[1]) if helps else (TARGET[1], SOURCE[1])
    x = _slowly(centre + 0.3 * hand_path(rng, hand, ticks, dt), 0.9 * speed_cap * dt)
    theirs = other + 0.3 * hand_path(rng, "person", ticks, dt)
    silent = int(rng.integers(ticks // 4, ticks // 2))  # until then they say nothing of where they are
    fraction, filled = min(exchange * dt, 1.0), float(rng.choice([0.001, 0.1, 1.0]))
    kinds = rng.choice(["", "lost", "twice", "late", "broken", "no place"], ticks, p=[0.5, 0.1, 0.1, 0.1, 0.1, 0.1])
    account, moved, newest, last = budget, np.diff(x, axis=0), 0, None
    acted, commands, force = False, [], np.zeros(2)
    most, gave, exact = np.empty(ticks), np.empty(ticks), np.zeros(ticks, dtype=bool)
    (fresh, placed), held, level = np.zeros((2, ticks), dtype=bool), np.empty(ticks), np.empty(ticks)
    for k in range(ticks):
        energy = float(rng.choice([0.0, filled]) * budget * rng.random())
        energy = float(rng.choice(BROKEN)) if kinds[k] == "broken" else energy
        place = (math.nan, math.nan) if k < silent or kinds[k] == "no place" else tuple(theirs[k].tolist())
        push = tuple((0.5 * limit * rng.uniform(-1, 1, 2)).tolist())
        received = FromParticipant(*place, *(push if k >= silent else place), energy, k + 1) if helps else (
            FromHelper(*place, energy, k + 1))  # fmt: skip
        if kinds[k] == "late":
            received = received._replace(serial=int(rng.integers(0, newest + 1)))
        told = None if kinds[k] == "lost" else last if kinds[k] == "twice" else received
        command, message = side.step(x[k], told)  # type: ignore[arg-type]
        if told is not None and told.serial > newest:
            newest, fresh[k] = told.serial, True
            placed[k] = all(map(math.isfinite, told[: 4 if helps else 2]))
            account += min(told.energy, budget) if 0.0 < told.energy < math.inf else 0.0
            account = min(account, budget)
        if told is not None:
            last = told
        account = min(account - float(force @ moved[k - 1]), budget) if k else account
        force, acted = command.value, acted or bool(command.value.any())
        size = math.hypot(*force)  # of which a hand draws so much until it is released, and in a tick before that
        draws = speed_cap * size * (max(0.05, 3 * dt) + size / (2.0 * SLEW))
        most[k], gave[k], exact[k] = fraction * (account - draws), message.energy, not acted
        account -= message.energy
        held[k], level[k] = side.force.energy_left, account
        commands.append(command)
        verdict.holds("messages are numbered in turn", message.serial == k + 1)
        if isinstance(message, FromParticipant):
            verdict.holds("the force that is told is the one that acts", (message.force_x, message.force_y) ==
                          tuple(command.value.tolist()))  # fmt: skip
        if side.force.valid:
            verdict.holds("the place that is told is the hand's", (message.x, message.y) == tuple(x[k].tolist()))
    answers = verdict.answers(commands, dt)
    sizes = np.linalg.norm(answers.value, axis=1)
    rounding = 1e-12 * budget
    verdict.within("energy given beyond its share of the tank [J]", gave - np.maximum(most, 0.0), rounding)
    verdict.within("energy given, below zero [J]", -gave, 0.0)
    verdict.within("energy given away from its share, before any force [J]",
                   np.where(exact, np.abs(gave - most), 0.0), rounding)  # fmt: skip
    verdict.within("energy left, below zero [J]", -held, rounding)
    verdict.within("energy told to be left beyond what is [J]", held - level, rounding)
    verdict.within("energy told to be left away from what is, before any force [J]",
                   np.where(exact, np.abs(held - level), 0.0), rounding)  # fmt: skip
    verdict.holds("without a new message the force is released",
                  fresh | np.isin(answers.status, ("releasing", "released")))  # fmt: skip
    acts = np.isin(answers.status, ("ok", "backup", "blocked"))  # a certified answer, even where it is dry
    verdict.holds("who is told a place, and a force on it, acts", ~placed | acts)
    verdict.during("told a place", placed, dt)
    verdict.within("force over its limit", sizes / limit, 1.0)
    verdict.during("no force so far", exact, dt)
    verdict.during("force", sizes > 0, dt)
    verdict.during("all given at once", np.full(ticks, fraction == 1.0), dt)
    verdict.during("message lost", kinds == "lost", dt)
    verdict.during("message twice", kinds == "twice", dt)
    verdict.during("message late", kinds == "late", dt)
    verdict.during("energy that nobody can mean", kinds == "broken", dt)
    verdict.during("a full tank", level + gave > (1 - 1e-9) * budget, dt)
    verdict.during("a tank nearly empty", level < 0.1 * budget, dt)


def _slowly(path: np.ndarray, most: float) -> np.ndarray:
    """(N, 2) the same way, no faster than so many metres a tick."""
    found = path.copy()
    for k in range(1, len(found)):
        way = path[k] - found[k - 1]
        length = math.hypot(*way)
        found[k] = found[k - 1] + way * min(1.0, most / length) if length > 0 else found[k - 1]
    return found


run = judging(__name__, LEAST, Runs(one_run))
