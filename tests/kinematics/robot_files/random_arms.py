"""Random arms, written as URDF and as MJCF from one description, and their kinematics in plain numpy."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

KINDS = ("revolute", "continuous", "prismatic", "fixed")
ROUNDED = (3.1416, 3.1415, 3.14159, 1.5708, -1.5708, 1.57079632679, -3.1416)


@dataclass
class Edge:
    """One joint and the link it carries."""

    name: str
    kind: str
    xyz: Array
    rpy: Array
    axis: Array
    lower: float
    upper: float
    velocity: float
    parent: str
    child: str
    mass: float
    centre: Array
    moments: Array
    extra: str = field(default="")

    def origin(self) -> Array:
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_euler("xyz", self.rpy).as_matrix()
        pose[:3, 3] = self.xyz
        return pose

    def motion(self, value: float) -> Array:
        pose = np.eye(4)
        if self.kind == "prismatic":
            pose[:3, 3] = value * self.axis
        elif self.kind != "fixed":
            pose[:3, :3] = Rotation.from_rotvec(value * self.axis).as_matrix()
        return pose


def random_arm(rng: np.random.Generator, joints: int) -> list[Edge]:
    """Edges from `base` on: so many joints that move, with fixed ones between, before and behind."""
    kinds: list[str] = []
    for _ in range(joints):
        kinds += ["fixed"] * int(rng.integers(0, 2))
        kinds.append(str(rng.choice(KINDS[:3], p=[0.6, 0.2, 0.2])))
    kinds += ["fixed"] * int(rng.integers(0, 3))
    edges, parent = [], "base"
    for i, kind in enumerate(kinds):
        child = f"link_{i}"
        edges.append(random_edge(rng, f"joint_{i}", kind, parent, child))
        parent = child
    return edges


def random_edge(rng: np.random.Generator, name: str, kind: str, parent: str, child: str) -> Edge:
    axis = rng.standard_normal(3)
    if rng.random() < 0.5:
        axis = rng.choice([-1.0, 1.0]) * np.eye(3)[rng.integers(3)]
    rpy = rng.uniform(-np.pi, np.pi, 3)
    if rng.random() < 0.5:
        rpy = rng.choice([0.0, *ROUNDED], 3)
    lower, upper = np.sort(rng.uniform(-3.0, 3.0, 2))
    return Edge(
        name, kind, rng.uniform(-0.5, 0.5, 3), rpy, axis / np.linalg.norm(axis), float(lower), float(upper),
        float(rng.uniform(0.5, 3.0)), parent, child, float(rng.uniform(0.2, 3.0)), rng.uniform(-0.1, 0.1, 3),
        rng.uniform(0.01, 0.02, 3),
    )  # fmt: skip


def urdf(edges: list[Edge], extra: str = "") -> str:
    """The arm as a URDF; a visual mesh that is nowhere is named, as in real files."""
    links = [f'<link name="base"/>{extra}']
    for edge in edges:
        ixx, iyy, izz = edge.moments.tolist()
        links.append(
            f'<link name="{edge.child}"><inertial><origin xyz="{numbers(edge.centre)}" rpy="0.1 0.2 0.3"/>'
            f'<mass value="{edge.mass!r}"/><inertia ixx="{ixx!r}" iyy="{iyy!r}" izz="{izz!r}" ixy="0" ixz="0" iyz="0"/>'
            '</inertial><visual><geometry><mesh filename="package://nowhere/a.stl"/></geometry></visual></link>'
        )
        moving = "" if edge.kind == "fixed" else f'<axis xyz="{numbers(edge.axis)}"/>'
        ends = f'lower="{edge.lower!r}" upper="{edge.upper!r}" ' if edge.kind != "continuous" else ""
        limit = "" if edge.kind == "fixed" else f'<limit {ends}effort="9" velocity="{edge.velocity!r}"/>'
        links.append(
            f'<joint name="{edge.name}" type="{edge.kind}"><parent link="{edge.parent}"/><child link="{edge.child}"/>'
            f'<origin xyz="{numbers(edge.xyz)}" rpy="{numbers(edge.rpy)}"/>{moving}{limit}{edge.extra}</joint>'
        )
    return f'<?xml version="1.0"?>\n<robot name="random">{"".join(links)}</robot>'


def numbers(values: Array) -> str:
    return " ".join(repr(float(value)) for value in values)


def pose_of(edges: list[Edge], q: Array) -> Array:
    """(4, 4) of the last link in `base`, from the edges themselves."""
    pose, values = np.eye(4), iter(q)
    for edge in edges:
        pose = pose @ edge.origin() @ edge.motion(0.0 if edge.kind == "fixed" else next(values))
    return pose


def moving(edges: list[Edge]) -> list[Edge]:
    return [edge for edge in edges if edge.kind != "fixed"]


def random_postures(edges: list[Edge], rng: np.random.Generator, count: int) -> Array:
    ends = [(-3.0, 3.0) if edge.kind == "continuous" else (edge.lower, edge.upper) for edge in moving(edges)]
    low, high = np.array(ends).T
    return rng.uniform(low, high, (count, len(ends)))
