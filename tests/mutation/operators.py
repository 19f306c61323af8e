"""Faults that a line of Python can have: each is one change of its text, found in the syntax tree.

Left alone is what reaches no tick: docstrings and other strings, type hints, `raise`, and checks that only raise.
"""

from __future__ import annotations

import ast
import itertools
import re
from collections.abc import Iterator
from typing import NamedTuple

SIGN, COMPARISON, CONSTANT, DROPPED, SWAPPED = OPERATORS = (
    "sign", "comparison", "constant x 1.01", "dropped row", "swapped memory",
)  # fmt: skip
PLAIN = (0.0, 1.0, 2.0, 0.5)
"""Not constants that anybody tunes."""
ROUNDING = 1e-9
"""Constants up to this stand for rounding, or for nothing in a quotient: a hundredth of them is none."""
SIGNS: dict[type[ast.AST], str] = {
    ast.Add: "+", ast.Sub: "-", ast.Lt: "<", ast.Gt: ">", ast.LtE: "<=", ast.GtE: ">=",
}  # fmt: skip
OTHERS = {"+": ("-",), "-": ("+",), "<": ("<=", ">"), ">": ("<",), "<=": ("<", ">="), ">=": ("<=",)}
EXTREMES = {"min": "max", "fmin": "fmax", "mmin": "mmax", "minimum": "maximum"}
EXTREMES |= {other: one for one, other in EXTREMES.items()}
STACKED = {"vertcat", "horzcat", "all_true", "concatenate", "vstack", "hstack", "logic_and", "logic_or"}
"""Calls that put rows or conditions together: as arguments, or in one list."""
SYMMETRIC = {*EXTREMES, "all_true", "logic_and", "logic_or", "hypot", "zip", "isinstance", "dot", "is_equal"}
CHECKS = {"checked_number", "ConfigurationError", "getattr", "hasattr", "cast", "range"}


class Fault(NamedTuple):
    """One change of one file; positions are bytes."""

    file: str
    line: int
    operator: str
    before: str
    """The source line, or lines, as they are, blanks folded; `after` the same."""
    after: str
    begin: int
    end: int
    text: str
    """What stands between `begin` and `end` in the faulty file."""
    function: str
    """The function or class that it is in, with dots between; "" outside of all."""

    @property
    def key(self) -> tuple[str, ...]:
        """What names it, also when lines move."""
        return self.file, self.function, self.operator, self.before, self.after

    def planted(self, source: bytes) -> bytes:
        """The faulty file."""
        return source[: self.begin] + self.text.encode() + source[self.end :]


class Change(NamedTuple):
    """Of a source's bytes from `begin` to `end`."""

    operator: str
    begin: int
    end: int
    text: str


def faults(file: str, source: bytes) -> list[Fault]:
    """All faults of a module."""
    text, found = Source(source), []
    for node, function in reached(ast.parse(source)):
        for operator, begin, end, new in changes(node, text):
            first, last = source.rfind(b"\n", 0, begin) + 1, source.find(b"\n", end)
            before, after = source[first:last], source[first:begin] + new.encode() + source[end:last]
            folded = (" ".join(each.decode().split()) for each in (before, after))
            line = source.count(b"\n", 0, begin) + 1
            found.append(Fault(file, line, operator, *folded, begin, end, new, function))
    return found


class Source:
    """Where nodes stand in a module's bytes."""

    def __init__(self, source: bytes) -> None:
        self.source = source
        self.starts = [0, *itertools.accumulate(map(len, source.splitlines(keepends=True)))]

    def begin(self, node: ast.expr | ast.stmt) -> int:
        """First byte of a node."""
        return self.starts[node.lineno - 1] + node.col_offset

    def end(self, node: ast.expr | ast.stmt) -> int:
        """The byte behind a node."""
        return self.starts[(node.end_lineno or 0) - 1] + (node.end_col_offset or 0)

    def of(self, node: ast.expr) -> str:
        """Text of a node."""
        return self.source[self.begin(node) : self.end(node)].decode()

    def sign(self, left: ast.expr, right: ast.expr, sign: str) -> int:
        """Where the operator between two nodes stands, which comments and brackets may surround."""
        between = self.source[self.end(left) : self.begin(right)]
        blank = re.sub(rb"#[^\n]*", lambda comment: b" " * len(comment[0]), between)
        return self.end(left) + blank.index(sign.encode())

    def dropped(self, rows: list[ast.expr]) -> Iterator[Change]:
        """Each of several rows left out."""
        for i, row in enumerate(rows if len(rows) > 1 else []):
            if row is rows[-1]:
                yield Change(DROPPED, self.end(rows[i - 1]), self.end(row), "")
            else:
                yield Change(DROPPED, self.begin(row), self.begin(rows[i + 1]), "")

    def swapped(self, rows: list[ast.expr]) -> Iterator[Change]:
        """Neighbours in each other's place."""
        for one, other in itertools.pairwise(rows):
            if self.of(one) != self.of(other) and not {type(one), type(other)} & {ast.Starred, ast.Constant}:
                between = self.source[self.end(one) : self.begin(other)].decode()
                yield Change(SWAPPED, self.begin(one), self.end(other), f"{self.of(other)}{between}{self.of(one)}")


