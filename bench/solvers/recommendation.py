"""Which solver should be the default of a capability: the present one, and the best that is certified as often."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from bench.solvers.summary import Row
from bench.solvers.table import Grid

__all__ = ["DEFAULTS", "SLACK", "Recommendation", "recommendation_grid", "recommendations"]

DEFAULTS: Mapping[str, tuple[str, str]] = {
    "arm_ik": ("qrqp-fused", "warm"),
    "field_learning": ("daqp", "cold"),
    "nlp_arm_ik": ("sqp", "cold"),
    "nlp_boundary": ("sqp", "cold"),
}
"""Solver and mode of a family where nothing else is said, of those that are not solved by the fallback tick after tick:
steps of the SQP, fits that are made once, programmes."""
FALLBACK = ("fallback", "warm")
STAGES = ("fallback", "fallback-proxqp", "qrqp-fused", "qrqp-virtual", "sqp")
"""These are no alternatives: parts of the default, and its way through CasADi's virtual machine."""
SLACK = 1.2
"""A default may be slower than the best alternative by this factor."""


class Recommendation(NamedTuple):
    """One family, in the mode in which its capability solves."""

    family: str
    default: Row
    best: Row | None
    """Of the solvers of others that solve at least as large a share the one with the smallest mean time, if any."""

    @property
    def ratio(self) -> float:
        """Mean time of the default beside the best alternative's."""
        return self.default.mean / self.best.mean if self.best is not None else math.nan

    @property
    def stays(self) -> bool:
        """Whether the default solves something, and is not beaten by more than `SLACK`."""
        return self.default.solved > 0 and (self.best is None or self.ratio <= SLACK)

    @property
    def verdict(self) -> str:
        """Of the default."""
        if not self.default.solved > 0:
            return "solves none"
        return "stays" if self.stays else f"slower by more than {SLACK - 1:.0%}"


def recommendations(rows: Sequence[Row]) -> tuple[Recommendation, ...]:
    """One for each family in which a default took part."""
    found = []
    for own in (row for row in rows if DEFAULTS.get(row.family, FALLBACK) == (row.solver, row.mode) and row.ticks):
        same = STAGES if own.solver in STAGES else (own.solver,)
        others = [
            row
            for row in rows
            if (row.family, row.mode) == (own.family, own.mode) and row.solver not in same and row.solved >= own.solved
        ]
        best = min((row for row in others if row.solved > 0), key=lambda row: row.mean, default=None)
        found.append(Recommendation(own.family, own, best))
    return tuple(found)


def recommendation_grid(found: Sequence[Recommendation]) -> Grid:
    """As a grid."""
    columns = ("family", "default", "solved", "mean, us", "best alternative", "solved", "mean, us", "ratio", "verdict")
    cells: list[tuple[str, ...]] = []
    for each in found:
        other = ("none solves as many", "-", "-", "-")
        if each.best is not None:
            name, solved = each.best.solver, f"{100 * each.best.solved:.4g} %"
            other = (name, solved, f"{1e6 * each.best.mean:.3g}", f"{each.ratio:.2f}")
        own = (each.family, each.default.solver, f"{100 * each.default.solved:.4g} %", f"{1e6 * each.default.mean:.3g}")
        cells.append((*own, *other, each.verdict))
    return Grid(
        "The default beside the best alternative, in the mode in which the capability solves", columns, cells, leading=2
    )
