"""mink: MuJoCo's kinematics, the QP assembled in numpy and C, any solver through qpsolvers."""

from __future__ import annotations

from importlib.metadata import version

import mink
import mujoco
import numpy as np

from bench.peers.contender import Array, Contender
from bench.peers.models import HAND, mjcf
from bench.peers.path import HandPath
from rehab_opt import SerialChain

__all__ = ["Mink"]


class Mink(Contender):
    """`solve_ik` with the configuration, the task and both limits kept."""

    def __init__(self, chain: SerialChain, *, dt: float, solver: str) -> None:
        self.name = f"mink + {solver}"
        self.versions = {name: version(name) for name in ("mink", "mujoco", "qpsolvers", "numpy", solver)}
        self.dt, self.solver = dt, solver
        model = mujoco.MjModel.from_xml_string(mjcf(chain))
        self.configuration = mink.Configuration(model, np.zeros(chain.n))
        self.task = mink.FrameTask(HAND, "site", position_cost=1.0, orientation_cost=1.0)
        self.tasks = [self.task]
        speeds = dict(zip(chain.names, chain.velocity.tolist(), strict=True))
        self.limits = [mink.ConfigurationLimit(model), mink.VelocityLimit(model, speeds)]

    def pose(self, q: Array) -> Array:
        self.configuration.update(q)
        pose: Array = self.configuration.get_transform_frame_to_world(HAND, "site").as_matrix()
        return pose

    def target(self, path: HandPath, k: int) -> mink.SE3:
        return mink.SE3.from_matrix(path.poses[k + 1])

    def command(self, q: Array, target: mink.SE3) -> Array:
        self.configuration.update(q)
        self.task.set_target(target)
        velocity: Array = mink.solve_ik(self.configuration, self.tasks, self.dt, self.solver, limits=self.limits)
        return velocity

    def integrated(self, q: Array, command: Array) -> Array:
        after: Array = self.configuration.integrate(command, self.dt)
        return after
