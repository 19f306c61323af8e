"""Dynamics of serial arms and of a point mass: masses, rotors, friction and torque limits."""

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
"""Speed limit [m/s] of a point mass; its chain requires a number, but the plant does not enforce this limit."""


@dataclass(frozen=True, eq=False)
class ArmModel:
    """Kinematics and dynamics of a serial arm with n joints. Immutable.

    Parameters
    ----------
    chain : kinematics of the arm.
    bodies : masses that are fixed to the arm's links.
    rotors : inertia (n,) or scalar that motors and gears add at each joint [kg m^2; prismatic: kg].
    torque_limit : largest effort (n,) or scalar of each drive [N m, N].
    coulomb, viscous : dry friction [N m, N] and viscous friction [N m s/rad, N s/m] of each joint, (n,) or scalar.
    gravity : gravity (3,) [m/s^2] in the base frame.
    stops : lower and upper mechanical stops (2, n) [rad, m], infinite for none; None without stops. The chain's joint
        limits are not stops.

    Raises
    ------
    ConfigurationError : a number is out of range, a body is on no link, an inertia is impossible, or a joint moves no
        mass.
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
"""Assumed ratios of dry friction [1], viscous friction [s] and rotor inertia [s^2] to a joint's largest effort. Robot
files do not give these values; the ratios are those of `ur5_model`."""


def own_arm_model(chain: SerialChain, *, payload: float = 0.0) -> ArmModel:
    """Dynamics of an arm from a robot file that gives masses and efforts.

    Parameters
    ----------
    chain : kinematics with the masses and efforts of the robot file. payload : point mass [kg] at the tool.

    Raises
    ------
    ConfigurationError : the robot file has no masses, or lacks the effort of a joint.
    """
    bodies = [body for body in chain.bodies if body.link]  # bodies on the fixed base load no joint
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
"""Links of the UR5: name, mass [kg], centre of mass [m] in the Denavit-Hartenberg frame after the joint, axis [m] and
radius [m] of a cylinder that replaces the unpublished inertia. Masses and centres: Universal Robots, "DH parameters for
calculations of kinematics and dynamics"; sizes of the cylinders: ROS-Industrial's ur_description."""

TORQUE_LIMIT = (150.0, 150.0, 150.0, 28.0, 28.0, 28.0)
"""Largest torques [N m] of the UR5's joints; source: Universal Robots, "Max. joint torques"."""
ROTORS = (0.5, 0.5, 0.5, 0.05, 0.05, 0.05)
"""Inertia [kg m^2] of motors and gears at the joints; an assumption, since the vendor does not publish it."""
COULOMB = (6.0, 6.0, 4.0, 1.2, 1.2, 1.0)
"""Dry friction [N m] of strain-wave gears; an assumption, about 4 % of the largest torque."""
VISCOUS = (6.0, 6.0, 4.0, 1.0, 1.0, 0.8)
"""Viscous friction [N m s/rad]; an assumption."""


def ur5_model(chain: SerialChain | None = None, *, payload: float = 0.0, coulomb: ArrayLike = COULOMB) -> ArmModel:
    """Dynamics of the UR5.

    Parameters
    ----------
    chain : chain made by `ur5`, with any limits, base and tool; by default `ur5()`.
    payload : point mass [kg] at the tool. coulomb : dry friction (6,) or scalar [N m].
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
    """A point mass that slides along x and y; its joint positions are the hand's coordinates [m].

    Parameters
    ----------
    mass : mass [kg].
    viscous, coulomb : viscous friction [N s/m] and dry friction [N] of each axis. The two axes are independent.
    force_limit : largest motor force [N] of each axis. stops : lower and upper ends (2, 2) [m] of both axes, or None.
    """
    rows = (DH(0.0, -math.pi / 2, 0.0, math.pi / 2, prismatic=True), DH(0.0, 0.0, 0.0, 0.0, prismatic=True))
    # The first joint slides along the z axis of `base`, which is x; the second joint slides along y.
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
