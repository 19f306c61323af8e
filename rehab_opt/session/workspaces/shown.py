"""Workspaces shown: a table, and figures as in Fig. 3 of Rossa et al., slices (b) and volumes (a)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from rich.table import Table
from rich.text import Text

from rehab_opt.session.cells import Numbers, Rows
from rehab_opt.session.drawing import MM, framed, legend_below
from rehab_opt.session.workspaces.reached import handle_words, plane_words
from rehab_opt.session.workspaces.region_drawing import (
    SET_STYLES,
    draw_region,
    draw_shoulder,
    is_placed,
    region_label,
    seen_from_above,
)
from rehab_opt.session.workspaces.run import WorkspaceOutcome

__all__ = ["AREA_ROWS", "figures", "percent", "set_columns", "table"]


def figures(outcome: WorkspaceOutcome) -> dict[str, Figure]:
    """The figures by file name (without suffix)."""
    drawn = {"workspace": _slices(outcome)}
    if outcome.volumes:
        drawn["volume"] = _volumes(outcome)
    return drawn


def _slices(outcome: WorkspaceOutcome) -> Figure:
    where = f"Reachable workspace seen from above, in the plane {plane_words(outcome.section)};"
    figure = framed(f"{outcome.title}\n{where}\n{handle_words(outcome.section)}", 8.0, 7.5)
    axes = figure.add_subplot()
    order = sorted(outcome.sets, key=lambda name: -outcome.sets[name].workspace.area)
    styles = {name: SET_STYLES[i % len(SET_STYLES)] for i, name in enumerate(outcome.sets)}
    for name in order:  # the largest below the others
        workspace = outcome.sets[name].workspace
        draw_region(axes, workspace, styles[name], label=region_label(name, workspace))
    draw_shoulder(axes, outcome.section)
    seen_from_above(axes, outcome.section)
    legend_below(figure, axes, 1 if any(of.workspace.empty for of in outcome.sets.values()) else 2)
    return figure


def _volumes(outcome: WorkspaceOutcome) -> Figure:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]  # noqa: PLC0415  (slow to import, rarely drawn)

    held = sorted({upright for _, upright in outcome.volumes}, reverse=True)
    figure = framed(f"{outcome.title}\nReachable volume", 6.0 * len(held) + 1, 6.5)
    names = list(outcome.sets)
    sizes: dict[str, list[str]] = {name: [] for name in names}
    views = figure.subplots(1, len(held), subplot_kw={"projection": "3d"}, squeeze=False)[0]
    for axes, upright in zip(views, held, strict=True):
        corners = []
        for i, name in enumerate(names):
            volume = outcome.volumes[name, upright]
            words = "held" if upright else "free"
            sizes[name].append(f"{words} {1e3 * volume.volume:.3g} l" if not volume.empty else f"{words}: empty")
            if volume.empty:
                continue
            corners.append(MM * volume.vertices)
            mesh = Poly3DCollection(corners[-1][volume.triangles], alpha=0.25 if i == 0 else 0.6, shade=True,
                                    facecolors=SET_STYLES[i % len(SET_STYLES)]["facecolor"])  # fmt: skip
            axes.add_collection3d(mesh)
        x, y, z = MM * np.array(outcome.section.shoulder_m)
        axes.scatter([x], [y], [z], color="black", s=40)
        around = np.concatenate([*corners, [[x, y, z]]])
        low, high = around.min(axis=0), around.max(axis=0)
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
        axes.set_box_aspect(np.maximum(high - low, 1.0))
        axes.view_init(elev=18, azim=-60)
        placed = is_placed(outcome.section)
        axes.set_xlabel("x of the robot [mm]" if placed else "right of the shoulder [mm]")
        axes.set_ylabel("y of the robot [mm]" if placed else "in front [mm]")
        axes.set_zlabel("z of the robot [mm]" if placed else "above [mm]")
        axes.set_title(handle_words(outcome.section) if upright else "the handle free", fontsize=10)
    handles = [
        Patch(facecolor=SET_STYLES[i % len(SET_STYLES)]["facecolor"], label=f"{name} ({'; '.join(sizes[name])})")
        for i, name in enumerate(names)
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=2, frameon=False, fontsize=9)
    return figure


def table(outcome: WorkspaceOutcome) -> Table:
    """Rows of quantities with their units, a column for each range of motion."""
    sets = outcome.metrics["sets"]
    caption = f"plane {plane_words(outcome.section)}, {handle_words(outcome.section)}"
    grid = set_columns(outcome.title, sets, caption)
    for label, value in AREA_ROWS:
        grid.add_row(label, *(value(numbers) for numbers in sets.values()))
    for other in sets if len(sets) > 1 else ():
        shares = (numbers["share_inside"].get(other) for numbers in sets.values())
        grid.add_row(Text(f"share of it inside {other}, %"), *map(percent, shares))
    grid.add_row("time to find it, s", *(f"{numbers['seconds']:.2f}" for numbers in sets.values()))
    volumes = outcome.metrics["volumes"]
    for key, label in (("handle_held", "volume, handle held as above, l"), ("handle_free", "volume, handle free, l")):
        if any(key in numbers for numbers in volumes.values()):
            grid.add_row(label, *(_litres(volumes[name].get(key)) for name in sets))
    return grid


def set_columns(title: str, names: Any, caption: str) -> Table:
    """An empty table with a column for each named set."""
    grid = Table(title=Text(title), caption=Text(caption), caption_justify="left")
    grid.add_column("quantity")
    for name in names:
        grid.add_column(Text(name), justify="right")
    return grid


def _extent(axis: str) -> Callable[[Numbers], str]:
    def cell(of: Numbers) -> str:
        low, high = of[f"{axis}_min_m"], of[f"{axis}_max_m"]
        return "-" if low is None else f"{1e3 * low:.0f} to {1e3 * high:.0f}"

    return cell


def _area(of: Numbers) -> str:
    return "0 (empty)" if of["empty"] else f"{1e4 * of['area_m2']:.4g}"


def percent(share: float | None) -> str:
    """A share, or that there is none."""
    return "-" if share is None else f"{100 * share:.1f}"


def _litres(of: Numbers | None) -> str:
    return "-" if of is None else f"{1e3 * of['volume_m3']:.3g} +- {1e3 * of['volume_bound_m3']:.2g}"


AREA_ROWS: Rows = (
    ("area, cm^2", _area),
    ("separate parts; holes", lambda of: f"{of['components']}; {of['holes']}"),
    ("extent to the right, x, mm", _extent("x")),
    ("extent forwards, y, mm", _extent("y")),
    ("accuracy of the boundary, mm", lambda of: f"{1e3 * of['accuracy_m']:.2g}"),
)
