"""placo: kinematics, QP assembly and solver all in C++."""

from __future__ import annotations

from importlib.metadata import version

import numpy as np
import placo

from bench.peers.contender import Array, Contender
from bench.peers.models import HAND, urdf
from bench.peers.path import HandPath
from rehab_opt import SerialChain

__all__ = ["Placo"]

_FIXED_BASE = 7  # placo's state begins with the pose of a floating base, masked here


class Placo(Contender):
    """`KinematicsSolver` with a soft frame task; `solve(True)` integrates inside, which costs it nothing.

    Parameters
    ----------
    stateful : leave the state inside placo between ticks, as its examples do, instead of taking it from the caller.
        It saves the copy; a controller that reads a robot's encoders cannot.
    """

    def __init__(self, chain: SerialChain, *, dt: float, stateful: bool = False) -> None:
        self.name = "placo, own state" if stateful else "placo"
        self.versions = {"placo": version("placo"), "pinocchio": version("pin")}
        self.stateful = stateful
        self.robot = placo.RobotWrapper("", 0, urdf(chain))
        for name, lower, upper, velocity in zip(chain.names, chain.lower, chain.upper, chain.velocity, strict=True):
            self.robot.set_joint_limits(name, lower, upper)
            self.robot.set_velocity_limit(name, velocity)
        self.solver = placo.KinematicsSolver(self.robot)
        self.solver.mask_fbase(True)
        self.solver.dt = dt
        self.solver.enable_joint_limits(True)
        self.solver.enable_velocity_limits(True)
        self.task = self.solver.add_frame_task(HAND, self.pose(np.zeros(chain.n)))
        self.task.configure(HAND, "soft", 1.0, 1.0)
        self.state = self.robot.state
        self.started = False

    def pose(self, q: Array) -> Array:
        self._set(q)
        pose: Array = self.robot.get_T_world_frame(HAND)
        return pose

    def target(self, path: HandPath, k: int) -> Array:
        pose: Array = path.poses[k + 1]
        return pose

    def command(self, q: Array, target: Array) -> Array:
        if not (self.stateful and self.started):
            self.state.q[_FIXED_BASE:] = q
            self.started = True
        self.robot.update_kinematics()
        self.task.T_world_frame = target
        displacement: Array = self.solver.solve(True)
        return displacement

    def integrated(self, q: Array, command: Array) -> Array:
        after: Array = self.state.q[_FIXED_BASE:]
        return after.copy()

    def _set(self, q: Array) -> None:
        self.robot.state.q[_FIXED_BASE:] = q
        self.robot.update_kinematics()
