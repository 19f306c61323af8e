"""Stability of a hand on a spring and damper with delay and a slew limit.

The force F = -S x - D v acts on a hand of mass m with its own damping c. v is estimated from positions through two
low-passes with the total lag `velocity_lag`; the force acts after `delay`, with a first-order lag. With s = jw the loop
is

    L(s) = (S + D s / (1 + velocity_lag s / 2)^2) exp(-delay s) / ((1 + lag s) (m s + c) s)

|L| falls with w, so it is 1 at a single w_c. The hand comes to rest if and only if L lags by less than 180 degrees
there (Nyquist). To first order, the damping ratio of the remaining oscillation is half the margin in radians.

A force limited to F with slew limit R follows an oscillation at w with force amplitude A <= F unless A w > R. Otherwise
it lags by up to 90 degrees and drives the oscillation (describing function of a rate limiter: Gelb and Vander Velde,
Multiple-Input Describing Functions, 1968). Limiters only reduce the gain, so a steady oscillation needs |L| >= 1 and w
<= w_c. Hence there is none if

    F w_c <= R                                                                                  (force times frequency)

A spring alone has w_c = sqrt(S / m). D = sqrt(S m) is half of the critical damping and raises w_c by a factor of 1.2.
Larger damping is not better: with a delay, damping itself causes oscillation at a rate of D / m.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator
from typing import NamedTuple

__all__ = ["Crossover", "crossover", "fitting_damping", "fitting_slew", "settling_notes"]

LIGHT, HEAVY = 1.5, 4.0
"""[kg] Effective mass of an arm at the hand, across its long axis and along it."""
OWN_DAMPING = 4.0
"""[N s/m] Least own damping of a relaxed arm."""
MARGIN = 0.1
"""[rad] Least phase margin; below it an oscillation loses less than a quarter of its amplitude in each period."""


class Crossover(NamedTuple):
    """Frequency at which a loop has gain 1, and the phase margin there."""

    frequency: float
    """[rad/s]"""
    margin: float
    """[rad] phase margin; if it is negative, the oscillation grows."""


def fitting_damping(stiffness: float) -> float:
    """D [N s/m] for a spring S [N/m] and a hand of unknown mass: sqrt(S m) with the mean mass m."""
    return math.sqrt(stiffness * math.sqrt(LIGHT * HEAVY))


def crossover(
    stiffness: float, damping: float, *, mass: float, delay: float, lag: float, velocity_lag: float
) -> Crossover:
    """Crossover frequency and phase margin of the module's loop, for S [N/m], D [N s/m], mass [kg] and times [s]."""

    def spring(w: float) -> complex:
        return stiffness + damping * 1j * w / (1.0 + 0.5 * velocity_lag * 1j * w) ** 2

    def amplifies(w: float) -> bool:
        return abs(spring(w)) > w * math.hypot(mass * w, OWN_DAMPING) * math.hypot(1.0, lag * w)

    low, high = 0.0, 1.0
    while amplifies(high):
        low, high = high, 2.0 * high
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if amplifies(middle) else (low, middle)
    lead = cmath.phase(spring(high)) + math.atan2(OWN_DAMPING, mass * high)
    return Crossover(high, lead - high * delay - math.atan(lag * high))


def fitting_slew(stiffness: float, damping: float, *, force_limit: float, velocity_lag: float) -> float:
    """Least slew limit R [N/s] that causes no oscillation, F w_c for the lightest hand; see the module."""
    fastest = crossover(stiffness, damping, mass=LIGHT, delay=0.0, lag=0.0, velocity_lag=velocity_lag)
    return force_limit * fastest.frequency


def settling_notes(
    stiffness: float,
    damping: float,
    *,
    force_limit: float,
    slew_limit: float,
    delay: float,
    lag: float,
    velocity_lag: float,
) -> Iterator[str]:
    """Notes on parameters with which the hand can oscillate; each names a better value.

    Parameters
    ----------
    stiffness, damping : S [N/m], D [N s/m]. force_limit, slew_limit : F [N], R [N/s].
    delay : [s], ticks included. lag, velocity_lag : [s]
    """
    times = {"delay": delay, "lag": lag, "velocity_lag": velocity_lag}
    margins = {mass: crossover(stiffness, damping, mass=mass, **times).margin for mass in (LIGHT, HEAVY)}
    mass = min(margins, key=margins.__getitem__)
    if not margins[mass] >= MARGIN:
        swings = "oscillates with growing amplitude" if margins[mass] < 0 else "oscillates for a long time"
        yield (
            f"a hand of {mass:g} kg {swings}: a stiffness of {stiffness:g} N/m with a damping of {damping:.3g} N s/m, "
            f"{1e3 * (delay + lag):.3g} ms late, leaves a phase margin of {math.degrees(margins[mass]):.0f} degrees; "
            f"{_better(stiffness, **times)}"
        )
    needed = fitting_slew(stiffness, damping, force_limit=force_limit, velocity_lag=velocity_lag)
    if not slew_limit >= (1 - 1e-9) * needed:
        yield (
            f"slew_limit = {slew_limit:g} N/s lets a force of {force_limit:g} N come late, which can swing the hand: a "
            f"stiffness of {stiffness:g} N/m with a damping of {damping:.3g} N s/m asks for {needed:.0f} N/s"
        )


def _better(stiffness: float, **times: float) -> str:
    """Advice as text: a sufficient damping or, if there is none, the largest stiffness that comes to rest."""

    def margin(of: float) -> float:
        return min(crossover(of, fitting_damping(of), mass=mass, **times).margin for mass in (LIGHT, HEAVY))

    if margin(stiffness) >= MARGIN:
        return f"a damping of {fitting_damping(stiffness):.3g} N s/m does"
    low, high = 0.0, stiffness
    for _ in range(30):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if margin(middle) >= MARGIN else (low, middle)
    low = math.floor(0.1 * low) * 10.0
    return f"at most {low:g} N/m come to rest behind this delay, with a damping of {fitting_damping(low):.3g} N s/m"
