"""Chair and arm under one stick, shown: a table, figures from above, of the hand and of the limits used, and a film."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon
from rich.table import Table
from rich.text import Text

from rehab_opt.control.obstacles import HalfPlane
from rehab_opt.session.ardis.clearance import arm_points, chair_corners
from rehab_opt.session.ardis.outcome import LAWS, ArdisOutcome, Motion
from rehab_opt.session.drawing import GRID, LAW_STYLES, REFERENCE, framed, legend_below, servo_figure
from rehab_opt.session.shown import Numbers, Rows, counts, law_table

__all__ = ["brief", "figures", "table"]


OBSTACLE, GOAL = "#BBBBBB", "#009E73"
INSTANTS = 4
"""Chairs that are drawn, from the first to the last."""
SEEN = 100
"""Postures of the arm that the panels have room for, evenly over the run."""
EDGE = 0.35
"""[m] drawn around what moves."""
ABOVE = 0.03
"""[m] Goals nearer than this, seen from above, share a label: two would lie on each other."""
NAMES = {"published": "published law, Eq. (1)", "optimised": "ours"}
ORDER = {"optimised": 4, "published": 4.5}
"""Dashes are drawn over what they agree with."""


def figures(outcome: ArdisOutcome) -> dict[str, Figure]:
    """The figures by file name (without suffix)."""
    drawn = {"top_view": _top_view(outcome), "hand": _hand(outcome), "limits": _limits(outcome)}
    for drive, near in outcome.near.items():
        drawn[f"clearance_{drive}"] = near.figure(f"{outcome.title}, {drive} drive, ours")
    for drive, of in outcome.drives.items():
        motion = of.optimised.motion
        if motion is not None:
            title = f"{outcome.title}, {drive} drive, ours"
            drawn[f"servos_{drive}"] = servo_figure(title, outcome.robot.chain.names, motion, lengths=2)
    return drawn


def _top_view(outcome: ArdisOutcome) -> Figure:
    x, y = seen_from_above(outcome)
    # Side by side where the scene is tall, one above the other where it is wide.
    count = len(outcome.drives)
    stacked = count == 1 or np.ptp(x) > 1.3 * np.ptp(y)
    panel = 7.5 * np.ptp(y) / np.ptp(x) + 0.9 if stacked else 5.5
    size = (8.5, 1.6 + count * panel) if stacked else (5.0 * count, 7.0)
    figure = framed(f"{outcome.title}\nseen from above; chair and arm of our law at {INSTANTS} instants", *size)
    grid = np.atleast_1d(figure.subplots(count if stacked else 1, 1 if stacked else count)).ravel()
    for axes, (drive, of) in zip(grid, outcome.drives.items(), strict=True):
        draw_room(axes, outcome, x, y)
        _draw_chairs(axes, outcome, of.optimised)
        for law, motion in of.by_law.items():
            axes.plot(
                motion.hand[:, 0], motion.hand[:, 1], **LAW_STYLES[law], label=f"hand, {NAMES[law]}", zorder=ORDER[law]
            )
        axes.plot(*of.optimised.hand[0, :2], "o", color=REFERENCE, markersize=5, label="hand at the start", zorder=5)
        axes.set_title(f"{drive} drive", fontsize=10, loc="left")
    return legend_below(figure, grid[0], 3)


def seen_from_above(outcome: ArdisOutcome) -> tuple[np.ndarray, np.ndarray]:
    """Limits (2,) of x and y [m] that show our motions, the goals and the posts near them."""
    points = [np.array([goal.hand_m[:2] for goal in outcome.goals]).reshape(-1, 2)]
    for of in outcome.drives.values():
        motion = of.optimised
        arms = arm_points(outcome.robot, motion.q[:: max(1, len(motion.q) // SEEN)])[:, :, :2]
        points += [chair_corners(outcome.robot.outline, motion.q).reshape(-1, 2), motion.hand[:, :2]]
        points.append(arms.reshape(-1, 2))
    every = np.vstack(points)
    low, high = every.min(axis=0) - EDGE, every.max(axis=0) + EDGE
    return np.array([low[0], high[0]]), np.array([low[1], high[1]])


def draw_room(axes: Axes, outcome: ArdisOutcome, x: np.ndarray, y: np.ndarray) -> None:
    """Walls, posts and goals."""
    for obstacle in outcome.room:
        if isinstance(obstacle, HalfPlane):
            normal = np.asarray(obstacle.normal) / np.hypot(*obstacle.normal)
            along, edge = np.array([-normal[1], normal[0]]), normal * obstacle.offset / np.hypot(*obstacle.normal)
            far = 100.0
            corners = [edge + far * way for way in (along, -along, normal - along, normal + along)]
            axes.add_patch(Polygon(corners, closed=True, color=OBSTACLE, linewidth=0, zorder=0))
        else:
            axes.add_patch(Circle(obstacle.centre, obstacle.radius, color=OBSTACLE, linewidth=0, zorder=0))
    if outcome.room:
        axes.plot([], [], "s", color=OBSTACLE, markersize=9, label="obstacle of the chair")
    places = [(goal.hand_m[0], goal.hand_m[1]) for goal in outcome.goals]
    for goal, place in zip(outcome.goals, places, strict=True):
        axes.add_patch(Circle(place, goal.within_m, fill=False, color=GOAL, linewidth=1.5, zorder=3))
    if places:
        label = "goal, as wide as its tolerance"
        axes.plot([], [], "o", markerfacecolor="none", color=GOAL, linestyle="", label=label)
    for numbers, place in _goal_labels(places):
        axes.annotate(numbers, place, xytext=(5, 5), textcoords="offset points", fontsize=9, color=GOAL, zorder=6)
    axes.set(xlim=x, ylim=y, aspect="equal", xlabel="x, forward [m]", ylabel="y, left [m]")
    axes.grid(**GRID)


def _goal_labels(places: list[tuple[float, float]]) -> list[tuple[str, tuple[float, float]]]:
    """Numbers of the goals, those above each other together: "1, 3"."""
    labels: list[tuple[str, tuple[float, float]]] = []
    for i, place in enumerate(places, start=1):
        same = next((k for k, (_, there) in enumerate(labels) if np.hypot(*np.subtract(there, place)) < ABOVE), None)
        if same is None:
            labels.append((str(i), place))
        else:
            labels[same] = (f"{labels[same][0]}, {i}", labels[same][1])
    return labels


def _draw_chairs(axes: Axes, outcome: ArdisOutcome, motion: Motion) -> None:
    # As far apart on the chair's way as can be, so that a chair that stands is drawn once; on the arm's if it stands.
    steps = np.abs(np.diff(motion.q, axis=0))
    moving = steps[:, :3] if steps[:, :3].any() else steps[:, 3:]
    way = np.concatenate([[0.0], np.cumsum(moving.sum(axis=1))])
    picked = np.searchsorted(way, np.linspace(0, way[-1], INSTANTS)).clip(max=len(way) - 1)
    q = motion.q[picked]
    corners, arms = chair_corners(outcome.robot.outline, q), arm_points(outcome.robot, q)
    for i, (outline, arm) in enumerate(zip(corners, arms, strict=True)):
        shade = 0.25 + 0.75 * i / (INSTANTS - 1)
        closed = np.vstack([outline, outline[:1]])
        label = "chair, later ones darker" if i == INSTANTS - 1 else None
        axes.plot(closed[:, 0], closed[:, 1], color=REFERENCE, linewidth=1.2, alpha=shade, label=label, zorder=2)
        front = outline[[0, 1]]  # as `chair_corners` has them: its front
        axes.plot(front[:, 0], front[:, 1], color=REFERENCE, linewidth=3, alpha=shade, zorder=2)
        axes.plot(arm[:, 0], arm[:, 1], "o-", color="#56B4E9", linewidth=2, markersize=3, alpha=shade, zorder=3)
    axes.plot([], [], "o-", color="#56B4E9", linewidth=2, markersize=3, label="arm")


def _hand(outcome: ArdisOutcome) -> Figure:
    figure = framed(f"{outcome.title}\nheight of the hand, and the chair's way", 9.0, 6.0)
    grid = figure.subplots(2, len(outcome.drives), sharex="col", sharey="row", squeeze=False)
    for column, (drive, of) in zip(grid.T, outcome.drives.items(), strict=True):
        for law, motion in of.by_law.items():
            gone = np.cumsum(np.hypot(motion.velocity[:, 0], motion.velocity[:, 1])) * motion.dt
            column[0].plot(motion.time, motion.hand[:, 2], **LAW_STYLES[law], label=NAMES[law], zorder=ORDER[law])
            column[1].plot(motion.time, gone, **LAW_STYLES[law], zorder=ORDER[law])
        # A law that leaves its limits may go anywhere: the room is shown.
        column[0].set_ylim(-0.2, 1.8)
        column[1].set_ylim(0, 1.3 * max(1e-2, outcome.metrics["drives"][drive]["optimised"]["chair_path_m"]))
        column[0].axhline(0, color=REFERENCE, linewidth=1, linestyle=":")
        reached = outcome.metrics["drives"][drive]["optimised"]["goals"].values()
        for i, when in enumerate((when for when in reached if when is not None), start=1):
            for axes in column:
                axes.axvline(when, color=GOAL, linewidth=1)
            column[0].annotate(
                str(i), (when, 0.97), xycoords=("data", "axes fraction"), xytext=(2, 0),
                textcoords="offset points", va="top", fontsize=8, color=GOAL,
            )  # fmt: skip
        column[0].set_title(f"{drive} drive", fontsize=10, loc="left")
        column[1].set_xlabel("time [s]")
        for axes in column:
            axes.grid(**GRID)
    if any(of["optimised"]["goals_met"] for of in outcome.metrics["drives"].values()):
        grid[0, 0].plot([], [], color=GOAL, linewidth=1, label="goal reached by ours")
    grid[0, 0].set_ylabel("hand above the floor [m]")
    grid[1, 0].set_ylabel("way of the chair [m]")
    return legend_below(figure, grid[0, 0], 3)


def _limits(outcome: ArdisOutcome) -> Figure:
    figure = framed(f"{outcome.title}\nhow much of its limits each law uses", 9.0, 8.0)
    grid = figure.subplots(3, len(outcome.drives), sharex="col", sharey="row", squeeze=False)
    chain = outcome.robot.chain
    arm = 3 + np.flatnonzero(np.isfinite(chain.upper[3:]))  # joints without ends are nowhere near one
    middle, half = (chain.upper[arm] + chain.lower[arm]) / 2, (chain.upper[arm] - chain.lower[arm]) / 2
    for column, (drive, of) in zip(grid.T, outcome.drives.items(), strict=True):
        limit = outcome.robot.drive(drive).limit
        for law, motion in of.by_law.items():
            speeds = np.column_stack(
                [np.hypot(motion.chassis[:, 0], motion.chassis[:, 1]) / chain.velocity[0],
                 np.abs(motion.chassis[:, 2:]) / chain.velocity[2:],
                 np.abs(motion.wheels) / limit]
            )  # fmt: skip
            last = np.vstack([np.zeros(chain.n), motion.chassis[:-1]])
            accelerations = np.abs(motion.chassis - last) / motion.dt / chain.acceleration
            ranges = np.abs(motion.q[:, arm] - middle) / half
            for axes, fractions in zip(column, (ranges, speeds, accelerations), strict=True):
                axes.plot(
                    motion.time,
                    100 * fractions.max(axis=1, initial=0.0),
                    **{**LAW_STYLES[law], "linewidth": 1.0},
                    label=NAMES[law],
                    zorder=ORDER[law],
                )
        for axes in column:
            axes.axhline(100, color=REFERENCE, linewidth=1, linestyle=":")
            axes.set_ylim(0, 200)
            axes.grid(**GRID)
        column[0].set_title(f"{drive} drive", fontsize=10, loc="left")
        column[2].set_xlabel("time [s]")
    for axes, name in zip(
        grid[:, 0], ("arm joint nearest to its limit", "fastest joint or wheel", "hardest acceleration"), strict=True
    ):
        axes.set_ylabel(f"{name}\n[% of limit]", fontsize=9)
    return legend_below(figure, grid[0, 0], 2)


def table(outcome: ArdisOutcome) -> Table:
    """Rows of quantities with their units, a column for each drive and law."""
    columns = _columns(outcome)
    grid = law_table(outcome.title, columns, (*FIRST_ROWS, *MORE_ROWS))
    for goal in outcome.goals:
        fractions = (_leg(of["legs"].get(goal.name)) for of in columns.values())
        grid.add_row(Text(f"  on the way to: {goal.name}"), *fractions)
    return grid


def brief(outcome: ArdisOutcome) -> Table:
    """The first of them."""
    return law_table(outcome.title, _columns(outcome), FIRST_ROWS)


def _columns(outcome: ArdisOutcome) -> dict[str, Numbers]:
    drives = outcome.metrics["drives"]
    return {f"{drive}\n{law}": drives[drive][law] for drive in drives for law in LAWS}


def _fractions(name: str) -> Callable[[Numbers], str]:
    def cell(of: Numbers) -> str:
        arm = of[f"hand_{name}_arm_fraction"]
        return "-" if arm is None else f"{100 * arm:z.0f} / {100 * (1 - arm):z.0f}"

    return cell


def _leg(of: Numbers | None) -> str:
    if of is None:
        return "not reached"
    energy, alone = of["kinetic_energy_mean_J"], of["kinetic_energy_chair_alone_mean_J"]
    return f"{_fractions('path')(of)}; {_joules(energy)} / {_joules(alone)}"


def _joules(energy: float | None) -> str:
    return "-" if energy is None else f"{energy:.2g}"


def _margin(kind: str) -> Callable[[Numbers], str]:
    def cell(of: Numbers) -> str:
        if of["excess_max"].get(kind) is None:
            return "-"
        return f"{-of['excess_max'][kind] + 0.0:.3g} ({100 * of['broken_fraction'][kind]:.1f} %)"

    return cell


def _residual(of: Numbers) -> str:
    residual = of["rolling_residual_max_m_s"]
    return "no such row" if residual is None else f"{residual:.1e}"


FIRST_ROWS: Rows = (
    ("goals reached", lambda of: f"{of['goals_met']} of {len(of['goals'])}"),
    ("duration, s", lambda of: f"{of['duration_s']:.1f}"),
    ("ticks that break a limit, %", lambda of: f"{100 * of['broken_any_fraction']:.2f}"),
    ("room to joint limits, rad (ticks beyond)", _margin("position")),
    ("arm to chair and user, m", _margin("keep_out")),
    ("chair to obstacles, m", _margin("obstacles")),
    ("ticks by status", lambda of: counts(of["status"])),
)
MORE_ROWS: Rows = (
    ("path of the hand; of the chair, m", lambda of: f"{of['hand_path_m']:.2f}; {of['chair_path_m']:.2f}"),
    ("hand's path given by arm / chair, %", _fractions("path")),
    ("hand's turning given by arm / chair, %", _fractions("turn")),
    (
        "mean kinetic energy / chair alone, J",
        lambda of: f"{_joules(of['kinetic_energy_mean_J'])} / {_joules(of['kinetic_energy_chair_alone_mean_J'])}",
    ),
    ("room to speeds, m/s or rad/s (ticks beyond)", _margin("velocity")),
    ("to accelerations, m/s^2 or rad/s^2", _margin("acceleration")),
    ("to wheel speeds, rad/s", _margin("wheels")),
    ("motion that the drive does not allow, m/s", _residual),
    ("largest tilt of the hand from its start, deg", lambda of: f"{of['hand_tilt_max_deg']:.2g}"),
    ("ticks in which the stick moved nothing", lambda of: counts(of["stick_ignored"]) or "0"),
    ("ticks in which the law braked or rested", lambda of: counts(of["stopped"]) or "0"),
    ("ticks in which something was relaxed", lambda of: counts(of["relaxed"]) or "0"),
    ("ways: arm / chair, %; mean energy / chair alone, J", lambda of: ""),
)
