"""Sequences of the corpus that come from controllers run for it: mirror, assistance, learning, targets out of reach."""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Callable, Iterator, Mapping
from functools import cache, partial
from types import MappingProxyType, ModuleType

import numpy as np
from numpy.typing import NDArray

from bench.qp_recording.recording import sequence_of_stream
from bench.qp_recording.sequence import QPSequence
from bench.solvers.shipped import regenerate_command
from rehab_opt.control.arm_ik import ArmIK
from rehab_opt.control.assistance import Assistance
from rehab_opt.control.conditioning import Conditioned, conditioned
from rehab_opt.control.mirror import MirrorTracker
from rehab_opt.field.demonstration import Demonstration
from rehab_opt.field.potential import PotentialField
from rehab_opt.kinematics.human_arm import human_arm
from rehab_opt.kinematics.ur5 import ur5
from rehab_opt.kinematics.vr import quaternions_of
from rehab_opt.optim.recorder import QPRecorder, recording_qps
from rehab_opt.session.files import shipped_folder
from rehab_opt.workspace.region import Workspace

__all__ = ["CONTROLLER_RUNS", "mirrored_motion"]

Array = NDArray[np.float64]

DT = 0.002
"""[s] of the mirror's tick."""
FORCE_DT = 0.001
"""[s] of the assistance's tick."""
SHARE = np.linspace(0.0, 1.0, 1000)
REACH = np.column_stack([-0.15 + 0.3 * SHARE, 0.4 + 0.03 * np.sin(3 * SHARE)])
"""[m] (1000, 2) path of a reach in the plane of the hand."""
WIDTH = 0.025
"""[m] sigma of its field."""


