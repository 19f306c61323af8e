"""Trials and outcomes of scenarios made by hand, with answers that are known."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.gate import Mode
from rehab_opt.field.potential import PotentialField
from rehab_opt.session.scenario.measures import trial_measures
from rehab_opt.session.scenario.precomputed import Precomputed
from rehab_opt.session.scenario.problem import THERAPY, AssistanceSection
from rehab_opt.session.scenario.scene import ScenarioTrials
from rehab_opt.session.scenario.trials import LAWS, Law, trial_trace
from rehab_opt.session.trace import Trace
from rehab_opt.workspace.region import Workspace

Array = NDArray[np.float64]

COMFORTABLE = Workspace(shapely.box(-0.05, 0.40, 0.05, 0.50), accuracy=1e-6)
REACHABLE = Workspace(shapely.Point(0.0, 0.45).buffer(0.25), accuracy=1e-6)
LINE = np.array([[0.0, 0.45], [0.20, 0.45]])
WITHIN = 0.005
NOTHING: Any = None
ALONE: tuple[Law, ...] = ("unassisted", "assisted", "published")
"""Laws without a helper."""


def minimum_jerk_speed(fraction: ArrayLike) -> Array:
    """Speed of a reach of length 1 in time 1 at a share of its time, zero before and after."""
    u = np.clip(np.asarray(fraction, dtype=np.float64), 0.0, 1.0)
    speed: Array = 30.0 * (u * (1.0 - u)) ** 2
    return speed


def trial_of(position: ArrayLike, *, dt: float = 0.01, ended: str = "done", **given: Any) -> Trace:
    """A trial along positions (N, 2): no force, never in W_c, no goal; columns that are given replace that."""
    places = np.asarray(position, dtype=np.float64)
    count = len(places)
    none = np.zeros((count, 2))
    velocity = np.gradient(places, dt, axis=0)
    columns: dict[str, Any] = {
        "t_s": dt * np.arange(count), "_hand": places, "velocity": velocity, "intended": places, "force_desired": none,
        "force_commanded": none, "force_measured": none, "inside": np.zeros(count, dtype=bool),
        "status": ["ok"] * count, "_let_go": np.zeros(count, dtype=bool), "_relaxed": np.zeros(count, dtype=np.uint8),
        "energy_left_J": np.full(count, 20.0), "goal": np.full((count, 2), np.nan),
    }  # fmt: skip
    return trial_trace(columns | given, ended=ended)


def wavering_trial(law: Law, number: int, mode: Mode, points: Array, *, seconds: float, rate: float = 200.0) -> Trace:
    """Along the reference by a minimum-jerk motion, with a wavering that assistance makes smaller; forces pull back."""
    rng = np.random.default_rng((number, LAWS.index(law)))
    count = int(seconds * rate) + 7 * number
    time = np.arange(count) / rate
    along = np.cumsum(minimum_jerk_speed(time / seconds))
    along /= along[-1]
    corners = np.linspace(0.0, 1.0, len(points))
    meant = np.column_stack([np.interp(along, corners, points[:, axis]) for axis in (0, 1)])
    size = 0.008 if law == "unassisted" else 0.002
    phase = rng.uniform(0, 2 * np.pi, 2)
    waver = size * np.sin(2 * np.pi * np.outer(time, (0.9, 1.3)) + phase)
    places = meant + waver
    inside = np.asarray(COMFORTABLE.contains(places))
    gate = inside == (mode not in THERAPY)
    force = np.zeros((count, 2)) if law == "unassisted" else np.where(gate[:, None], -1500.0 * waver, 0.0)
    goal = np.full((count, 2), np.nan)
    if mode == "hold":
        slot = np.minimum((len(points) * np.arange(count)) // count, len(points) - 1)
        late = (len(points) * np.arange(count)) % count > count // 3
        goal = np.where(late[:, None], points[slot], np.nan)
        places = points[slot] + waver
    own = {"helper": 3.0 * places, "helper_force": force / 3.0, "_helper_intended": 3.0 * meant}
    helper = own | {"helper_energy_left_J": np.full(count, 4.0)} if law == "together" else {}
    return trial_of(
        places, dt=1 / rate, intended=meant, force_desired=force, force_commanded=force, goal=goal,
        force_measured=force + 0.05 * rng.standard_normal((count, 2)), inside=inside,
        energy_left_J=np.full(count, 15.0 if law in ("assisted", "together") else np.nan),
        ended="late" if number else "done", **helper,
    )  # fmt: skip


def made_outcome(mode: Mode, *, trials: int = 3, laws: tuple[Law, ...] = ALONE) -> ScenarioTrials:
    """A scenario of a kind, with workspaces, fields and trials made by hand."""
    reference, fields = REFERENCES[mode](), FIELDS[mode]
    done = {
        law: tuple(wavering_trial(law, number, mode, reference, seconds=2.0) for number in range(trials))
        for law in laws
    }
    target = reference[-1] if mode in THERAPY else None
    measures = {
        law: tuple(trial_measures(of, reference=reference, mode=mode, target=target, within=WITHIN) for of in each)
        for law, each in done.items()
    }
    assistance, task = AssistanceSection(force_limit_N=30.0), SimpleNamespace(within_mm=1e3 * WITHIN)
    problem: Any = SimpleNamespace(mode=mode, assistance=assistance, task=task)
    config: Any = SimpleNamespace(problem=problem)
    context = Precomputed(
        config=config,
        comfortable=COMFORTABLE,
        reachable=REACHABLE,
        reference=reference,
        demonstrated=None if mode in THERAPY else 3.0 * (reference - (0.0, 0.45)) + (0.0, 0.45),
        workspace_map=None,
        fields=fields(reference),
        numbers={"stiffness": 2000.0, "width": 0.02, "damping": 0.0},
        drag=1.0,
        shown=(),
        intention=NOTHING,
        notes=(),
    )
    return ScenarioTrials(context, done, measures)


def _circle() -> Array:
    angle = np.linspace(0.0, 2 * np.pi, 60)
    return np.column_stack((0.03 * np.cos(angle), 0.45 + 0.03 * np.sin(angle)))


def _springs(reference: Array) -> tuple[PotentialField, ...]:
    return tuple(PotentialField(point[None, :], stiffness=3500.0, width=0.04, compile=False) for point in reference)


def _field(**numbers: Any) -> Callable[[Array], tuple[PotentialField, ...]]:
    return lambda reference: (PotentialField(reference, stiffness=2000.0, width=0.02, compile=False, **numbers),)


REFERENCES: dict[Mode, Callable[[], Array]] = {
    "stretch": lambda: np.array([[0.10, 0.40], [0.12, 0.52]]),
    "assist": lambda: LINE,
    "resist": lambda: LINE,
    "follow": _circle,
    "hold": lambda: np.array([[-0.03, 0.42], [0.03, 0.42], [0.0, 0.48]]),
}
FIELDS: dict[Mode, Callable[[Array], tuple[PotentialField, ...]]] = {
    "stretch": _field(rest_on_target=False),
    "assist": _field(drag=100.0),
    "resist": _field(drag=40.0, drag_along="travelled"),
    "follow": _field(rest_on_target=False),
    "hold": _springs,
}
