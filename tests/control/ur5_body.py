"""The UR5 once more, for judging: products of exponentials in plain numpy, its links' surfaces as points.

Axes and places are those of the vendor's drawing at q = 0, where the arm is stretched along -x: no Denavit-Hartenberg
row and no frame of the package is in it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

Z, BACK, DOWN = np.array([0, 0, 1.0]), np.array([0, -1.0, 0]), np.array([0, 0, -1.0])
HEIGHT, ELBOW, WRIST = 0.089159, -0.425, -0.425 - 0.39225
LOW = HEIGHT - 0.09465
AXES = np.array([Z, BACK, BACK, BACK, DOWN, BACK])
PLACES = np.array(
    [[0, 0, 0], [0, 0, HEIGHT], [ELBOW, 0, HEIGHT], [WRIST, 0, HEIGHT], [WRIST, -0.10915, 0], [WRIST, 0, LOW]]
)
"""A point of each axis [m]."""
FLANGE = np.array([WRIST, -0.10915 - 0.0823, LOW])
ORIENTATION = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])
"""Of the flange at q = 0."""
AT = np.array([0, -0.10915, 0]) + PLACES[3], np.array([0, -0.10915, 0]) + PLACES[5]
"""Where the axes of the wrist meet."""
CAPSULES = {
    "shoulder": (1, [0, 0, HEIGHT], [0, -0.149, HEIGHT], 0.073),
    "upper_arm": (2, [0, -0.149, HEIGHT], [ELBOW, -0.149, HEIGHT], 0.073),
    "elbow": (2, [ELBOW, -0.149, HEIGHT], [ELBOW, 0, HEIGHT], 0.073),
    "forearm": (3, [ELBOW, 0, HEIGHT], [WRIST, 0, HEIGHT], 0.066),
    "wrist_1": (4, [WRIST, 0, HEIGHT], AT[0], 0.066),
    "wrist_2": (5, AT[0], AT[1], 0.066),
    "wrist_3": (5, AT[1], AT[1] + [0, -0.025, 0], 0.066),
}
"""Joints that move it, ends [m] at q = 0, radius [m]."""
TUBES = {
    "upper_arm": (2, [0, -0.13585, HEIGHT], [ELBOW, -0.13585, HEIGHT], 0.054),
    "forearm": (3, [ELBOW, -0.0165, HEIGHT], [WRIST, -0.0165, HEIGHT], 0.040),
    "wrist_3": (6, AT[1] + [0, -0.05, 0], FLANGE, 0.030),
}
"""Of the vendor's physical_parameters.yaml, "manually measured"; flat at their ends."""


SKEW = [np.cross(np.eye(3), axis) for axis in AXES]
SQUARE = [each @ each for each in SKEW]


def turns(q: Array) -> list[tuple[Array, Array]]:
    """Rotation (..., 3, 3) and shift (..., 3) of what the first 0, 1, ... n joints move, from where it is at q = 0.

    q is (..., 6) here and below: one posture, or many at once.
    """
    rotation, shift = np.broadcast_to(np.eye(3), (*q.shape[:-1], 3, 3)), np.zeros((*q.shape[:-1], 3))
    moved = [(rotation, shift)]
    for i, place in enumerate(PLACES):
        sine, versine = np.sin(q[..., i, None, None]), 1 - np.cos(q[..., i, None, None])
        turn = np.eye(3) + sine * SKEW[i] + versine * SQUARE[i]
        shift = shift + np.einsum("...ij,...j->...i", rotation, place - turn @ place)
        rotation = rotation @ turn
        moved.append((rotation, shift))
    return moved


def tool_motion(q: Array, v: Array, tool: Array) -> tuple[Array, Array]:
    """(..., 3) [m] and [m/s] of a tool at `tool` (3,) in the flange's frame, at joint velocities (..., 6)."""
    place, speed = FLANGE + ORIENTATION @ tool + np.zeros((*q.shape[:-1], 3)), np.zeros((*q.shape[:-1], 3))
    for i in reversed(range(6)):  # turned by the last joint first
        sine, versine = np.sin(q[..., i, None]), 1 - np.cos(q[..., i, None])
        place, speed = (
            each + sine * (each @ SKEW[i].T) + versine * (each @ SQUARE[i].T) for each in (place - PLACES[i], speed)
        )
        place, speed = place + PLACES[i], speed + v[..., i, None] * (place @ SKEW[i].T)
    return place, speed


def ball_surface(count: int) -> Array:
    """(count, 3) unit vectors, spread evenly."""
    k = np.arange(count) + 0.5
    z, angle = 1 - 2 * k / count, np.pi * (1 + 5**0.5) * k
    return np.stack([np.sqrt(1 - z * z) * np.cos(angle), np.sqrt(1 - z * z) * np.sin(angle), z], axis=1)


def surface(shape: tuple[int, object, object, float], *, flat: bool) -> tuple[int, Array]:
    """Joints that move it, and points (N, 3) of its surface at q = 0, both ends' among them."""
    joints, start, end, radius = shape
    a, b = np.array(start, dtype=float), np.array(end, dtype=float)
    around = ball_surface(80)
    if flat:  # a cylinder's rims and rings
        axis = (b - a) / np.linalg.norm(b - a)
        around = around - np.outer(around @ axis, axis)
        around = around / np.linalg.norm(around, axis=1, keepdims=True)
    along = np.linspace(0, 1, 5)[:, None, None]
    return joints, (a + along * (b - a) + radius * around).reshape(-1, 3)


SURFACES = {
    **{name: surface(shape, flat=False) for name, shape in CAPSULES.items()},
    **{f"tube of {name}": surface(shape, flat=True) for name, shape in TUBES.items()},
}


def heights(q: Array, normal: Array, offset: float, tool: Array) -> dict[str, Array]:
    """(..., N) [m] above a plane of each link's points, and of the tool's."""
    moved = turns(q)
    # A point is x = R p + t, its height n'x = (R'n)'p + n't.
    found = {
        name: (normal @ moved[k][0]) @ points.T + (moved[k][1] @ normal)[..., None] - offset
        for name, (k, points) in SURFACES.items()
    }
    flange, place = (tool_motion(q, np.zeros_like(q), each)[0] @ normal for each in (np.zeros(3), tool))
    found["tool"] = np.linspace(flange, place, 5, axis=-1) - offset
    return found


def clearances(q: Array, normal: Array, offset: float, tool: Array) -> dict[str, Array]:
    """(...) [m] of each whole link above a plane, exactly; the line from the flange to the tool is the last link's."""
    moved = turns(q)
    found = {}
    for name, (k, *ends, radius) in CAPSULES.items():
        above = (normal @ moved[k][0]) @ np.array(ends, dtype=float).T + (moved[k][1] @ normal)[..., None]
        found[name] = above.min(axis=-1) - radius - offset
    tip = tool_motion(q, np.zeros_like(q), tool)[0] @ normal - offset
    return {**found, "tool": np.minimum(tip, found["wrist_3"])}
