"""Serial chains from standard Denavit-Hartenberg rows: pose, Jacobian, manipulability, and the expressions behind."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.symbolic.buffered import BufferedFunction

__all__ = ["DH", "SerialChain"]

Array = NDArray[np.float64]


class DH(NamedTuple):
    """One standard Denavit-Hartenberg row, A = Rz(theta) Tz(d) Tx(a) Rx(alpha): Eq. (1), Rossa et al.

    The joint value is added to `theta` [rad] of a revolute row and to `d` [m] of a prismatic one.
    """

    a: float
    alpha: float
    d: float = 0.0
    theta: float = 0.0
    prismatic: bool = False


@dataclass(frozen=True, eq=False)
class SerialChain:
    """A chain of n revolute or prismatic joints with its limits.

    Parameters
    ----------
    rows : n Denavit-Hartenberg rows, base to tip.
    lower, upper : (n,) joint position limits [rad or m]; may be infinite; equal ones lock the joint.
    velocity : (n,) largest joint speeds [rad/s or m/s], finite and positive. A scalar stands for all.
    acceleration : (n,) largest joint accelerations [rad/s^2 or m/s^2], positive, infinite for none.
    names : (n,) joint names.
    base, tool : (4, 4) pose of row 1's frame in the base frame, and of the tool in the last row's frame.

    Raises
    ------
    ConfigurationError : a limit that is not a number, inverted, or of the wrong size; a pose that is not rigid.
    """

    rows: tuple[DH, ...]
    lower: Array = field(kw_only=True)
    upper: Array = field(kw_only=True)
    velocity: Array = field(kw_only=True)
    acceleration: Array = field(kw_only=True)
    names: tuple[str, ...] = field(default=(), kw_only=True)
    base: Array = field(default_factory=lambda: np.eye(4), kw_only=True)
    tool: Array = field(default_factory=lambda: np.eye(4), kw_only=True)

    def __post_init__(self) -> None:
        """Check and freeze every argument."""
        rows = _checked_rows(self.rows)
        n = len(rows)
        given = self.names if isinstance(self.names, Sequence) else (None,)
        names = tuple(given) or tuple(f"joint_{i + 1}" for i in range(n))
        if not all(isinstance(name, str) for name in names) or len(names) != n or len(set(names)) != n:
            raise ConfigurationError("names", self.names, f"{n} different names")
        lower, upper = per_joint("lower", self.lower, n), per_joint("upper", self.upper, n)
        for i in range(n):
            if not (lower[i] <= upper[i] and lower[i] < math.inf and upper[i] > -math.inf):
                raise ConfigurationError(
                    f"lower, upper of {names[i]}", (float(lower[i]), float(upper[i])), "lower <= upper, neither NaN"
                )
        velocity = per_joint("velocity", self.velocity, n)
        if not np.all((velocity > 0) & (velocity < math.inf)):
            raise ConfigurationError("velocity", self.velocity, "positive finite numbers")
        acceleration = per_joint("acceleration", self.acceleration, n)
        if not np.all(acceleration > 0):
            raise ConfigurationError("acceleration", self.acceleration, "positive numbers (infinite for no bound)")
        checked = {
            "rows": rows,
            "names": names,
            "lower": lower,
            "upper": upper,
            "velocity": velocity,
            "acceleration": acceleration,
            "base": rigid("base", self.base),
            "tool": rigid("tool", self.tool),
        }
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    # ------------------------------------------------------------------------------------------------ numbers
    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.rows)

    @cached_property
    def locked(self) -> NDArray[np.bool_]:
        """(n,) True where the joint's range has zero width."""
        mask = np.array(self.lower == self.upper)
        mask.flags.writeable = False
        return mask

    def pose(self, q: ArrayLike) -> Array:
        """(4, 4) pose of the tool in the base frame at joint values q (n,)."""
        return self._evaluate("pose", q)

    def jacobian(self, q: ArrayLike) -> Array:
        """(6, n) geometric Jacobian in the base frame at the tool's origin, linear rows first."""
        return self._evaluate("jacobian", q).reshape(6, self.n)  # one joint gives a column, which would come flat

    def manipulability(self, q: ArrayLike) -> float:
        """Yoshikawa's measure w = sqrt(det(J J')), and sqrt(det(J' J)) below six joints."""
        return float(self._evaluate("manipulability", q)[0])

    def manipulability_gradient(self, q: ArrayLike) -> Array:
        """(n,) gradient of `manipulability`; zero where w is zero and not differentiable."""
        return self._evaluate("manipulability_gradient", q)

    def with_limits(
        self,
        *,
        lower: ArrayLike | None = None,
        upper: ArrayLike | None = None,
        velocity: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
    ) -> SerialChain:
        """The same chain with other limits."""
        given = {"lower": lower, "upper": upper, "velocity": velocity, "acceleration": acceleration}
        return replace(self, **{name: value for name, value in given.items() if value is not None})  # type: ignore[arg-type]

    # -------------------------------------------------------------------------------------------- expressions
    def frames_expression(self, q: ca.SX, rows: Sequence[DH] | None = None) -> list[ca.SX]:
        """N + 2 poses (4, 4) in the base frame: before joint 1, after each row, and the tool.

        `rows` take the place of the chain's own; their a and d may be expressions, so that code serves any lengths.
        """
        frames = [ca.SX(ca.DM(self.base))]
        for i, row in enumerate(self.rows if rows is None else rows):
            frames.append(_times(frames[-1], _row_expression(row, q[i])))
        frames.append(_times(frames[-1], ca.SX(ca.DM(self.tool))))
        return frames

    def pose_expression(self, q: ca.SX, rows: Sequence[DH] | None = None) -> ca.SX:
        """(4, 4) expression of `pose`: Eq. (2), Rossa et al.; `rows` as for `frames_expression`."""
        return self.frames_expression(q, rows)[-1]

    def jacobian_expression(self, q: ca.SX) -> ca.SX:
        """(6, n) expression of `jacobian`."""
        frames = self.frames_expression(q)
        tip = frames[-1][:3, 3]
        columns = []
        for row, frame in zip(self.rows, frames, strict=False):
            axis = frame[:3, 2]
            if row.prismatic:
                columns.append(ca.vertcat(axis, ca.SX.zeros(3)))
            else:
                columns.append(ca.vertcat(ca.cross(axis, tip - frame[:3, 3]), axis))
        return ca.horzcat(*columns)

    def manipulability_expression(self, q: ca.SX) -> ca.SX:
        """Scalar expression of `manipulability`."""
        jacobian = self.jacobian_expression(q)
        if self.n == 6:
            return ca.fabs(determinant(jacobian))
        gram = jacobian @ jacobian.T if self.n > 6 else jacobian.T @ jacobian
        return ca.sqrt(ca.fmax(determinant(gram), 0))

    def manipulability_gradient_expression(self, q: ca.SX) -> ca.SX:
        """(n,) expression of `manipulability_gradient`."""
        jacobian = self.jacobian_expression(q)
        if self.n == 6:
            volume = determinant(jacobian)
            return ca.sign(volume) * ca.gradient(volume, q)
        gram = jacobian @ jacobian.T if self.n > 6 else jacobian.T @ jacobian
        square = determinant(gram)
        return ca.if_else(square > 0, ca.gradient(square, q) / (2 * ca.sqrt(square)), ca.SX.zeros(self.n))

    # ------------------------------------------------------------------------------------------------ plumbing
    def _evaluate(self, name: str, q: ArrayLike) -> Array:
        functions = self._functions.__dict__
        if name not in functions:
            symbol = ca.SX.sym("q", self.n)
            expression = getattr(self, f"{name}_expression")(symbol)
            functions[name] = BufferedFunction(ca.Function(name, [symbol], [ca.densify(expression)], {"cse": True}))
        return functions[name].of(per_joint("q", q, self.n, finite=False))  # type: ignore[no-any-return]

    @cached_property
    def _functions(self) -> threading.local:
        return threading.local()  # a buffer belongs to one thread

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_functions"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        for value in state.values():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False  # pickle forgets it
        self.__dict__.update(state)


