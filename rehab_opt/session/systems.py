"""The kinds of problems, and the interface of a kind.

A kind is a class that derives from `System`, and has a name. Shipped kinds are in `SHIPPED`. Another distribution
names its kinds in the entry point group `rehab_opt.systems`:

    [project.entry-points."rehab_opt.systems"]
    circle = "my_package.circle:CircleSystem"

A kind is imported at its first use.
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
from rehab_opt.session.schema import Problem, Section
from rehab_opt.session.trace import Trace

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.table import Table

    from rehab_opt.kinematics.chain import SerialChain
    from rehab_opt.session.live.problem import LiveProblem

P = TypeVar("P", bound=Problem)
P_co = TypeVar("P_co", bound=Problem, covariant=True)
S = TypeVar("S", bound="Traced")

GROUP = "rehab_opt.systems"
"""Group of entry points that name kinds of problems outside this package."""
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
"""Key that names a robot file, which refers to other files in turn."""


class Needed(NamedTuple):
    """A recording or robot file that a problem needs: its key and the value there."""

    key: str
    reference: str


def needed_files(section: Section, above: str = "") -> Iterator[Needed]:
    """The files that a problem names, by `Section.FILES`; entries of lists count from 0."""
    for key in type(section).model_fields:
        value = getattr(section, key)
        entries = {f".{i}": each for i, each in enumerate(value)} if isinstance(value, list) else {"": value}
        for number, each in entries.items():
            if isinstance(each, Section):
                yield from needed_files(each, f"{above}{key}{number}.")
            elif key in section.FILES and each is not None:
                yield Needed(f"{above}{key}{number}", each)


@dataclass(frozen=True)
class ProblemFile(Generic[P_co]):
    """A validated problem.

    Parameters
    ----------
    name : `upper_limb/figure_eight` for a shipped problem, the file's stem for others.
    file : the file as the user named it, for errors.
    path : its path.
    problem : its content.
    """

    name: str
    file: str
    path: Path
    problem: P_co


class NotMet(str):
    """A note that a run would not do what its file specifies."""

    __slots__ = ()


class Traced(Protocol):
    """A single run: numbers and notes are functions of its trace."""

    def run(self, progress: Progress) -> Trace:
        """The trace of the run."""
        ...

    def numbers(self, trace: Trace) -> dict[str, Any]:
        """Numbers for metrics.json; keys end in their statistic and unit."""
        ...

    def notes(self, trace: Trace) -> Iterable[str]:
        """Notes for a reader of the numbers; equal notes of several scenes are printed once."""
        ...


class System(Generic[P, S]):
    """A kind of problem: it must have `schema` and `scenes`; everything else has defaults.

    Attributes
    ----------
    schema : class of its problem files.
    options : names of the options of `rehab-opt run` that it accepts; others are refused before the run. With "plant",
        the problem gets the table that `--plant` selects; a solver that cannot be built is refused.
    solver_key : key of the solver in the problem file, which `--solver` overrides; empty if there is none.
    rate_key : key of the controllers' rate in ticks per second; empty if there is none.
    first : the few most important quantities, as for `numbers_table`; empty if there are only few.
    labels : meaning of the parts of a scene's name.
    drawing : module with a function `figures` of an outcome, imported when a run is drawn.
    """

    schema: type[P]
    options: ClassVar[frozenset[str]] = frozenset()
    solver_key: ClassVar[str] = ""
    rate_key: ClassVar[str] = ""
    first: ClassVar[tuple[str, ...]] = ()
    labels: ClassVar[Names] = ()
    drawing: ClassVar[str] = ""

    def check(self, config: ProblemFile[P]) -> tuple[str, ...]:
        """Check everything that can be checked without a run, and return the notes.

        Raises
        ------
        ProblemFileError : a value of the file or a recording is not valid.
        """
        return ()

    def arms(self, config: ProblemFile[P]) -> dict[str, SerialChain]:
        """The arms whose range of motion the problem defines, by the names of the ranges; by default none.

        Raises
        ------
        ProblemFileError : a value of the file is not valid for the arm.
        """
        return {}

    def scenes(self, config: ProblemFile[P], options: Mapping[str, str]) -> Mapping[Names, S]:
        """The scenes of a run by name, in the order of the run.

        Raises
        ------
        ProblemFileError : as `check`.
        ConfigurationError : the value of an option is not valid.
        """
        raise NotImplementedError

    def nested(self, numbers: Mapping[Names, dict[str, Any]], outcome: Outcome) -> dict[str, Any]:
        """The metrics of a run, from the numbers of each scene; `outcome` has only scenes and traces at this time."""
        (of,) = numbers.values()
        return of

    def run(self, config: ProblemFile[P], *, options: Mapping[str, str], progress: Progress) -> Outcome:
        """Run each scene once; no files are written. Raises as `scenes`."""
        scenes, traces = self.scenes(config, options), dict[Names, Trace]()
        for names, scene in scenes.items():
            traces[names] = scene.run(partial(_named, progress, names))
        numbers = {names: scene.numbers(traces[names]) for names, scene in scenes.items()}
        outcome = Outcome(traces=traces, scenes=scenes, labels=self.labels, table=numbers)
        metrics, notes = self.nested(numbers, outcome), self.notes(numbers, outcome)
        return replace(outcome, metrics=metrics, notes=tuple(dict.fromkeys(notes)))

    def notes(self, numbers: Mapping[Names, dict[str, Any]], outcome: Outcome) -> Iterator[str]:
        """The notes of all scenes; arguments as for `nested`."""
        for names, scene in outcome.scenes.items():
            yield from scene.notes(outcome.traces[names])

    def live(self, config: ProblemFile[P], *, options: Mapping[str, str]) -> LiveProblem:
        """The problem for a run in real time; most kinds have none. Call `live_problem` instead, which reports this.

        Raises
        ------
        ProblemFileError : as `check`.
        ConfigurationError : the value of an option is not valid.
        """
        raise NotImplementedError

    def columns(self, outcome: Outcome) -> Mapping[str, Mapping[str, Any]]:
        """Numbers of each column of the table; by default one column for each scene."""
        return {"\n".join(map(str, names)) or "value": of for names, of in outcome.table.items()}

    def caption(self, outcome: Outcome) -> str:
        """Text below the table."""
        return ""

    def table(self, outcome: Outcome) -> Table:
        """The full table of results for the terminal."""
        from rehab_opt.session.tables import numbers_table  # noqa: PLC0415  (loads rich)

        return numbers_table(outcome.title, self.columns(outcome), caption=self.caption(outcome))

    def brief(self, outcome: Outcome) -> Table | None:
        """The few most important numbers; None if there are only few."""
        if not self.first:
            return None
        from rehab_opt.session.tables import numbers_table  # noqa: PLC0415  (loads rich)

        return numbers_table(outcome.title, self.columns(outcome), first=self.first, caption=self.caption(outcome))

    def figures(self, outcome: Outcome) -> dict[str, Figure]:
        """The figures by file name without suffix: those of `drawing`, by default all columns over time."""
        if self.drawing:
            drawn: dict[str, Figure] = importlib.import_module(self.drawing).figures(outcome)
            return drawn
        from rehab_opt.session.drawing import columns_figure  # noqa: PLC0415  (draws)

        return columns_figure(dict(outcome.trace()))


def _named(progress: Progress, names: Names, what: str, done: int, among: int) -> None:
    progress(", ".join(map(str, filter(None, (*names, what)))), done, among)


def value_at(problem: Problem, key: str) -> Any:
    """Value of a problem at a dotted key."""
    return reduce(getattr, key.split("."), problem)


def systems() -> dict[str, str]:
    """Location `module:class` of each kind of problem, by name: shipped ones first, then others."""
    others = {each.name: each.value for each in entry_points(group=GROUP) if each.name not in SHIPPED}
    return {**SHIPPED, **others}


def system_named(name: str) -> System[Any, Any]:
    """The system with this name in problem files; shipped ones take precedence.

    Raises
    ------
    ConfigurationError : unknown name, or an entry point that cannot be loaded.
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
