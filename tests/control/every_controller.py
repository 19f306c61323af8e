"""One of each controller, with a step that is usual for it; what any of them must do is claimed of all."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
import shapely

from rehab_opt import (
    Assistance,
    Bilateral,
    BoundedForce,
    HelperSide,
    Joystick,
    MirrorTracker,
    ParticipantSide,
    PathAssistance,
    PoseTracker,
    PotentialField,
    RedundancyResolver,
    Smoother,
    Workspace,
    ardis,
    ur5,
)
from rehab_opt.control.bilateral_sides import FromHelper, FromParticipant
from rehab_opt.control.conditioning import Conditioner
from rehab_opt.control.scanning import Scanning
from rehab_opt.control.watchdog import Watchdog
from rehab_opt.kinematics.ardis import ARDIS_READY
from rehab_opt.workspace.controller_map import ControllerMap
from rehab_opt.workspace.mapping import WorkspaceMap

READY = np.array([0.0, -1.2, 1.5, -1.8, -1.57, 0.0])
POSE = ur5().pose(READY)
POSE[:3, 3] += 0.001
PATH = np.array([[0.0, 0.0], [0.3, 0.0]])
HAND = np.array([0.2, 0.01])
FORCE = {"compile": False, "dt": 0.001}


class Case(NamedTuple):
    """How to make a controller, and one tick of it: what must come out as an array, from arrays that go in."""

    make: Callable[..., Any]
    inputs: tuple[np.ndarray, ...]
    step: Callable[..., Any]
    reset: Callable[[Any], None] = lambda made: made.reset()


def workspace() -> Workspace:
    return Workspace(shapely.box(-0.05, -0.05, 0.05, 0.05), accuracy=1e-3)


def assistance(**options: Any) -> Assistance:
    field = PotentialField(PATH, stiffness=1000.0, drag=200.0, width=0.025, compile=False)
    return Assistance(field, comfortable=workspace(), **FORCE, **options)


@cache
def workspace_map() -> ControllerMap:
    here, there = (Workspace(shapely.box(0, 0, size, size), accuracy=1e-3) for size in (0.4, 0.3))
    return WorkspaceMap.between(here, there, rule="polar").for_controller(unsafe=True)


NUMBERS: WeakKeyDictionary[object, Iterator[int]] = WeakKeyDictionary()


def next_number(side: HelperSide | ParticipantSide) -> int:
    """Of the message that follows on those that a side has heard."""
    return next(NUMBERS.setdefault(side, itertools.count(1)))


def bilateral() -> Bilateral:
    room = Workspace(shapely.box(0, 0, 0.3, 0.3), accuracy=1e-3)
    return Bilateral(HelperSide(workspace_map(), **FORCE), ParticipantSide(workspace_map(), comfortable=room, **FORCE))


def smoother() -> Smoother:
    made = Smoother(velocity=1.0, acceleration=1.0, jerk=10.0, axes=3)
    made.reset([0.0, 0.0, 0.0])
    return made


CASES: dict[str, Case] = {
    "pose_tracker": Case(
        lambda **options: PoseTracker(ur5(), compile=False, **options),
        (READY, POSE, np.full(6, 0.01)),
        lambda made, *given, **more: made.step(*given, **more),
    ),
    "mirror_tracker": Case(
        lambda **options: MirrorTracker(ur5(), floor=0.1, max_manipulability=0.1, compile=False, **options),
        (READY, POSE, np.full(6, 0.01)),
        lambda made, *given, **more: made.step(*given, **more),
    ),
    "redundancy": Case(
        lambda **options: RedundancyResolver(ardis(), row_sets=[("x", "y")], compile=False, **options),
        (ARDIS_READY, np.array([0.01, 0.0])),
        lambda made, *given, **more: made.step(*given, ("x", "y"), **more),
    ),
    "assistance": Case(assistance, (HAND, np.zeros(2)), lambda made, *given, **more: made.step(*given, **more)),
    "bounded_force": Case(
        lambda **options: BoundedForce(lambda x, y, vx, vy: (1.0, 0.0), **FORCE, **options),
        (HAND, np.zeros(2)),
        lambda made, *given, **more: made.step(*given, **more),
    ),
    "path_assistance": Case(
        lambda **options: PathAssistance(
            PATH, stiffness=1000.0, width=0.025, comfortable=workspace(), **FORCE, **options
        ),
        (HAND, np.zeros(2)),
        lambda made, *given, **more: made.step(*given, **more),
    ),
    "helper_side": Case(
        lambda **options: HelperSide(workspace_map(), **FORCE, **options),
        (HAND, np.zeros(2)),
        lambda made, x, v, **more: made.step(x, FromParticipant(*HAND, 1.0, 0.0, 0.0, next_number(made)), v, **more)[0],
    ),
    "participant_side": Case(
        lambda **options: ParticipantSide(workspace_map(), comfortable=workspace_map().source, **FORCE, **options),
        (HAND, np.zeros(2)),
        lambda made, x, v, **more: made.step(x, FromHelper(*HAND, 0.0, next_number(made)), v, **more)[0],
    ),
    "bilateral": Case(bilateral, (HAND, HAND), lambda made, *given, **more: made.step(*given, **more).helper),
    "smoother": Case(
        smoother,
        (np.array([0.1, 0.2, 0.3]),),
        lambda made, *given, **more: made.step(*given, **more),
        lambda made: made.reset([0.0, 0.0, 0.0]),
    ),
    "scanning": Case(Scanning, (np.array(0.5),), lambda made, pressure: made.step(float(pressure))),
    "watchdog": Case(
        lambda: Watchdog(dt=0.01), (np.array(0.0),), lambda made, stamp: (made.check(float(stamp)), made.lag)
    ),
    "joystick": Case(Joystick, (np.array([0.5, 0.0]),), lambda made, *given: made.step(*given)),
    "conditioner": Case(
        lambda: Conditioner(0.01),
        (np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0])),
        lambda made, *given, stamp=0.0: made.push(stamp, *given),
    ),
}
COMMANDING = [name for name in CASES if name not in {"joystick", "scanning", "watchdog", "conditioner"}]
"""Those whose step gives a Command."""


@cache
def kept(name: str, number: int) -> Any:
    """A controller that every test of a process may have after a reset."""
    return CASES[name].make()


def as_new(name: str, number: int = 0) -> tuple[Any, Callable[..., Any]]:
    """As `made`, but one that was made before and is reset: making a chair takes longer than most tests."""
    case, controller = CASES[name], kept(name, number)
    case.reset(controller)
    return controller, lambda **more: case.step(controller, *case.inputs, **more)


def made(name: str, **options: Any) -> tuple[Any, Callable[..., Any]]:
    """A new controller and its usual tick."""
    case = CASES[name]
    controller = case.make(**options)
    return controller, lambda **more: case.step(controller, *case.inputs, **more)
