"""The kinds of problems there are: the one place that knows a system by its name.

A new system is a module with a class that has what `System` asks for, and a line in `SYSTEMS`; the schema of its files,
its run, its table, its figures and its trace stand beside it. Nothing of a system is imported before it is asked for.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, TypeVar, runtime_checkable

from rehab_opt.errors import ConfigurationError
from rehab_opt.session.outcome import Outcome, Progress
from rehab_opt.session.schema import Problem

if TYPE_CHECKING:
    from matplotlib.animation import Animation
    from matplotlib.figure import Figure
    from rich.table import Table

    from rehab_opt.kinematics.chain import SerialChain
    from rehab_opt.session.ardis.outcome import ArdisOutcome
    from rehab_opt.session.ardis.problem import ArdisProblem
    from rehab_opt.session.files import ProblemFile
    from rehab_opt.session.mirror.outcome import MirrorOutcome
    from rehab_opt.session.mirror.problem import MirrorProblem
    from rehab_opt.session.pose_tracking.outcome import RobotOutcome
    from rehab_opt.session.pose_tracking.problem import PoseTracking
    from rehab_opt.session.scenario.outcome import ScenarioOutcome
    from rehab_opt.session.scenario.problem import ScenarioProblem
    from rehab_opt.session.upper_limb.outcome import ArmOutcome
    from rehab_opt.session.upper_limb.problem import UpperLimb
    from rehab_opt.session.used_ranges.outcome import UsedRangesOutcome
    from rehab_opt.session.used_ranges.problem import UsedRangesProblem
    from rehab_opt.session.workspace_maps.outcome import MapOutcome
    from rehab_opt.session.workspace_maps.problem import WorkspaceMapProblem
    from rehab_opt.session.workspaces.outcome import WorkspaceOutcome
    from rehab_opt.session.workspaces.problem import WorkspaceProblem

__all__ = ["ROBOT_FILE", "SYSTEMS", "Animated", "Column", "Needed", "OfPeople", "Recorded", "System", "system_named"]

P = TypeVar("P", bound=Problem)
O = TypeVar("O", bound=Outcome)  # noqa: E741  (an outcome)

Column = tuple[str, list[float] | list[int] | tuple[str, ...]]
"""Header, which ends in the unit, and cells of one column of trace.csv."""


ROBOT_FILE = "robot.file"
"""Key of a file that describes a robot, and names other files."""


class Needed(NamedTuple):
    """A recording, or a robot file, that a problem needs: the key that names it, and what it says there."""

    key: str
    reference: str


class System(Protocol[P, O]):
    """What a session asks of one kind of problem.

    Attributes
    ----------
    schema : what its files may say.
    options : names of the options of `rehab-opt run` that it knows; others are refused before it is run.
    """

    @property
    def schema(self) -> type[P]: ...  # noqa: D102  (above)

    @property
    def options(self) -> frozenset[str]: ...  # noqa: D102

    def recordings(self, problem: P) -> tuple[Needed, ...]:
        """The recordings and robot files it needs."""
        ...

    def check(self, loaded: ProblemFile[P]) -> tuple[str, ...]:
        """Everything that can be checked without running it; what was noticed on the way.

        Raises
        ------
        ProblemFileError : a value of the file or a recording cannot be used.
        """
        ...

    def run(self, loaded: ProblemFile[P], *, options: Mapping[str, str], progress: Progress) -> O:
        """The problem from its file to its numbers; nothing is written.

        Raises
        ------
        ProblemFileError : as `check`.
        ConfigurationError : an option's value cannot be used.
        """
        ...

    def table(self, outcome: O) -> Table:
        """The result for the terminal."""
        ...

    def trace(self, outcome: O) -> Iterator[Column]:
        """The columns of trace.csv, all of one length."""
        ...

    def figures(self, outcome: O) -> dict[str, Figure]:
        """The figures by file name, without suffix."""
        ...


@runtime_checkable
class Animated(Protocol):
    """A system that also shows its runs as films."""

    def animations(self, outcome: Any) -> dict[str, Animation]:
        """The films by file name, without suffix."""
        ...


@runtime_checkable
class OfPeople(Protocol):
    """A system whose problems state the range of motion of arms."""

    def arms(self, loaded: ProblemFile[Any]) -> dict[str, SerialChain]:
        """The arms by what their ranges of motion are called.

        Raises
        ------
        ProblemFileError : the kinematics refuses a value of the file.
        """
        ...


@runtime_checkable
class Recorded(Protocol):
    """A system whose controllers solve QPs as it runs: `rehab-opt record` writes them down."""

    def seconds_a_tick(self, problem: Any) -> float:
        """From one QP to the next; NaN where they are no ticks, as iterations are."""
        ...


def system_named(name: str) -> System[Any, Any]:
    """The system that a problem file calls by this name.

    Raises
    ------
    ConfigurationError : there is none.
    """
    if name not in SYSTEMS:
        raise ConfigurationError("system", name, f"one of {', '.join(SYSTEMS)}")
    return SYSTEMS[name]()


def _upper_limb() -> System[UpperLimb, ArmOutcome]:
    from rehab_opt.session.upper_limb.system import UpperLimbSystem  # noqa: PLC0415  (what is not used is not loaded)

    return UpperLimbSystem()


def _pose_tracking() -> System[PoseTracking, RobotOutcome]:
    from rehab_opt.session.pose_tracking.system import PoseTrackingSystem  # noqa: PLC0415

    return PoseTrackingSystem()


def _mirror() -> System[MirrorProblem, MirrorOutcome]:
    from rehab_opt.session.mirror.system import MirrorSystem  # noqa: PLC0415

    return MirrorSystem()


def _workspace() -> System[WorkspaceProblem, WorkspaceOutcome]:
    from rehab_opt.session.workspaces.system import WorkspaceSystem  # noqa: PLC0415

    return WorkspaceSystem()


def _workspace_map() -> System[WorkspaceMapProblem, MapOutcome]:
    from rehab_opt.session.workspace_maps.system import WorkspaceMapSystem  # noqa: PLC0415

    return WorkspaceMapSystem()


def _used_ranges() -> System[UsedRangesProblem, UsedRangesOutcome]:
    from rehab_opt.session.used_ranges.system import UsedRangesSystem  # noqa: PLC0415

    return UsedRangesSystem()


def _scenario() -> System[ScenarioProblem, ScenarioOutcome]:
    from rehab_opt.session.scenario.system import ScenarioSystem  # noqa: PLC0415

    return ScenarioSystem()


def _ardis() -> System[ArdisProblem, ArdisOutcome]:
    from rehab_opt.session.ardis.system import ArdisSystem  # noqa: PLC0415

    return ArdisSystem()


SYSTEMS: Mapping[str, Callable[[], System[Any, Any]]] = MappingProxyType(
    {
        "upper_limb": _upper_limb,
        "pose_tracking": _pose_tracking,
        "mirror": _mirror,
        "workspace": _workspace,
        "workspace_map": _workspace_map,
        "used_ranges": _used_ranges,
        "scenario": _scenario,
        "ardis": _ardis,
    }
)
