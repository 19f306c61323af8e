"""Numbers that a setting has where nobody gives it, written out here: the other tests give most settings."""

from __future__ import annotations

import importlib
import inspect

MODULES = ("", ".control.conditioning", ".control.hand_bounds", ".control.scanning")
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
    "PathAssistance": {"damping": 0.0, "force_limit": 30.0, "return_stiffness": 500.0,
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


def test_defaults_are_the_documented_ones() -> None:
    modules = [importlib.import_module(f"rehab_opt{name}") for name in MODULES]
    for name, numbers in DEFAULTS.items():
        first, *method = name.split(".")
        found = next(getattr(module, first) for module in modules if hasattr(module, first))
        shown = inspect.signature(getattr(found, method[0]) if method else found).parameters
        assert {key: shown[key].default for key in numbers} == numbers, name
