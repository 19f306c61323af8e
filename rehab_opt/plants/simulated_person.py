"""A simulated person who moves a hand, and a plant in which this person holds the handle of a planar robot."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.plants.hand_robot import MakesRobots
from rehab_opt.plants.intention import Aims
from rehab_opt.plants.plant import Measurement, Truth
from rehab_opt.workspace.region import Workspace

__all__ = ["FASTEST_LINE", "Person", "PersonAtRobot", "SimulatedPerson"]

Array = NDArray[np.float64]


TREMOR_LINES = 3
FASTEST_LINE = 1.15
"""Largest ratio of a tremor component's frequency to the centre frequency; the smallest ratio is 0.85."""


@dataclass(frozen=True)
class Person:
    """Parameters of a person's hand. Every default is an assumption; none comes from the paper's participant.

    The force on the handle is

        sat(K (x_i + wander - x) + B (v_i - v) + effort, strength(x)) - passive(x, v) + tremor + spasms

    with the hand's position x and velocity v, the intended position x_i and velocity v_i, and an effort that grows
    while the hand lags behind. Outside the comfortable workspace W_c the strength falls to `weak_strength`, and the
    arm's passive stiffness pulls the hand towards the nearest point of W_c.

    Parameters
    ----------
    hand_mass : effective mass of hand and arm at the handle [kg].
    stiffness, damping : stiffness K [N/m] and damping B [N s/m] of the voluntary motion.
    persistence : growth of the effort per second [1/s], as a fraction of K * remaining distance.
    strength, weak_strength : largest voluntary force [N] inside W_c, and far outside W_c.
    fades_over : distance [m] outside W_c over which the strength falls.
    passive_stiffness, passive_damping : passive stiffness [N/m] outside W_c, and passive damping [N s/m] everywhere.
    wander, wander_time : error of the intended position: standard deviation of each coordinate [m], and the time T [s]
        in its autocorrelation (1 + t / T) exp(-t / T).
    tremor, tremor_hz : tremor force: root mean square of its length [N], and its centre frequency [Hz].
    spasm_rate, spasm_force, spasm_time : involuntary bursts of force in random directions: rate [1/s], mean peak [N],
        mean duration [s].
    aims, ahead : "clock" or "path", as explained at `AIMS`; for "path", largest lead [m] of the intended position.
    """

    hand_mass: float = 1.2
    stiffness: float = 200.0
    damping: float = 20.0
    persistence: float = 0.6
    strength: float = 25.0
    weak_strength: float = 3.0
    fades_over: float = 0.02
    passive_stiffness: float = 120.0
    passive_damping: float = 8.0
    wander: float = 0.006
    wander_time: float = 0.5
    tremor: float = 0.3
    tremor_hz: float = 6.0
    spasm_rate: float = 0.15
    spasm_force: float = 5.0
    spasm_time: float = 0.3
    aims: Aims = "clock"
    ahead: float = 0.01


