"""An arm from a robot file with the masses and efforts of that file, and what is assumed of its joints."""

from __future__ import annotations

import numpy as np

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.body import Body
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.plants.arm_model import ArmModel

__all__ = ["own_arm_model"]

COULOMB, VISCOUS, ROTOR = 0.04, 0.04, 0.003
"""[1], [s], [s^2] Assumption: dry and viscous friction and what motors and gears add to the inertia, as a share of the
largest effort; those of `ur5_model`, as no robot file has them."""


def own_arm_model(chain: SerialChain, *, payload: float = 0.0) -> ArmModel:
    """The dynamics of a chain whose file has masses and efforts.

    Parameters
    ----------
    payload : [kg] at the tool, a point.

    Raises
    ------
    ConfigurationError : the file has no masses, or no effort of a joint.
    """
    bodies = [body for body in chain.bodies if body.link]  # what no joint moves weighs on none
    if not bodies:
        raise ConfigurationError("chain.bodies", chain.bodies, "masses of links, as robot files may have")
    for name, effort in zip(chain.names, chain.effort, strict=True):
        if not effort < np.inf:
            raise ConfigurationError(f"effort of {name}", float(effort), "the drive's largest, limit.effort of a URDF")
    if payload:
        bodies.append(Body("payload", chain.n, payload, np.array(chain.tool[:3, 3]), np.zeros((3, 3))))
    effort = chain.effort
    return ArmModel(chain, tuple(bodies), ROTOR * effort, effort, COULOMB * effort, VISCOUS * effort)
