"""Controllers that somebody made in Python, ready to become C: the one place that knows which can."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rehab_opt.control.assistance import Assistance
from rehab_opt.control.bilateral import Bilateral
from rehab_opt.control.mirror import MirrorTracker
from rehab_opt.control.path_assistance import PathAssistance
from rehab_opt.control.pose_tracker import PoseTracker
from rehab_opt.control.redundancy import RedundancyResolver
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
"""What can become C; of a `Bilateral` both sides do."""

Run = Sequence[Mapping[str, Any]]


def exported_object(
    controller: object, *, run: Run | None, memory: int | None, progress: Progress
) -> Sequence[ExportedController]:
    """The controller, or its sides, with the run that C has to repeat; arguments as of `export_c.export_c`."""
    title, of = type(controller).__name__, "a run that was given" if run is not None else "a random run"
    if isinstance(controller, MirrorTracker):
        start, poses, twists = (
            (run[0]["q"], *(np.array([tick[name] for tick in run]) for name in ("pose", "twist")))
            if run is not None
            else random_runs.mirror_reference(controller)
        )
        given = MEMORY if memory is None else memory
        return [
            exported_mirror(
                controller, start, poses, twists, title=title, source=of, memory=given, progress=progress
            )
        ]  # fmt: skip
    if isinstance(controller, PoseTracker):
        ticks = random_runs.tracker_run(controller) if run is None else [dict(tick) for tick in run]
        return [exported_tracker(controller, ticks, title=title, of=of)]
    if isinstance(controller, RedundancyResolver):
        ticks = random_runs.resolver_run(controller) if run is None else [dict(tick) for tick in run]
        return [exported_resolver(controller, ticks, title=title, of=of)]
    if isinstance(controller, PathAssistance | Assistance):
        made = random_runs.hand_run(controller.comfortable, controller.dt)
        hand = made if run is None else np.array([tick["x"] for tick in run])
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
