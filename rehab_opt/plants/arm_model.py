"""Dynamics of serial arms and of a point mass: masses, motors, friction, torque limits."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.body import Body, checked_bodies
from rehab_opt.kinematics.chain import SerialChain, per_joint
from rehab_opt.kinematics.denavit_hartenberg import DH
from rehab_opt.kinematics.inertia import rod
from rehab_opt.kinematics.ur5 import ur5

__all__ = ["ArmModel", "own_arm_model", "point_mass_model", "ur5_model"]

Array = NDArray[np.float64]

FASTEST = 10.0
"""[m/s, rad/s] Formal speed limit of a point mass's chain; the plant does not enforce it."""


@dataclass(frozen=True, eq=False)
class ArmModel:
    """A chain with its dynamics. Immutable.

    Parameters
    ----------
    chain : any serial chain.
    bodies : masses that move with its links.
    rotors : (n,) or scalar: inertia that motors and gears add at each joint [kg m^2; prismatic: kg].
    torque_limit : (n,) or scalar [N m, N] largest effort of each drive.
    coulomb, viscous : (n,) or scalar, friction of each joint [N m, N] and [N m s/rad, N s/m].
    gravity : (3,) [m/s^2] in the base frame.
    stops : (2, n) [rad, m] lower and upper mechanical stops, infinite for none, or None; joint limits are no stops.

    Raises
    ------
    ConfigurationError : a number out of range, a body on no link, an impossible inertia, a joint that moves no mass.
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
        bodies = checked_bodies(self.bodies, n)
        object.__setattr__(self, "bodies", bodies)
        tip = sum(body.mass for body in bodies if body.link == n)
        if not (tip > 0.0 or self.rotors[-1] > 0.0):
            raise ConfigurationError("bodies, rotors", (bodies, self.rotors), "a mass that the last joint moves")


COULOMB_SHARE, VISCOUS_SHARE, ROTOR_SHARE = 0.04, 0.04, 0.003
"""[1], [s], [s^2] Assumed ratios of dry friction, viscous friction and rotor inertia to the largest effort: those of
`ur5_model`, since robot files have none."""


def own_arm_model(chain: SerialChain, *, payload: float = 0.0) -> ArmModel:
    """Dynamics of a chain whose robot file has masses and efforts.

    Parameters
    ----------
    payload : [kg] point mass at the tool.

    Raises
    ------
    ConfigurationError : the file has no masses, or lacks the effort of a joint.
    """
    bodies = [body for body in chain.bodies if body.link]  # what no joint moves weighs on none
    if not bodies:
        raise ConfigurationError(
            "chain.bodies",
            chain.bodies,
            "masses of links, by <inertial> of a URDF or MJCF: those of shapes are not read",
        )
    for name, effort in zip(chain.names, chain.effort, strict=True):
        if not effort < np.inf:
            expected = (
                "the drive's largest: limit.effort of a URDF, a force range of an MJCF, effort_n_m of a robot file"
            )
            raise ConfigurationError(f"effort of {name}", float(effort), expected)
    if payload:
        bodies.append(Body("payload", chain.n, payload, np.array(chain.tool[:3, 3]), np.zeros((3, 3))))
    effort = chain.effort
    return ArmModel(chain, tuple(bodies), ROTOR_SHARE * effort, effort, COULOMB_SHARE * effort, VISCOUS_SHARE * effort)


_SOLID = (
    ("shoulder", 3.7, (0.0, -0.02561, 0.00193), (0.0, 0.178, 0.0), 0.075),
    ("upper arm", 8.393, (0.2125, 0.0, 0.11336), (0.425, 0.0, 0.0), 0.06),
    ("forearm", 2.33, (0.15, 0.0, 0.0265), (0.39225, 0.0, 0.0), 0.06),
    ("wrist 1", 1.219, (0.0, -0.0018, 0.01634), (0.0, 0.095, 0.0), 0.06),
    ("wrist 2", 1.219, (0.0, 0.0018, 0.01634), (0.0, 0.085, 0.0), 0.06),
    ("wrist 3", 0.1879, (0.0, 0.0, -0.001159), (0.0, 0.0, 0.0305), 0.0375),
)
"""Name, mass [kg] and centre of mass [m] in the Denavit-Hartenberg frame after the joint: Universal Robots, "DH
parameters for calculations of kinematics and dynamics". Then axis [m] and radius [m] of a cylinder that replaces the
unpublished inertia; sizes from ROS-Industrial's ur_description."""

TORQUE_LIMIT = (150.0, 150.0, 150.0, 28.0, 28.0, 28.0)
"""[N m] Universal Robots, "Max. joint torques"."""
ROTORS = (0.5, 0.5, 0.5, 0.05, 0.05, 0.05)
"""[kg m^2] Assumption: motors and gears as seen at the joints; the vendor publishes none."""
COULOMB = (6.0, 6.0, 4.0, 1.2, 1.2, 1.0)
"""[N m] Assumption: dry friction of strain-wave gears, a few hundredths of the largest torque."""
VISCOUS = (6.0, 6.0, 4.0, 1.0, 1.0, 0.8)
"""[N m s/rad] Assumption."""


def ur5_model(chain: SerialChain | None = None, *, payload: float = 0.0, coulomb: ArrayLike = COULOMB) -> ArmModel:
    """Dynamics of the UR5.

    Parameters
    ----------
    chain : made by `ur5`, with any limits, base and tool.
    payload : [kg] point mass at the tool. coulomb : (6,) or scalar [N m] dry friction.
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


def point_mass_model(
    mass: float,
    *,
    viscous: float = 0.0,
    coulomb: float = 0.0,
    force_limit: float = math.inf,
    stops: ArrayLike | None = None,
) -> ArmModel:
    """A point mass [kg] that slides along x and y; its joint positions are those of the hand [m].

    Parameters
    ----------
    viscous, coulomb : [N s/m], [N] friction of each axis. Axes are independent, so the bound of dry friction is a
        square.
    force_limit : [N] of each axis. stops : (2, 2) [m] lower and upper ends of both axes, or None.
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
