"""Figures of a study's report, as PNG images inside the page; labels are drawn as plain text, without formulas."""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from rehab_opt.errors import printable
from rehab_opt.session.drawing import MM, NARROW, OKABE_ITO, framed, styled
from rehab_opt.study.summary import Interval
from rehab_opt.text_file import shown

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["COLOURS", "outline_figure", "progress_figure"]

COLOURS = OKABE_ITO
FIRST, LAST = COLOURS[1], COLOURS[0]
LONGEST_LABEL, MOST_LABELS = 14, 8
LARGEST = 1e30
"""Largest drawn value; matplotlib cannot draw larger values, and measures are far smaller."""


@styled()
def progress_figure(
    points: Mapping[str, Mapping[float, Sequence[float]]],
    means: Mapping[str, Mapping[float, Interval]],
    labels: Mapping[float, str],
) -> str:
    """Plot values, and means with 95 % intervals, over x for each condition; `labels` has the texts of the x axis."""
    figure = framed("", 2.1, NARROW)
    axes = figure.subplots()
    step = (max(labels) - min(labels)) / 40 or 0.05
    for i, (name, of) in enumerate(points.items()):
        shift = 0.8 * step * (i - (len(points) - 1) / 2)
        dots = [(x + shift, y) for x, ys in of.items() for y in ys if abs(y) < LARGEST]
        if dots:
            strength = 0.4 if len(dots) < 400 else 0.1
            axes.plot(*zip(*dots, strict=True), ".", color=COLOURS[i], alpha=strength, markersize=3)
        drawn = [(x, each) for x, each in means[name].items() if abs(each.mean) < LARGEST]
        axes.plot([x + shift for x, _ in drawn], [each.mean for _, each in drawn], "o-", color=COLOURS[i], markersize=3)
        low, high = axes.get_ylim()  # long intervals of few trials are cut, so that the points stay visible
        for x, each in drawn:
            if math.isfinite(each.lower):
                ends = (max(each.lower, 2 * low - high), min(each.upper, 2 * high - low))
                axes.plot([x + shift] * 2, ends, color=COLOURS[i])
    chosen = sorted(labels)[:: math.ceil(len(labels) / MOST_LABELS)]
    texts = [printable(shown(labels[x], LONGEST_LABEL)) for x in chosen]
    axes.set_xticks(chosen, texts, rotation=20 if max(map(len, texts)) > 4 else 0)
    return _picture(figure)


@styled()
def outline_figure(shapes: Sequence[tuple[Sequence[Sequence[float]], str, float]]) -> str:
    """Figure of closed outlines, each with corners [m], colour and opacity; later outlines are on top."""
    figure = framed("", 3.0, NARROW)
    axes = figure.subplots()
    for corners, colour, strength in shapes:
        xs, ys = zip(*[*corners, corners[0]], strict=True)
        axes.plot([MM * x for x in xs], [MM * y for y in ys], color=colour, alpha=strength, linewidth=0.8 + strength)
    axes.set(aspect="equal", xlabel="[mm]", ylabel="[mm]")
    return _picture(figure)


def _picture(figure: Figure) -> str:
    from matplotlib.text import Text  # noqa: PLC0415

    for text in figure.findobj(Text):
        text.set_parse_math(False)
    content = io.BytesIO()
    figure.savefig(content)
    return f"data:image/png;base64,{base64.b64encode(content.getvalue()).decode()}"
