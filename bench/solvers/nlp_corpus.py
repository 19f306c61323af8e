"""How the shipped nonlinear programmes are made: targets for arms, boundary points of their slices, mirror plans."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.solvers.controller_runs import mirrored_motion, motions
from bench.solvers.mirror_window import MirrorWindow
from bench.solvers.nlp_instances import PLAN, WINDOW, WINDOW_KEYS, NLPInstances
from bench.solvers.shipped import regenerate_command
from rehab_opt.control.arm_ik import ArmIK
from rehab_opt.control.command import Status
from rehab_opt.control.mirror import MirrorTracker
from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.human_arm import human_arm
from rehab_opt.kinematics.ur5 import ur5
from rehab_opt.optim.recorder import QPRecorder, recording_qps
from rehab_opt.workspace.plane_search import PlaneSearch
from rehab_opt.workspace.plane_statement import PlaneStatement

__all__ = ["made", "names"]

Array = NDArray[np.float64]

TILT = math.radians(2.0)
"""[rad] of the handle, as in `ArmIK`."""
HEIGHT = -0.24
"""[m] plane of the recordings (II-D, Rossa et al.)."""
TOLERANCE = 1e-9
SHORT = {"acromiohumeral": 0.110, "humerus": 0.240, "forearm": 0.220, "hand": 0.060}
"""[m] A smaller person."""
PLAN_DT = 0.02
"""[s]"""
FLOOR = 0.3
"""Of the manipulability, in plans and windows of them."""
KNOTS, SPACING, EVERY = 8, 0.1, 2
"""Of a window: knots, the time between them [s], and after how many of them the next window begins."""
COUNT = 60
DRAWS = 600


def names() -> tuple[str, ...]:
    """Of all files, in alphabetical order."""
    return tuple(sorted(RECIPES))


def made(name: str) -> NLPInstances:
    """The instances of that name.

    Raises
    ------
    ConfigurationError : there are none of that name.
    """
    if name not in RECIPES:
        raise ConfigurationError("name", name, f"one of {', '.join(names())}")
    return RECIPES[name](name)


def targets(name: str, *, reached: bool, about: str, **arm_arguments: Any) -> NLPInstances:
    """Hand positions of random postures that an arm can hold the handle at, or not, each with `ArmIK`'s first start."""
    arguments = {**arm_arguments, "handle_tilt": TILT}
    arm = human_arm(range_of_motion=arguments["range_of_motion"], segments=arguments["segments_m"])
    statement, wanted = ("ik_posture", Status.OK) if reached else ("ik_nearest", Status.UNREACHABLE)
    rng, found = np.random.default_rng(11), []
    with recording_qps() as recorder:
        solver = ArmIK(arm, handle_tilt=TILT, compile=False, nearest_starts=4)
        for _ in range(DRAWS):
            target = arm.pose(rng.uniform(arm.lower, arm.upper))[:3, 3]
            before = _met(recorder, statement)
            if solver.solve(target).status is wanted:
                found.append(_seen(recorder, statement, before))
            if len(found) == COUNT:
                break
    parameters, starts = (np.array(each) for each in zip(*found, strict=True))
    return _instances(name, statement, arguments, parameters, starts, about=about)


def boundary(name: str, *, about: str, **arm_arguments: Any) -> NLPInstances:
    """Probes around the slice of an arm's workspace: the answer is the nearest boundary point.

    Each starts from that posture of the slice whose hand is nearest to the probe.
    """
    arguments = {**arm_arguments, "handle_tilt": TILT}
    arm = human_arm(range_of_motion=arguments["range_of_motion"], segments=arguments["segments_m"])
    statement = PlaneStatement(arm, handle_tilt=TILT)
    inside = PlaneSearch(statement, height=HEIGHT, compile=False).spread(256)
    hands = np.array([(each.x, each.y) for each in inside])
    angles = 2 * np.pi * np.arange(COUNT) / COUNT
    radius = 1.5 * float(np.ptp(hands, axis=0).max())
    probes = hands.mean(axis=0) + radius * np.column_stack([np.cos(angles), np.sin(angles)])
    nearest = [int(np.argmin(((hands - probe) ** 2).sum(axis=1))) for probe in probes]
    parameters = [np.concatenate([statement.fixed, [HEIGHT], probe, [statement.size**-2]]) for probe in probes]
    starts = [inside[i].posture for i in nearest]
    return _instances(name, "plane_nearest", arguments, np.array(parameters), np.array(starts), about=about)


def mirror_plan(name: str, *, task: str, about: str) -> NLPInstances:
    """A whole mirrored task, known beforehand."""
    samples = mirrored_motion(task, PLAN_DT)
    parameters = np.concatenate([samples.poses.reshape(-1, 16), samples.twists], axis=1)
    arguments = {"floor": FLOOR, "dt": PLAN_DT}
    return _instances(name, PLAN, arguments, parameters, motions().START[None], about=about)


