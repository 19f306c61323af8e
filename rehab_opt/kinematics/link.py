"""Links of a serial chain: a joint about or along z, then a fixed transform to the next joint's frame.

Denavit-Hartenberg rows (`DH`) and the origins and axes of robot files are two ways to write the fixed transform:

    DH          Rz(theta) Tz(d) Tx(a) Rx(alpha), applied after the joint's motion
    origins     Z^T O Z+, where O is the pose of the next joint's origin in this joint's frame

The rotations Z and Z+ turn the z axis to the axes of this joint and of the next one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Protocol

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.kinematics.rigid import rigid

__all__ = ["ChainRow", "Link", "pose_after", "pose_before", "product"]

Array = NDArray[np.float64]


class ChainRow(Protocol):
    """Interface of one link of a chain, `DH` or `Link`."""

    @property
    def prismatic(self) -> bool:
        """True for a prismatic joint along z, False for a revolute joint about z."""
        ...

    @property
    def after(self) -> Any:
        """(4, 4) pose of the next joint's frame after this joint's motion; symbolic if a length is symbolic."""
        ...

    @property
    def along(self) -> float:
        """[m] offset of the next frame along the joint's axis."""
        ...

    @property
    def across(self) -> float:
        """[m] distance of the next frame from the joint's axis."""
        ...

    @property
    def lengths(self) -> tuple[float, ...]:
        """Nonzero lengths [m] of this row."""
        ...

    def with_lengths(self, lengths: Iterator[Any]) -> ChainRow:
        """The same row, but its nonzero lengths are the next entries of `lengths`, numbers or expressions."""
        ...


@dataclass(frozen=True, eq=False)
class Link:
    """One link of a chain with arbitrary axes, as in robot files.

    Parameters
    ----------
    after : (4, 4) rigid transform from this joint, after its motion, to the next joint's frame, whose z axis is the
        next joint's axis. For the last link: to the frame in which the tool's pose is given.
    prismatic : True for sliding along z [m], False for turning about z [rad].

    Raises
    ------
    ConfigurationError : `after` is not a rigid transform.
    """

    after: Any
    prismatic: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.after, ca.SX):
            object.__setattr__(self, "after", rigid("after", self.after))

    @property
    def along(self) -> float:
        """[m] offset of the next joint's frame along this joint's axis."""
        return float(self.after[2, 3])

    @property
    def across(self) -> float:
        """[m] distance of the next joint's frame from this joint's axis."""
        return float(np.hypot(self.after[0, 3], self.after[1, 3]))

    @property
    def lengths(self) -> tuple[float, ...]:
        """[m] nonzero coordinates of the next joint's origin."""
        return tuple(float(each) for each in self.after[:3, 3] if each != 0.0)

    def with_lengths(self, lengths: Iterator[Any]) -> Link:
        """The same link, but its nonzero coordinates are the next entries of `lengths`."""
        after = ca.SX(ca.DM(self.after))
        for i in range(3):
            if self.after[i, 3] != 0.0:
                after[i, 3] = next(lengths)
        return replace(self, after=after)

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Make the array read-only again, because pickle does not keep that flag."""
        state["after"].flags.writeable = False
        self.__dict__.update(state)


def pose_after(row: ChainRow, value: ca.SX) -> ca.SX:
    """(4, 4) pose of the frame after a row, in the frame before it, at a joint value [rad or m]."""
    return product(_joint(row, value), ca.SX(row.after))


def pose_before(row: ChainRow, value: ca.SX) -> ca.SX:
    """(4, 4) pose of the frame before a row, in the frame after it; inverse of `pose_after`."""
    after = ca.SX(row.after)
    turn = after[:3, :3].T
    back = ca.vertcat(ca.horzcat(turn, -(ca.sparsify(turn) @ ca.sparsify(after[:3, 3]))), ca.SX([[0, 0, 0, 1]]))
    return product(back, _joint(row, -value) if row.prismatic else _joint(row, value).T)


def product(left: ca.SX, right: ca.SX) -> ca.SX:
    """Product of two poses; zeros and ones in them cost no operations."""
    return ca.sparsify(left) @ ca.sparsify(right)


def _joint(row: ChainRow, value: ca.SX) -> ca.SX:
    if row.prismatic:
        return ca.blockcat([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, value], [0, 0, 0, 1]])
    cos, sin = ca.cos(value), ca.sin(value)
    return ca.blockcat([[cos, -sin, 0, 0], [sin, cos, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
