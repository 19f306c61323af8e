"""The controllers of a trial as `ForceLaw`, which the closed loop calls: none, ours, and the paper's."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np

from rehab_opt.control.assistance import Assistance
from rehab_opt.control.bounded_force import BoundedForce
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

NONE = (0.0, 0.0)


class ForceLaw:
    """Base class of controllers that compute a force from the hand's position; this one commands no force."""

    notes: tuple[str, ...] = ()
    """Notes on parameters that do not fit together."""
    desired_force: tuple[float, float] = NONE
    """[N] Desired force of the last tick, before bounds."""
    energy_left: float = math.nan
    """[J] Energy left in the tank; NaN without a tank."""
    led: tuple[float, float] | None = None
    """[m] Position to which the live user leads the helper's hand, in the helper's workspace; None: the helper follows
    their own intention."""
    along: tuple[float, ...] = (math.nan,) * 7
    """Seven numbers: position of the helper's hand [m], force on it [N], energy in its tank [J], and its intended
    position
    [m]; NaN without a helper."""

    def start(self, number: int) -> None:
        """Start a trial."""

    def set_goal(self, goal: int) -> None:
        """Set the number of the current goal."""

    def command(self, x: float, y: float, *, enable: object = True, stamp: float | None = None) -> Command:
        """The force (2,) [N] for a hand at (x, y) [m]; `enable` and `stamp` as in `Assistance.step`."""
        return Command(np.array(self.desired_force), Status.OK, "", math.inf, -1, "", Relaxed.NOTHING, 1.0)


class Assisted(ForceLaw):
    """The controller `Assistance` or `PathAssistance`, which estimates the velocity from the positions.

    Parameters
    ----------
    assistance : the controller; if points are held, it has the field of the first one.
    points, pace : (M, 2) [m] points to hold, and the smoother that moves the field from one to the next. If the field
        jumped, it would pull the hand to the next point with its full force.
    """

    def __init__(
        self, assistance: Assistance | PathAssistance, points: Array | None = None, pace: Smoother | None = None
    ) -> None:
        self._assistance, self._points, self._pace, self.notes = assistance, points, pace, assistance.notes

    def start(self, number: int) -> None:
        """Start with zero force and a full tank, at the first point."""
        self._assistance.reset()
        self.desired_force, self.energy_left = NONE, self._assistance.energy_left
        if self._pace is not None and self._points is not None:
            self._pace.reset(self._points[0])
        self.set_goal(0)

    def set_goal(self, goal: int) -> None:
        """Move the field to the point number `goal`."""
        self._goal, self._there = goal, self._points is None

    def command(self, x: float, y: float, *, enable: object = True, stamp: float | None = None) -> Command:
        """The certified force, with its status and reason."""
        assistance = self._assistance
        if not self._there:
            assert self._pace is not None
            assert self._points is not None
            assert isinstance(assistance, Assistance)
            assistance.shift(*(self._pace.step(self._points[self._goal]).value - self._points[0]).tolist())
            self._there = self._pace.arrived
        command = assistance.step((x, y), enable=enable, stamp=stamp)
        self.desired_force, self.energy_left = assistance.desired_force, assistance.energy_left
        return command


class Published(ForceLaw):
    """Eq. (20) with a hard gate and a clipped force; the velocity is the change of position in a tick of `dt` [s]."""

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
        return super().command(x, y)


BOUNDED: tuple[Law, ...] = ("assisted", "together", "delayed")
"""Controllers with a slew limit."""


def swinging_notes(laws: Mapping[Law, ForceLaw]) -> Iterator[str]:
    """The notes of `settling_notes` for each controller, with the keys of a problem file."""
    for name, law in laws.items():
        for note in law.notes:
            yield f"{name}: {note.replace('slew_limit =', 'assistance.slew_limit_N_s =')}"


def bounds_of(problem: ScenarioProblem, *, solver: str | None, backup: str | None = None) -> dict[str, Any]:
    """Force bounds of the file as arguments of a controller; `solver` overrides the file's solver."""
    bounds = problem.assistance.arguments()
    del bounds["onset"]
    return {
        **bounds,
        "trust_stillness": True,  # a simulated sensor does not freeze
        "solver": solver or problem.run.solver or FUSED,
        "backup": backup,
        "dt": 1 / problem.run.rate_hz,
    }


@contextmanager
def bounds_refusals(config: ProblemFile[ScenarioProblem], *, solver: str | None, section: str) -> Iterator[None]:
    """Context in which errors of a controller name the file's key, or `--solver`."""
    own = {"solver": "run.solver"}
    with (
        solver_refusals(solver, file=config.file, key="run.solver", value=config.problem.run.solver),
        refused_as(config.file, lambda name: own.get(name, f"{section}, {name}"), option=solver),
    ):
        yield


def check_bounds(config: ProblemFile[ScenarioProblem], *, solver: str | None) -> None:
    """Check solver and bounds before any computation; see `bounds_refusals`."""
    with bounds_refusals(config, solver=solver, section="assistance"):
        BoundedForce(lambda *_: NONE, **bounds_of(config.problem, solver=solver))
