"""Common to all figures: frame, colours, joints over time, servos, legends."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.session.outcome import Array
from rehab_opt.session.trace import Trace

if TYPE_CHECKING:  # loaded where a figure is made: reading a problem needs none
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.legend import Legend
    from matplotlib.text import Text

__all__ = [
    "ACROSS",
    "CLOSE_UP",
    "FORWARD",
    "GRID",
    "LAW_NAMES",
    "LAW_STYLES",
    "LIMIT",
    "MISSED",
    "MM",
    "REFERENCE",
    "TOLD",
    "TRUE",
    "Gaps",
    "Panel",
    "columns_figure",
    "figure_over_time",
    "fitted",
    "framed",
    "joint_figure",
    "label_times",
    "labelled_gaps",
    "legend_below",
    "mark_gaps",
    "path_figure",
    "servo_figure",
]


Gaps: TypeAlias = Sequence[tuple[float, float]]
"""(from, to) [s] without samples."""
REFERENCE, MISSED, LIMIT, EVENT = "#000000", "#CC79A7", "#BBBBBB", "#009E73"
MM = 1e3
GRID: Mapping[str, Any] = {"visible": True, "color": "#DDDDDD", "linewidth": 0.6}
ACROSS = "left of the shoulder (negative) or right of it (positive) [mm]"
FORWARD = "in front of the shoulder [mm]"


def framed(title: str, width: float, height: float) -> Figure:
    """An empty figure with its title; sizes in inches."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415
    from matplotlib.figure import Figure  # noqa: PLC0415

    figure = Figure(figsize=(width, height), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title, fontsize=12)
    return figure


def legend_below(figure: Figure, shown: Axes | Sequence[Artist], columns: int) -> Figure:
    """The figure with one legend for all of it, outside of all axes: of what these axes show, or of these handles."""
    handles = shown if isinstance(shown, Sequence) else shown.get_legend_handles_labels()[0]
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False, fontsize=9)
    return figure


def label_times(panels: Iterable[Axes], *labels: str, time: str = "time [s]", from_zero: bool = False) -> None:
    """Panels one above the other along one time: a label for each, what they share, and zero as their lower end."""
    for panel, label in zip(panels, labels, strict=True):
        panel.set_ylabel(label)
        if from_zero:
            panel.set_ylim(bottom=0)
        panel.margins(x=0.01)
        panel.grid(**GRID)
    panel.set_xlabel(time)


LAW_STYLES: Mapping[str, Mapping[str, Any]] = {
    "optimised": {"color": "#0072B2", "linestyle": "-", "linewidth": 2.0},
    "published": {"color": "#D55E00", "linestyle": "--", "linewidth": 1.5},
}
LAW_NAMES = {"optimised": "ours", "published": "published controller"}


class Panel(NamedTuple):
    """One quantity of a trace over time."""

    label: str
    """With its unit."""
    of: Callable[[Trace], Array]
    """(N,) in the label's unit"""
    limit: float = math.nan
    """A dotted line."""
    low: float = 0.0
    high: float | None = None


def figure_over_time(
    title: str,
    groups: Mapping[str, Mapping[str, Trace]],
    panels: Sequence[Panel],
    *,
    events: Mapping[str, Sequence[float]] | None = None,
    event: str = "",
    gaps: Gaps = (),
) -> Figure:
    """A row for each panel, a column for each group of traces, a line for each controller of a group.

    `events` are times [s] by group, numbered from 1; the legend calls them `event`. `gaps` are hatched.
    """
    figure = framed(title, 9.0, 0.9 + 2.1 * len(panels))
    grid = figure.subplots(len(panels), len(groups), sharex="col", sharey="row", squeeze=False)
    for column, (group, of) in zip(grid.T, groups.items(), strict=True):
        column[0].set_title(group, fontsize=10, loc="left")
        column[-1].set_xlabel("time [s]")
        for axes, panel in zip(column, panels, strict=True):
            for order, (law, trace) in enumerate(of.items()):
                # Dashes over what they agree with.
                style = {**LAW_STYLES[law], "zorder": 4 + 0.5 * order}
                axes.plot(trace["t_s"], panel.of(trace), **style, label=LAW_NAMES[law])
            axes.axhline(panel.limit, color=REFERENCE, linewidth=1, linestyle=":")
            axes.margins(x=0.01)
            axes.grid(**GRID)
            axes.set_ylim(panel.low, panel.high)
            for i, when in enumerate((events or {}).get(group, ()), start=1):
                axes.axvline(when, color=EVENT, linewidth=1, label=event if i == 1 else None)
                at, style = {"xycoords": ("data", "axes fraction"), "va": "top"}, {"fontsize": 8, "color": EVENT}
                axes.annotate(f" {i}", (when, 0.97), **at, **style)
    for axes, panel in zip(grid[:, 0], panels, strict=True):
        axes.set_ylabel(panel.label, fontsize=9)
    mark_gaps([*grid.flat], gaps)
    return legend_below(figure, grid[0, 0], 3)


