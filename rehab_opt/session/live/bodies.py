"""Shapes that the page of `rehab-opt live` draws: arms as coloured capsules, boxes and planes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from rehab_opt.control.clearance import Clearance
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.kinematics.link_capsules import LinkCapsule
from rehab_opt.kinematics.room import Box, KeepOut
from rehab_opt.session.outcome import Array

BLUE, ORANGE, GREEN, RED, AMBER, GREY, PURPLE, ROBOT = (
    "#0072b2", "#e69f00", "#2e9e6b", "#d1495b", "#e9b44c", "#8d99a6", "#9b5fc0", "#b9c4cf",
)  # fmt: skip
WIDE = 0.5
"""Half the edge length [m] of the square that represents a plane."""
LIT = "#aab5c0"
STICK = 0.035
"""Radius [m] of the links of an arm without capsules."""
SHORT = 1e-6
"""Distance [m] of two frames below which no link is drawn between them."""
CLOSE, AWAY = math.radians(5.0), math.radians(20.0)
"""Margins [rad] to a joint limit: a joint is red below the first and amber below the second."""


def near_limit(margin: float) -> str:
    """Colour of a joint with this margin [rad] to its limits."""
    if not margin > CLOSE:
        return RED
    return AMBER if margin <= AWAY else GREEN


def joint_rows(chain: SerialChain) -> list[dict[str, Any]]:
    """Names and limits [rad, m] of the joints that can move, for the bars of the page."""
    return [
        {"index": i, "name": name.replace("_", " "), "lower": low, "upper": high, "angle": not chain.rows[i].prismatic}
        for i, (name, low, high) in enumerate(zip(chain.names, chain.lower.tolist(), chain.upper.tolist(), strict=True))
        if low < high
    ]


def screen(points: Array) -> dict[str, Any]:
    """The plane in which the participant's page shows a path (N, 3) [m]: centre, axes u and v, half width [m].

    The plane is the one closest to the path. v points up; in a horizontal plane it points along y.
    """
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    normal = np.linalg.svd(points - centre, full_matrices=True)[2][2]
    upright = abs(normal[2]) < 0.8
    v = np.array([0.0, 0.0, 1.0]) if upright else np.array([0.0, 1.0, 0.0])
    v = v - (v @ normal) * normal
    v /= np.linalg.norm(v)
    u = np.cross(v, normal if normal[2] + (normal[0] if upright else 0.0) > 0 else -normal)
    half = 1.4 * float(np.abs((points - centre) @ np.column_stack([u, v])).max(initial=0.05))
    return {"centre": centre.tolist(), "u": u.tolist(), "v": v.tolist(), "half": half}


def kept_off(middle: Array, bodies: Sequence[Clearance], planes: Sequence[KeepOut] = ()) -> dict[str, Any]:
    """Shapes of the bodies and planes that an arm avoids; planes are drawn as squares around `middle` (3,) [m]."""
    planes = [*planes, *(plane for each in bodies for plane in each.planes)]
    told = (
        (planes, RED, "planes to keep off"),
        (any(each.boxes or each.capsules for each in bodies), GREY, "bodies to keep off"),
        (any(each.moving for each in bodies), PURPLE, "those that move"),
    )
    return {
        "lines": [{"points": [*square, square[0]], "colour": RED} for square in (_square(p, middle) for p in planes)],
        "fills": [
            {"points": side.round(4).tolist(), "colour": LIT if side[:, 2].min() > box.centre[2] else GREY}
            for each in bodies
            for box in each.boxes
            for side in sides(box)
        ],
        "capsules": [[*body.start, *body.end, body.radius, GREY] for each in bodies for body in each.capsules],
        "legend": [[colour, name] for there, colour, name in told if there],
    }


def moving_rows(told: Array) -> list[list[Any]]:
    """Capsules of k moving bodies, from the data (k, 14) of `moving_numbers`."""
    return [[*each[:6].round(4).tolist(), float(each[12]), PURPLE] for each in told]


def sides(box: Box) -> Array:
    """Corners (6, 4, 3) [m] of the six sides of a box."""
    x, y, z = (np.array(box.turn) * box.size / 2).T
    ways = ((x, y, z), (-x, y, z), (y, z, x), (-y, z, x), (z, x, y), (-z, x, y))
    return np.array([_rectangle(box.centre + out, u, v) for out, u, v in ways])


def _square(plane: KeepOut, middle: Array) -> list[list[float]]:
    normal = np.array(plane.normal)
    u = np.cross(normal, [0.0, 0.0, 1.0] if abs(normal[2]) < 0.9 else [1.0, 0.0, 0.0])
    u *= WIDE / np.linalg.norm(u)
    foot = middle - (normal @ middle - plane.offset) * normal
    square: list[list[float]] = _rectangle(foot, u, np.cross(normal, u)).round(4).tolist()
    return square


def _rectangle(middle: Array, u: Array, v: Array) -> Array:
    return np.asarray(middle + np.array([u + v, u - v, -u - v, v - u]))


class ArmBodies:
    """Capsules of an arm at any joint positions; an arm without capsules gets sticks between its joints.

    Parameters
    ----------
    chain : kinematics of the arm. radius : radius of the sticks [m]. first : number of base joints without a stick.
    """

    def __init__(self, chain: SerialChain, *, radius: float = STICK, first: int = 0) -> None:
        self.chain, self._radius, self._first = chain, radius, first
        q = ca.SX.sym("q", chain.n)
        frames = [ca.densify(each[:3, :]) for each in chain.frames_expression(q)]
        self._frames = ca.Function("frames", [q], [ca.horzcat(*frames)], {"cse": True})
        self._capsules: Sequence[LinkCapsule] = chain.capsules

    def frames(self, q: ArrayLike) -> Array:
        """Poses (n + 2, 3, 4) of the base, of each joint and of the tool, at joint positions q (n,)."""
        return (
            np.array(self._frames(np.asarray(q, dtype=np.float64))).reshape(3, self.chain.n + 2, 4).transpose(1, 0, 2)
        )

    def capsules(self, q: ArrayLike, colours: Sequence[str] | str = ROBOT) -> list[list[Any]]:
        """Capsules at joint positions q (n,), each with start, end, radius [m] and colour.

        `colours` is one colour for all links, or one for each joint and its link.
        """
        frames = self.frames(q)
        if self._capsules:
            bodies = [
                (i, *(frames[i][:, :3] @ end + frames[i][:, 3] for end in (each.start, each.end)), each.radius)
                for i, each in ((each.frame, each) for each in self._capsules)
            ]
        else:
            points = frames[self._first :, :, 3]
            bodies = [
                (i + self._first, a, b, self._radius)
                for i, (a, b) in enumerate(pairwise(points))
                if np.linalg.norm(b - a) > SHORT
            ]
        of = [colours] if isinstance(colours, str) else colours
        return [
            [*a.round(4).tolist(), *b.round(4).tolist(), radius, of[min(max(frame - 1, 0), len(of) - 1)]]
            for frame, a, b, radius in bodies
        ]

    def tool(self, q: ArrayLike) -> Array:
        """Pose (3, 4) of the tool, without the last row, at joint positions q (n,)."""
        return np.asarray(self.frames(q)[-1])
