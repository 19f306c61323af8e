"""Error of a followed pose beside pink's and placo's on the same robot, and how often noise asks the backup."""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from bench.physics.following import ASKED_BACKUP, follow
from bench.physics.setting import Array, Numbers, Setting
from rehab_opt import Command, PoseTracker
from rehab_opt.control.command import Relaxed, Status

__all__ = ["GAINS", "PEERS", "tracked"]

GAINS, DEFAULT = (20.0, 50.0, 100.0, 200.0), 50.0
"""[1/s] that all are tried with, so that the best one of each is between others; and ours where none is given."""
SECONDS, SETTLING = 3.0, 0.5
"""[s]"""


def tracked(setting: Setting) -> Numbers:
    """A smooth loop of the hand well inside all limits: RMS of the true error, ours and the peers', gain by gain."""
    rng, arm, dt = setting.rng, setting.arm, setting.dt
    chain, start = arm.chain, arm.start(rng, 0.15)
    poses, twists = _loop(chain.pose(start), rng, dt)
    settled = round(SETTLING / dt)
    noise = rng.bit_generator.state  # the same draws for everybody
    found: Numbers = {}

    def error_of(step: Callable[[int, Any], Command]) -> tuple[float, float]:
        rng.bit_generator.state = noise
        run = follow(setting.plant(), chain, start, len(poses), step)
        error = np.linalg.norm(run.hand[settled:] - poses[settled:, :3, 3], axis=1)
        return float(np.sqrt(np.mean(error**2))), run.fraction(*ASKED_BACKUP)

    for gain in GAINS:
        tracker = setting.controller(PoseTracker, chain, gain=gain)
        rms, asked = error_of(lambda k, seen, by=tracker: by.step(seen.position, poses[k], twists[k]))
        found[f"ours {gain:g}/s"] = rms
        if gain == DEFAULT:
            found["backup"] = asked
        for name, peer in PEERS.items():
            found[f"{name} {gain:g}/s"] = error_of(_peer(peer(chain, gain, dt), poses, gain, dt))[0]
    return found


Solve = Callable[[Array, Array, Array], Array | None]
"""Measured positions, a pose, the last velocities -> velocities; None where the limits have no common answer."""


def _peer(solve: Solve, poses: Array, gain: float, dt: float) -> Callable[[int, Any], Command]:
    """A peer's frame task with limits of velocity, acceleration and position: no feedforward is known to it."""
    last = [np.zeros(0)]

    def step(k: int, seen: Any) -> Command:
        # The sample ahead by one error's time constant: what makes up for the feedforward that it is not given.
        ahead = poses[min(k + round(1.0 / (gain * dt)), len(poses) - 1)]
        before = last[0] if k else np.zeros_like(seen.position)
        value = solve(seen.position, ahead, before)
        last[0] = before if value is None else value  # noise can leave the limits without an answer: on as before
        return Command(last[0], Status.OK, "", 0.0, -1, "", Relaxed.NOTHING, 1.0)

    return step


def _pink(chain: Any, gain: float, dt: float) -> Solve:
    import pink  # noqa: PLC0415  (of the extra `peers`)
    import pinocchio  # noqa: PLC0415
    from pink.limits import AccelerationLimit, ConfigurationLimit, VelocityLimit  # noqa: PLC0415

    from bench.peers.models import HAND, urdf  # noqa: PLC0415

    model = pinocchio.buildModelFromXML(urdf(chain))
    configuration = pink.Configuration(model, model.createData(), np.zeros(chain.n))
    task = pink.FrameTask(HAND, position_cost=1.0, orientation_cost=1.0, gain=1 - math.exp(-gain * dt))
    limits = [ConfigurationLimit(model), VelocityLimit(model), AccelerationLimit(model, np.array(chain.acceleration))]

    def solve(q: Array, pose: Array, last: Array) -> Array | None:
        configuration.update(q)
        task.set_target(pinocchio.SE3(pose[:3, :3], pose[:3, 3]))
        limits[-1].set_last_integration(last, dt)
        try:
            return np.array(pink.solve_ik(configuration, (task,), dt, "daqp", limits=limits, safety_break=False))
        except pink.exceptions.NoSolutionFound:
            return None

    return solve


def _placo(chain: Any, gain: float, dt: float) -> Solve:
    """Its tasks have no gain and its solver no limit of acceleration: an interpolated pose, and half-spaces."""
    import placo  # noqa: PLC0415  (of the extra `peers`)

    from bench.peers.with_placo import Placo  # noqa: PLC0415

    peer, n = Placo(chain, dt=dt), chain.n
    joints = np.zeros((2 * n, len(peer.state.q)))
    joints[:n, -n:], joints[n:, -n:] = np.eye(n), -np.eye(n)
    change = np.array(chain.acceleration) * dt
    bounds = peer.solver.add_joint_space_half_spaces_constraint(joints, np.zeros(2 * n))
    bounds.configure("acceleration", "hard", 1.0)

    def solve(q: Array, pose: Array, last: Array) -> Array | None:
        peer.task.T_world_frame = placo.interpolate_frames(peer.pose(q), pose, 1 - math.exp(-gain * dt))
        bounds.b = np.concatenate([q + (last + change) * dt, -q - (last - change) * dt])
        try:
            return np.array(peer.solver.solve(False)[-n:]) / dt
        except RuntimeError:
            return None

    return solve


PEERS: Mapping[str, Callable[[Any, float, float], Solve]] = {
    name: peer for name, peer in (("pink", _pink), ("placo", _placo)) if importlib.util.find_spec(name) is not None
}
"""Those that are installed: a chain, a gain [1/s] and dt [s] -> what answers a tick."""


def _loop(first: Array, rng: np.random.Generator, dt: float) -> tuple[Array, Array]:
    """Poses (N, 4, 4) and twists (N, 6): two sines an axis from rest, the hand swinging about an axis."""
    time = dt * np.arange(round(SECONDS / dt))
    onset = 0.3
    clock, rate = time - onset * -np.expm1(-time / onset), -np.expm1(-time / onset)
    sizes = rng.uniform(0.01, 0.05, (2, 3)) * rng.choice([-1, 1], (2, 3))
    hertz = rng.uniform(0.2, 0.7, (2, 3))
    waves, phases = 2 * math.pi * hertz, clock[:, None, None] * 2 * math.pi * hertz
    places, speeds = (sizes * np.sin(phases)).sum(axis=1), (sizes * waves * np.cos(phases)).sum(axis=1)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    swing, beat = rng.uniform(0.05, 0.2), 2 * math.pi * rng.uniform(0.2, 0.7)
    poses = np.tile(first, (len(time), 1, 1))
    poses[:, :3, 3] += places
    turns = Rotation.from_rotvec(np.outer(swing * np.sin(beat * clock), axis))
    poses[:, :3, :3] = turns.as_matrix() @ first[:3, :3]
    twists = np.zeros((len(time), 6))
    twists[:, :3] = speeds * rate[:, None]
    twists[:, 3:] = np.outer(swing * beat * np.cos(beat * clock) * rate, axis)
    return poses, twists