def mirror_window(name: str, *, task: str, standing: bool, about: str) -> NLPInstances:
    """Stretches of a plan as programmes: each begins where the plan is, and wants what its clock shows.

    Its start is the plan itself, which keeps every bound, or, `standing`, the posture in which it begins.
    """
    tracker = MirrorTracker(ur5(), floor=FLOOR, dt=PLAN_DT, compile=False)
    samples = mirrored_motion(task, PLAN_DT)
    path, stride = tracker.plan(samples.poses, samples.twists, motions().START), round(SPACING / PLAN_DT)
    bounds, speed, deviation = tracker.hand_bounds, tracker.linear_speed, tracker.max_deviation
    window = MirrorWindow(bounds, linear_speed=speed, deviation=deviation, dt=SPACING, knots=KNOTS)
    parameters, starts = [], []
    for first in range(stride, len(path.q) - KNOTS * stride, EVERY * stride):
        later = first + stride * np.arange(1, KNOTS + 1)
        here = path.q[first]
        parameters.append(window.parameters_of(here, path.q[first - stride], path.references[later]))
        starts.append(window.standing(here) if standing else path.q[later].reshape(-1))
    values = (bounds.floor, bounds.max_manipulability, speed, deviation, SPACING, KNOTS)
    arguments = dict(zip(WINDOW_KEYS, values, strict=True))
    return _instances(name, WINDOW, arguments, np.array(parameters), np.array(starts), about=about)


def _instances(
    name: str, statement: str, arguments: Mapping[str, Any], parameters: Array, starts: Array, *, about: str
) -> NLPInstances:
    command = regenerate_command(f"nlp/{name}")
    return NLPInstances(name, statement, arguments, parameters, starts, TOLERANCE, command=command, about=about)


def _met(recorder: QPRecorder, statement: str) -> int:
    return sum(len(each) for each in recorder.streams if each.name == f"{statement}_step")


def _seen(recorder: QPRecorder, statement: str, before: int) -> tuple[Array, Array]:
    """Parameters and start of the first iteration after those met before."""
    (stream,) = (each for each in recorder.streams if each.name == f"{statement}_step" and len(each))
    parameters, start, *_ = stream.seen[before]
    return parameters, start


_SEGMENTS = {"acromiohumeral": 0.130, "humerus": 0.290, "forearm": 0.300, "hand": 0.070}
_REGULAR: dict[str, Any] = {"range_of_motion": "regular", "segments_m": _SEGMENTS}
_RESTRICTED: dict[str, Any] = {"range_of_motion": "restricted", "segments_m": _SEGMENTS}
_SMALL: dict[str, Any] = {"range_of_motion": "regular", "segments_m": SHORT}

RECIPES: Mapping[str, Callable[[str], NLPInstances]] = MappingProxyType(
    {
        "arm_ik/regular": partial(targets, reached=True, about="Targets within the regular range.", **_REGULAR),
        "arm_ik/restricted": partial(targets, reached=True, about="Within the restricted range.", **_RESTRICTED),
        "arm_ik/small_arm": partial(targets, reached=True, about="Of a smaller person's arm.", **_SMALL),
        "arm_ik/out_of_reach": partial(
            targets, reached=False, about="Targets that the handle's tilt or the range puts out of reach.", **_REGULAR
        ),
        "boundary/regular": partial(boundary, about="Boundary of the slice at -0.24 m, regular range.", **_REGULAR),
        "boundary/restricted": partial(boundary, about="The same, restricted range.", **_RESTRICTED),
        "mirror_plan/pick_fruit": partial(mirror_plan, task="pick_fruit", about="A fruit is picked, at 50 Hz."),
        "mirror_plan/refrigerator_door": partial(
            mirror_plan, task="refrigerator_door", about="A refrigerator's door is opened and shut, at 50 Hz."
        ),
        "mirror_window/pick_fruit": partial(
            mirror_window, task="pick_fruit", standing=False, about="0.8 s of picking a fruit, from the plan of it."
        ),
        "mirror_window/refrigerator_door": partial(
            mirror_window,
            task="refrigerator_door",
            standing=False,
            about="0.8 s of opening and shutting a refrigerator's door, from the plan of it.",
        ),
        "mirror_standing/pick_fruit": partial(
            mirror_window, task="pick_fruit", standing=True, about="The same as mirror_window, from standing still."
        ),
        "mirror_standing/refrigerator_door": partial(
            mirror_window,
            task="refrigerator_door",
            standing=True,
            about="The same as mirror_window, from standing still.",
        ),
    }
)
