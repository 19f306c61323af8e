"""Error of a followed pose beside pink's on the same robot, and how often noise asks the backup."""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from bench.physics.following import ASKED_BACKUP, follow
from bench.physics.setting import Array, Numbers, Setting
from rehab_opt import Command, PoseTracker
from rehab_opt.control.command import Bound, Status

__all__ = ["GAINS", "PINK", "tracked"]

PINK = importlib.util.find_spec("pink") is not None
GAINS = (10.0, 20.0, 50.0)
"""[1/s] that both are tried with; the better one of each counts. 50 is our default."""
SECONDS, SETTLING = 3.0, 0.5
"""[s]"""


def tracked(setting: Setting) -> Numbers:
    """A smooth loop of the hand well inside all limits: RMS of the true error, ours and pink's, gain by gain."""
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
        return float(np.sqrt(np.mean(error**2))), run.share(*ASKED_BACKUP)

    for gain in GAINS:
        tracker = setting.controller(PoseTracker, chain, gain=gain)
        rms, asked = error_of(lambda k, seen, by=tracker: by.step(seen.position, poses[k], twists[k]))
        found[f"ours {gain:g}/s"] = rms
        if gain == GAINS[-1]:
            found["backup"] = asked
        if PINK:
            found[f"pink {gain:g}/s"] = error_of(_pink(chain, poses, gain, dt))[0]
    return found


def _pink(chain: Any, poses: Array, gain: float, dt: float) -> Callable[[int, Any], Command]:
    """pink's frame task with velocity, acceleration and position limits: no feedforward is known to it."""
    import pink  # noqa: PLC0415  (of the extra `peers`)
    import pinocchio  # noqa: PLC0415
    from pink.limits import AccelerationLimit, ConfigurationLimit, VelocityLimit  # noqa: PLC0415

    from bench.peers.models import HAND, urdf  # noqa: PLC0415

    model = pinocchio.buildModelFromXML(urdf(chain))
    configuration = pink.Configuration(model, model.createData(), np.zeros(chain.n))
    task = pink.FrameTask(HAND, position_cost=1.0, orientation_cost=1.0, gain=1 - math.exp(-gain * dt))
    limits = [ConfigurationLimit(model), VelocityLimit(model), AccelerationLimit(model, np.array(chain.acceleration))]

    last = [np.zeros(chain.n)]

    def step(k: int, seen: Any) -> Command:
        configuration.update(seen.position)
        # The sample ahead by one error's time constant: what makes up for the feedforward that it is not given.
        ahead = min(k + round(1.0 / (gain * dt)), len(poses) - 1)
        task.set_target(pinocchio.SE3(poses[ahead, :3, :3], poses[ahead, :3, 3]))
        try:
            value = np.array(pink.solve_ik(configuration, (task,), dt, solver="daqp", limits=limits))
        except pink.exceptions.NoSolutionFound:  # noise can leave its limits without a common answer: on as before
            value = last[0]
        last[0] = value
        limits[-1].set_last_integration(value, dt)
        return Command(value, Status.OK, "daqp", 0.0, -1, "", Bound.NOTHING, 1.0)

    return step


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
