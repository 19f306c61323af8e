"""Ranges used, shown: a table; the joints, the workspaces side by side, and how many of drawn people reach what."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch

from rehab_opt.kinematics.human_arm import ARM_JOINTS
from rehab_opt.session.drawing import GRID, MM, REFERENCE, framed, legend_below
from rehab_opt.session.used_ranges.run import GroupResult, UsedRangesOutcome
from rehab_opt.session.workspaces.reached import handle_words, plane_words
from rehab_opt.session.workspaces.shown import (
    SET_STYLES,
    draw_region,
    draw_shoulder,
    region_label,
    region_path,
    seen_from_above,
)
from rehab_opt.workspace.reach_rows import GROUPS, task_title

__all__ = ["figures"]

OFFSETS = (-0.17, 0.17)


def figures(outcome: UsedRangesOutcome) -> dict[str, Figure]:
    """The figures by file name (without suffix)."""
    drawn = {"range_used": _ranges(outcome), "workspace_of_range_used": _workspaces(outcome)}
    if outcome.variation is not None:
        drawn["fraction_of_people"] = _fractions(outcome)
    for figure in drawn.values():
        for _ in range(2):  # panels that share axes of equal scales find their place in the third layout
            figure.draw_without_rendering()
    return drawn


def _ranges(outcome: UsedRangesOutcome) -> Figure:
    figure = framed(f"{outcome.title}\nRange used by a typical limb of each group", 6.0 * len(outcome.tasks) + 1, 5.5)
    panels = figure.subplots(1, len(outcome.tasks), sharey=True, squeeze=False)[0]
    for axes, (task, of_task) in zip(panels, outcome.tasks.items(), strict=True):
        for k, of in enumerate(of_task):
            style = SET_STYLES[k]
            limits = np.rad2deg([of.group.used[joint] for joint in ARM_JOINTS])
            axes.barh(
                np.arange(len(ARM_JOINTS)) + OFFSETS[k], limits[:, 1] - limits[:, 0], left=limits[:, 0], height=0.3,
                facecolor=style["facecolor"], edgecolor=style["edgecolor"], hatch=style.get("hatch"), label=GROUPS[k],
            )  # fmt: skip
        axes.use_sticky_edges = False  # a bar that ends at the frame might go on behind it
        axes.set_yticks(range(len(ARM_JOINTS)), [joint.replace("_", " ") for joint in ARM_JOINTS])
        axes.set_xlabel("angle of the model's joint [deg]")
        axes.set_title(task_title(task), fontsize=10)
        axes.grid(**GRID)
        axes.set_axisbelow(True)
    panels[0].invert_yaxis()
    return legend_below(figure, panels[0], 2)


def _workspaces(outcome: UsedRangesOutcome) -> Figure:
    title = (
        f"{outcome.title}\nWorkspace of the range used, seen from above, in the plane {plane_words(outcome.section)};\n"
        f"{handle_words(outcome.section)}; the same segment lengths for all"
    )
    figure = framed(title, 6.5 * len(outcome.tasks), 7.2)
    panels = figure.subplots(1, len(outcome.tasks), sharex=True, sharey=True, squeeze=False)[0]
    for axes, (task, of_task) in zip(panels, outcome.tasks.items(), strict=True):
        for k, of in enumerate(of_task):
            draw_region(axes, of.reached.workspace, SET_STYLES[k], label=GROUPS[k])
        areas = (region_label(GROUPS[k], of.reached.workspace) for k, of in enumerate(of_task))
        _finish(axes, outcome, "\n".join((task_title(task), *areas)))
    return legend_below(figure, panels[0], 3)


def _fractions(outcome: UsedRangesOutcome) -> Figure:
    variation = outcome.variation
    assert variation is not None
    figure = framed(
        f"{outcome.title}\nShare of {variation.people} people, drawn around each range used, who reach a point;\n"
        f"plane {plane_words(outcome.section)}, {handle_words(outcome.section)}",
        6.5 * len(GROUPS),
        1.6 + 4.2 * len(outcome.tasks),
    )
    grid = figure.subplots(len(outcome.tasks), len(GROUPS), sharex=True, sharey=True, squeeze=False)
    shown = None
    for row, of_task in zip(grid, outcome.tasks.values(), strict=True):
        for axes, of in zip(row, of_task, strict=True):
            shown = _draw_fractions(axes, of, variation.at_least) or shown
            _finish(axes, outcome, of.label)
    if shown is not None:
        figure.colorbar(shown, ax=grid, shrink=0.7).set_label("fraction of the people who reach the point")
    return legend_below(figure, grid[0][0], 2)


def _draw_fractions(axes: Axes, of: GroupResult, at_least: float) -> Any:
    """The fractions as an image; None where nobody reaches anything."""
    label = f"reached by {100 * at_least:g} % of them or more"
    axes.plot([], [], color=REFERENCE, linewidth=1.5, label=label)
    if of.fractions is None or of.fractions.grid.size == 0:
        axes.annotate("nobody reaches this plane", (0.5, 0.5), xycoords="axes fraction", ha="center")
        return None
    held = np.where(of.fractions.grid > 0, of.fractions.grid, np.nan)
    image = axes.pcolormesh(
        MM * of.fractions.x, MM * of.fractions.y, held, cmap="cividis", vmin=0, vmax=1, shading="nearest"
    )
    axes.add_patch(
        PathPatch(region_path(of.fractions.region(at_least)), fill=False, edgecolor=REFERENCE, linewidth=1.5)
    )
    return image


def _finish(axes: Axes, outcome: UsedRangesOutcome, title: str) -> None:
    draw_shoulder(axes, outcome.section)
    seen_from_above(axes, outcome.section)
    axes.set_aspect("equal", adjustable="box")  # the panels share their axes
    axes.set_axisbelow(True)
    axes.set_title(title, fontsize=10)
