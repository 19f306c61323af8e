"""Functions that differ in numbers alone share one library: another person, time step or floor needs no compiler."""

from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from rehab_opt import (
    Assistance,
    PoseTracker,
    PotentialField,
    RedundancyResolver,
    SerialChain,
    Workspace,
    ardis,
    ur5,
)  # fmt: skip
from rehab_opt.symbolic import BufferedFunction, compiled
from rehab_opt.symbolic.constant_table import shape_of, with_table
from tests.symbolic.test_compiled import MACHINE_CODE, cache, needs_compiler

__all__ = ["cache"]  # a fixture

Rng = np.random.Generator


@pytest.fixture
def rng() -> Rng:
    seed = int(np.random.SeedSequence().entropy) % 2**32  # type: ignore[arg-type]
    print("seed", seed)
    return np.random.default_rng(seed)


@pytest.fixture
def no_compiler(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """From when it is called on, compiling is a failure."""

    def compiles(*_: object, **__: object) -> bytes:
        pytest.fail("a compiler was asked")

    return lambda: monkeypatch.setattr(import_module("rehab_opt.symbolic.compiled"), "build_library", compiles)


def weighted(weights: NDArray[np.float64]) -> ca.Function:
    """A graph in an SX function within an MX function, both with constants: numbers, columns, one twice."""
    x, y = ca.SX.sym("x", 3), ca.MX.sym("y", 3)
    inner = ca.Function("inner", [x], [ca.fmax(ca.sin(weights[:3] * x), weights[3]) + ca.dot(weights[4:7], x)])
    outer = inner(y) * weights[7] + ca.if_else(y > weights[8], weights[9], y) + ca.fmin(ca.DM(weights[:3]), y)
    return ca.Function("weighted", [y], [outer, ca.fmax(ca.MX(3, 1) + weights[4], y)])


@needs_compiler
def test_other_numbers_need_no_compiler_and_each_function_keeps_its_own(
    cache: Path, no_compiler: Callable[[], None], rng: Rng
) -> None:
    pairs = []
    for _ in range(5):
        function = weighted(rng.uniform(0.1, 0.9, 10))
        pairs.append((BufferedFunction(function), BufferedFunction(compiled(function, compile="wait"))))
        no_compiler()  # but for the first
    assert [quick.function.class_name() for _, quick in pairs] == [MACHINE_CODE] * 5
    assert len(list(cache.glob("*.so"))) == 1
    for x in rng.normal(size=(200, 3)):
        for slow, quick in pairs:
            np.testing.assert_array_equal(quick.of(x), slow.of(x))


@needs_compiler
def test_a_number_that_casadi_leaves_out_is_right_too(cache: Path, rng: Rng) -> None:
    for at in (0, 7):  # of a column, and of a number
        functions, x, values = [], ca.MX.sym("x", 3), rng.normal(size=3)
        for special in (0.0, 1.0, -1.0, 2.0, 0.5):
            weights = rng.normal(size=10)
            weights[at] = special
            functions.append(weighted(weights))
        function = ca.Function("each", [x], [ca.vertcat(*(each(x)[0] for each in functions))])
        alone = np.concatenate([BufferedFunction(each).of(values) for each in functions])
        np.testing.assert_array_equal(BufferedFunction(compiled(function, compile="wait")).of(values), alone)


# -------------------------------------------------------------------------------------------------- the controllers
def some_robot(rng: Rng) -> SerialChain:
    """A UR5 whose limits are its own."""
    return ur5().with_limits(
        lower=-rng.uniform(2.1, 6.0, 6), upper=rng.uniform(2.1, 6.0, 6), velocity=rng.uniform(1.2, 3.5, 6),
        acceleration=rng.uniform(5.0, 20.0, 6),
    )  # fmt: skip


def pose_tracker(rng: Rng) -> object:
    return PoseTracker(
        some_robot(rng), dt=rng.uniform(7e-4, 2e-2), gain=rng.uniform(5.0, 12.0), linear_speed=rng.uniform(0.1, 1.9),
        angular_speed=rng.uniform(0.6, 3.0), recovery_speed=rng.uniform(0.05, 0.3),
    )  # fmt: skip


def chair(rng: Rng) -> object:
    return RedundancyResolver(ardis(), dt=rng.uniform(4e-3, 1.9e-2), row_sets=(("x", "y", "z"),))


def assistance(rng: Rng) -> object:
    """Of one number of samples."""
    line = np.column_stack([np.linspace(0.0, 0.3, 60), 0.1 * np.sin(np.linspace(0, 3, 60))])
    field = PotentialField(line, stiffness=rng.uniform(300.0, 900.0), width=0.02)
    return Assistance(
        field,
        comfortable=Workspace(shapely.box(-1, -1, 1, 1), accuracy=1e-3),
        dt=rng.uniform(7e-4, 1e-2),
        force_limit=rng.uniform(5.0, 30.0),
    )


@pytest.mark.parametrize("make", [pose_tracker, chair, assistance])
def test_code_of_a_controller_is_the_same_for_other_people_limits_gains_floors_and_time_steps(
    make: Callable[[Rng], object], rng: Rng, monkeypatch: pytest.MonkeyPatch
) -> None:
    functions: list[ca.Function] = []

    def looked_at(function: ca.Function, **_: object) -> ca.Function:
        functions.append(function)
        return function

    monkeypatch.setattr("rehab_opt.symbolic.buffered.machine_code", looked_at)
    monkeypatch.setenv("REHAB_OPT_COMPILE", "wait")

    def written() -> list[tuple[str, bytes]]:
        functions.clear()
        make(rng)
        codes = []
        for function in functions:
            generator = ca.CodeGenerator(function.name(), {"verbose": False})
            generator.add(function)
            code, table = with_table(generator.dump())
            codes.append((shape_of(code), table))
        return codes

    one, other = written(), written()
    assert len(one) == len(other) > 0
    assert [mine == its for (mine, _), (its, _) in zip(one, other, strict=True)] == [True] * len(one)
    assert one != other or make is assistance  # whose numbers are inputs
