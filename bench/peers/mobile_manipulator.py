"""Chair and arm by one stick, beside pink: `python -m bench.peers.mobile_manipulator` (extra `peers`).

Robots are ARDIS, seven joints, and a Gen3 on a chair, ten. Both get the same chain (hand positions compared before
anything is timed), rows x, y, z of the hand in the chassis frame, limits of joint positions, joint speeds and wheels
and, of an ordinary chair, the non-holonomic row.
Ours keeps what it adds: six obstacles, the keep-out of the arm, the way to rest, acceleration bounds, certificate and
Command; pink has none of these here. `--parts` times ours without the keep-out, too, and without obstacles either.
Each integrates its own state along the same wandering stick; rounds alternate.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from collections.abc import Callable, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pink
import pinocchio
from pink.limits import ConfigurationLimit, Limit, VelocityLimit
from rich.console import Console
from rich.table import Table

from bench.machine import machine
from bench.test_bench_control import ROOM
from bench.verdict import Reported, Verdict, all_met, print_verdicts
from rehab_opt import RedundancyResolver, SerialChain, ardis
from rehab_opt.kinematics.ardis import ARDIS_READY
from rehab_opt.kinematics.arm_on_chair import arm_on_chair
from rehab_opt.kinematics.mobile_arm import MobileArm

__all__ = ["main"]

DT, HOLD = 0.01, 100
SPEEDS = {"slow": 0.1, "fast": 1.0}
"""[m/s] of the stick: within what chair and arm can do, and beyond it."""
PARTS: dict[str, dict[str, Any]] = {
    "all": {},
    "no keep-out": {"keep_out": False},
    "nor obstacles": {"keep_out": False, "obstacles": ()},
}
"""What of ours is left out."""
HAND = "hand"
GEN3 = Path(__file__).parents[2] / "problems" / "robots" / "kinova_gen3" / "gen3.urdf"
MOUNT = np.array([[1.0, 0, 0, 0.25], [0, 1, 0, -0.35], [0, 0, 1, 0.62], [0, 0, 0, 1]])
"""Of the Gen3 on the chair."""
GEN3_READY = np.radians([0, 0, 0, -105.9, -72.0, -59.9, -112.0, -33.0, -57.3, 0.0])
"""Joints that slide are at zero."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run both drives, slow and fast, and judge."""
    parser = argparse.ArgumentParser(prog="python -m bench.peers.mobile_manipulator", description=__doc__)
    parser.add_argument("--rounds", type=int, default=20)
    parser.add_argument("--ticks", type=int, default=200)
    parser.add_argument("--parts", action="store_true", help="also ours without keep-outs, and without obstacles")
    options = parser.parse_args(arguments)
    console, robots = Console(), {"ARDIS": (ardis(), ARDIS_READY), "Gen3": (_gen3_on_chair(), GEN3_READY)}
    console.print("  ".join(f"{key}: {value}" for key, value in machine().items()), highlight=False)
    parts = PARTS if options.parts else {"all": PARTS["all"]}
    heads = [head for part in parts for head in (f"ours ({part}), us", "p99")]
    table = Table("robot", "drive", "stick", *heads, "pink + daqp, us", "p99", *["ratio"] * len(parts))
    verdicts, notes = [], []
    for (kind, (robot, ready)), drive, (name, speed) in product(
        robots.items(), ("mecanum", "differential"), SPEEDS.items()
    ):
        steps = [*(_ours(robot, drive, **part) for part in parts.values()), _pink(robot, drive, ready)]
        *ours, pinks = _alternated(steps, ready, speed, options.rounds, options.ticks)
        ratios = [statistics.median(np.median(each, axis=1) / np.median(pinks, axis=1)) for each in ours]
        cells = [f"{value:.1f}" for each in (*ours, pinks) for value in (np.median(each), np.percentile(each, 99))]
        table.add_row(kind, drive, name, *cells, *(f"{ratio:.3f}" for ratio in ratios))
        what = f"{kind}, {drive}, {name} stick"
        verdicts.append(Verdict(f"{what}: ours / pink + daqp", ratios[0], "<=", 1 / 20))
        left = [part for part in parts if part != "all"]
        notes += [Reported(f"{what}, {part}", ratio) for part, ratio in zip(left, ratios[1:], strict=True)]
    console.print(table)
    for note in notes:
        console.print(str(note), highlight=False, soft_wrap=True)
    print_verdicts(console, verdicts)
    return 0 if all_met(verdicts) else 1


Step = Callable[[np.ndarray, np.ndarray], np.ndarray]


def _ours(robot: MobileArm, drive: str, **part: Any) -> Step:
    options = {"obstacles": ROOM, "row_sets": [("x", "y", "z")], "dt": DT, "compile": "wait"} | part
    resolver = RedundancyResolver(robot, drive=drive, **options)  # type: ignore[arg-type]
    return lambda q, stick: resolver.step(q, stick).value


def _gen3_on_chair() -> MobileArm:
    return arm_on_chair(SerialChain.from_urdf(GEN3, acceleration=4.0), mount=MOUNT)