class SimulatedPerson:
    """A person in one trial; wander, tremor and spasms depend only on the seed.

    Parameters
    ----------
    person : parameters of the person. comfortable : comfortable workspace W_c in the robot's frame.
    dt : duration of a tick [s]. ticks : largest number of ticks. seed : seed of wander, tremor and spasms.
    """

    def __init__(
        self, person: Person, comfortable: Workspace, *, dt: float, ticks: int, seed: int | tuple[int, ...]
    ) -> None:
        self.person = person
        self._where = comfortable.signed_distance_and_closest_point
        self._dt = dt
        rng = np.random.default_rng(seed)
        self._wander: list[list[float]] = _wander(person, ticks, dt, rng).tolist()
        self._involuntary: list[list[float]] = (
            _tremor(person, ticks, dt, rng) + _spasms(person, ticks, dt, rng)
        ).tolist()
        self._effort_x = self._effort_y = 0.0
        self._tick = 0
        self.beyond = -math.inf

    def force(  # noqa: PLR0917  (a hot call: state, then intention)
        self, x: float, y: float, vx: float, vy: float, to_x: float, to_y: float, to_vx: float, to_vy: float
    ) -> tuple[float, float]:
        """Force (x, y) [N] on the handle, from the hand's actual and intended positions [m] and velocities [m/s].

        The method sets `beyond`, the signed distance [m] of the hand to the comfortable workspace, negative inside.
        """
        person, tick = self.person, self._tick
        self._tick += 1
        wander_x, wander_y = self._wander[tick]
        pushed_x, pushed_y = self._involuntary[tick]
        beyond, closest_x, closest_y = self._where((x, y))
        self.beyond = beyond
        spring, damper = person.stiffness, person.damping
        off_x, off_y = to_x + wander_x - x, to_y + wander_y - y
        effort_x, effort_y = self._effort_x, self._effort_y
        will_x = spring * off_x + damper * (to_vx - vx) + effort_x
        will_y = spring * off_y + damper * (to_vy - vy) + effort_y
        most = person.strength
        if beyond > 0.0:
            left = 1.0 - beyond / person.fades_over
            most = person.weak_strength + ((most - person.weak_strength) * left if left > 0.0 else 0.0)
            pushed_x -= person.passive_stiffness * (x - closest_x)
            pushed_y -= person.passive_stiffness * (y - closest_y)
        size = math.hypot(will_x, will_y)
        if size > most:  # at the largest voluntary force the effort stops growing
            will_x *= most / size
            will_y *= most / size
            keep = min(1.0, most / max(math.hypot(effort_x, effort_y), most))
            self._effort_x, self._effort_y = keep * effort_x, keep * effort_y
        else:
            grow = person.persistence * spring * self._dt
            self._effort_x = effort_x + grow * (to_x - x)
            self._effort_y = effort_y + grow * (to_y - y)
        return (
            will_x - person.passive_damping * vx + pushed_x,
            will_y - person.passive_damping * vy + pushed_y,
        )


def _wander(person: Person, ticks: int, dt: float, rng: np.random.Generator) -> Array:
    """Errors (N, 2) [m] of the intended position: white noise through two equal first-order low-pass filters."""
    from scipy.signal import lfilter  # noqa: PLC0415  (loads slowly)

    keep = math.exp(-dt / person.wander_time)
    settle = math.ceil(8 * person.wander_time / dt)  # skips the filters' transient
    noise = rng.standard_normal((ticks + settle, 2))
    walk = lfilter([1 - keep], [1, -2 * keep, keep * keep], noise, axis=0)[settle:]
    # For unit noise, two filters 1 / (1 - k z^-1) in a row give the variance (1 + k^2) / (1 - k^2)^3.
    spread = (1 - keep) * math.sqrt((1 + keep**2) / (1 - keep**2) ** 3)
    return np.asarray(person.wander / spread * walk)


def _tremor(person: Person, ticks: int, dt: float, rng: np.random.Generator) -> Array:
    """Tremor forces (N, 2) [N]: sinusoids near the centre frequency with random phases."""
    time = dt * np.arange(ticks)
    total = np.zeros((ticks, 2))
    for _ in range(TREMOR_LINES):
        hertz = person.tremor_hz * rng.uniform(2.0 - FASTEST_LINE, FASTEST_LINE)
        total += np.sin(2 * math.pi * (hertz * time[:, None] + rng.uniform(0, 1, 2)))
    return total * person.tremor / math.sqrt(TREMOR_LINES)


def _spasms(person: Person, ticks: int, dt: float, rng: np.random.Generator) -> Array:
    """Spasm forces (N, 2) [N]: half sines in random directions at the times of a Poisson process."""
    total = np.zeros((ticks, 2))
    for _ in range(rng.poisson(person.spasm_rate * ticks * dt)):
        start = int(rng.integers(ticks))
        length = max(2, int(person.spasm_time * rng.uniform(0.5, 1.5) / dt))
        size, angle = person.spasm_force * rng.uniform(0.5, 1.5), rng.uniform(0, 2 * math.pi)
        burst = size * np.sin(math.pi * np.arange(length) / length)[: ticks - start]
        total[start : start + len(burst)] += burst[:, None] * np.array([math.cos(angle), math.sin(angle)])
    return total


