"""The kinds of problems there are, and what a session asks of one.

A kind is a class that derives from `System`, and a name: of the shipped ones in `SHIPPED`, of any other in the entry
points of the group `rehab_opt.systems` of the distribution that it comes with,

    [project.entry-points."rehab_opt.systems"]
    circle = "my_package.circle:CircleSystem"

It is imported when it is used.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial, reduce
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Generic, NamedTuple, Protocol, TypeVar

from rehab_opt.errors import ConfigurationError
from rehab_opt.session.outcome import Names, Outcome, Progress
from rehab_opt.session.schema import Problem
from rehab_opt.session.trace import Trace

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.table import Table

    from rehab_opt.kinematics.chain import SerialChain
    from rehab_opt.session.live.problem import LiveProblem

__all__ = [
    "GROUP",
    "ROBOT_FILE",
    "SHIPPED",
    "Names",
    "Needed",
    "NotMet",
    "ProblemFile",
    "System",
    "Traced",
    "system_named",
    "systems",
    "value_at",
]

P = TypeVar("P", bound=Problem)
P_co = TypeVar("P_co", bound=Problem, covariant=True)
S = TypeVar("S", bound="Traced")

GROUP = "rehab_opt.systems"
"""Of the entry points that name kinds of problems outside of this package."""
SHIPPED: Mapping[str, str] = MappingProxyType(
    {
        "upper_limb": "rehab_opt.session.upper_limb.scene:UpperLimbSystem",
        "pose_tracking": "rehab_opt.session.pose_tracking:PoseTrackingSystem",
        "mirror": "rehab_opt.session.mirror.run:MirrorSystem",
        "workspace": "rehab_opt.session.workspaces.scene:WorkspaceSystem",
        "workspace_map": "rehab_opt.session.workspace_maps.scene:WorkspaceMapSystem",
        "scenario": "rehab_opt.session.scenario.scene:ScenarioSystem",
        "ardis": "rehab_opt.session.ardis.scene:ArdisSystem",
    }
)
ROBOT_FILE = "robot.file"
"""Key of a file that describes a robot, and names other files."""


class Needed(NamedTuple):
    """A recording, or a robot file, that a problem needs: the key that names it, and what it says there."""

    key: str
    reference: str


@dataclass(frozen=True)
class ProblemFile(Generic[P_co]):
    """A checked problem.

    Parameters
    ----------
    name : what it is called: `upper_limb/figure_eight` for a shipped one, the file's stem for others.
    file : the file as the user named it, for errors.
    path : where it lies.
    problem : what it says.
    """

    name: str
    file: str
    path: Path
    problem: P_co


class NotMet(str):
    """A note that a run would not do what its file asks."""

    __slots__ = ()


class Traced(Protocol):
    """What is run once: numbers and notes are functions of its trace."""

    def run(self, progress: Progress) -> Trace:
        """Everything that happened."""
        ...

    def numbers(self, trace: Trace) -> dict[str, Any]:
        """For metrics.json; keys end in their statistic and unit."""
        ...

    def notes(self, trace: Trace) -> Iterable[str]:
        """What a reader of the numbers has to know; equal notes of several scenes are printed once."""
        ...


class System(Generic[P, S]):
    """A kind of problem: `schema` and `scenes`; the rest has defaults.

    Attributes
    ----------
    schema : what its files may say.
    options : names of the options of `rehab-opt run` that it knows; others are refused before it is run. With "plant",
        a problem is handed on with the table that the option asks for; a solver that cannot be made is refused.
    solver_key : where the problem file names the solver that `--solver` goes before; empty where it names none.
    rate_key : where it says how many ticks a second its controllers have; empty where they have none.
    first : the few quantities that matter first, as of `numbers_table`; empty where there are but few.
    labels : what the names of its scenes are.
    """

    schema: type[P]
    options: ClassVar[frozenset[str]] = frozenset()
    solver_key: ClassVar[str] = ""
    rate_key: ClassVar[str] = ""
    first: ClassVar[tuple[str, ...]] = ()
    labels: ClassVar[Names] = ()

    def recordings(self, problem: P) -> tuple[Needed, ...]:
        """The recordings and robot files it needs; none by default."""
        return ()

    def check(self, config: ProblemFile[P]) -> tuple[str, ...]:
        """Everything that can be checked without running it; what was noticed on the way.

        Raises
        ------
        ProblemFileError : a value of the file or a recording cannot be used.
        """
        return ()

    def arms(self, config: ProblemFile[P]) -> dict[str, SerialChain]:
        """The arms whose range of motion it states, by what these ranges are called; none by default.

        Raises
        ------
        ProblemFileError : the kinematics refuses a value of the file.
        """
        return {}

    def scenes(self, config: ProblemFile[P], options: Mapping[str, str]) -> Mapping[Names, S]:
        """What is run, one after the other, by its names.

        Raises
        ------
        ProblemFileError : as `check`.
        ConfigurationError : an option's value cannot be used.
        """
        raise NotImplementedError

    def nested(self, numbers: Mapping[Names, dict[str, Any]], outcome: Outcome) -> dict[str, Any]:
        """The metrics, of the numbers of each scene; `outcome` has scenes and traces only."""
        (of,) = numbers.values()
        return of

    def run(self, config: ProblemFile[P], *, options: Mapping[str, str], progress: Progress) -> Outcome:
        """Each scene once; nothing is written. Raises as `scenes`."""
        scenes, traces = self.scenes(config, options), dict[Names, Trace]()
        for names, scene in scenes.items():
            traces[names] = scene.run(partial(_named, progress, names))
        numbers = {names: scene.numbers(traces[names]) for names, scene in scenes.items()}
        outcome = Outcome(traces=traces, scenes=scenes, labels=self.labels, table=numbers)
        metrics, notes = self.nested(numbers, outcome), self.notes(numbers, outcome)
        return replace(outcome, metrics=metrics, notes=tuple(dict.fromkeys(notes)))

    def notes(self, numbers: Mapping[Names, dict[str, Any]], outcome: Outcome) -> Iterator[str]:
        """Those of each scene; as `nested`."""
        for names, scene in outcome.scenes.items():
            yield from scene.notes(outcome.traces[names])

    def live(self, config: ProblemFile[P], *, options: Mapping[str, str]) -> LiveProblem:
        """The problem to be run in real time; problems of most kinds are not. Ask `live_problem`, which says so.

        Raises
        ------
        ProblemFileError : as `check`.
        ConfigurationError : an option's value cannot be used.
        """
        raise NotImplementedError

    def seconds_a_tick(self, problem: P) -> float | None:
        """From one QP of its controllers to the next, for `python -m bench.record`; None where they solve none.

        NaN where the QPs are no ticks, as iterations are.
        """
        return 1 / value_at(problem, self.rate_key) if self.rate_key else None

    def columns(self, outcome: Outcome) -> Mapping[str, Mapping[str, Any]]:
        """Numbers of each column of the table; by default a column for each scene."""
        return {"\n".join(map(str, names)) or "value": of for names, of in outcome.table.items()}

    def caption(self, outcome: Outcome) -> str:
        """What stands below the table."""
        return ""

    def table(self, outcome: Outcome) -> Table:
        """The result for the terminal, all of it."""
        from rehab_opt.session.tables import numbers_table  # noqa: PLC0415  (loads rich)

        return numbers_table(outcome.title, self.columns(outcome), caption=self.caption(outcome))

    def brief(self, outcome: Outcome) -> Table | None:
        """The few numbers that matter first; None where there are but few."""
        if not self.first:
            return None
        from rehab_opt.session.tables import numbers_table  # noqa: PLC0415  (loads rich)

        return numbers_table(outcome.title, self.columns(outcome), first=self.first, caption=self.caption(outcome))

    def figures(self, outcome: Outcome) -> dict[str, Figure]:
        """The figures by file name, without suffix; by default all columns over time."""
        from rehab_opt.session.drawing import columns_figure  # noqa: PLC0415  (draws)

        return columns_figure(outcome.title, dict(outcome.trace()))


def _named(progress: Progress, names: Names, what: str, done: int, among: int) -> None:
    progress(", ".join(map(str, filter(None, (*names, what)))), done, among)


def value_at(problem: Problem, key: str) -> Any:
    """What a problem says at a dotted key."""
    return reduce(getattr, key.split("."), problem)


def systems() -> dict[str, str]:
    """Where each kind of problem is, `module:class` by name: the shipped ones, then those of other distributions."""
    others = {each.name: each.value for each in entry_points(group=GROUP) if each.name not in SHIPPED}
    return {**SHIPPED, **others}


def system_named(name: str) -> System[Any, Any]:
    """The system that a problem file calls by this name; a shipped one goes before any other of its name.

    Raises
    ------
    ConfigurationError : there is none, or an entry point leads to none.
    """
    if name in SHIPPED:
        module, _, attribute = SHIPPED[name].partition(":")
        made: System[Any, Any] = getattr(importlib.import_module(module), attribute)()
        return made
    for entry in entry_points(group=GROUP):
        if entry.name == name:
            return _config(entry)
    raise ConfigurationError("system", name, f"one of {', '.join(systems())}")


def _config(entry: EntryPoint) -> System[Any, Any]:
    expected = f"an entry point {entry.value!r} that leads to a class derived from System"
    try:
        found = entry.load()
    except (ImportError, AttributeError) as problem:
        raise ConfigurationError("system", entry.name, f"{expected} ({problem})") from problem
    if not (isinstance(found, type) and issubclass(found, System)):
        raise ConfigurationError("system", entry.name, expected)
    return found()
