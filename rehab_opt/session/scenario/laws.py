"""The three controllers of a trial, in the interface of the loop: none, ours, and the paper's."""

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
    """A controller from positions to forces."""

    notes: tuple[str, ...] = ()
    """Notes on parameters that do not fit together."""
    desired_force: tuple[float, float] = NONE
    """[N] Desired force of the last tick, before bounds."""
    energy_left: float = math.nan
    """[J] Energy left in the tank; NaN without a tank."""
    led: tuple[float, float] | None = None
    """[m] Position to which the live user leads the helper's hand, in the helper's workspace; None: the helper follows
    their own intention."""
    along: tuple[float, float, float, float] = (math.nan,) * 4
    """[m, N] Position of the helper's hand, and the force on it; NaN without a helper."""

    def start(self, number: int) -> None:  # noqa: B027  (most have nothing to forget)
        """Start a trial."""

    def set_goal(self, goal: int) -> None:  # noqa: B027  (most have one field for all)
        """Set a new goal."""

    @abstractmethod
    def command(self, x: float, y: float, *, enable: object = True, stamp: float | None = None) -> Command:
        """The force (2,) [N] for a hand at (x, y) [m]; `enable` and `stamp` as in `Assistance.step`."""

    def partner(self) -> dict[str, Array]:
        """Trace columns of the helper; empty without one."""
        return {}


class Unassisted(ForceLaw):
    """The robot follows the hand and adds no force."""

    def command(self, x: float, y: float, *, enable: object = True, stamp: float | None = None) -> Command:
        """Zero force."""
        return uncertified(NONE)


def uncertified(force: tuple[float, float]) -> Command:
    """A command with a force [N] of a controller without a certificate."""
    return Command(np.array(force), Status.OK, "", math.inf, -1, "", Relaxed.NOTHING, 1.0)


class Assisted(ForceLaw):
    """`Assistance` or `PathAssistance`, which estimate the velocity from the positions."""

    def __init__(self, assistance: Assistance | PathAssistance) -> None:
        self._assistance, self.notes = assistance, assistance.notes

    def start(self, number: int) -> None:
        """Start with zero force and a full tank."""
        self._assistance.reset()
        self.desired_force, self.energy_left = NONE, self._assistance.energy_left

    def command(self, x: float, y: float, *, enable: object = True, stamp: float | None = None) -> Command:
        """The certified force, with its status and reason."""
        command = self._assistance.step((x, y), enable=enable, stamp=stamp)
        self.desired_force, self.energy_left = self._assistance.desired_force, self._assistance.energy_left
        return command


class AssistedAtPoints(Assisted):
    """Holds one point after the other; between points a `Smoother` shifts the field.

    A field that jumps to the next point would pull the hand there with its full force.

    Parameters
    ----------
    assistance : with the field of points[0]. points : (M, 2) [m]. pace : limits the motion of the field.
    """

    def __init__(self, assistance: Assistance, points: Array, pace: Smoother) -> None:
        super().__init__(assistance)
        self._shifting = assistance
        self._points, self._pace = points, pace

    def start(self, number: int) -> None:
        """Start at the first point."""
        super().start(number)
        self._goal, self._there = self._points[0], False
        self._pace.reset(self._points[0])

    def set_goal(self, goal: int) -> None:
        """Move to the next point."""
        self._goal, self._there = self._points[goal], False

    def command(self, x: float, y: float, *, enable: object = True, stamp: float | None = None) -> Command:
        """The certified force towards the field's current position."""
        if not self._there:
            to_x, to_y = (self._pace.step(self._goal).value - self._points[0]).tolist()
            self._shifting.shift(to_x, to_y)
            self._there = self._pace.arrived
        return super().command(x, y, enable=enable, stamp=stamp)


class Published(ForceLaw):
    """Eq. (20) with a hard gate and a clip; velocities are differences of positions, `dt` [s] apart."""

    def __init__(self, law: FieldLaw, *, dt: float) -> None:
        self._law, self._dt = law, dt
        self.start(0)

    def start(self, number: int) -> None:
        """Forget the last position: the velocity is unknown."""
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
"""Controllers with a slew limit."""


def swinging_notes(laws: Mapping[Law, ForceLaw]) -> Iterator[str]:
    """The notes of `settling_notes` for each controller, with the keys of a problem file."""
    for name, law in laws.items():
        for note in law.notes:
            yield f"{name}: {note.replace('slew_limit =', 'assistance.slew_limit_N_s =')}"


def bounds_of(problem: ScenarioProblem, *, solver: str | None) -> ForceBounds:
    """Bounds that both sides of a pair share with the assistance; `solver` overrides the file's."""
    keys = ("slew_limit_N_s", "growth_limit_N_s", "energy_budget_J", "speed_cap_m_s")
    return {
        **problem.assistance.arguments(*keys),  # type: ignore[typeddict-item]
        "trust_stillness": True,  # a simulated sensor does not freeze
        "solver": solver or problem.run.solver or FUSED,
        "dt": 1 / problem.run.rate_hz,
    }


@contextmanager
def bounds_refusals(config: ProblemFile[ScenarioProblem], *, solver: str | None, section: str) -> Iterator[None]:
    """Name the file's key, or `--solver`, if a controller refuses it.

    Raises
    ------
    ProblemFileError : a value of the file is not valid.
    ConfigurationError : `solver` is not valid.
    """
    own = {"solver": "run.solver"}
    with (
        solver_refusals(solver, file=config.file, key="run.solver", value=config.problem.run.solver),
        refused_as(config.file, lambda name: own.get(name, f"{section}, {name}"), option=solver),
    ):
        yield


def check_bounds(config: ProblemFile[ScenarioProblem], *, solver: str | None) -> None:
    """Check solver and bounds before any computation; see `bounds_refusals`."""
    problem = config.problem
    with bounds_refusals(config, solver=solver, section="assistance"):
        BoundedForce(
            lambda *_: (0.0, 0.0), force_limit=problem.assistance.force_limit_N, **bounds_of(problem, solver=solver)
        )
