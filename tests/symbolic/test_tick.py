"""Marks change when a part of a tick is evaluated, and no number."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np
import pytest

from rehab_opt.symbolic.tick import Stages

OPERATIONS: tuple[Callable[[ca.SX, ca.SX], ca.SX], ...] = (
    lambda a, b: a * b, lambda a, b: ca.sin(a) - b, ca.fmax, lambda a, b: ca.if_else(a > b, a, -b),
)  # fmt: skip


class Counted(ca.Callback):
    """Twice its input, and how often it was asked."""

    def __init__(self) -> None:
        ca.Callback.__init__(self)
        self.count = 0
        self.construct("counted", {})

    def eval(self, arguments: Sequence[ca.DM]) -> list[ca.DM]:
        self.count += 1
        return [2 * arguments[0]]


class Plain:
    """The same marks without any effect: what they must not change."""

    def once(self, value: ca.SX) -> ca.SX:
        return value

    def when(self, condition: ca.SX, value: Callable[[], ca.SX], otherwise: Callable[[], ca.SX]) -> ca.SX:
        return ca.if_else(condition, value(), otherwise())

    def call(self, function: ca.Function, *arguments: ca.SX) -> tuple[ca.SX, ...]:
        return tuple(function.call(list(arguments)))


def drawn(tick: Stages | Plain, rng: np.random.Generator, known: list[ca.SX], depth: int = 2) -> list[ca.SX]:
    """Expressions of columns (3,) in which each may use any before it; the same for the same numbers drawn."""
    x = ca.SX.sym("x", 3)
    other = ca.Function("other", [x], [x[::-1], ca.sumsqr(x)])
    for _ in range(6):
        a, b = (known[i] for i in rng.integers(len(known), size=2))
        value = OPERATIONS[rng.integers(len(OPERATIONS))](a, b)
        kind = rng.integers(4)
        if kind == 1:
            value = tick.once(value)
        elif kind == 2:
            first, second = tick.call(other, value)
            value = first + second
        elif kind == 3 and depth:
            seeds = rng.integers(1 << 30, size=2)

            def branch(seed: int, known: list[ca.SX] = [*known, value]) -> Callable[[], ca.SX]:  # noqa: B006
                return lambda: drawn(tick, np.random.default_rng(seed), list(known), depth - 1)[-1]

            value = tick.when(ca.sum1(a) > ca.sum1(b), branch(int(seeds[0])), branch(int(seeds[1])))
        known.append(value)
    return known


@pytest.mark.parametrize("seed", range(12))
def test_marks_change_no_number(seed: int) -> None:
    p, memory = ca.SX.sym("p", 3), ca.SX.sym("memory", 3)
    tick = Stages()
    marked = drawn(tick, np.random.default_rng(seed), [p, memory])[2:]
    plain = drawn(Plain(), np.random.default_rng(seed), [p, memory])[2:]
    inputs = [p, memory]
    staged, whole = tick.function("staged", inputs, marked), ca.Function("plain", inputs, plain)
    for values in np.random.default_rng(seed + 1000).normal(size=(5, 2, 3)):
        for one, other in zip(staged.call(list(values)), whole.call(list(values)), strict=True):
            np.testing.assert_allclose(np.array(one), np.array(other), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("seed", range(6))
def test_what_does_not_wait_for_the_answer_comes_before_it(seed: int) -> None:
    p, x = ca.SX.sym("p", 3), ca.SX.sym("x", 3)
    tick, rng = Stages(), np.random.default_rng(seed)
    before = drawn(tick, rng, [p])
    after = drawn(tick, rng, [*before, x])[len(before) + 1 :]
    column, precompute = tick.precomputed([p], after, later=x)
    finish = tick.function("finish", [ca.vertcat(p, column), x], after)
    whole = tick.function("whole", [p, x], after)
    values = rng.normal(size=(2, 3))
    full = ca.vertcat(values[0], precompute(values[0]))
    for one, other in zip(finish.call([full, values[1]]), whole.call(list(values)), strict=True):
        np.testing.assert_allclose(np.array(one), np.array(other), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("value", [1.0, -1.0])
def test_only_the_branch_that_is_taken_is_evaluated(value: float) -> None:
    tick, p, counted = Stages(), ca.SX.sym("p"), (Counted(), Counted())
    chosen = tick.when(p > 0, lambda: tick.call(counted[0], p)[0], lambda: -tick.call(counted[1], p)[0])
    function = tick.function("f", [p], [tick.once(chosen) + chosen])
    assert float(function(value)) == 4 * abs(value)
    assert [each.count for each in counted] == [int(value > 0), int(value < 0)]


def test_a_value_that_is_used_twice_is_evaluated_once() -> None:
    tick, p, counted = Stages(), ca.SX.sym("p", 2), Counted()
    (twice,) = tick.call(counted, p[0])
    function = tick.function("f", [p], [twice + p[1], twice**2])
    assert [float(each) for each in function.call([[1.0, 2.0]])] == [4.0, 4.0]
    assert counted.count == 1


def test_constants_stay_as_they_are_and_zeros_keep_their_place() -> None:
    tick, p = Stages(), ca.SX.sym("p", 2)
    assert float(tick.once(ca.SX(3))) == 3
    assert tick.once(ca.diag(p)).nnz() == 2


def test_what_depends_on_nothing_is_evaluated_like_all_else() -> None:
    tick, p = Stages(), ca.SX.sym("p", 2)
    square = ca.Function("square", [p], [p**2])
    constant = tick.when(ca.SX(1), lambda: tick.call(square, ca.SX([1, 2]))[0], lambda: ca.SX([0, 0]))
    function = tick.function("f", [p], [constant + tick.call(square, ca.SX([3, 0]))[0] + p])
    assert np.array(function([10.0, 20.0])).ravel().tolist() == [20.0, 24.0]
