"""Measures of two trials of one simulated person, without and with help."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.signal import find_peaks

from rehab_opt.measures.score import Score, hand_motion, score
from rehab_opt.measures.speed import RISE, movement_interval
from rehab_opt.session.drawing import GRID, LIMIT, MM, REFERENCE, TRUE, framed
from rehab_opt.session.files import load_problem
from rehab_opt.session.run import run_problem

PROBLEM = "upper_limb/scenario_2_assist"
CONDITIONS = {"unassisted": "#D55E00", "assisted": TRUE}
TRIAL = 0
EVERY = 10
"""Every tenth tick of the run is used: 100 Hz, as in a recording."""
TARGET = "#E69F00"
MIDDLE, HALF = np.array([45.0, 5.0]), 62.0
"""[mm] Centre of a path's panel relative to the target, and half of its width."""
APART = 0.15
"""[s] Least time between two peaks of `velocity_peaks`."""


def scored_reaches() -> Figure:
    """Speed over time with movement and peaks, and the path with its straight line; numbers above."""
    outcome = run_problem(load_problem(PROBLEM))
    figure = framed("The same simulated person's reach, without and with help: what the measures see", 9.0, 6.2)
    grid = figure.subplots(2, 2, width_ratios=(1.5, 1), sharex="col", sharey="col")
    target = outcome.reference[-1]
    for (speeds, paths), (law, colour) in zip(grid, CONDITIONS.items(), strict=True):
        trial = outcome.trials[law][TRIAL]
        time, points = trial.time[::EVERY], trial.position[::EVERY]
        scored = score(time, points, target=target)
        _draw_speed(speeds, time, points, colour)
        _draw_path(paths, scored, target, colour)
        speeds.set_title(f"{law}: {_words(scored)}", fontsize=9, loc="left")
        for axes in (speeds, paths):
            axes.grid(**GRID)
            axes.tick_params(labelsize=8)
    grid[1, 0].set_xlabel("time [s]", fontsize=9)
    grid[1, 1].set_xlabel("to the right [mm]", fontsize=9)
    handles = {}
    for axes in grid[1]:
        found, labels = axes.get_legend_handles_labels()
        handles |= dict(zip(labels, found, strict=True))
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=6, frameon=False, fontsize=9)
    return figure


def _draw_speed(axes: Axes, time: np.ndarray, points: np.ndarray, colour: str) -> None:
    motion = hand_motion(time, points)
    rate = motion.even.rate_hz
    begin, end = movement_interval(motion.speed, rate, threshold=motion.threshold)
    at, speed = motion.even.time - motion.even.time[0], MM * motion.speed
    rise = MM * max(RISE, motion.shaken)
    peaks, _ = find_peaks(np.concatenate(([0.0], speed, [0.0])), prominence=rise, distance=APART * rate)
    axes.axvspan(begin, end, color=LIMIT, alpha=0.35, linewidth=0, label="movement time")
    axes.plot(at, speed, color=colour, linewidth=1.4)
    axes.plot(at[peaks - 1], speed[peaks - 1], "v", color=REFERENCE, markersize=6, label="velocity peak")
    axes.set_ylabel("speed of the hand [mm/s]", fontsize=9)
    axes.margins(x=0.01)


def _draw_path(axes: Axes, scored: Score, target: np.ndarray, colour: str) -> None:
    moved = MM * scored.movement
    axes.plot(*moved.T, color=colour, linewidth=1.4)
    axes.plot(*moved[[0, -1]].T, color=REFERENCE, linestyle="--", linewidth=1.2, label="straight line")
    axes.plot(*moved[0], "o", color=REFERENCE, markersize=7, markerfacecolor="white", label="start")
    axes.plot(*moved[-1], "s", color=REFERENCE, markersize=6, label="end")
    axes.plot(*MM * target, "*", color=TARGET, markersize=13, markeredgecolor=REFERENCE, label="target")
    ratio, error = _value(scored, "path_ratio"), MM * _value(scored, "end_error")
    axes.set_title(f"path ratio {ratio:.1f}, end error {error:.0f} mm", fontsize=9, loc="left")
    axes.set_ylabel("to the front [mm]", fontsize=9)
    axes.set_aspect("equal", adjustable="box")
    middle = MM * target + MIDDLE
    axes.set_xlim(middle[0] - HALF, middle[0] + HALF)
    axes.set_ylim(middle[1] - 0.8 * HALF, middle[1] + 0.8 * HALF)


def _words(scored: Score) -> str:
    time, peaks, sparc = (_value(scored, name) for name in ("movement_time", "velocity_peaks", "sparc"))
    return f"movement time {time:.1f} s, {peaks:.0f} velocity peaks, SPARC {sparc:.1f}"


def _value(scored: Score, name: str) -> float:
    return next(float(each.value) for each in scored.measures if each.name == name)