def reached(tree: ast.AST) -> Iterator[tuple[ast.AST, str]]:
    """Nodes that a tick may depend on, and the function they are in."""
    left = [(tree, "")]
    while left:
        node, function = left.pop()
        if isinstance(node, (ast.Raise, ast.JoinedStr)) or (isinstance(node, ast.Call) and named(node.func) in CHECKS):
            continue
        if isinstance(node, ast.If) and not node.orelse and all(isinstance(each, ast.Raise) for each in node.body):
            continue
        yield node, function
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            function = f"{function}.{node.name}".lstrip(".")
        hints = [getattr(node, name, None) for name in ("annotation", "returns")]
        left += [(child, function) for child in reversed([*ast.iter_child_nodes(node)]) if child not in hints]


def changes(node: ast.AST, source: Source) -> Iterator[Change]:
    """Those of this node itself."""
    match node:
        case ast.BinOp(left=left, op=ast.Add() | ast.Sub() as op, right=right) if not is_sequence(left, right):
            yield from signs(SIGN, source, left, op, right)
        case ast.AugAssign(target=left, op=ast.Add() | ast.Sub() as op, value=right) if not is_sequence(right):
            yield from signs(SIGN, source, left, op, right)
        case ast.UnaryOp(op=ast.USub(), operand=operand) if not isinstance(getattr(operand, "value", None), int):
            yield Change(SIGN, source.begin(node), source.begin(node) + 1, "")
        case ast.Compare(left=left, ops=ops, comparators=others):
            for one, op, other in zip([left, *others], ops, others, strict=False):
                yield from signs(COMPARISON, source, one, op, other)
        case ast.Constant(value=float() as value) if value not in PLAIN and value > ROUNDING:
            yield Change(CONSTANT, source.begin(node), source.end(node), f"({source.of(node)} * 1.01)")
        case ast.Assign(targets=[ast.Tuple(elts=targets)], value=ast.Tuple(elts=values)):
            for i in range(min(len(targets), len(values)) - 1):
                alike = source.of(values[i]) == source.of(values[i + 1])  # in either order the same
                if type(values[i]) is type(values[i + 1]) and not alike:
                    yield from source.swapped(targets[i : i + 2])
        case ast.keyword(arg="subject_to" | "requires", value=ast.List(elts=rows)):
            yield from source.dropped(rows)
        case ast.Call(func=function, args=rows):
            yield from arguments(source, function, rows)


def signs(operator: str, source: Source, left: ast.expr, op: ast.AST, right: ast.expr) -> Iterator[Change]:
    """The operator between two nodes replaced."""
    sign = SIGNS.get(type(op), "")
    for other in OTHERS.get(sign, ()):
        at = source.sign(left, right, sign)
        yield Change(operator, at, at + len(sign), other)


def stacked(source: Source, name: str, rows: list[ast.expr]) -> Iterator[Change]:
    """Rows left out, or in each other's place."""
    yield from source.dropped(rows)
    if name not in SYMMETRIC:
        yield from source.swapped(rows)


def arguments(source: Source, function: ast.expr, given: list[ast.expr]) -> Iterator[Change]:
    """The other extreme; arguments of one kind in each other's place."""
    name = named(function)
    if name in STACKED:
        one_list = len(given) == 1 and isinstance(given[0], (ast.List, ast.Tuple))
        yield from stacked(source, name, given[0].elts if one_list else given)  # type: ignore[attr-defined]
    elif name in EXTREMES:
        yield Change(COMPARISON, source.end(function) - len(name), source.end(function), EXTREMES[name])
    elif name in {"if_else", "where"}:
        yield from source.swapped(given[-2:])
    elif name not in SYMMETRIC:
        for one, other in itertools.pairwise(given):
            if all(isinstance(each, (ast.Name, ast.Attribute, ast.Subscript)) for each in (one, other)):
                yield from source.swapped([one, other])


def is_sequence(*nodes: ast.expr) -> bool:
    """Whether one of them is a list, a tuple or a text, which + joins; or zero."""
    joined = (ast.List, ast.Tuple, ast.JoinedStr)
    values = [getattr(node, "value", None) for node in nodes]
    return any(isinstance(node, joined) for node in nodes) or any(isinstance(each, str) or each == 0 for each in values)


def named(function: ast.expr) -> str:
    """Last name of what is called."""
    name = getattr(function, "attr", None) or getattr(function, "id", "")
    return str(name)
