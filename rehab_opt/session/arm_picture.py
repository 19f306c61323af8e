"""A person's range of motion as text and as a picture of the arm at both ends of each movement."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.kinematics.goniometer import GONIOMETER, arm_posture, goniometer_range, range_in_words
from rehab_opt.kinematics.human_arm import ARM_JOINTS, ARM_REST
from rehab_opt.session.arm_keys import RADIANS
from rehab_opt.session.drawing import BROAD, OKABE_ITO, framed, legend_below, styled
from rehab_opt.session.live.bodies import ArmBodies
from rehab_opt.session.outcome import Array
from rehab_opt.session.report import write_figures

LOWER, UPPER, TRUNK = OKABE_ITO[1], OKABE_ITO[0], "#BBBBBB"
SAME = 1e-9
"""[m] Frame origins closer than this count as one point."""
THUMB = 0.06
"""[m] Drawn length of the thumb, which is the handle's axis."""
CROOKED = 45.0
"""[deg] An elbow that cannot extend past this angle was probably measured with 180 as straight."""
WRAPPED = 26
"""Largest number of letters in a line of text below a panel."""
BENT = {"elbow_flexion": math.pi / 2}


class View(NamedTuple):
    """View of a movement: the two drawn axes of the shoulder's frame, and the angles of the other movements."""

    across: int
    up: int
    words: str
    beside: Mapping[str, float]


FRONT, SIDE, TOP = (0, 2), (1, 2), (0, 1)
VIEWS: Mapping[str, View] = {
    "scapular_retraction": View(*TOP, "from above, forward is up", {}),
    "shoulder_flexion": View(*SIDE, "from the side, forward is right", {}),
    "shoulder_abduction": View(*FRONT, "from behind", {}),
    "shoulder_external_rotation": View(*TOP, "from above, elbow bent", BENT),
    "elbow_flexion": View(*SIDE, "from the side, forward is right", {}),
    "forearm_pronation": View(*FRONT, "from behind, elbow bent", BENT),
    "wrist_flexion": View(*TOP, "from above, elbow bent, thumb up", BENT),
    "wrist_ulnar_deviation": View(*SIDE, "from the side, elbow bent, thumb up", BENT),
}


def range_note(name: str, arm: SerialChain, *, side: str = "") -> str:
    """An arm's range of motion in goniometer angles, with a warning if they look like another unit or convention."""
    said = [range_in_words(movement, *pair) + _looks_like(movement, *pair) for movement, pair in _measured(arm).items()]
    whose = f" of the {side} arm" if side else ""
    return f"range of motion {name!r}{whose}, as a goniometer reads it: {'; '.join(said)}"


def _looks_like(movement: str, lower: float, upper: float) -> str:
    """Warning that a range [rad] looks like another unit or convention; empty for a usual range."""
    low, high = math.degrees(lower), math.degrees(upper)
    if high > low and max(abs(low), abs(high)) <= RADIANS:
        return " (so narrow: degrees, not radians?)"
    if movement == "elbow_flexion" and low >= CROOKED:
        return f" (the straight arm is 0: if it was counted as 180, this is {180 - high:.4g} to {180 - low:.4g})"
    return ""


def range_figure(name: str, arm: SerialChain) -> Figure:
    """A figure with one panel for each movement: the arm at both ends of it, with all other movements at zero."""
    figure = framed(
        f"Range of motion {name!r}: each movement alone, at both ends of its range; the short line is the thumb.", 5.0
    )
    panels = figure.subplots(2, 4).ravel()
    for axes, (movement, (lower, upper)) in zip(panels, _measured(arm).items(), strict=True):
        view, of = VIEWS[movement], GONIOMETER[movement]
        for angle, colour, style in ((lower, LOWER, "--"), (upper, UPPER, "-")):
            _draw(axes, stick_arm(arm, {**view.beside, movement: angle}), view, colour, style)
        low, high = (round(math.degrees(angle), 1) + 0.0 for angle in (lower, upper))
        ends = f"{low:g} to {high:g} deg"
        axes.set_title(f"{movement.replace('_', ' ')}\n{ends}")
        axes.set_xlabel("\n".join([*textwrap.wrap(view.words, WRAPPED), f"+ {of.positive}", f"- {of.negative}"]))
    for colour, style, label in ((LOWER, "--", "lower end"), (UPPER, "-", "upper end")):
        panels[0].plot([], [], color=colour, linestyle=style, label=label)
    panels[0].plot([], [], color=TRUNK, linewidth=BROAD, label="trunk")
    return legend_below(figure)


def write_range_figures(arms: Mapping[str, SerialChain], folder: Path, *, title: str) -> list[Path]:
    """Write a figure of each arm (arm_1, arm_2, ...) and the captions; return the written files."""
    folder.mkdir(parents=True, exist_ok=True)
    with styled():
        figures = {f"arm_{i}": range_figure(*each) for i, each in enumerate(arms.items(), start=1)}
        return write_figures(figures, folder, title)


def stick_arm(arm: SerialChain, angles: Mapping[str, float]) -> Array:
    """Positions (6, 3) [m] of neck, shoulder, elbow, wrist, hand and thumb tip, at goniometer angles [rad].

    Segments of length zero give fewer points.
    """
    q = arm_posture(angles)
    places = ArmBodies(arm).frames(q)[:, :, 3]
    apart = np.concatenate(([True], np.linalg.norm(np.diff(places, axis=0), axis=1) > SAME))
    return np.vstack((places[apart], places[-1] + THUMB * arm.pose(q)[:3, 0]))


def _measured(arm: SerialChain) -> dict[str, tuple[float, float]]:
    rest = np.where(np.arange(arm.n) == 0, ARM_REST[0], 0.0)
    limits = zip(ARM_JOINTS, (arm.lower - rest).tolist(), (arm.upper - rest).tolist(), strict=True)
    return goniometer_range({joint: (lower, upper) for joint, lower, upper in limits})


def _draw(axes: Axes, points: Array, view: View, colour: str, style: str) -> None:
    flat = points[:, [view.across, view.up]]
    trunk = ([0, 0], [-0.45, 0.1]) if view.up == 2 else ([-0.1, 0.1], [0, 0])
    axes.plot(*trunk, color=TRUNK, linewidth=BROAD, zorder=0)
    axes.plot(*flat[:-1].T, color=colour, linestyle=style, marker="o", markersize=2.5)
    axes.plot(*flat[-2:].T, color=colour)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.1)
    axes.set(xticks=[], yticks=[])
