"""What every link of a serial chain is: a joint about or along z, and a fixed transform to the next joint's frame.

Forward kinematics is written here and nowhere else. Denavit-Hartenberg rows (`DH`) and the origins and axes of robot
files are two ways to write the fixed transform:

    DH          Rz(theta) Tz(d) Tx(a) Rx(alpha), which turns and shifts along the joint's z after the joint does
    origins     Z' O Z+, with O the origin of the next joint in this one's frame, and Z, Z+ rotations that lay z along
                the axes of this joint and the next
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
    """One link of a chain, however it is written down."""

    @property
    def prismatic(self) -> bool:
        """Whether the joint slides along z; it turns about z otherwise."""
        ...

    @property
    def after(self) -> Any:
        """(4, 4) pose of the next joint's frame once this joint has moved; of expressions where a length is one."""
        ...

    @property
    def along(self) -> float:
        """[m] how far that frame lies along the joint's axis."""
        ...

    @property
    def across(self) -> float:
        """[m] how far it lies from the joint's axis."""
        ...

    @property
    def lengths(self) -> tuple[float, ...]:
        """Lengths [m] of this row that are not zero."""
        ...

    def with_lengths(self, lengths: Iterator[Any]) -> ChainRow:
        """The row with the next ones of `lengths`, numbers or expressions, in their places."""
        ...


@dataclass(frozen=True, eq=False)
class Link:
    """One link of a chain whose axes lie anywhere, as robot files have them.

    Parameters
    ----------
    after : (4, 4) rigid transform from the joint, once it has moved, to the next joint's frame; that joint moves about
        or along the frame's z. Of the last link: to the frame that the tool is given in.
    prismatic : whether the joint slides along z [m]; it turns about z [rad] otherwise.

    Raises
    ------
    ConfigurationError : `after` is not a rigid transform.
    """

    after: Any
    prismatic: bool = False

    def __post_init__(self) -> None:
        """Check and freeze the transform."""
        if not isinstance(self.after, ca.SX):
            object.__setattr__(self, "after", rigid("after", self.after))

    @property
    def along(self) -> float:
        """[m] how far the next joint's frame lies along this joint's axis."""
        return float(self.after[2, 3])

    @property
    def across(self) -> float:
        """[m] how far it lies from this joint's axis."""
        return float(np.hypot(self.after[0, 3], self.after[1, 3]))

    @property
    def lengths(self) -> tuple[float, ...]:
        """[m] coordinates of the next joint's frame that are not zero."""
        return tuple(float(each) for each in self.after[:3, 3] if each != 0.0)

    def with_lengths(self, lengths: Iterator[Any]) -> Link:
        """The link with the next ones of `lengths` in place of its own."""
        after = ca.SX(ca.DM(self.after))
        for i in range(3):
            if self.after[i, 3] != 0.0:
                after[i, 3] = next(lengths)
        return replace(self, after=after)

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Pickle forgets that an array is read-only."""
        state["after"].flags.writeable = False
        self.__dict__.update(state)


def pose_after(row: ChainRow, value: ca.SX) -> ca.SX:
    """(4, 4) pose of the frame after a row in the one before it, at a joint value [rad or m]."""
    return product(_joint(row, value), ca.SX(row.after))


def pose_before(row: ChainRow, value: ca.SX) -> ca.SX:
    """(4, 4) pose of the frame before a row in the one after it, the inverse of `pose_after`."""
    after = ca.SX(row.after)
    turn = after[:3, :3].T
    back = ca.vertcat(ca.horzcat(turn, -(ca.sparsify(turn) @ ca.sparsify(after[:3, 3]))), ca.SX([[0, 0, 0, 1]]))
    return product(back, _joint(row, -value) if row.prismatic else _joint(row, value).T)


def product(left: ca.SX, right: ca.SX) -> ca.SX:
    """Product of two poses; zeros and ones vanish from the expression."""
    return ca.sparsify(left) @ ca.sparsify(right)


def _joint(row: ChainRow, value: ca.SX) -> ca.SX:
    """(4, 4) motion of a joint along or about z."""
    if row.prismatic:
        return ca.blockcat([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, value], [0, 0, 0, 1]])
    cos, sin = ca.cos(value), ca.sin(value)
    return ca.blockcat([[cos, -sin, 0, 0], [sin, cos, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