class PersonAtRobot:
    """A person with a hand on a planar robot; a `Plant` whose commands are forces (2,) [N].

    Attributes
    ----------
    target : intended state (x, y, vx, vy) of the hand [m, m/s]; None for a person who does not move the hand.
    exerted : force (2,) [N] of the person in the last tick.

    Parameters
    ----------
    person, comfortable : as for `SimulatedPerson`. robot : factory of robots. dt : duration of a tick [s].
    seed : seed of wander, tremor, spasms and sensor noise.
    ticks : number of ticks whose random numbers are drawn at once. After these ticks, person and robot restart at rest
        at the current position with the next seed.
    """

    def __init__(
        self, person: Person, comfortable: Workspace, robot: MakesRobots, *, dt: float, seed: int, ticks: int
    ) -> None:
        self.dt, self.person, self._comfortable, self._kind = dt, person, comfortable, robot
        self._first, self._most = seed, ticks
        self.target: tuple[float, float, float, float] | None = None
        self.exerted = (0.0, 0.0)
        self._time = 0.0
        self.reset((0.0, 0.0))

    @property
    def measured(self) -> Measurement:
        """Measured position and force of the hand; the velocity is the true one, for tests only."""
        return self._measured

    @property
    def truth(self) -> Truth:
        """True state of the hand."""
        return self._truth

    @property
    def hand(self) -> tuple[float, float, float, float]:
        """True position x, y [m] and velocity vx, vy [m/s] of the hand."""
        robot = self._robot
        return robot.x, robot.y, robot.vx, robot.vy

    def reset(self, position: ArrayLike) -> Measurement:
        """Place the hand at rest at `position` (2,) [m]; reset the time to zero."""
        self._time, self._seed = 0.0, self._first
        x, y = np.asarray(position, dtype=np.float64).tolist()
        self._begin((x, y))
        return self._look()

    def step(self, command: ArrayLike, push: ArrayLike | None = None) -> Measurement:
        """Simulate one tick with the commanded force (2,) [N]; a `push` (2,) [N] is added to the person's force."""
        if self._left == 0:
            self._seed += 1
            self._begin((self._robot.x, self._robot.y))
        self._left -= 1
        robot, (force_x, force_y) = self._robot, np.asarray(command, dtype=np.float64).tolist()
        to = (robot.x, robot.y, 0.0, 0.0) if self.target is None else self.target
        will_x, will_y = self._moods.force(robot.x, robot.y, robot.vx, robot.vy, *to)
        if push is not None:
            more_x, more_y = np.asarray(push, dtype=np.float64)[:2].tolist()
            will_x, will_y = will_x + more_x, will_y + more_y
        robot.step(force_x, force_y, will_x, will_y)
        self.exerted, self._time = (will_x, will_y), self._time + self.dt
        return self._look()

    def _look(self) -> Measurement:
        """Compute the true state and the measurement; a loop reads both in each tick."""
        robot, time = self._robot, self._time
        now = np.array(
            (robot.x, robot.y, robot.vx, robot.vy, robot.measured_x, robot.measured_y, *robot.acting, *robot.seen)
        )
        velocity, force = now[2:4], now[4:6]
        self._truth = Truth(time, now[:2], velocity, now[6:8], force)
        self._measured = Measurement(time, now[8:], velocity, force)
        return self._measured

    def _begin(self, start: tuple[float, float]) -> None:
        self._left = self._most
        self._moods = SimulatedPerson(
            self.person, self._comfortable, dt=self.dt, ticks=self._most, seed=self._seed
        )  # fmt: skip
        self._robot = self._kind.robot(
            hand_mass=self.person.hand_mass, start=start, dt=self.dt, rng=np.random.default_rng((self._seed, 1)),
            ticks=self._most,
        )  # fmt: skip
