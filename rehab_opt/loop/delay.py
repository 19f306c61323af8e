"""Measure the delay of a robot."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.command import Command, Relaxed, Status
from rehab_opt.errors import ConfigurationError, DeviceLostError
from rehab_opt.loop.loop import Loop
from rehab_opt.loop.records import Tick
from rehab_opt.plants.plant import Plant

__all__ = ["measured_delay"]

Array = NDArray[np.float64]

STEPS = (0.25, 1.0, 0.25, 0.0, -0.25, -1.0, -0.25, 0.0)
"""Sequence of commanded speeds, as fractions of the largest speed."""
HELD, RAMP = 0.45, 0.1
"""Duration [s] of each step of the sequence, and of the ramp with which the step begins."""
SETTLED = 0.2
"""Duration [s] at the end of each step over which the lag is averaged."""


def measured_delay(plant: Plant, *, joint: int = 0, speed: float = 0.2, fifo: int | None = None) -> float:
    """Delay [s] from a velocity command until the motion is measured; controllers allow for 0.1 s (`FrontEnd`).

    A joint moves out and back at a quarter of `speed` and at `speed`. At constant speed v, the joint lags by v T plus
    an offset due to dry friction, where T is the delay. The offset is about equal at both speeds. So T is the
    difference of the two lags divided by the difference of the two speeds.

    Parameters
    ----------
    plant : robot at rest that takes joint velocities as commands.
    joint : number, from 0, of the joint to move; it moves by 0.8 s times `speed`.
    speed : largest speed [rad/s, m/s]; below 0.05, encoder noise disturbs the result. fifo : as for `Loop`.

    Raises
    ------
    ConfigurationError : a number is out of range. DeviceLostError : the robot is lost or did not move.
    """
    n = plant.measured.position.size
    if not (isinstance(joint, int) and 0 <= joint < n):
        raise ConfigurationError("joint", joint, f"a whole number from 0 to {n - 1}")
    if not 0.0 < speed <= 1.0:
        raise ConfigurationError("speed", speed, "rad/s or m/s above 0, at most 1")
    # Per tick: time on the plant's clock (a simulation's clock stops in missed ticks), position, commanded speed.
    seen: list[tuple[float, float, float]] = []
    begun: list[float] = []  # time of the first tick, which a busy machine may delay

    def since() -> float:
        return plant.truth.time - begun[0]

    def move(tick: Tick) -> Command:
        if not begun:
            begun.append(plant.truth.time)
        command, now = np.zeros(n), since()
        if tick.enabled:
            command[joint] = speed * _fraction(now)
        seen.append((now, float(tick.seen.position[joint]), float(command[joint])))
        status = Status.OK if tick.enabled else Status.HOLDING
        return Command(command, status, "", 0.0, 0, "", Relaxed.NOTHING, 1.0)

    over = len(STEPS) * HELD
    report = Loop(plant, move, fifo=fifo).run(until=lambda: since() >= over)
    if report.lost:
        raise DeviceLostError(report.reason)
    times, positions, speeds = np.array(seen).T
    led = np.concatenate([[0.0], np.cumsum(speeds[:-1] * np.diff(times))])
    behind = led - (positions - positions[0])
    if not np.ptp(positions) > 0.5 * np.ptp(led):
        raise DeviceLostError(f"joint {joint} moved by {np.ptp(positions):.3g}, not by {np.ptp(led):.3g}")
    held = [_settled(times, behind, i) for i in range(len(STEPS))]
    faster = [(i, speed * (STEPS[i + 1] - STEPS[i])) for i in (0, 1, 4, 5)]
    return float(np.mean([(held[i + 1] - held[i]) / change for i, change in faster]))


def _fraction(time: float) -> float:
    """Commanded fraction of the largest speed at a time [s] since the beginning."""
    i = int(time / HELD)
    if i >= len(STEPS):
        return 0.0
    before = STEPS[i - 1] if i else 0.0
    return before + (STEPS[i] - before) * min((time - i * HELD) / RAMP, 1.0)


def _settled(times: Array, behind: Array, i: int) -> float:
    end = (i + 1) * HELD
    found = behind[(times > end - SETTLED) & (times <= end)]
    if not found.size:
        raise DeviceLostError(f"no tick between {end - SETTLED:.2f} and {end:.2f} s: the loop is too late to measure")
    return float(found.mean())
