"""A mirrored motion as one structured NLP, beside `MirrorTracker.plan`: what it costs, what it passes, what it breaks.

`python -m bench.plan_nlp [--reaches 3] [--slices 3] [--slice-seconds 5.3] [--rate 20] [--seed 60] [--solvers ipopt]`.

Knots lie along the reference, `--rate` of them for each second that it takes at the hand's largest speeds. With the
pose X_k that is asked for at the k-th, the least seconds d_k until the next (the recording's own pace, bridges at
half the hand's speeds), e_k and t_k the tool's distance from X_k and turn:

    min   sum |e_k|^2 + turn_length^2 t_k^2 + price h_k
    s.t.  q' = q + h v + h^2/2 a,  v' = v + h a,  h >= d,  at rest at both ends,
          joint positions, speeds and accelerations within limits,  |J v| <= linear speed,  w(q) >= floor.

h is free: what cannot be done at the recording's pace is done later, and what cannot be done at all as near as it
comes. The solution is laid out in ticks and judged as a plan is, by the oracle of `bench.unseen`; joint limits and
planes by the arm's own functions. Nothing is said to the NLP of planes, `max_deviation` and `max_turn`.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from bench.unseen.__main__ import ACCELERATION, JUDGED, problem_with
from bench.unseen.hands import reach_recording, slice_recording
from bench.unseen.measured import broken, judged, passed
from bench.unseen.time_optimal import reference_seconds
from rehab_opt import MirrorTracker
from rehab_opt.control.seats import Seats
from rehab_opt.session.files import ProblemFile, load_problem
from rehab_opt.session.mirror.laws import tracker_of
from rehab_opt.session.mirror.placing import found_place, placed
from rehab_opt.session.mirror.scene import laid_out

Array = NDArray[np.float64]

SHIPPED = "pick_fruit", "open_refrigerator"
SHAPES = 100
"""Knots of a programme are a multiple of these, so that most recordings find theirs built."""
SCALE, PRICE = 1e4, 1e-2
"""[1/m^2] of squares of distances; and what a knot's own time counts for: as much as 1 mm at one knot."""
LONGEST = 2.0
"""[s] from one knot to the next at most."""
KEPT = 0.98, 1.005
"""Shares of hand speed and floor that bound the knots: between them it may be more, or less."""


class Reference(NamedTuple):
    """N + 1 knots."""

    poses: Array
    """(N + 1, 4, 4), from the tool's at the start on."""
    seconds: Array
    """(N,) [s] until the next one, at least."""
    spacing: float
    """[s] until the next one at the hand's largest speeds."""


def knots_of(tracker: MirrorTracker, poses: Array, start: Array, *, rate: float) -> Reference:
    """Knots along poses (M, 4, 4), `dt` apart, from posture `start` (n,) on; rate in 1/s."""
    seen = np.flatnonzero(np.isfinite(poses[:, 0, 3]))
    here, times = tracker.chain.pose(start), tracker.dt * np.append(-1, seen)
    way = np.concatenate([here[None], poses[seen]])
    own = reference_seconds(times, poses, here, tracker.dt, speed=tracker.linear_speed, turning=tracker.angular_speed)
    turns = Rotation.from_matrix(way[:, :3, :3])
    turned = (turns[:-1].inv() * turns[1:]).magnitude()
    moved = np.linalg.norm(np.diff(way[:, :3, 3], axis=0), axis=1)
    least = np.maximum.reduce([np.diff(own), moved / tracker.linear_speed, turned / tracker.angular_speed])
    passed_at = np.append(0.0, np.cumsum(np.maximum(least, 1e-9)))
    count = SHAPES * math.ceil(rate * passed_at[-1] / SHAPES)
    at = np.linspace(0.0, passed_at[-1], count + 1)
    found = np.tile(np.eye(4), (count + 1, 1, 1))
    found[:, :3, :3] = Slerp(passed_at, turns)(at).as_matrix()
    found[:, :3, 3] = np.column_stack([np.interp(at, passed_at, axis) for axis in way[:, :3, 3].T])
    return Reference(found, np.diff(np.interp(at, passed_at, own)), passed_at[-1] / count)


