"""Parts that all figures share: style, empty figure, colours, legends, and panels over time.

A figure has no title. Its caption is stored as the figure's label, and a run writes all captions to `captions.md`.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.session.outcome import Array
from rehab_opt.session.trace import Trace

if TYPE_CHECKING:  # imported where a figure is made; reading a problem needs none
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.legend import Legend
    from matplotlib.lines import Line2D
    from matplotlib.text import Text


Gaps: TypeAlias = Sequence[tuple[float, float]]
"""Intervals (from, to) [s] without samples."""
OKABE_ITO = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""Colours that every kind of colour vision distinguishes."""
REFERENCE, MISSED, LIMIT, EVENT = "#000000", "#CC79A7", "#BBBBBB", "#009E73"
WIDE, NARROW = 7.2, 3.5
"""[inches] Width of a figure that spans both columns of a journal page, and of one that spans a single column."""
THIN, BROAD = 0.6, 4.0
"""[points] Line widths of a single trial, and of a reference below the paths that follow it; others are in `STYLE`."""
STYLE: dict[Any, Any] = {
    "font.size": 8,
    "axes.titlesize": "medium",
    "axes.titlelocation": "left",
    "axes.linewidth": 0.6,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.prop_cycle": f"cycler('color', {list(OKABE_ITO)})",
    "grid.color": "#DDDDDD",
    "grid.linewidth": 0.5,
    "hatch.linewidth": 0.5,
    "legend.frameon": False,
    "lines.linewidth": 1.2,
    "lines.markersize": 4,
    "pdf.fonttype": 42,
    "savefig.dpi": 300,
}
MM = 1e3
ACROSS, FORWARD = "x, to the right [mm]", "y, forward [mm]"
"""Axis labels for positions relative to the shoulder."""


@contextmanager
def styled() -> Iterator[None]:
    """Context in which matplotlib has the style of all figures; needed to draw a figure and to save it."""
    from matplotlib import rc_context  # noqa: PLC0415

    with rc_context(STYLE):
        yield


def framed(caption: str, height: float, width: float = WIDE) -> Figure:
    """An empty figure with its caption; sizes in inches."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415
    from matplotlib.figure import Figure  # noqa: PLC0415

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    figure.set_label(caption)
    return figure


def legend_below(figure: Figure, handles: Sequence[Artist] = ()) -> Figure:
    """Add one legend below all axes, for `handles` or, by default, for all labelled curves; return the figure."""
    of: dict[str, Artist] = {}
    for axes in figure.axes if not handles else ():
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            of.setdefault(label, handle)
    chosen = list(handles or of.values())
    if chosen:
        figure.legend(handles=chosen, loc="outside lower center", ncols=len(chosen))
    return figure


def label_times(panels: Iterable[Axes], *labels: str, time: str = "time [s]", from_zero: bool = False) -> None:
    """Label a column of panels that share a time axis; with `from_zero`, their y axes start at zero."""
    for panel, label in zip(panels, labels, strict=True):
        panel.set_ylabel(label)
        if from_zero:
            panel.set_ylim(bottom=0)
        panel.margins(x=0.01)
    panel.set_xlabel(time)
    panel.figure.align_ylabels()


def end_at(axes: Axes, top: float, *, bottom: float = 0.0) -> None:
    """Set the y limits of a panel; a note in its corner names the curves that go beyond `top`, with their peaks."""
    axes.set_ylim(bottom, top)
    peaks = [(str(line.get_label()), _peak(axes, line)) for line in axes.lines]
    beyond = [f"{label} {peak:.3g}" for label, peak in peaks if peak > top and not label.startswith("_")]
    if beyond:
        axes.annotate(
            "beyond this panel: " + ", ".join(beyond), (0.99, 0.96), xycoords="axes fraction", ha="right", va="top"
        )


def _peak(axes: Axes, line: Line2D) -> float:
    """Largest value of a line; -inf for vertical lines, which mark events."""
    values = np.asarray(line.get_ydata(), dtype=np.float64)
    counts = np.isfinite(values) & line.get_transform().contains_branch_seperately(axes.transData)[1]
    return float(np.max(values[counts], initial=-math.inf))


LAW_STYLES: Mapping[str, Mapping[str, Any]] = {
    "optimised": {"color": OKABE_ITO[0], "linestyle": "-", "label": "ours"},
    "published": {"color": OKABE_ITO[1], "linestyle": "--", "label": "published controller"},
}
STRETCHED = 2.0
"""No panel extends beyond this multiple of its limit; a note names the curves that do."""


class Panel(NamedTuple):
    """One quantity of a trace over time."""

    label: str
    """Label with its unit."""
    of: Callable[[Trace], Array]
    """Function from a trace to the plotted values (N,), in the label's unit."""
    limit: float = math.nan
    """Value of a dashed line that marks a limit; NaN for none."""
    low: float = 0.0
    high: float | None = None


