"""Figures of maps between workspaces as in Fig. 8 of Rossa et al., and of the folds of these maps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Patch, PathPatch
from matplotlib.transforms import Bbox

from rehab_opt.session.arm_keys import ArmInPlane
from rehab_opt.session.drawing import MM, OKABE_ITO, REFERENCE, THIN, framed, legend_below
from rehab_opt.session.outcome import Array, Outcome
from rehab_opt.session.workspace_maps.made import Direction, MadeMap
from rehab_opt.session.workspaces.figures import draw_region, region_path, seen_from_above
from rehab_opt.workspace.region import Workspace

GRID_LINES = 16
"""Number of grid lines across the longer side of a set."""
ALONG_A_LINE = 60
ALONG_AN_OUTLINE = 600
PIXELS = 260
FOLDED, OUTSIDE = OKABE_ITO[1], OKABE_ITO[3]
PATH_STYLES: Sequence[Mapping[str, Any]] = (
    {"color": OKABE_ITO[0], "linestyle": "-"},
    {"color": OKABE_ITO[1], "linestyle": "--"},
    {"color": OKABE_ITO[2], "linestyle": "-."},
    {"color": REFERENCE, "linestyle": ":"},
)
OUTLINE: Mapping[str, Any] = {"facecolor": "#DDDDDD", "edgecolor": "#333333", "linestyle": "-"}
DENSITY = (0.1, 10.0)
"""Range of the colour scale: local enlargement of area divided by the ratio of the two sets' areas."""


def figures(outcome: Outcome) -> dict[str, Figure]:
    """Figures of a run by file name without suffix."""
    drawn, (scene,), (trace,) = {}, outcome.scenes.values(), outcome.traces.values()
    for direction in scene.directions(trace):
        drawn[f"map_{direction.key}"] = _before_and_after(direction)
        drawn[f"folds_{direction.key}"] = _folds(direction)
    return drawn


def _before_and_after(direction: Direction) -> Figure:
    """Figure of the sets before and after the map; the lower row has the same panels on one scale."""
    names = f"{direction.start.name} to {direction.end.name}"
    what = "Grid and trajectories before and after" if direction.before else "Grid before and after"
    figure = framed(f"{what} the map from {names} [mm]; above each panel on its own scale, below all on one.", 4.6)
    large, alike = figure.subplots(2, 1 + len(direction.maps), height_ratios=(4, 3))
    _draw_panels(large, direction)
    _draw_panels(alike, direction)
    for axes in alike:
        axes.set_title("")
    seen = Bbox.union([axes.dataLim for axes in alike]).expanded(1.06, 1.06)
    for axes in alike:
        axes.set(xlim=seen.intervalx, ylim=seen.intervaly, adjustable="box")
    return legend_below(figure)


def _draw_panels(panels: Sequence[Axes], direction: Direction) -> None:
    first, *rest = panels
    start, end = direction.start_space, direction.end_space
    draw_region(first, start, OUTLINE, label="workspace")
    for k, line in enumerate(_grid(start)):
        first.plot(*(MM * line.T), color="#777777", linewidth=THIN, label="grid" if k == 0 else None)
    first.plot([], [], color=REFERENCE, linewidth=THIN, linestyle=":", label="edge of the workspace, mapped")
    for k, (name, path) in enumerate(direction.before.items()):
        _draw_path(first, path, k, name)
    _finish(first, f"before: {direction.start.name}", direction.start.section)
    for axes, made in zip(rest, direction.maps, strict=True):
        draw_region(axes, end, OUTLINE)
        if made.mapped is None:
            axes.annotate("no map", (0.5, 0.5), xycoords="axes fraction", ha="center")
        else:
            for ring in _outline(start):
                axes.plot(*(MM * made.mapped.spline(ring).T), color=REFERENCE, linewidth=THIN, linestyle=":")
            for line in _grid(start):
                axes.plot(*(MM * made.mapped.spline(line).T), color="#777777", linewidth=THIN)
            for k, (name, path) in enumerate(direction.after[made.rule].items()):
                _draw_path(axes, path, k, name)
        _finish(axes, f"after, {made.rule} rule: {direction.end.name}\n{_verdict(made)}", direction.end.section)


def _verdict(made: MadeMap) -> str:
    if made.audit is None:
        return "no map by this rule"
    folded, outside = 100 * made.audit.folded, 100 * made.audit.outside
    size = f"folded {folded:.3g} %, outside {outside:.3g} %"
    return f"{size}\n{'passes its audit' if made.audit.passed else 'NOT for a controller'}"


