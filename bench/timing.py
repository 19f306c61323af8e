"""Timing of whole paths, on shipped runs and generated paths: `python -m bench.timing`.

An oracle that shares nothing with the timing judges every path that `smooth_path` passes: finite differences of the
positions, a cubic interpolation of scipy's, and the arm's forward kinematics for the handle's tilt. Durations stand
beside those in `timing_before.json`, which `--record` wrote on the commit that the file names, with this same module:
there whole paths were timed in two passes and then averaged.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from scipy.interpolate import CubicSpline, PchipInterpolator

from bench.machine import machine
from bench.verdict import Reported, Verdict, all_met, print_verdicts
from rehab_opt import ArmIK, SerialChain, human_arm, smooth_path, ur5
from rehab_opt.session.files import load_problem
from rehab_opt.session.mirror import metrics as of_mirror
from rehab_opt.session.run import run_problem
from rehab_opt.session.upper_limb import drive as of_upper_limb

__all__ = ["main"]

Array = NDArray[np.float64]

BEFORE = Path(__file__).with_name("timing_before.json")
SHIPPED = (
    "upper_limb/figure_eight", "upper_limb/pen_trace", "upper_limb/mocap_box", "upper_limb/mocap_lift",
    "mirror/pick_fruit", "mirror/open_refrigerator", "mirror/franka_pick_fruit", "mirror/vr_hand",
)  # fmt: skip
"""Problems whose output is a path that is timed after its run."""
GENERATED = 50
ROUNDING = 1e-6
"""Part of a bound that rounding may add to a finite difference."""
TILTED = math.radians(0.01)
"""[rad] by which a handle may tilt further than along the path: what the reports of `upper_limb` allow a drive, too."""
DIFFERENCES = "speed", "acceleration", "jerk"


class Passed(NamedTuple):
    """One path and how it is passed."""

    name: str
    times: Array
    points: Array
    bounds: dict[str, Any]
    found: Any
    arm: SerialChain | None
    """Whose handle is to stay upright; None where nothing is."""


class Judged(NamedTuple):
    """What the oracle says of a path."""

    shares: Array
    """(3,) largest finite difference of each order over its bound."""
    off: float
    """Distance from the path over the tolerance."""
    beyond: float
    """[u] outside the position bounds."""
    tilted: float
    """[rad] further than along the path."""
    paced: float
    """Largest pace over the recorded one; infinite if the path is passed backwards or not to its end."""
    seconds: float


def judged(passed: Passed) -> Judged:
    """The oracle's answer."""
    found, bounds = passed.found, passed.bounds
    x, dt = found.positions, float(np.diff(found.times).mean())
    still = np.vstack([np.repeat(x[:1], 3, axis=0), x, np.repeat(x[-1:], 3, axis=0)])  # at rest before and after
    noise = 8.0 * np.finfo(float).eps * (1.0 + np.abs(x).max())
    shares = [
        float(((np.abs(np.diff(still, order, axis=0)) - 2**order * noise) / dt**order / bounds[name]).max())
        for order, name in enumerate(("velocity", "acceleration", "jerk"), start=1)
    ]
    n = x.shape[1]
    lower, upper = (np.broadcast_to(bounds[name], n) for name in ("lower", "upper"))
    path = PchipInterpolator(passed.times, np.clip(passed.points, lower, upper), axis=0)
    on = path(found.phase)
    pace = np.diff(found.phase) / dt
    ends = np.abs(x[[0, -1]] - path(passed.times[[0, -1]])).max() < 1e-9
    tilt = 0.0
    if passed.arm is not None:
        along, driven = (_tilts(passed.arm, q) for q in (on[::5], x[::5]))
        tilt = float((driven - np.maximum(along, np.deg2rad(2.0))).max())
    return Judged(
        np.array(shares), float(np.abs(x - on).max()) / bounds.get("tolerance", 1e-4),
        float(np.maximum(lower - x, x - upper).max(initial=0.0)), tilt,
        float(pace.max()) if ends and pace.min() >= -1e-9 else math.inf, float(found.times[-1] - found.times[0]),
    )  # fmt: skip


def _tilts(arm: SerialChain, q: Array) -> Array:
    axes = np.array([arm.pose(each)[:3, 0] for each in q])
    return np.asarray(np.arctan2(np.hypot(axes[:, 0], axes[:, 1]), axes[:, 2]))


def shipped(names: Sequence[str]) -> Iterator[Passed]:
    """Each path that a shipped run has timed: its sessions' own calls, watched."""
    for name in names:
        seen: list[Passed] = []

        def watched(times: Any, points: Any, *, _seen: list[Passed] = seen, _name: str = name, **bounds: Any) -> Any:
            found = smooth_path(times, points, **bounds)
            arm = human_arm() if _name.startswith("upper_limb") else None
            label = f"{_name} {len(_seen)}"
            _seen.append(Passed(label, np.asarray(times), np.asarray(points), bounds, found, arm))
            return found

        modules: list[Any] = [of_mirror, of_upper_limb]
        for module in modules:
            module.smooth_path = watched
        outcome = run_problem(load_problem(name))
        for module in modules:
            module.smooth_path = smooth_path
        chain = getattr(outcome, "chain", None)
        yield from (each._replace(arm=each.arm and chain) for each in seen)


