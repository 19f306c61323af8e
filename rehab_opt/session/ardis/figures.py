"""Figures of an `ardis` run: the scene from above, the hand over time, and how much of each limit is used."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rehab_opt.control.obstacles import HalfPlane, Obstacle
from rehab_opt.kinematics.mobile_arm import MobileArm
from rehab_opt.session.ardis.clearance import arm_points, chair_corners
from rehab_opt.session.ardis.measures import goals_met
from rehab_opt.session.ardis.problem import GoalSection
from rehab_opt.session.drawing import (
    BROAD,
    EVENT,
    LAW_STYLES,
    NARROW,
    OKABE_ITO,
    REFERENCE,
    WIDE,
    Panel,
    figure_over_time,
    framed,
    legend_below,
    servo_figure,
)
from rehab_opt.session.outcome import Array, Outcome
from rehab_opt.session.trace import Trace

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

OBSTACLE, ARM = "#BBBBBB", OKABE_ITO[5]
INSTANTS = 4
"""Number of instants at which the chair is drawn, from the first to the last."""
SEEN = 100
"""Number of arm postures, evenly spaced over the run, that must fit into the picture."""
EDGE = 0.35
"""[m] Margin around everything that moves."""
ABOVE = 0.03
"""[m] Goals that are closer together than this, seen from above, share one label."""


def figures(outcome: Outcome) -> dict[str, Figure]:
    """Figures by file name; the outcome's scenes and traces are named (drive, controller)."""
    scenes, traces = outcome.scenes, outcome.traces
    scene, drives = next(iter(scenes.values())), list(dict.fromkeys(drive for drive, _ in traces))
    ours = {drive: traces[drive, "optimised"] for drive in drives}
    groups = {f"{drive} drive": {law: traces[drive, law] for law in ("optimised", "published")} for drive in drives}
    goals = {f"{drive} drive": goals_met(trace, scene.problem.goals) for drive, trace in ours.items()}
    events = {group: [when for when in met if when is not None] for group, met in goals.items()}
    found = {
        "top_view": _top_view(scene.robot, scene.room, scene.problem.goals, traces),
        "hand": figure_over_time(
            "Height of the hand, and path of the chair, over time. Each controller is steered on its own.",
            groups,
            _hand_panels(ours.values(), scene.dt),
            events=events,
            event="goal reached by ours",
        ),
        "limits": figure_over_time(
            "How much of its limits each controller uses, over time: the arm's joint that is nearest to an end of its "
            "range, the fastest joint or wheel, and the hardest acceleration; a note names what exceeds a "
            "limit twice and more.",
            groups,
            _limit_panels(scene.robot, scene.dt),
        ),
    }
    for drive, trace in ours.items():
        near, named = scenes[drive, "optimised"].near(trace), f" ({drive} drive, our controller)"
        if near is not None:
            found[f"clearance_{drive}"] = near.figure(named)
        if "velocity" in trace:
            world, speeds = Trace({**trace, "command": trace["_world"]}), scene.robot.chain.velocity
            found[f"servos_{drive}"] = servo_figure(scene.names, world, speeds, of=named, lengths=2)
    return found


def _hand_panels(ours: Iterable[Trace], dt: float) -> tuple[Panel, Panel]:
    """Panels of the hand's height and the chair's path; the scale fits our controller."""

    def way(trace: Trace) -> Array:
        return np.asarray(np.cumsum(np.hypot(trace["_world"][:, 0], trace["_world"][:, 1])) * dt)

    far = 1.3 * max(1e-2, *(float(way(trace)[-1]) for trace in ours))
    return (
        Panel("hand above\nthe floor [m]", lambda trace: trace["hand"][:, 2], low=-0.2, high=1.8),
        Panel("path of\nthe chair [m]", way, high=far),
    )


def _limit_panels(robot: MobileArm, dt: float) -> tuple[Panel, ...]:
    chain = robot.chain
    ended = 3 + np.flatnonzero(np.isfinite(chain.upper[3:]))  # only joints with finite limits
    middle, half = (chain.upper[ended] + chain.lower[ended]) / 2, (chain.upper[ended] - chain.lower[ended]) / 2

    def ranges(trace: Trace) -> Array:
        return np.asarray(np.abs(trace["joint"][:, ended] - middle) / half)

    def speeds(trace: Trace) -> Array:
        own = trace["command"]
        level = np.hypot(own[:, 0], own[:, 1]) / chain.velocity[0]
        return np.column_stack([level, np.abs(own[:, 2:]) / chain.velocity[2:], trace["_wheel_use"]])

    def accelerations(trace: Trace) -> Array:
        return np.asarray(np.abs(np.diff(trace["command"], axis=0, prepend=0.0)) / dt / chain.acceleration)

    def panel(label: str, of: Callable[[Trace], Array]) -> Panel:
        return Panel(f"{label}\n[% of limit]", lambda trace: 100 * of(trace).max(axis=1, initial=0.0), 100.0)

    return (
        panel("arm joint nearest\nto its limit", ranges),
        panel("fastest joint\nor wheel", speeds),
        panel("hardest\nacceleration", accelerations),
    )


