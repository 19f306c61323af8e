"""Places, speeds and manipulability of many postures at once, in plain numpy: no judge shares code with the judged."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rehab_opt import KeepOut, SerialChain

__all__ = ["frames", "heights", "jacobians", "manipulabilities"]

Array = NDArray[np.float64]


def frames(chain: SerialChain, q: Array) -> Array:
    """(N, n + 2, 4, 4) of postures q (N, n): before joint 1, behind each row, and the tool."""
    found = [np.broadcast_to(chain.base, (len(q), 4, 4))]
    for row, values in zip(chain.rows, q.T, strict=True):
        theta, d = (row.theta, row.d + values) if row.prismatic else (row.theta + values, row.d)
        ct, st, ca, sa = np.cos(theta), np.sin(theta), np.cos(row.alpha), np.sin(row.alpha)
        step = np.zeros((len(q), 4, 4))
        step[:, 0, 0], step[:, 0, 1], step[:, 0, 2], step[:, 0, 3] = ct, -st * ca, st * sa, row.a * ct
        step[:, 1, 0], step[:, 1, 1], step[:, 1, 2], step[:, 1, 3] = st, ct * ca, -ct * sa, row.a * st
        step[:, 2, 1], step[:, 2, 2], step[:, 2, 3], step[:, 3, 3] = sa, ca, d, 1.0
        found.append(found[-1] @ step)
    found.append(found[-1] @ chain.tool)
    return np.stack(found, axis=1)


def jacobians(chain: SerialChain, q: Array) -> Array:
    """(N, 6, n) geometric Jacobians of the tool, linear rows first, of chains whose joints all turn."""
    at = frames(chain, q)
    axes, origins = at[:, : chain.n, :3, 2], at[:, : chain.n, :3, 3]
    linear = np.cross(axes, at[:, -1:, :3, 3] - origins)
    return np.concatenate([linear, axes], axis=2).transpose(0, 2, 1)


def manipulabilities(chain: SerialChain, q: Array) -> Array:
    """(N,) Yoshikawa's measure, from six joints on."""
    moves = jacobians(chain, q)
    squares = np.linalg.det(moves @ moves.transpose(0, 2, 1))
    return np.asarray(np.sqrt(np.maximum(squares, 0.0)))


def heights(chain: SerialChain, q: Array, plane: KeepOut) -> Array:
    """(N,) [m] of what is lowest above a plane: joints' frames that move, and the ends of the links' capsules."""
    at, normal = frames(chain, q), np.array(plane.normal)
    found = [at[:, i, :3, 3] @ normal for i in range(2, chain.n + 2)]
    for capsule in chain.capsules:
        if capsule.frame >= 2:
            for end in (capsule.start, capsule.end):
                centre = at[:, capsule.frame, :3, :3] @ np.array(end) + at[:, capsule.frame, :3, 3]
                found.append(centre @ normal - capsule.radius)
    lowest: Array = np.min(found, axis=0) - plane.offset
    return lowest
