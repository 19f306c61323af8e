"""An assistance that goes into C, with little energy, a workspace with a hole, and a hand that goes in and out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import shapely

from rehab_opt import Assistance, PotentialField, Workspace
from rehab_opt.export.controllers.assistance import exported_assistance
from rehab_opt.export.export_c import written_files

S = np.linspace(0.0, 1.0, 200)
PATH = np.column_stack([-0.15 + 0.3 * S, 0.4 + 0.03 * np.sin(3 * S)])
ROUND = shapely.Point(-0.10, 0.40).buffer(0.07, quad_segs=12)
COMFORTABLE = Workspace(ROUND.difference(shapely.box(-0.11, 0.38, -0.09, 0.40)), accuracy=1e-3)
DT = 1e-3


def made(mode: str, comfortable: Workspace = COMFORTABLE, **options: object) -> Assistance:
    """In Python, with the rungs that C has."""
    drag = 200.0 if mode == "assist" else 0.0
    field = PotentialField(PATH, stiffness=1000.0, width=0.025, drag=drag, damping=[5.0, 8.0])
    given = {"onset": 0.01, "energy_budget": 0.3, "velocity_lag": 0.02, "backup": "qrqp", **options}
    return Assistance(field, comfortable=comfortable, mode=mode, dt=DT, **given)  # type: ignore[arg-type]


def exported_to(folder: Path, mode: str) -> Path:
    """Folder of its C files."""
    t = DT * np.arange(3000)
    hand = np.column_stack([-0.05 + 0.12 * np.sin(2 * t), 0.41 + 0.05 * np.cos(5 * t)])
    controller = exported_assistance(made(mode), hand, title="a hand in and out")
    written_files({folder: controller}, folder, problem="a library call")
    return folder
