"""Speed of the tool at constant joint velocities: p(t) = p(q + q' t) with the tool's position p.

A curve deviates from its chord by at most dt^2/8 times its largest second derivative. So within a tick

    |p'(t)| <= max(|p'(0)|, |p'(dt)|) + dt^2/8 * max |p'''|.

For a chain, p is the sum of its rows' lengths l_i, each rotated by the joints before it, so

    |p'''| <= sum over i of  |l_i| O_i^3 + 3 |l_i'| O_i^2,     O_i = |q'_1| + ... + |q'_i| of the revolute joints.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from rehab_opt.kinematics.chain import SerialChain

__all__ = ["tool_jerk"]


def tool_jerk(chain: SerialChain, q: ca.SX, velocity: ca.SX, dt: float) -> ca.SX:
    """Upper bound [m/s^3] of |p'''| during dt [s] from q (n,) at joint velocities (n,)."""
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
