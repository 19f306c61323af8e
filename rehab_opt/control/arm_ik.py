"""Inverse kinematics of a limb with joint limits: find the posture of least cost that puts the hand at a target."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.command import Status
from rehab_opt.control.ik_search import POSITION_TOLERANCE, IKSearch, within_reason
from rehab_opt.control.posture import History, PostureCost, Quadratic
from rehab_opt.control.thread_owner import OneThread
from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.kinematics.plausible import checked_posture, farthest
from rehab_opt.kinematics.real_array import checked_array
from rehab_opt.optim.nlp import NLPAnswer
from rehab_opt.optim.nlp_solvers import checked_name
from rehab_opt.symbolic import Compile

__all__ = ["ArmIK", "IKPath", "IKSolution"]


class IKSolution(NamedTuple):
    """One posture with its status and residuals."""

    q: Array
    """(n,) [rad] finite, inside the joint limits."""
    status: Status
    """OK, BACKUP, UNREACHABLE (q is the nearest or the most upright posture) or HOLDING (no answer: the target is not
    finite, or every solver failed).
    """
    position_error: float
    """[m] distance from the hand to the target; infinite if the target is not finite."""
    handle_tilt: float
    """[rad] angle between the handle and the vertical."""
    residual: float
    """Certificate residual of the problem that gave q; infinite without a certificate."""
    solver: str
    """Name of the solver; empty if no solver gave q."""
    iterations: int
    """Iterations of the run that found q; -1 if the solver reports none."""
    reason: str
    """Reason if the status is not OK; empty otherwise."""
    cost: float
    """Posture cost of q; a term whose reference posture does not exist yet is left out."""


@dataclass(frozen=True, eq=False)
class IKPath:
    """Postures along a path of N samples; position errors are in m, handle tilts in rad."""

    q: Array
    """(N, n) [rad]"""
    status: list[Status]
    position_error: Array
    handle_tilt: Array
    residual: Array
    seconds: Array
    """(N,) [s] computing time."""
    reason: list[str]

    @property
    def max_step(self) -> float:
        """[rad] Largest joint change between two samples; large if the arm jumps to another branch of postures."""
        return float(self.steps.max(initial=0.0))

    @property
    def steps(self) -> Array:
        """(N - 1,) [rad] largest joint change from each sample to the next."""
        changes: Array = np.abs(np.diff(self.q, axis=0)).max(axis=1, initial=0.0)
        return changes

    @classmethod
    def of(cls, solutions: list[IKSolution], seconds: list[float], n: int) -> IKPath:
        """Collect the answers of an arm with n joints."""
        return cls(
            q=np.array([each.q for each in solutions]).reshape(-1, n),
            status=[each.status for each in solutions],
            position_error=np.array([each.position_error for each in solutions]),
            handle_tilt=np.array([each.handle_tilt for each in solutions]),
            residual=np.array([each.residual for each in solutions]),
            seconds=np.array(seconds),
            reason=[each.reason for each in solutions],
        )

    @property
    def reached(self) -> float:
        """Fraction of the samples whose posture puts the hand at its target."""
        return float(np.mean([each.certified for each in self.status])) if self.status else 0.0


Array = NDArray[np.float64]

JUMP = 0.3
"""[rad] Joint change between two samples above which other postures are tried."""


class _Question(NamedTuple):
    target: Array
    goal: Array
    """(3,) [m] `target` for the search; one that is very far away is moved closer."""
    quadratic: Quadratic
    start: Array | None


class ArmIK(OneThread):
    """Find the posture of least cost with the hand at a position, the handle upright and every joint inside its limits.

        minimise posture cost(q)  s.t.  p(q) = position,  x_n(q) . z_0 >= cos(handle_tilt),  lower <= q <= upper

    Here p is the hand position, x_n the handle's axis and z_0 the vertical. If the position is unreachable, the result
    is the posture whose hand is nearest to it. q is always finite and inside its limits. Simultaneous use by a second
    thread raises a `SharingError`.

    Parameters
    ----------
    arm : any chain; the handle is the x axis of its last frame. Locked joints do not move.
    handle_tilt : [rad] largest angle between handle and +z0, from 0 to pi; None for no limit. Below 1e-5 the handle is
        aligned exactly, so a workspace that is restricted to upright handles is empty.
    posture_cost : weights of `PostureCost`.
    rest : (n,) [rad] rest posture; None for the arm's own.
    solver, backup : "sqp" (ours, compiled), "sqpmethod", "ipopt", "fatrop".
    tolerance : largest certificate residual.
    starts, nearest_starts : number of start postures if `solve` gets no `start`, and number of start postures of the
        search for the posture nearest to the target.
    table_size : number of postures from which the start postures are picked.
    compile : see `BufferedFunction`.
    """

    def __init__(
        self,
        arm: SerialChain,
        *,
        handle_tilt: float | None = math.radians(2.0),
        posture_cost: Mapping[str, float | Mapping[str, float]] = {"rest": 1.0},
        rest: ArrayLike | None = None,
        solver: str = "sqp",
        backup: str = "ipopt",
        tolerance: float = 1e-9,
        starts: int = 2,
        nearest_starts: int = 32,
        table_size: int = 4096,
        compile: Compile = None,
    ) -> None:
        if not isinstance(arm, SerialChain):
            raise ConfigurationError("arm", arm, "a SerialChain")
        number = (int, float, np.integer, np.floating)
        if handle_tilt is not None and not (isinstance(handle_tilt, number) and 0 <= handle_tilt <= math.pi):
            raise ConfigurationError("handle_tilt", handle_tilt, "an angle from 0 to pi rad, or None")
        for name, value in (("starts", starts), ("nearest_starts", nearest_starts), ("table_size", table_size)):
            if not (isinstance(value, int) and value > 0):
                raise ConfigurationError(name, value, "a positive whole number")
        if not (isinstance(tolerance, number) and 0 < tolerance <= POSITION_TOLERANCE):
            raise ConfigurationError("tolerance", tolerance, f"a number above 0, at most {POSITION_TOLERANCE}")
        checked_name("solver", solver)
        checked_name("backup", backup)
        rest = checked_posture("rest", rest, arm)
        self.cost = PostureCost(arm, posture_cost, rest=rest)
        self._arguments: dict[str, Any] = {
            "handle_tilt": handle_tilt, "posture_cost": dict(posture_cost), "rest": rest, "solver": solver,
            "backup": backup, "tolerance": tolerance, "starts": starts, "nearest_starts": nearest_starts,
            "table_size": table_size, "compile": compile,
        }  # fmt: skip
        self.arm, self.handle_tilt, self._tolerance = arm, handle_tilt, tolerance
        self._search: IKSearch | None = None
        if not arm.locked.all():
            self._search = IKSearch(
                arm, handle_tilt=handle_tilt, manipulability=self.cost.manipulability, rest=self.cost.rest,
                solver=solver, backup=backup, tolerance=tolerance, starts=starts,
                nearest_starts=nearest_starts, table_size=table_size, compile=compile,
            )  # fmt: skip

    def __reduce__(self) -> tuple[Any, ...]:
        return _rebuilt, (self.arm, self._arguments)

    def solve(self, position: ArrayLike, start: ArrayLike | None = None) -> IKSolution:
        """Find a posture for a hand position (3,) [m] in the base frame; a wrong shape raises `ConfigurationError`.

        The search is local and begins at the posture `start` (n,) [rad], which is also the previous posture in the
        cost. Without `start`, the search tries several start postures.
        """
        target = _numbers("position", position, (3,))
        q = None if start is None else self._inside(_numbers("start", start, (self.arm.n,)))
        with self._alone():
            return self._answer(target, History(previous=q, origin=q))[0]

    def follow(self, path: ArrayLike, start: ArrayLike | None = None) -> IKPath:
        """Find postures along hand positions `path` (N, 3) [m] in the base frame.

        Each search begins at the previous posture. `start` (n,) [rad] is the posture before the first sample; without
        it, the first search tries several start postures.
        """
        targets = _numbers("path", path, (-1, 3))
        q = None if start is None else self._inside(_numbers("start", start, (self.arm.n,)))
        history = History(previous=q, origin=q)
        multipliers: Array | float = 0.0
        solutions, seconds = [], []
        with self._alone():
            for target in targets:
                began = time.perf_counter()
                solution, multipliers = self._answer(target, history, multipliers, continuing=True)
                seconds.append(time.perf_counter() - began)
                solutions.append(solution)
                origin = solution.q if history.origin is None else history.origin
                history = History(solution.q, history.previous, origin)
        return IKPath.of(solutions, seconds, self.arm.n)

    @contextmanager
    def _alone(self) -> Iterator[None]:
        self._claim()
        try:
            yield
        finally:
            self._give_away()

    # --------------------------------------------------------------------------------------------------- chain
    def _answer(
        self, target: Array, history: History, multipliers: Array | float = 0.0, *, continuing: bool = False
    ) -> tuple[IKSolution, Array | float]:
        """Run the fallback chain; also return multipliers for the next sample's start."""
        search = self._search
        quadratic = self.cost.quadratic(history)
        start = history.previous
        if not np.isfinite(target).all():
            query = _Question(target, target, quadratic, start)
            return self._at(self._start_of(query), query, Status.HOLDING, "position is not a number"), 0.0
        query = _Question(target, within_reason(target), quadratic, start)
        if search is None:
            return self._immovable(query), 0.0
        near = None if start is None else start[search.free]
        search.pose_posture(query.goal, quadratic)
        if near is not None:
            answer = search.posture_from(near, multipliers)
            if answer.certified and not (continuing and np.abs(answer.x - near).max() > JUMP):
                return self._found(answer, query), answer.multipliers
        if search.min_tilt is not None:
            assert self.handle_tilt is not None
            reason = f"no posture holds the handle within {math.degrees(self.handle_tilt):.3g} deg: most upright one"
            return self._found(search.min_tilt, query, Status.UNREACHABLE, reason), 0.0
        best = search.posture(query.goal, near)
        if best is not None:
            return self._found(best, query), best.multipliers
        return self._second_stage(search, query, near)

    def _second_stage(self, search: IKSearch, query: _Question, near: Array | None) -> tuple[IKSolution, Array | float]:
        """Search for the nearest reachable position, to distinguish an unreachable target from a failed solver."""
        nearest = search.nearest(query.goal, near)
        if nearest is None:
            reason = "no solver kept the handle within its tilt"
            return self._at(self._start_of(query), query, Status.HOLDING, reason), 0.0
        if nearest.report[0] > POSITION_TOLERANCE:
            far = math.dist(query.target, self.arm.base[:3, 3]) > farthest(self.arm)
            note = ", not certified" * (not nearest.certified) + "; is it in metres?" * far
            solution = self._found(nearest, query, Status.UNREACHABLE, "out of reach")
            reason = f"out of reach by {solution.position_error:.3g} m: nearest posture{note}"
            return solution._replace(reason=reason), 0.0
        answer: NLPAnswer | None = search.posture_from(nearest.x)
        if answer is None or not answer.certified:
            answer = search.posture(query.goal, near, patient=True)
        if answer is not None and answer.certified:
            return self._found(answer, query), answer.multipliers
        answer = search.posture_from(nearest.x, backup=True)
        if not answer.certified and np.isfinite(answer.residual):  # fatrop's residual ends at about 1e-8
            answer = search.posture_from(answer.x, answer.multipliers)
        if answer.certified:
            reason = "no certified answer from the primary solver"
            return self._found(answer, query, Status.BACKUP, reason), answer.multipliers
        reason = "hand and handle are in place, but the least cost is not certified"
        return self._found(nearest, query, Status.BACKUP, reason), 0.0

    def _found(self, answer: NLPAnswer, query: _Question, status: Status = Status.OK, reason: str = "") -> IKSolution:
        search = self._search
        assert search is not None
        q = search.still.copy()
        q[search.free] = answer.x
        error, tilt = answer.report.tolist()
        if status is Status.UNREACHABLE:  # the search's goal may differ from the target
            error = self._distance(q, query.target)
        cost = self._cost_of(q, query.quadratic)
        return IKSolution(q, status, error, tilt, answer.residual, answer.solver, answer.iterations, reason, cost)

    def _at(self, q: Array, query: _Question, status: Status, reason: str, residual: float = math.inf) -> IKSolution:
        error = self._distance(q, query.target) if np.isfinite(query.target).all() else math.inf
        cost = self._cost_of(q, query.quadratic)
        return IKSolution(q.copy(), status, error, self._tilt(q), residual, "", 0, reason, cost)

    def _immovable(self, query: _Question) -> IKSolution:
        q = self.arm.lower
        held = self.handle_tilt is None or self._tilt(q) <= self.handle_tilt + self._tolerance
        if held and self._distance(q, query.target) <= POSITION_TOLERANCE:
            return self._at(q, query, Status.OK, "", residual=0.0)
        return self._at(q, query, Status.UNREACHABLE, "every joint is locked")

    def _start_of(self, query: _Question) -> Array:
        return self.cost.rest if query.start is None else query.start

    # ----------------------------------------------------------------------------------------------- quantities
    def _cost_of(self, q: Array, quadratic: Quadratic) -> float:
        weight, centre, constant = quadratic
        away = q - centre
        cost = 0.5 * float(away @ (weight * away)) + constant
        return cost if self._search is None else cost + self._search.manipulability_cost(q[self._search.free])

    def _inside(self, q: Array) -> Array | None:
        """`q` clipped to the joint limits; None if it is not finite."""
        if not np.isfinite(q).all():
            return None
        inside: Array = np.clip(q, self.arm.lower, self.arm.upper)
        return inside

    def _distance(self, q: Array, target: Array) -> float:
        return math.dist(self.arm.pose(q)[:3, 3], target)

    def _tilt(self, q: Array) -> float:
        x, y, z = self.arm.pose(q)[:3, 0]
        return math.atan2(math.hypot(x, y), z)


def _rebuilt(arm: SerialChain, arguments: dict[str, Any]) -> ArmIK:
    return ArmIK(arm, **arguments)


def _numbers(argument: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
    expected = "numbers of shape (" + ", ".join("N" if size < 0 else str(size) for size in shape) + ")"
    array = np.array(checked_array(argument, value, expected))
    if array.ndim != len(shape) or any(size not in (-1, own) for size, own in zip(shape, array.shape, strict=True)):
        raise ConfigurationError(argument, value, expected)
    return array
