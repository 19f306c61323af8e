"""Export of controllers made in Python; registry of the exportable types."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.assistance import Assistance
from rehab_opt.control.bilateral import Bilateral
from rehab_opt.control.hand_task import checked_rows, frame_number
from rehab_opt.control.limit import PostureLimits
from rehab_opt.control.mirror import MirrorTracker
from rehab_opt.control.path_assistance import PathAssistance
from rehab_opt.control.pose_tracker import PoseTracker
from rehab_opt.control.redundancy import RedundancyResolver
from rehab_opt.control.velocity_controller import real_numbers
from rehab_opt.errors import ConfigurationError
from rehab_opt.export import random_runs
from rehab_opt.export.controllers.assistance import exported_assistance
from rehab_opt.export.controllers.bilateral_sides import exported_helper_side, exported_participant_side
from rehab_opt.export.controllers.mirror import MEMORY, exported_mirror
from rehab_opt.export.controllers.path_assistance import exported_path_assistance
from rehab_opt.export.controllers.pose_tracker import exported_tracker
from rehab_opt.export.controllers.redundancy import exported_resolver
from rehab_opt.export.exported import ExportedController
from rehab_opt.session.outcome import Progress

__all__ = ["KINDS", "exported_object"]

KINDS = (MirrorTracker, PoseTracker, RedundancyResolver, PathAssistance, Assistance, Bilateral)
"""Exportable types; both sides of a `Bilateral` are exported."""

Array = NDArray[np.float64]
Run = Sequence[Mapping[str, Any]]


def exported_object(
    controller: object, *, run: Run | None, memory: int | None, progress: Progress
) -> Sequence[ExportedController]:
    """Prepare a controller for export, with the run that C must repeat; arguments as in `export_c.export_c`."""
    title, of = type(controller).__name__, "a run that was given" if run is not None else "a random run"
    if isinstance(controller, MirrorTracker):
        ticks = random_runs.mirror_reference(controller) if run is None else _poses(controller, run)
        poses, twists, *bodies = (np.array([tick[name] for tick in ticks]) for name in ticks[0] if name != "q")
        given = MEMORY if memory is None else memory
        return [
            exported_mirror(
                controller, ticks[0]["q"], poses, twists, bodies=bodies[0] if bodies else None, title=title, source=of,
                memory=given, progress=progress,
            )
        ]  # fmt: skip
    if isinstance(controller, PoseTracker):
        ticks = random_runs.tracker_run(controller) if run is None else _poses(controller, run)
        return [exported_tracker(controller, ticks, title=title, of=of)]
    if isinstance(controller, RedundancyResolver):
        ticks = random_runs.resolver_run(controller) if run is None else _sticks(controller, run)
        return [exported_resolver(controller, ticks, title=title, of=of)]
    if isinstance(controller, PathAssistance | Assistance):
        made = random_runs.hand_run(controller.comfortable, controller.dt)
        hand = made if run is None else np.array([_numbers(where, tick, "x", (2,)) for where, tick in _told(run)])
        if isinstance(controller, PathAssistance):
            return [exported_path_assistance(controller, hand, title=title)]
        return [exported_assistance(controller, hand, title=title)]
    if isinstance(controller, Bilateral):
        if run is not None:
            raise ConfigurationError("run", f"{len(run)} ticks", "None: both sides of a pair repeat a run of their own")
        hands, drawn, back, there = random_runs.pair_run(controller)
        return [
            exported_helper_side(controller.helper, hands, back, title=title),
            exported_participant_side(controller.participant, drawn, there, title=title),
        ]
    expected = f"a controller that can become C: {', '.join(sorted(kind.__name__ for kind in KINDS))}"
    raise ConfigurationError("controller", controller, expected)


# ------------------------------------------------------------ ticks with arguments of `step` -> ticks of a recorded run
def _told(run: Run) -> Sequence[tuple[str, Mapping[str, Any]]]:
    """The ticks of a run that a caller gave, each with its name in error messages, such as run[3]."""
    if not (isinstance(run, Sequence) and run and all(isinstance(tick, Mapping) for tick in run)):
        raise ConfigurationError("run", run, "a list of at least one tick, each a dict of what `step` takes")
    return [(f"run[{k}]", tick) for k, tick in enumerate(run)]


def _numbers(where: str, tick: Mapping[str, Any], name: str, shape: tuple[int, ...]) -> Array:
    if name not in tick:
        raise ConfigurationError(where, list(tick), f"{name} among them")
    return real_numbers(f"{where}[{name!r}]", tick[name], shape)


def _bodies(where: str, tick: Mapping[str, Any], name: str, limits: PostureLimits) -> dict[str, Array]:
    given = tick.get(name)
    if given is None and not limits.moving:
        return {}
    return {"obstacles": limits.capsule_numbers(f"{where}[{name!r}]", given)}


def _poses(tracker: PoseTracker | MirrorTracker, run: Run) -> list[dict[str, Any]]:
    shapes = {"q": (tracker.chain.n,), "pose": (4, 4), "twist": (6,)}
    return [
        {name: _numbers(where, tick, name, shape) for name, shape in shapes.items()}
        | _bodies(where, tick, "obstacles", tracker.limits)
        for where, tick in _told(run)
    ]


def _sticks(resolver: RedundancyResolver, run: Run) -> list[dict[str, Any]]:
    """Inputs of each tick as numbers, with every twist padded to the size of the largest one."""
    ticks, widest = [], max(map(len, resolver.row_sets))
    for where, tick in _told(run):
        rows = checked_rows(tick.get("rows", ("x", "y", "z")), f"{where}['rows']")
        if rows not in resolver.row_sets:
            raise ConfigurationError(f"{where}['rows']", rows, f"one of row_sets: {resolver.row_sets}")
        twist = np.zeros(widest)
        twist[: len(rows)] = _numbers(where, tick, "twist", (len(rows),))
        q = _numbers(where, tick, "q", (resolver.robot.chain.n,))
        frame = int(frame_number(tick.get("frame", "chassis")))
        around = _bodies(where, tick, "moving", resolver.limits)
        ticks.append({"q": q, "twist": twist, "rows": resolver.row_sets.index(rows), "frame": frame, **around})
    return ticks
