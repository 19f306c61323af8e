"""Differential inverse kinematics within joint limits by a tangent transform: Eqs. (8)-(14), Rossa et al.

Deviations: the handle's task is r11 = r21 = 0, because roll and pitch (4)-(5) are singular at their own goal. Locked
joints are left out, because (8) divides by their range. The transformed variable v is bounded, by default far above any
value in use. As published, an unreachable target drives v to infinity. When the target returns, a joint at its limit
does not follow, because its slope in (11) is 1/v^2. With `saturation=30, damping=1e-8` the arm returns within 0.05 s,
at the cost of 1 % of each range at both ends.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.kinematics.real_array import is_finite, positive

__all__ = ["TangentLaw", "TangentPath", "Tracking", "damped_pseudoinverse"]

Array = NDArray[np.float64]

GAIN = 1000.0
"""[1/s] k0. The paper gives no value: `GAIN` and `DAMPING` are the best of the grid of `python -m
bench.tangent_law`."""
DAMPING = 1e-6
"""mu; the paper requires mu << 1. With 1e-4 the hand misses one constant reachable target in 25 after 3 s."""
SATURATION = 1e6
"""Largest |v|; there a joint is about a millionth of a radian from its limit."""
STEP = 0.2  # largest k0 h of an integration step h [s]; with 0.05 the path of mocap_lift is the same
MAX_MAGNITUDE = 1e6  # [m] a target beyond counts as not finite
SETTLING = 20.0  # [1/k0] time to find a start posture if none is given


class Tracking(Enum):
    """Result for one sample of a path."""

    OK = "ok"  #: hand within the tolerance, handle within its tilt
    OFF = "off_target"  #: hand or handle is outside its tolerance
    HOLDING = "holding"  #: the target was not finite, and the posture stayed


@dataclass(frozen=True)
class TangentPath:
    """Postures for all samples of a path."""

    q: Array
    """(N, n) [rad], inside the joint limits, always finite."""
    status: list[Tracking]
    """(N,) result of each sample."""
    position_error: Array
    """(N,) [m] distance from hand to target; NaN if the target is not finite."""
    handle_tilt: Array
    """(N,) [rad] angle between handle and vertical."""
    seconds: Array
    """(N,) computing time of each sample."""


def damped_pseudoinverse(jacobian: Array, damping: float) -> Array:
    """J' (J J' + mu I)^-1, Eq. (13): (k, n) to (n, k)."""
    return np.asarray(
        np.linalg.solve(jacobian @ jacobian.T + damping * np.eye(len(jacobian)), jacobian).T, dtype=np.float64
    )


class TangentLaw:
    """Eq. (14), v' = k0 Jc+ (p - Gamma(q)), integrated by explicit Euler steps.

    v are the transformed joint variables of Eq. (8), p is the target of the task Gamma(q), and Jc+ is the damped
    pseudoinverse of the task Jacobian Jc, Eq. (13).

    Parameters
    ----------
    arm : chain with finite limits and its handle along the tool's x axis, such as `human_arm`.
    gain : k0 [1/s].
    damping : mu of Eq. (13).
    dt : time between the samples of a path [s].
    handle_tilt : [rad] tilt up to which a sample counts as followed; the controller's goal is zero tilt.
    tolerance : [m] position error up to which a sample counts as followed.
    substeps : integration steps per sample; by default so many that k0 h <= 0.2.
    saturation : largest |v|.

    Raises
    ------
    ConfigurationError : no chain, an infinite joint limit, a number that is not positive and finite.
    """

    def __init__(
        self,
        arm: SerialChain,
        *,
        gain: float = GAIN,
        damping: float = DAMPING,
        dt: float = 0.01,
        handle_tilt: float = math.radians(2.0),
        tolerance: float = 1e-3,
        substeps: int | None = None,
        saturation: float = SATURATION,
    ) -> None:
        if not isinstance(arm, SerialChain):
            raise ConfigurationError("arm", arm, "a SerialChain")
        if not np.all(np.isfinite([arm.lower, arm.upper])):
            raise ConfigurationError("arm", (arm.lower, arm.upper), "finite joint limits")
        for name, number in (
            ("gain", gain), ("dt", dt), ("handle_tilt", handle_tilt), ("tolerance", tolerance),
            ("saturation", saturation),
        ):  # fmt: skip
            positive(name, number)
        if not (is_finite(damping) and damping >= 1e-12):
            raise ConfigurationError("damping", damping, "a number of at least 1e-12")
        substeps = math.ceil(gain * dt / STEP) if substeps is None else substeps
        if not (isinstance(substeps, (int, np.integer)) and substeps >= 1):
            raise ConfigurationError("substeps", substeps, "a whole number, at least 1")
        self.arm = arm
        self.gain, self.damping, self.dt = gain, damping, dt
        self.handle_tilt, self.tolerance = handle_tilt, tolerance
        self.substeps, self.saturation = substeps, saturation
        self._free = ~arm.locked
        self._width = (arm.upper - arm.lower)[self._free]
        self._middle = 0.5 * (arm.upper + arm.lower)

    # ------------------------------------------------------------------------------------------- the equations
    def transformed(self, q: ArrayLike) -> Array:
        """Variables v (m,) of the joints that are not locked, Eq. (8); q (n,) [rad] is first clipped into limits."""
        fraction = 2.0 * (np.asarray(q, dtype=np.float64) - self._middle)[self._free] / self._width
        v = np.tan(0.5 * math.pi * np.clip(fraction, -1.0, 1.0))
        return np.clip(v, -self.saturation, self.saturation)

    def joints(self, v: Array) -> Array:
        """Joint values q (n,) [rad] for v (m,), Eq. (9); they are inside the limits for any v."""
        q = self._middle.copy()
        q[self._free] += self._width / math.pi * np.arctan(v)
        return np.clip(q, self.arm.lower, self.arm.upper)

    def slope(self, v: Array) -> Array:
        """(m,) diagonal of Eq. (11), dq/dv [rad]."""
        return self._width / math.pi / (1.0 + v * v)

    def task(self, q: Array) -> Array:
        """(5,) hand position [m] and the horizontal components r11, r21 of the handle's axis: Eq. (6)."""
        return _task_at(self.arm.pose(q))

    def task_jacobian(self, v: Array) -> Array:
        """(5, m) derivative of `task` by v: Jc of Eq. (10)."""
        q = self.joints(v)
        return self._jacobian_at(v, q, self.arm.pose(q))

    def rate(self, v: Array, position: Array) -> Array:
        """Rates v' (m,) [1/s] towards a hand position (3,) [m] with a vertical handle: Eq. (14)."""
        q = self.joints(v)
        pose = self.arm.pose(q)
        error = np.concatenate([position, np.zeros(2)]) - _task_at(pose)
        return self.gain * damped_pseudoinverse(self._jacobian_at(v, q, pose), self.damping) @ error

    def _jacobian_at(self, v: Array, q: Array, pose: Array) -> Array:
        jacobian = self.arm.jacobian(q)
        x, y, z = pose[:3, 0]
        linear, (about_x, about_y, about_z) = jacobian[:3], jacobian[3:]
        rows = np.vstack([linear, about_y * z - about_z * y, about_z * x - about_x * z])  # the axis turns: w x handle
        return np.asarray(rows[:, self._free] * self.slope(v))

    # ------------------------------------------------------------------------------------------------ the path
    def follow(self, path: ArrayLike, start: ArrayLike | None = None) -> TangentPath:
        """Postures that follow a hand path; its points may be out of reach or not finite.

        Parameters
        ----------
        path : (N, 3) [m], one sample every `dt`; between them the target moves in straight lines.
        start : (n,) [rad] posture at the first sample; by default the one to which the controller converges from
            mid-range.

        Raises
        ------
        ConfigurationError : a path or start of the wrong shape, a start that is not finite.
        """
        targets = _numbers("path", path, "numbers of shape (N, 3)")
        if targets.ndim != 2 or targets.shape[1] != 3:
            raise ConfigurationError("path", targets.shape, "shape (N, 3)")
        known = np.all(np.abs(targets) <= MAX_MAGNITUDE, axis=1)
        v = np.zeros(self._width.shape)
        if start is not None:
            q = _numbers("start", start, f"{self.arm.n} finite joint angles")
            if q.shape != (self.arm.n,) or not np.all(np.isfinite(q)):
                raise ConfigurationError("start", start, f"{self.arm.n} finite joint angles")
            v = self.transformed(q)
        postures, tilts = np.empty((len(targets), self.arm.n)), np.empty(len(targets))
        errors, seconds = np.full(len(targets), np.nan), np.empty(len(targets))
        last: Array | None = None
        for k, target in enumerate(targets):
            begun = time.perf_counter()
            if known[k]:
                if last is not None:
                    v = self._integrated(v, last, target, steps=self.substeps, h=self.dt / self.substeps)
                elif start is None:
                    v = self._integrated(v, target, target, steps=math.ceil(SETTLING / STEP), h=STEP / self.gain)
                last = target
            postures[k] = self.joints(v)
            seconds[k] = time.perf_counter() - begun
            pose = self.arm.pose(postures[k])
            errors[k] = np.linalg.norm(pose[:3, 3] - target) if known[k] else math.nan
            tilts[k] = math.atan2(math.hypot(pose[0, 0], pose[1, 0]), pose[2, 0])
        followed = (errors <= self.tolerance) & (tilts <= self.handle_tilt)
        status = [
            Tracking.HOLDING if not given else Tracking.OK if met else Tracking.OFF
            for given, met in zip(known, followed, strict=True)
        ]
        return TangentPath(q=postures, status=status, position_error=errors, handle_tilt=tilts, seconds=seconds)

    def _integrated(self, v: Array, begin: Array, end: Array, *, steps: int, h: float) -> Array:
        """Variables v (m,) after `steps` Euler steps of h [s], in which the target moves from `begin` to `end` (3,)."""
        for i in range(1, steps + 1):
            v = v + h * self.rate(v, begin + (end - begin) * (i / steps))
            v = np.clip(v, -self.saturation, self.saturation)
        return v


def _task_at(pose: Array) -> Array:
    return np.concatenate([pose[:3, 3], pose[:2, 0]])


def _numbers(argument: str, value: ArrayLike, expected: str) -> Array:
    try:
        return np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as problem:
        raise ConfigurationError(argument, value, expected) from problem
