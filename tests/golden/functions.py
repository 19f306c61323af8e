"""Kept numbers of the CasADi functions of a part, on what they met in a run and on what a broken one would meet.

A fault seldom shows in the commands of a run: its row is not active, its branch not taken. It shows in the functions
that the run was made of, at inputs that are changed here and there.
"""

from __future__ import annotations

import json
import math
import os
import re
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any

import casadi as ca
import numpy as np
import pytest

from rehab_opt.optim.fallback_chain import FallbackChain
from rehab_opt.symbolic import BufferedFunction
from tests.golden import KEEP, PARTS, assert_kept

Columns = list[np.ndarray]
Gives = Callable[[Columns], Sequence[Any]]
SPECIAL = (math.nan, math.inf, -math.inf, 0.0, 0.0, 1.0, -1.0, 1e7)
FINEST, COARSE = 1e-5, 1e-3
"""Of what is told apart, in a function and in a run; a smaller number counts as itself over this."""
ROUNDING, STEADY = 1e-13, 1e-5
"""A sample is not kept where so small a change of its inputs changes what is kept by more than this: a near tie."""
DEEP, FEW = 9, 20
"""Functions within one another; inputs that are drawn for one."""
TOGETHER = 4
"""Samples of one kept number."""


class Met:
    """Functions that were made, in order, and the inputs of their calls."""

    def __init__(self) -> None:
        self.functions: list[tuple[ca.Function, list[Columns]]] = []
        self.chains: list[FallbackChain] = []

    def all(self) -> Iterator[tuple[str, Gives, list[Columns]]]:
        """By name and sizes what they give, and their inputs; of a QP also its numbers, screen and report.

        And of what they call inside, at inputs that are drawn.
        """
        alike: dict[str, tuple[ca.Function, list[Columns]]] = {}
        for function, calls in self.functions:
            alike.setdefault(_key(function), (function, []))[1].extend(calls)
        alike = {key: (function, calls) for key, (function, calls) in alike.items() if calls}
        yield from ((key, _evaluated(function), calls) for key, (function, calls) in alike.items())
        for chain in {chain.statement.name: chain for chain in self.chains}.values():
            if calls := alike.get(_key(chain.given), (None, []))[1]:
                yield chain.statement.name, _stated(chain.statement), calls
        inside = dict[str, dict[int, ca.Function]]()
        for each in (each for function, _ in alike.values() for each in function.find_functions(DEEP)):
            if each.class_name() == "SXFunction" and _key(each) not in alike:
                inside.setdefault(_key(each), {})[each.__hash__()] = each
        for key, several in inside.items():
            first = next(iter(several.values()))
            yield f"{key} inside", _in_turn([*map(_evaluated, several.values())]), [drawn(first, k) for k in range(FEW)]


def _in_turn(several: Sequence[Gives]) -> Gives:
    """What functions of one name give, by size: CasADi finds them in any order."""
    return lambda columns: [each for one in sorted((gives(columns) for gives in several), key=summed) for each in one]


def _key(function: ca.Function) -> str:
    return f"{function.name()} {','.join(str(function.numel_in(i)) for i in range(function.n_in()))}"


def drawn(function: ca.Function, seed: int) -> Columns:
    """Inputs for a function, a third of the numbers small, or zero."""
    rng, found = np.random.RandomState(seed), Columns()
    for i in range(function.n_in()):
        rows, columns = function.size_in(i)
        values = rng.normal(size=(rows, columns)) * rng.choice([1.0, 1.0, 1.0, 0.1, 0.0], size=(rows, columns))
        found.append(values[:, 0] if columns == 1 else values)
    return found


def _evaluated(function: ca.Function) -> Gives:
    inputs = [ca.MX.sym("input", *function.size_in(i)) for i in range(function.n_in())]
    dense = ca.Function(function.name(), inputs, [ca.densify(each) for each in function.call(inputs)])
    buffered = BufferedFunction(dense)

    def gives(columns: Columns) -> Sequence[Any]:
        buffered.of(*columns)
        return buffered.outputs

    return gives


def _stated(stated: Any) -> Gives:
    begin, end = stated.state_size - int(stated.memory.numel()), stated.state_size
    p, memory, x = (ca.MX.sym("column", size) for size in (stated.parameter_size, end - begin, stated.n))
    full = stated.complete(p, memory)
    parts = [*stated.build.call([full, memory]), *stated.screen.call([full, memory])]
    parts = [full, *parts, *stated.finish.call([full, memory, x])]
    every = _evaluated(ca.Function("every", [p, memory, x], parts))
    return lambda columns: every([columns[0], columns[1][begin:end], columns[1][: stated.n]])


@contextmanager
def watched() -> Iterator[Met]:
    """Within it, every buffered function that is made tells of its calls."""
    met, begin, chain = Met(), BufferedFunction.__init__, FallbackChain.__init__

    def made(self: BufferedFunction, function: ca.Function, **options: Any) -> None:
        begin(self, function, **options)
        calls: list[Columns] = []
        met.functions.append((function, calls))

        def around(call: Callable[[], None]) -> Callable[[], None]:
            def told() -> None:
                calls.append([np.array(each) for each in self.inputs])
                call()

            return told

        self.surround(around)

    def chained(self: Any, *given: Any, **options: Any) -> None:
        chain(self, *given, **options)
        self.given = self.function.function
        met.chains.append(self)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(BufferedFunction, "__init__", made)
        patched.setattr(FallbackChain, "__init__", chained)
        yield met


