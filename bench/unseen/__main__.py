"""The mirror on recordings that nobody tuned it to: placed by `rehab-opt place`, run, judged by an oracle of its own.

`python -m bench.unseen [--recordings 10] [--processes 1] [--minutes M] [--seed 500] [--random-seats 2000] [--write]`.
Half of them are minimum-jerk reaches with turns at random (seeds from `--seed` on), half are slices of the real hand at
random rows. 100 take about an hour on two idle cores (`--processes 2`).
Nothing judged is imported by the oracle (`ur5_branches`, `person_reach`, `measured`, `time_optimal`, which needs the
extra `peers`).
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
import time
import tomllib
from functools import partial
from multiprocessing import Pool
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from bench.machine import machine
from bench.results import RESULTS, write_section
from bench.unseen.hands import reach_recording, slice_recording
from bench.unseen.measured import Broken, broken, judged, off_path, passed, reach
from bench.unseen.time_optimal import least_seconds, reference_seconds
from bench.unseen.ur5_branches import branch_of, flange, manipulability, postures
from bench.verdict import Verdict, all_met, print_verdicts
from rehab_opt.plants.ideal import IdealJoints
from rehab_opt.session.files import ProblemFile, problem_of, shipped_problems
from rehab_opt.session.mirror.laws import planned, track_reference, tracker_of
from rehab_opt.session.mirror.metrics import driven
from rehab_opt.session.mirror.placing import found_place, placed
from rehab_opt.session.mirror.scene import laid_out

__all__ = ["main"]

Array = NDArray[np.float64]

TUNED, JUDGED, KEPT_BACK = (721, 1500), (1501, 2400), (2401, 3000)
"""Rows of the real hand: tuned on, judged by default, and looked at in the end only (`--kept-back`)."""
ROWS = 480
ACCELERATION = 15.0
"""[rad/s^2] of `ur5()`."""
SOME = 40
"""Poses of a recording on which random seats are compared."""
FINALISTS = 50
"""Of the random seats that are then compared on all of them."""
TITLES = (
    "recording", "in reach, any branch / start's", "best random", "promised", "step of all",
    "step of in reach, any / start's", "plan", "drive / step", "step's seconds", "plan / least time",
    "worst acceleration",
)  # fmt: skip
TITLE = "## The mirror on unseen recordings"


class Row(NamedTuple):
    """What was measured of one recording."""

    name: str
    in_reach: float
    """Share of poses in reach of robot (any branch) and person, from the placed seat."""
    on_branch: float
    """The same on the branch that the motion starts on."""
    promised: float
    step: float
    """Share of the poses in reach (any branch) that `step` passes."""
    step_on_branch: float
    plan: float
    achieved: float
    """Share of all poses that `step` passes, by the oracle."""
    best_random: float
    complete: bool
    driven: float
    """Share of the poses that `step` passes which the drive behind it passes, too."""
    off: float
    """[m] of the drive from the joint path of `step`, at most."""
    late: float
    """Duration of `step` over the recording's."""
    over_least: float
    """Duration of the plan over the least of its joint path."""
    turn: float
    """Of the tool from the reference, beyond what it is said to stay short of, over `max_turn`."""
    worst: Broken

    @property
    def line(self) -> str:
        """Of the table."""
        return (
            f"| {self.name} | {self.in_reach:.2f} / {self.on_branch:.2f} | {self.best_random:.2f} | "
            f"{self.promised:.3f} | {self.achieved:.3f} | {self.step:.2f} / {self.step_on_branch:.2f} | "
            f"{self.plan:.2f} | {self.driven:.3f}, {1e3 * self.off:.2f} mm | x {self.late:.1f} | "
            f"{self.over_least:.2f} | {self.worst.acceleration:.2f} |"
        )


def problem_with(recording: dict[str, Any], folder: Path) -> ProblemFile[Any]:
    """The shipped recording's problem with another recording."""
    content = tomllib.loads(shipped_problems()["mirror/vr_hand"].read_text())
    content["recording"] = recording
    if recording["frame"] == "robot":
        del content["placement"]["recorded_arm_m"], content["placement"]["arm_m"]
    return problem_of(content, name="unseen", file="unseen.toml", path=folder / "unseen.toml")