class Solution(NamedTuple):
    """A motion with constant accelerations between its knots."""

    q: Array
    """(N + 1, n) [rad]"""
    v: Array
    """(N + 1, n) [rad/s]"""
    a: Array
    """(N, n) [rad/s^2] after each knot but the last."""
    h: Array
    """(N,) [s] to the next knot."""
    iterations: int
    refusal: str
    """Why the solver gave up, or nothing."""

    def ticks(self, dt: float) -> Array:
        """(M, n) positions `dt` apart, from rest to rest."""
        ends = np.append(0.0, np.cumsum(self.h))
        times = np.minimum(dt * np.arange(math.ceil(ends[-1] / dt) + 2), ends[-1])
        k = np.clip(np.searchsorted(ends, times, side="right") - 1, 0, len(self.h) - 1)
        since = (times - ends[k])[:, None]
        return np.asarray(self.q[k] + since * self.v[k] + since**2 / 2 * self.a[k])


class Programme:
    """The NLP of N knots after the first, for one arm; its functions compiled, by a C compiler, where asked for."""

    def __init__(self, tracker: MirrorTracker, count: int, solver: str, options: argparse.Namespace) -> None:
        begun = spent()
        chain, n = tracker.chain, tracker.chain.n
        self.chain, self.count = chain, count
        x, u, after, target = (ca.SX.sym("x", size) for size in (2 * n, n + 1, 2 * n, 12))
        q, v, a, h = x[:n], x[n:], u[:n], u[n]
        pose, wanted = chain.pose_expression(q)[:3, :], ca.reshape(target, 3, 4)
        turned = tracker.task_weights[3] * ca.sumsqr(pose[:, :3] - wanted[:, :3]) / 2  # 2 (1 - cos t), twice
        off = SCALE * (ca.sumsqr(pose[:, 3] - wanted[:, 3]) + turned)
        hand = ca.sumsqr(chain.jacobian_expression(q)[:3, :] @ v) / (KEPT[0] * tracker.linear_speed) ** 2
        w = chain.manipulability_expression(q) / tracker.max_manipulability
        gap = after - ca.vertcat(q + h * v + h**2 / 2 * a, v + h * a)
        stage = ca.Function("stage", [x, u, after, target], [ca.vertcat(gap, hand, w), off], {"cse": True})
        self.rows = [[0.0] * 2 * n + [-math.inf, KEPT[1] * tracker.floor], [0.0] * 2 * n + [1.0, math.inf]]
        # One column a knot: states, then inputs, as solvers of structured programmes want them.
        free = ca.MX.sym("free", (3 * n + 1) * count + 2 * n)
        targets, price = ca.MX.sym("targets", 12, count + 1), ca.MX.sym("price")
        columns, last = ca.reshape(free[: -2 * n], 3 * n + 1, count), free[-2 * n :]
        states, inputs = columns[: 2 * n, :], columns[2 * n :, :]
        rows, costs = stage.map(count)(states, inputs, ca.horzcat(states[:, 1:], last), targets[:, :count])
        cost = ca.sum2(costs) + stage(last, 0, last, targets[:, count])[1] + price * ca.sum2(inputs[n, :])
        nlp = {"x": free, "p": ca.vertcat(ca.vec(targets), price), "f": cost, "g": ca.vec(rows)}
        settings: dict[str, Any] = {
            "error_on_fail": False, "print_time": False, "show_eval_warnings": False, "calc_lam_p": False,
            "jit": not options.uncompiled, "compiler": "shell",
            "jit_options": {"flags": ["-O1"], "directory": f"{tempfile.gettempdir()}/"},
            solver: {"print_level": 0, "max_iter": options.iterations, "tol": 1e-6},
        }  # fmt: skip
        if solver == "fatrop":
            settings |= {"structure_detection": "auto", "equality": ([True] * 2 * n + [False] * 2) * count}
        else:
            settings[solver] |= {"sb": "yes", "mu_strategy": "adaptive", "max_cpu_time": options.seconds}
        self.function = ca.nlpsol("plan", solver, nlp, settings)
        self.seconds = spent() - begun

    def solve(self, reference: Reference, guess: Array) -> Solution:
        """From a first guess of the positions at the knots (N + 1, n), the first of which is where the arm rests."""
        chain, n, count = self.chain, self.chain.n, self.count
        lower, upper = (
            np.tile(np.concatenate([ends, sign * chain.velocity, sign * chain.acceleration, [LONGEST]]), (count, 1))
            for ends, sign in ((chain.lower, -1.0), (chain.upper, 1.0))
        )
        lower[:, -1] = np.maximum(reference.seconds, 1e-3)
        lower[0, : 2 * n] = upper[0, : 2 * n] = np.append(guess[0], np.zeros(n))
        spacing = np.maximum(reference.spacing, lower[:, -1])
        speeds = np.diff(guess, axis=0) / spacing[:, None]
        begin = np.column_stack([guess[:-1], speeds, np.zeros_like(speeds), spacing])
        rest = np.zeros(n)
        found = self.function(
            x0=np.concatenate([begin.ravel(), guess[-1], rest]), lbx=np.concatenate([lower.ravel(), chain.lower, rest]),
            ubx=np.concatenate([upper.ravel(), chain.upper, rest]), lbg=np.tile(self.rows[0], count),
            ubg=np.tile(self.rows[1], count),
            p=np.append(reference.poses[:, :3, :].transpose(0, 2, 1), PRICE / reference.spacing),
        )  # fmt: skip
        answer, stats = found["x"].full().ravel(), self.function.stats()
        columns, last = answer[: -2 * n].reshape(count, -1), answer[-2 * n :]
        q, v = np.split(np.vstack([columns[:, : 2 * n], last]), 2, axis=1)
        iterations = stats.get("iter_count", stats.get("fatrop", {}).get("iterations_count", -1))
        refusal = "" if stats["success"] else f"gave up: {stats['return_status']}"
        return Solution(q, v, columns[:, 2 * n : -1], columns[:, -1], int(iterations), refusal)


