"""Find out why a slice is empty: its height, the handle, or their combination. First, search once more."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rehab_opt.optim.nlp import NLP, NLPAnswer
from rehab_opt.optim.nlp_solvers import NLPSolver, nlp_solver
from rehab_opt.optim.nlp_sqp import SQP
from rehab_opt.workspace.plane_search import TOLERANCE, VIOLATION, Nearest, PlaneSearch
from rehab_opt.workspace.plane_statement import PlaneStatement, spread_postures

__all__ = ["LastTry", "heights", "last_try"]

Array = NDArray[np.float64]

STARTS = 64
TRIES = 8


class LastTry(NamedTuple):
    """Points of the slice that one more search found, or the reason why there are none."""

    found: list[Nearest]
    reason: str


def last_try(search: PlaneSearch, handle_tilt: float | None) -> LastTry:
    """Search once more, after spread postures led to no point of the slice."""
    statement, height = search.statement, search.height
    lowest, highest = heights(statement, held=False)
    if not lowest.report[0] - VIOLATION <= height <= highest.report[0] + VIOLATION:
        low, high = float(lowest.report[0]), float(highest.report[0])
        return LastTry([], f"height {height:.4g} m is out of reach: the hand gets from {low:.4g} to {high:.4g} m")
    upright = _best(statement, statement.upright, [])
    if handle_tilt is not None and not upright.report[0] <= handle_tilt + VIOLATION:
        least, most = math.degrees(upright.report[0]), math.degrees(handle_tilt)
        return LastTry([], f"no posture holds the handle within {most:.4g} deg of vertical: at best {least:.4g} deg")
    ends = [answer for answer in heights(statement, held=True, more=[upright.x]) if answer.violation <= VIOLATION]
    for start in (answer.x for answer in [*ends, upright, lowest, highest]):
        hand = statement.measure(start, statement.fixed)[0].full().ravel()
        for solve in (search.nearest, search.by_backup):
            answer = solve(float(hand[0]), float(hand[1]), start)
            if answer is not None:
                return LastTry([answer], "")
    if len(ends) == 2:
        low, high = float(ends[0].report[0]), float(ends[1].report[0])
        held = "" if handle_tilt is None else f" with the handle within {math.degrees(handle_tilt):.4g} deg of vertical"
        return LastTry([], f"height {height:.4g} m is not reached{held}: the hand gets from {low:.4g} to {high:.4g} m")
    return LastTry([], f"no posture was found with the hand at {height:.4g} m and the handle upright")


def heights(statement: PlaneStatement, *, held: bool, more: list[Array] | None = None) -> tuple[NLPAnswer, NLPAnswer]:
    """Two answers, for the lowest and the highest hand; each reports z [m]. Unless `held`, the handle tilts freely."""
    nlp = statement.vertical if held else statement.vertical_free
    low, high = (_best(statement, nlp, [sign], more) for sign in (1.0, -1.0))
    return low, high


def _best(statement: PlaneStatement, nlp: NLP, extra: list[float], more: list[Array] | None = None) -> NLPAnswer:
    """Best answer from many starts: one that satisfies the rows, if any does. The solver is not compiled."""
    solver = nlp_solver(nlp, "sqp", tolerance=TOLERANCE, compile=False)
    starts = [*(more or []), *spread_postures(statement.arm, statement.free, STARTS)]
    best = _from(solver, statement, extra, starts[0])
    for start in starts[1:]:
        answer = _from(solver, statement, extra, start)
        if (not answer.violation <= VIOLATION, answer.cost) < (not best.violation <= VIOLATION, best.cost):
            best = answer
    if not best.violation <= VIOLATION:
        backup = nlp_solver(nlp, "ipopt", tolerance=TOLERANCE)
        for start in starts[:TRIES]:
            answer = _from(backup, statement, extra, start)
            if answer.violation <= VIOLATION:
                return answer
    return best


def _from(solver: SQP | NLPSolver, statement: PlaneStatement, extra: list[float], start: Array) -> NLPAnswer:
    solver.parameters[:] = [*statement.fixed, *extra]
    return solver.solve(start)
