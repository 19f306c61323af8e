"""What is read back is the function that was made, and no other's."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest

from rehab_opt.symbolic import shared
from rehab_opt.symbolic.shared import REMEMBERED, read_back


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
    monkeypatch.setattr(shared, "_texts", {})
    return Maker()


def c_code(function: ca.Function) -> str:
    generator = ca.CodeGenerator("code.c")
    generator.add(function)
    return str(generator.dump())


def test_the_third_is_read_back_and_is_the_first_to_the_last_bit_and_in_c(maker: Maker) -> None:
    functions = [read_back("form", maker.of(3.7)) for _ in range(4)]
    assert maker.made == [3.7, 3.7]
    assert len({each.__hash__() for each in functions}) == 4  # none is shared
    assert {c_code(each) for each in functions} == {c_code(functions[0])}
    rng = np.random.default_rng(3)
    for _ in range(200):
        x = rng.standard_normal(4)
        assert len({b"".join(np.array(y).tobytes() for y in each(x)) for each in functions}) == 1


def test_forms_are_not_mixed(maker: Maker) -> None:
    for k in range(12):
        factor = float(1 + k % 3)
        sines, _ = read_back(("form", factor), maker.of(factor))([1.0, 0.0, 0.0, 0.0])
        assert float(sines[0]) == np.sin(factor)
    assert sorted(maker.made) == [1.0, 1.0, 2.0, 2.0, 3.0, 3.0]


def test_what_was_used_least_lately_is_forgotten_first(maker: Maker) -> None:
    for factor in (0.0, 0.0, *range(1, REMEMBERED), 0.0, REMEMBERED):
        read_back(factor, maker.of(factor))
    maker.made.clear()
    read_back(0.0, maker.of(0.0))
    assert not maker.made
    for _ in range(2):
        read_back(1.0, maker.of(1.0))  # made twice again: it was forgotten
    assert maker.made == [1.0, 1.0]