def figure_over_time(
    caption: str,
    groups: Mapping[str, Mapping[str, Trace]],
    panels: Sequence[Panel],
    *,
    events: Mapping[str, Sequence[float]] | None = None,
    event: str = "",
    gaps: Gaps = (),
    styles: Mapping[str, Mapping[str, Any]] = LAW_STYLES,
) -> Figure:
    """Figure with a row for each panel, a column for each group of traces, and a curve for each controller.

    `events` are times [s] by group, which are marked and numbered from 1; the legend calls them `event`. `gaps` are
    hatched. No panel extends beyond twice its limit; a note names the curves that do.
    """
    count = max(len(trace["t_s"]) for of in groups.values() for trace in of.values())
    figure = framed(f"{caption} n = {count} ticks a run.", 0.7 + 1.3 * len(panels))
    grid = figure.subplots(len(panels), len(groups), sharex="col", sharey="row", squeeze=False)
    for number, (column, (group, of)) in enumerate(zip(grid.T, groups.items(), strict=True)):
        column[0].set_title(group)
        for axes, panel in zip(column, panels, strict=True):
            for order, (law, trace) in enumerate(of.items()):
                # Draw later curves on top, so that dashes are visible over an equal curve.
                axes.plot(trace["t_s"], panel.of(trace), **{**styles[law], "zorder": 4 + 0.5 * order})
            for i, when in enumerate((events or {}).get(group, ()), start=1):
                axes.axvline(when, color=EVENT, linewidth=THIN, label=event if i == 1 else None)
                at = {"xycoords": ("data", "axes fraction"), "va": "top"}
                axes.annotate(f" {i}", (when, 0.97), color=EVENT, **at)
        label_times(column, *("" if number else panel.label for panel in panels))
    for row, panel in zip(grid, panels, strict=True):
        _scale(row, panel)
    mark_gaps([*grid.flat], gaps)
    return legend_below(figure)


def _scale(row: Iterable[Axes], panel: Panel) -> None:
    """Set the y limits that the panels of a row share."""
    row = list(row)
    peak = max(axes.dataLim.y1 for axes in row)
    for axes in row:
        if panel.high is not None:
            end_at(axes, panel.high, bottom=panel.low)
        elif peak > STRETCHED * panel.limit:
            end_at(axes, STRETCHED * panel.limit, bottom=panel.low)
        else:
            axes.set_ylim(panel.low, max(1.08 * peak, 0.0 if math.isnan(panel.limit) else 1.08 * panel.limit))
        if math.isfinite(panel.limit):
            axes.axhline(panel.limit, color=REFERENCE, linewidth=THIN, linestyle="--", label="limit")


def labelled_gaps(gaps: Gaps) -> Iterator[tuple[tuple[float, float], str]]:
    """Gaps (from, to) [s], each with its label; one label stands in the legend for all gaps."""
    label = f"no samples: {sum(b - a for a, b in gaps):.2g} s, bridged"
    yield from ((gap, "_" if number else label) for number, gap in enumerate(gaps))