def labelled_gaps(gaps: Gaps) -> Iterator[tuple[tuple[float, float], str]]:
    """Gaps (from, to) [s] of a recording, the first with a label for all."""
    label = f"no samples: {sum(b - a for a, b in gaps):.2g} s, bridged"
    yield from ((gap, "_" if number else label) for number, gap in enumerate(gaps))


def mark_gaps(panels: Sequence[Axes], gaps: Gaps) -> None:
    """Hatch the gaps of a recording in panels over time."""
    for (first, last), label in labelled_gaps(gaps):
        for axes in panels:
            axes.axvspan(first, last, hatch="//", facecolor="none", edgecolor=REFERENCE, alpha=0.4, label=label)


def columns_figure(title: str, columns: Mapping[str, Any]) -> dict[str, Figure]:
    """Every column of numbers over `t_s`, a panel for each unit; none where there is no time."""
    units: dict[str, list[str]] = {}
    for name, cells in columns.items():
        if name != "t_s" and np.asarray(cells).dtype.kind in "fi":
            units.setdefault(name.rpartition("_")[2], []).append(name)
    if "t_s" not in columns or not units:
        return {}
    figure = framed(title, 9.0, 1.0 + 2.5 * len(units))
    grid = figure.subplots(len(units), 1, sharex=True, squeeze=False)[:, 0]
    for axes, names in zip(grid, units.values(), strict=True):
        for name in names:
            axes.plot(columns["t_s"], columns[name], label=name)
        axes.legend(fontsize=8)
    label_times(grid, *(f"[{unit}]" for unit in units))
    return {"trace": figure}


def path_figure(title: str, reference: Array, paths: Mapping[str, Array]) -> Figure:
    """Paths (N, 3) [m] by controller from above, from the side and from behind, beside their reference (N, 3) [m]."""
    figure = framed(f"{title}\nPath seen from above, from the side and from behind", 11.0, 4.5)
    panels = figure.subplots(1, 3)
    for axes, (a, b) in zip(panels, ((0, 1), (0, 2), (1, 2)), strict=True):
        wide = {"color": REFERENCE, "linewidth": 4.5, "alpha": 0.25}
        axes.plot(MM * reference[:, a], MM * reference[:, b], **wide, label="reference")
        for law, path in paths.items():
            axes.plot(MM * path[:, a], MM * path[:, b], **LAW_STYLES[law], label=LAW_NAMES[law])
        axes.plot(MM * reference[0, a], MM * reference[0, b], "o", color=REFERENCE, markersize=6, label="start")
        axes.set(aspect="equal", adjustable="datalim", xlabel=f"{'xyz'[a]} [mm]", ylabel=f"{'xyz'[b]} [mm]")
        axes.grid(**GRID)
    return legend_below(figure, panels[0], 3)


