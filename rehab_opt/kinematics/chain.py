"""Serial chains from Denavit-Hartenberg rows or robot files: pose, Jacobian, manipulability, and their expressions."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, wraps
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, TypeVar

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.body import Body
from rehab_opt.kinematics.denavit_hartenberg import FASTEST, SIX_TURNS, TWO_TURNS, checked_rows
from rehab_opt.kinematics.link import ChainRow, pose_after, pose_before, product
from rehab_opt.kinematics.link_capsules import CapsuleOnLink, LinkCapsule, checked_capsules
from rehab_opt.kinematics.real_array import checked_array
from rehab_opt.kinematics.rigid import nearest_rigid
from rehab_opt.kinematics.robot_file.links import MJCF, URDF, Given, chain_arguments
from rehab_opt.symbolic.matrices import determinant
from rehab_opt.symbolic.shared import HasEvaluator, PerThread

__all__ = ["SerialChain", "per_joint"]

Array = NDArray[np.float64]
Expression = TypeVar("Expression", bound=Callable[..., Any])
LONG_TOOL, FAR_BASE, LONG_ROW, LONGEST = 2.0, 10.0, 20.0, 1e6
"""Largest accepted lengths. A tool or capsule: `LONG_TOOL` times the arm's length, or times 1 m if that is more. The
distance of the base: `FAR_BASE` times the limit of the tool. One row: `LONG_ROW` [m]. `LONGEST` [m] bounds the sum of
all lengths; prismatic joints without limits reach it."""
MAX_WRITTEN = 64
"""Largest number of cached expressions."""
_written: PerThread[dict[tuple[Any, ...], ca.Function]] = PerThread(dict)


def _written_once(expression: Expression) -> Expression:
    """Decorator that caches an expression of the joint values; chains with equal rows, base and tool share it.

    Without the cache, building these expressions takes half of the time of creating a controller. Each thread has its
    own cache, because CasADi counts references to expressions without a lock. Subclasses, and arguments other than a
    column of n symbols, do not use the cache.
    """

    @wraps(expression)
    def copied(chain: SerialChain, q: ca.SX, rows: Sequence[ChainRow] | None = None) -> Any:
        if rows is not None:
            return expression(chain, q, rows)
        if type(chain) is not SerialChain or not isinstance(q, ca.SX) or q.shape != (chain.n, 1):
            return expression(chain, q)
        known, key = _written.mine, (expression, chain.rows, chain.base.tobytes(), chain.tool.tobytes())
        if key not in known:
            if len(known) == MAX_WRITTEN:
                known.clear()
            symbol = ca.SX.sym("q", chain.n)
            found = expression(chain, symbol)
            known[key] = ca.Function("written", [symbol], found if isinstance(found, list) else [found])
        copies = known[key].call([q])
        return copies if len(copies) > 1 else copies[0]

    return copied  # type: ignore[return-value]


@dataclass(frozen=True, eq=False)
class SerialChain(HasEvaluator):
    """A chain of n revolute or prismatic joints with its limits; immutable, any thread may use it.

    Parameters
    ----------
    rows : n Denavit-Hartenberg rows or `Link`s, base to tip.
    lower, upper : (n,) joint position limits [rad or m]; may be infinite; equal limits lock the joint. Finite limits of
        a revolute joint must be within two turns, since 170 would be degrees.
    velocity : (n,) largest joint speeds [rad/s or m/s], positive, at most `SIX_TURNS` or `FASTEST`; a scalar applies to
        all joints.
    acceleration : (n,) largest joint accelerations [rad/s^2 or m/s^2], positive; infinite for no limit.
    names : (n,) joint names.
    base, tool : (4, 4) pose of row 1's frame in the base frame, and of the tool in the last row's frame.
    capsules : the links' shapes, for clearance to obstacles; none by default.
    bodies : the links' masses, if known, for robots with mass.
    effort : (n,) largest torque or force of each drive [N m or N], infinite if unknown, for robots with mass.
    notes : remarks on the origin of the numbers, such as a rounded rotation.

    Raises
    ------
    ConfigurationError : a limit that is not a number, inverted, or of the wrong size; a pose that is not rigid; an
        invalid capsule.
    """

    rows: tuple[ChainRow, ...]
    lower: Array = field(kw_only=True)
    upper: Array = field(kw_only=True)
    velocity: Array = field(kw_only=True)
    acceleration: Array = field(kw_only=True)
    names: tuple[str, ...] = field(default=(), kw_only=True)
    base: Array = field(default_factory=lambda: np.eye(4), kw_only=True)
    tool: Array = field(default_factory=lambda: np.eye(4), kw_only=True)
    capsules: tuple[LinkCapsule, ...] = field(default=(), kw_only=True)
    bodies: tuple[Body, ...] = field(default=(), kw_only=True)
    effort: Array = field(default_factory=lambda: np.array(math.inf), kw_only=True)
    notes: tuple[str, ...] = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        rows = checked_rows(self.rows)
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
            if not rows[i].prismatic and any(TWO_TURNS < abs(end) < math.inf for end in (lower[i], upper[i])):
                expected = "radians within two turns, or infinite for no limit"
                raise ConfigurationError(f"lower, upper of {names[i]}", (float(lower[i]), float(upper[i])), expected)
        velocity = per_joint("velocity", self.velocity, n)
        if not np.all((velocity > 0) & (velocity < math.inf)):
            raise ConfigurationError("velocity", self.velocity, "positive finite numbers")
        for name, row, speed in zip(names, rows, velocity.tolist(), strict=True):
            most, unit = (FASTEST, "m/s") if row.prismatic else (SIX_TURNS, "rad/s")
            if speed > most:
                raise ConfigurationError(f"velocity of {name}", speed, f"at most {most:.3g}: is it in {unit}?")
        acceleration = per_joint("acceleration", self.acceleration, n)
        if not np.all(acceleration > 0):
            raise ConfigurationError("acceleration", self.acceleration, "positive numbers (infinite for no bound)")
        effort = per_joint("effort", self.effort, n)
        if not np.all(effort > 0):
            raise ConfigurationError("effort", self.effort, "positive numbers (infinite if unknown)")
        base, base_note = nearest_rigid("base", self.base)
        tool, tool_note = nearest_rigid("tool", self.tool)
        capsules, still = checked_capsules(self.capsules, n + 2), np.zeros(n)
        most = LONG_TOOL * max(_lengths(rows, still, still), 1.0)
        sizes = {"tool": (tool[:3, 3], most), "base": (base[:3, 3], FAR_BASE * most)}
        sizes |= {f"rows, {names[i]}": (np.array([row.across, row.along]), LONG_ROW) for i, row in enumerate(rows)}
        sizes |= {
            f"capsules, {each.name}": (np.array([*each.start, *each.end, each.radius]), most) for each in capsules
        }
        for argument, (numbers, longest) in sizes.items():
            if not (size := float(np.linalg.norm(numbers))) <= longest:
                expected = f"at most {longest:.3g} m on this arm: is it in metres?"
                raise ConfigurationError(argument, f"{size:.6g} m long", expected)
        checked = {
            "rows": rows,
            "names": names,
            "lower": lower,
            "upper": upper,
            "velocity": velocity,
            "acceleration": acceleration,
            "base": base,
            "tool": tool,
            "capsules": capsules,
            "bodies": tuple(self.bodies),
            "effort": effort,
            "notes": (*self.notes, *(note for note in (base_note, tool_note) if note)),
        }
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    @classmethod
    def from_urdf(
        cls,
        file: str | Path,
        *,
        base: str | None = None,
        tip: str | None = None,
        acceleration: ArrayLike | Mapping[str, float],
        velocity: ArrayLike | Mapping[str, float] | None = None,
        lower: ArrayLike | Mapping[str, float] | None = None,
        upper: ArrayLike | Mapping[str, float] | None = None,
        locked: Mapping[str, float] = MappingProxyType({}),
        mount: ArrayLike | None = None,
        tool: ArrayLike | None = None,
        capsules: Sequence[CapsuleOnLink] | Literal["collision"] = (),
        effort: ArrayLike | Mapping[str, float] | None = None,
    ) -> SerialChain:
        """The chain between two links of a URDF, with revolute, continuous and prismatic joints.

        Frame i of `frames_expression` has its origin at joint i + 1 and its z axis along that joint's axis; frame n is
        at the tip link, and the last frame at the tool. Angles stay as written: a rounded 3.1416 is not corrected.
        Meshes and soft limits are ignored. The chain's `notes` list what was corrected. Its `bodies` are the masses of
        the links and of devices on them, such as a camera, or a gripper with its joints at zero.

        Parameters
        ----------
        file : the URDF; expand xacro first: `xacro arm.urdf.xacro > arm.urdf`.
        base, tip : first and last link of the chain; default the root and the only leaf.
        acceleration : [rad/s^2 or m/s^2], which a URDF lacks: a scalar, (n,), or values by joint name.
        velocity, lower, upper, effort : replace the file's limits: a scalar, (n,), or values by joint name. Finite
            position limits of a revolute joint must be within two turns, since 170 would be degrees.
        locked : fixed joint values [rad or m] by joint name; locked joints are not joints of the chain. A coupled
            (mimic) joint between base and tip must be locked.
        mount : (4, 4) pose of the base link in the base frame; default the identity.
        tool : (4, 4) pose of the tool in the tip link's frame; default the identity.
        capsules : shapes of links, in the links' frames; of a link without a capsule only the frame's origin is checked
            against keep-outs. "collision" makes capsules around the file's <collision> cylinders, boxes, spheres and
            capsules.

        Raises
        ------
        RobotFileError : the content is invalid, or has meshes for `capsules="collision"`; the error names file, joint,
            key, value and expectation.
        ProblemFileError : the file cannot be read. ConfigurationError : an argument is invalid.
        """
        given = Given(acceleration, velocity, lower, upper, locked, capsules, effort)
        return cls._imported(URDF, file, base, tip, given, mount=mount, tool=tool)

    @classmethod
    def from_mjcf(
        cls,
        file: str | Path,
        *,
        base: str | None = None,
        tip: str | None = None,
        acceleration: ArrayLike | Mapping[str, float],
        velocity: ArrayLike | Mapping[str, float],
        lower: ArrayLike | Mapping[str, float] | None = None,
        upper: ArrayLike | Mapping[str, float] | None = None,
        locked: Mapping[str, float] = MappingProxyType({}),
        mount: ArrayLike | None = None,
        tool: ArrayLike | None = None,
        capsules: Sequence[CapsuleOnLink] = (),
        effort: ArrayLike | Mapping[str, float] | None = None,
    ) -> SerialChain:
        """The chain between two bodies of a MuJoCo model; needs `pip install rehab_opt[mjcf]`.

        Differences from `from_urdf`: `base` is a body (by default the world), and `tip` is a body or site (by default
        the only leaf). `velocity` is required, because MJCF has no speed limits. Joint values are those of MuJoCo and
        include `ref`. By default, `effort` comes from the force ranges of each joint's drives.
        """
        given = Given(acceleration, velocity, lower, upper, locked, capsules, effort)
        return cls._imported(MJCF, file, base, tip, given, mount=mount, tool=tool)

    @classmethod
    def _imported(cls, *what: Any, mount: ArrayLike | None, tool: ArrayLike | None) -> SerialChain:
        arguments = chain_arguments(*what)
        if mount is not None:
            placed, note = nearest_rigid("mount", mount)
            arguments["base"] = placed @ arguments["base"]
            arguments["notes"] += (note,) if note else ()
        return cls(**arguments, tool=np.eye(4) if tool is None else tool)  # type: ignore[arg-type]

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

    @property
    def reach(self) -> float:
        """[m] Upper bound of the tool's distance from the base: the sum of all link lengths at the joint limits."""
        return self.reach_from(0)

    def reach_from(self, joint: int) -> float:
        """[m] Upper bound of the tool's distance from joint `joint`, counted from 0."""
        lengths = _lengths(self.rows[joint:], self.lower[joint:], self.upper[joint:])
        return lengths + float(np.linalg.norm(self.tool[:3, 3]))

    def pose(self, q: ArrayLike) -> Array:
        """(4, 4) pose of the tool in the base frame at joint values q (n,)."""
        return self._evaluate(self.pose_expression, q)

    def jacobian(self, q: ArrayLike) -> Array:
        """(6, n) geometric Jacobian in the base frame at the tool's origin, linear rows first."""
        return self._evaluate(self.jacobian_expression, q).reshape(
            6, self.n
        )  # with one joint, the result would be flat

    def manipulability(self, q: ArrayLike) -> float:
        """Yoshikawa's measure w = sqrt(det(J J^T)); for fewer than six joints, w = sqrt(det(J^T J))."""
        return float(self._evaluate(self.manipulability_expression, q)[0])

    def manipulability_gradient(self, q: ArrayLike) -> Array:
        """(n,) gradient of `manipulability`; zero where w is zero and not differentiable."""
        return self._evaluate(self.manipulability_gradient_expression, q)

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
    @_written_once
    def frames_expression(self, q: ca.SX, rows: Sequence[ChainRow] | None = None) -> list[ca.SX]:
        """List of n + 2 poses (4, 4) in the base frame: the frame of row 1, the frame after each row, and the tool.

        `rows` replace the chain's rows; their lengths may be expressions.
        """
        frames = [ca.SX(ca.DM(self.base))]
        for i, row in enumerate(self.rows if rows is None else rows):
            frames.append(product(frames[-1], pose_after(row, q[i])))
        frames.append(product(frames[-1], ca.SX(ca.DM(self.tool))))
        return frames

    def pose_expression(self, q: ca.SX, rows: Sequence[ChainRow] | None = None) -> ca.SX:
        """(4, 4) expression of `pose`: Eq. (2), Rossa et al.; `rows` as for `frames_expression`."""
        return self.frames_expression(q, rows)[-1]

    @_written_once
    def jacobian_expression(self, q: ca.SX) -> ca.SX:
        """(6, n) expression of `jacobian`."""
        frames = self.frames_expression(q)
        return self.jacobian_about(frames, frames[-1][:3, 3])

    @_written_once
    def manipulability_expression(self, q: ca.SX) -> ca.SX:
        """Scalar expression of `manipulability`."""
        jacobian = self._moves_amid(q)
        if self.n == 6:
            return ca.fabs(determinant(jacobian))
        gram = jacobian @ jacobian.T if self.n > 6 else jacobian.T @ jacobian
        return ca.sqrt(ca.fmax(determinant(gram), 0))

    @_written_once
    def manipulability_gradient_expression(self, q: ca.SX) -> ca.SX:
        """(n,) expression of `manipulability_gradient`."""
        jacobian = self._moves_amid(q)
        if self.n == 6:
            volume = determinant(jacobian)
            return ca.sign(volume) * ca.gradient(volume, q)
        gram = jacobian @ jacobian.T if self.n > 6 else jacobian.T @ jacobian
        square = determinant(gram)
        return ca.if_else(square > 0, ca.gradient(square, q) / (2 * ca.sqrt(square)), ca.SX.zeros(self.n))

    def jacobian_about(self, frames: Sequence[ca.SX], point: ca.SX) -> ca.SX:
        """(6, n) geometric Jacobian of a point (3,) on the last link; `frames` come from `frames_expression`.

        The point and the Jacobian are in the base frame of `frames`.
        """
        columns = []
        for row, frame in zip(self.rows, frames, strict=False):
            axis = frame[:3, 2]
            if row.prismatic:
                columns.append(ca.vertcat(axis, ca.SX.zeros(3)))
            else:
                columns.append(ca.vertcat(ca.cross(axis, point - frame[:3, 3]), axis))
        return ca.horzcat(*columns)

    def _moves_amid(self, q: ca.SX) -> ca.SX:
        """(6, n) geometric Jacobian for `manipulability`; if n >= 6, in the frame of the middle link.

        det(J J^T) is the same in every frame, and the middle frame needs a fifth of the operations. With fewer than six
        joints, det(J^T J) depends on the frame.
        """
        if self.n < 6:
            return self.jacobian_expression(q)
        middle = self.n // 2
        frames = [ca.SX.eye(4)]
        for i in reversed(range(middle)):
            frames.insert(0, product(frames[0], pose_before(self.rows[i], q[i])))
        for i in range(middle, self.n - 1):
            frames.append(product(frames[-1], pose_after(self.rows[i], q[i])))
        return self.jacobian_about(frames, ca.SX.zeros(3))

    # ------------------------------------------------------------------------------------------------ plumbing
    def _evaluate(self, expression: Callable[[ca.SX], ca.SX], q: ArrayLike) -> Array:
        return self._evaluator.of(expression, per_joint("q", q, self.n, finite=False))


def _lengths(rows: Sequence[ChainRow], lower: Array, upper: Array) -> float:
    """[m] sum of all link lengths with prismatic joints extended to their limits; `LONGEST` if the sum is larger."""
    slides = np.where([row.prismatic for row in rows], np.maximum(np.abs(lower), np.abs(upper)), 0.0)
    total = sum(
        math.hypot(row.across, abs(row.along) + slide) for row, slide in zip(rows, slides.tolist(), strict=True)
    )
    return min(total, LONGEST)


def per_joint(argument: str, value: ArrayLike, n: int, *, finite: bool = False) -> Array:
    """`value` as a read-only float array (n,); a scalar applies to all joints."""
    array = np.array(checked_array(argument, value, f"{n} numbers"))
    if array.ndim == 0:
        array = np.full(n, float(array))
    if array.shape != (n,):
        raise ConfigurationError(argument, value, f"an array of shape ({n},)")
    if finite and not np.all(np.isfinite(array)):
        raise ConfigurationError(argument, value, f"{n} finite numbers")
    array.flags.writeable = False
    return array
