"""A point mass on two axes, for the controllers of forces."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from rehab_opt.kinematics.body import Body
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.kinematics.denavit_hartenberg import DH
from rehab_opt.plants.arm_model import ArmModel

__all__ = ["point_mass_model"]

FASTEST = 10.0
"""[m/s, rad/s] A chain has to have a speed limit; nothing here keeps it."""


def point_mass_model(
    mass: float,
    *,
    viscous: float = 0.0,
    coulomb: float = 0.0,
    force_limit: float = math.inf,
    stops: ArrayLike | None = None,
) -> ArmModel:
    """A mass [kg] that slides along x and y; its positions are those of the hand [m].

    Parameters
    ----------
    viscous, coulomb : [N s/m], [N] friction of each axis, apart: dry friction is a square rather than a circle.
    force_limit : [N] of each axis' drive. stops : (2, 2) [m] lower and upper ends of both axes, or None.
    """
    rows = (DH(0.0, -math.pi / 2, 0.0, math.pi / 2, prismatic=True), DH(0.0, 0.0, 0.0, 0.0, prismatic=True))
    # z before the first row is x, and before the second one y.
    base = np.array([[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    axes, far = np.zeros(2), np.full(2, math.inf)
    chain = SerialChain(
        rows, lower=-far, upper=far, velocity=axes + FASTEST, acceleration=far, names=("x", "y"), base=base
    )
    return ArmModel(
        chain,
        (Body("mass", 2, mass, np.zeros(3), np.zeros((3, 3))),),
        axes,
        axes + force_limit,
        axes + coulomb,
        axes + viscous,
        (0.0, 0.0, 0.0),
        stops,  # type: ignore[arg-type]  # checked there
    )
