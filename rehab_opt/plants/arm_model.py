"""A serial arm with everything that moves it or holds it back: masses, motors, friction, torque limits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.body import Body
from rehab_opt.kinematics.chain import SerialChain, per_joint
from rehab_opt.kinematics.inertia import rod

__all__ = ["ArmModel", "rods_along"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ArmModel:
    """A chain with its dynamics. Immutable.

    Parameters
    ----------
    chain : any serial chain.
    bodies : masses that move with its links.
    rotors : (n,) or scalar: what motors and gears add to each joint's inertia [kg m^2; of a prismatic joint kg].
    torque_limit : (n,) or scalar [N m, N] largest effort of each drive.
    coulomb, viscous : (n,) or scalar, friction of each joint [N m, N] and [N m s/rad, N s/m].
    gravity : (3,) [m/s^2] in the base frame.
    stops : (2, n) [rad, m] lower and upper mechanical stops, infinite for none, or None; joint limits are no stops.

    Raises
    ------
    ConfigurationError : a number out of range, a body on no link, a joint that nothing has a mass behind.
    """

    chain: SerialChain
    bodies: tuple[Body, ...]
    rotors: Array
    torque_limit: Array
    coulomb: Array
    viscous: Array
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    stops: Array | None = None

    def __post_init__(self) -> None:
        """Check and freeze every argument."""
        n = self.chain.n
        for name in ("rotors", "torque_limit", "coulomb", "viscous"):
            value = per_joint(name, getattr(self, name), n)
            if not (np.all(value >= 0.0) and (name == "torque_limit" or np.all(value < math.inf))):
                raise ConfigurationError(name, getattr(self, name), f"{n} numbers of zero or more")
            object.__setattr__(self, name, value)
        if self.stops is not None:
            stops = np.array(self.stops, dtype=np.float64)
            if stops.shape != (2, n) or not np.all(stops[0] < stops[1]):
                raise ConfigurationError("stops", self.stops, f"(2, {n}) numbers, lower ones below upper ones")
            object.__setattr__(self, "stops", stops)
        bodies = tuple(self.bodies)
        for body in bodies:
            if not (isinstance(body, Body) and 1 <= body.link <= n and 0.0 <= body.mass < math.inf):
                raise ConfigurationError("bodies", body, f"masses on links 1 to {n}")
        object.__setattr__(self, "bodies", bodies)
        tip = sum(body.mass for body in bodies if body.link == n)
        if not (tip > 0.0 or self.rotors[-1] > 0.0):
            raise ConfigurationError("bodies, rotors", (bodies, self.rotors), "a mass that the last joint moves")


def rods_along(chain: SerialChain, masses: Sequence[float] | ArrayLike, *, radius: float) -> tuple[Body, ...]:
    """An assumption where no inertias are published: each link a solid rod from one joint's axis to the next one's.

    A link of less than a radius' length becomes a ball of that radius about its frame.

    Parameters
    ----------
    chain : whose rows give the rods. masses : (n,) [kg]. radius : [m] of all of them.
    """
    bodies = []
    for i, (row, mass) in enumerate(zip(chain.rows, np.asarray(masses, dtype=np.float64).tolist(), strict=True)):
        # From the frame before the joint to the one behind it, in the axes of the latter: whatever the joint's value.
        after = np.array(row.after, dtype=np.float64)
        along = after[:3, :3].T @ np.append(after[:2, 3], 0.0 if row.prismatic else after[2, 3])
        ball = float(np.linalg.norm(along)) <= radius
        inertia = 0.4 * mass * radius**2 * np.eye(3) if ball else rod(mass, along, radius)
        bodies.append(Body(chain.names[i], i + 1, mass, np.zeros(3) if ball else -0.5 * along, inertia))
    return tuple(bodies)
