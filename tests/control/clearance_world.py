"""Random robots among random bodies, with kinematics and distances that owe nothing to the library's."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from rehab_opt import DH, Box, Capsule, Clearance, KeepOut, LinkCapsule, MovingCapsule, SerialChain, ur5

Array = NDArray[np.float64]
PANDA = Path(__file__).parents[2] / "problems" / "robots" / "franka_panda" / "panda.urdf"
MARGIN = 0.02
"""[m]"""


def with_capsules(chain: SerialChain, radius: float) -> SerialChain:
    """A capsule from every frame's origin to the one before it: constant in the frame, since joints turn about z."""
    links = []
    for i, row in enumerate(chain.rows, start=1):
        after = np.asarray(row.after, dtype=float)
        before = -after[:3, :3].T @ after[:3, 3]
        if np.linalg.norm(before) > 0.03:
            links.append(LinkCapsule(f"link_{i}", i, tuple(before), (0.0, 0.0, 0.0), radius))
    hand = (0.0, 0.0, 0.0), (0.0, 0.0, 0.08)
    links.append(LinkCapsule("hand", chain.n, *hand, radius))
    return SerialChain(
        chain.rows, lower=chain.lower, upper=chain.upper, velocity=chain.velocity, acceleration=chain.acceleration,
        names=chain.names, base=chain.base, tool=chain.tool, capsules=tuple(links),
    )  # fmt: skip


def robot(kind: str, rng: np.random.Generator) -> SerialChain:
    """A UR5, a Panda from its URDF, or a random arm of six or seven joints."""
    if kind == "ur5":
        return ur5(velocity=2.0)
    if kind == "panda":
        arm = SerialChain.from_urdf(PANDA, tip="panda_link8", acceleration=7.5, velocity=2.0)
        return with_capsules(arm, 0.06)
    n = 6 if kind == "six" else 7
    alphas = rng.permutation([np.pi / 2, -np.pi / 2, 0.0, np.pi / 2, -np.pi / 2, np.pi / 2, -np.pi / 2])[:n]
    alphas[0] = np.pi / 2
    lengths = rng.uniform(0.12, 0.4, n) * np.r_[1, np.ones(n - 3), 0.4, 0.4]
    rows = [
        DH(a=length, alpha=alpha, d=0.0) if rng.random() < 0.5 else DH(a=0.0, alpha=alpha, d=length)
        for length, alpha in zip(lengths, alphas, strict=True)
    ]
    limits = rng.uniform(1.8, 3.1, n)
    plain = SerialChain(
        tuple(rows), lower=-limits, upper=limits, velocity=rng.uniform(1.0, 2.5, n), acceleration=rng.uniform(6, 20, n)
    )
    return with_capsules(plain, float(rng.uniform(0.03, 0.06)))


def room(chain: SerialChain, rng: np.random.Generator, *, moving: int) -> Clearance:
    """A floor, a post, a bar and boxes about the arm."""
    angles, away = rng.uniform(0, 2 * np.pi, 3), rng.uniform(0.45, 0.9, 3)  # none is where no joint leads away
    places = np.column_stack([away * np.cos(angles), away * np.sin(angles), rng.uniform(0.0, 0.8, 3)])
    bases = places[:2]
    bars = [
        Capsule(f"bar {i}", tuple(base), tuple(base + rng.uniform(-0.2, 0.2, 3) * [1, 1, 3]), rng.uniform(0.02, 0.06))
        for i, base in enumerate(bases)
    ]
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.random(rng=rng).as_matrix(), places[2]
    floor = KeepOut.through([0, 0, -rng.uniform(0.1, 0.4)], [*rng.uniform(-0.2, 0.2, 2), 1.0])
    return Clearance(
        margin=MARGIN,
        planes=[floor],
        capsules=bars,
        boxes=[Box.at("box", pose, rng.uniform(0.1, 0.4, 3))],
        moving=moving,
    )


