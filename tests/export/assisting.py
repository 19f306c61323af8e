"""Assistance that goes into C, with little energy, a workspace with a hole, and a hand that goes in and out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import shapely

from rehab_opt import Assistance, PotentialField, Workspace
from rehab_opt.control.path_assistance import PathAssistance
from rehab_opt.export.controllers.assistance import exported_assistance
from rehab_opt.export.controllers.path_assistance import exported_path_assistance
from rehab_opt.export.export_c import written_files

S = np.linspace(0.0, 1.0, 200)
PATH = np.column_stack([-0.15 + 0.3 * S, 0.4 + 0.03 * np.sin(3 * S)])
ROUND = shapely.Point(-0.10, 0.40).buffer(0.07, quad_segs=12)
COMFORTABLE = Workspace(ROUND.difference(shapely.box(-0.11, 0.38, -0.09, 0.40)), accuracy=1e-3)
DT = 1e-3
EIGHT = np.array([-0.10, 0.41]) + np.column_stack([0.05 * np.sin(2 * np.pi * S), 0.025 * np.sin(4 * np.pi * S)])
"""It crosses itself above the hole."""
FORCES = {"assistance": "assist", "path_assistance": "path"}
"""Controllers in C, and what they are made of here."""
LITTLE = {"energy_budget": 0.3, "velocity_lag": 0.02, "backup": "qrqp", "dt": DT}

LATE = {"actuation_delay": 0.004, "actuation_lag": 0.002, "position_noise": 1e-4}


def field_of(mode: str, number: int = 0) -> PotentialField:
    """One of two that differ in all they have, their number of samples too."""
    path = PATH if number == 0 else PATH[::-1][:70] + [0.0, 0.02]
    drag, width = 200.0 if mode == "assist" else 0.0, 0.025 + 0.005 * number
    return PotentialField(
        path, stiffness=1000.0 + 500.0 * number, width=width, drag=drag, damping=[5.0 + number, 8.0 + 2 * number]
    )


def made(mode: str, comfortable: Workspace = COMFORTABLE, **options: object) -> Assistance:
    """In Python, with the stages that C has."""
    late = LATE if mode == "follow" else {}
    given = {"onset": 0.01, **LITTLE, **late, **options}
    return Assistance(field_of(mode), comfortable=comfortable, mode=mode, **given)  # type: ignore[arg-type]


def made_along_a_path() -> PathAssistance:
    """The same for a path that crosses itself, with energy to hold a hand that stands."""
    given = {**LITTLE, "energy_budget": 3.0}
    return PathAssistance(EIGHT, stiffness=1000.0, width=0.01, damping=5.0, comfortable=COMFORTABLE, **given)  # type: ignore[arg-type]


def exported_to(folder: Path, mode: str) -> Path:
    """Folder of its C files; mode "path" is that of the path."""
    t = DT * np.arange(3000)
    hand = np.column_stack([-0.05 + 0.12 * np.sin(2 * t), 0.41 + 0.05 * np.cos(5 * t)])
    if mode == "path":
        round_and_round = EIGHT[(np.arange(3000) // 7) % len(EIGHT)] + 0.002 * np.sin(9 * t)[:, None]
        controller = exported_path_assistance(made_along_a_path(), round_and_round, title="round and round")
    else:
        offset = np.column_stack([0.02 * np.sin(3 * t), 0.01 * np.cos(3 * t)])
        controller = exported_assistance(
            made(mode), hand, title="a hand in and out", fields=[field_of(mode, 1)], offset=offset
        )
    written_files({folder: controller}, folder, problem="a library call")
    return folder
