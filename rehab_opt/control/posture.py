"""Costs that select one of the postures with the hand at its target: Discussion of Rossa et al. (VII-A)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.kinematics.human_arm import ARM_JOINTS, ARM_REST

__all__ = ["POSTURE_COSTS", "History", "PostureCost", "Quadratic", "rest_posture"]

Array = NDArray[np.float64]
Weights = Mapping[str, float | Mapping[str, float]]

POSTURE_COSTS = ("rest", "speed", "elbow", "displacement", "acceleration", "manipulability")
NARROW, WIDE = 0.1, 2 * math.pi
"""[rad] Ranges of motion are clipped to these limits, since a joint with a tiny range would outweigh all others."""
ELBOWS = ("forearm_extension", "elbow")


class History(NamedTuple):
    """Reference postures (n,) of the cost terms; None before the first sample."""

    previous: Array | None = None
    """One sample ago."""
    before: Array | None = None
    """Two samples ago."""
    origin: Array | None = None
    """At the start of the path."""


class Quadratic(NamedTuple):
    """Cost 1/2 sum weight_i (q_i - centre_i)^2 + constant of a posture q."""

    weight: Array
    centre: Array
    constant: float


class PostureCost:
    """Sum of weighted terms; all but the last are 1/2 sum_i w_i (change_i / range_i)^2.

    ================ ====================================================================================
    "rest"           distance from the rest posture
    "elbow"          distance of the elbow from its flexed position, the upper end of its range
    "displacement"   distance from the posture at the start of the path
    "speed"          change since the previous sample
    "acceleration"   difference between the last two changes
    "manipulability" w^2 / (its mean over the range of motion); low where spasms move the hand little
    ================ ====================================================================================

    range_i is the joint's range of motion, clipped to 0.1 rad and 2 pi, and w the manipulability. A term without a
    reference posture is left out; if no term remains, "rest" is used.

    Parameters
    ----------
    weights : weight of each term, or weights by joint name: {"displacement": {"humeral_flexion": 2}}.
    rest : (n,) [rad] rest posture, clipped to the limits; None for that of Table I, else the middle of the limits.

    Raises
    ------
    ConfigurationError : an unknown term or joint, a negative or infinite weight, "elbow" for an arm without one.
    """

    def __init__(self, arm: SerialChain, weights: Weights, *, rest: ArrayLike | None = None) -> None:
        if not isinstance(weights, Mapping) or not weights:
            raise ConfigurationError("posture_cost", weights, f"weights by name, among {', '.join(POSTURE_COSTS)}")
        self.rest = rest_posture(arm, rest)
        scale = 1.0 / np.clip(arm.upper - arm.lower, NARROW, WIDE) ** 2
        self._terms: dict[str, Array] = {}
        self.manipulability = 0.0
        for name, weight in weights.items():
            if name not in POSTURE_COSTS:
                raise ConfigurationError("posture_cost", name, f"names among {', '.join(POSTURE_COSTS)}")
            if name == "manipulability":
                self.manipulability = _weight(name, weight)
            else:
                self._terms[name] = scale * _joint_weights(arm, name, weight)
        self._default = scale
        # An infinite range has no flexed position: use the rest posture.
        self._flexed = np.where(np.isfinite(arm.upper), arm.upper, self.rest)
        self._constant = None if self._needs_history else self._combined(History())

    def quadratic(self, history: History) -> Quadratic:
        """All terms except manipulability as one quadratic cost."""
        return self._constant or self._combined(history)

    @property
    def _needs_history(self) -> bool:
        return not {"speed", "displacement", "acceleration"}.isdisjoint(self._terms)

    def _combined(self, history: History) -> Quadratic:
        pairs = [
            (weight, centre)
            for name, weight in self._terms.items()
            if (centre := self._centre(name, history)) is not None
        ]
        if not (pairs or self.manipulability):
            pairs = [(self._default, self.rest)]
        total = np.zeros_like(self.rest)
        moment = np.zeros_like(self.rest)
        for weight, centre in pairs:
            total += weight
            moment += weight * centre
        middle = np.divide(moment, total, out=self.rest.copy(), where=total > 0)
        constant = 0.5 * sum(float(weight @ (centre - middle) ** 2) for weight, centre in pairs)
        return Quadratic(total, middle, constant)

    def _centre(self, name: str, history: History) -> Array | None:
        previous, before, origin = history
        if name == "speed":
            return previous
        if name == "displacement":
            return origin
        if name == "acceleration":
            return None if previous is None or before is None else 2 * previous - before
        return self.rest if name == "rest" else self._flexed


def rest_posture(arm: SerialChain, rest: ArrayLike | None = None) -> Array:
    """(n,) rest posture inside the limits, from `rest`, Table I or the middle of the limits."""
    if rest is None:
        if arm.names == ARM_JOINTS:
            chosen = ARM_REST
        else:
            finite = np.isfinite(arm.lower) & np.isfinite(arm.upper)
            chosen = np.where(finite, (np.where(finite, arm.lower, 0) + np.where(finite, arm.upper, 0)) / 2, 0.0)
    else:
        chosen = np.array(rest, dtype=np.float64)
        if chosen.shape != (arm.n,) or not np.all(np.isfinite(chosen)):
            raise ConfigurationError("rest", rest, f"{arm.n} finite joint values")
    return np.clip(chosen, arm.lower, arm.upper)


def _joint_weights(arm: SerialChain, name: str, weight: float | Mapping[str, float]) -> Array:
    if isinstance(weight, Mapping):
        weights = np.zeros(arm.n)
        for joint, fraction in weight.items():
            if joint not in arm.names:
                raise ConfigurationError(f"posture_cost[{name!r}]", joint, f"joints among {', '.join(arm.names)}")
            weights[arm.names.index(joint)] = _weight(f"{name}.{joint}", fraction)
        return weights
    weights = np.full(arm.n, _weight(name, weight))
    if name != "elbow":
        return weights
    elbows = [joint in ELBOWS for joint in arm.names]
    if not any(elbows):
        raise ConfigurationError(
            "posture_cost", name, f"a chain with a joint named {' or '.join(ELBOWS)}, or joints by name"
        )
    return np.where(elbows, weights, 0.0)


def _weight(name: str, weight: object) -> float:
    try:
        number = float(weight)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        number = math.nan
    if not 0 <= number < math.inf:
        raise ConfigurationError(f"posture_cost[{name!r}]", weight, "a finite number, zero or more")
    return number