def varied(calls: Sequence[Columns], rng: np.random.RandomState) -> Columns:
    """One of the calls with some of its numbers changed."""
    one, other = (calls[rng.randint(len(calls))] for _ in range(2))
    flat, beside = (np.concatenate([each.ravel(order="F") for each in columns]) for columns in (one, other))
    whole = flat == np.round(flat)
    with np.errstate(invalid="ignore"):
        flat = np.where(whole, flat, flat * (1 + 1e-6 * rng.normal(size=flat.size)))
        few = rng.randint(5)
        count = (0, 1, 3, max(1, flat.size // 8), max(1, flat.size // 2))[few]
        for at in rng.choice(flat.size, min(count, flat.size), replace=False):
            kind = rng.randint(8 if few < 3 else 7)
            value, drawn = flat[at], rng.normal()
            flat[at] = (
                value * math.exp(drawn), -value, value + drawn, value + 0.01 * drawn, value * (1 + 0.1 * drawn),
                beside[at], drawn if value == 0 else 2 * value, SPECIAL[rng.randint(len(SPECIAL))],
            )[kind]  # fmt: skip
    ends = np.cumsum([each.size for each in one])[:-1]
    return [part.reshape(each.shape, order="F") for part, each in zip(np.split(flat, ends), one, strict=True)]


def summed(outputs: Sequence[Any], finest: float = FINEST) -> float:
    """One number that a hundredth more of any output changes."""
    flat = np.concatenate([each.ravel(order="F") for each in outputs])
    weights = 1.5 + np.cos(2.0 + np.arange(flat.size))
    size = np.arcsinh(np.clip(np.nan_to_num(flat, nan=3e8, posinf=1e9, neginf=-1e9), -1e9, 1e9) / finest)
    return float(weights @ size)


def rounded(columns: Columns, rng: np.random.RandomState) -> Columns:
    """Inputs that rounding might have left instead."""
    with np.errstate(invalid="ignore"):
        return [np.where(each == np.round(each), each, each * (1 + ROUNDING * rng.normal(size=each.shape)))
                for each in columns]  # fmt: skip


def assert_functions_kept(name: str, met: Met, *said: Any, samples: int = 120) -> None:
    """What the functions give at their calls, varied, is what is kept in `NAME.json`, and so is what was said."""
    file, keep = PARTS / f"{name}.json", os.environ.get(KEEP) == "1"
    ties = {} if keep else {key: each["ties"] for key, each in json.loads(file.read_text())["functions"].items()}
    found: dict[str, Any] = {}
    for key, gives, calls in met.all():
        rng, about = np.random.RandomState(len(key)), np.random.RandomState(1)
        inputs = [varied(calls, rng) for _ in range(2 * FEW if key.endswith("inside") else samples)]
        values = np.array([summed(gives(columns)) for columns in inputs])
        if keep:
            beside = [[summed(gives(rounded(columns, about))) for _ in range(2)] for columns in inputs]
            ties[key] = np.flatnonzero(~(np.abs(np.array(beside).T - values).max(axis=0) < STEADY)).tolist()
        values[ties.get(key, [])] = 0.0
        sums = values.reshape(-1, TOGETHER) @ (1 + np.arange(TOGETHER) / TOGETHER)
        found[key] = {"ties": ties.get(key, []), "sums": [float(f"{each:.10g}") for each in sums]}
    assert_kept(name, {"said": digest(*said), "functions": found}, relative=0.0, absolute=1e-4)


def digest(*values: Any, width: int = 12, finest: float = COARSE) -> list[Any]:
    """Numbers that are in values, so many of them together in one; and what words, without the digits in them."""
    numbers, words = list[float](), Counter[str]()
    for each in _parts(values):
        if isinstance(each, str):
            words[text := re.sub(r"-?\d[\d.]*(e[-+]?\d+)?", "#", each)] += 1
            numbers.append(zlib.crc32(text.encode()) / 2**32)
        else:
            numbers += np.asarray(each, dtype=float).ravel().tolist()
    sums = [summed([np.array(numbers[i : i + width])], finest) for i in range(0, len(numbers), width)]
    return [*(float(f"{each:.10g}") for each in sums), *([text, words[text]] for text in sorted(words))]


def _parts(value: Any) -> Iterator[Any]:
    """Arrays, numbers and texts."""
    if isinstance(value, dict):
        value = [each for pair in value.items() for each in pair]
    elif is_dataclass(value):
        value = [getattr(value, each.name) for each in fields(value)]
    elif isinstance(value, Enum) and not isinstance(value, int):
        value = value.value
    if isinstance(value, (list, tuple, Iterator)):
        for each in value:
            yield from _parts(each)
    elif value is not None:
        yield np.array(ca.DM(value)) if isinstance(value, (ca.DM, ca.SX)) else value