class Judged(NamedTuple):
    """What the oracle says of a motion in ticks."""

    seconds: float
    """[s] that it takes."""
    passed: float
    """Share of the recording's poses."""
    off: float
    """[m] from the reference, at most; of an NLP at its knots."""
    acceleration: float
    hand_speed: float
    floor: float
    """As `bench.unseen.measured.Broken`."""
    outside: float
    """[rad] beyond joint limits or [m] beyond keep-out planes, at most; below zero is inside."""

    @property
    def line(self) -> str:
        """Of the table."""
        return (
            f"{self.seconds:.1f} | {self.passed:.3f} | {1e3 * self.off:.0f} | {self.acceleration:.3f} | "
            f"{self.hand_speed:.3f} | {self.floor:.4f} | {self.outside:.1e} | {'yes' if self.kept else 'NO'} |"
        )

    @property
    def kept(self) -> bool:
        """Whether every bound is, by the tolerances of `bench.unseen`."""
        fast = max(self.acceleration, self.hand_speed) <= 1 + 1e-6
        return fast and self.floor >= 1 - 1e-6 and self.outside <= 1e-9


def judge(tracker: MirrorTracker, q: Array, poses: Array, problem: dict[str, Any], *, off: float) -> Judged:
    """Of positions (M, n) in ticks, the last of them at rest."""
    velocities = np.append(np.diff(q, axis=0), np.zeros((1, q.shape[1])), axis=0) / tracker.dt
    found = broken(q, velocities, tracker.dt, problem, acceleration=ACCELERATION)
    planes = [-tracker.hand_bounds.min_heights(q, plane).min() for plane in tracker.hand_bounds.planes]
    outside = max(*(tracker.chain.lower - q).max(axis=1), *(q - tracker.chain.upper).max(axis=1), *planes)
    return Judged(tracker.dt * (len(q) - 1), float(passed(q, judged(poses)).mean()), off, *found, float(outside))


def spent() -> float:
    """[s] of processor time, compilers included."""
    return sum(os.times()[:4])


@lru_cache(maxsize=1)
def seats_of(tracker: MirrorTracker) -> Seats:
    """What walks along a path of poses, built once."""
    return Seats(tracker)


def first_guess(tracker: MirrorTracker, reference: Reference, start: Array) -> Array:
    """(N + 1, n) nearest postures above the floor, knot by knot, without whole turns by which a walk is wound up."""
    guess = seats_of(tracker).walk(reference.poses[:, None], start[None], 0).q[:, 0]
    guess += 2 * np.pi * np.rint((start - guess[0]) / (2 * np.pi))
    guess[0] = start
    return np.clip(guess, tracker.chain.lower, tracker.chain.upper)