def mark_gaps(panels: Sequence[Axes], gaps: Gaps) -> None:
    """Hatch the gaps of a recording in panels over time."""
    for (first, last), label in labelled_gaps(gaps):
        for axes in panels:
            axes.axvspan(first, last, hatch="//", facecolor="none", edgecolor=REFERENCE, alpha=0.4, label=label)


def columns_figure(columns: Mapping[str, Any]) -> dict[str, Figure]:
    """Every numeric column over `t_s`, one panel for each unit; no figure without times."""
    units: dict[str, list[str]] = {}
    for name, cells in columns.items():
        if name != "t_s" and np.asarray(cells).dtype.kind in "fi":
            units.setdefault(name.rpartition("_")[2], []).append(name)
    if "t_s" not in columns or not units:
        return {}
    figure = framed(f"All columns of trace.csv over time, n = {len(columns['t_s'])} rows.", 0.7 + 1.6 * len(units))
    grid = figure.subplots(len(units), 1, sharex=True, squeeze=False)[:, 0]
    for axes, names in zip(grid, units.values(), strict=True):
        for name in names:
            axes.plot(columns["t_s"], columns[name], label=name)
        axes.legend()
    label_times(grid, *(f"[{unit}]" for unit in units))
    return {"trace": figure}


def path_figure(reference: Array, paths: Mapping[str, Array]) -> Figure:
    """Figure of paths (N, 3) [m], by controller, and their reference (N, 3) [m], seen from above, side and behind."""
    caption = "Path of the tool [mm] seen from above, from the side and from behind, over its reference (broad line);"
    figure = framed(f"{caption} n = {len(reference)} ticks.", 2.6)
    panels = figure.subplots(1, 3)
    for axes, (a, b) in zip(panels, ((0, 1), (0, 2), (1, 2)), strict=True):
        wide = {"color": REFERENCE, "linewidth": BROAD, "alpha": 0.25}
        axes.plot(MM * reference[:, a], MM * reference[:, b], **wide, label="reference")
        for law, path in paths.items():
            axes.plot(MM * path[:, a], MM * path[:, b], **LAW_STYLES[law])
        axes.plot(MM * reference[0, a], MM * reference[0, b], "o", color=REFERENCE, label="start")
        axes.set(aspect="equal", adjustable="datalim", xlabel=f"{'xyz'[a]} [mm]", ylabel=f"{'xyz'[b]} [mm]")
    return legend_below(figure)


def joint_figure(chain: SerialChain, joints: Sequence[tuple[Array, Array, Mapping[str, Any]]]) -> Figure:
    """One panel for each joint; `joints` holds times (N,) [s], values (N, n) [rad], and their style and label."""
    rows, count = math.ceil(chain.n / 2), max(len(times) for times, _, _ in joints)
    figure = framed(
        "Angles of the joints [deg] over time. Each panel is headed by the joint's range; grey: outside it, where that "
        f"is near. n = {count} samples.",
        0.8 + 1.05 * rows,
    )
    grid = np.atleast_1d(figure.subplots(rows, 2, sharex=True)).ravel()
    limits_seen = False
    for joint, axes in enumerate(grid[: chain.n]):
        for times, q, style in joints:
            axes.plot(times, np.rad2deg(q[:, joint]), **style)
        limits_seen |= _shade_limits(axes, chain, joint)
        axes.set_title(f"{chain.names[joint].replace('_', ' ')}, {_range(chain, joint)}", parse_math=False)
        axes.margins(x=0.01)
    for axes in grid[: chain.n : 2]:
        axes.set_ylabel("angle [deg]")
    for axes in grid[chain.n - 2 : chain.n]:
        axes.set_xlabel("time [s]")
        axes.tick_params(labelbottom=True)  # also above an empty cell of the grid
    for axes in grid[chain.n :]:
        axes.set_visible(False)
    if limits_seen:
        grid[0].plot([], [], color=LIMIT, linewidth=2 * BROAD, alpha=0.6, label="outside the joint's range")
    return legend_below(figure)


