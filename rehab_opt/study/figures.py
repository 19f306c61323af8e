"""Figures of a report, as PNG within the page: no text of a study is read as anything but text."""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from rehab_opt.errors import printable
from rehab_opt.session.drawing import GRID, MM, framed
from rehab_opt.study.summary import Interval
from rehab_opt.text_file import shown

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["COLOURS", "outline_figure", "progress_figure"]

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
"""Okabe and Ito's."""
FIRST, LAST = COLOURS[1], COLOURS[0]
LONGEST_LABEL, MOST_LABELS = 14, 8
LARGEST = 1e30
"""Beyond, matplotlib draws nothing; no measure is as large."""


def progress_figure(
    points: Mapping[str, Mapping[float, Sequence[float]]],
    means: Mapping[str, Mapping[float, Interval]],
    labels: Mapping[float, str],
) -> str:
    """Of each condition points (y by x) and means with their 95 % intervals over x, whose `labels` stand below."""
    figure, axes = _empty(3.5, 2.1)
    step = (max(labels) - min(labels)) / 40 or 0.05
    for i, (name, of) in enumerate(points.items()):
        shift = 0.3 * step * (i - (len(points) - 1) / 2)
        dots = [(x + shift, y) for x, ys in of.items() for y in ys if abs(y) < LARGEST]
        if dots:
            strength = 0.4 if len(dots) < 400 else 0.1
            axes.plot(*zip(*dots, strict=True), ".", color=COLOURS[i], alpha=strength, markersize=3)
        drawn = [(x, each) for x, each in means[name].items() if abs(each.mean) < LARGEST]
        axes.plot([x + shift for x, _ in drawn], [each.mean for _, each in drawn], "o-", color=COLOURS[i], markersize=3)
        low, high = axes.get_ylim()  # one interval of few trials may be far longer than the values lie apart
        for x, each in drawn:
            if math.isfinite(each.lower):
                ends = (max(each.lower, 2 * low - high), min(each.upper, 2 * high - low))
                axes.plot([x + shift] * 2, ends, color=COLOURS[i], linewidth=1.2)
    chosen = sorted(labels)[:: math.ceil(len(labels) / MOST_LABELS)]
    texts = [printable(shown(labels[x], LONGEST_LABEL)) for x in chosen]
    axes.set_xticks(chosen, texts, rotation=20 if max(map(len, texts)) > 4 else 0)
    axes.grid(**GRID)
    return _picture(figure)


def outline_figure(shapes: Sequence[tuple[Sequence[Sequence[float]], str, float]]) -> str:
    """Closed outlines [m], their colours and how strong their lines are, under one scale; later ones on top."""
    figure, axes = _empty(3.5, 3.0)
    for corners, colour, strength in shapes:
        xs, ys = zip(*[*corners, corners[0]], strict=True)
        axes.plot([MM * x for x in xs], [MM * y for y in ys], color=colour, alpha=strength, linewidth=0.8 + strength)
    axes.set(aspect="equal", xlabel="[mm]", ylabel="[mm]")
    axes.grid(**GRID)
    return _picture(figure)


def _empty(width: float, height: float) -> tuple[Figure, Axes]:
    figure = framed("", width, height)
    axes = figure.subplots()
    axes.tick_params(labelsize=7)
    axes.xaxis.label.set_fontsize(7)
    axes.yaxis.label.set_fontsize(7)
    return figure, axes


def _picture(figure: Figure) -> str:
    from matplotlib.text import Text  # noqa: PLC0415

    for text in figure.findobj(Text):
        text.set_parse_math(False)
    content = io.BytesIO()
    figure.savefig(content, dpi=200)
    return f"data:image/png;base64,{base64.b64encode(content.getvalue()).decode()}"
