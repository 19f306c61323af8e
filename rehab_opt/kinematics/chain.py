"""Serial chains from Denavit-Hartenberg rows or robot files: pose, Jacobian, manipulability, expressions behind."""

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
from rehab_opt.kinematics.denavit_hartenberg import TWO_TURNS, checked_rows
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
LONG_TOOL, LONGEST = 2.0, 1e6
"""A tool is no longer than so many arms, or [m]; a chain that slides on and on counts as so long [m]."""
MAX_WRITTEN = 64
"""Expressions that are kept."""
_written: PerThread[dict[tuple[Any, ...], ca.Function]] = PerThread(dict)


def _written_once(expression: Expression) -> Expression:
    """An expression of joint values, written once for all chains of the same rows, base and tool, and then copied.

    Anew at every use it is half the time that making a controller takes. In each thread its own: CasADi counts without
    a lock who refers to an expression. A subclass may write it in another way, and what is no column of a symbol for
    each joint is left to the expression itself.
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
    lower, upper : (n,) joint position limits [rad or m]; may be infinite; equal ones lock the joint. Those of a joint
        that turns are within two turns, or infinite: 170 would be degrees.
    velocity : (n,) largest joint speeds [rad/s or m/s], finite and positive. A scalar stands for all.
    acceleration : (n,) largest joint accelerations [rad/s^2 or m/s^2], positive, infinite for none.
    names : (n,) joint names.
    base, tool : (4, 4) pose of row 1's frame in the base frame, and of the tool in the last row's frame.
    capsules : the links' bodies, for whatever keeps the robot clear of something; none by default.
    bodies : the links' masses, where they are known; nothing here uses them.
    effort : (n,) largest torque or force of each drive [N m or N], infinite where it is not known; nothing here uses
        it.
    notes : what a reader has to know about where the numbers come from; a rotation that was rounded, say.

    Raises
    ------
    ConfigurationError : a limit that is not a number, inverted, or of the wrong size; a pose that is not rigid; a
        capsule that is none.
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
        """Check and freeze every argument."""
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
                expected = "radians within two turns, or infinite ones where there are none"
                raise ConfigurationError(f"lower, upper of {names[i]}", (float(lower[i]), float(upper[i])), expected)
        velocity = per_joint("velocity", self.velocity, n)
        if not np.all((velocity > 0) & (velocity < math.inf)):
            raise ConfigurationError("velocity", self.velocity, "positive finite numbers")
        acceleration = per_joint("acceleration", self.acceleration, n)
        if not np.all(acceleration > 0):
            raise ConfigurationError("acceleration", self.acceleration, "positive numbers (infinite for no bound)")
        effort = per_joint("effort", self.effort, n)
        if not np.all(effort > 0):
            raise ConfigurationError("effort", self.effort, "positive numbers (infinite for none that is known)")
        base, base_note = nearest_rigid("base", self.base)
        tool, tool_note = nearest_rigid("tool", self.tool)
        lengths, size = _lengths(rows, lower, upper), float(np.linalg.norm(tool[:3, 3]))
        if not size <= max(LONG_TOOL * lengths, LONG_TOOL):
            expected = f"a tool of at most {max(LONG_TOOL * lengths, LONG_TOOL):.3g} m on this arm: is it in metres?"
            raise ConfigurationError("tool", f"{size:.6g} m long", expected)
        checked = {
            "rows": rows,
            "names": names,
            "lower": lower,
            "upper": upper,
            "velocity": velocity,
            "acceleration": acceleration,
            "base": base,
            "tool": tool,
            "capsules": checked_capsules(self.capsules, n + 2),
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
        """The chain between two links of a URDF: joints of any axis and origin, revolute, continuous or prismatic.

        Frame i of `frames_expression` has its origin at joint i + 1 and its z axis along it; the last but one is at the
        tip link, the last one at the tool. Angles stay as written: a rounded 3.1416 is not corrected. Meshes and soft
        limits are not read. `notes` lists what was corrected. `bodies` holds the masses of the links and of what is
        fixed to them, such as a camera or a gripper, whose own joints are at zero.

        Parameters
        ----------
        file : the URDF. One in xacro is expanded first: `xacro arm.urdf.xacro > arm.urdf`.
        base, tip : links where the chain begins and ends; default the root, and the only link that bears no other.
        acceleration : [rad/s^2 or m/s^2] which is not read of a URDF: for all joints, for each (n,), or by joint name.
        velocity, lower, upper, effort : in place of the file's; for all joints, for each (n,), or by joint name. A
            joint that turns has its ends within two turns, or infinite ones: 170 would be degrees.
        locked : joint values [rad or m] by the names of joints that are held there, and are no joints of the chain; a
            joint that is coupled to another (mimic) can be on the way so alone.
        mount : (4, 4) pose of the base link in the base frame; default the identity.
        tool : (4, 4) pose of the tool in the tip link's frame; default the identity.
        capsules : bodies of links, in the links' own frames; a link without keeps its frame's origin guarded, no more.
            "collision" for capsules about the file's own <collision>, of cylinders, boxes, balls and capsules.

        Raises
        ------
        RobotFileError : the file cannot be used, or has meshes for `capsules="collision"`; it names file, joint, key,
            value and what was expected.
        ProblemFileError : it cannot be read. ConfigurationError : an argument cannot be used.
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

        As `from_urdf`, but for: `base` is a body, by default the world, and `tip` a body or a site (a gripper's grasp),
        by default the only body that bears no other; `velocity` has to be given, since MJCF has no speed limits; joint
        values are MuJoCo's, `ref` included. `effort` is what the file's force ranges allow the drives of each joint.
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
        """[m] The farthest that the tool can be from the base: all lengths, sliding joints at their limits."""
        return self.reach_from(0)

    def reach_from(self, joint: int) -> float:
        """[m] The same from a joint, counted from 0."""
        lengths = _lengths(self.rows[joint:], self.lower[joint:], self.upper[joint:])
        return lengths + float(np.linalg.norm(self.tool[:3, 3]))

    def pose(self, q: ArrayLike) -> Array:
        """(4, 4) pose of the tool in the base frame at joint values q (n,)."""
        return self._evaluate(self.pose_expression, q)

    def jacobian(self, q: ArrayLike) -> Array:
        """(6, n) geometric Jacobian in the base frame at the tool's origin, linear rows first."""
        return self._evaluate(self.jacobian_expression, q).reshape(
            6, self.n
        )  # one joint gives a column, which would come flat

    def manipulability(self, q: ArrayLike) -> float:
        """Yoshikawa's measure w = sqrt(det(J J')), and sqrt(det(J' J)) below six joints."""
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
        """N + 2 poses (4, 4) in the base frame: before joint 1, after each row, and the tool.

        `rows` take the place of the chain's own; their lengths may be expressions, so that code serves any lengths.
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
        """(6, n) geometric Jacobian of a point (3,) that moves with the last link; `frames` as `frames_expression`'s.

        Point and Jacobian are in the axes that the frames are given in.
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
        """(6, n) geometric Jacobian for `manipulability`, from six joints on about and along the frame amid them.

        det(J J') is the same from everywhere, here at a fifth of the operations. Below six joints det(J' J) is not.
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
    """[m] all links in a line, sliding joints at their limits; no more than numbers are used here."""
    slides = np.where([row.prismatic for row in rows], np.maximum(np.abs(lower), np.abs(upper)), 0.0)
    total = sum(
        math.hypot(row.across, abs(row.along) + slide) for row, slide in zip(rows, slides.tolist(), strict=True)
    )
    return min(total, LONGEST)


def per_joint(argument: str, value: ArrayLike, n: int, *, finite: bool = False) -> Array:
    """`value` as a read-only float array (n,); a scalar stands for every joint."""
    array = np.array(checked_array(argument, value, f"{n} numbers"))
    if array.ndim == 0:
        array = np.full(n, float(array))
    if array.shape != (n,):
        raise ConfigurationError(argument, value, f"an array of shape ({n},)")
    if finite and not np.all(np.isfinite(array)):
        raise ConfigurationError(argument, value, f"{n} finite numbers")
    array.flags.writeable = False
    return array