def _range(chain: SerialChain, joint: int) -> str:
    low, high = (round(math.degrees(limit), 1) + 0.0 for limit in (chain.lower[joint], chain.upper[joint]))
    if chain.locked[joint]:
        return f"locked at {low:g} deg"
    return f"{low:g} to {high:g} deg" if math.isfinite(low) else "no limits"


def _shade_limits(axes: Axes, chain: SerialChain, joint: int) -> bool:
    """Shade the range outside the joint's limits; returns whether it is visible in the panel.

    Limits beyond half a turn are left out, so that the motion stays visible.
    """
    lower, upper = np.rad2deg(chain.lower[joint]), np.rad2deg(chain.upper[joint])
    low, high = axes.dataLim.intervaly
    for limit in (lower, upper):
        if abs(limit) < 180 or lower == upper:
            low, high = min(low, limit), max(high, limit)
    margin = max(0.12 * (high - low), 1.5)
    axes.set_ylim(low - margin, high + margin)
    for outside in ((-1e4, max(lower, -1e4)), (min(upper, 1e4), 1e4)):  # some joints have infinite limits
        axes.axhspan(*outside, color=LIMIT, alpha=0.6, linewidth=0, zorder=0)
    return bool(lower > low - margin or upper < high + margin)


TRUE, COMMANDED = OKABE_ITO[0], OKABE_ITO[4]
CLOSE_UP = 0.5
"""[s] Length of the close-up around the fastest change, which shows delay and response of the servo."""


def servo_figure(
    names: Sequence[str],
    trace: Trace,
    most: Array,
    *,
    of: str = "",
    lengths: int = 0,
    what: str = "Speeds of the joints",
    unit: str = "m/s",
) -> Figure:
    """Two panels for each joint: the whole run, and half a second around the run's largest acceleration.

    Parameters
    ----------
    names : names of the n joints. trace : trace with the columns `command` and (true) `velocity` (N, n).
    most : (n,) speed limits [rad/s, m/s]. of : name of the run in the caption, if there are several runs.
    lengths : number of joints, from the first one, that are in metres; the others are angles.
    what, unit : for quantities other than speeds: text of the caption, and unit of the joints that are in metres.
    """
    figure = framed(
        f"{what}{of}, commanded and true: the whole run, and the half second of the largest change. "
        f"n = {len(trace['t_s'])} ticks.",
        0.8 + 0.95 * len(names),
    )
    grid = figure.subplots(len(names), 2, squeeze=False, width_ratios=(2.2, 1), sharex="col")
    time, units = trace["t_s"], np.where(np.arange(len(names)) < lengths, 1.0, 180 / math.pi)
    middle = _moment(trace, lengths)
    near = np.flatnonzero(np.abs(time - middle) <= CLOSE_UP / 2)
    every = np.arange(len(time))
    for joint, (name, axes) in enumerate(zip(names, grid, strict=True)):
        for panel, shown in zip(axes, (every, near), strict=True):
            at = time[shown]
            commanded, true = (units[joint] * trace[key][shown, joint] for key in ("command", "velocity"))
            # Thin and below, since commands that react to encoder noise would hide the true speeds.
            panel.step(at, commanded, where="post", color=COMMANDED, linewidth=THIN, label="commanded")
            panel.plot(at, true, color=TRUE, label="true")
            panel.margins(x=0.01)
        own = unit if joint < lengths else "deg/s"
        axes[0].set_ylabel(f"[{own}]")
        axes[0].set_title(f"{name.replace('_', ' ')}, at most {units[joint] * most[joint]:.3g} {own}")
    for panel in grid[-1]:
        panel.set_xlabel("time [s]")
    return legend_below(figure)


def _moment(trace: Trace, lengths: int) -> float:
    """Time [s] of the largest change of a true speed, relative to the fastest joint with the same unit."""
    time, velocity = trace["t_s"], trace["velocity"]
    if len(time) < 3:
        return float(time[0])
    fastest = np.abs(velocity).max(axis=0)
    for kind in (slice(0, lengths), slice(lengths, None)):
        fastest[kind] = max(float(fastest[kind].max(initial=0.0)), 1e-9)
    change = np.abs(np.diff(velocity, axis=0)) / fastest
    return float(time[1 + int(change.max(axis=1).argmax())])