def joint_figure(
    title: str, chain: SerialChain, joints: Mapping[str, tuple[Array, Array, Mapping[str, Any]]]
) -> Figure:
    """A panel for each joint; `joints` holds times (N,) [s], values (N, n) [rad] and their style by label."""
    rows = math.ceil(chain.n / 2)
    figure = framed(title, 9.0, 1.3 + 1.9 * rows)
    grid = np.atleast_1d(figure.subplots(rows, 2, sharex=True)).ravel()
    limits_seen = False
    for joint, axes in enumerate(grid[: chain.n]):
        for label, (times, q, style) in joints.items():
            axes.plot(times, np.rad2deg(q[:, joint]), **style, label=label)
        limits_seen |= _shade_limits(axes, chain, joint)
        axes.set_title(chain.names[joint].replace("_", " "), fontsize=9, loc="left", parse_math=False)
        axes.set_ylabel("angle [deg]", fontsize=8)
        axes.tick_params(labelsize=8)
    for axes in grid[chain.n - 2 : chain.n]:
        axes.set_xlabel("time [s]", fontsize=9)
        axes.tick_params(labelbottom=True)  # also above a place without a panel
    for axes in grid[chain.n :]:
        axes.set_visible(False)
    what = (
        "Joint angles and the limits near them" if limits_seen else "Joint angles; all limits lie outside these panels"
    )
    figure.suptitle(f"{title}\n{what}", fontsize=12)
    if limits_seen:
        grid[0].plot([], [], color=LIMIT, linewidth=8, alpha=0.6, label="outside the joint's range")
    return legend_below(figure, grid[0], 4)


def _shade_limits(axes: Axes, chain: SerialChain, joint: int) -> bool:
    """Grey where the joint may not be, and whether that is in the panel.

    Limits beyond half a turn are left out, so that the motion can be seen.
    """
    lower, upper = np.rad2deg(chain.lower[joint]), np.rad2deg(chain.upper[joint])
    low, high = axes.dataLim.intervaly
    for limit in (lower, upper):
        if abs(limit) < 180 or lower == upper:
            low, high = min(low, limit), max(high, limit)
    margin = max(0.12 * (high - low), 1.5)
    axes.set_ylim(low - margin, high + margin)
    for outside in ((-1e4, max(lower, -1e4)), (min(upper, 1e4), 1e4)):  # some joints have no ends
        axes.axhspan(*outside, color=LIMIT, alpha=0.6, linewidth=0, zorder=0)
    if chain.locked[joint]:
        axes.annotate("locked: a range of zero width", (0.98, 0.06), xycoords="axes fraction", ha="right", fontsize=7)
    return bool(lower > low - margin or upper < high + margin)


TRUE, TOLD = "#0072B2", "#E69F00"
CLOSE_UP = 0.5
"""[s] shown around the fastest change, where delay and servo can be seen."""


def servo_figure(title: str, names: Sequence[str], trace: Trace, *, lengths: int = 0) -> Figure:
    """Two panels a joint: the whole run, and half a second about its hardest acceleration.

    Parameters
    ----------
    names : (n,) of the joints. lengths : how many of them, the first ones, are in metres; the others are angles.
    """
    figure = framed(
        f"{title}\nJoint speeds, commanded and true: the whole run, and the half second of the largest change",
        11.0,
        1.3 + 1.5 * len(names),
    )
    grid = figure.subplots(len(names), 2, squeeze=False, width_ratios=(2.2, 1), sharex="col")
    time, units = trace["t_s"], np.where(np.arange(len(names)) < lengths, 1.0, 180 / math.pi)
    middle = _moment(trace, lengths)
    near = np.flatnonzero(np.abs(time - middle) <= CLOSE_UP / 2)
    every = np.arange(len(time))
    for joint, (name, axes) in enumerate(zip(names, grid, strict=True)):
        for panel, shown in zip(axes, (every, near), strict=True):
            at = time[shown]
            told, true = (units[joint] * each[shown, joint] for each in (trace["command"], trace["velocity"]))
            # The commands, which answer the encoders' noise, would hide what came of them.
            panel.step(at, told, where="post", color=TOLD, linewidth=0.9, label="commanded")
            panel.plot(at, true, color=TRUE, linewidth=1.4, label="true")
            panel.grid(**GRID)
            panel.margins(x=0.01)
            panel.tick_params(labelsize=8)
        unit = "m/s" if joint < lengths else "deg/s"
        axes[0].set_ylabel(f"[{unit}]", fontsize=8)
        axes[0].set_title(name.replace("_", " "), fontsize=9, loc="left")
    for panel in grid[-1]:
        panel.set_xlabel("time [s]", fontsize=9)
    return legend_below(figure, grid[0, 0], 2)


