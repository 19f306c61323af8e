"""What is remembered is the function that was made, and no other's."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import casadi as ca
import numpy as np
import pytest

from rehab_opt.symbolic import BufferedFunction, shared
from rehab_opt.symbolic.shared import REMEMBERED, remembered


class Maker:
    """Makes functions, and counts them."""

    def __init__(self) -> None:
        self.made: list[float] = []

    def of(self, factor: float) -> Callable[[], ca.Function]:
        def make() -> ca.Function:
            self.made.append(factor)
            x, given = ca.SX.sym("x", 4), ca.MX.sym("given", 4)
            inner = ca.Function("inner", [x], [ca.sin(factor * x) / ca.norm_2(x), ca.cumsum(x)], {"cse": True})
            either = ca.Function.if_else("either", inner, ca.Function("other", [x], [-x, factor * x]))
            return ca.Function("made", [given], either(ca.sum1(given) > 0, given))

        return make


@pytest.fixture
def maker(monkeypatch: pytest.MonkeyPatch) -> Maker:
    monkeypatch.setattr(shared, "_made", {})
    return Maker()


def test_one_is_made_and_four_threads_that_use_it_at_once_get_its_numbers_to_the_last_bit(maker: Maker) -> None:
    functions = [remembered("form", maker.of(3.7)) for _ in range(4)]
    assert maker.made == [3.7]
    xs = np.random.default_rng(3).standard_normal((300, 4))

    def answers(function: ca.Function) -> list[bytes]:
        evaluate = BufferedFunction(function)
        return [evaluate.of(x).tobytes() + evaluate.outputs[1].tobytes() for x in xs]

    alone = answers(maker.of(3.7)())
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(answers, functions)) == [alone] * 4


def test_nothing_is_remembered_where_casadi_counts_references_without_atoms(
    maker: Maker, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shared, "ATOMIC", False)
    for _ in range(3):
        remembered("form", maker.of(3.7))
    assert maker.made == [3.7] * 3


def test_forms_are_not_mixed(maker: Maker) -> None:
    for k in range(12):
        factor = float(1 + k % 3)
        sines, _ = remembered(("form", factor), maker.of(factor))([1.0, 0.0, 0.0, 0.0])
        assert float(sines[0]) == np.sin(factor)
    assert sorted(maker.made) == [1.0, 2.0, 3.0]


def test_what_was_used_least_lately_is_forgotten_first(maker: Maker) -> None:
    for factor in (0.0, *range(1, REMEMBERED), 0.0, REMEMBERED):
        remembered(factor, maker.of(factor))
    maker.made.clear()
    remembered(0.0, maker.of(0.0))
    assert not maker.made
    for _ in range(2):
        remembered(1.0, maker.of(1.0))  # made again: it was forgotten
    assert maker.made == [1.0]
