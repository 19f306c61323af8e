"""Serial chains written as URDF and MJCF, so that every library computes with the same kinematics and limits."""

from __future__ import annotations

import math

from rehab_opt import DH, SerialChain

__all__ = ["HAND", "mjcf", "urdf"]

HAND = "hand"
"""Name of the tool frame in both descriptions."""

# Differential inverse kinematics needs no dynamics, but MuJoCo refuses a moving body without mass.
_INERTIA = 'ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"'


def urdf(chain: SerialChain, *, robot: str = "arm") -> str:
    """Robot description of a revolute `chain` with base and tool at identity.

    A standard Denavit-Hartenberg row turns first and moves then: joint i + 1 stands at row i's fixed part.
    """
    parts = [f'<robot name="{robot}">', _link("base")]
    previous, row = "base", DH(0.0, 0.0)
    for i, name in enumerate(chain.names):
        parts.append(
            f'<joint name="{name}" type="revolute"><parent link="{previous}"/><child link="link_{i}"/>'
            f'{_origin(row)}<axis xyz="0 0 1"/>'
            f'<limit lower="{float(chain.lower[i])!r}" upper="{float(chain.upper[i])!r}" '
            f'velocity="{float(chain.velocity[i])!r}" effort="1000"/></joint>'
        )
        parts.append(_link(f"link_{i}"))
        previous, row = f"link_{i}", _checked(chain, i)
    parts.append(
        f'<joint name="tool" type="fixed"><parent link="{previous}"/><child link="{HAND}"/>{_origin(row)}</joint>'
    )
    parts.append(f'<link name="{HAND}"/></robot>')
    return "\n".join(parts)


def mjcf(chain: SerialChain, *, robot: str = "arm") -> str:
    """MuJoCo description of the same arm; the tool is a site. Speed limits have no place in this format."""
    opened, row = [], DH(0.0, 0.0)
    for i, name in enumerate(chain.names):
        opened.append(
            f'<body name="link_{i}" {_placement(row)}><inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/>'
            f'<joint name="{name}" type="hinge" axis="0 0 1" limited="true" '
            f'range="{float(chain.lower[i])!r} {float(chain.upper[i])!r}"/>'
        )
        row = _checked(chain, i)
    tool = f'<site name="{HAND}" {_placement(row)}/>'
    bodies = "\n".join(opened) + tool + "</body>" * chain.n
    return f'<mujoco model="{robot}"><compiler angle="radian"/><worldbody>{bodies}</worldbody></mujoco>'


def _checked(chain: SerialChain, i: int) -> DH:
    row = chain.rows[i]
    if row.prismatic or row.theta:
        raise NotImplementedError(f"row {i}: only revolute rows without an offset are written")
    return row


def _link(name: str) -> str:
    return f'<link name="{name}"><inertial><mass value="1"/><inertia {_INERTIA}/></inertial></link>'


def _origin(row: DH) -> str:
    return f'<origin xyz="{row.a!r} 0 {row.d!r}" rpy="{row.alpha!r} 0 0"/>'


def _placement(row: DH) -> str:
    half = row.alpha / 2
    return f'pos="{row.a!r} 0 {row.d!r}" quat="{math.cos(half)!r} {math.sin(half)!r} 0 0"'
