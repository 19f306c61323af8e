"""Search for a posture: pick several starts, solve from each, return the best answer."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.ik_statements import IKStatements
from rehab_opt.control.posture import Quadratic
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.optim.nlp import NLP, NLPAnswer
from rehab_opt.optim.nlp_solvers import NLPSolver, nlp_solver
from rehab_opt.optim.nlp_sqp import SQP
from rehab_opt.symbolic import Compile
from rehab_opt.workspace.plane_statement import spread_postures

__all__ = ["POSITION_TOLERANCE", "IKSearch", "PostureTable", "within_reason"]

Array = NDArray[np.float64]

POSITION_TOLERANCE = 1e-6
"""[m] A target this near to the reachable set counts as reached."""
CANDIDATES = 32
"""Number of table entries nearest to the target that are ranked by cost."""
DISTANCE_PRICE = 20.0
"""[1/m] Weight of a candidate's distance, relative to its posture cost, in the ranking."""
SHARPNESS = 100.0
"""Factor on the squared distance in the last solve; the tolerance on its gradient then corresponds to micrometres."""
FAR = 1e4
"""[m] Targets further away are moved to this distance, since rounding of squares would hide the arm."""

UNBOUNDED = 1e6
"""[rad or m] Value that replaces an infinite joint limit."""