def _top_view(
    robot: MobileArm, room: Sequence[Obstacle], goals: Sequence[GoalSection], traces: Mapping[Any, Trace]
) -> Figure:
    ours = {drive: trace for (drive, law), trace in traces.items() if law == "optimised"}
    points = [np.array([goal.hand_m[:2] for goal in goals]).reshape(-1, 2)]
    for trace in ours.values():
        q = trace["joint"]
        arms = arm_points(robot, q[:: max(1, len(q) // SEEN)])[:, :, :2]
        points += [chair_corners(robot.outline, q).reshape(-1, 2), trace["hand"][:, :2], arms.reshape(-1, 2)]
    every = np.vstack(points)
    (left, low), (right, high) = every.min(axis=0) - EDGE, every.max(axis=0) + EDGE
    # Side by side where the scene is tall, one above the other where it is wide.
    count, tall = len(ours), (high - low) / (right - left)
    below = count == 1 or tall < 0.55
    width = NARROW if count == 1 else WIDE
    height = count * (0.8 * width * tall + 0.5) if below else (width / count - 0.6) * tall + 0.5
    figure = framed(
        f"Path of the hand seen from above [m], with each controller; chair and arm under ours at {INSTANTS} instants.",
        0.5 + height,
        width,
    )
    grid = np.atleast_1d(figure.subplots(count if below else 1, 1 if below else count)).ravel()
    for axes, (drive, trace) in zip(grid, ours.items(), strict=True):
        _draw_room(axes, room, goals)
        _draw_chairs(axes, robot, trace["joint"])
        for order, law in enumerate(("published", "optimised")):
            style = {**LAW_STYLES[law], "zorder": 4.5 - 0.5 * order}
            axes.plot(*traces[drive, law]["hand"][:, :2].T, **style)
        axes.plot(*trace["hand"][0, :2], "o", color=REFERENCE, label="hand at the start", zorder=5)
        axes.set(xlim=(left, right), ylim=(low, high))
        axes.set_title(f"{drive} drive")
    return legend_below(figure)


def _draw_room(axes: Axes, room: Sequence[Obstacle], goals: Sequence[GoalSection]) -> None:
    from matplotlib.patches import Circle, Polygon  # noqa: PLC0415

    for obstacle in room:
        if isinstance(obstacle, HalfPlane):
            normal = np.asarray(obstacle.normal) / np.hypot(*obstacle.normal)
            along, edge = np.array([-normal[1], normal[0]]), normal * obstacle.offset / np.hypot(*obstacle.normal)
            far = 100.0
            corners = [edge + far * way for way in (along, -along, normal - along, normal + along)]
            axes.add_patch(Polygon(corners, closed=True, color=OBSTACLE, linewidth=0, zorder=0))
        else:
            axes.add_patch(Circle(obstacle.centre, obstacle.radius, color=OBSTACLE, linewidth=0, zorder=0))
    if room:
        axes.plot([], [], "s", color=OBSTACLE, label="obstacle of the chair")
    places = [(goal.hand_m[0], goal.hand_m[1]) for goal in goals]
    for goal, place in zip(goals, places, strict=True):
        axes.add_patch(Circle(place, goal.within_m, fill=False, color=EVENT, linewidth=1.2, zorder=3))
    if places:
        label = "goal and its tolerance"
        axes.plot([], [], "o", markerfacecolor="none", color=EVENT, linestyle="", label=label)
    labels: dict[tuple[float, float], list[str]] = {}
    for i, place in enumerate(places, start=1):
        there = next((of for of in labels if np.hypot(*np.subtract(of, place)) < ABOVE), place)
        labels.setdefault(there, []).append(str(i))
    for i, (place, numbers) in enumerate(labels.items()):
        at = (5, -11 if i % 2 else 4)
        axes.annotate(", ".join(numbers), place, xytext=at, textcoords="offset points", color=EVENT, zorder=6)
    axes.set(aspect="equal", xlabel="x, forward [m]", ylabel="y, left [m]")


def _draw_chairs(axes: Axes, robot: MobileArm, joints: Array) -> None:
    # Evenly spaced along the chair's motion, so that a chair at rest is drawn once; if it never moves, along the arm's.
    steps = np.abs(np.diff(joints, axis=0))
    moving = steps[:, :3] if steps[:, :3].any() else steps[:, 3:]
    way = np.concatenate([[0.0], np.cumsum(moving.sum(axis=1))])
    picked = np.searchsorted(way, np.linspace(0, way[-1], INSTANTS)).clip(max=len(way) - 1)
    q = joints[picked]
    corners, arms = chair_corners(robot.outline, q), arm_points(robot, q)
    for i, (outline, arm) in enumerate(zip(corners, arms, strict=True)):
        shade = 0.25 + 0.75 * i / (INSTANTS - 1)
        closed = np.vstack([outline, outline[:1]])
        label = "chair, later ones darker" if i == INSTANTS - 1 else None
        axes.plot(closed[:, 0], closed[:, 1], color=REFERENCE, alpha=shade, label=label, zorder=2)
        front = outline[[0, 1]]  # the front edge, by the order of `chair_corners`
        axes.plot(front[:, 0], front[:, 1], color=REFERENCE, linewidth=BROAD / 2, alpha=shade, zorder=2)
        axes.plot(arm[:, 0], arm[:, 1], "o-", color=ARM, alpha=shade, zorder=3)
    axes.plot([], [], "o-", color=ARM, label="arm")