def measured(config: ProblemFile[Any], name: str, *, random_seats: int, seed: int) -> Row:
    """Place, run and judge one recording."""
    place = found_place(config, seed=seed, progress=lambda *_: None)
    there = placed(config, place.keys)
    content = there.problem.model_dump(mode="json")
    scene = laid_out(there)
    tracker = tracker_of(there.problem, scene, file=name)
    patience = there.problem.tracker.patience
    step = track_reference(tracker, scene, IdealJoints(tracker.dt), patience=patience, progress=lambda *_: None)
    plan = planned(tracker, scene, progress=lambda *_: None)
    poses = judged(scene.reference.poses)
    found = reach(poses, content)
    branch = found.on(int(branch_of(scene.start[None])[0]))
    by_step, by_plan = passed(step["joint"], poses), passed(plan["joint"], poses)
    limits = content["tracker"]
    drive = driven(
        step, scene.robot, there.problem.smoothing, linear_speed=limits["linear_speed_m_s"],
        max_manipulability=tracker.max_manipulability,
    )  # fmt: skip
    clock = reference_seconds(
        np.maximum.accumulate(plan["t_s"] - plan["lag_s"]), scene.led.poses, plan["_tool"][0], tracker.dt,
        speed=limits["linear_speed_m_s"], turning=math.radians(limits["angular_speed_deg_s"]),
    )  # fmt: skip
    worst = [
        broken(led["joint"], led["command"], tracker.dt, content, acceleration=ACCELERATION) for led in (step, plan)
    ]
    return Row(
        name, float(found.anyhow.mean()), float(branch.mean()), place.passed, _mean(by_step, found.anyhow),
        _mean(by_step, branch), _mean(by_plan, found.anyhow), float(by_step.mean()),
        best_random(poses, found.person, content, random_seats, np.random.default_rng(seed)), bool(step["_complete"]),
        _mean(passed(drive["joint"], poses), by_step),
        off_path(flange(drive["joint"])[:, :3, 3], flange(step["joint"])[:, :3, 3]),
        float(step["t_s"][-1] / (scene.reference.times[-1] - scene.reference.times[0])),
        float(plan["t_s"][-1]) / least_seconds(
            plan["joint"], clock, flange(plan["joint"])[:, :3, 3], speed=np.full(6, math.pi),
            acceleration=np.full(6, ACCELERATION), hand_speed=limits["linear_speed_m_s"],
        ),
        max(float(np.nanmax(led["turn_rad"] - led["_short"][:, 1])) / tracker.max_turn for led in (step, plan)),
        Broken(*(f(each) for f, each in zip((max, max, min), zip(*worst, strict=True), strict=True))),
    )  # fmt: skip


def best_random(
    poses: Array, person: NDArray[np.bool_], content: dict[str, Any], count: int, rng: np.random.Generator
) -> float:
    """In-reach share (any branch) of the best of seats and grips at random, patients out of the robot's column.

    All are looked at on some of the poses, and the best of those on all: the best of many coarse shares flatters.
    """
    points = np.array([content["placement"]["origin_m"], content["patient"]["sagittal_point_m"],
                       content["patient"]["arm"]["shoulder_m"]])  # fmt: skip
    middle, floor = np.median(poses[:, :3, 3], axis=0), content["tracker"]["floor"]
    some = np.unique(np.linspace(0, len(poses) - 1, SOME).astype(int))

    def fraction(seat: tuple[Array, Array, Array], among: NDArray[np.int_]) -> float:
        turn, goal, grip = seat
        moved = poses[among]
        moved[:, :3, 3] = (moved[:, :3, 3] - middle) @ turn.T + goal
        moved[:, :3, :3] = turn @ moved[:, :3, :3] @ grip
        found = postures(moved)
        good = ~np.isnan(found).any(axis=2)
        good &= (manipulability(np.nan_to_num(found.reshape(-1, 6))) >= floor).reshape(-1, 8)
        return float((good.any(axis=1) & person[among]).mean())

    seats: list[tuple[float, int, tuple[Array, Array, Array]]] = []
    while len(seats) < count:
        angle, about = rng.uniform(-math.pi, math.pi, 2)
        c, s = math.cos(angle), math.sin(angle)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        away, height = rng.uniform(0.2, 0.9), rng.uniform(-0.3, 0.7)
        goal = np.array([away * math.cos(about), away * math.sin(about), height])
        there = (points - middle) @ turn.T + goal
        if not (-0.1 <= there[2, 2] <= 0.5 and np.linalg.norm(there[:, :2], axis=1).min() >= 0.45):
            continue
        grip = np.linalg.qr(rng.standard_normal((3, 3)))[0]
        seat = turn, goal, grip * np.sign(np.linalg.det(grip))
        seats.append((fraction(seat, some), len(seats), seat))
    best = sorted(seats, reverse=True)[:FINALISTS]
    return max((fraction(seat, np.arange(len(poses))) for *_, seat in best), default=0.0)


