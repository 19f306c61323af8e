"""Speed of the tool at constant joint velocities: p(t) = p(q + q' t).

p' changes with the joints, so it may be larger at either end of a tick. A curve deviates from its chord by at most
dt^2/8 times its largest second derivative. So within a tick

    |p'(t)| <= max(|p'(0)|, |p'(dt)|) + dt^2/8 * max |p'''|.

For a chain, p is the sum of its rows' lengths l_i, each rotated by the joints before it, so

    |p'''| <= sum over i of  |l_i| O_i^3 + 3 |l_i'| O_i^2,     O_i = |q'_1| + ... + |q'_i| of the revolute joints.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from rehab_opt.kinematics.chain import SerialChain

__all__ = ["speed_ahead", "tool_acceleration", "tool_jerk"]


def tool_acceleration(jacobian: ca.SX, velocity: ca.SX) -> ca.SX:
    """(6,) [m/s^2, rad/s^2] J' q' at constant joint velocities (n,), from the geometric Jacobian (6, n)."""
    total, turning = ca.SX.zeros(6), ca.SX.zeros(3)
    for j in range(velocity.numel()):
        linear, turn = jacobian[:3, j] * velocity[j], jacobian[3:, j] * velocity[j]
        total += ca.vertcat(ca.cross(2 * turning + turn, linear), ca.cross(turning, turn))
        turning += turn
    return total


def tool_jerk(chain: SerialChain, q: ca.SX, velocity: ca.SX, dt: float) -> ca.SX:
    """[m/s^3] upper bound of |p'''| during dt [s] from q (n,) at joint velocities (n,)."""
    bound, turning = ca.SX(0), ca.SX(0)
    for i, row in enumerate(chain.rows):
        speed = ca.fabs(velocity[i])
        if row.prismatic:
            bound += turning**2 * (turning * (ca.fabs(row.along + q[i]) + speed * dt) + 3 * speed)
        else:
            bound += abs(row.along) * turning**3  # along the joint's own axis
            turning += speed
        bound += row.across * turning**3
    return bound + float(np.linalg.norm(chain.tool[:3, 3])) * turning**3


def speed_ahead(chain: SerialChain, q: ca.SX, jacobian: ca.SX, velocity: ca.SX, dt: float) -> ca.SX:
    """[m/s] upper bound of |p'| in a tick, from its start alone; at least the bound of this module.

    For s times the velocity, with s <= 1, it is at most s times as large.
    """
    now = jacobian[:3, :] @ velocity
    then = now + dt * tool_acceleration(jacobian, velocity)[:3]
    # |p'(dt) - then| <= dt^2/2 max |p'''|, and an eighth for the way.
    return ca.fmax(ca.norm_2(now), ca.norm_2(then)) + 0.625 * dt**2 * tool_jerk(chain, q, velocity, dt)
