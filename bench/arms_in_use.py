"""Three arms from files in use: `python -m bench.arms_in_use`: a Panda, Kinova's Gen3 and a Jaco, as the UR5 is used.

Each goes round a circle by `run`, as commanded and on the MuJoCo plant, becomes C that repeats that run with faults in
it, and passes the fault campaign of `bench.fault_campaign`. Then the shipped problems with a Kinova on a
wheelchair and a Franka that leads a hand become C, too.
"""

from __future__ import annotations

import argparse
import math
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.console import Console

from bench import fault_campaign
from bench.imported_arms import ROBOTS
from bench.machine import machine
from bench.verdict import Verdict, all_met, print_verdicts
from rehab_opt import SerialChain, export_c
from rehab_opt.session.files import load_problem
from rehab_opt.session.robot_file import robot_at_start
from rehab_opt.session.run import run_problem

__all__ = ["main"]

ALIKE = 1e-12
"""[rad/s] By which a command of C may differ from Python's."""
FOLLOWED, ON_SERVOS = 1e-4, 0.03
"""[m] Largest error of the tool, of joints that move as commanded and on servos that are late."""
SHIPPED = ("ardis/kinova_drink", "ardis/kinova_lift_button", "mirror/franka_pick_fruit")
HERE = Path(__file__).parents[1] / "problems/robots"
FLAGS = ("-std=c99", "-O1", "-Wall", "-Wextra", "-Werror", "-fno-math-errno", "-ffp-contract=off")


class Arm(NamedTuple):
    """One arm, and where it begins."""

    name: str
    file: Path
    """Below the folder that packages are installed in, or absolute."""
    tip: str
    start: tuple[float, ...]
    """[deg]"""
    acceleration: float
    """[deg/s^2] An assumption: no URDF has it."""


ARMS = (
    Arm(
        "Panda", Path(ROBOTS) / "panda_description/urdf/panda.urdf", "panda_hand_tcp", (0, -45, 0, -135, 0, 90, 45),
        429,
    ),
    Arm("Gen3", HERE / "kinova_gen3/gen3.urdf", "end_effector_link", (0, 30, 180, -100, 0, -60, 90), 300),
    Arm(
        "Jaco", Path(ROBOTS) / "kinova_description/robots/kinova.urdf", "j2s6s200_end_effector",
        (275, 167, 57, 241, 83, 76), 300,
    ),
)  # fmt: skip
PROBLEM = """system = "pose_tracking"
title = "{name} round a circle"
[robot]
file = "robot.toml"
start_deg = {start}
[circle]
radius_m = 0.05
duration_s = {seconds}
"""
ROBOT = """urdf = "{file}"
tip = "{tip}"
acceleration_deg_s2 = {acceleration}
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the verdicts; 0 where every one is met."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=100_000, help="ticks of the fault campaign, of all arms together")
    parser.add_argument("--seconds", type=float, default=6.0, help="of the circle")
    parser.add_argument("--packages", type=Path, action="append", default=[], help="folder that wheels are unpacked in")
    options = parser.parse_args(arguments)
    os.environ.setdefault("REHAB_OPT_COMPILE", "off")  # the same answers
    console, verdicts, chains = Console(), [], {}
    console.print(machine())
    with tempfile.TemporaryDirectory() as scratch:
        for arm in ARMS:
            places = (folder / arm.file for folder in [*options.packages, *map(Path, sys.path)])
            file = next((place for place in places if place.exists()), None)
            if file is None:
                verdicts.append(Verdict(f"{arm.name}: file {arm.file}", math.nan, "<=", 0))
                continue
            problem = written(Path(scratch) / arm.name, arm, file, options.seconds)
            robot, _ = robot_at_start(load_problem(str(problem)))
            verdicts += verdicts_of(arm.name, problem, robot)
            chains[arm.name] = partial(_same, robot)
        for name in SHIPPED:
            verdicts += [
                Verdict(f"{name}, {folder.name}: C", difference(folder), "<=", ALIKE, "rad/s")
                for folder in exported(name, Path(scratch) / name)
            ]
        tally = fault_campaign.run(options.cases, 0, compile=False, chains=chains)
    tally.show()
    verdicts.append(Verdict(f"fault campaign, {tally.cases} ticks: broken claims", len(tally.broken), "<=", 0))
    print_verdicts(console, verdicts)
    return 0 if all_met(verdicts) else 1


def written(folder: Path, arm: Arm, file: Path, seconds: float) -> Path:
    """A problem file of the arm, its robot file beside it."""
    folder.mkdir(parents=True)
    (folder / "robot.toml").write_text(ROBOT.format(file=file, tip=arm.tip, acceleration=arm.acceleration))
    (folder / "circle.toml").write_text(PROBLEM.format(name=arm.name, start=list(arm.start), seconds=seconds))
    return folder / "circle.toml"


def verdicts_of(name: str, problem: Path, robot: SerialChain) -> list[Verdict]:
    """Of the runs and of the C."""
    found = []
    for plant, bound in ((None, FOLLOWED), ("mujoco", ON_SERVOS)):
        outcome = run_problem(load_problem(str(problem)), plant=plant)
        (trace,) = outcome.traces.values()
        beyond = np.maximum(trace["joint"] - robot.upper, robot.lower - trace["joint"]).max()
        where = plant or "as commanded"
        found.append(
            Verdict(f"{name}, {where}: largest error", float(trace["position_error_m"].max()), "<=", bound, "m")
        )
        found.append(Verdict(f"{name}, {where}: beyond a joint limit", max(0.0, float(beyond)), "<=", 0, "rad"))
    (folder,) = exported(str(problem), problem.parent / "c")
    return [*found, Verdict(f"{name}: C", difference(folder), "<=", ALIKE, "rad/s")]


def _same(robot: SerialChain) -> SerialChain:
    return robot


def exported(problem: str, folder: Path) -> list[Path]:
    """Folders of the C of a problem's controllers."""
    return sorted({file.parent for file in export_c(load_problem(problem), folder)})


def difference(folder: Path) -> float:
    """Largest difference of a command of C from Python's in the recorded run."""
    source = next(folder.glob("rehab_*.c")).name
    compiler = os.environ.get("CC", "cc")
    subprocess.run([compiler, *FLAGS, source, "main.c", "-o", "example", "-lm"], cwd=folder, check=True)
    done = subprocess.run(["./example", "0"], cwd=folder, check=False, capture_output=True, text=True)
    said = re.search(r"largest difference from Python (\S+)", done.stdout)
    return math.nan if said is None else float(said[1])


if __name__ == "__main__":
    raise SystemExit(main())
