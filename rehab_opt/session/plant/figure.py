"""Joint speeds that were commanded beside those that came of it, and what the drives gave."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from rehab_opt.session.drawing import GRID, framed, legend_below
from rehab_opt.session.plant.motion import JointMotion

__all__ = ["servo_figure"]

TRUE, TOLD = "#0072B2", "#E69F00"
CLOSE_UP = 0.5
"""[s] shown around the fastest change, where delay and servo can be seen."""


def servo_figure(title: str, names: Sequence[str], motion: JointMotion, *, lengths: int = 0) -> Figure:
    """Two panels a joint: the whole run, and half a second about its hardest acceleration.

    Parameters
    ----------
    names : (n,) of the joints. lengths : how many of them, the first ones, are in metres; the others are angles.
    """
    figure = framed(
        f"{title}\nJoint speeds, commanded and true: the whole run, and the half second of the largest change",
        11.0,
        1.3 + 1.5 * len(names),
    )
    grid = figure.subplots(len(names), 2, squeeze=False, width_ratios=(2.2, 1), sharex="col")
    time, units = motion.time, np.where(np.arange(len(names)) < lengths, 1.0, 180 / math.pi)
    middle = _moment(motion, lengths)
    near = np.flatnonzero(np.abs(time - middle) <= CLOSE_UP / 2)
    every = np.arange(len(time))
    for joint, (name, axes) in enumerate(zip(names, grid, strict=True)):
        for panel, shown in zip(axes, (every, near), strict=True):
            at = time[shown]
            told, true = (units[joint] * each[shown, joint] for each in (motion.commanded, motion.velocity))
            # The commands, which answer the encoders' noise, would hide what came of them.
            panel.step(at, told, where="post", color=TOLD, linewidth=0.9, label="commanded")
            panel.plot(at, true, color=TRUE, linewidth=1.4, label="true")
            panel.grid(**GRID)
            panel.margins(x=0.01)
            panel.tick_params(labelsize=8)
        unit = "m/s" if joint < lengths else "deg/s"
        axes[0].set_ylabel(f"[{unit}]", fontsize=8)
        axes[0].set_title(name.replace("_", " "), fontsize=9, loc="left")
    for panel in grid[-1]:
        panel.set_xlabel("time [s]", fontsize=9)
    legend_below(figure, grid[0, 0], 2)
    return figure


def _moment(motion: JointMotion, lengths: int) -> float:
    """[s] of the largest change of a true speed, as a share of the fastest joint's of its kind."""
    if len(motion.time) < 3:
        return float(motion.time[0])
    fastest = np.abs(motion.velocity).max(axis=0)
    for kind in (slice(0, lengths), slice(lengths, None)):
        fastest[kind] = max(float(fastest[kind].max(initial=0.0)), 1e-9)
    change = np.abs(np.diff(motion.velocity, axis=0)) / fastest
    return float(motion.time[1 + int(change.max(axis=1).argmax())])
