"""Registry of exporters by the system of a problem file.

A new controller needs a file in `controllers`, a line in `EXPORTERS`, and templates of its C interface.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

from rehab_opt.errors import ProblemFileError
from rehab_opt.export.exported import ExportedController
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.outcome import Progress

__all__ = ["EXPORTERS", "Exporter", "exported_controllers"]

Exporter = Callable[[ProblemFile[Any], Progress, int | None], Sequence[ExportedController]]
"""Function from a problem file, progress and the largest struct [bytes] to the controllers with recorded runs."""


def exported_controllers(
    config: ProblemFile[Any], *, memory: int | None = None, progress: Progress
) -> Sequence[ExportedController]:
    """Prepare the controllers of a problem file for export, each with the run that C must repeat.

    Raises
    ------
    ProblemFileError : a system without an exportable controller, or an invalid value in the file.
    """
    system = config.problem.system
    if system not in EXPORTERS:
        expected = f"a system whose controller can be exported: {', '.join(EXPORTERS)}"
        raise ProblemFileError(config.file, "system", system, expected)
    return EXPORTERS[system](config, progress, memory)


def _pose_tracking(config: ProblemFile[Any], progress: Progress, _: int | None) -> Sequence[ExportedController]:
    from rehab_opt.export.controllers.pose_tracker import exported_pose_tracker  # noqa: PLC0415  (loads solvers)

    return (exported_pose_tracker(config, progress=progress),)


def _ardis(config: ProblemFile[Any], progress: Progress, _: int | None) -> Sequence[ExportedController]:
    from rehab_opt.export.controllers.redundancy import exported_resolvers  # noqa: PLC0415

    return exported_resolvers(config, progress=progress)


def _scenario(config: ProblemFile[Any], progress: Progress, _: int | None) -> Sequence[ExportedController]:
    from rehab_opt.export.controllers.scenario import exported_scenario  # noqa: PLC0415

    return exported_scenario(config, progress=progress)


def _mirror(config: ProblemFile[Any], progress: Progress, memory: int | None) -> Sequence[ExportedController]:
    from rehab_opt.export.controllers.mirror import MEMORY, exported_mirror_problem  # noqa: PLC0415

    given = MEMORY if memory is None else memory
    return (exported_mirror_problem(config, memory=given, progress=progress),)


EXPORTERS: Mapping[str, Exporter] = MappingProxyType(
    {"pose_tracking": _pose_tracking, "ardis": _ardis, "scenario": _scenario, "mirror": _mirror}
)