ROOM = 0.97
"""Largest width of a text, as a fraction of the width of its figure or panel."""
LINE = 1.3 * STYLE["font.size"] / 72
"""[inches] Height of a line of text."""
FEWEST_LETTERS = 8


def fitted(figure: Figure) -> Figure:
    """Break headings into lines, and legends into columns, that fit the figure's width; return the figure.

    The figure grows by the added height, so that panels keep their size. Dollar signs outside formulas stay.
    """
    from matplotlib.text import Text  # noqa: PLC0415

    for text in figure.findobj(Text):
        if isinstance(text, Text) and "$" in text.get_text() and not _is_formula(text.get_text()):
            text.set_parse_math(False)
    figure.draw_without_rendering()
    for legend in list(figure.legends):
        _fit_legend(figure, legend)
    for axes in figure.axes:
        inside = axes.get_legend()
        if inside is not None:
            _shorten(figure, inside, ROOM * axes.bbox.width)
        lines = [_wrap(figure, text, max(axes.bbox.width, 0.15 * figure.bbox.width)) for text in _titles(axes)]
        figure.set_figheight(figure.get_figheight() + max(lines, default=0) * LINE)
    return figure


def _wrap(figure: Figure, text: Text, width: float) -> int:
    """Break lines of a text that are wider than `width` [pixel]; returns the number of added lines."""
    before = text.get_text()
    after = "\n".join(part for line in before.split("\n") for part in _parts(figure, text, line, ROOM * width))
    text.set_text(after)
    return after.count("\n") - before.count("\n")


def _parts(figure: Figure, text: Text, line: str, width: float) -> list[str]:
    text.set_text(line)
    wide = _width(text) if line.strip() else 0.0
    if wide <= width or ("$" in line and text.get_parse_math()):  # do not break a formula
        return [line]
    return textwrap.wrap(line, max(FEWEST_LETTERS, int(len(line) * width / wide))) or [line]


def _fit_legend(figure: Figure, legend: Legend) -> None:
    """If the legend is wider than the figure, redraw it with fewer columns, and then break its labels."""
    labels, room = [text.get_text() for text in legend.get_texts()], ROOM * figure.bbox.width
    handles, before = legend.legend_handles, _height(legend)
    for columns in sorted({math.ceil(len(labels) / rows) for rows in range(2, len(labels) + 1)}, reverse=True):
        if _width(legend) <= room:
            break
        legend.remove()
        legend = figure.legend(handles=handles, labels=labels, loc="outside lower center", ncols=columns)
    _shorten(figure, legend, room)
    figure.set_figheight(figure.get_figheight() + max(_height(legend) - before, 0.0) / figure.dpi)


def _shorten(figure: Figure, legend: Legend, room: float) -> None:
    """Break the labels of a legend that is wider than `room` [pixel]."""
    excess = _width(legend) - room
    if excess > 0:
        widest = max(_width(text) for text in legend.get_texts())
        for text in legend.get_texts():
            _wrap(figure, text, max(widest - excess, 0.2 * room))


def _titles(axes: Axes) -> list[Text]:
    from matplotlib.text import Text  # noqa: PLC0415

    said = {axes.get_title(loc) for loc in ("left", "center", "right")} - {""}
    return [text for text in axes.findobj(Text) if isinstance(text, Text) and text.get_text() in said]


def _is_formula(text: str) -> bool:
    from matplotlib.mathtext import MathTextParser  # noqa: PLC0415

    parser = MathTextParser("agg")
    try:
        for line in text.split("\n"):  # matplotlib parses each line separately
            parser.parse(line)
    except ValueError:
        return False
    return True


def _width(artist: Text | Legend) -> float:
    return float(artist.get_window_extent().width)


def _height(artist: Text | Legend) -> float:
    return float(artist.get_window_extent().height)
