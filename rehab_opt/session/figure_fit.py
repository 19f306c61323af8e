"""Titles and legends made to fit their figure, however long the names in them are."""

from __future__ import annotations

import textwrap

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.mathtext import MathTextParser
from matplotlib.text import Text
from matplotlib.transforms import Bbox

__all__ = ["fitted"]

ROOM = 0.97
"""Fraction of the figure's width, or of a panel's, that a text may fill."""
LINE = 1.3
"""Height of a line in sizes of its letters."""
MOST_COLUMNS = 6
FEWEST_LETTERS = 8


def fitted(figure: Figure) -> Figure:
    """The figure itself, its titles broken into lines and its legends into columns that it has room for.

    What is added in height is added to the figure, so that panels keep their size. A dollar that begins no formula is
    a dollar.
    """
    for text in figure.findobj(Text):
        if isinstance(text, Text) and "$" in text.get_text() and not _is_formula(text.get_text()):
            text.set_parse_math(False)
    if figure.get_suptitle():
        title = figure.suptitle(figure.get_suptitle(), fontsize=12)
        _heighten(figure, _wrap(figure, title, figure.bbox.width), 12.0)
    figure.draw_without_rendering()
    for legend in list(figure.legends):
        _fit_legend(figure, legend)
    for axes in figure.axes:
        inside = axes.get_legend()
        if inside is not None:
            _shorten(figure, inside, ROOM * axes.bbox.width)
        lines = [_wrap(figure, text, max(axes.bbox.width, 0.15 * figure.bbox.width)) for text in _titles(axes)]
        _heighten(figure, max(lines, default=0), 9.0)
    return figure


def _wrap(figure: Figure, text: Text, width: float) -> int:
    """Break the lines of a text that are wider than `width` [pixel]; how many lines that added."""
    before = text.get_text()
    after = "\n".join(part for line in before.split("\n") for part in _parts(figure, text, line, ROOM * width))
    text.set_text(after)
    return after.count("\n") - before.count("\n")


def _parts(figure: Figure, text: Text, line: str, width: float) -> list[str]:
    text.set_text(line)
    wide = _width(figure, text) if line.strip() else 0.0
    if wide <= width or ("$" in line and text.get_parse_math()):  # a formula is not cut in two
        return [line]
    return textwrap.wrap(line, max(FEWEST_LETTERS, int(len(line) * width / wide))) or [line]


def _fit_legend(figure: Figure, legend: Legend) -> None:
    """The figure's legend anew, with fewer columns and then shorter lines, if it is wider than the figure."""
    labels, room = [text.get_text() for text in legend.get_texts()], ROOM * figure.bbox.width
    if not labels or _width(figure, legend) <= room:
        return
    handles, size, before = legend.legend_handles, legend.get_texts()[0].get_fontsize(), _height(figure, legend)
    for columns in range(min(MOST_COLUMNS, len(labels)), 0, -1):
        legend.remove()
        legend = figure.legend(
            handles=handles,
            labels=labels,
            loc="outside lower center",
            ncols=columns,
            frameon=False,
            fontsize=size,
        )
        if _width(figure, legend) <= room:
            break
    _shorten(figure, legend, room)
    figure.set_figheight(figure.get_figheight() + max(_height(figure, legend) - before, 0.0) / figure.dpi)


def _shorten(figure: Figure, legend: Legend, room: float) -> None:
    """Break the labels of a legend that is wider than `room` [pixel]."""
    excess = _width(figure, legend) - room
    if excess > 0:
        widest = max(_width(figure, text) for text in legend.get_texts())
        for text in legend.get_texts():
            _wrap(figure, text, max(widest - excess, 0.2 * room))


def _heighten(figure: Figure, lines: int, size: float) -> None:
    """More height for lines of `size` [point]."""
    if lines > 0:
        figure.set_figheight(figure.get_figheight() + lines * LINE * size / 72)


def _titles(axes: Axes) -> list[Text]:
    """The titles of a panel: what stands in them, and nowhere else."""
    said = {axes.get_title(loc) for loc in ("left", "center", "right")} - {""}
    return [text for text in axes.findobj(Text) if isinstance(text, Text) and text.get_text() in said]


def _is_formula(text: str) -> bool:
    parser = MathTextParser("agg")
    try:
        for line in text.split("\n"):  # as it is drawn
            parser.parse(line)
    except ValueError:
        return False
    return True


def _width(figure: Figure, artist: Text | Legend) -> float:
    return float(_extent(figure, artist).width)


def _height(figure: Figure, artist: Text | Legend) -> float:
    return float(_extent(figure, artist).height)


def _extent(figure: Figure, artist: Text | Legend) -> Bbox:
    canvas = figure.canvas if isinstance(figure.canvas, FigureCanvasAgg) else FigureCanvasAgg(figure)
    return artist.get_window_extent(canvas.get_renderer())  # type: ignore[no-untyped-call]
