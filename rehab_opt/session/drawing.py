"""What all figures have in common: they are drawn to be read by a therapist.

Colours are those of Okabe and Ito, told apart by all common kinds of colour vision; line styles differ as well. Nothing
here touches pyplot, so that no state is shared and no window is opened.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

__all__ = ["ACROSS", "FORWARD", "GRID", "LIMIT", "MISSED", "MM", "REFERENCE", "framed", "legend_below"]

REFERENCE, MISSED, LIMIT = "#000000", "#CC79A7", "#BBBBBB"
MM = 1e3
GRID: Mapping[str, Any] = {"visible": True, "color": "#DDDDDD", "linewidth": 0.6}
ACROSS = "left of the shoulder (negative) or right of it (positive) [mm]"
FORWARD = "in front of the shoulder [mm]"


def framed(title: str, width: float, height: float) -> Figure:
    """An empty figure with its title; sizes in inches."""
    figure = Figure(figsize=(width, height), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title, fontsize=12)
    return figure


def legend_below(figure: Figure, axes: Axes, columns: int) -> None:
    """One legend for the whole figure, outside of all axes."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=columns, frameon=False, fontsize=9)
