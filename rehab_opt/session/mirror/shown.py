"""Figures of a mirrored motion, after Figs. 3-11 of Xu, Guo, Zhang 2021."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rehab_opt.published.astar import AStarPath
from rehab_opt.session.drawing import (
    BROAD,
    LAW_STYLES,
    LIMIT,
    MM,
    NARROW,
    OKABE_ITO,
    REFERENCE,
    THIN,
    end_at,
    framed,
    joint_figure,
    label_times,
    legend_below,
    servo_figure,
)
from rehab_opt.session.live.bodies import ArmBodies
from rehab_opt.session.mirror.metrics import CAUSES
from rehab_opt.session.mirror.outcome import BEFORE, PLAN, STEP, MirrorRuns
from rehab_opt.session.outcome import Array

__all__ = ["figures"]


STYLES: Mapping[str, Mapping[str, Any]] = {
    BEFORE: {"color": OKABE_ITO[4], "linestyle": ":"},
    STEP: LAW_STYLES["optimised"],
    PLAN: {"color": OKABE_ITO[2], "linestyle": "-."},
}
ASTAR = LAW_STYLES["published"]
LABELS = {BEFORE: BEFORE, STEP: "tick by tick (step)", PLAN: "as a whole (plan)"}
CAUSE_COLOURS = dict(
    zip(CAUSES, ("#009E73", "#F0E442", "#CC79A7", "#D55E00", "#56B4E9", "#0072B2", "#000000"), strict=True)
)
EVENTS = ("braking", "holding", "backup", "acceleration", "position", "task")


def figures(outcome: MirrorRuns) -> dict[str, Figure]:
    """The figures of a run by file name (without suffix)."""
    led = outcome.laws
    drawn = {
        "manipulability": _manipulability(outcome),
        "position": _position(outcome),
        "joints": joint_figure(
            outcome.chain, {LABELS[name]: (of.time, of.q, STYLES[name]) for name, of in outcome.drives.items()}
        ),
        "pace": _pace(outcome),
        "causes": _causes(outcome),
        "space": _space(outcome),
    }
    if outcome.near is not None:
        drawn["clearance"] = outcome.near.figure(f" ({LABELS[STEP]})")
    motion = led[STEP].motion
    if motion is not None:
        drawn["servos"] = servo_figure(outcome.chain.names, motion, outcome.chain.velocity, of=f" ({LABELS[STEP]})")
    return drawn


def _manipulability(outcome: MirrorRuns) -> Figure:
    """Manipulability over the reference's own time, so that equal moments of the motion are above each other."""
    figure = framed(
        "Manipulability as a fraction of the robot's largest, over the reference's own time, with the floor of "
        f"{outcome.floor:g} and without. n = {_n(outcome)} samples.",
        2.8,
        NARROW,
    )
    axes, end = figure.add_subplot(), float(outcome.time[-1])
    for name, drive in outcome.drives.items():
        moment = drive.time - drive.lag
        moment = np.where(moment <= end, moment, np.nan)  # afterwards the hand settles at the last pose
        axes.plot(moment, drive.manipulability, **STYLES[name], label=LABELS[name])
    path = outcome.astar
    if path is not None:
        largest = outcome.metrics["manipulability_max"]
        w = np.array([outcome.chain.manipulability(q) for q in path.q]) / largest
        axes.plot(_astar_times(outcome, path), w, **ASTAR, label="published A*")
    axes.axhspan(
        -1, outcome.floor, color=LIMIT, alpha=0.4, linewidth=0, zorder=0, label=f"below the floor of {outcome.floor:g}"
    )
    axes.set(xlim=(-0.01 * end, 1.01 * end), xlabel="time in the reference [s]")
    axes.set(ylim=(0, 1), ylabel="manipulability / its maximum")
    return legend_below(figure)


