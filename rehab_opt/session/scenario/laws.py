"""The three laws of a trial, as a loop calls them: none, ours, the paper's."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import numpy as np

from rehab_opt.control.assistance import Assistance
from rehab_opt.control.bounded_force import BoundedForce, ForceBounds
from rehab_opt.control.command import Command, Relaxed, Status
from rehab_opt.control.path_assistance import PathAssistance
from rehab_opt.control.smoother import Smoother
from rehab_opt.optim.fallback_chain import FUSED
from rehab_opt.published.field_law import FieldLaw
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.outcome import Array
from rehab_opt.session.refusals import refused_as, solver_refusals
from rehab_opt.session.scenario.problem import ScenarioProblem
from rehab_opt.session.scenario.trials import Law

__all__ = [
    "BOUNDED",
    "Assisted",
    "AssistedAtPoints",
    "ForceLaw",
    "Published",
    "Unassisted",
    "bounds_of",
    "bounds_refusals",
    "check_bounds",
    "swinging_notes",
]


NONE = (0.0, 0.0)


class ForceLaw(ABC):
    """Positions in, forces out."""

    notes: tuple[str, ...] = ()
    """What of its numbers does not go together."""
    desired_force: tuple[float, float] = NONE
    """[N] desired in the last tick, before bounds."""
    energy_left: float = math.nan
    """[J] in the tank; NaN where there is none."""
    led: tuple[float, float] | None = None
    """[m] Where somebody leads the hand of who does it along, in their workspace; None: where that one means to be."""
    along: tuple[float, float, float, float] = (math.nan,) * 4
    """[m, N] That hand, and the force on it; NaN where there is none."""

    def start(self, number: int) -> None:  # noqa: B027  (most have nothing to forget)
        """A trial begins."""

    def set_goal(self, goal: int) -> None:  # noqa: B027  (most have one field for all)
        """The goal has changed."""

    @abstractmethod
    def command(self, x: float, y: float, *, enable: object = True, stamp: float | None = None) -> Command:
        """The force (2,) [N] for a hand at (x, y) [m]; `enable` and `stamp` as a controller takes them."""

    def partner(self) -> dict[str, Array]:
        """Columns of who has done the trial along with the participant; none where there is nobody."""
        return {}


class Unassisted(ForceLaw):
    """The robot follows the hand without a force of its own."""

    def command(self, x: float, y: float, *, enable: object = True, stamp: float | None = None) -> Command:
        """No force."""
        return uncertified(NONE)


def uncertified(force: tuple[float, float]) -> Command:
    """A force [N] of a law that certifies nothing."""
    return Command(np.array(force), Status.OK, "", math.inf, -1, "", Relaxed.NOTHING, 1.0)


class Assisted(ForceLaw):
    """`Assistance` or `PathAssistance`, which estimate the velocity from the positions."""

    def __init__(self, assistance: Assistance | PathAssistance) -> None:
        self._assistance, self.notes = assistance, assistance.notes

    def start(self, number: int) -> None:
        """No force yet, and a full tank."""
        self._assistance.reset()
        self.desired_force, self.energy_left = NONE, self._assistance.energy_left

    def command(self, x: float, y: float, *, enable: object = True, stamp: float | None = None) -> Command:
        """The certified force with how it came about."""
        command = self._assistance.step((x, y), enable=enable, stamp=stamp)
        self.desired_force, self.energy_left = self._assistance.desired_force, self._assistance.energy_left
        return command


class AssistedAtPoints(Assisted):
    """Holds one point after the other; on the way from one to the next the field is shifted by a `Smoother`.

    A field that jumped to the next point would pull the hand there as fast as its force allows.

    Parameters
    ----------
    assistance : with the field of points[0]. points : (M, 2) [m]. pace : how fast the field is shifted.
    """

    def __init__(self, assistance: Assistance, points: Array, pace: Smoother) -> None:
        super().__init__(assistance)
        self._shifting = assistance
        self._points, self._pace = points, pace

    def start(self, number: int) -> None:
        """At the first point."""
        super().start(number)
        self._goal, self._there = self._points[0], False
        self._pace.reset(self._points[0])

    def set_goal(self, goal: int) -> None:
        """To the next one."""
        self._goal, self._there = self._points[goal], False

    def command(self, x: float, y: float, *, enable: object = True, stamp: float | None = None) -> Command:
        """The certified force towards where the field now is."""
        if not self._there:
            to_x, to_y = (self._pace.step(self._goal).value - self._points[0]).tolist()
            self._shifting.shift(to_x, to_y)
            self._there = self._pace.arrived
        return super().command(x, y, enable=enable, stamp=stamp)


class Published(ForceLaw):
    """Eq. (20) with a hard gate and a clip; velocities by differences of positions, `dt` [s] apart."""

    def __init__(self, law: FieldLaw, *, dt: float) -> None:
        self._law, self._dt = law, dt
        self.start(0)

    def start(self, number: int) -> None:
        """Nothing is known of the velocity."""
        self._last: tuple[float, float] | None = None

    def command(self, x: float, y: float, *, enable: object = True, stamp: float | None = None) -> Command:
        """The clipped force."""
        before = self._last or (x, y)
        self._last = (x, y)
        velocity = ((x - before[0]) / self._dt, (y - before[1]) / self._dt)
        force_x, force_y = self._law.force(np.array((x, y)), np.array(velocity)).tolist()
        self.desired_force = (force_x, force_y)
        return uncertified(self.desired_force)


BOUNDED: tuple[Law, ...] = ("assisted", "together", "delayed")
"""Laws that have a slew limit."""


def swinging_notes(laws: Mapping[Law, ForceLaw]) -> Iterator[str]:
    """What `settling_notes` has to say of each law, in the keys of a problem file."""
    for name, law in laws.items():
        for note in law.notes:
            yield f"{name}: {note.replace('slew_limit =', 'assistance.slew_limit_N_s =')}"


def bounds_of(problem: ScenarioProblem, *, solver: str | None) -> ForceBounds:
    """What both sides of a pair and the assistance have in common; `solver` goes before the file's."""
    keys = ("slew_limit_N_s", "growth_limit_N_s", "energy_budget_J", "speed_cap_m_s")
    return {
        **problem.assistance.arguments(*keys),  # type: ignore[typeddict-item]
        "trust_stillness": True,  # a simulated sensor does not freeze
        "solver": solver or problem.run.solver or FUSED,
        "dt": 1 / problem.run.rate_hz,
    }


@contextmanager
def bounds_refusals(config: ProblemFile[ScenarioProblem], *, solver: str | None, section: str) -> Iterator[None]:
    """Name the file's key, or `--solver`, where a law cannot be made.

    Raises
    ------
    ProblemFileError : a value of the file is refused.
    ConfigurationError : `solver` is.
    """
    own = {"solver": "run.solver"}
    with (
        solver_refusals(solver, file=config.file, key="run.solver", value=config.problem.run.solver),
        refused_as(config.file, lambda name: own.get(name, f"{section}, {name}"), option=solver),
    ):
        yield


def check_bounds(config: ProblemFile[ScenarioProblem], *, solver: str | None) -> None:
    """Refuse solver and bounds before anything is computed; see `bounds_refusals`."""
    problem = config.problem
    with bounds_refusals(config, solver=solver, section="assistance"):
        BoundedForce(
            lambda *_: (0.0, 0.0), force_limit=problem.assistance.force_limit_N, **bounds_of(problem, solver=solver)
        )
