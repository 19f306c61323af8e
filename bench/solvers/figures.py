"""Figures of a comparison: for each family its performance profile, its times, and accuracy against time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter
from numpy.typing import NDArray

from bench.solvers.passes import MODES, Pass
from bench.solvers.statistics import percentile, performance_profile
from bench.solvers.summary import Row, family_times
from bench.solvers.table import share_text
from rehab_opt.session.drawing import OKABE_ITO, REFERENCE, THIN, framed, legend_below

__all__ = ["figures_of"]

COLOURS = (REFERENCE, *OKABE_ITO)
DASHES = ("-", "--", ":")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*", "<", ">", "h")
MIN_FACTOR = 10.0
"""To which a profile is drawn at least; further where a solver that solves everything needs longer."""
MIN_ERROR = 1e-17
"""What is exact is drawn here: a logarithm has no zero."""

Times = Mapping[str, NDArray[np.float64]]
Styles = Mapping[str, Mapping[str, Any]]


def figures_of(
    passes: Sequence[Pass], rows: Sequence[Row], hopeless: dict[str, NDArray[np.bool_]]
) -> dict[str, Figure]:
    """Figures by the name of their file, of every family with instances that have an answer."""
    drawn = {}
    for family in dict.fromkeys(row.family for row in rows):
        times = {mode: family_times(passes, hopeless, family=family, mode=mode) for mode in MODES["qp"]}
        if not any(times.values()):
            continue
        styles = _styles(list(dict.fromkeys(row.solver for row in rows if row.family == family)))
        drawn[f"{family}_profile"] = _profile(family, times, styles)
        drawn[f"{family}_times"] = _distribution(family, times)
        drawn[f"{family}_accuracy"] = _accuracy(family, [row for row in rows if row.family == family], styles)
    return drawn


def _styles(solvers: Sequence[str]) -> Styles:
    """The same for families with the same solvers; as many as colours times markers, whose numbers share no factor."""
    return {
        name: {"color": COLOURS[i % len(COLOURS)], "linestyle": DASHES[i // len(COLOURS) % len(DASHES)],
               "marker": MARKERS[i % len(MARKERS)]}
        for i, name in enumerate(solvers)
    }  # fmt: skip


def _profile(family: str, times: Mapping[str, Times], styles: Styles) -> Figure:
    figure = framed(f"{family}: fraction of instances solved within a factor of the fastest solver's time.", 3.2)
    panels = _panels(figure, times)
    for mode, axes in panels.items():
        profiles = performance_profile(times[mode])
        largest = max([MIN_FACTOR, *(float(factors[-1]) for factors, _ in profiles.values() if factors.size)])
        axes.set(xscale="log", xlim=(1.0, largest), ylim=(0.0, 1.03))
        axes.set_title(mode)
        axes.set_xlabel("time / time of the fastest solver")
        axes.yaxis.set_major_formatter(PercentFormatter(1.0))
        for name, (factors, fractions) in profiles.items():
            x = np.concatenate(([1.0], factors, [largest]))
            y = np.concatenate(([0.0], fractions, [fractions[-1] if fractions.size else 0.0]))
            style = {key: value for key, value in styles[name].items() if key != "marker"}
            axes.step(x, y, where="post", label=name, **style)
    next(iter(panels.values())).set_ylabel("certified instances")
    return legend_below(figure)


def _distribution(family: str, times: Mapping[str, Times]) -> Figure:
    names = list(dict.fromkeys(name for each in times.values() for name in each))
    words = "bar: quarter to three quarters, line: to 99 %, dot: largest"
    figure = framed(f"{family}: time of a solve; {words}.", 0.8 + 0.17 * len(names))
    for mode, axes in _panels(figure, times).items():
        axes.set(xscale="log", ylim=(len(names) - 0.4, -0.6))
        axes.set_yticks(range(len(names)), names)
        axes.set_title(mode)
        axes.set_xlabel("time of a solve [us]")
        for i, name in enumerate(names):
            of_mode = times[mode].get(name, np.empty(0))
            solved = 1e6 * of_mode[np.isfinite(of_mode)]
            if solved.size:
                least, low, middle, high, most, largest = (
                    percentile(solved, fraction) for fraction in (0.0, 0.25, 0.5, 0.75, 0.99, 1.0)
                )
                axes.plot([least, most], [i, i], color="#555555", linewidth=THIN)
                axes.plot([low, high], [i, i], color="#56B4E9", linewidth=4.0, solid_capstyle="butt")
                axes.plot(middle, i, "|", color=REFERENCE, markersize=7, markeredgewidth=1.2)
                axes.plot(largest, i, ".", color="#555555")
            failed = of_mode.size - solved.size
            if failed:
                axes.set_xmargin(0.25)
                note = f"{share_text(failed / of_mode.size)} failed"
                axes.annotate(note, (0.985, i), xycoords=("axes fraction", "data"), ha="right", va="center",
                              color=COLOURS[2])  # fmt: skip
    return figure


def _accuracy(family: str, rows: Sequence[Row], styles: Styles) -> Figure:
    figure = framed(
        f"{family}: distance from the reference (median, line to the largest) and shifted geometric mean of the time, "
        "failures as the limit, of what is certified.",
        3.2,
    )
    panels = _panels(figure, {mode: [row for row in rows if row.mode == mode] for mode in MODES["qp"]})
    for mode, axes in panels.items():
        axes.set(xscale="log", yscale="log")
        axes.set_title(mode)
        axes.set_xlabel("mean time [us]")
        for row in rows:
            if row.mode == mode and row.ticks and np.isfinite(row.largest_error):
                error = max(row.error, MIN_ERROR), max(row.largest_error, MIN_ERROR)
                style = {key: value for key, value in styles[row.solver].items() if key != "linestyle"}
                axes.plot([1e6 * row.mean] * 2, error, color=style["color"], linewidth=THIN)
                axes.plot(1e6 * row.mean, error[0], linestyle="none", label=row.solver, **style)
    next(iter(panels.values())).set_ylabel("distance from the reference")
    return legend_below(figure)


def _panels(figure: Figure, times: Mapping[str, Any]) -> dict[str, Axes]:
    """One panel for each mode that has something."""
    modes = [mode for mode in MODES["qp"] if len(times[mode])]
    grid = np.atleast_1d(figure.subplots(1, len(modes), sharey=True)).ravel()
    return dict(zip(modes, grid, strict=True))