# -------------------------------------------------------------------------------------------------------------- mirror
@cache
def motions() -> ModuleType:
    """The shipped `mirror/motions.py`: two mirrored tasks as poses of the led hand."""
    path = shipped_folder() / "mirror" / "motions.py"
    spec = importlib.util.spec_from_file_location("rehab_opt_mirror_motions", path)
    if spec is None or spec.loader is None:
        raise FileNotFoundError(path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def mirrored_motion(task: str, dt: float) -> Conditioned:
    """Poses and twists of a task, dt apart."""
    poses = np.array(getattr(motions(), task)())
    return conditioned(np.arange(len(poses)) / motions().RATE, poses[:, :3, 3], quaternions_of(poses[:, :3, :3]), dt=dt)


def mirror(name: str, *, task: str, floor: float, skip: int, ticks: int, about: str) -> QPSequence:
    """A window of a task that `MirrorTracker` follows."""
    with recording_qps(skip=skip, most=ticks) as recorder:
        tracker = MirrorTracker(ur5(), floor=floor, dt=DT, compile=False)
        samples, q = mirrored_motion(task, DT), motions().START.copy()
        for pose, twist in zip(samples.poses[: skip + ticks], samples.twists, strict=False):
            q = q + DT * tracker.step(q, pose, twist).value
    return _only(recorder, name, "mirror_tracker", DT, about)


# ---------------------------------------------------------------------------------------------------------- assistance
def swaying_hand(ticks: int, *, speed: float) -> Iterator[Array]:
    """Forth and back along the reach, with a tremor; `speed` 1 takes 3.3 s for both ways."""
    t = np.arange(ticks) * FORCE_DT
    fraction = 0.5 - 0.5 * np.cos(2 * np.pi * 0.3 * speed * t)
    x = np.column_stack([np.interp(fraction, SHARE, column) for column in REACH.T])
    yield from x + 4e-3 * np.column_stack([np.sin(2 * np.pi * 5 * t), np.cos(2 * np.pi * 4 * t)])


def assistance(
    name: str, *, force_limit: float, slew_limit: float, energy: float, speed: float, skip: int, ticks: int, about: str
) -> QPSequence:
    """A window of a hand that is led along the reach."""
    import shapely  # noqa: PLC0415  (loaded when used)

    field = PotentialField(REACH, stiffness=1000.0, drag=200.0, damping=5.0, width=WIDTH, compile=False)
    comfortable = Workspace(shapely.box(-0.18, 0.365, -0.06, 0.435), accuracy=1e-3)
    with recording_qps(skip=skip, most=ticks) as recorder:
        helper = Assistance(
            field, comfortable=comfortable, mode="assist", force_limit=force_limit, slew_limit=slew_limit,
            energy_budget=energy, dt=FORCE_DT, compile=False,
        )  # fmt: skip
        for x in swaying_hand(20 * (skip + ticks), speed=speed):
            helper.step(x)
    return _only(recorder, name, "assistance", FORCE_DT, about)


# ------------------------------------------------------------------------------------------------------ field learning
def led_hands(count: int) -> list[Demonstration]:
    """Reaches of two seconds that sway beside the path, led by a known field, and held back at first."""
    truth = PotentialField(REACH, stiffness=1000.0, drag=200.0, damping=8.0, width=WIDTH, compile=False)
    rng, path = np.random.default_rng(7), truth.paths[0]
    t = np.linspace(0.0, 1.0, 200)
    length = path.travelled[-1] * (10 * t**3 - 15 * t**4 + 6 * t**5)
    on_path = np.column_stack([np.interp(length, path.travelled, column) for column in path.points.T])
    hands = []
    for _ in range(count):
        beside = rng.normal(0, 0.01, 2) * np.sin(3 * np.pi * t[:, None] + rng.uniform(0, 6, 2))
        x = on_path + beside * np.sin(np.pi * t[:, None])
        v = np.gradient(x, 2.0 * t, axis=0)
        held = np.outer(np.maximum(0.0, 1.0 - 3.0 * t), (-rng.uniform(0.0, 60.0), 0.0))
        hands.append(Demonstration(x, truth.force(x, v) + held + rng.standard_normal(x.shape), v))
    return hands


def learning(name: str, *, about: str) -> QPSequence:
    """A field learnt again after each new demonstration, as in a session that goes on."""
    hands = led_hands(110)
    with recording_qps() as recorder:
        for count in range(2, len(hands) + 1):
            PotentialField.learn(
                hands[max(0, count - 10) : count], path=REACH, width=WIDTH, spacing=WIDTH / 2, held_out=(),
                compile=False,
            )  # fmt: skip
    largest = max(recorder.streams, key=lambda stream: int(stream.name.rpartition("_")[2]))
    return _only(recorder, name, largest.name, math.nan, about)


# ----------------------------------------------------------------------------------------------------- out of reach
def out_of_reach(name: str, *, about: str) -> QPSequence:
    """Iterations towards the nearest posture while a target leaves what the arm can reach."""
    arm = human_arm(range_of_motion="regular")
    with recording_qps(most=300) as recorder:
        solver = ArmIK(arm, compile=False, nearest_starts=4)
        inside = arm.pose((arm.lower + arm.upper) / 2)[:3, 3]
        solver.follow(inside + np.outer(np.linspace(0.3, 0.8, 40), [0.3, 0.9, 0.3]))
    return _only(recorder, name, "ik_nearest_step", math.nan, about)


def _only(recorder: QPRecorder, name: str, stream: str, dt: float, about: str) -> QPSequence:
    """The one stream of that name that saw something."""
    found = next(each for each in recorder.streams if each.name == stream and len(each))
    return sequence_of_stream(found, name=name, dt=dt, command=regenerate_command(name), about=about)


CONTROLLER_RUNS: Mapping[str, Callable[[str], QPSequence]] = MappingProxyType(
    {
        "arm_ik/out_of_reach": partial(
            out_of_reach, about="Iterations towards the nearest posture while a target leaves the arm's reach."
        ),
        "mirror/far": partial(
            mirror, task="pick_fruit", floor=0.3, skip=600, ticks=150,
            about="A mirrored hand on its way to the fruit, far from every singularity.",
        ),
        "mirror/near_singularity": partial(
            mirror, task="pick_fruit", floor=0.3, skip=1650, ticks=200,
            about="At the fruit the arm is nearly stretched: the hand slides along the manipulability floor.",
        ),
        "mirror/late": partial(
            mirror, task="refrigerator_door", floor=0.3, skip=1000, ticks=250,
            about="Faster than a hand may be led, and into the floor: the clock slows down, several bounds are active.",
        ),
        "assistance/within_bounds": partial(
            assistance, force_limit=30.0, slew_limit=200.0, energy=1e3, speed=1.0, skip=700, ticks=250,
            about="A hand led along a reach at 1 kHz with a tremor; a bound is active now and then.",
        ),
        "assistance/at_bounds": partial(
            assistance, force_limit=8.0, slew_limit=60.0, energy=3.0, speed=2.0, skip=300, ticks=250,
            about="A faster hand with a small force limit, a small slew limit and little energy.",
        ),
        "field_learning/shared": partial(
            learning, about="Stiffness, drag and damping learnt again after each demonstration."
        ),
    }
)  # fmt: skip
