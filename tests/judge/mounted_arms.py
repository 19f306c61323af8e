"""Arms from robot files on the chair, drawn and written as a URDF, with the judge's own kinematics of them.

An arm has four to seven joints. Its links are capsules of the file's frames, or segments from joint to joint.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rehab_opt import Capsule, CapsuleOnLink, SerialChain, arm_on_chair
from tests.judge.chair_robot import Chair, jacobian_of, placed, segments_apart

Array = NDArray[np.float64]

KEEP_OUT = (
    Capsule("trunk and head", (-0.15, 0.0, 0.55), (-0.15, 0.0, 1.25), 0.18),
    Capsule("legs", (-0.10, 0.0, 0.55), (0.40, 0.0, 0.50), 0.18),
)
RADIUS = 0.05
"""[m] Of a link that has no capsule of its own."""
NEAR, ROUNDING = 0.0025, 1e-9
AXES = np.eye(3)
SINGULAR = 1e-3
"""[m, rad] Of the hand for a rad: rows in which it moves less at every posture drawn are not independent."""


@dataclass(frozen=True, kw_only=True)
class Mounted(Chair):
    """A chair with an arm from a file, of n joints, in place of ARDIS: arrays of 3 + n."""

    base: Array
    """(4, 4) of the arm's first link in the chassis frame."""
    origins: Array
    """(n + 1, 3) of each joint, and of the tool, in the link before [m]."""
    turns: Array
    """(n, 3) roll, pitch and yaw of each joint in the link before [rad]."""
    axes: Array
    """(n, 3) unit vectors."""
    capsules: tuple[tuple[int, Array, float], ...]
    """Joint whose link it is (from 1), both ends (2, 3) [m] in that link, radius [m]."""

    @property
    def n(self) -> int:
        """How many joints of the arm."""
        return len(self.axes)

    def urdf(self) -> str:
        """The file."""
        text = ['<robot name="drawn"><link name="link0"/>']
        for i in range(self.n):
            xyz, rpy, axis = (" ".join(map(repr, each[i].tolist())) for each in (self.origins, self.turns, self.axes))
            text.append(
                f'<link name="link{i + 1}"><inertial><origin xyz="0 0 0.05"/><mass value="1.0"/><inertia ixx="0.01" '
                f'ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link><joint name="joint{i + 1}" '
                f'type="revolute"><parent link="link{i}"/><child link="link{i + 1}"/><origin xyz="{xyz}" rpy="{rpy}"/>'
                f'<axis xyz="{axis}"/><limit lower="{self.lower[i]}" upper="{self.upper[i]}" effort="50" '
                f'velocity="{self.velocity[3 + i]}"/></joint>'
            )
        xyz = " ".join(map(repr, self.origins[-1].tolist()))
        text.append(
            f'<link name="tool"/><joint name="mounted" type="fixed"><parent link="link{self.n}"/><child link="tool"/>'
            f'<origin xyz="{xyz}"/></joint></robot>'
        )
        return "".join(text)

    def robot(self) -> Any:
        """What the public constructors make of the same numbers."""
        capsules = [CapsuleOnLink(f"link{i}", tuple(ends[0].tolist()), tuple(ends[1].tolist()), radius)  # type: ignore[arg-type]
                    for i, ends, radius in self.capsules]  # fmt: skip
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "drawn.urdf"
            file.write_text(self.urdf(), encoding="utf-8")
            chain = SerialChain.from_urdf(file, tip="tool", acceleration=self.acceleration[3:], capsules=capsules)
        return arm_on_chair(chain, mount=self.base, keep_out=KEEP_OUT)

    def links(self, q: Array) -> list[Array]:
        """(n + 2) poses (..., 4, 4) in the chassis frame: first link, the others, the tool."""
        pose = np.broadcast_to(self.base, (*q.shape[:-1], 4, 4))
        found = [pose]
        for i in range(self.n):
            fixed = np.eye(4)
            fixed[:3, :3], fixed[:3, 3] = rolled_pitched_yawed(self.turns[i]), self.origins[i]
            pose = pose @ fixed @ turned_about(self.axes[i], q[..., 3 + i])
            found.append(pose)
        tool = np.eye(4)
        tool[:3, 3] = self.origins[-1]
        return [*found, pose @ tool]

    def bodies(self, q: Array) -> list[tuple[Array, Array, float]]:
        """Both ends (..., 3) in the chassis frame and radius [m] of each link."""
        poses = self.links(q)
        if self.capsules:
            return [
                (*(poses[i][..., :3, :3] @ end + poses[i][..., :3, 3] for end in ends), radius)
                for i, ends, radius in self.capsules
            ]
        places = [pose[..., :3, 3] for pose in poses[1:]]
        return [(one, other, RADIUS) for one, other in pairwise(places) if np.abs(one - other).max() > ROUNDING]

    @property
    def radii(self) -> Array:
        """[m] of link and keep-out together, in the order of `arm_gaps`."""
        return np.array([radius + 0.18 for *_, radius in self.bodies(np.zeros(3 + self.n)) for _ in KEEP_OUT])

    def arm_gaps(self, q: Array) -> Array:
        """(..., k) [m] of links and keep-outs; negative inside."""
        return np.stack(
            [
                segments_apart(one, other, np.array(body.start), np.array(body.end)) - body.radius - radius
                for one, other, radius in self.bodies(q)
                for body in KEEP_OUT
            ],
            -1,
        )

    def elbow(self, q: Array, frame: int) -> Array:
        """(..., 3) [m] of the joint at that frame of the chain in the world."""
        return placed(self.links(q)[frame - 2][..., :3, 3], q)

    def hand(self, q: Array) -> Array:
        """(..., 3) place of the hand in the world [m]."""
        return placed(self.links(q)[-1][..., :3, 3], q)

    def orientation(self, q: Array) -> Array:
        """(..., 3, 3) of the hand in the world."""
        return np.asarray(turned_about(AXES[2], q[..., 2])[..., :3, :3] @ self.links(q)[-1][..., :3, :3])

    def jacobian(self, q: Array) -> Array:
        """(..., 7, 3 + n) rows `ROWS` in the chassis frame, by u."""
        poses = self.links(q)
        axes = [pose[..., :3, :3] @ axis for pose, axis in zip(poses[1:-1], self.axes, strict=True)]
        origins = [pose[..., :3, 3] for pose in poses[1:-1]]
        return jacobian_of(poses[-1][..., :3, 3], poses[-1][..., :3, 2], list(zip(axes, origins, strict=True)))

    def free_posture(self, rng: np.random.Generator) -> Array | None:
        """(n,) joints off keep-outs, near one if the drawn ones are; None where there are none."""
        q = np.zeros((300, 3 + self.n))
        q[:, 3:] = rng.uniform(self.lower, self.upper, (300, self.n))
        nearest = self.arm_gaps(q).min(axis=1)
        free = np.flatnonzero(nearest > NEAR)[:8]
        return np.asarray(q[free[nearest[free].argmin()], 3:]) if len(free) else None

    def moves_in(self, rows: tuple[str, ...]) -> bool:
        """Whether the hand can be moved in all rows at once somewhere: an arm of one axis cannot."""
        q = np.zeros((8, 3 + self.n))
        q[:, 3:] = np.random.default_rng(0).uniform(self.lower, self.upper, (8, self.n))
        moves = self.task(q, rows, "chassis")[..., self.moving]
        return bool((np.linalg.svd(moves, compute_uv=False).min(axis=-1) > SINGULAR).any())


