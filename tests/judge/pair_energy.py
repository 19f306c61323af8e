"""Helper and participant: whatever the delay and the hands do, no more energy leaves than the tanks held.

Judged by the work of both forces on both hands, from the beginning to every later tick, for greedy, shuttling and calm
hands below the speed cap, at delays up to 0.3 s; with each side's force and slew bound, the silence before the first
message, and equal power on both sides by finite differences of the image (that of the map that was given).
"""

from __future__ import annotations

import functools
import math

import numpy as np
import shapely

from rehab_opt import Bilateral, HelperSide, ParticipantSide, Workspace, WorkspaceMap
from tests.judge.force_runs import hand_path, moved
from tests.judge.numbering import Runs, judging, run_length
from tests.judge.verdict import Verdict

GUARANTEES = ("G22",)
LEAST = {"more than half of both tanks drawn": 2000, "hand greedy": 30_000, "hand shuttle": 58_000,
         "before the first message": 1000, "equal power compared": 125, "pull compared": 125,
         "status released": 1000, "disabled": 3000}  # fmt: skip
CI_TICKS = 10_000
SHARE = 0.5
SOURCE, TARGET = ((0.2, 0.15), (-0.17, 0.5)), ((0.07, 0.05), (-0.15, 0.45))
HANDS = ("greedy", "shuttle", "person", "held")


def ellipse(radii: tuple[float, float], centre: tuple[float, float]) -> Workspace:
    """Of 40 corners."""
    angle = np.linspace(0, 2 * math.pi, 40, endpoint=False)
    points = np.column_stack([radii[0] * np.cos(angle), radii[1] * np.sin(angle)]) + centre
    return Workspace(shapely.Polygon(points), accuracy=0.0)


@functools.cache
def mapped() -> WorkspaceMap:
    """One ellipse onto another."""
    return WorkspaceMap.between(ellipse(*SOURCE), ellipse(*TARGET))


