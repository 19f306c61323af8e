"""Times of the solvers, from the tables that `python -m bench.solvers` printed, kept in bench/solvers/TABLE.md."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter

from rehab_opt.session.drawing import COMMANDED, REFERENCE, TRUE, framed, legend_below

PRINTED = Path(__file__).parents[2] / "bench" / "solvers" / "TABLE.md"
QPS = "**QPs of consecutive ticks, warm: mean time in us"
PROGRAMMES = "**NLPs: mean time in us"
DEFAULTS = "**The default beside the best alternative"
FAMILIES = {
    "pose_tracking": "pose tracking", "mirror": "mirror", "assistance": "assistance", "ardis": "chair and arm",
    "degenerate": "every row twice", "badly_scaled": "badly scaled", "field_learning": "field learning",
    "nlp_arm_ik": "arm IK, an NLP",
}  # fmt: skip
NAMES = {"fallback": "fused qrqp", "daqp-kept": "daqp", "sqp": "our SQP"}
CLOSE = 2.0
"""Ratio of two times below which names are at the sides, not above."""
OURS = ("fallback", "fallback-proxqp", "qrqp-fused", "qrqp-virtual")
"""Ours: chains of solvers, and the fused one."""
TICK_US = 1000.0
GREY = "#777777"


class Mean(NamedTuple):
    """Mean time [us] and fraction certified [%]."""

    us: float
    fraction: float


def solver_times() -> Figure:
    """One row for each family: the default, the best alternative, and all others with a mean."""
    table = _times(QPS) | _times(PROGRAMMES)
    chosen = {row["family"]: (row["default"], row["best alternative"]) for row in _rows(DEFAULTS)}
    figure = framed("What the controllers solve, tick after tick: mean time of a warm-started solve.", 4.4)
    axes = figure.subplots()
    names = list(FAMILIES)[::-1]
    for row, family in enumerate(names):
        default, best = chosen[family]
        for solver, mean in table[family].items():
            if solver == default:
                style = {"color": TRUE, "marker": "o", "markersize": 7, "zorder": 4}
            elif solver == best:
                style = {"color": COMMANDED, "marker": "s", "markersize": 6, "zorder": 3}
            elif solver not in OURS:
                style = {"color": GREY, "marker": "D", "markersize": 4, "zorder": 2}
            else:
                continue
            whole = {} if mean.fraction == 100 else {"markerfacecolor": "white"}
            axes.plot(mean.us, row, linestyle="none", markeredgewidth=1.2, **style, **whole)
        ours, other = table[family][default].us, table[family][best].us
        near = max(ours, other) / min(ours, other) < CLOSE
        for at, solver in ((ours, default), (other, best)):
            side = "center" if not near else "right" if at == min(ours, other) else "left"
            axes.annotate(
                NAMES.get(solver, solver), (at, row), ({"right": -2, "left": 2}.get(side, 0), 8),
                textcoords="offset points", ha=side, va="bottom",
            )  # fmt: skip
    axes.axvline(TICK_US, color=REFERENCE, linestyle="--")
    axes.set_xscale("log")
    axes.set_xlim(1, 6000)
    axes.xaxis.set_major_formatter(FuncFormatter(lambda us, _: f"{us:g}"))
    axes.set_ylim(-0.5, len(names) - 0.35)
    axes.set_yticks(range(len(names)), [FAMILIES[name] for name in names])
    axes.set_xlabel("mean time of a solve [µs], less is better")
    marks = {
        "the controller's default": {"color": TRUE, "marker": "o", "markersize": 7},
        "best alternative": {"color": COMMANDED, "marker": "s", "markersize": 6},
        "another solver": {"color": GREY, "marker": "D", "markersize": 4},
        "hollow: not all were solved": {"color": GREY, "marker": "D", "markersize": 4, "markerfacecolor": "white"},
        "one tick at 1 kHz": {"color": REFERENCE, "linestyle": "--"},
    }
    handles = [Line2D([], [], **{"linestyle": "none", **style}, label=label) for label, style in marks.items()]
    return legend_below(figure, handles)


def _times(heading: str) -> dict[str, dict[str, Mean]]:
    """By family and solver; cells with only a fraction have no mean."""
    found: dict[str, dict[str, Mean]] = {}
    for row in _rows(heading):
        solver = row.pop("solver")
        for family, cell in row.items():
            if means := re.fullmatch(r"([\d.]+)(?: \(([\d.]+) %\))?", cell):
                found.setdefault(family, {})[solver] = Mean(float(means[1]), float(means[2] or 100))
    return found


def _rows(heading: str) -> list[dict[str, str]]:
    """The table below a heading."""
    lines = iter(PRINTED.read_text(encoding="utf-8").partition(heading)[2].splitlines()[2:])
    split = [[cell.strip() for cell in line.strip("|").split("|")] for line in iter(lambda: next(lines, ""), "")]
    return [dict(zip(split[0], cells, strict=True)) for cells in split[2:]]