def rolled_pitched_yawed(angles: Array) -> Array:
    """(3, 3) yaw @ pitch @ roll [rad]."""
    roll, pitch, yaw = (turned_about(axis, np.array(angle))[:3, :3] for axis, angle in zip(AXES, angles, strict=True))
    return np.asarray(yaw @ pitch @ roll)


def turned_about(axis: Array, angle: Array) -> Array:
    """(..., 4, 4) by angles (...) [rad] about a unit vector: Rodrigues."""
    across = np.cross(axis, AXES).T
    sine, cosine = np.sin(angle)[..., None, None], np.cos(angle)[..., None, None]
    found = np.zeros((*np.shape(angle), 4, 4))
    found[..., :3, :3] = AXES + sine * across + (1 - cosine) * across @ across
    found[..., 3, 3] = 1.0
    return found


def drawn(rng: np.random.Generator, drive: str) -> Mounted:
    """An arm beside the seat, with capsules of its own or without."""
    bodies = bool(rng.random() < 0.7)
    n = int(rng.choice([4, 5, 6, 7]))
    lengths = rng.dirichlet(np.full(n + 1, 2.0)) * rng.uniform(0.7, 1.1)
    lengths[1:-1][rng.random(n - 1) < 0.3] = 0.0
    origins = np.zeros((n + 1, 3))
    origins[1:, 2], origins[-1, 2] = lengths[1:], max(lengths[-1], 0.1)
    origins[1:, 0] = rng.choice([0.0, 0.0, 0.04], n)
    axes, last = np.zeros((n, 3)), -1
    for i in range(n):
        last = int(rng.choice([each for each in range(3) if each != last]))
        axes[i] = AXES[last] * rng.choice([-1.0, 1.0]) + (0.1 * rng.standard_normal(3) if rng.random() < 0.3 else 0.0)
    mount = np.eye(4)
    mount[:3, :3] = rolled_pitched_yawed(rng.choice([0.0, 0.0, math.pi / 2, -0.4], 3))
    mount[:3, 3] = rng.uniform([0.0, -0.5, 0.5], [0.35, -0.38, 0.8])
    velocity = rng.uniform(0.5, 2.0, n)
    capsules = [
        (i, np.array([np.zeros(3), origins[i]]) + rng.uniform(-0.03, 0.03, 3), float(rng.uniform(0.03, 0.07)))
        for i in range(1, n + 1)
        if i == n or np.linalg.norm(origins[i]) > 0.1
    ]
    turns = rng.choice([0.0, 0.0, 0.0, math.pi / 2, 0.3], (n, 3))
    lower, upper = -rng.uniform(1.0, 3.0, n), rng.uniform(1.0, 3.0, n)
    acceleration = velocity / rng.uniform(0.15, 0.8, n)
    return Mounted(
        drive=drive, lower=lower, upper=upper, velocity=np.append([0.8, 0.8, 1.0], velocity),
        acceleration=np.append([1.0, 1.0, 1.5], acceleration), base=mount, origins=origins, turns=turns,
        axes=axes / np.linalg.norm(axes, axis=1)[:, None], capsules=tuple(capsules) if bodies else (),
    )  # fmt: skip


def mounted(rng: np.random.Generator, drive: str, sets: Sequence[tuple[str, ...]]) -> tuple[Mounted, Array]:
    """A chair with an arm from a file whose hand can be moved in these rows, and joints (n,) near a keep-out."""
    while True:
        chair = drawn(rng, drive)
        joints = chair.free_posture(rng)
        if joints is not None and all(map(chair.moves_in, sets)):
            return chair, joints
