"""A drawing, and three ways to map it into a small workspace."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.figure import Figure

from rehab_opt.kinematics.human_arm import human_arm
from rehab_opt.session.drawing import ACROSS, FORWARD, MM, OKABE_ITO, framed
from rehab_opt.workspace.mapping import WorkspaceMap
from rehab_opt.workspace.reach import planar_workspace
from rehab_opt.workspace.similarity import largest_copy

SET, DRAWN = "#BBBBBB", OKABE_ITO[0]


def mapped_drawing() -> Figure:
    """A figure of eight in the regular workspace, and its images in the restricted one."""
    reach = planar_workspace(human_arm(range_of_motion="regular"), accuracy=3e-3)
    comfortable = planar_workspace(human_arm(range_of_motion="restricted"))
    turn = np.linspace(0.0, 2.0 * math.pi, 400)
    eight = [-0.1, 0.45] + 0.05 * np.column_stack([np.sin(turn), 0.5 * np.sin(2.0 * turn)])
    panels = (
        ("the drawing", reach, eight),
        ("map of the sets", comfortable, WorkspaceMap.between(reach, comfortable)(eight)),
        ("map for the task", comfortable, WorkspaceMap.for_task(reach, comfortable, eight)(eight)),
        ("largest copy", comfortable, largest_copy(eight, comfortable)(eight)),
    )
    figure = framed("A figure of eight in the regular workspace, and three images of it in the restricted one.", 2.2)
    for axes, (name, workspace, path) in zip(figure.subplots(1, 4), panels, strict=True):
        axes.fill(*(MM * np.array(workspace.polygon.exterior.xy)), color=SET, alpha=0.5, linewidth=0.0)
        axes.plot(*(MM * path.T), color=DRAWN)
        axes.set(title=name, xlabel=ACROSS, aspect="equal")
    figure.axes[0].set_ylabel(FORWARD)
    return figure
