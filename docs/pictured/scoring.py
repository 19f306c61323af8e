"""Measures of two trials of one simulated person, without and with help."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.signal import find_peaks

from rehab_opt.measures.score import Score, hand_motion, score
from rehab_opt.measures.speed import RISE, movement_interval
from rehab_opt.session.drawing import LIMIT, MM, OKABE_ITO, REFERENCE, TRUE, framed, label_times, legend_below
from rehab_opt.session.files import load_problem
from rehab_opt.session.run import run_problem
from rehab_opt.session.scenario.scene import trials_of

PROBLEM = "upper_limb/scenario_2_assist"
CONDITIONS = {"unassisted": OKABE_ITO[1], "assisted": TRUE}
TRIAL = 0
EVERY = 10
"""Every tenth tick of the run is used: 100 Hz, as in a recording."""
TARGET = OKABE_ITO[4]
MIDDLE, HALF = np.array([45.0, 5.0]), 62.0
"""[mm] Centre of a path's panel relative to the target, and half of its width."""
APART = 0.15
"""[s] Least time between two peaks of `velocity_peaks`."""


def scored_reaches() -> Figure:
    """Speed over time with movement and peaks, and the path with its straight line; numbers above."""
    outcome = trials_of(run_problem(load_problem(PROBLEM)))
    figure = framed("The same simulated person's reach, without and with help: what the measures see.", 5.0)
    grid = figure.subplots(2, 2, width_ratios=(1.5, 1), sharex="col", sharey="col")
    target = outcome.context.reference[-1]
    for (speeds, paths), (law, colour) in zip(grid, CONDITIONS.items(), strict=True):
        trial = outcome.trials[law][TRIAL]
        time, points = trial["t_s"][::EVERY], trial["_hand"][::EVERY]
        scored = score(time, points, target=target)
        _draw_speed(speeds, time, points, colour)
        _draw_path(paths, scored, target, colour)
        speeds.set_title(f"{law}: {_words(scored)}")
    label_times(grid[:, 0], *["speed of the hand [mm/s]"] * 2)
    grid[1, 1].set_xlabel("x, to the right [mm]")
    return legend_below(figure)


def _draw_speed(axes: Axes, time: np.ndarray, points: np.ndarray, colour: str) -> None:
    motion = hand_motion(time, points)
    rate = motion.even.rate_hz
    begin, end = movement_interval(motion.speed, rate, threshold=motion.threshold)
    at, speed = motion.even.time - motion.even.time[0], MM * motion.speed
    rise = MM * max(RISE, motion.shaken)
    peaks, _ = find_peaks(np.concatenate(([0.0], speed, [0.0])), prominence=rise, distance=APART * rate)
    axes.axvspan(begin, end, color=LIMIT, alpha=0.35, linewidth=0, label="movement time")
    axes.plot(at, speed, color=colour)
    axes.plot(at[peaks - 1], speed[peaks - 1], "v", color=REFERENCE, label="velocity peak")


def _draw_path(axes: Axes, scored: Score, target: np.ndarray, colour: str) -> None:
    moved = MM * scored.movement
    axes.plot(*moved.T, color=colour)
    axes.plot(*moved[[0, -1]].T, color=REFERENCE, linestyle="--", label="straight line")
    axes.plot(*moved[0], "o", color=REFERENCE, markersize=6, markerfacecolor="white", label="start")
    axes.plot(*moved[-1], "s", color=REFERENCE, label="end")
    axes.plot(*MM * target, "*", color=TARGET, markersize=10, markeredgecolor=REFERENCE, label="target")
    ratio, error = _value(scored, "path_ratio"), MM * _value(scored, "end_error")
    axes.set_title(f"path ratio {ratio:.1f}, end error {error:.0f} mm")
    axes.set_ylabel("y, forward [mm]")
    axes.set_aspect("equal", adjustable="box")
    middle = MM * target + MIDDLE
    axes.set_xlim(middle[0] - HALF, middle[0] + HALF)
    axes.set_ylim(middle[1] - 0.8 * HALF, middle[1] + 0.8 * HALF)


def _words(scored: Score) -> str:
    time, peaks, sparc = (_value(scored, name) for name in ("movement_time", "velocity_peaks", "sparc"))
    return f"{time:.1f} s, {peaks:.0f} velocity peaks, SPARC {sparc:.1f}"


def _value(scored: Score, name: str) -> float:
    return next(float(each.value) for each in scored.measures if each.name == name)