class IKSearch:
    """Searches over the k movable joints of an arm, k >= 1; parameters as in `ArmIK`."""

    def __init__(
        self,
        arm: SerialChain,
        *,
        handle_tilt: float | None,
        manipulability: float,
        rest: Array,
        solver: str,
        backup: str,
        tolerance: float,
        starts: int,
        nearest_starts: int,
        table_size: int,
        compile: Compile,
    ) -> None:
        self.arm, self.handle_tilt, self.rest = arm, handle_tilt, rest
        self.starts, self.nearest_starts, self.table_size = starts, nearest_starts, table_size
        self._options = {"tolerance": tolerance, "compile": compile}
        self._names = {"primary": solver, "backup": backup}
        self.tolerance = tolerance
        self.statements = IKStatements(arm, handle_tilt=handle_tilt, manipulability=manipulability > 0)
        self.free = self.statements.free
        self.lower = np.maximum(arm.lower[self.free], -UNBOUNDED)
        self.upper = np.minimum(arm.upper[self.free], UNBOUNDED)
        self.still = np.where(arm.locked, arm.lower, 0.0)
        self._fixed = np.concatenate([self.lower, self.upper, self.still, [handle_tilt or 0.0]])
        self._solvers: dict[tuple[str, str], SQP | NLPSolver] = {}
        self._manipulability = manipulability
        k, at = len(self.free), self.statements.fixed_size
        self._posture_parameters = np.concatenate([self._fixed, np.zeros(3 + 2 * k + 1)])
        self._target = self._posture_parameters[at : at + 3]
        self._weight = self._posture_parameters[at + 3 : at + 3 + k]
        self._centre = self._posture_parameters[at + 3 + k : at + 3 + 2 * k]
        self._quadratic: Quadratic | None = None
        self.cost_scale = 1.0

    # ----------------------------------------------------------------------------------------------- statements
    def pose_posture(self, target: Array, quadratic: Quadratic) -> None:
        """Set the posture problem: least cost with the hand at `target` (3,) [m]; `quadratic` covers all n joints."""
        self._target[:] = target
        if quadratic is not self._quadratic:
            weight = quadratic.weight[self.free]
            # Scale the cost to order one, since tolerances are absolute.
            self.cost_scale = 1.0 / (max(weight.max(), self._manipulability) or 1.0)
            self._weight[:] = weight * self.cost_scale
            self._centre[:] = quadratic.centre[self.free]
            self._posture_parameters[-1] = self._dexterity * self.cost_scale
            self._quadratic = quadratic

    def posture_from(self, start: Array, multipliers: Array | float = 0.0, *, backup: bool = False) -> NLPAnswer:
        """Solve the posture problem that was set last, from free joints `start` (k,)."""
        solver = self._solver(self.statements.posture, "backup" if backup else "primary")
        solver.parameters[:] = self._posture_parameters
        return solver.solve(start, multipliers)

    def manipulability_cost(self, x: Array) -> float:
        """Manipulability term of the posture cost at free joints `x` (k,)."""
        return self._dexterity * float(self.statements.square(x, self.still)) if self._manipulability else 0.0

    # ------------------------------------------------------------------------------------------------- searches
    def posture(self, target: Array, near: Array | None = None, *, patient: bool = False) -> NLPAnswer | None:
        """Certified answer of least cost from several starts; with `near` (k,), the answer nearest to that posture.

        If `patient`, the search tries further starts until one succeeds.
        """
        postures, distances = self.table.near(target, CANDIDATES)
        if near is None:
            change = postures - self._centre
            price = 0.5 * (change * change) @ self._weight
        else:
            price = np.abs(postures - near).max(axis=1)
        order = np.argsort(price + DISTANCE_PRICE * distances)
        best, best_price = None, np.inf
        for tried, i in enumerate(order, start=1):
            answer = self.posture_from(postures[i])
            if answer.certified:
                own = answer.cost if near is None else float(np.abs(answer.x - near).max())
                if own < best_price:
                    best, best_price = answer, own
            if tried >= self.starts and (best is not None or not patient):
                break
        return best

    def nearest(self, target: Array, near: Array | None = None) -> NLPAnswer | None:
        """Posture whose hand is nearest to `target`, with the handle in its cone: the best answer from many starts.

        The answer from `near` (k,) is preferred unless another start comes closer by a micrometre. None means that no
        start gave a posture with the handle in its cone.
        """
        plain, sharp = self._nearest_parameters(target), self._nearest_parameters(target, SHARPNESS)
        starts, _ = self.table.near(target, self.nearest_starts)
        best = None if near is None else self._better(None, self._from("primary", plain, near))
        kept = best
        for start in starts:
            if best is not None and best.report[0] <= POSITION_TOLERANCE / 10:
                break
            margin = 1e-6 if best is kept and best is not None else 0.0
            best = self._better(best, self._from("primary", plain, start), margin)
        if best is None or not best.certified:
            for start in starts[:4]:
                best = self._better(best, self._from("primary", sharp, start))
        if best is None or not best.certified:
            start = starts[0] if len(starts) else self.rest[self.free]
            best = self._better(best, self._from("backup", plain, start if best is None else best.x))
        if best is not None and best.report[0] > self.tolerance:
            best = self._better(best, self._from("primary", sharp, best.x, best.multipliers * SHARPNESS))
        return best

    @cached_property
    def table(self) -> PostureTable:
        """Start postures; built by the first search."""
        table = PostureTable(self.arm, self.statements, handle_tilt=self.handle_tilt, size=self.table_size)
        self._min_tilt: NLPAnswer | None = None
        if not table.within:
            answers = [self._upright_from(start) for start in table.most_upright]
            answers = [answer for answer in answers if np.all(np.isfinite(answer.x))]
            limit = (self.handle_tilt or 0.0) + self.tolerance
            upright = [answer for answer in answers if answer.report[1] <= limit]
            if upright:
                postures = np.array([answer.x for answer in upright])
                hands = self.statements.measure.map(len(postures))(
                    postures.T, np.tile(self.still[:, None], len(postures))
                )[0]
                table.extend(postures, hands.full().T)
            else:
                self._min_tilt = min(answers, key=lambda answer: float(answer.report[1]))
        return table

    @property
    def min_tilt(self) -> NLPAnswer | None:
        """Posture with the most upright handle, if no posture holds the handle in its cone; otherwise None."""
        _ = self.table
        return self._min_tilt

    # ------------------------------------------------------------------------------------------------- plumbing
    @cached_property
    def _dexterity(self) -> float:
        """Weight of the squared manipulability, divided by the mean of this square over the range of motion."""
        if not self._manipulability:
            return 0.0
        postures = self.table.postures
        squares = self.statements.square.map(len(postures))(
            postures.T, np.tile(self.still[:, None], len(postures))
        ).full()
        mean = float(squares.mean()) if squares.size else 0.0
        return self._manipulability / mean if mean > 0 else 0.0

    def _solver(self, nlp: NLP, stage: str) -> SQP | NLPSolver:
        key = (nlp.name, stage)
        if key not in self._solvers:
            self._solvers[key] = nlp_solver(nlp, self._names[stage], **self._options)  # type: ignore[arg-type]
        return self._solvers[key]

    def _from(self, stage: str, parameters: Array, start: Array, multipliers: Array | float = 0.0) -> NLPAnswer:
        solver = self._solver(self.statements.nearest, stage)
        solver.parameters[:] = parameters
        return solver.solve(start, multipliers)

    def _upright_from(self, start: Array) -> NLPAnswer:
        solver = self._solver(self.statements.upright, "primary")
        solver.parameters[:] = np.concatenate([self._fixed, np.zeros(3)])
        return solver.solve(start)

    def _nearest_parameters(self, target: Array, sharpness: float = 1.0) -> Array:
        distance = float(np.linalg.norm(target))
        return np.concatenate([self._fixed, target, [sharpness / max(1.0, distance)]])

    def _better(self, best: NLPAnswer | None, other: NLPAnswer, margin: float = 0.0) -> NLPAnswer | None:
        """`other` if its handle is in the cone and its hand is nearer than that of `best` by `margin`; else `best`."""
        if not 0 <= other.violation <= self.tolerance:
            return best
        return other if best is None or other.report[0] < best.report[0] - margin else best


