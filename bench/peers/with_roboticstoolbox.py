"""Robotics Toolbox for Python: kinematics in C, the QP of its own resolved-rate examples, any solver of qpsolvers."""

from __future__ import annotations

import warnings
from importlib.metadata import version

import numpy as np
import qpsolvers

from bench.peers.contender import Array, Contender
from bench.peers.path import HandPath
from rehab_opt import SerialChain

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # of its own syntax and of plotting packages that are not installed
    import roboticstoolbox as rtb

__all__ = ["RoboticsToolbox"]

EASE = 0.01
"""Weight of the joint velocities, as in its examples."""


class RoboticsToolbox(Contender):
    """Joint velocities and a slack of the hand's twist that costs more the nearer the target is (its `neo` and `mmc`).

    The library states no task: these lines are what its examples write around it, with `p_servo`, `jacob0` and
    `joint_velocity_damper`. Its manipulability term is left out, since no other contender has one.
    """

    def __init__(self, chain: SerialChain, *, dt: float, solver: str) -> None:
        self.name = f"roboticstoolbox + {solver}"
        self.versions = {name: version(name) for name in ("roboticstoolbox-python", "qpsolvers", "numpy", solver)}
        self.dt, self.solver, self.n = dt, solver, chain.n
        self.robot = rtb.Robot(_elements(chain), name="arm")
        self.robot.qlim = np.vstack([chain.lower, chain.upper])
        free = np.full(6, 1e3)  # its examples' 10 is too little for the gain that reaches a target in one tick
        self.upper = np.concatenate([chain.velocity, free])
        self.equal = np.hstack([np.empty((6, self.n)), np.eye(6)])
        self.cost, self.none = EASE * np.eye(self.n + 6), np.zeros(self.n + 6)

    def pose(self, q: Array) -> Array:
        pose: Array = self.robot.fkine(q).A
        return pose

    def target(self, path: HandPath, k: int) -> Array:
        pose: Array = path.poses[k + 1]
        return pose

    def command(self, q: Array, target: Array) -> Array:
        robot, n = self.robot, self.n
        now = robot.fkine(q).A
        twist, _ = rtb.p_servo(now, target, gain=1 / self.dt, method="angle-axis")
        self.equal[:, :n] = robot.jacob0(q)
        self.cost[n:, n:] = np.eye(6) / max(self.dt * np.abs(twist).sum(), 1e-6)
        rows, limits = robot.joint_velocity_damper(q, 0.05, 0.9, n)
        padded = np.hstack([rows, np.zeros((n, 6))])
        answer = qpsolvers.solve_qp(
            self.cost, self.none, padded, limits, self.equal, twist, -self.upper, self.upper, solver=self.solver
        )
        assert answer is not None
        velocity: Array = answer[:n]
        return velocity

    def integrated(self, q: Array, command: Array) -> Array:
        return q + self.dt * command


def _elements(chain: SerialChain) -> rtb.ETS:
    """A standard Denavit-Hartenberg row turns about z first and moves then."""
    elements = rtb.ETS()
    for i, row in enumerate(chain.rows):
        elements *= (
            rtb.ET.Rz(jindex=i) * rtb.ET.Rz(row.theta) * rtb.ET.tz(row.d) * rtb.ET.tx(row.a) * rtb.ET.Rx(row.alpha)
        )
    return elements
