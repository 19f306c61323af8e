"""What is drawn of a kind of problem that draws nothing itself."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from rehab_opt.session.drawing import GRID, framed
from rehab_opt.session.outcome import Outcome

__all__ = ["figures"]

TIME = "t_s"


def figures(outcome: Outcome) -> dict[str, Figure]:
    """Every column of numbers over time, a panel for each unit; none where there is no time."""
    units: dict[str, list[str]] = {}
    for name, cells in outcome.columns.items():
        if name != TIME and np.asarray(cells).dtype.kind in "fi":
            units.setdefault(name.rpartition("_")[2], []).append(name)
    if TIME not in outcome.columns or not units:
        return {}
    figure = framed(outcome.title, 9.0, 1.0 + 2.5 * len(units))
    grid = figure.subplots(len(units), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (unit, names) in zip(grid, units.items(), strict=True):
        for name in names:
            axes.plot(outcome.columns[TIME], outcome.columns[name], label=name)
        axes.set_ylabel(f"[{unit}]")
        axes.grid(**GRID)
        axes.legend(fontsize=8)
    grid[-1].set_xlabel("time [s]")
    return {"trace": figure}
