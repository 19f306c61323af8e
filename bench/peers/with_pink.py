"""pink: pinocchio's kinematics, the QP assembled in numpy, any solver through qpsolvers."""

from __future__ import annotations

from importlib.metadata import version

import numpy as np
import pink
import pinocchio

from bench.peers.contender import Array, Contender
from bench.peers.models import HAND, urdf
from bench.peers.path import HandPath
from rehab_opt import SerialChain

__all__ = ["Pink"]


class Pink(Contender):
    """`solve_ik` with the configuration and the task kept, its default limits (position and velocity)."""

    def __init__(self, chain: SerialChain, *, dt: float, solver: str) -> None:
        self.name = f"pink + {solver}"
        self.versions = {name: version(name) for name in ("pin-pink", "qpsolvers", "numpy", _package(solver))}
        self.dt, self.solver = dt, solver
        model = pinocchio.buildModelFromXML(urdf(chain))
        self.configuration = pink.Configuration(model, model.createData(), np.zeros(chain.n))
        self.task = pink.FrameTask(HAND, position_cost=1.0, orientation_cost=1.0)
        self.tasks = (self.task,)

    def pose(self, q: Array) -> Array:
        self.configuration.update(q)
        pose: Array = self.configuration.get_transform_frame_to_world(HAND).homogeneous
        return pose

    def target(self, path: HandPath, k: int) -> pinocchio.SE3:
        return pinocchio.SE3(path.poses[k + 1, :3, :3], path.poses[k + 1, :3, 3])

    def command(self, q: Array, target: pinocchio.SE3) -> Array:
        self.configuration.update(q)
        self.task.set_target(target)
        velocity: Array = pink.solve_ik(self.configuration, self.tasks, self.dt, solver=self.solver)
        return velocity

    def integrated(self, q: Array, command: Array) -> Array:
        after: Array = self.configuration.integrate(command, self.dt)
        return after


def _package(solver: str) -> str:
    return {"proxqp": "proxsuite"}.get(solver, solver)