def verdicts(rows: list[Row]) -> list[Verdict]:
    """The issue's rows."""
    anyhow = np.maximum([row.in_reach for row in rows], 1e-9)
    branch = np.maximum([row.on_branch for row in rows], 1e-9)
    step, own, plan = np.array([(row.step, row.step_on_branch, row.plan) for row in rows]).T
    gap = max(abs(r.promised - r.achieved) for r in rows)
    seat = min(r.in_reach / max(r.best_random, 1e-9) for r in rows)
    return [
        Verdict("step: fraction of the poses in reach that it passes", _weighted(step, anyhow), ">=", 0.9),
        Verdict("step: fraction of those in reach on the branch it starts on", _weighted(own, branch), ">=", 0.9),
        Verdict("plan: fraction of the poses in reach that it passes", _weighted(plan, anyhow), ">=", 0.98),
        Verdict(
            "plan: duration / the least of its joint path (toppra), worst", max(r.over_least for r in rows), "<=", 1.15
        ),
        Verdict("place: promised and achieved differ by at most", gap, "<=", 0.03),
        Verdict("place: in-reach fraction / best of random seats, worst", seat, ">=", 0.95),
        Verdict("drive: fraction of what step passes that it passes, too", min(r.driven for r in rows), ">=", 0.99),
        Verdict("drive: off the way of step in mm, worst", 1e3 * max(r.off for r in rows), "<=", 1.0),
        Verdict("runs that come to the recording's end", float(np.mean([r.complete for r in rows])), ">=", 1.0),
        Verdict("joint acceleration / its limit, worst", max(r.worst.acceleration for r in rows), "<=", 1 + 1e-6),
        Verdict("hand speed / its limit, worst", max(r.worst.hand_speed for r in rows), "<=", 1 + 1e-6),
        Verdict("turn beyond what the arm stays short of / max_turn, worst", max(r.turn for r in rows), "<=", 1.0),
        Verdict("manipulability / floor, worst", min(r.worst.floor for r in rows), ">=", 1 - 1e-6),
    ]


def _mean(flags: NDArray[np.bool_], among: NDArray[np.bool_]) -> float:
    return float(flags[among].mean()) if among.any() else 1.0


def _weighted(fractions: Array, weights: Array) -> float:
    return float(np.average(fractions, weights=weights))


def main() -> int:
    """Measure, print, and write where it is asked for."""
    parser = argparse.ArgumentParser(prog="python -m bench.unseen", description=__doc__)
    parser.add_argument("--recordings", type=int, default=10)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--minutes", type=float, default=math.inf, help="after which no recording is begun")
    parser.add_argument("--seed", type=int, default=500)
    parser.add_argument("--random-seats", type=int, default=2000)
    parser.add_argument("--rows", choices=("tuned", "judged", "kept-back"), default="judged")
    parser.add_argument("--write", action="store_true", help="put the table into bench/RESULTS.md")
    options = parser.parse_args()
    console = Console(width=132)
    first, last = {"tuned": TUNED, "judged": JUDGED, "kept-back": KEPT_BACK}[options.rows]
    rows_of = np.random.default_rng(options.seed).integers(first, last - ROWS + 2, options.recordings).tolist()
    one = partial(
        of_recording, seed=options.seed, random_seats=options.random_seats, until=time.time() + 60 * options.minutes
    )
    rows = []
    console.print("| " + " | ".join(TITLES) + " |", highlight=False, soft_wrap=True)
    with Pool(options.processes) as pool:
        for row, seconds in filter(None, pool.imap(one, enumerate(rows_of))):
            rows.append(row)
            console.print(f"{row.line} ({seconds:.0f} s)", highlight=False, soft_wrap=True)
    found = verdicts(rows)
    print_verdicts(console, found)
    if options.write:
        _write(len(rows), found, options)
    return 0 if all_met(found) else 1


def of_recording(task: tuple[int, int], *, seed: int, random_seats: int, until: float) -> tuple[Row, float] | None:
    """What was measured of the k-th recording, and in how many seconds; none where it would begin after `until`.

    `task` is k and the row of the real hand from which an odd one is.
    """
    k, first = task
    began = time.time()
    if began > until:
        return None
    with tempfile.TemporaryDirectory() as scratch:
        if k % 2:
            recording, name = slice_recording(first, rows=ROWS), f"real hand, rows {first} to {first + ROWS - 1}"
        else:
            recording, name = reach_recording(Path(scratch), seed + k), f"reaches, seed {seed + k}"
        config = problem_with(recording, Path(scratch))
        return measured(config, name, random_seats=random_seats, seed=seed + k), time.time() - began


def _write(recordings: int, found: list[Verdict], options: argparse.Namespace) -> None:
    about = "  ".join(f"{key}: {value}" for key, value in machine().items())
    command = f"python -m bench.unseen --recordings {options.recordings} --seed {options.seed} --rows {options.rows}"
    numbers = ["| what | value | bound | |", "|---|---|---|---|"]
    for each in found:
        verdict = "PASS" if each.met else "FAIL"
        numbers.append(f"| {each.what} | {each.measured:.4g} | {each.relation} {each.asked:.4g} | {verdict} |")
    command += f" --minutes {options.minutes:g}" if math.isfinite(options.minutes) else ""
    section = [TITLE, "", f"`{command} --write`: {recordings} recordings; {about}", "", *numbers]
    write_section(RESULTS, "unseen", section)


if __name__ == "__main__":
    sys.exit(main())
