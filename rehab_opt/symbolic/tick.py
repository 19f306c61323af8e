"""Marks for the evaluation of a tick: expressions that are evaluated once, or only if needed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, TypeVar, cast

import casadi as ca

__all__ = ["Stages"]

Marked = TypeVar("Marked")


class Stages:
    """Marks for parts of a tick's expressions that are evaluated once, or only if needed.

    `once(value)` returns symbols for a value that is evaluated once a tick, however often they are used.
    `when(condition, value, otherwise)` evaluates only one of the two. `call(function, ...)` calls a function that may
    contain branches. `function` derives the order of evaluation from the dependencies.
    """

    def __init__(self) -> None:
        self._stages: list[_Once | _Call] = []

    # ---------------------------------------------------------------------------------------------------- the marks
    def once(self, value: Marked) -> Marked:
        """Symbols that stand for an expression, or for each expression of a tuple; constants are returned unchanged."""
        if isinstance(value, tuple):
            make = getattr(value, "_make", tuple)
            return cast("Marked", make([self.once(each) for each in value]))
        expression = ca.SX(cast("Any", value))
        if expression.is_constant():
            return cast("Marked", expression)
        symbol = ca.SX.sym("once", expression.sparsity())
        self._stages.append(_Once(_entries(symbol), _entries(expression)))
        return cast("Marked", symbol)

    def when(
        self, condition: ca.SX, value: ca.SX | Callable[[], ca.SX], otherwise: ca.SX | Callable[[], ca.SX]
    ) -> ca.SX:
        """`value` if the condition holds, else `otherwise`; only the chosen one is evaluated. Both have the same shape.

        Both are expressions, or functions without arguments that return one and may set marks.
        """
        branches = [self._branch(each) for each in (value, otherwise)]
        shape = branches[0].shape
        free = frozenset[int]().union(*(each.free() for each in branches))

        def evaluated(condition: ca.MX, known: _Known) -> list[ca.MX]:
            needed = known.holding(free)
            made = [_function("branch", each.stages, [one.column for one in needed], [each.value]) for each in branches]
            return [ca.Function.if_else("when", made[0], made[1])(condition, *(one.value for one in needed))]

        column = ca.SX.sym("when", shape[0] * shape[1])
        self._stages.append(_Call([column], [ca.SX(condition)], lambda given, known: evaluated(given[0], known), free))
        return ca.reshape(column, *shape)

    def call(self, function: ca.Function, *arguments: ca.SX) -> tuple[ca.SX, ...]:
        """Outputs of a function that may contain branches, at `arguments`."""
        shapes = [function.size_out(i) for i in range(function.n_out())]
        into = [function.size_in(i) for i in range(function.n_in())]

        def evaluated(given: list[ca.MX], _: _Known) -> list[ca.MX]:
            shaped = [ca.reshape(each, *shape) for each, shape in zip(given, into, strict=True)]
            return [ca.vec(each) for each in function.call(shaped)]

        columns = [ca.SX.sym("call", rows * width) for rows, width in shapes]
        self._stages.append(_Call(columns, [ca.densify(ca.vec(ca.SX(each))) for each in arguments], evaluated))
        return tuple(ca.reshape(each, *shape) for each, shape in zip(columns, shapes, strict=True))

    def _branch(self, value: ca.SX | Callable[[], ca.SX]) -> _Branch:
        outer, self._stages = self._stages, []
        try:
            expression = ca.SX(value() if callable(value) else value)
            return _Branch(self._stages, ca.densify(ca.vec(expression)), expression.shape)
        finally:
            self._stages = outer

    # ------------------------------------------------------------------------------------------------ derived functions
    def function(self, name: str, inputs: Sequence[ca.SX], outputs: Sequence[ca.SX]) -> ca.Function:
        """Function with `inputs`, columns of symbols; its `outputs` may use these and marked symbols."""
        return _function(name, self._stages, inputs, outputs)

    def precomputed(
        self, inputs: Sequence[ca.SX], expressions: Iterable[ca.SX], *, later: ca.SX
    ) -> tuple[ca.SX, ca.Function]:
        """Two results: a column of marked symbols, and a function from `inputs` to their values.

        The symbols are those that the expressions use and that do not depend on `later`.
        """
        late, asked = _hashes(later), _hashes(*expressions)
        for stage in self._stages:
            if not late.isdisjoint(stage.free):
                late |= stage.gives
        for stage in reversed(self._stages):
            if not asked.isdisjoint(late & stage.gives):
                asked |= stage.free
        return _column(self._stages, inputs, asked - late)


@dataclass(frozen=True, eq=False)
class _Once:
    """Symbols that stand for a value, and the value."""

    symbols: ca.SX
    value: ca.SX

    @cached_property
    def gives(self) -> set[int]:
        """Hashes of the symbols that stand for this value."""
        return _hashes(self.symbols)

    @cached_property
    def free(self) -> set[int]:
        """Hashes of the symbols that this value needs."""
        return _hashes(self.value)


@dataclass(frozen=True, eq=False)
class _Call:
    """A function call; its outputs get symbols."""

    columns: list[ca.SX]
    """Symbols of the outputs."""
    arguments: list[ca.SX]
    """Arguments as columns."""
    evaluated: Callable[[list[ca.MX], _Known], list[ca.MX]]
    beside: frozenset[int] = frozenset()
    """Further symbols that the call needs."""

    @cached_property
    def gives(self) -> set[int]:
        """Hashes of the symbols that stand for the outputs."""
        return _hashes(*self.columns)

    @cached_property
    def free(self) -> set[int]:
        """Hashes of the symbols that the call needs."""
        return _hashes(*self.arguments) | self.beside


class _Branch(NamedTuple):
    """One of the two branches of `when`: an expression as a column, and the marks set inside it."""

    stages: list[_Once | _Call]
    value: ca.SX
    shape: tuple[int, int]

    def free(self) -> set[int]:
        """Hashes of the symbols that the branch needs from outside."""
        own = set[int]().union(*(stage.gives for stage in self.stages))
        return set[int]().union(_hashes(self.value), *(stage.free for stage in self.stages)) - own


@dataclass(frozen=True, eq=False)
class _Place:
    column: ca.SX
    value: ca.MX

    @cached_property
    def symbols(self) -> list[int]:
        return [each.element_hash() for each in ca.vertsplit(self.column)]


class _Known(list[_Place]):
    def holding(self, symbols: AbstractSet[int]) -> list[_Place]:
        """Columns with one of the symbols; the first one if none has, since a CasADi call needs an input."""
        return [place for place in self if not symbols.isdisjoint(place.symbols)] or self[:1]

    def slice_of(self, expression: ca.SX) -> ca.MX | None:
        """Value of an expression that is a slice of a known column; None otherwise."""
        if not expression.numel():
            return ca.MX(0, 1)
        looked = [each.element_hash() if each.is_symbolic() else None for each in ca.vertsplit(expression)]
        for place in self:
            order, value = place.symbols, place.value
            if looked[0] in order:
                first = order.index(looked[0])
                if order[first : first + len(looked)] == looked:
                    return value if len(looked) == len(order) else value[first : first + len(looked)]
        return None


def _entries(matrix: ca.SX) -> ca.SX:
    """Structurally nonzero entries as a column."""
    return ca.vertcat(ca.SX(0, 1), *cast("list[ca.SX]", matrix.nonzeros()))


def _hashes(*expressions: ca.SX) -> set[int]:
    return {each.element_hash() for each in ca.symvar(ca.veccat(ca.SX(0, 1), *expressions))}


def _function(
    name: str, stages: Sequence[_Once | _Call], inputs: Sequence[ca.SX], outputs: Sequence[ca.SX]
) -> ca.Function:
    dense = [ca.densify(each) for each in outputs]
    column, before = _column(stages, inputs, _hashes(*outputs))
    if not column.numel():
        return ca.Function(name, list(inputs), dense, {"cse": True})
    last = ca.Function(f"{name}_last", [*inputs, column], dense, {"cse": True})
    given = [ca.MX.sym("given", each.numel()) for each in inputs]
    return ca.Function(name, given, last.call([*given, before(*given)]))


def _column(stages: Sequence[_Once | _Call], inputs: Sequence[ca.SX], asked: set[int]) -> tuple[ca.SX, ca.Function]:
    """Two results: the marked symbols in `asked` that are not inputs, one column; function (inputs) -> their values.

    The function alternates between one part without branches and the branches that depend on its outputs.
    """
    needed, level = _needed(stages, inputs, asked)
    given = [ca.MX.sym("given", each.numel()) for each in inputs]
    known = _Known(map(_Place, inputs, given))
    found: list[_Place] = []
    for turn in range(1 + max(level, default=0)):
        values = [each for each, at in zip(needed, level, strict=True) if at == turn and isinstance(each, _Once)]
        calls = [each for each, at in zip(needed, level, strict=True) if at == turn + 1 and isinstance(each, _Call)]
        later = [each.free for each, at in zip(needed, level, strict=True) if at > turn and each not in calls]
        used = set[int]().union(*(each.beside for each in calls), *later)
        kept = [each for each in values if not asked.isdisjoint(each.gives)]
        passed = [each for each in values if each not in kept and not used.isdisjoint(each.gives)]
        columns = [ca.vertcat(ca.SX(0, 1), *(each.symbols for each in some)) for some in (kept, passed)]
        arguments = [each for call in calls for each in call.arguments]
        direct = [known.slice_of(each) for each in arguments]
        own = [each for each, there in zip(arguments, direct, strict=True) if there is None]
        evaluated = iter(_evaluated(turn, values, known, [*columns, *own]))
        places = [_Place(column, next(evaluated)) for column in columns]
        known += (each for each in places if each.column.numel())
        found += places[:1]
        ready = iter([next(evaluated) if there is None else there for there in direct])
        for call in calls:
            results = call.evaluated([next(ready) for _ in call.arguments], known)
            places = list(map(_Place, call.columns, results))
            known += places
            found += (each for each in places if not asked.isdisjoint(each.symbols))
    whole = ca.vertcat(ca.SX(0, 1), *(each.column for each in found))
    return whole, ca.Function("staged", given, [ca.vertcat(ca.MX(0, 1), *(each.value for each in found))])


def _needed(
    stages: Sequence[_Once | _Call], inputs: Sequence[ca.SX], asked: set[int]
) -> tuple[list[_Once | _Call], list[int]]:
    """Two lists: the stages that must be evaluated to get the symbols `asked` from `inputs`, and each stage's level.

    The level is the largest number of calls that depend on one another, up to and including the stage.
    """
    there = _hashes(*inputs)
    missing = asked - there
    needed: list[_Once | _Call] = []
    for stage in reversed(stages):
        if not missing.isdisjoint(stage.gives):
            needed.insert(0, stage)
            missing |= stage.free - there
    level: list[int] = []
    place: dict[int, int] = {}
    for stage in needed:
        at = max((place.get(each, 0) for each in stage.free), default=0) + isinstance(stage, _Call)
        level.append(at)
        place |= dict.fromkeys(stage.gives, at)
    return needed, level


def _evaluated(turn: int, values: Sequence[_Once], known: _Known, outputs: Sequence[ca.SX]) -> list[ca.MX]:
    """Values of `outputs`, which use known symbols and `values`; each of these may use the ones before it."""
    if not any(each.numel() for each in outputs):
        return [ca.MX(0, 1) for _ in outputs]
    symbols, definitions = [each.symbols for each in values], [each.value for each in values]
    written = ca.substitute_inplace(symbols, definitions, list(outputs))[1] if values else list(outputs)
    places = known.holding(_hashes(*written))
    columns = [place.column for place in places]
    function = ca.Function(f"turn_{turn}", columns, [ca.densify(each) for each in written], {"cse": True})
    return function.call([place.value for place in places])
