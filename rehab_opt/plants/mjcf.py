"""MJCF model of a serial arm: each frame of the chain is a body, and the tool is a site."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rehab_opt.kinematics.body import Body
from rehab_opt.kinematics.link import ChainRow
from rehab_opt.plants.arm_model import ArmModel

__all__ = ["HAND", "arm_mjcf", "row_pose"]

Array = NDArray[np.float64]

HAND = "hand"
"""Name of the tool's site in the MJCF model."""
FAR = 1e6
"""Position [rad, m] that replaces an infinite mechanical stop."""
NEGLIGIBLE = 1e-9
"""Mass [kg] and inertia [kg m^2] of a massless link, because MuJoCo requires nonzero numbers."""


def arm_mjcf(model: ArmModel, *, step: float) -> str:
    """MJCF text of an arm without geometry, so that MuJoCo detects no collisions.

    Parameters
    ----------
    model : kinematics and dynamics of the arm. step : duration of a physics step [s].
    """
    chain = model.chain
    opened: list[str] = []
    placed: Array = chain.base
    for i in range(chain.n):
        row = chain.rows[i]
        here = row_pose(row, 0.0)
        place = placed @ here
        # Pose of the frame before the joint, in the frame after it; the joint moves about or along its z axis.
        back = np.asarray(np.linalg.inv(here), dtype=np.float64)
        kind = "slide" if row.prismatic else "hinge"
        opened.append(
            f'<body name="{chain.names[i]}" {_pose(place)}>'
            f"{_inertial([body for body in model.bodies if body.link == i + 1])}"
            f'<joint name="{chain.names[i]}" type="{kind}" pos="{_text(back[:3, 3])}" axis="{_text(back[:3, 2])}" '
            f'armature="{float(model.rotors[i])!r}" damping="{float(model.viscous[i])!r}" '
            f'frictionloss="{float(model.coulomb[i])!r}"{_stops(model, i)}/>'
        )
        placed = np.eye(4)
    site = f'<site name="{HAND}" {_pose(chain.tool)}/>'
    bodies = "\n".join(opened) + site + "</body>" * chain.n
    return (
        '<mujoco model="arm"><compiler angle="radian" autolimits="false" inertiafromgeom="false"/>'
        f'<option timestep="{step!r}" integrator="implicitfast" gravity="{_text(np.array(model.gravity))}">'
        '<flag contact="disable"/></option>'
        f"<worldbody>{bodies}</worldbody></mujoco>"
    )


def row_pose(row: ChainRow, value: float) -> Array:
    """Pose (4, 4) of a link in the frame of the link before, for the chain's `row` and a joint position [rad, m]."""
    joint = np.eye(4)
    if row.prismatic:
        joint[2, 3] = value
    else:
        cos, sin = np.cos(value), np.sin(value)
        joint[:2, :2] = [[cos, -sin], [sin, cos]]
    return np.asarray(joint @ np.array(row.after, dtype=np.float64))


def _stops(model: ArmModel, joint: int) -> str:
    if model.stops is None or not np.isfinite(model.stops[:, joint]).any():
        return ""
    low, high = np.clip(model.stops[:, joint], -FAR, FAR)
    return f' limited="true" range="{_text(np.array([low, high]))}"'


def _inertial(bodies: Sequence[Body]) -> str:
    """MJCF element of the combined mass, centre of mass and inertia of several bodies on one link."""
    mass = sum(body.mass for body in bodies)
    if not mass > 0.0:
        return (
            f'<inertial pos="0 0 0" mass="{NEGLIGIBLE!r}" diaginertia="{NEGLIGIBLE!r} {NEGLIGIBLE!r} {NEGLIGIBLE!r}"/>'
        )
    centre = sum((body.mass * np.asarray(body.centre) for body in bodies), np.zeros(3)) / mass
    total = NEGLIGIBLE * np.eye(3)
    for body in bodies:
        off = np.asarray(body.centre) - centre
        total = total + body.inertia + body.mass * (float(off @ off) * np.eye(3) - np.outer(off, off))
    full = [total[0, 0], total[1, 1], total[2, 2], total[0, 1], total[0, 2], total[1, 2]]
    return f'<inertial pos="{_text(centre)}" mass="{float(mass)!r}" fullinertia="{_text(np.array(full))}"/>'


def _pose(pose: Array) -> str:
    return f'pos="{_text(pose[:3, 3])}" quat="{_text(_quaternion(pose[:3, :3]))}"'


def _quaternion(rotation: Array) -> Array:
    """Quaternion (w, x, y, z) of a rotation (3, 3), computed as an eigenvector to be insensitive to rounding."""
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    matrix = np.array(
        [
            [a + e + i, h - f, c - g, d - b],
            [h - f, a - e - i, d + b, c + g],
            [c - g, d + b, e - a - i, f + h],
            [d - b, c + g, f + h, i - a - e],
        ]
    )
    return np.asarray(np.linalg.eigh(matrix)[1][:, -1])


def _text(numbers: Array) -> str:
    return " ".join(repr(float(number)) for number in numbers)
