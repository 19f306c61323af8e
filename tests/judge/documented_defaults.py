"""Numbers that stand for a setting nobody gave, as the signatures in the reference show them; written out here.

Whoever changes one changes it here too, and whoever adds one enters it: a default acts only where it is left out, and
the judges of motion give most settings.
"""

from __future__ import annotations

import enum
import importlib
import inspect
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from rehab_opt import __all__ as exported
from rehab_opt.control.conditioning import Conditioner, conditioned
from rehab_opt.control.hand_bounds import HandBounds
from rehab_opt.control.scanning import Scanning
from tests.judge.verdict import Verdict

BESIDES: tuple[Callable[..., Any], ...] = (Conditioner, conditioned, HandBounds, Scanning)
"""Public, but of modules of their own."""
STICK = (("plane", ("x", "y"), (0.25, 0.25), ()), ("lift", ("z", "roll7"), (0.15, 0.6), ()))
DEFAULTS: dict[str, dict[str, object]] = {
    "ArmIK": {"handle_tilt": 0.03490658503988659, "posture_cost": {"rest": 1.0}, "tolerance": 1e-9, "starts": 2,
              "nearest_starts": 32, "table_size": 4096},
    "Assistance": {"force_limit": 30.0, "onset": 0.0, "return_stiffness": 500.0, "return_force": 10.0},
    "Bilateral": {"delay": 0.0},
    "BoundedForce": {"force_limit": 30.0, "slew_limit": 2500.0, "growth_limit": 200.0, "energy_budget": 20.0,
                     "speed_cap": 1.0, "actuation_delay": 0.0, "actuation_lag": 0.0, "actuation_uncertainty": 0.003,
                     "velocity_lag": 0.01, "dt": 0.001,
                     "tolerance": 1e-8},
    "BoundedForce.instance": {"v": (0.0, 0.0)},
    "BoundedForce.nothing_seen": {"force": (0.0, 0.0)},
    "BoundedForce.reset": {"force": (0.0, 0.0)},
    "BoundedForce.to_qpsolvers": {"v": (0.0, 0.0)},
    "Clearance": {"self_margin": 0.0, "moving": 0, "max_contacts": 8},
    "Conditioner": {"cutoff_hz": 8.0, "max_gap": 0.1, "max_speed": 5.0, "max_turn_rate": 30.0},
    "HandBounds": {"margin": 0.0},
    "HelperSide": {"damping": 2.0, "exchange": 5.0, "force_limit": 30.0, "return_stiffness": 500.0,
                   "return_force": 10.0},
    "Interaction": {"slow_from": 8.0, "limit": 30.0, "stop_at": 140.0, "release": 0.7, "hold": 0.3,
                    "stiffness": 580.0, "damping": 180.0, "mass": 4.0, "max_offset": 0.05, "speed": 0.15,
                    "reserve": 0.5},
    "JointFeedback": {"delay": 0.005, "servo_hz": 24.0, "correction": 0.05, "following": 200.0, "contact": 0.001,
                      "tolerance": 0.03, "patience": 0.1},
    "Joystick": {"modes": STICK, "dt": 0.01, "dead_zone": 0.12, "rate": 3.0},
    "MirrorTracker": {"floor": 0.3, "max_deviation": 0.05, "max_turn": 0.7853981633974483, "linear_speed": 0.25,
                      "angular_speed": 1.5, "catch_up": 0.5, "turn_length": 0.1, "rate": 20.0, "dt": 0.001,
                      "recovery_speed": 0.1},
    "ParticipantSide": {"stiffness": 400.0, "damping": 20.0, "exchange": 5.0, "force_limit": 30.0},
    "PathAssistance": {"damping": 0.0, "push": 2.0, "force_limit": 30.0, "return_stiffness": 500.0,
                       "return_force": 10.0},
    "PathAssistance.reset": {"force": (0.0, 0.0)},
    "PoseTracker": {"gain": 50.0, "linear_speed": 1.0, "angular_speed": 3.141592653589793, "task_weights": 1.0,
                    "dt": 0.001, "recovery_speed": 0.1, "tolerance": 1e-8},
    "RedundancyResolver": {"self_motion": 1.0, "dt": 0.01, "recovery_speed": 0.1, "tolerance": 1e-8},
    "RedundancyResolver.reset": {"heading": 0.0},
    "Scanning": {"modes": STICK, "dt": 0.01, "dwell": 1.0, "threshold": 0.3, "rate": 3.0},
    "Smoother": {"dt": 0.001, "recovery_speed": 0.1},
    "conditioned": {"cutoff_hz": 8.0, "max_gap": 0.1, "max_speed": 5.0, "max_turn_rate": 30.0},
    "smooth_path": {"dt": 0.001, "tolerance": 1e-4},
}  # fmt: skip
"""Function, class or public method -> its parameters whose defaults are, or hold, numbers."""


def defaults(verdict: Verdict) -> None:
    """Each number is the one written here, no other parameter has one, and nothing of this table is gone."""
    public = {each.__name__: each for each in (*of_control(), *BESIDES)}
    found = {name: numbers for each in public.values() for name, numbers in shown(each) if numbers}
    verdict.where = "signatures"
    for name in sorted({*found, *DEFAULTS}):
        told, written = found.get(name, {}), DEFAULTS.get(name, {})
        other = sorted(key for key in {*told, *written} if told.get(key) != written.get(key))
        numbers = ", ".join(f"{name}({key}={told.get(key)}), not {written.get(key)}" for key in other)
        verdict.holds("defaults are the documented ones", not other, numbers)


def of_control() -> Iterator[Callable[..., Any]]:
    """Controllers, settings and functions of `control` that the package exports."""
    package = importlib.import_module("rehab_opt")
    for name in exported:
        each = getattr(package, name)
        a_status = isinstance(each, type) and issubclass(each, enum.Enum)
        if str(getattr(each, "__module__", "")).startswith("rehab_opt.control") and not a_status:
            yield each


def shown(public: Callable[..., Any]) -> Iterator[tuple[str, dict[str, object]]]:
    """Names, with dots, and the numbers that the signatures of one function, or of one class and its methods show.

    Methods that another exported class hands down are shown there.
    """
    yield public.__name__, numeric(public)
    if isinstance(public, type):
        for name, method in inspect.getmembers(public, lambda each: inspect.isfunction(each) or inspect.ismethod(each)):
            ours = str(method.__module__).startswith("rehab_opt")
            owner = str(method.__qualname__).partition(".")[0]
            if ours and not name.startswith("_") and (owner == public.__name__ or owner not in exported):
                yield f"{public.__name__}.{name}", numeric(method)


def numeric(function: Callable[..., Any]) -> dict[str, object]:
    """Its parameters whose defaults are, or hold, numbers."""
    found = inspect.signature(function).parameters.values()
    return {each.name: each.default for each in found if each.default is not each.empty and holds_numbers(each.default)}


def holds_numbers(value: object) -> bool:
    """Whether it is a number, or a tuple, list or mapping with one in it."""
    if isinstance(value, Mapping):
        return any(map(holds_numbers, value.values()))
    if isinstance(value, (tuple, list)):
        return any(map(holds_numbers, value))
    return isinstance(value, (int, float)) and not isinstance(value, (bool, enum.Enum))
