"""The motion as a short film: chair and arm of our law from above, with the hand of the published law beside it."""

from __future__ import annotations

import numpy as np
from matplotlib.animation import FuncAnimation
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from rehab_opt.session.ardis.clearance import arm_points, chair_corners
from rehab_opt.session.ardis.figures import NAMES, draw_room, seen_from_above
from rehab_opt.session.ardis.outcome import ArdisOutcome
from rehab_opt.session.drawing import REFERENCE
from rehab_opt.session.joint_figure import LAW_STYLES

__all__ = ["animations", "motion_film"]

FRAMES = 40
"""However long the run is, so that the file stays small."""
INTERVAL = 150
"""[ms] a frame"""


def animations(outcome: ArdisOutcome) -> dict[str, FuncAnimation]:
    """The films by file name, without suffix."""
    return {"motion": motion_film(outcome)}


def motion_film(outcome: ArdisOutcome) -> FuncAnimation:
    """One panel a drive; a run is shown in `FRAMES` frames."""
    x, y = seen_from_above(outcome)
    count = len(outcome.drives)
    stacked = np.ptp(x) > 1.3 * np.ptp(y)
    ratio = float(np.ptp(y) / np.ptp(x))
    size = (6.0, 0.7 + count * (5.2 * ratio + 0.9)) if stacked else (4.0 * count, 1.1 + 3.4 * ratio)
    figure = Figure(figsize=size, dpi=80)
    FigureCanvasAgg(figure)
    grid = np.atleast_1d(figure.subplots(count if stacked else 1, 1 if stacked else count)).ravel()
    figure.subplots_adjust(left=0.11, right=0.97, top=1 - 0.5 / size[1], bottom=0.6 / size[1], hspace=0.5, wspace=0.3)
    longest = max(float(of.optimised.time[-1]) for of in outcome.drives.values())
    panels = []
    for axes, (drive, of) in zip(grid, outcome.drives.items(), strict=True):
        draw_room(axes, outcome, x, y)
        hands = {law: axes.plot([], [], **LAW_STYLES[law], label=NAMES[law])[0] for law in of.by_law}
        (chair,) = axes.plot([], [], color=REFERENCE, linewidth=1.5)
        (arm,) = axes.plot([], [], "o-", color="#56B4E9", linewidth=3, markersize=4)
        panels.append((axes, drive, of, hands, chair, arm))

    def draw(frame: int) -> list[Artist]:
        now, changed = longest * frame / (FRAMES - 1), []
        for axes, drive, of, hands, chair, arm in panels:
            for law, motion in of.by_law.items():
                k = min(int(now / motion.dt), len(motion.time) - 1)
                hands[law].set_data(motion.hand[: k + 1 : 5, 0], motion.hand[: k + 1 : 5, 1])
                if law == "optimised":
                    q = motion.q[k : k + 1]
                    outline, points = chair_corners(outcome.robot.outline, q)[0], arm_points(outcome.robot, q)[0]
                    chair.set_data(*np.vstack([outline, outline[:1]]).T)
                    arm.set_data(points[:, 0], points[:, 1])
                    held = ", gripper closed" if motion.closed[k] else ""
                    # On two lines, since panels may stand side by side.
                    words = (
                        f"{drive} drive, {now:.1f} s\nstick mode {motion.mode[k]}, hand at {points[-1, 2]:.2f} m{held}"
                    )
                    axes.set_title(words, fontsize=8, loc="left")
            changed += [*hands.values(), chair, arm]
        return changed

    return FuncAnimation(figure, draw, frames=FRAMES, interval=INTERVAL, blit=False, cache_frame_data=False)
