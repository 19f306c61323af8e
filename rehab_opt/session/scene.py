"""Base classes of problems with a robot in a closed loop.

A `SceneSystem` and a `Scene` define a kind of problem. The scene builds robot and controller, gives the inputs of each
tick, and computes metrics and notes from a trace; the system draws figures from traces.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

from rehab_opt.control.command import Command
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.live.bodies import ORANGE, ArmBodies, joint_rows
from rehab_opt.session.live.problem import LiveControl, LiveInputs, LiveProblem
from rehab_opt.session.outcome import Array, Names, Outcome, Progress
from rehab_opt.session.schema import Problem
from rehab_opt.session.simulation import simulate
from rehab_opt.session.systems import System
from rehab_opt.session.trace import Trace

P = TypeVar("P", bound=Problem)
S = TypeVar("S", bound="Scene")
Shown = dict[str, Any]


class Plot(NamedTuple):
    """A number that the page plots: name, unit, and function from the drawn data to the number.

    `scale` may have `line`, the number's limit, or `least`, the smallest upper end of the plot's axis.
    """

    name: str
    unit: str
    of: Callable[[Shown], float]
    scale: Mapping[str, float] = {}


def arm_plots(chain: SerialChain) -> tuple[Plot, ...]:
    """Plots for any arm: smallest joint-limit margin, manipulability, and force on the hand."""
    ended = np.isfinite(chain.lower) & (chain.lower < chain.upper)

    def margin(of: Shown) -> float:
        return math.degrees(np.minimum(of["q"] - chain.lower, chain.upper - of["q"])[ended].min(initial=math.inf))

    return (
        Plot("joint-limit margin", "deg", margin),
        Plot("manipulability", "", lambda of: chain.manipulability(of["q"])),
        Plot("force", "N", lambda of: float(np.linalg.norm(of["force"])), {"least": 10.0}),
    )


class Scene(LiveProblem):
    """Base class of scenes with a robot in a closed loop.

    Attributes
    ----------
    chain, bodies : kinematics of the arm, and its drawn bodies. ticks : largest number of ticks of a run.
    plots : numbers that the page plots. still : fixed parts of the page's picture, and the camera.
    """

    chain: SerialChain
    bodies: ArmBodies
    ticks: int
    plots: tuple[Plot, ...]
    still: Mapping[str, Any]
    noise = "mrad"

    def inputs(self, k: int, control: Any) -> LiveInputs | None:
        """Inputs in tick k of a run; None ends the run."""
        given: LiveInputs = control.untouched(k * self.dt)
        return given

    def also(self, control: Any, command: Command) -> Mapping[str, Any]:
        """Further columns of the trace for a tick, computed before the tick's command is sent."""
        return {}

    def derived(self, trace: Trace) -> None:
        """Add columns that are computed from other columns, and name the components of array columns."""

    def run(self, progress: Progress = lambda *_: None, control: LiveControl | None = None) -> Trace:
        """Run the closed loop from rest, with `control` or, by default, a new control; return the trace."""
        made = self.control() if control is None else control
        trace = simulate(
            made,
            lambda k: self.inputs(k, made),
            ticks=self.ticks,
            also=lambda _, command: self.also(made, command),
            progress=partial(progress, ""),
        )
        self.derived(trace)
        return trace

    def numbers(self, trace: Trace) -> dict[str, Any]:
        """Metrics of a run for metrics.json; keys end in a statistic and a unit, as in `position_error_max_m`."""
        raise NotImplementedError

    def notes(self, trace: Trace) -> Iterator[str]:
        """Notes on a run; equal notes of several scenes are printed once."""
        return iter(())

    def scene(self) -> dict[str, Any]:
        """Data that the page gets once."""
        plots = [{"name": each.name, "unit": each.unit, **each.scale} for each in self.plots]
        own = {"joints": joint_rows(self.chain), "plots": plots, "noise": self.noise}
        return {**super().scene(), **own, **self.still}

    def frame(self, shown: Mapping[str, Array]) -> dict[str, Any]:
        """Data that the page gets 30 times a second: arm, handles, force on the hand, and plotted numbers."""
        of = dict(shown, hand=self.bodies.tool(shown["q"])[:, 3])
        return {
            "capsules": self.bodies.capsules(of["q"]),
            "handles": {name: of[name].round(4).tolist() for name in ("target", "hand") if name in of},
            "arrows": [[*of["hand"].tolist(), *of["force"].tolist(), ORANGE]] if of["force"].any() else [],
            "joints": of["q"].round(4).tolist(),
            "numbers": [round(each.of(of), 4) for each in self.plots],
        }


class SceneSystem(System[P, S], Generic[P, S]):
    """Base class of systems with a robot in a closed loop."""

    options = frozenset({"plant", "solver"})

    def nested(self, numbers: Mapping[Names, dict[str, Any]], outcome: Outcome) -> dict[str, Any]:
        """The metrics of each scene by the name of its controller."""
        return {law: of for (law,), of in numbers.items()}

    def live(self, config: ProblemFile[P], *, options: Mapping[str, str]) -> LiveProblem:
        """The first scene of a problem, with options as for `run`."""
        return next(iter(self.scenes(config, options).values()))
