"""Inputs of controllers that follow a pose and a twist."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.limit import PostureLimits
from rehab_opt.control.thread_owner import setting
from rehab_opt.control.velocity_controller import VelocityController
from rehab_opt.kinematics.room import MOVING, MovingCapsule

__all__ = ["PoseInputs"]

Array = NDArray[np.float64]
_ndarray = np.ndarray


class PoseInputs(VelocityController):
    """Base of joint controllers whose `step` takes q, a pose, a twist, and moving capsules if `limits` have any."""

    requirement = "pose is not a rigid transform"
    name: ClassVar[str]

    gain: float = setting()
    linear_speed: float = setting()
    angular_speed: float = setting()
    task_weights: Array = setting()
    posture: Array | None = setting()
    limits: PostureLimits = setting()

    @property
    def shapes(self) -> tuple[tuple[int, ...], ...]:  # type: ignore[override]
        """Shapes of the statement's parameters after q: pose, twist, and moving capsules if any."""
        moving = self.limits.moving
        return ((4, 4), (6,), *([(moving, MOVING)] if moving else []))

    def _take(
        self, q: ArrayLike, pose: ArrayLike, twist: ArrayLike, obstacles: Sequence[MovingCapsule] | Array | None
    ) -> None:
        usual = False
        # A masked array would lose its mask.
        if q.__class__ is _ndarray and twist.__class__ is _ndarray and pose.__class__ is _ndarray:
            try:
                # View to view: twice as fast as numpy, and refuses any other type or size.
                views: tuple[Any, ...] = self._views
                views[0][:], views[2][:] = q, twist
                views[1][:] = pose.ravel()
                usual = pose.ndim == 2 and len(pose) == 4
            except (ValueError, TypeError):
                usual = False
        if not usual:
            self._write((q, pose, twist, *self._inputs[2:]))
        if obstacles is not None or self.limits.moving:
            self._inputs[-1][:] = self.limits.capsule_numbers("obstacles", obstacles)
