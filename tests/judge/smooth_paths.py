"""`smooth_path`: within the bounds, from rest to rest, and what it says of its lag and deviation is true.

Judged by finite differences of the positions, a cubic interpolation of scipy's, and by trying other lags.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import PchipInterpolator

from rehab_opt import Smoother, smooth_path
from tests.judge.numbering import numbered
from tests.judge.verdict import Promise, Verdict

PROMISES = (
    Promise("rehab_opt/control/smoothing.py", "A recorded or planned path as `Smoother` follows it, from rest to "
            "rest."),
    Promise("rehab_opt/control/smoothing.py", "[s] ticks from the first time of the path, until the last point is "
            "reached."),
    Promise("rehab_opt/control/smoothing.py", "[u] largest distance from where the path was at the same time."),
    Promise("rehab_opt/control/smoothing.py", "also follow the path with its own velocity, and ahead of time by the "
            "lag, and keep what stays closest."),
    Promise("rehab_opt/control/smoothing.py", "interpolated by shape-preserving cubics, which leave no range the "
            "points keep."),
    Promise("rehab_opt/control/smoother.py", "A target further away than this at full speed is a fault, not a target"),
    Promise("rehab_opt/control/smoother.py", "a scalar stands for all."),
    Promise("rehab_opt/control/measured_lag.py", "Delay [s] after which the targets match the positions best: least "
            "squares, each axis counted by its own range."),
)  # fmt: skip
LEAST = {"a path within the bounds": 100_000, "a path that is too fast": 100_000, "compensation velocity": 5000,
         "compensation preview": 5000, "compensation none": 5000}  # fmt: skip
CI_TICKS = 6_000
SHARE = 0.1
EXACT, TURNING = 0.05, 0.1
"""Of the range of a path within the bounds: how near compensation stays to it, and where it turns round 1 mm before a
bound: its speed there may not be taken to go on."""


def run(ticks: int, seed: int, *, only: int | None = None) -> Verdict:
    """Paths of random points, some far too fast."""
    verdict = Verdict("smooth_paths", seed, LEAST)
    for number, rng in numbered(verdict, ticks, only):
        one_run(verdict, number, rng)
    return verdict


def one_run(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """One path, with and without compensation."""
    axes, dt = int(rng.integers(1, 4)), float(rng.choice([0.005, 0.01]))
    hurried, alike = number % 2 == 1, number % 4 > 1
    velocity, acceleration, jerk = rng.uniform(0.5, 2.0, axes), rng.uniform(2.0, 8.0, axes), rng.uniform(20, 80, axes)
    velocity = np.full(axes, velocity[0]) if alike else velocity
    if hurried:
        times = 3.0 + np.cumsum(rng.uniform(0.1, 1.0, rng.integers(4, 9)))
        points = velocity * np.cumsum(rng.uniform(-1, 1, (len(times), axes)), axis=0)
    else:  # reaches of least jerk, there and back
        share = np.linspace(0.0, 1.0, 41)
        reach = share**3 * (10 + share * (6 * share - 15))
        times = 3.0 + rng.uniform(2.0, 4.0) * np.linspace(0.0, 1.0, 81)
        points = 0.2 * velocity * rng.uniform(-1, 1, axes) * np.r_[reach, reach[-2::-1]][:, None]
    if axes > 1 and rng.random() < 0.3:
        points[:, 0] = 0.1  # an axis that stands
    lower, upper = points.min(axis=0) - 1e-3, points.max(axis=0) + 1e-3
    bounds = {"velocity": velocity[0] if alike else velocity, "acceleration": acceleration, "jerk": jerk}
    if rng.random() < 0.7:
        bounds |= {"lower": lower, "upper": upper}
    else:  # where the cubics go, and no further than the path overshoots
        lower, upper = lower - np.ptp(points, axis=0), upper + np.ptp(points, axis=0)
    verdict.begin(number, f"{axes} axes, {'too fast' if hurried else 'within the bounds'}, dt {dt:g}")
    raw = smooth_path(times, points, dt=dt, compensate=False, **bounds)
    path = smooth_path(times, points, dt=dt, **bounds)
    known = PchipInterpolator(times, points, axis=0)
    for each in (raw, path):
        x, ticks = each.positions, len(each.times)
        verdict.ticks += ticks
        rounding = 8 * np.finfo(float).eps * (1 + np.abs(x).max())
        # Every axis stood before the first tick and stands after the last one.
        still = np.vstack([np.repeat(x[:1], 3, axis=0), x, np.repeat(x[-1:], 3, axis=0)])
        for order, bound in ((1, velocity), (2, acceleration), (3, jerk)):
            change = np.abs(np.diff(still, order, axis=0)) / dt**order
            verdict.within(
                f"difference of order {order} over its bound", change - rounding / dt**order, bound * (1 + 1e-6)
            )
        verdict.within("beyond the limits [u]", np.maximum(x - upper, lower - x), 1e-9)
        verdict.within(
            "times that are not those of the ticks [s]", np.abs(each.times - times[0] - dt * np.arange(ticks)), 1e-9
        )
        verdict.within("way from the path's ends [u]", np.abs(x[[0, -1]] - points[[0, -1]]), 1e-9)
        verdict.holds("the end is reached, not awaited", each.times[-1] >= times[-1] - 1e-9)
        wanted = known(np.clip(each.times, times[0], times[-1]))
        apart = np.abs(x - wanted).max(axis=0)
        verdict.within("error of the deviation that is told [u]", np.abs(apart - each.deviation), 1e-9)
        spans = np.ptp(wanted, axis=0)
        moving = spans > 0

        def mismatch(lag: float, x=x, wanted=wanted, each=each, spans=spans, moving=moving) -> float:
            late = np.stack([np.interp(each.times - lag, each.times, column) for column in wanted[:, moving].T], axis=1)
            return float(np.mean(((late - x[:, moving]) / spans[moving]) ** 2))

        reach = 0.25 * float(each.times[-1] - each.times[0])
        best = min(mismatch(lag) for lag in np.linspace(-reach, reach, 201))
        verdict.within("mismatch at the lag that is told over the best", mismatch(each.lag), best * (1 + 1e-3) + 1e-12)
        verdict.within("certificate of all ticks", each.residual, 1e-8)
        verdict.during(f"compensation {each.compensation}", np.ones(ticks, dtype=bool), dt)
    if alike:
        twins = [
            Smoother(velocity=each, acceleration=acceleration, jerk=jerk, dt=dt) for each in (velocity[0], velocity)
        ]
        for each in twins:
            each.reset(points[0])
        one, other = ([each.step(points[-1]).value for _ in range(20)] for each in twins)
        verdict.holds("a scalar bound stands for all axes", np.array_equal(one, other))
        far = 2000.0 * velocity
        for begin, end in ((-far, far), (far, 2 * far), (far, -far)):
            twins[1].reset(begin)
            command = twins[1].step(end)
            refused = command.status.value == "holding" and bool(command.reason)
            verdict.holds(
                "a target of more than 3600 s is none, a nearer one is", refused == (abs(end - begin)[0] > 1.8 * far[0])
            )
    verdict.holds("no compensation unless asked", raw.compensation == "none")
    worse = float(np.max(path.deviation / velocity)) - float(np.max(raw.deviation / velocity))
    verdict.within("compensation makes worse [s]", worse, 1e-9)
    if not hurried:
        close = path.deviation / np.maximum(np.ptp(points, axis=0), 1e-3)
        room = TURNING if "lower" in bounds else EXACT
        verdict.within("deviation over the range of a path within the bounds", close / room, 1.0)
    count = np.ones(len(path.times), dtype=bool)
    verdict.during("a path that is too fast" if hurried else "a path within the bounds", count, dt)
