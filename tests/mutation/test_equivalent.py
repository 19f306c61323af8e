"""Faults of `equivalent.toml` change no number: each is shown on 10^4 inputs."""

from __future__ import annotations

from types import ModuleType, SimpleNamespace

import numpy as np

from rehab_opt.kinematics.robot_file import steps
from tests.mutation.__main__ import reasons
from tests.mutation.nearest import ROOT
from tests.mutation.operators import faults

INPUTS = 10_000


def with_fault(file: str, after: str) -> ModuleType:
    """The module with a fault of `equivalent.toml`."""
    source = (ROOT / file).read_bytes()
    fault = next(each for each in faults(file, source) if each.key in reasons() and each.after == after)
    module = ModuleType(file.removesuffix(".py").replace("/", "."))
    exec(compile(fault.planted(source), file, "exec"), module.__dict__)
    return module


def test_no_length_is_off_by_just_what_rounded_numbers_may_be() -> None:
    faulty = with_fault("rehab_opt/kinematics/robot_file/steps.py", "if not abs(length - 1.0) < ROUNDED:")
    source = SimpleNamespace(refuse=lambda *_: ValueError())

    def unit(module: ModuleType, length: float) -> object:
        try:
            return module.unit_vector(np.array([length]), source, "axis")[0].tolist()
        except ValueError:
            return "refused"

    spacing = np.finfo(float).eps / 2
    lengths = [edge + k * spacing for edge in (0.999, 1.001) for k in range(-INPUTS // 4, INPUTS // 4)]
    both = [(unit(steps, each), unit(faulty, each)) for each in lengths]
    assert len(both) == INPUTS
    assert all(one == other for one, other in both)
    assert {"refused"} < {str(one) for one, _ in both}
