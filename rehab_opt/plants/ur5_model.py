"""The UR5 (CB3) with its masses, torque limits and what is assumed of its joints."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from rehab_opt.kinematics.body import Body
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.kinematics.inertia import rod
from rehab_opt.kinematics.ur5 import ur5
from rehab_opt.plants.arm_model import ArmModel

__all__ = ["ur5_model"]

_SOLID = (
    ("shoulder", 3.7, (0.0, -0.02561, 0.00193), (0.0, 0.178, 0.0), 0.075),
    ("upper arm", 8.393, (0.2125, 0.0, 0.11336), (0.425, 0.0, 0.0), 0.06),
    ("forearm", 2.33, (0.15, 0.0, 0.0265), (0.39225, 0.0, 0.0), 0.06),
    ("wrist 1", 1.219, (0.0, -0.0018, 0.01634), (0.0, 0.095, 0.0), 0.06),
    ("wrist 2", 1.219, (0.0, 0.0018, 0.01634), (0.0, 0.085, 0.0), 0.06),
    ("wrist 3", 0.1879, (0.0, 0.0, -0.001159), (0.0, 0.0, 0.0305), 0.0375),
)
"""Name, mass [kg] and centre of mass [m] in the Denavit-Hartenberg frame behind the joint: Universal Robots, "DH
parameters for calculations of kinematics and dynamics". Length, direction [m] and radius [m] of the cylinder that
stands for its inertia, which the vendor does not publish: sizes of ROS-Industrial's ur_description."""

TORQUE_LIMIT = (150.0, 150.0, 150.0, 28.0, 28.0, 28.0)
"""[N m] Universal Robots, "Max. joint torques"."""
ROTORS = (0.5, 0.5, 0.5, 0.05, 0.05, 0.05)
"""[kg m^2] Assumption: motors and gears as seen at the joints; the vendor publishes none."""
COULOMB = (6.0, 6.0, 4.0, 1.2, 1.2, 1.0)
"""[N m] Assumption: dry friction of strain-wave gears, a few hundredths of the largest torque."""
VISCOUS = (6.0, 6.0, 4.0, 1.0, 1.0, 0.8)
"""[N m s/rad] Assumption."""


def ur5_model(chain: SerialChain | None = None, *, payload: float = 0.0, coulomb: ArrayLike = COULOMB) -> ArmModel:
    """The UR5's dynamics on a chain of its rows.

    Parameters
    ----------
    chain : made by `ur5`, with limits, base and tool of one's own.
    payload : [kg] at the tool, a point. coulomb : (6,) or scalar [N m] dry friction.
    """
    arm = ur5() if chain is None else chain
    bodies = [
        Body(name, i, mass, np.array(centre), rod(mass, along, radius))
        for i, (name, mass, centre, along, radius) in enumerate(_SOLID, start=1)
    ]
    if payload:
        bodies.append(Body("payload", arm.n, payload, np.array(arm.tool[:3, 3]), np.zeros((3, 3))))
    return ArmModel(
        arm,
        tuple(bodies),
        np.array(ROTORS),
        np.array(TORQUE_LIMIT),
        coulomb,  # type: ignore[arg-type]  # as `per_joint` takes it
        np.array(VISCOUS),
    )
