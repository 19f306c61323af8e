"""Drawings of the conventions and of a tick: frames, signs, and the steps of a controller."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Ellipse, FancyArrowPatch, FancyBboxPatch, Rectangle

from rehab_opt.session.drawing import OKABE_ITO, framed

X, Y, Z, BODY, INK, TINT = OKABE_ITO[1], OKABE_ITO[2], OKABE_ITO[0], "#DDDDDD", "#222222", "#EEF3F8"


def frames() -> Figure:
    """The arm's frame, a robot's base and tool, and the chair with a wall and a post, each with its axes."""
    figure = framed("Frames and signs of the arm, of a robot and of a chair.", 2.9)
    for axes, draw in zip(figure.subplots(1, 3), (_person, _robot, _chair), strict=True):
        axes.set_aspect("equal")
        axes.set_axis_off()
        draw(axes)
    return figure


def tick() -> Figure:
    """The steps from a state to a command, and to a fallback command."""
    figure = framed("The steps from a state to a command.", 3.6)
    figure.set_layout_engine("none")
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_axis_off()
    axes.set(xlim=(0, 7.2), ylim=(0, 3.6))
    upper = [
        (0.05, "state\nq, stamp, enable,\ntarget, twist"),
        (1.50, "watchdog\nstamp fresh?\nnumbers finite?"),
        (2.95, "joint positions\nas commanded;\nencoders in range?\njoints follow?"),
        (4.40, "reference\ntwist + gain x error,\nslowed to the speeds"),
        (5.85, "bounds\nof this tick, room\nto brake to rest"),
    ]
    lower = [
        (5.85, "QP\nclosed form, last\nactive set, solver,\nbackup"),
        (4.40, "certificate\nresidual of the\nstated problem"),
        (2.95, "true state\nat the tick's end\nwithin all limits?"),
        (1.50, "command\nvalue, status,\nreason, relaxed"),
    ]
    _row(axes, upper, 2.55)
    _row(axes, lower, 1.35)
    for (left, _), (right, _) in pairwise(upper):
        _arrow(axes, (left + 1.30, 2.97), (right, 2.97))
    _arrow(axes, (6.50, 2.55), (6.50, 2.19))
    for (right, _), (left, _) in pairwise(lower):
        _arrow(axes, (right, 1.77), (left + 1.30, 1.77))
    _box(
        axes,
        2.95,
        0.15,
        "fallback command\nbrake within the limits, then hold;\na force: let go",
        width=2.75,
        colour="#FBEBE0",
    )
    axes.plot((2.15, 2.15, 0.72, 0.72), (2.55, 2.40, 2.40, 0.52), color=X, linewidth=1.2)
    _arrow(axes, (0.72, 0.52), (2.95, 0.52), X)
    axes.plot((3.60, 3.60), (2.55, 2.40), color=X, linewidth=1.2)
    axes.plot((3.60, 2.15), (2.40, 2.40), color=X, linewidth=1.2)
    _arrow(axes, (5.05, 1.35), (5.05, 0.99), X)
    axes.text(5.12, 1.12, "not certified", color=X, va="center")
    axes.text(0.80, 0.62, "no", color=X)
    axes.plot((2.95, 2.15), (0.35, 0.35), color=X, linewidth=1.2)
    _arrow(axes, (2.15, 0.35), (2.15, 1.35), X)
    return figure


def _row(axes: Axes, boxes: Sequence[tuple[float, str]], bottom: float) -> None:
    for left, words in boxes:
        _box(axes, left, bottom, words)


def _box(axes: Axes, left: float, bottom: float, words: str, *, width: float = 1.30, colour: str = TINT) -> None:
    shape = FancyBboxPatch((left, bottom), width, 0.84, boxstyle="round,pad=0,rounding_size=0.06")
    shape.set(facecolor=colour, edgecolor=INK, linewidth=0.8)
    axes.add_patch(shape)
    head, _, rest = words.partition("\n")
    axes.text(left + width / 2, bottom + 0.79, head, weight="bold", ha="center", va="top")
    axes.text(left + width / 2, bottom + 0.60, rest, ha="center", va="top", linespacing=1.15)


def _arrow(axes: Axes, begin: tuple[float, float], end: tuple[float, float], colour: str = INK) -> None:
    style = {"arrowstyle": "-|>", "mutation_scale": 9, "shrinkA": 0, "shrinkB": 0, "linewidth": 1.2, "color": colour}
    axes.add_patch(FancyArrowPatch(begin, end, **style))


def _axis(axes: Axes, origin: tuple[float, float], along: tuple[float, float], words: str, colour: str) -> None:
    """An axis with its name beyond the arrow's head."""
    end = (origin[0] + along[0], origin[1] + along[1])
    _arrow(axes, origin, end, colour)
    across = "left" if along[0] > 0.01 else "right" if along[0] < -0.01 else "center"
    above = "center" if abs(along[1]) < 0.5 * abs(along[0]) else "bottom" if along[1] > 0 else "top"
    size = max(abs(along[0]), abs(along[1]))
    at = (end[0] + 0.02 * along[0] / size, end[1] + 0.02 * along[1] / size)
    axes.text(*at, words, color=colour, ha=across, va=above)


