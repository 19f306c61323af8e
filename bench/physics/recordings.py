"""The shipped mirrored motions tick by tick: how late they come in, beside joints that move as commanded."""

from __future__ import annotations

from typing import Any

from bench.physics.setting import Numbers, Setting
from rehab_opt import MirrorTracker
from rehab_opt.plants.ideal import IdealJoints
from rehab_opt.plants.mujoco_arm import MujocoArm
from rehab_opt.plants.ur5_model import ur5_model
from rehab_opt.session.files import load_problem
from rehab_opt.session.mirror.laws import followed, tracker_of
from rehab_opt.session.mirror.scene import laid_out

__all__ = ["mirrored"]

PROBLEMS = ("mirror/pick_fruit", "mirror/open_refrigerator")
STALLED = 2.0
"""Lengths of the recording after which a motion that has not ended stands."""


def mirrored(setting: Setting) -> Numbers:
    """Mean lag at the file's rate over what is allowed: 1.2 of the ideal robot's, and 0.1 s. Infinite where it stalls."""
    name = PROBLEMS[int(setting.rng.integers(len(PROBLEMS)))]
    loaded = load_problem(name)
    problem, scene = loaded.problem, laid_out(loaded)
    dt = 1.0 / problem.tracker.rate_hz
    plant: Any = IdealJoints(dt)
    key = ("ideal lag", name)
    if key not in setting.kept:
        setting.kept["tracker", name] = tracker_of(problem, scene, file=name)
        setting.kept[key] = _lag(setting.kept["tracker", name], scene, plant)
    if not setting.ideal:
        model = ur5_model(scene.robot)
        plant = MujocoArm(model, dt=dt, channel=setting.channel, seed=setting.rng)
    told = setting.told(MirrorTracker)
    if told:
        raise NotImplementedError(f"problem files have no keys for {', '.join(told)} yet: pass them here")
    lag = _lag(setting.kept["tracker", name], scene, plant)
    return {"mirror: lag": lag / (1.2 * setting.kept[key] + 0.1)}


def _lag(tracker: MirrorTracker, scene: Any, plant: Any) -> float:
    """[s] mean."""
    led = followed(tracker, scene, plant, patience=STALLED, progress=lambda *_: None)
    late: float = float(led.lag.mean())
    return late if led.complete else float("inf")