def _checked_rows(rows: object) -> tuple[DH, ...]:
    if not isinstance(rows, Sequence) or not rows:
        raise ConfigurationError("rows", rows, "at least one Denavit-Hartenberg row")
    checked = []
    for i, row in enumerate(rows):
        try:
            dh = DH(*row)
            usable = all(math.isfinite(number) for number in dh[:4])
        except (TypeError, ValueError, OverflowError):
            usable = False
        if not usable:
            raise ConfigurationError(
                f"rows[{i}]", row, "finite numbers a, alpha, d, theta, and whether it is prismatic"
            )
        checked.append(dh)
    return tuple(checked)


def per_joint(argument: str, value: ArrayLike, n: int, *, finite: bool = False) -> Array:
    """`value` as a read-only float array (n,); a scalar stands for every joint."""
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as problem:
        raise ConfigurationError(argument, value, f"{n} numbers") from problem
    if array.ndim == 0:
        array = np.full(n, float(array))
    if array.shape != (n,):
        raise ConfigurationError(argument, value, f"an array of shape ({n},)")
    if finite and not np.all(np.isfinite(array)):
        raise ConfigurationError(argument, value, f"{n} finite numbers")
    array.flags.writeable = False
    return array


def rigid(argument: str, value: ArrayLike) -> Array:
    """`value` as a read-only rigid transform (4, 4)."""
    expected = "a (4, 4) rigid transform"
    try:
        pose = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as problem:
        raise ConfigurationError(argument, value, expected) from problem
    if pose.shape != (4, 4) or not np.all(np.isfinite(pose)):
        raise ConfigurationError(argument, value, expected)
    rotation = pose[:3, :3]
    orthonormal = np.abs(rotation @ rotation.T - np.eye(3)).max() <= 1e-9
    if not (orthonormal and np.linalg.det(rotation) > 0 and np.array_equal(pose[3], (0, 0, 0, 1))):
        raise ConfigurationError(argument, value, expected)
    pose.flags.writeable = False
    return pose