def _draw_path(axes: Axes, points: Array, index: int, name: str) -> None:
    style = PATH_STYLES[index % len(PATH_STYLES)]
    axes.plot(*(MM * points.T), **style, label=name)
    axes.plot(*(MM * points[0]), "o", color=style["color"])


def _finish(axes: Axes, title: str, section: ArmInPlane) -> None:
    axes.set_title(title)
    seen_from_above(axes, section)


def _grid(workspace: Workspace) -> Iterator[Array]:
    """Lines (n, 2) [m] of a square grid inside a workspace."""
    left, low, right, high = workspace.polygon.bounds
    step = max(right - left, high - low) / GRID_LINES
    columns = np.arange(left + step / 2, right, step)
    lines = [shapely.LineString([(x, low), (x, high)]) for x in columns]
    lines += [shapely.LineString([(left, y), (right, y)]) for y in np.arange(low + step / 2, high, step)]
    for piece in shapely.get_parts(shapely.intersection(lines, workspace.polygon)):
        if piece.length > 0:
            dense = shapely.segmentize(piece, max(right - left, high - low) / (GRID_LINES * ALONG_A_LINE / 10))
            yield shapely.get_coordinates(dense)


def _outline(workspace: Workspace) -> Iterator[Array]:
    """Closely spaced points (n, 2) [m] along each outline of a workspace."""
    for ring in shapely.get_parts(workspace.polygon.boundary):
        yield shapely.get_coordinates(shapely.segmentize(ring, ring.length / ALONG_AN_OUTLINE))


def _folds(direction: Direction) -> Figure:
    names = f"{direction.start.name} to {direction.end.name}"
    figure = framed(
        f"Local enlargement of area by the map from {names}, in units of the whole sets' ratio, over "
        f"{direction.start.name} [mm]; and where the map folds or leaves {direction.end.name}.",
        3.2,
    )
    start, end = direction.start_space, direction.end_space
    panels = figure.subplots(1, len(direction.maps), squeeze=False)[0]
    shown = None
    for axes, made in zip(panels, direction.maps, strict=True):
        if made.mapped is not None and made.audit is not None:
            shown = _draw_folds(axes, made, start, end)
        else:
            axes.annotate("no map", (0.5, 0.5), xycoords="axes fraction", ha="center")
        axes.add_patch(PathPatch(region_path(start), fill=False, edgecolor=REFERENCE))
        _finish(axes, f"{made.rule} rule\n{_verdict(made)}", direction.start.section)
    if shown is not None:
        bar = figure.colorbar(
            shown, ax=list(panels), shrink=0.8, extend="both", ticks=[0.1, 0.3, 1, 3, 10], format="%g"
        )
        bar.minorticks_off()
        bar.set_label("local enlargement of area\n(1: as the whole set's)")
    marks = [
        Patch(facecolor=FOLDED, edgecolor="none", label="folded: movements are reversed there"),
        Patch(facecolor="none", edgecolor=OUTSIDE, hatch="////", label=f"mapped outside {direction.end.name}"),
    ]
    return legend_below(figure, marks)


def _draw_folds(axes: Axes, made: MadeMap, start: Workspace, end: Workspace) -> Any:
    """Draw the map's local enlargement of area, relative to the sets' ratio; return the image for a colour bar."""
    assert made.mapped is not None
    assert made.audit is not None
    left, low, right, high = start.polygon.bounds
    step = max(right - left, high - low) / PIXELS
    x, y = np.arange(left, right + step, step), np.arange(low, high + step, step)
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    inside = np.asarray(start.contains(points))
    density, away = np.full(len(points), np.nan), np.zeros(len(points))
    density[inside] = np.linalg.det(made.mapped.spline.jacobian(points[inside])) / made.audit.overall_ratio**2
    away[inside] = ~np.asarray(end.contains(made.mapped.spline(points[inside])))
    shape = len(y), len(x)
    extent = MM * np.array([x[0] - step / 2, x[-1] + step / 2, y[0] - step / 2, y[-1] + step / 2])
    held = np.where(density > 0, density, np.nan).reshape(shape)
    folded = np.where(inside & ~(density > 0), 1.0, np.nan).reshape(shape)
    shared: dict[str, Any] = {"origin": "lower", "extent": tuple(extent), "interpolation": "nearest"}
    image = axes.imshow(held, cmap="cividis", norm=LogNorm(*DENSITY), **shared)
    axes.imshow(folded, cmap=ListedColormap([FOLDED]), **shared)
    if away.any():
        marked = axes.contourf(MM * x, MM * y, away.reshape(shape), levels=[0.5, 1.5], colors="none", hatches=["////"])
        marked.set_edgecolor(OUTSIDE)
        marked.set_linewidth(0.0)
    return image
