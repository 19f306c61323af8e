"""Titles and legends are never cut off, and figures that fit stay as they are."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

from rehab_opt.session.drawing import fitted, framed, legend_below

LONG = "The title of a person's own problem, as long as a problem file allows, nothing left out, and then some more"


def overhang(figure: Figure) -> float:
    """[inch] by which the figure's content reaches beyond its edges."""
    figure.canvas.draw()
    box, (width, height) = figure.get_tightbbox(), figure.get_size_inches()
    return float(max(-box.x0, -box.y0, box.x1 - width, box.y1 - height))


def labelled(title: str, labels: list[str], panels: int, columns: int) -> Figure:
    figure = framed(title, 7.5, 6.5)
    grid = np.atleast_1d(figure.subplots(1, panels))
    for number, label in enumerate(labels):
        grid[0].plot([0, 1], [number, 1], label=label)
    for axes in grid:
        axes.set_title(labels[0], fontsize=9)
    legend_below(figure, grid[0], columns)
    return figure


@pytest.mark.parametrize(("count", "panels"), [(1, 1), (4, 3)])
def test_long_names_fit(count: int, panels: int) -> None:
    labels = [f"a range of motion of forty letters, no {number:02d}" + 60 * "x" for number in range(count)]
    figure = labelled(f"{LONG}\n{LONG}", labels, panels, 4)
    assert overhang(figure) > 0.5
    assert overhang(fitted(figure)) < 0.01
    assert "".join(figure.get_suptitle().split()) == "".join(f"{LONG}{LONG}".split())
    said = ["".join(text.get_text().split()) for text in figure.legends[0].get_texts()]
    assert said == ["".join(label.split()) for label in labels]


def test_figure_that_fits_stays_as_it_is() -> None:
    figure = labelled("short", ["a", "b"], 2, 2)
    legend, size = figure.legends[0], figure.get_size_inches().copy()
    fitted(figure)
    assert figure.legends == [legend]
    np.testing.assert_array_equal(figure.get_size_inches(), size)


def test_a_formula_in_a_text_of_two_lines_is_drawn_without_a_warning(caplog: pytest.LogCaptureFixture) -> None:
    figure = framed("outside $W_c$,\nmean [mm]", 4.0, 3.0)
    fitted(figure).canvas.draw()
    assert not caplog.records