def within_reason(target: Array) -> Array:
    """Finite `target` (3,) [m]; a very distant one is moved along its direction to the distance `FAR`."""
    largest = float(np.abs(target).max())
    if largest <= FAR:
        return target
    direction = target / largest
    moved: Array = direction * (FAR / float(np.linalg.norm(direction)))
    return moved


ALIGNMENT_STEPS = 10
MAX_STEP = 0.5
"""[rad] Largest change of a joint in one alignment step."""
SLACK = math.radians(3.0)
"""[rad] Start postures may exceed the handle's largest tilt by this much."""


class PostureTable:
    """Start postures of searches: they cover an arm's range of motion with an upright handle. Deterministic.

    `size` is the number of samples; a power of two keeps the Sobol sequence balanced.

    Attributes
    ----------
    postures : (N, k) [rad] free joints, inside their limits. hands : (N, 3) [m] hand positions.
    within : whether any sample holds the handle in its cone. most_upright : (<= 32, k) [rad] most upright samples.
    """

    def __init__(self, arm: SerialChain, statements: IKStatements, *, handle_tilt: float | None, size: int) -> None:
        free = statements.free
        lower, upper = arm.lower[free], arm.upper[free]
        postures = spread_postures(arm, free, size)
        still = np.where(arm.locked, arm.lower, 0.0)
        limit = math.pi if handle_tilt is None else handle_tilt
        for _ in range(ALIGNMENT_STEPS):
            hands, axes, slopes = _measured(statements, postures, still)
            tilts = np.arctan2(np.hypot(axes[:, 0], axes[:, 1]), axes[:, 2])
            outside = tilts > limit
            if not outside.any():
                break
            step = _alignment(axes, slopes, limit)
            postures = np.where(outside[:, None], np.clip(postures + step, lower, upper), postures)
        hands, axes, _ = _measured(statements, postures, still)
        tilts = np.arctan2(np.hypot(axes[:, 0], axes[:, 1]), axes[:, 2])
        self.most_upright = postures[np.argsort(tilts)[:32]]
        self.within = bool(np.any(tilts <= limit))
        self._keep(tilts <= limit + SLACK, postures, hands)

    def _keep(self, chosen: NDArray[np.bool_], postures: Array, hands: Array) -> None:
        from scipy.spatial import cKDTree  # noqa: PLC0415

        self.postures, self.hands = postures[chosen], hands[chosen]
        self._tree = cKDTree(self.hands)

    def extend(self, postures: Array, hands: Array) -> None:
        """Add postures (m, k) with their hand positions (m, 3)."""
        postures = np.concatenate([self.postures, postures])
        self._keep(np.ones(len(postures), dtype=bool), postures, np.concatenate([self.hands, hands]))

    def near(self, target: Array, count: int) -> tuple[Array, Array]:
        """At most `count` postures (count, k) whose hands are nearest to `target`, nearest first; distances [m]."""
        count = min(count, len(self.postures))
        if count == 0:
            return self.postures, np.zeros(0)
        distances, indices = self._tree.query(target, count)
        return self.postures[np.atleast_1d(indices)], np.atleast_1d(distances)


def _measured(statements: IKStatements, postures: Array, still: Array) -> tuple[Array, Array, Array]:
    """Hand positions (N, 3), handle axes (N, 3), and derivatives (N, 2, k) of the axes' x and y by the free joints."""
    n, k = postures.shape
    hands, axes, slopes = (each.full() for each in statements.measure.map(n)(postures.T, np.tile(still[:, None], n)))
    return hands.T, axes.T, slopes.reshape(2, n, k).transpose(1, 0, 2)


def _alignment(axes: Array, slopes: Array, limit: float) -> Array:
    """Damped Gauss-Newton step (N, k) that turns the handle's axis into its cone."""
    horizontal = np.hypot(axes[:, 0], axes[:, 1])
    excess = axes[:, :2] * (1 - math.sin(min(limit, math.pi / 2)) * 0.7 / np.maximum(horizontal, 1e-12))[:, None]
    # Upside down, shrinking components would turn the handle away from upright, so they grow instead.
    excess = np.where(axes[:, 2:] < 0, -axes[:, :2] / np.maximum(horizontal, 1e-12)[:, None] * 0.5, excess)
    gram = slopes @ slopes.transpose(0, 2, 1) + 1e-4 * np.eye(2)
    step = -np.einsum("nij,ni->nj", slopes, np.linalg.solve(gram, excess[..., None])[..., 0])
    clipped: Array = np.clip(step, -MAX_STEP, MAX_STEP)
    return clipped