def generated(count: int) -> Iterator[Passed]:
    """Paths of seeds 0, 1 and so on: curves and ways with corners, in turn slower and faster than the arm may be."""
    for seed in range(count):
        rng = np.random.default_rng(seed)
        kind, hurry = ("curve", "corners")[seed % 2], float(rng.uniform(0.3, 6.0))
        place = rng.uniform(-1.0, 1.0, (8, 8))
        arm = (ur5(), human_arm(range_of_motion="regular"), human_arm(range_of_motion="restricted"))[seed // 2 % 3]
        upright = seed // 2 % 3 == 2
        name = f"{seed}: {('UR5', 'arm, regular range', 'hand led upright')[seed // 2 % 3]}, {kind}, {hurry:.1f} times"
        if upright:  # the handle is to stay upright while the hand goes over a table
            hand = np.array([-0.172, 0.5, -0.24]) + np.column_stack([0.015 * place[:, :2], np.zeros(8)])
            q = ArmIK(arm, handle_tilt=np.radians(2.0)).follow(_way(hand, kind)).q
        else:
            low, high = np.maximum(arm.lower, -2.0), np.minimum(arm.upper, 2.0)
            q = _way((low + high) / 2 + 0.45 * (high - low) * place[:, : arm.n], kind)
        unhurried = float((np.abs(np.diff(q, axis=0)).max(axis=0) / arm.velocity).max())
        times = np.asarray(np.arange(len(q)) * max(unhurried / hurry, 1e-4), dtype=np.float64)
        bounds: dict[str, Any] = {
            "velocity": arm.velocity, "acceleration": arm.acceleration, "jerk": float(10 ** rng.uniform(2, 3.5)),
            "lower": arm.lower, "upper": arm.upper,
        }  # fmt: skip
        yield Passed(name, times, q, bounds, smooth_path(times, q, **bounds), arm if upright else None)


def _way(places: Array, kind: str) -> Array:
    """(501, n) a curve through places (8, n), or straight from one to the next, at an even pace."""
    t, s = np.linspace(0.0, 1.0, len(places)), np.linspace(0.0, 1.0, 501)
    if kind == "curve":
        return np.asarray(np.clip(CubicSpline(t, places, bc_type="clamped")(s), places.min(axis=0), places.max(axis=0)))
    return np.column_stack([np.interp(s, t, column) for column in places.T])


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the verdicts; 0 where every one is met."""
    parser = argparse.ArgumentParser(prog="python -m bench.timing", description=__doc__)
    parser.add_argument("--generated", type=int, default=GENERATED)
    parser.add_argument("--shipped", nargs="*", default=list(SHIPPED))
    parser.add_argument("--record", type=Path, help="write the durations there, instead of comparing with them")
    parser.add_argument("--commit", default="", help="named beside them")
    options = parser.parse_args(arguments)
    console = Console(width=132)
    console.print("  ".join(f"{key}: {value}" for key, value in machine().items()), highlight=False)
    groups = {name: list(shipped([name])) for name in options.shipped}
    groups["generated"] = list(generated(options.generated))
    answers = {each.name: judged(each) for group in groups.values() for each in group}
    if options.record:
        seconds = {name: round(each.seconds, 3) for name, each in answers.items()}
        options.record.write_text(json.dumps({"commit": options.commit, "seconds": seconds}, indent=1) + "\n")
        return 0
    before = json.loads(BEFORE.read_text())
    table = Table(title=f"seconds, and those of {before['commit']}")
    for column in ("path", "seconds", "before", "ratio", *DIFFERENCES, "off path"):
        table.add_column(column, justify="left" if column == "path" else "right")
    ratios = {name: each.seconds / before["seconds"].get(name, math.nan) for name, each in answers.items()}
    for name, each in answers.items():
        shares = (f"{x:.3f}" for x in (*each.shares, each.off))
        table.add_row(name, f"{each.seconds:.2f}", f"{each.seconds / ratios[name]:.2f}", f"{ratios[name]:.3f}", *shares)
    console.print(table)
    verdicts: list[Verdict] = []
    for name, group in groups.items():
        those = [answers[each.name] for each in group]
        verdicts += [
            Verdict(
                f"{name}: {what}, as a fraction of its bound", max(each.shares[k] for each in those), "<=", 1 + ROUNDING
            )
            for k, what in enumerate(DIFFERENCES)
        ]
        verdicts += [
            Verdict(f"{name}: off the path, as a fraction of the tolerance", max(e.off for e in those), "<=", 1.0),
            Verdict(f"{name}: beyond the joint limits", max(e.beyond for e in those), "<=", 1e-12, "rad"),
            Verdict(f"{name}: pace, of the recorded one", max(e.paced for e in those), "<=", 1 + ROUNDING),
        ]
        if any(each.arm for each in group):
            tilt = max(each.tilted for each in those)
            verdicts.append(Verdict(f"{name}: handle tilts further than its path", tilt, "<=", TILTED, "rad"))
    print_verdicts(console, verdicts)
    for name, group in groups.items():
        now, then = (sum(values[each.name] for each in group) for values in (
            {key: each.seconds for key, each in answers.items()}, before["seconds"]))  # fmt: skip
        said = f"{name}: {now:.2f} s in all, {then:.2f} s at {before['commit']}; ratio"
        console.print(str(Reported(said, now / then)), highlight=False, soft_wrap=True)
    worst = max(ratios.values())
    console.print(str(Reported("longest of any path, over its duration before", worst)), highlight=False)
    return 0 if all_met(verdicts) else 1


if __name__ == "__main__":
    sys.exit(main())
