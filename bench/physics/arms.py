"""The arms of the bench: a UR5, and one of seven joints; both with limits near enough to be met."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt import DH, SerialChain, ur5
from rehab_opt.kinematics.body import Body
from rehab_opt.kinematics.inertia import rod
from rehab_opt.plants.arm_model import ArmModel, ur5_model

__all__ = ["ARMS", "Arm", "iiwa", "rods_along"]

Array = NDArray[np.float64]

AROUND = 0.9
"""[rad] The bench's joint limits, to either side of the posture that an arm begins near."""


@dataclass(frozen=True, eq=False)
class Arm:
    """An arm with the posture that tasks begin near."""

    name: str
    model: ArmModel
    ready: Array
    """(n,) [rad] in the middle of its limits."""

    @property
    def chain(self) -> SerialChain:
        """With the bench's limits."""
        return self.model.chain

    def start(self, rng: np.random.Generator, spread: float = 0.3) -> Array:
        """(n,) [rad] near `ready`."""
        return self.ready + rng.uniform(-spread, spread, len(self.ready))


def iiwa() -> SerialChain:
    """The KUKA LBR iiwa 14 R820 with its vendor's lengths, ranges and speeds (data sheet); accelerations assumed."""
    turns = (-math.pi / 2, math.pi / 2, math.pi / 2, -math.pi / 2, -math.pi / 2, math.pi / 2, 0.0)
    lengths = (0.36, 0.0, 0.42, 0.0, 0.4, 0.0, 0.126)
    reach = np.deg2rad([170.0, 120.0, 170.0, 120.0, 170.0, 120.0, 175.0])
    return SerialChain(
        tuple(DH(0.0, alpha, d) for alpha, d in zip(turns, lengths, strict=True)),
        lower=-reach,
        upper=reach,
        velocity=np.deg2rad([85.0, 85.0, 100.0, 75.0, 130.0, 135.0, 135.0]),
        acceleration=np.full(7, 15.0),
    )


@cache
def _ur5() -> Arm:
    ready = np.array([0.0, -1.2, 1.5, -1.8, -1.57, 0.0])
    return Arm("UR5", ur5_model(ur5(lower=ready - AROUND, upper=ready + AROUND)), ready)


@cache
def _iiwa() -> Arm:
    """Masses of iiwa_stack's description (IFL-CAMP); inertias as rods, motors and friction are assumptions."""
    ready = np.array([0.0, 0.6, 0.0, -1.4, 0.0, 1.0, 0.0])
    chain = iiwa().with_limits(lower=ready - AROUND, upper=ready + AROUND)
    masses = (4.0, 4.0, 3.0, 2.7, 1.7, 1.8, 0.3)
    strong, weak = np.array([1.0] * 4 + [0.0] * 3), np.array([0.0] * 4 + [1.0] * 3)
    model = ArmModel(
        chain,
        rods_along(chain, masses, radius=0.06),
        rotors=0.4 * strong + 0.1 * weak,
        torque_limit=np.array([320.0, 320.0, 176.0, 176.0, 110.0, 40.0, 40.0]),
        coulomb=3.0 * strong + 1.0 * weak,
        viscous=3.0 * strong + 1.0 * weak,
    )
    return Arm("iiwa 14", model, ready)


ARMS: Mapping[str, Callable[[], Arm]] = MappingProxyType({"ur5": _ur5, "iiwa": _iiwa})


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