def _position(outcome: MirrorRuns) -> Figure:
    figure = framed(
        "Position of the driven hand over time, the mirrored hand as reference (broad line), and the distance between "
        f"them; allowed are {MM * outcome.max_deviation:g} mm. n = {_n(outcome)} samples.",
        5.2,
    )
    panels = figure.subplots(4, 1, sharex=True)
    for i, axes in enumerate(panels[:3]):
        reference = MM * outcome.reference[:, i, 3]
        axes.plot(outcome.time, reference, color=REFERENCE, linewidth=BROAD, alpha=0.25, label="mirrored hand")
        for name, led in outcome.drives.items():
            axes.plot(led.time, MM * led.tool[:, i, 3], **STYLES[name], label=LABELS[name])
        if outcome.astar is not None:
            positions = MM * outcome.astar.positions[:, i]
            axes.plot(_astar_times(outcome, outcome.astar), positions, **ASTAR, label="published A*")
    for name, led in outcome.drives.items():
        panels[3].plot(led.time, MM * led.deviation, **STYLES[name], label=LABELS[name])
    allowed = panels[3].axhline(MM * outcome.max_deviation, color=REFERENCE, linewidth=THIN, linestyle="--")
    allowed.set_label("allowed distance")
    furthest = (MM * float(np.nanmax(outcome.drives[name].deviation)) for name in (STEP, PLAN))
    label_times(panels, "x [mm]", "y [mm]", "z [mm]", "distance [mm]")
    end_at(panels[3], 1.3 * max(*furthest, 1.0))
    return legend_below(figure)


def _n(outcome: MirrorRuns) -> int:
    return max(len(drive.time) for drive in outcome.drives.values())


def _astar_times(outcome: MirrorRuns, path: AStarPath) -> Array:
    """(K,) [s] of the nearest reference positions: the published path has no times."""
    return np.asarray(outcome.time[np.isfinite(outcome.reference[:, 0, 3])][path.nearest])


def _pace(outcome: MirrorRuns) -> Figure:
    figure = framed(
        "How the reference is slowed in time: seconds of it in a second, and how late it is followed; speed of the "
        f"tool, at most {outcome.linear_speed:g} m/s for a controller with a floor; when what was relaxed. "
        f"n = {_n(outcome)} samples.",
        5.4,
    )
    pace, lag, speed, events = figure.subplots(4, 1, sharex=True, height_ratios=(1, 1, 1, 1.1))
    for name, drive in outcome.drives.items():
        tool = np.linalg.norm(np.diff(drive.tool[:, :3, 3], axis=0), axis=1) / np.diff(drive.time)
        speed.plot(drive.time[1:], tool, **STYLES[name], label=LABELS[name])
        if name != BEFORE:
            pace.plot(drive.time, 100 * drive.pace, **STYLES[name])
            lag.plot(drive.time, drive.lag, **STYLES[name])
    speed.axhline(outcome.linear_speed, color=REFERENCE, linewidth=THIN, linestyle="--", label="limit of the speed")
    _events(events, outcome)
    labels = "speed of the\nreference [%]", "lag [s]", "speed of the\ntool [m/s]", ""
    label_times((pace, lag, speed, events), *labels)
    pace.set_ylim(0, 110 * max(float(drive.pace.max()) for drive in outcome.drives.values()))
    lag.set_ylim(bottom=0)
    end_at(speed, 3 * outcome.linear_speed)
    return legend_below(figure)


def _causes(outcome: MirrorRuns) -> Figure:
    """A strip of time for each drive, and the duration of each cause."""
    figure = framed(
        "What kept the hand from its reference: as a strip of time for each controller, and the seconds of each cause. "
        f"n = {_n(outcome)} samples.",
        5.2,
    )
    when, seconds = figure.subplots(2, 1, height_ratios=(1, 4))
    names = list(outcome.drives)
    for row, (name, drive) in enumerate(outcome.drives.items()):
        cause, dt = outcome.causes[name], float(drive.time[1] - drive.time[0])
        begins = np.append(0, np.flatnonzero(np.diff(cause)) + 1)
        lengths = np.diff(np.append(begins, len(cause)))
        for k, (label, colour) in enumerate(CAUSE_COLOURS.items()):
            strips = [(dt * a, dt * n) for a, n in zip(begins.tolist(), lengths.tolist(), strict=True) if cause[a] == k]
            when.broken_barh(strips, (row - 0.4, 0.8), color=colour, linewidth=0)
            spent = outcome.metrics["laws"][name]["drive"]["seconds_by_cause"][label]
            at = k + 0.3 * (row - (len(names) - 1) / 2)
            seconds.barh(at, spent, height=0.26, color=colour)
            if spent >= 0.05:
                seconds.annotate(f" {name}: {spent:.1f} s", (spent, at), va="center")
    when.set_yticks(range(len(names)), [LABELS[name] for name in names])
    when.set_xlabel("time of the run [s]")
    seconds.set_yticks(range(len(CAUSES)), CAUSES)
    seconds.set_xlabel("time under each cause [s]")
    seconds.margins(x=0.3)  # room for the words behind the longest
    for axes in (when, seconds):
        axes.invert_yaxis()
        axes.grid(visible=False, axis="y")
    return figure