def determinant(matrix: ca.SX) -> ca.SX:
    """Determinant as an expression with no division, so that its derivatives hold at singular matrices too."""
    columns = [[matrix[i, j] for i in range(matrix.size1())] for j in range(matrix.size2())]
    minors: dict[tuple[int, ...], ca.SX] = {(): ca.SX(1)}
    for column in columns:  # minors of the first k columns, by rows taken: expansion along the newest column
        minors = _extended(minors, column)
    return minors[tuple(range(len(columns)))]


def _extended(minors: dict[tuple[int, ...], ca.SX], column: Sequence[ca.SX]) -> dict[tuple[int, ...], ca.SX]:
    wider: dict[tuple[int, ...], ca.SX] = {}
    for rows, minor in minors.items():
        for i, entry in enumerate(column):
            if i in rows:
                continue
            taken = tuple(sorted((*rows, i)))
            sign = (-1) ** (len(rows) - taken.index(i))
            wider[taken] = wider.get(taken, ca.SX(0)) + sign * entry * minor
    return wider


def _row_expression(row: DH, value: ca.SX) -> ca.SX:
    theta, d = (ca.SX(row.theta), row.d + value) if row.prismatic else (row.theta + value, ca.SX(row.d))
    cos_theta, sin_theta = ca.cos(theta), ca.sin(theta)
    cos_alpha, sin_alpha = _exact(math.cos, row.alpha), _exact(math.sin, row.alpha)
    return ca.blockcat(
        [
            [cos_theta, -sin_theta * cos_alpha, sin_theta * sin_alpha, row.a * cos_theta],
            [sin_theta, cos_theta * cos_alpha, -cos_theta * sin_alpha, row.a * sin_theta],
            [0, sin_alpha, cos_alpha, d],
            [0, 0, 0, 1],
        ]
    )


def _exact(function: Callable[[float], float], angle: float) -> float:
    """Sine or cosine with the rounding of multiples of a right angle removed: 1e-17 is zero, and drops out."""
    value = function(angle)
    return float(round(value)) if abs(value - round(value)) < 1e-15 else value


def _times(left: ca.SX, right: ca.SX) -> ca.SX:
    """Product of two poses; zeros and ones vanish from the expression."""
    return ca.sparsify(left) @ ca.sparsify(right)
