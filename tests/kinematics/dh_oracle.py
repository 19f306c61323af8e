"""Denavit-Hartenberg chains in plain numpy, from the definition A = Rz(theta) Tz(d) Tx(a) Rx(alpha)."""

from collections.abc import Sequence

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rehab_opt import DH, SerialChain

Array = NDArray[np.float64]


def turned(axis: str, angle: float) -> Array:
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler(axis, angle).as_matrix()
    return pose


def moved(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Array:
    pose = np.eye(4)
    pose[:3, 3] = x, y, z
    return pose


def row_pose(row: DH, value: float) -> Array:
    theta, d = (row.theta, row.d + value) if row.prismatic else (row.theta + value, row.d)
    return turned("z", theta) @ moved(z=d) @ moved(x=row.a) @ turned("x", row.alpha)


def chain_pose(rows: Sequence[DH], q: Array, base: Array, tool: Array) -> Array:
    pose = base
    for row, value in zip(rows, q, strict=True):
        pose = pose @ row_pose(row, value)
    return pose @ tool


def differentiated(chain: SerialChain, q: Array, h: float = 1e-6) -> Array:
    """Twist per unit of joint speed by central differences of the pose, angular part through the matrix logarithm."""
    columns = []
    for i in range(chain.n):
        step = np.zeros(chain.n)
        step[i] = h
        ahead, behind = chain.pose(q + step), chain.pose(q - step)
        turn = Rotation.from_matrix(ahead[:3, :3] @ behind[:3, :3].T).as_rotvec()
        columns.append(np.concatenate([ahead[:3, 3] - behind[:3, 3], turn]) / (2 * h))
    return np.stack(columns, axis=1)


lengths = st.floats(-0.6, 0.6)
angles = st.one_of(st.sampled_from([0.0, np.pi / 2, -np.pi / 2, np.pi]), st.floats(-np.pi, np.pi))
dh_rows = st.builds(DH, a=lengths, alpha=angles, d=lengths, theta=angles, prismatic=st.booleans())


@st.composite
def rigid_poses(draw: st.DrawFn) -> Array:
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec([draw(st.floats(-2, 2)) for _ in range(3)]).as_matrix()
    pose[:3, 3] = [draw(lengths) for _ in range(3)]
    return pose


one_to_nine = st.integers(1, 9)


@st.composite
def chains_with_joints(draw: st.DrawFn, sizes: st.SearchStrategy[int] = one_to_nine) -> tuple[SerialChain, Array]:
    """A chain without limits to speak of, and joint values for it."""
    n = draw(sizes)
    chain = SerialChain(
        tuple(draw(dh_rows) for _ in range(n)),
        lower=-np.inf,
        upper=np.inf,
        velocity=1.0,
        acceleration=np.inf,
        base=draw(rigid_poses()),
        tool=draw(rigid_poses()),
    )
    return chain, np.array([draw(st.floats(-3, 3)) for _ in range(n)])
