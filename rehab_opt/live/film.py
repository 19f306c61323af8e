"""Film of a problem as a GIF that looks like the page of `rehab-opt live`."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from rehab_opt.control.command import Command
from rehab_opt.errors import ConfigurationError
from rehab_opt.session.live.bodies import BLUE, ORANGE
from rehab_opt.session.live.problem import LiveProblem
from rehab_opt.session.simulation import simulate

__all__ = ["write_film"]

Array = NDArray[np.float64]

WIDTH, HEIGHT, DPI, COLOURS = 4.8, 3.6, 100, 48
LIFT = 0.45
"""Elevation [rad] of the camera, as on the page."""
EDGE = "#5c6b7a"


def write_film(
    problem: LiveProblem,
    path: Path,
    *,
    seconds: float,
    per_second: float = 10.0,
    progress: Callable[[str, int, int], None] = lambda *_: None,
) -> int:
    """Simulate a problem without inputs, with the dead man's switch held, and write the pictures to a GIF.

    Parameters
    ----------
    problem : problem from `live_problem`. path : path of the GIF.
    seconds : simulated time [s]. per_second : pictures per second of simulated time.
    progress : callback for the progress of the simulation.

    Returns
    -------
    The number of pictures.

    Raises
    ------
    ConfigurationError : the duration or the number of pictures per second is out of range.
    """
    for name, value, most in (("seconds", seconds, 600.0), ("per_second", per_second, 50.0)):
        if not 0.0 < value <= most:
            raise ConfigurationError(name, value, f"a number above 0, at most {most:g}")
    control, scene = problem.control(), problem.scene()
    every, pictures, trail = max(1, round(1 / (per_second * problem.dt))), list[Image.Image](), list[list[float]]()

    def shoot(tick: int, command: Command) -> dict[str, Any]:
        if tick % every == 0:
            numbers = {name: np.atleast_1d(np.asarray(value, float)) for name, value in control.shown().items()}
            frame = problem.frame(numbers)
            trail.append(frame["handles"]["hand"])
            words = f"{problem.title} · {tick * problem.dt:.1f} s · {command.status.value}"
            pictures.append(_picture(words, scene, frame, trail))
        return {}

    simulate(
        control, lambda tick: control.untouched(tick * problem.dt), ticks=math.ceil(seconds / problem.dt), also=shoot,
        progress=partial(progress, "film"),
    )  # fmt: skip
    palette = pictures[-1].quantize(COLOURS, Image.Quantize.MAXCOVERAGE)
    flat = [each.quantize(palette=palette, dither=Image.Dither.NONE) for each in pictures]
    flat[0].save(path, save_all=True, append_images=flat[1:], duration=round(1e3 / per_second), loop=0, optimize=True)
    return len(pictures)


def _picture(words: str, scene: dict[str, Any], frame: dict[str, Any], trail: list[list[float]]) -> Image.Image:
    figure = Figure(figsize=(WIDTH, HEIGHT), dpi=DPI)
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 0.92))
    axes.set_axis_off()
    flat, reach = scene.get("planar", False), scene["reach"]
    seen = _projection(np.array(scene["centre"]), math.pi / 2 if flat else LIFT, scene.get("turn", -0.9), flat=flat)
    half = 0.62 * reach
    axes.set_xlim(-half, half)
    axes.set_ylim(-half * HEIGHT * 0.92 / WIDTH, half * HEIGHT * 0.92 / WIDTH)
    points_a_metre = 72 * WIDTH / (2 * half)

    # For each shape: coordinate towards the eye, points, colour, line width in points (0 for a filled shape).
    shapes: list[tuple[float, Array, str, float]] = []
    for each in scene.get("fills", ()):
        at = seen(np.array(each["points"]))
        shapes.append((float(at[:, 2].min()), at, each["colour"], 0.0))
    for each in (*scene.get("lines", ()), *frame.get("lines", ()), {"points": trail, "colour": ORANGE}):
        at = seen(np.array(each["points"]))
        width = max(1.2, 2 * each.get("radius", 0.0) * points_a_metre)
        shapes.append((float(at[:, 2].mean()), at, each["colour"], width))
    for each in (*scene.get("capsules", ()), *frame.get("capsules", ())):
        at = seen(np.array((each[:3], each[3:6])))
        width = 2 * each[6] * points_a_metre
        nearness = float(at[:, 2].mean())
        shapes += [(nearness, at, EDGE, width + 1.4), (nearness, at, each[7], width)]
    for order, (_, at, colour, width) in enumerate(sorted(shapes, key=lambda shape: shape[0])):
        if width:
            axes.plot(at[:, 0], at[:, 1], color=colour, linewidth=width, solid_capstyle="round", zorder=order)
        else:
            axes.fill(at[:, 0], at[:, 1], color=colour, zorder=order)
    for size, arrows in ((1.0, scene.get("arrows", ())), (scene.get("arrow", 0.01), frame.get("arrows", ()))):
        for each in arrows:
            (x, y, _), (to_x, to_y, _) = seen(np.array((each[:3], np.array(each[:3]) + size * np.array(each[3:6]))))
            style = {"arrowstyle": "->", "color": each[6]}
            axes.annotate("", (to_x, to_y), (x, y), arrowprops=style, zorder=len(shapes))
    for name, colour in (("target", BLUE), ("hand", ORANGE)):
        if name in frame["handles"]:
            x, y, _ = seen(np.array([frame["handles"][name]]))[0]
            axes.plot(x, y, "o", color=colour, markeredgecolor="white", zorder=len(shapes) + 1)
    figure.text(0.02, 0.95, words, fontsize=8, color="#1d2733")
    canvas.draw()  # type: ignore[no-untyped-call]
    drawn = np.asarray(canvas.buffer_rgba())  # type: ignore[no-untyped-call]
    return Image.fromarray(drawn[:, :, :3].copy())


def _projection(centre: Array, lift: float, turn: float, *, flat: bool) -> Callable[[Array], Array]:
    """Parallel projection: function from points (N, 3) [m] to coordinates (N, 3) [m]: right, up, towards the camera."""
    turn = -math.pi / 2 if flat else turn
    c, s, ct, st = math.cos(lift), math.sin(lift), math.cos(turn), math.sin(turn)
    axes = np.array([[-st, ct, 0.0], [-s * ct, -s * st, c], [c * ct, c * st, s]])
    return lambda points: (points - centre) @ axes.T
