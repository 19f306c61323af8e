"""The one style of figures: two widths, a caption for each; headings and legends are never cut off."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text
from PIL import Image

from rehab_opt.session.drawing import end_at, fitted, framed, legend_below, styled
from rehab_opt.session.files import load_problem
from rehab_opt.session.report import write_report
from rehab_opt.session.run import run_problem
from tests.session.test_robot import PATH


def overhang(figure: Figure) -> float:
    """[inch] by which the figure's content reaches beyond its edges."""
    figure.canvas.draw()
    box, (width, height) = figure.get_tightbbox(), figure.get_size_inches()
    return float(max(-box.x0, -box.y0, box.x1 - width, box.y1 - height))


def labelled(labels: list[str], panels: int) -> Figure:
    figure = framed("", 6.5)
    grid = np.atleast_1d(figure.subplots(1, panels))
    for number, label in enumerate(labels):
        grid[0].plot([0, 1], [number, 1], label=label)
    for axes in grid:
        axes.set_title(labels[0])
    return legend_below(figure)


@pytest.mark.parametrize(("count", "panels"), [(1, 1), (4, 3)])
def test_long_names_fit(count: int, panels: int) -> None:
    labels = [f"a range of motion of forty letters, no {number:02d}" + 60 * "x" for number in range(count)]
    figure = labelled(labels, panels)
    assert overhang(figure) > 0.5
    assert overhang(fitted(figure)) < 0.01
    said = ["".join(text.get_text().split()) for text in figure.legends[0].get_texts()]
    assert said == ["".join(label.split()) for label in labels]


def test_figure_that_fits_stays_as_it_is() -> None:
    figure = labelled(["a", "b"], 2)
    legend, size = figure.legends[0], figure.get_size_inches().copy()
    fitted(figure)
    assert figure.legends == [legend]
    np.testing.assert_array_equal(figure.get_size_inches(), size)


def test_a_formula_in_a_text_of_two_lines_is_drawn_without_a_warning(caplog: pytest.LogCaptureFixture) -> None:
    figure = framed("", 3.0)
    figure.subplots().set_title("outside $W_c$,\nmean [mm]")
    fitted(figure).canvas.draw()
    assert not caplog.records


def test_a_run_writes_a_caption_for_every_figure_and_each_has_one_of_two_widths(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(PATH)
    (tmp_path / "path.csv").write_text("t_s,x_m,y_m\n" + "\n".join(f"{0.1 * k},{0.001 * k},0" for k in range(20)))
    written = write_report(run_problem(load_problem(str(tmp_path / "mine.toml"))), tmp_path / "out")
    drawn = {path.stem for path in written if path.suffix == ".png"}
    assert drawn
    assert {path.stem for path in written if path.suffix == ".pdf"} == drawn
    captions = (tmp_path / "out" / "captions.md").read_text(encoding="utf-8").strip().split("\n\n")
    assert {caption.split(".**")[0].strip("*") for caption in captions} == drawn
    for path in written:
        if path.suffix == ".png":
            with Image.open(path) as image:
                assert image.width / 300 in {3.5, 7.2}
                assert image.info["dpi"] == pytest.approx((300, 300), abs=0.1)


def test_every_text_of_a_figure_in_the_style_is_of_8_points() -> None:
    with styled():
        figure = labelled(["a", "b"], 2)
        figure.axes[0].set(xlabel="x", ylabel="y")
        figure.canvas.draw()
    assert {text.get_fontsize() for text in figure.findobj(Text)} == {8.0}


def test_a_panel_says_which_lines_leave_it() -> None:
    axes = framed("", 2.0).subplots()
    axes.plot([0, 1], [0.0, 4.0], label="low")
    axes.plot([0, 1], [np.nan, 12.5], label="high")
    axes.axvline(0.5, label="event")
    end_at(axes, 5.0)
    (note,) = axes.texts
    assert note.get_text() == "beyond this panel: high 12.5"