def _out(axes: Axes, words: str, size: float, away: tuple[float, float], side: str) -> None:
    """An axis that comes out of the page at the origin."""
    at = (0.0, 0.0)
    axes.add_patch(Circle(at, size, facecolor="white", edgecolor=Z, linewidth=1.2, zorder=4))
    axes.add_patch(Circle(at, size / 3, facecolor=Z, edgecolor=Z, zorder=5))
    axes.text(*away, words, color=Z, ha=side, va="top")


def _person(axes: Axes) -> None:
    """From above: the left arm's frame at its shoulder."""
    axes.add_patch(Ellipse((0.20, 0.0), 0.44, 0.22, facecolor=BODY, edgecolor=INK, linewidth=0.8))
    axes.add_patch(Circle((0.20, 0.03), 0.09, facecolor="white", edgecolor=INK, linewidth=0.8))
    axes.plot((0.0, -0.20, -0.20), (0.0, 0.24, 0.50), color="#999999", linewidth=5, solid_capstyle="round")
    axes.plot(-0.20, 0.50, "o", color=INK, markersize=4)
    axes.text(-0.16, 0.52, "hand")
    _axis(axes, (0.0, 0.0), (0.46, 0.0), "x, to the\nright", X)
    _axis(axes, (0.0, 0.0), (0.0, 0.34), "y, forward", Y)
    _out(axes, "z, up", 0.025, (-0.04, -0.04), "right")
    axes.text(0.10, -0.27, "person from above,\norigin at the shoulder", ha="center", va="center")
    axes.set(xlim=(-0.30, 0.72), ylim=(-0.36, 0.66))


def _robot(axes: Axes) -> None:
    """From the side: base, tool, a twist in base axes."""
    axes.add_patch(Rectangle((-0.10, -0.06), 0.20, 0.06, facecolor=BODY, edgecolor=INK, linewidth=0.8))
    axes.plot((0.0, 0.05, 0.38, 0.50), (0.0, 0.34, 0.44, 0.30), color="#999999", linewidth=5, solid_capstyle="round")
    _axis(axes, (0.0, 0.0), (0.26, 0.0), "x", X)
    _axis(axes, (0.0, 0.0), (0.0, 0.26), "z", Z)
    _axis(axes, (0.50, 0.30), (0.10, -0.12), "tool z", Z)
    _axis(axes, (0.50, 0.30), (0.12, 0.10), "tool x", X)
    axes.text(0.26, 0.66, "twist = (vx, vy, vz, wx, wy, wz)\nof the tool, in base axes", ha="center")
    axes.text(
        0.26,
        -0.20,
        "robot from the side;\npose (4, 4): tool in the base frame",
        ha="center",
        va="center",
    )
    axes.set(xlim=(-0.20, 0.76), ylim=(-0.30, 0.78))


def _chair(axes: Axes) -> None:
    """From above: chassis frame, a wall's normal, a post."""
    axes.add_patch(Rectangle((-0.35, -0.30), 0.70, 0.90, facecolor=BODY, edgecolor=INK, linewidth=0.8))
    _axis(axes, (0.0, 0.0), (0.0, 0.46), "x, forward", X)
    _axis(axes, (0.0, 0.0), (-0.46, 0.0), "y,\nleft", Y)
    _out(axes, "z, up; turns are\nanti-clockwise", 0.035, (0.0, -0.07), "center")
    axes.add_patch(Rectangle((-0.75, 0.98), 1.60, 0.12, facecolor="#BBBBBB", edgecolor=INK, hatch="//", linewidth=0.8))
    _arrow(axes, (-0.60, 0.72), (-0.60, 0.98))
    axes.text(-0.55, 0.80, "HalfPlane: the normal\npoints into the wall", va="center")
    axes.add_patch(Circle((0.68, 0.30), 0.12, facecolor="#BBBBBB", edgecolor=INK, linewidth=0.8))
    axes.text(0.68, 0.10, "Disc", ha="center", va="center")
    axes.text(0.05, -0.52, "chair from above;\nchassis frame", ha="center", va="center")
    axes.set(xlim=(-0.80, 0.90), ylim=(-0.62, 1.14))