def frames(chain: SerialChain, q: Array) -> list[Array]:
    """Poses (N, 4, 4) at q (N, n), in the order of a capsule's `frame`."""
    poses = [np.broadcast_to(chain.base, (len(q), 4, 4))]
    for row, angle in zip(chain.rows, q.T, strict=True):
        joint = np.tile(np.eye(4), (len(q), 1, 1))
        if row.prismatic:
            joint[:, 2, 3] = angle
        else:
            joint[:, :3, :3] = Rotation.from_euler("z", angle[:, None]).as_matrix()
        poses.append(poses[-1] @ joint @ np.asarray(row.after, dtype=float))
    return [*poses, poses[-1] @ chain.tool]


def link_ends(chain: SerialChain, q: Array) -> Array:
    """(N, links, 2, 3) [m]"""
    poses = frames(chain, q)
    ends = [
        np.stack(
            [poses[each.frame][:, :3, :3] @ end + poses[each.frame][:, :3, 3] for end in (each.start, each.end)], 1
        )
        for each in chain.capsules
    ]
    return np.stack(ends, 1)


@dataclass
class Swinging:
    """Bodies that move on smooth ways no faster than `speed`, and stop where they are told to."""

    middles: Array
    swings: Array
    phases: Array
    axes: Array
    speed: float

    @classmethod
    def drawn(cls, rng: np.random.Generator, count: int, speed: float) -> Swinging:
        middles = rng.normal(size=(count, 3))
        middles *= rng.uniform(0.35, 0.8, (count, 1)) / np.linalg.norm(middles, axis=1, keepdims=True)
        middles[:, 2] = np.abs(middles[:, 2])
        return cls(
            middles,
            rng.normal(size=(count, 3)) * 0.2,
            rng.uniform(0, 6, count),
            rng.normal(size=(count, 3)) * 0.15,
            speed,
        )

    def at(self, clock: Array, going: Array) -> list[MovingCapsule]:
        """Capsules at each one's own clock [s]; they move on by it where they are `going`."""
        found = []
        for middle, swing, phase, axis, t, moves in zip(
            self.middles, self.swings, self.phases, self.axes, clock, going, strict=True
        ):
            rate = 0.9 * self.speed / (np.linalg.norm(swing) + np.linalg.norm(axis))
            place, way = middle + swing * np.sin(rate * t + phase), swing * rate * np.cos(rate * t + phase) * moves
            tilt, turning = axis * np.cos(rate * t), -axis * rate * np.sin(rate * t) * moves
            found.append(MovingCapsule(place - tilt, place + tilt, 0.05, way - turning, way + turning))
        return found


def segments_apart(a: Array, b: Array, c: Array, d: Array) -> float:
    """[m] by bounded least squares, for segments that are no points."""
    found = lsq_linear(np.column_stack([b - a, c - d]), c - a, bounds=(0, 1), method="bvls", tol=1e-15)
    return float(np.linalg.norm(found.fun))


def box_apart(a: Array, b: Array, box: Box) -> float:
    """[m] of a segment and a box, negative by the shortest way out where it cuts the box."""
    turn, half = np.array(box.turn), np.array(box.size) / 2
    p, q = ((end - np.array(box.centre)) @ turn for end in (a, b))
    lower, upper = np.r_[0, -half], np.r_[1, half]
    found = lsq_linear(np.column_stack([q - p, -np.eye(3)]), -p, bounds=(lower, upper), method="bvls", tol=1e-15)
    apart = float(np.linalg.norm(found.fun))
    if apart > 1e-9:
        return apart
    corners = half * np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T
    hull = ConvexHull(np.vstack([corners - p, corners - q]))
    return float(hull.equations[:, -1].max())


def least_distance(
    chain: SerialChain, given: Clearance, ends: Array, moving: list[MovingCapsule], links: Array
) -> float:
    """[m] of every link of `links` from the room, less the margin; ends (links, 2, 3)."""
    found: list[float] = []
    for i in links:
        (a, b), radius = ends[i], chain.capsules[i].radius + given.margin
        bodies = [*given.capsules, *moving]
        found += [min(a @ each.normal, b @ each.normal) - each.offset - radius for each in given.planes]
        found += [box_apart(a, b, box) - radius for box in given.boxes]
        found += [segments_apart(a, b, np.array(c.start), np.array(c.end)) - radius - c.radius for c in bodies]
    return min(found)
