"""Figures of a run of `upper_limb`: the hand's path from above, the joints, and the errors of hand and handle."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rehab_opt.session.drawing import (
    ACROSS,
    BROAD,
    FORWARD,
    LAW_STYLES,
    MISSED,
    MM,
    NARROW,
    REFERENCE,
    Panel,
    figure_over_time,
    framed,
    joint_figure,
    labelled_gaps,
    legend_below,
)
from rehab_opt.session.outcome import Array, Outcome
from rehab_opt.session.trace import Trace
from rehab_opt.session.upper_limb.drive import law_columns

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SEEN = 1.0  # smallest distance [mm] of the hand from its plane that the legend mentions


def figures(outcome: Outcome) -> dict[str, Figure]:
    """Figures of a run by file name without suffix."""
    (scene,), (trace,) = outcome.scenes.values(), outcome.traces.values()
    of = {law: law_columns(trace, law) for law in scene.laws}
    joints = [(each["drive_time_s"], each["drive_joint"], LAW_STYLES[law]) for law, each in of.items()]
    return {
        "hand_path": _hand_path(outcome, scene, of),
        "joints": joint_figure(scene.arm, joints),
        "error": _errors(scene, trace["t_s"], trace.get("reachable"), of),
    }


def _hand_path(outcome: Outcome, scene: Any, of: dict[str, dict[str, Any]]) -> Figure:
    (trace,) = outcome.traces.values()
    path, time, reachable, depth = MM * trace["path"], trace["t_s"], trace.get("reachable"), -trace["path"][0, 2]
    where = f"{abs(depth):g} m {'below' if depth >= 0 else 'above'} the shoulder"
    figure = framed(
        f"Path of the driven hand with each controller, seen from above [mm], over the reference (broad line), in the "
        f"plane {where}. n = {len(path)} samples of the path.",
        3.4,
        NARROW,
    )
    axes = figure.add_subplot()
    axes.plot(path[:, 0], path[:, 1], color=REFERENCE, linewidth=BROAD, alpha=0.25, label="reference")
    axes.plot(*path[0, :2], "o", color=REFERENCE, label="start")
    if reachable is not None and not reachable.all():
        fraction = 100 * (1 - outcome.metrics["reachable_fraction_of_length"])
        label = f"out of this arm's reach ({fraction:.0f} % of the path)"
        axes.plot(*path[~reachable, :2].T, "x", color=MISSED, label=label)
    for (first, last), label in labelled_gaps(scene.recording.gaps):
        bridge = path[(time >= first) & (time <= last)]
        axes.plot(bridge[:, 0], bridge[:, 1], color=MISSED, linewidth=2 * BROAD, alpha=0.3, zorder=1, label=label)
    for law, each in of.items():
        height = MM * outcome.metrics[law]["drive"]["height_off_plane_max_m"]
        off = f" (up to {height:.0f} mm off the plane)" if height >= SEEN else ""
        axes.plot(
            *(MM * each["drive_hand"][:, :2]).T, **{**LAW_STYLES[law], "label": f"{LAW_STYLES[law]['label']}{off}"}
        )
    axes.set(aspect="equal", adjustable="datalim", xlabel=ACROSS, ylabel=FORWARD)
    return legend_below(figure)


def _errors(scene: Any, time: Array, reachable: NDArray[np.bool_] | None, of: dict[str, dict[str, Any]]) -> Figure:
    limit = scene.problem.arm.handle_tilt_deg
    figure = figure_over_time(
        "Distance of the driven hand from the reference, tilt of the handle from the vertical (at most "
        f"{limit:g} deg), and how much later than the recording the hand is there, over the recording's time; shaded: "
        "path out of this arm's reach.",
        {"": {law: Trace({**each, "t_s": time}) for law, each in of.items()}},
        (
            Panel("position error\n[mm]", lambda of: MM * of["drive_position_error_m"]),
            Panel("handle tilt\n[deg]", lambda of: np.rad2deg(of["drive_handle_tilt_rad"]), limit),
            Panel("delay [s]", lambda of: of["drive_t_s"] - of["t_s"]),
        ),
        gaps=scene.recording.gaps,
    )
    for axes in figure.axes:
        _shade_missed(axes, time, np.zeros(len(time), dtype=bool) if reachable is None else ~reachable)
    return figure


def _shade_missed(axes: Axes, time: Array, missed: NDArray[np.bool_]) -> None:
    edges = np.flatnonzero(np.diff(np.concatenate(([False], missed, [False])).astype(int)))
    half = (time[1] - time[0]) / 2
    for first, after in list(pairwise(edges))[::2]:
        axes.axvspan(time[first] - half, time[after - 1] + half, color=MISSED, alpha=0.3, linewidth=0, zorder=0)
