"""`smooth_path`: on the path, within the bounds, from rest to rest, no faster than recorded, late only where it must.

Judged by finite differences of the positions, a cubic interpolation of scipy's, and the slopes of that.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import PchipInterpolator

from rehab_opt import smooth_path
from tests.judge.numbering import Runs, judging
from tests.judge.verdict import Verdict

GUARANTEES = ("G03",)
LEAST = {"a path that is too fast": 100_000, "a path within the bounds": 100_000, "waiting": 50_000,
         "at its own pace": 50_000}  # fmt: skip
CI_TICKS = 6_000
SHARE = 0.1
LATE = 0.1
"""[s] of delay that is allowed to a path within the bounds, beside the distance of two control points."""


def one_run(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """One path."""
    axes, dt = int(rng.integers(1, 4)), float(rng.choice([0.005, 0.01]))
    hurried, alike = number % 2 == 1, number % 4 > 1
    velocity, acceleration, jerk = rng.uniform(0.5, 2.0, axes), rng.uniform(2.0, 8.0, axes), rng.uniform(20, 80, axes)
    velocity = np.full(axes, velocity[0]) if alike else velocity
    if hurried:
        times = 3.0 + np.cumsum(rng.uniform(0.1, 1.0, rng.integers(4, 9)))
        points = velocity * np.cumsum(rng.uniform(-1, 1, (len(times), axes)), axis=0)
    else:  # reaches of least jerk, there and back
        fraction = np.linspace(0.0, 1.0, 41)
        reach = fraction**3 * (10 + fraction * (6 * fraction - 15))
        times = 3.0 + rng.uniform(2.0, 4.0) * np.linspace(0.0, 1.0, 81)
        points = (
            velocity * (0.02, 0.3)[number // 4 % 2] * rng.uniform(-1, 1, axes) * np.r_[reach, reach[-2::-1]][:, None]
        )
    if axes > 1 and rng.random() < 0.3:
        points[:, 0] = 0.1  # an axis that stands
    lower, upper = points.min(axis=0), points.max(axis=0)
    bounds = {"velocity": velocity[0] if alike else velocity, "acceleration": acceleration, "jerk": jerk}
    if rng.random() < 0.7:
        narrower = float(rng.choice([0.0, 0.1])) * (upper - lower)
        lower, upper = lower + narrower, upper - narrower
        bounds |= {"lower": lower, "upper": upper}
    tolerance = float(rng.choice([1e-4, 1e-3, 1e-2]))
    verdict.begin(number, f"{axes} axes, {'too fast' if hurried else 'within the bounds'}, dt {dt:g}")
    each = smooth_path(times, points, dt=dt, tolerance=tolerance, **bounds)
    known = PchipInterpolator(times, np.clip(points, lower, upper), axis=0)
    x, ticks = each.positions, len(each.times)
    verdict.ticks += ticks
    rounding = 8 * np.finfo(float).eps * (1 + np.abs(x).max())
    # Every axis stood before the first tick and stands after the last one.
    still = np.vstack([np.repeat(x[:1], 3, axis=0), x, np.repeat(x[-1:], 3, axis=0)])
    for order, bound in ((1, velocity), (2, acceleration), (3, jerk)):
        change = np.abs(np.diff(still, order, axis=0)) / dt**order
        verdict.within(f"difference of order {order} over its bound", change - rounding / dt**order, bound * (1 + 1e-6))
    verdict.within("beyond the limits [u]", np.maximum(x - upper, lower - x), 1e-12)
    verdict.within(
        "times that are not those of the ticks [s]", np.abs(each.times - times[0] - dt * np.arange(ticks)), 1e-9
    )
    ends = np.abs(x[[0, -1]] - np.clip(points[[0, -1]], lower, upper))
    verdict.within("way from the path's ends [u]", ends, 1e-9)
    apart = np.abs(x - known(each.phase))
    verdict.within("away from the path [u]", apart, tolerance * (1 + 1e-9))
    verdict.within("error of the deviation that is told [u]", np.abs(apart.max(axis=0) - each.deviation), 1e-9)
    pace = np.diff(each.phase) / dt
    verdict.within("pace over the recorded one", pace, 1 + 1e-9)
    verdict.within("the path is passed backwards", -pace, 1e-9)
    verdict.within("the path's ends are left out [s]", np.abs(each.phase[[0, -1]] - times[[0, -1]]), 1e-9)
    verdict.within("error of the delay that is told [s]", abs(each.delay - (each.times[-1] - times[-1])), 1e-9)
    # Accelerations and jerks that leave the timing its part of the bounds, and bends that the tolerance leaves alone.
    apart = max(dt, float(np.minimum(2 * acceleration / jerk, np.cbrt(12 * tolerance / jerk)).max()))
    gentle = np.minimum(np.minimum(acceleration, jerk * apart / 2), 6 * tolerance / apart**2)
    fine = np.linspace(times[0], times[-1], 4000)
    speed, change = np.abs(known(fine, 1)), np.abs(known(fine, 2))
    if (speed < 0.9 * velocity).all() and (change < 0.5 * gentle).all():
        verdict.within("delay of a path within the bounds [s]", each.delay, LATE + apart)
        verdict.during("at its own pace", np.ones(ticks, dtype=bool), dt)
    verdict.during("waiting", np.r_[pace < 0.5, False], dt)
    count = np.ones(ticks, dtype=bool)
    verdict.during("a path that is too fast" if hurried else "a path within the bounds", count, dt)


run = judging(__name__, LEAST, Runs(one_run))