def _events(axes: Axes, outcome: MirrorRuns) -> None:
    """Times of events in the drive, one row for each controller and kind of event."""
    rows = []
    for name in (STEP, PLAN):
        led, drive = outcome.laws[name], outcome.drives[name]
        for event in EVENTS:
            ticks = np.array(
                [event == status or event in said for status, said in zip(led.status, led.relaxed, strict=True)]
            )
            if ticks.any():
                at = np.interp(led.time[ticks], drive.law_time, drive.time)
                rows.append((f"{event} ({name})", at, STYLES[name]["color"]))
    for i, (_, at, colour) in enumerate(rows):
        axes.plot(at, np.full(len(at), i), "|", color=colour, markersize=8)
    axes.set_yticks(range(len(rows)), [label for label, _, _ in rows])
    axes.set_ylim(len(rows) - 0.5, -0.5)
    if not rows:
        axes.set_ylim(0, 1)
        axes.annotate("nothing was relaxed", (0.5, 0.5), xycoords="axes fraction", ha="center")


def _space(outcome: MirrorRuns) -> Figure:
    """The motion in the robot's frame; the robot is drawn in its last posture."""
    figure = framed(
        "The healthy hand, its mirror image and the hand that is led, in the robot's frame [mm]; the robot at the end. "
        f"n = {_n(outcome)} samples.",
        3.6,
        NARROW,
    )
    axes = figure.add_subplot(projection="3d")
    healthy, reference = MM * outcome.recorded, MM * outcome.reference[:, :3, 3]
    axes.plot(*healthy.T, color=OKABE_ITO[3], label="healthy hand")
    axes.plot(*reference.T, color=REFERENCE, linewidth=BROAD, alpha=0.25, label="mirrored hand")
    drawn = [healthy, reference]
    for name, led in outcome.drives.items():
        if name == BEFORE:
            continue
        path = MM * led.tool[:, :3, 3]
        axes.plot(*path.T, **STYLES[name], label=LABELS[name])
        drawn.append(path)
    if outcome.astar is not None:
        axes.plot(*(MM * outcome.astar.positions).T, **ASTAR, label="published A*")
    last = list(outcome.drives.values())[-1].q[-1]
    arm = MM * ArmBodies(outcome.chain).frames(last)[:, :, 3]
    axes.plot(*arm.T, color="#555555", linewidth=BROAD / 2, marker="o", label="robot at the end")
    drawn.append(arm)
    points = np.concatenate(drawn)
    points = points[np.all(np.isfinite(points), axis=1)]
    low, high = points.min(axis=0), points.max(axis=0)
    _draw_mirror(axes, outcome, low, high)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(np.maximum(high - low, 1.0), zoom=1.1)
    axes.view_init(elev=24, azim=-125)
    axes.set(xlabel="x [mm]", ylabel="y [mm]")
    axes.zaxis.set_rotate_label(False)
    axes.set_zlabel("z [mm]", rotation=90)
    return legend_below(figure)


def _draw_mirror(axes: Any, outcome: MirrorRuns, low: Array, high: Array) -> None:
    """The part of the (vertical) sagittal plane within the extent of everything else."""
    normal = np.array(outcome.mirror.normal) / np.linalg.norm(outcome.mirror.normal)
    along, point = np.array([-normal[1], normal[0], 0.0]), MM * np.array(outcome.mirror.point)
    corners = np.array([[x, y, 0.0] for x in (low[0], high[0]) for y in (low[1], high[1])])
    reach = (corners - point) @ along
    across = np.array([reach.min(), reach.max()])
    heights = np.array([low[2], high[2]])
    ground = point[None, :2] + across[:, None] * along[None, :2]
    axes.plot_surface(
        np.tile(ground[:, 0], (2, 1)), np.tile(ground[:, 1], (2, 1)), np.tile(heights[:, None], (1, 2)),
        color=OKABE_ITO[5], alpha=0.15, linewidth=0,
    )  # fmt: skip
    axes.plot([], [], color=OKABE_ITO[5], alpha=0.3, linewidth=2 * BROAD, label="sagittal plane (mirror)")