def _moment(trace: Trace, lengths: int) -> float:
    """[s] of the largest change of a true speed, as a fraction of the fastest joint's of its kind."""
    time, velocity = trace["t_s"], trace["velocity"]
    if len(time) < 3:
        return float(time[0])
    fastest = np.abs(velocity).max(axis=0)
    for kind in (slice(0, lengths), slice(lengths, None)):
        fastest[kind] = max(float(fastest[kind].max(initial=0.0)), 1e-9)
    change = np.abs(np.diff(velocity, axis=0)) / fastest
    return float(time[1 + int(change.max(axis=1).argmax())])


ROOM = 0.97
"""Fraction of the figure's width, or of a panel's, that a text may fill."""
LINE = 1.3
"""Height of a line in sizes of its letters."""
MAX_COLUMNS = 6
FEWEST_LETTERS = 8


def fitted(figure: Figure) -> Figure:
    """The figure itself, its titles broken into lines and its legends into columns that it has room for.

    What is added in height is added to the figure, so that panels keep their size. A dollar that begins no formula is
    a dollar.
    """
    from matplotlib.text import Text  # noqa: PLC0415

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
    wide = _width(text) if line.strip() else 0.0
    if wide <= width or ("$" in line and text.get_parse_math()):  # a formula is not cut in two
        return [line]
    return textwrap.wrap(line, max(FEWEST_LETTERS, int(len(line) * width / wide))) or [line]


def _fit_legend(figure: Figure, legend: Legend) -> None:
    """The figure's legend anew, with fewer columns and then shorter lines, if it is wider than the figure."""
    labels, room = [text.get_text() for text in legend.get_texts()], ROOM * figure.bbox.width
    if not labels or _width(legend) <= room:
        return
    handles, size, before = legend.legend_handles, legend.get_texts()[0].get_fontsize(), _height(legend)
    for columns in range(min(MAX_COLUMNS, len(labels)), 0, -1):
        legend.remove()
        legend = figure.legend(
            handles=handles,
            labels=labels,
            loc="outside lower center",
            ncols=columns,
            frameon=False,
            fontsize=size,
        )
        if _width(legend) <= room:
            break
    _shorten(figure, legend, room)
    figure.set_figheight(figure.get_figheight() + max(_height(legend) - before, 0.0) / figure.dpi)


def _shorten(figure: Figure, legend: Legend, room: float) -> None:
    """Break the labels of a legend that is wider than `room` [pixel]."""
    excess = _width(legend) - room
    if excess > 0:
        widest = max(_width(text) for text in legend.get_texts())
        for text in legend.get_texts():
            _wrap(figure, text, max(widest - excess, 0.2 * room))


def _heighten(figure: Figure, lines: int, size: float) -> None:
    """More height for lines of `size` [point]."""
    if lines > 0:
        figure.set_figheight(figure.get_figheight() + lines * LINE * size / 72)


def _titles(axes: Axes) -> list[Text]:
    """The titles of a panel: what stands in them, and nowhere else."""
    said = {axes.get_title(loc) for loc in ("left", "center", "right")} - {""}
    from matplotlib.text import Text  # noqa: PLC0415

    return [text for text in axes.findobj(Text) if isinstance(text, Text) and text.get_text() in said]


def _is_formula(text: str) -> bool:
    from matplotlib.mathtext import MathTextParser  # noqa: PLC0415

    parser = MathTextParser("agg")
    try:
        for line in text.split("\n"):  # as it is drawn
            parser.parse(line)
    except ValueError:
        return False
    return True


def _width(artist: Text | Legend) -> float:
    return float(artist.get_window_extent().width)


def _height(artist: Text | Legend) -> float:
    return float(artist.get_window_extent().height)
