"""The controllers of scenarios, as a problem file asks for them, repeat their trials in C."""

from __future__ import annotations

import csv
import subprocess
from pathlib import Path

import numpy as np
import pytest

from bench.scenarios import changed
from rehab_opt.errors import ProblemFileError
from rehab_opt.export.export_c import export_c
from tests.export.calling_c import SAME, Built


def test_a_scenario_with_a_solver_that_does_not_become_c_is_refused() -> None:
    with pytest.raises(ProblemFileError, match=r"run\.solver = 'proxqp'.*qrqp"):
        export_c(changed("scenario_5_hold", run={"solver": "proxqp"}), Path("nowhere"))


UNMAPPED = {"mapped": False, "rest_s": 0.5}
"""Places inside the comfortable workspace: a map would take seconds."""
SCENARIOS = {
    "scenario_3_resist": ("assistance", {}),
    "scenario_4_follow": (
        "path_assistance",
        {**UNMAPPED, "movement_s": 10.0, "placement": {"centre_m": [-0.17, 0.505], "fit_m": [0.03, 0.02]}},
    ),
    "scenario_5_hold": (
        "assistance",
        {"mapped": False, "points_m": [[-0.18, 0.50], [-0.16, 0.51], [-0.17, 0.52]], "dwell_s": 0.5},
    ),
}


@pytest.mark.parametrize(
    "scenario",
    [each if "hold" in each else pytest.param(each, marks=pytest.mark.nightly) for each in SCENARIOS],
)
def test_a_scenario_s_assistance_repeats_its_trial_in_c(scenario: str, tmp_path: Path, built: Built) -> None:
    name, task = SCENARIOS[scenario]
    export_c(changed(scenario, run={"rate_hz": 200.0}, task=task), tmp_path)
    example = built(tmp_path, "example", f"rehab_{name}.c", "main.c", "-lm", flags=("-O0",))
    replay = subprocess.run([example, "0"], capture_output=True, text=True, check=False)
    assert replay.returncode == 0, replay.stdout + replay.stderr
    difference = float(replay.stdout.split("largest difference from Python ")[1].split()[0])
    assert difference <= SAME
    with (tmp_path / "recorded_run.csv").open() as table:
        ticks = list(csv.DictReader(table))
    if scenario == "scenario_4_follow":  # the hand passes from piece to piece
        assert max(float(tick["more_1"]) for tick in ticks) > 0.1
    else:
        by = np.array([[float(tick[f"offset_{i}"]) for i in range(2)] for tick in ticks])
        moved = np.ptp(by[np.abs(by).max(axis=1) < 0.045], axis=0)  # without the faults
        assert (moved.min() > 0.01) == (scenario == "scenario_5_hold")