def _pink(robot: MobileArm, drive: str, ready: np.ndarray) -> Step:
    model = _model(robot)
    _same_hand(robot, model, ready)
    configuration = pink.Configuration(model, model.createData(), ready.copy())
    hand = pink.FrameTask(HAND, position_cost=1.0, orientation_cost=0.0)
    rest = pink.tasks.DampingTask(cost=1e-3)
    wheels = robot.mecanum if drive == "mecanum" else robot.differential
    limits = (ConfigurationLimit(model), VelocityLimit(model), _WheelLimit(model, wheels.rolling, wheels.limit))
    rolling = (_Rolling(cost=1.0),) if drive == "differential" else None

    def step(q: np.ndarray, stick: np.ndarray) -> np.ndarray:
        configuration.update(q)
        target = configuration.get_transform_frame_to_world(HAND).copy()
        target.translation += _turned(q, stick) * DT
        hand.set_target(target)
        return pink.solve_ik(  # type: ignore[no-any-return]
            configuration, (hand, rest), DT, solver="daqp", limits=limits, constraints=rolling, safety_break=False
        )

    return step


def _turned(q: np.ndarray, stick: np.ndarray) -> np.ndarray:
    """The stick (forward, left, up) of the chassis frame in world axes."""
    cos, sin = np.cos(q[2]), np.sin(q[2])
    forward, left = cos * stick[0] - sin * stick[1], sin * stick[0] + cos * stick[1]
    return np.array([forward, left, stick[2]])


class _WheelLimit(Limit):
    """Wheel speeds within their limit, of the chassis twist that the first three joints make."""

    def __init__(self, model: pinocchio.Model, rolling: np.ndarray, limit: float) -> None:
        self.rolling, self.bound, self.n = rolling, np.full(2 * len(rolling), limit), model.nv

    def compute_qp_inequalities(self, configuration: pink.Configuration, dt: float) -> tuple[np.ndarray, np.ndarray]:
        cos, sin = np.cos(configuration.q[2]), np.sin(configuration.q[2])
        rows = np.zeros((len(self.rolling), self.n))
        rows[:, :3] = self.rolling @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
        return np.vstack((rows, -rows)), self.bound * dt


class _Rolling(pink.tasks.Task):
    """No sideways motion of an ordinary chair: Eq. (4), Honzik."""

    def compute_error(self, configuration: pink.Configuration) -> np.ndarray:
        return np.zeros(1)

    def compute_jacobian(self, configuration: pink.Configuration) -> np.ndarray:
        row = np.zeros((1, configuration.model.nv))
        row[0, :2] = -np.sin(configuration.q[2]), np.cos(configuration.q[2])
        return row

    def __repr__(self) -> str:
        return "_Rolling()"


def _model(robot: MobileArm) -> pinocchio.Model:
    """The chain in pinocchio: each joint turns about or slides along its z, then comes the way to the next."""
    model, parent, chain = pinocchio.Model(), 0, robot.chain
    before = pinocchio.SE3(chain.base)
    for i, row in enumerate(chain.rows):
        joint = pinocchio.JointModelPZ() if row.prismatic else pinocchio.JointModelRZ()
        bounds = [np.array([float(value)]) for value in (chain.velocity[i], chain.lower[i], chain.upper[i])]
        parent = model.addJoint(parent, joint, before, chain.names[i], np.array([1e3]), *bounds)
        before = pinocchio.SE3(np.array(row.after, dtype=np.float64))
    model.addFrame(pinocchio.Frame(HAND, parent, 0, before * pinocchio.SE3(chain.tool), pinocchio.FrameType.OP_FRAME))
    return model


def _same_hand(robot: MobileArm, model: pinocchio.Model, ready: np.ndarray) -> None:
    """Raise AssertionError where pinocchio's hand is not ours: its times would mean nothing."""
    data, rng = model.createData(), np.random.default_rng(0)
    for _ in range(50):
        q = ready + 0.3 * rng.standard_normal(robot.chain.n)
        pinocchio.framesForwardKinematics(model, data, q)
        difference = np.abs(data.oMf[model.getFrameId(HAND)].homogeneous - robot.chain.pose(q)).max()
        if not difference <= 1e-9:
            raise AssertionError(f"hand pose differs by {difference:.1e} at q = {q.tolist()}")


def _alternated(steps: Sequence[Step], ready: np.ndarray, speed: float, rounds: int, ticks: int) -> list[np.ndarray]:
    """(rounds, ticks) [us] of each."""
    rng = np.random.default_rng(0)
    states = [ready.copy() for _ in steps]
    times = [np.empty((rounds, ticks)) for _ in steps]
    for k in range(-1, rounds):  # the first round warms up
        sticks = np.repeat(speed * rng.standard_normal((ticks // HOLD + 1, 3)) * [1.0, 1.0, 0.3], HOLD, axis=0)
        for step, kept, q in zip(steps, times, states, strict=True):
            for i in range(ticks):
                began = time.perf_counter()
                velocity = step(q, sticks[i])
                kept[max(k, 0), i] = 1e6 * (time.perf_counter() - began)
                q[:] = q + DT * velocity
    return times


if __name__ == "__main__":
    sys.exit(main())
