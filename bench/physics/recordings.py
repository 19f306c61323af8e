"""The shipped mirrored motions tick by tick: how late they come in, beside joints that move as commanded."""

from __future__ import annotations

from bench.physics.setting import Numbers, Setting
from rehab_opt import MirrorTracker
from rehab_opt.plants.arm_model import ur5_model
from rehab_opt.plants.ideal import IdealJoints
from rehab_opt.plants.mujoco_arm import MujocoArm
from rehab_opt.plants.plant import Plant
from rehab_opt.session.files import load_problem
from rehab_opt.session.mirror.laws import track_reference, tracker_of
from rehab_opt.session.mirror.scene import Setup, laid_out

__all__ = ["mirrored"]

PROBLEMS = ("mirror/pick_fruit", "mirror/open_refrigerator")
STALLED = 2.0
"""Lengths of the recording after which a motion that has not ended stands."""


def mirrored(setting: Setting) -> Numbers:
    """Mean lag at the file's rate, over 1.2 times the ideal robot's and 0.1 s; infinite where it stalls."""
    name = PROBLEMS[int(setting.rng.integers(len(PROBLEMS)))]
    config = load_problem(name)
    problem, told = config.problem, setting.told(MirrorTracker)
    dt, key = 1.0 / problem.tracker.rate_hz, (name, repr(told))
    if key not in setting.kept:
        scene = laid_out(config)
        tracker = tracker_of(problem, scene, file=name, **told)
        setting.kept[key] = scene, tracker, _lag(tracker, scene, IdealJoints(dt))
    scene, tracker, ideal = setting.kept[key]
    if setting.ideal:
        return {"mirror: lag": ideal / (1.2 * ideal + 0.1)}
    plant = MujocoArm(ur5_model(scene.robot), dt=dt, channel=setting.channel, seed=setting.rng)
    return {"mirror: lag": _lag(tracker, scene, plant) / (1.2 * ideal + 0.1)}


def _lag(tracker: MirrorTracker, scene: Setup, plant: Plant) -> float:
    """[s] mean."""
    led = track_reference(tracker, scene, plant, patience=STALLED, progress=lambda *_: None)
    late: float = float(led["lag_s"].mean())
    return late if led["_complete"] else float("inf")
