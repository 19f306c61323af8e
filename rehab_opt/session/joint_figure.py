"""The joints of a movement over time, against their limits."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.session.drawing import LIMIT, framed, legend_below
from rehab_opt.session.outcome import MovementOutcome

__all__ = ["LAW_STYLES", "joint_figure"]

Array = NDArray[np.float64]

LAW_STYLES: Mapping[str, Mapping[str, Any]] = {
    "optimised": {"color": "#0072B2", "linestyle": "-", "linewidth": 2.0},
    "published": {"color": "#D55E00", "linestyle": "--", "linewidth": 1.5},
}


def joint_figure(
    outcome: MovementOutcome,
    joints: Mapping[str, tuple[Array, Mapping[str, Any]]],
    *,
    times: Mapping[str, Array] | None = None,
) -> Figure:
    """A panel for each joint; `joints` holds values (N, n) [rad] and their style by label.

    `times` (N,) [s] by label, where they are not all sampled at the outcome's own.
    """
    chain = outcome.chain
    rows = math.ceil(chain.n / 2)
    figure = framed(outcome.title, 9.0, 1.3 + 1.9 * rows)
    grid = np.atleast_1d(figure.subplots(rows, 2, sharex=True)).ravel()
    limits_seen = False
    for joint, axes in enumerate(grid[: chain.n]):
        for label, (q, style) in joints.items():
            axes.plot((times or {}).get(label, outcome.time), np.rad2deg(q[:, joint]), **style, label=label)
        limits_seen |= _shade_limits(axes, chain, joint)
        axes.set_title(chain.names[joint].replace("_", " "), fontsize=9, loc="left", parse_math=False)
        axes.set_ylabel("angle [deg]", fontsize=8)
        axes.tick_params(labelsize=8)
    for axes in grid[chain.n - 2 : chain.n]:
        axes.set_xlabel("time [s]", fontsize=9)
    for axes in grid[chain.n :]:
        axes.set_visible(False)
    what = (
        "Joint angles and the limits near them" if limits_seen else "Joint angles; all limits lie outside these panels"
    )
    figure.suptitle(f"{outcome.title}\n{what}", fontsize=12)
    if limits_seen:
        grid[0].plot([], [], color=LIMIT, linewidth=8, alpha=0.6, label="outside the joint's range")
    legend_below(figure, grid[0], 4)
    return figure


def _shade_limits(axes: Axes, chain: SerialChain, joint: int) -> bool:
    """Grey where the joint may not be, and whether that is in the panel.

    Limits beyond half a turn are left out, so that the motion can be seen.
    """
    lower, upper = np.rad2deg(chain.lower[joint]), np.rad2deg(chain.upper[joint])
    low, high = axes.dataLim.intervaly
    for limit in (lower, upper):
        if abs(limit) < 180 or lower == upper:
            low, high = min(low, limit), max(high, limit)
    margin = max(0.12 * (high - low), 1.5)
    axes.set_ylim(low - margin, high + margin)
    for outside in ((-1e4, max(lower, -1e4)), (min(upper, 1e4), 1e4)):  # some joints have no ends
        axes.axhspan(*outside, color=LIMIT, alpha=0.6, linewidth=0, zorder=0)
    if chain.locked[joint]:
        axes.annotate("locked: a range of zero width", (0.98, 0.06), xycoords="axes fraction", ha="right", fontsize=7)
    return bool(lower > low - margin or upper < high + margin)
