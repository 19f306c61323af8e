"""Keep-out planes of `MirrorTracker`: no part of the arm crosses them.

Judged by the arm's true shape: the UR5's upper arm lies 0.136 m beside the line of its Denavit-Hartenberg frames, the
forearm 0.016 m. Its tubes are balls along that line, thinner than the vendor's: 54 mm for the upper arm, 40 mm for what
is behind it. Planes begin clear of them by 57 mm and more, of a hand by 40; references lead into them.
"""

from __future__ import annotations

import numpy as np

from tests.judge.mirror_floor import joint_bounds
from tests.judge.mirror_runs import Run, followed, spike_heights
from tests.judge.numbering import Runs, judging
from tests.judge.ur5_numbers import links
from tests.judge.verdict import Verdict

GUARANTEES = ("G18",)
LEAST = {"a plane is near": 219, "the hand is nearest to it": 5000, "another link is nearest to it": 219,
         "status braking": 100}  # fmt: skip
CI_TICKS = 4000
SHARE = 0.2
RADII = np.array([0.054, 0.054, 0.054, 0.04, 0.04, 0.04, 0.0])
"""[m] of the tube at each corner of `links` but the shoulder's, which does not move."""


def judge(verdict: Verdict, one: Run) -> None:
    """Height of every part of the arm above every plane, after every tick."""
    dt = one.settings.dt
    joint_bounds(verdict, one)
    parts, mounted = links(one.q)[:, 1:], np.zeros(len(one.commands), dtype=bool)
    near, hand = np.zeros(len(one.commands), dtype=bool), np.zeros(len(one.commands), dtype=bool)
    for normal, offset in one.settings.planes:
        heights = parts @ normal - offset - RADII
        verdict.within("part of the arm beyond a plane [m]", -heights, 1e-9)
        if one.settings.spike is not None:
            above = spike_heights(one.settings.spike, one.q, normal, offset)
            verdict.within("what is mounted on the arm beyond a plane [m]", -above, 1e-9)
            mounted |= above[1:] < 0.03
        near |= heights[1:].min(axis=1) < 0.03
        hand |= (heights[1:].argmin(axis=1) == len(RADII) - 1) & (heights[1:, -1] < 0.03)
    verdict.during("a plane is near", near, dt)
    verdict.during("what is mounted on the arm is near to it", mounted, dt)
    verdict.during("the hand is nearest to it", hand, dt)
    verdict.during("another link is nearest to it", near & ~hand, dt)


run = judging(
    __name__,
    LEAST,
    Runs(followed(judge, planes=True, below=0.05), 1 / 2),
    Runs(followed(judge, planes=True, hand=True, below=0.0), 1 / 6, 2_000_000),
    Runs(followed(judge, planes=True, faults=0.5, below=0.05), 1 / 3, 1_000_000),
    finish=(Verdict.seldom_beyond_the_dual_method,),
)