def one_run(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """One pair."""
    dt, workspace_map = float(rng.choice([1e-3, 2e-3, 5e-3])), mapped().for_controller()
    limit, slew = float(rng.choice([10.0, 30.0])), float(rng.choice([200.0, 1000.0]))
    budgets = rng.choice([0.05, 0.5, 5.0], 2)
    bounds = {"dt": dt, "slew_limit": slew, "force_limit": limit, "compile": False}
    damping, stiffness = float(rng.choice([0.0, 2.0])), float(rng.choice([400.0, 4000.0]))
    both = Bilateral(
        HelperSide(workspace_map, damping=damping, energy_budget=budgets[0],
                   exchange=float(rng.choice([0.0, 5.0, 50.0, 5000.0])), **bounds),  # type: ignore[arg-type]
        ParticipantSide(workspace_map, comfortable=ellipse(*TARGET), stiffness=stiffness, damping=0.0,
                        energy_budget=budgets[1], exchange=float(rng.choice([0.0, 5.0, 50.0, 5000.0])),
                        **bounds),  # type: ignore[arg-type]
        delay=float(rng.choice([0.0, 0.02, 0.3])),
    )  # fmt: skip
    kinds = [HANDS[number % 4], HANDS[number // 2 % 4]]
    verdict.begin(number, f"{' and '.join(kinds)}, delay {both.delay:g}, dt {dt:g}")
    ticks = run_length(rng, number, dt)
    centres = np.array([SOURCE[1], TARGET[1]])
    paths = [centres[i] + hand_path(rng, kinds[i], ticks, dt) * (1.0, 0.3)[i] for i in (0, 1)]
    x = np.empty((ticks + 1, 2, 2))
    x[0] = paths[0][0], paths[1][0]
    off = rng.random() < 0.3
    disabled = (np.cumsum(rng.random(ticks) < 0.002) % 2 == 1) & off
    answers: list[list] = [[], []]
    for k in range(ticks):
        forces = both.step(x[k, 0], x[k, 1], enable=not disabled[k])
        for i, command in enumerate(forces):
            answers[i].append(command)
            there = centres[i] + [0.1 if k * dt % 0.2 < 0.1 else -0.1, 0.0]
            x[k + 1, i] = moved(kinds[i], x[k, i], paths[i][k + 1], command.value, 0.9 * dt, there)
    felt = verdict.answers(answers[0], dt)
    drawn = verdict.answers(answers[1], dt)
    values = np.stack([felt.value, drawn.value], axis=1)
    ways = np.diff(x, axis=0)
    size = np.linalg.norm(values, axis=2)
    verdict.within("force over its limit", size / limit, 1.0)
    change = np.linalg.norm(np.diff(values, axis=0, prepend=np.zeros((1, 2, 2))), axis=2)
    slewed = np.stack([felt.relaxed, drawn.relaxed], axis=1) & 8 != 0
    verdict.within("change of force over the slew bound", np.where(slewed, 0.0, change / (slew * dt)), 1 + 1e-9)
    total = np.cumsum(np.einsum("nij,nij->n", values, ways))
    verdict.within("energy drawn by both hands over what the tanks held", total.max() / budgets.sum(), 1 + 1e-9)
    # Outside its workspace a hand is drawn back, message or none.
    radii = np.array([SOURCE[0], TARGET[0]])
    within = np.logical_and.accumulate(np.linalg.norm((x[:-1] - centres) / radii, axis=2) < 0.98)
    silent = np.arange(ticks) <= round(both.delay / dt)
    verdict.within("force before the first message [N]", np.where(silent[:, None] & within, size, 0.0), 0.0)
    lets_go = np.stack([felt.status != "ok", drawn.status != "ok"], axis=1)
    verdict.holds("silence is told", lets_go | ~silent[:, None] | ~within)
    verdict.holds("both sides let go without the switch", (np.isin(felt.status, ("releasing", "released"))
                  & np.isin(drawn.status, ("releasing", "released"))) | ~disabled)  # fmt: skip

    # What the helper feels is -J' of the participant's force of a message ago: the same power, the other way.
    late = round(both.delay / dt) + 1
    free = (felt.status == "ok") & (felt.relaxed == 0) & (np.arange(ticks) >= late) & (damping == 0.0)
    way, step = np.array([[1.0, 0.0], [0.0, 1.0]]), 1e-6
    inside = np.linalg.norm((x[:-1, 0] - centres[0]) / SOURCE[0], axis=1) < 0.95
    picked = np.flatnonzero(free & inside)[:: max(1, ticks // 50)]
    # The participant is drawn by the image of where the helper was a message ago, as far as no bound is in the way.
    plain = (drawn.status == "ok") & (drawn.relaxed == 0) & (np.arange(ticks) >= late) & within[:, 1]
    for k in np.flatnonzero(plain)[:: max(1, int(plain.sum()) // 50)].tolist():
        pull = stiffness * (mapped()(x[k - late, 0]) - x[k, 1])
        pull *= min(1.0, limit / max(float(np.linalg.norm(pull)), 1e-12))
        verdict.within("pull away from that of the image [N]", np.abs(values[k, 1] - pull), 1e-5 * limit)
    verdict.during("pull compared", plain, dt)
    for k in picked.tolist():
        images = [(mapped()(x[k, 0] + step * each) - mapped()(x[k, 0] - step * each)) / (2 * step) for each in way]
        power = [float(values[k - late, 1] @ image) for image in images]
        verdict.within("power felt beside power given, away from equal [N]", np.abs(values[k, 0] + power), 1e-5 * limit)
    verdict.during("equal power compared", free & inside, dt)
    verdict.during("before the first message", silent, dt)
    verdict.during("more than half of both tanks drawn", total > 0.5 * budgets.sum(), dt)
    verdict.during("disabled", disabled, dt)
    for kind in set(kinds):
        verdict.during(f"hand {kind}", np.ones(ticks, dtype=bool), dt)


run = judging(__name__, LEAST, Runs(one_run))
