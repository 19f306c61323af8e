"""Figures of a mirrored motion, after Figs. 3-11 of Xu, Guo, Zhang 2021."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from rehab_opt.session.drawing import (
    BROAD,
    LAW_STYLES,
    LIMIT,
    MM,
    NARROW,
    OKABE_ITO,
    REFERENCE,
    Panel,
    figure_over_time,
    framed,
    joint_figure,
    legend_below,
    servo_figure,
)
from rehab_opt.session.live.bodies import ArmBodies
from rehab_opt.session.mirror.laws import BEFORE, PLAN, STEP
from rehab_opt.session.mirror.metrics import CAUSES
from rehab_opt.session.mirror.run import Mirrored, task_of
from rehab_opt.session.outcome import Array, Outcome
from rehab_opt.session.trace import Trace

STYLES: Mapping[str, Mapping[str, Any]] = {
    BEFORE: {"color": OKABE_ITO[4], "linestyle": ":", "label": BEFORE},
    STEP: {**LAW_STYLES["optimised"], "label": "tick by tick (step)"},
    PLAN: {"color": OKABE_ITO[2], "linestyle": "-.", "label": "as a whole (plan)"},
}
ASTAR: Mapping[str, Any] = {**LAW_STYLES["published"], "label": "published A*"}
MIRRORED: Mapping[str, Any] = {"color": REFERENCE, "linewidth": BROAD, "alpha": 0.25, "label": "mirrored hand"}
CAUSE_COLOURS = ("#009E73", "#F0E442", "#CC79A7", "#D55E00", "#56B4E9", "#0072B2", "#000000")


def figures(outcome: Outcome) -> dict[str, Figure]:
    """The figures of the runs by file name (without suffix)."""
    task, laws = task_of(outcome), {name: trace for (name,), trace in outcome.traces.items()}
    drives = {name: trace["_drive"].item() for name, trace in laws.items()}
    joints = [(of["t_s"], of["joint"], STYLES[name]) for name, of in drives.items()]
    of_step, near = f" ({STYLES[STEP]['label']})", task.near(laws[STEP])
    drawn = {
        "manipulability": _manipulability(task, drives),
        "joints": joint_figure(task.robot, joints),
        "pace": _pace(task, drives),
        "causes": _causes(laws, drives),
        "space": _space(task, drives),
    }
    if near is not None:
        drawn["clearance"] = near.figure(of_step)
    if "_velocity" in laws[STEP]:
        motion = Trace({**laws[STEP], "velocity": laws[STEP]["_velocity"]})
        drawn["servos"] = servo_figure(task.robot.names, motion, task.robot.velocity, of=of_step)
    return drawn


def _n(drives: Mapping[str, Trace]) -> str:
    return f"n = {max(len(drive['t_s']) for drive in drives.values())} samples."


def _times(task: Mirrored) -> Array:
    """Times (N,) [s] of the reference poses, from zero."""
    return np.asarray(task.setup.reference.times - task.setup.reference.times[0])


def _astar_times(task: Mirrored) -> Array:
    """Times (K,) [s] of the reference positions nearest to the published path, which has no times of its own."""
    assert task.astar is not None
    return np.asarray(_times(task)[~task.setup.reference.lost][task.astar.nearest])


def _manipulability(task: Mirrored, drives: Mapping[str, Trace]) -> Figure:
    """Figure of manipulability over the time of the reference, so that controllers are compared at the same pose."""
    floor, end = task.bounds.floor, float(_times(task)[-1])
    figure = framed(
        "Manipulability as a fraction of the robot's largest, over the reference's own time, with the floor of "
        f"{floor:g} and without. {_n(drives)}",
        2.8,
        NARROW,
    )
    axes = figure.add_subplot()
    for name, drive in drives.items():
        moment = drive["t_s"] - drive["lag_s"]
        moment = np.where(moment <= end, moment, np.nan)  # afterwards the hand settles at the last pose
        axes.plot(moment, drive["manipulability"], **STYLES[name])
    if task.astar is not None:
        w = np.array([task.robot.manipulability(q) for q in task.astar.q]) / task.bounds.max_manipulability
        axes.plot(_astar_times(task), w, **ASTAR)
    below = f"below the floor of {floor:g}"
    axes.axhspan(-1, floor, color=LIMIT, alpha=0.4, linewidth=0, zorder=0, label=below)
    axes.set(xlim=(-0.01 * end, 1.01 * end), xlabel="time in the reference [s]")
    axes.set(ylim=(0, 1), ylabel="manipulability / its maximum")
    return legend_below(figure)


def _pace(task: Mirrored, drives: Mapping[str, Trace]) -> Figure:
    limit, allowed = task.problem.tracker.linear_speed_m_s, task.problem.tracker.max_deviation_mm
    furthest = (MM * float(np.nanmax(drives[name]["deviation_m"])) for name in (STEP, PLAN))

    def speed(of: Trace) -> Array:
        place = of["_tool"][:, :3, 3]
        way = np.linalg.norm(np.diff(place, axis=0, prepend=place[:1]), axis=1)
        return np.asarray(way / (of["t_s"][1] - of["t_s"][0]))

    return figure_over_time(
        f"Distance of the hand from the mirrored one, at most {allowed:g} mm for a controller with a floor; how the "
        "reference is slowed in time: seconds of it in a second, and how late it is followed; speed of the tool, at "
        f"most {limit:g} m/s for a controller with a floor.",
        {"": drives},
        (
            Panel("distance\n[mm]", lambda of: MM * of["deviation_m"], allowed, high=1.3 * max(*furthest, 1.0)),
            Panel("speed of the\nreference [%]", lambda of: 100 * of["pace"]),
            Panel("lag [s]", lambda of: of["lag_s"]),
            Panel("speed of the\ntool [m/s]", speed, limit, high=3 * limit),
        ),
        styles=STYLES,
    )


def _causes(laws: Mapping[str, Trace], drives: Mapping[str, Trace]) -> Figure:
    """Figure with a strip of time for each drive, coloured by cause."""
    figure = framed(f"What kept the hand from its reference, as a strip of time for each controller. {_n(drives)}", 1.9)
    axes = figure.add_subplot()
    for row, (name, drive) in enumerate(drives.items()):
        cause, dt = laws[name]["_cause"], float(drive["t_s"][1] - drive["t_s"][0])
        begins = np.append(0, np.flatnonzero(np.diff(cause)) + 1)
        lengths = np.diff(np.append(begins, len(cause)))
        for k, colour in enumerate(CAUSE_COLOURS):
            strips = [(dt * a, dt * n) for a, n in zip(begins.tolist(), lengths.tolist(), strict=True) if cause[a] == k]
            axes.broken_barh(strips, (row - 0.4, 0.8), color=colour, linewidth=0, label=CAUSES[k])
    axes.set_yticks(range(len(drives)), [STYLES[name]["label"] for name in drives])
    axes.set_xlabel("time of the run [s]")
    axes.invert_yaxis()
    axes.grid(visible=False, axis="y")
    return legend_below(figure)


def _space(task: Mirrored, drives: Mapping[str, Trace]) -> Figure:
    """Figure of the motion in the robot's frame; the robot is drawn in its last posture."""
    figure = framed(
        "The healthy hand, its mirror image and the hand that is led, in the robot's frame [mm]; the robot at the end. "
        f"{_n(drives)}",
        3.6,
        NARROW,
    )
    axes = figure.add_subplot(projection="3d")
    drawn = [MM * task.setup.recorded, MM * task.setup.reference.poses[:, :3, 3]]
    axes.plot(*drawn[0].T, color=OKABE_ITO[3], label="healthy hand")
    axes.plot(*drawn[1].T, **MIRRORED)
    for name in (STEP, PLAN):
        drawn.append(MM * drives[name]["_tool"][:, :3, 3])
        axes.plot(*drawn[-1].T, **STYLES[name])
    if task.astar is not None:
        axes.plot(*(MM * task.astar.positions).T, **ASTAR)
    drawn.append(MM * ArmBodies(task.robot).frames(drives[PLAN]["joint"][-1])[:, :, 3])
    axes.plot(*drawn[-1].T, color="#555555", linewidth=BROAD / 2, marker="o", label="robot at the end")
    points = np.concatenate(drawn)
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    _draw_mirror(axes, task, low, high)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(np.maximum(high - low, 1.0), zoom=1.1)
    axes.view_init(elev=24, azim=-125)
    axes.set(xlabel="x [mm]", ylabel="y [mm]")
    axes.zaxis.set_rotate_label(False)
    axes.set_zlabel("z [mm]", rotation=90)
    return legend_below(figure)


def _draw_mirror(axes: Any, task: Mirrored, low: Array, high: Array) -> None:
    normal = np.array(task.setup.mirror.normal) / np.linalg.norm(task.setup.mirror.normal)
    along, point = np.array([-normal[1], normal[0]]), MM * np.array(task.setup.mirror.point[:2])
    corners = np.array([[x, y] for x in (low[0], high[0]) for y in (low[1], high[1])])
    reach = (corners - point) @ along
    x, y = (point + np.outer((reach.min(), reach.max()), along)).T
    heights = np.tile([[low[2]], [high[2]]], (1, 2))
    axes.plot_surface(np.tile(x, (2, 1)), np.tile(y, (2, 1)), heights, color=OKABE_ITO[5], alpha=0.15, linewidth=0)
    axes.plot([], [], color=OKABE_ITO[5], alpha=0.3, linewidth=2 * BROAD, label="sagittal plane (mirror)")
