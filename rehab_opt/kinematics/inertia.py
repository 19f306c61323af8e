"""Inertia matrix of a serial chain from the masses of its links."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.kinematics.body import Body
from rehab_opt.kinematics.chain import SerialChain

__all__ = ["inertia_expression", "rod"]

Array = NDArray[np.float64]


def rod(mass: float, along: ArrayLike, radius: float) -> Array:
    """(3, 3) inertia [kg m^2] of a solid cylinder about its centre; the vector `along` (3,) [m] is its axis."""
    axis = np.asarray(along, dtype=np.float64)
    length = float(np.linalg.norm(axis))
    spin = 0.5 * mass * radius**2
    tilt = mass * (3 * radius**2 + length**2) / 12
    unit = axis / length if length > 0.0 else np.array([0.0, 0.0, 1.0])
    return tilt * np.eye(3) + (spin - tilt) * np.outer(unit, unit)


def inertia_expression(chain: SerialChain, bodies: Sequence[Body], rotors: Array, q: ca.SX) -> ca.SX:
    """(n, n) expression of the inertia matrix W; the kinetic energy is v^T W v / 2 [J] at joint velocities v.

    W is the sum of m Jv^T Jv + Jw^T I Jw over the bodies (mass m, inertia I), plus `rotors` on the diagonal. Jv and Jw
    are the linear and angular Jacobians of a body's centre of mass.

    `rotors` (n,) is the inertia that motors and gears add at each joint [kg m^2 or kg].
    """
    frames, n = chain.frames_expression(q), chain.n
    total = ca.SX(ca.diag(ca.DM(rotors)))
    for body in bodies:
        pose = frames[body.link]
        rotation, centre = pose[:3, :3], pose[:3, :3] @ ca.DM(body.centre) + pose[:3, 3]
        linear, angular = ca.SX(3, n), ca.SX(3, n)
        for i in range(body.link):
            axis, origin = frames[i][:3, 2], frames[i][:3, 3]
            if chain.rows[i].prismatic:
                linear[:, i] = axis
            else:
                linear[:, i], angular[:, i] = ca.cross(axis, centre - origin), axis
        turned = rotation.T @ angular
        total += body.mass * (linear.T @ linear) + turned.T @ ca.DM(body.inertia) @ turned
    return ca.densify(ca.triu2symm(ca.triu(total)))
