"""Ruckig's time-optimal profiles, accepted only inside the position bounds, and checked in every tick."""

from __future__ import annotations

import math

import numpy as np

from rehab_opt.control.axis_motion import AxisBounds, AxisStop, planned_range, stopping_distance

__all__ = ["CERTIFIED", "Profiles"]

Motion = tuple[list[float], list[float], list[float]]  # position, velocity, acceleration of the axes
Frame = tuple[list[float], list[float]]  # origin [u] at the start of a plan, and speed [u/s]

CERTIFIED = 1e-6
"""Largest accepted certificate residual."""
EDGE = 1e-12  # [u] rounding beyond a bound of a profile that ends on it; the output is clipped
INSIDE = 1.0 - 2.0**-48
"""Factor on the velocity and acceleration passed to Ruckig: exactly at a bound, rounding may hide the profile."""
ROUNDING = 32.0 * float(np.finfo(np.float64).eps)  # of a position, as a fraction of the largest one


class Profiles:
    """Current motion of the axes: state, current profile, and finite differences of the output.

    A profile is accepted only if all of it is inside the position bounds and every axis can stop inside from its end;
    otherwise the current profile continues. Each axis stops on its own, without Ruckig. A position bound is relaxed
    only if `start` set an axis outside it, or too fast to stop before it.

    Parameters
    ----------
    bounds : of the n axes; finite except for positions. dt : tick [s]. straight : see `Smoother`.
    recovery_speed : speed, as a fraction of the velocity bound, of an axis that returns into its position bounds.
    """

    def __init__(self, bounds: AxisBounds, *, dt: float, recovery_speed: float, straight: bool = False) -> None:
        import ruckig  # noqa: PLC0415  (loaded when used)

        n = len(bounds.velocity)
        self.bounds = bounds
        self._dt, self._rate = dt, 1.0 / dt
        self._slow = [recovery_speed * v for v in bounds.velocity]
        self._bounded = any(map(math.isfinite, bounds.lower + bounds.upper))
        self._edges = [
            (low - EDGE * (1.0 + abs(low)), high + EDGE * (1.0 + abs(high)))
            for low, high in zip(bounds.lower, bounds.upper, strict=True)
        ]
        # Intervals in which no axis that reverses at its largest acceleration reaches an edge.
        turns = [0.5 * v * v / a for v, a in zip(bounds.velocity, bounds.acceleration, strict=True)]
        self._amidst = [(low + turn, high - turn) for (low, high), turn in zip(self._edges, turns, strict=True)]
        # The binding raises ValueError for results without a name (a profile of more than 7.6e3 s).
        self._refusals: tuple[type[Exception], ...] = (ruckig.RuckigError, ValueError)
        self._solver = ruckig.Ruckig(n)
        self._plan, self._spare = ruckig.Trajectory(n), ruckig.Trajectory(n)
        self._rest = [0.0] * n
        self._question = ruckig.InputParameter(n)
        # Free axes do not wait for each other. Off the line Ruckig synchronises only the end times.
        self._straight = straight
        self._question.synchronization = ruckig.Synchronization.Phase if straight else ruckig.Synchronization.No
        self._question.max_acceleration, self._question.max_jerk = bounds.acceleration, bounds.jerk
        self._question.target_velocity = self._rest
        self._stops: dict[int, tuple[AxisStop, float]] = {}  # per axis, with `age` at its start; others follow _plan

    # ------------------------------------------------------------------------------------------------- planning
    def start(self, p: list[float], v: list[float]) -> bool:
        """Start at positions p with velocities v and zero acceleration, and plan to stop; return False on overflow."""
        self.p, self.v, self.a = p, v, self._rest
        self._speeds, self._changes = v, self._rest  # finite differences of p, as if v had been constant
        self._size = -1.0
        self._allow_rounding(p)
        self.outside = not self._is_inside()
        self.age = 0.0
        self._frame: Frame | None = None
        self.stop(at_any_price=True)
        return all(math.isfinite(stop.seconds + stop.at(math.inf)[0]) for stop, _ in self._stops.values())

    def move(self, goal: list[float], speed: list[float]) -> bool:
        """Plan to `goal` (n,) [u], the goal's position one tick from now; False if the plan would leave the bounds.

        speed : (n,) [u/s] speed of the goal, below the velocity bounds.
        """
        # Plan in the frame that moves with the goal, with shifted velocity bounds. With Ruckig's own target velocity a
        # profile passes the goal's current position; planned again in every tick, it trails the goal by centimetres.
        speed = self._rest if self.outside else speed
        self._set_velocity_bounds(speed)
        moving = any(speed)
        origin = [x - w * self._dt for x, w in zip(goal, speed, strict=True)] if moving else self._rest
        question = self._question
        question.target_position = self._rest if moving else goal
        frame = (origin, speed) if moving else None
        planned = self._straight and not (moving or self.outside or any(self.v) or any(self.a)) and self._along(goal)
        if not ((planned or self._planned(frame)) and self._stays_inside(frame)):
            return False
        self._allow_rounding(goal)
        self._adopt(frame, goal)
        return True

    def stop(self, *, at_any_price: bool = False) -> None:
        """Stop each axis as fast as its bounds allow, once such a stop stays inside the position bounds.

        Call this in every tick until all axes are `stopping`. With `at_any_price`, all stop at once, inside or not.
        """
        if at_any_price:
            self._stops, self._end = {}, self.age
        for i, (x, v, a) in enumerate(zip(self.p, self.v, self.a, strict=True)):
            if i in self._stops:
                continue
            stop = AxisStop(x, v, a, most=self.bounds.acceleration[i], jerk=self.bounds.jerk[i])
            low, high = self._edges[i]
            if at_any_price or (min(low, x) <= stop.lowest and stop.highest <= max(high, x)):
                self._stops[i] = stop, self.age
        self._standing = False
        ends = [begun + stop.seconds for stop, begun in self._stops.values()]
        self._end = max(ends) if self.stopping else max([self._end, *ends])

    @property
    def stopping(self) -> bool:
        """Whether all axes are stopping or stopped."""
        return len(self._stops) == len(self._rest)

    def leads_out(self, axis: int, position: float, speed: float) -> bool:
        """Whether an axis at `position` can no longer stop inside after one more tick at constant `speed`."""
        low, high, _, acceleration, jerk = (bound[axis] for bound in self.bounds)
        return not low <= position + speed * self._dt + stopping_distance(speed, acceleration, jerk) <= high

    @property
    def arrived(self) -> bool:
        """Whether the current profile has ended."""
        return self.age >= self._end

    # ------------------------------------------------------------------------------------------------ following
    def advance(self) -> float:
        """Advance by one tick; return the certificate residual of the new, always finite state.

        The residual is the largest relative excess of the finite differences of `p` over their bounds. If the residual
        is too large, the axes stop from the last state.
        """
        state = self._sample()
        residual = self._residual(state[0])
        if not residual <= CERTIFIED:
            self.stop(at_any_price=True)
            state = self._sample()
            residual = max(residual, self._residual(state[0]))
            if not all(math.isfinite(number) for numbers in state for number in numbers):
                state = list(self.p), self._rest, self._rest
                self._residual(state[0])
                self._standing, self._frame = True, None
        self.p, self.v, self.a = state
        self._speeds, self._changes = self._candidates
        if self.outside or residual > 0.0:
            self.outside = not self._is_inside()
        return residual

    def _sample(self) -> Motion:
        self.age += self._dt
        if self._standing:
            return list(self.p), self._rest, self._rest
        if self.stopping:
            states = [stop.at(self.age - begun) for _, (stop, begun) in sorted(self._stops.items())]
            p, v, a = (list(numbers) for numbers in zip(*states, strict=True))
        else:
            p, v, a = self._planned_state()
            for i, (stop, begun) in self._stops.items():
                p[i], v[i], a[i] = stop.at(self.age - begun)
        self._standing = self.arrived and (self.stopping or self._frame is None)
        if self._bounded:
            for i, (low, high) in enumerate(zip(self.bounds.lower, self.bounds.upper, strict=True)):
                # Clip rounding at a bound, but not an axis that still returns from outside.
                if not low <= p[i] <= high and (low <= self.p[i] <= high or self._standing):
                    near, far = self._edges[i]
                    p[i] = min(max(p[i], low), high) if near <= p[i] <= far else p[i]
        return p, v, a

    def _planned_state(self) -> Motion:
        p, v, a = self._plan.at_time(self.age)
        if self._frame is not None:
            origin, speed = self._frame
            p = [x + o + w * self.age for x, o, w in zip(p, origin, speed, strict=True)]
            v = [x + w for x, w in zip(v, speed, strict=True)]
        elif self.arrived:  # exactly at the goal, exactly at rest
            snap = ROUNDING * self._size
            p = [y if abs(x - y) <= snap else x for x, y in zip(p, self._goal, strict=True)]
            v, a = list(self._rest), list(self._rest)
        return p, v, a

    def _residual(self, p: list[float]) -> float:
        """Certificate residual of p as the next position; the finite differences of p are stored as candidates."""
        rate, speeds, changes, fine = self._rate, [], [], True
        for i, x in enumerate(p):
            speed = (x - self.p[i]) * rate
            change = (speed - self._speeds[i]) * rate
            jerk = (change - self._changes[i]) * rate
            speeds.append(speed)
            changes.append(change)
            v, a, j, low, high = self._allowed[i]
            if not (-v <= speed <= v and -a <= change <= a and -j <= jerk <= j and low <= x <= high):  # NaN fails
                fine = False
        self._candidates = speeds, changes
        return 0.0 if fine else self._excess(p)

    def _excess(self, p: list[float]) -> float:
        speeds, changes = (np.array(numbers) for numbers in self._candidates)
        differences = np.array([speeds, changes, (changes - self._changes) * self._rate])
        allowed = np.array(self._allowed)[:, :3].T
        bounds = np.array(self.bounds[2:])
        beyond = np.maximum(np.subtract(self.bounds.lower, p), np.subtract(p, self.bounds.upper))
        before = np.maximum(np.subtract(self.bounds.lower, self.p), np.subtract(self.p, self.bounds.upper))
        beyond = np.where(beyond <= np.maximum(before, 0.0), 0.0, beyond)  # outside, but not further out: no excess
        residual = float(np.max([np.max((np.abs(differences) - allowed) / bounds), np.max(beyond), 0.0]))
        return residual if math.isfinite(residual) else math.inf

    # ------------------------------------------------------------------------------------------------- plumbing
    def _set_velocity_bounds(self, frame_speed: list[float]) -> None:
        limit = self.bounds.velocity
        if self.outside:
            ways = zip(self.p, limit, self._slow, self.bounds.lower, self.bounds.upper, strict=True)
            limit = [v if low <= x <= high else slow for x, v, slow, low, high in ways]
        self._question.max_velocity = [v - w for v, w in zip(limit, frame_speed, strict=True)]
        self._question.min_velocity = [-v - w for v, w in zip(limit, frame_speed, strict=True)]

    def _along(self, goal: list[float]) -> bool:
        """Whether Ruckig finds a straight-line profile from rest."""
        question, ways = self._question, [abs(y - x) for x, y in zip(self.p, goal, strict=True)]
        names, bounds = ("max_velocity", "max_acceleration", "max_jerk"), self.bounds[2:]
        for name, bound in zip(names, bounds, strict=True):
            most = min((b / w for b, w in zip(bound, ways, strict=True) if w), default=math.inf)
            setattr(question, name, [min(most * w, b) if w else b for b, w in zip(bound, ways, strict=True)])
        question.min_velocity = [-v for v in question.max_velocity]
        planned = self._planned(None)
        self._set_velocity_bounds(self._rest)
        question.max_acceleration, question.max_jerk = self.bounds.acceleration, self.bounds.jerk
        return planned

    def _planned(self, frame: Frame | None) -> bool:
        """Whether Ruckig finds a profile from the current state; the profile is in `_spare`."""
        question, p, v = self._question, self.p, self.v
        if frame is not None:
            p = [x - o for x, o in zip(p, frame[0], strict=True)]
            v = [x - w for x, w in zip(v, frame[1], strict=True)]
        question.current_position, question.current_velocity = p, [INSIDE * x for x in v]
        question.current_acceleration = [INSIDE * x for x in self.a]
        try:
            self._solver.calculate(question, self._spare)
        except self._refusals:
            return False
        return math.isfinite(self._spare.duration)

    def _stays_inside(self, frame: Frame | None) -> bool:
        """Whether the profile in `_spare` stays inside the position bounds, or goes no further out."""
        if not self._bounded:
            return True
        if frame is None and all(
            low <= extent.min and extent.max <= high
            for extent, (low, high) in zip(self._spare.position_extrema, self._amidst, strict=True)
        ):
            return True
        origin, speed = (self._rest, self._rest) if frame is None else frame
        seconds = self._spare.duration + self._dt
        for i, (extent, start, w) in enumerate(zip(self._spare.position_extrema, origin, speed, strict=True)):
            low, high = self._edges[i]
            if frame is None:
                low, high = min(low, self.p[i]), max(high, self.p[i])
            way = w * seconds  # bounded by the sum of the two motions' ranges
            low, high = low - start - min(way, 0.0), high - start - max(way, 0.0)
            beyond = (self.bounds.velocity[i] + abs(w)) ** 2 / (2.0 * self.bounds.acceleration[i])
            if not (low <= extent.min - beyond and extent.max + beyond <= high):
                first, last = planned_range(self._spare.profiles[0][i], extent)
                if not (low <= first and last <= high):
                    return False
            if w and self.leads_out(i, start + way, w):
                return False
        return True

    def _adopt(self, frame: Frame | None, goal: list[float]) -> None:
        self._plan, self._spare = self._spare, self._plan
        self._frame, self._goal = frame, goal
        self.age, self._end = 0.0, float(self._plan.duration)
        self._stops, self._standing = {}, False

    def _is_inside(self) -> bool:
        return all(low <= x <= high for x, low, high in zip(self.p, self.bounds.lower, self.bounds.upper, strict=True))

    def _allow_rounding(self, positions: list[float]) -> None:
        size = max(map(abs, positions))
        if size <= self._size:
            return
        self._size = size
        noise = [ROUNDING * size * self._rate**order for order in (1, 2, 3)]
        self._allowed: list[tuple[float, ...]] = [
            (*(bound * (1.0 + 1e-9) + extra for bound, extra in zip(axis[2:], noise, strict=True)), axis[0], axis[1])
            for axis in zip(*self.bounds, strict=True)
        ]