def recordings(options: argparse.Namespace, folder: Path) -> Iterator[tuple[str, ProblemFile[Any]]]:
    """The shipped ones, and unseen ones of the generators."""
    for name in SHIPPED[: options.shipped]:
        yield name, load_problem(f"mirror/{name}")
    unseen = [
        (f"reaches, seed {s}", reach_recording(folder, s)) for s in range(options.seed, options.seed + options.reaches)
    ]
    rows = int(options.slice_seconds * 90)
    firsts = np.random.default_rng(options.seed).integers(JUDGED[0], JUDGED[1] - rows + 2, options.slices).tolist()
    unseen += [(f"real hand, rows {k} to {k + rows - 1}", slice_recording(k, rows=rows)) for k in firsts]
    for name, recording in unseen:
        config = problem_with(recording, folder)
        if options.placed:
            config = placed(config, found_place(config, seed=options.seed, progress=lambda *_: None).keys)
        yield name, config


TITLES = (
    "recording", "its s", "law", "knots", "iterations", "processor s cold / warm", "takes s", "passed", "off mm",
    "acceleration", "hand speed", "floor", "outside", "kept",
)  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    """Plan each recording by both, judge, print."""
    parser = argparse.ArgumentParser(prog="python -m bench.plan_nlp", description=__doc__)
    parser.add_argument("--reaches", type=int, default=3)
    parser.add_argument("--slices", type=int, default=3)
    parser.add_argument("--slice-seconds", type=float, default=5.3)
    parser.add_argument("--placed", action="store_true", help="at seats made for them, as `rehab-opt place` finds them")
    parser.add_argument("--shipped", type=int, default=len(SHIPPED))
    parser.add_argument("--seed", type=int, default=60)
    parser.add_argument("--rate", type=float, default=20.0, help="knots a second at the hand's largest speeds")
    parser.add_argument("--iterations", type=int, default=200)
    parser.add_argument("--seconds", type=float, default=60.0, help="of ipopt's processor time; fatrop has no such cap")
    parser.add_argument("--solvers", nargs="*", choices=("fatrop", "ipopt"), default=["fatrop", "ipopt"])
    parser.add_argument("--uncompiled", action="store_true", help="leave the NLP to CasADi's virtual machine")
    options = parser.parse_args(arguments)
    print("| " + " | ".join(TITLES) + " |", "|---" * len(TITLES) + "|", sep="\n")
    refused, built = Counter(dict.fromkeys(options.solvers, 0)), dict[tuple[Any, ...], Programme]()
    with tempfile.TemporaryDirectory() as scratch:
        for name, config in recordings(options, Path(scratch)):
            scene, content = laid_out(config), config.problem.model_dump(mode="json")
            tracker = tracker_of(config.problem, scene, file=name)
            poses, start, cpu = scene.led.poses, scene.start, []
            about = f"| {name} | {tracker.dt * len(poses):.1f}"
            for _ in range(2):
                begun = spent()
                plan = tracker.plan(poses, scene.led.twists, start)
                cpu.append(spent() - begun)
            found = judge(tracker, plan.q, poses, content, off=float(plan.deviations.max()))
            print(f"{about} | plan | - | - | {cpu[0]:.2f} / {cpu[1]:.2f} | {found.line}", flush=True)
            for solver in options.solvers:
                begun = spent()
                reference = knots_of(tracker, poses, start, rate=options.rate)
                guess, count = first_guess(tracker, reference, start), len(reference.seconds)
                guessed, key = spent() - begun, (solver, count, tracker.floor, tracker.linear_speed)
                if key not in built:
                    built[key] = Programme(tracker, count, solver, options)
                begun = spent()
                solution = built[key].solve(reference, guess)
                warm = guessed + spent() - begun
                refused[solver] += bool(solution.refusal)
                tools = np.array([tracker.chain.pose(each)[:3, 3] for each in solution.q])
                off = float(np.linalg.norm(tools - reference.poses[:, :3, 3], axis=1).max())
                found = judge(tracker, solution.ticks(tracker.dt), poses, content, off=off)
                cold = warm + built[key].seconds
                taken = f"{count} | {solution.iterations} {solution.refusal}"
                print(f"{about} | {solver} | {taken} | {cold:.2f} / {warm:.2f} | {found.line}", flush=True)
    print(*(f"{solver} gave up {count} times" for solver, count in refused.items()), sep="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
