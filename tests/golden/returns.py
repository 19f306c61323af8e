"""What each function of some modules gives back, or leaves in its object, while something runs: numbers to keep.

    with Returns("rehab_opt/field/") as seen:
        ...
    assert_kept("field", seen.numbers())

So a change is seen where it is made, though what comes of it were the same. Kept are of each function the calls that
`CALLS` names and those that come to a line for the first time; of a call two weighted sums of all numbers. Where
rounding leads a search another way, only the first calls are the same elsewhere: `last`.
"""

from __future__ import annotations

import dataclasses
import enum
import importlib
import inspect
import re
import sys
import zlib
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import FrameType
from typing import Any

import casadi as ca
import numpy as np
import shapely

from tests.mutation.nearest import ROOT

CALLS = (1, 2, 4, 8, 16)
ENOUGH = 150
"""Calls of a function that are looked at."""
DEEP, MOST, SEVERAL, LARGE = 2, 20_000, 100, 5000
"""How deep objects are looked into, how many numbers, and items of a list; inputs of a function that is not asked."""
TIMED = re.compile(
    r"second|elapsed|clock|_ms$|_ns$|started|deadline|computing|solve_time|wall|path|folder|cache|thread|version|memory|^_lock"
)
"""Names of attributes that differ from run to run."""
NUMBERS_IN_TEXT = re.compile(r"[-+]?\d+\.?\d*(?:e[-+]?\d+)?")
ENDS = ("ge", "gt", "le", "lt", "min_length", "max_length")
NAN, INFINITE = 0.7713, 1e3


class Returns:
    """Records functions whose file, from the tree's root, begins as asked; `but` is a pattern of names left out."""

    def __init__(self, *files: str, but: str = "a^", last: int = 10**9) -> None:
        self._files, self._but, self._last = tuple(str(ROOT / file) for file in files), re.compile(but), last
        self._inside = tuple(file.removesuffix(".py").rstrip("/").replace("/", ".") for file in files)
        self._count, self._lines = Counter[str](), defaultdict[str, set[int]](set)
        self._kept = defaultdict[str, list[list[float]]](list)

    def __enter__(self) -> Returns:
        for name, module in list(sys.modules.items()):
            if str(getattr(module, "__file__", "") or "").startswith(self._files) and name.startswith("rehab_opt"):
                for each in vars(module).values():
                    if hasattr(each, "cache_clear"):
                        each.cache_clear()
        sys.settrace(self._called)
        return self

    def __exit__(self, *_: object) -> None:
        sys.settrace(None)

    def numbers(self, *, with_constants: bool = True) -> dict[str, Any]:
        """Of each function, by name, and of each module its constants and defaults."""
        held: dict[str, Any] = {}
        for file in self._files if with_constants else ():
            held |= constants(file)
        return held | dict(sorted(self._kept.items()))

    def _called(self, frame: FrameType, event: str, argument: Any) -> Any:
        code = frame.f_code
        if not code.co_filename.startswith(self._files) or code.co_name in {"<module>", "<lambda>", "<genexpr>"}:
            return None
        place = Path(code.co_filename).relative_to(ROOT / "rehab_opt").with_suffix("")
        name = f"{'.'.join(place.parts)}.{code.co_qualname}".replace(".<locals>", "")
        if self._but.search(name) or self._count[name] >= ENOUGH:
            return None
        here, known = set[int](), self._lines[name]

        def within(frame: FrameType, event: str, value: Any) -> Any:
            if event == "line":
                here.add(frame.f_lineno)
            elif event == "return":
                self._count[name] += 1
                count = self._count[name]
                if count <= self._last and (count in CALLS or not here <= known):
                    known.update(here)
                    sys.settrace(None)
                    left = value if value is not None else frame.f_locals.get("self")
                    self._kept[name].append(sums(left, self._inside))
                    sys.settrace(self._called)
            return within

        return within


def constants(begin: str) -> Iterator[tuple[str, dict[str, list[float]]]]:
    """Of the modules whose file begins so: capital names, defaults of arguments and of fields, and ranges of keys."""
    for file in sorted((ROOT / "rehab_opt").rglob("*.py")):
        if str(file).startswith(begin) and file.stem != "__init__":
            place = file.relative_to(ROOT).with_suffix("").parts
            module = importlib.import_module(".".join(place))
            own = {
                name: each
                for name, each in vars(module).items()
                if getattr(each, "__module__", None) == module.__name__
            }
            found: dict[str, Any] = {name: each for name, each in vars(module).items() if name.isupper()}
            for name, each in own.items():
                parts = (
                    {name: each} if not isinstance(each, type) else {f"{name}.{k}": v for k, v in vars(each).items()}
                )
                for key, part in parts.items():
                    function = inspect.unwrap(getattr(part, "__func__", part)) if callable(part) else part
                    if inspect.isfunction(function):
                        found[key] = [function.__defaults__, function.__kwdefaults__]
                    elif isinstance(part, float):
                        found[key] = part
                if isinstance(each, type):
                    fields = getattr(each, "__pydantic_fields__", {}).values()
                    found[name] = [getattr(each, "_field_defaults", None), [field.default for field in fields]]
                    found[f"{name} ranges"] = [
                        getattr(m, end, None) for field in fields for m in field.metadata for end in ENDS
                    ]
            yield ".".join(place[1:]), {key: sums(each) for key, each in sorted(found.items()) if not TIMED.search(key)}


def sums(value: Any, inside: tuple[str, ...] = ("rehab_opt",)) -> list[float]:
    """Two sums of all numbers of something; the second of sizes, which do not cancel.

    Only into objects of modules `inside` is looked: how those of another folder are written is not kept here.
    """
    held = list[Any]()
    _collect(value, DEEP, held, set(), inside)
    found = np.concatenate([np.zeros(0), *held])[:MOST]
    found = np.where(np.isnan(found), NAN, np.clip(found, -INFINITE, INFINITE))
    weights = 1 + np.modf(np.arange(len(found)) * 0.6180339887)[0]
    return [float(f"{each:.9g}") for each in (weights @ found, weights[::-1] @ np.abs(found))]


def _collect(value: Any, deep: int, held: list[Any], met: set[int], inside: tuple[str, ...]) -> None:  # noqa: PLR0912  (one match)
    match value:
        case None:
            held.append([0.5])
        case enum.Enum():
            _collect(value.name, deep, held, met, inside)
        case bool() | int() | float() | complex() | np.number() | np.bool_():
            held.append([value.real, value.imag] if isinstance(value, complex | np.complexfloating) else [float(value)])
        case str():
            held.append([zlib.crc32(NUMBERS_IN_TEXT.sub("#", value).encode()) / 2**32])
        case np.ndarray() if value.dtype.kind in "biuf":
            held += [np.array(value.shape, dtype=float), np.asarray(value, dtype=float).ravel()[:MOST]]
        case np.ndarray() if value.dtype.kind == "c":
            _collect(np.stack((value.real, value.imag)), deep, held, met, inside)
        case ca.DM() | ca.SX() | ca.MX() | ca.Function():
            _symbolic(value, held)
        case shapely.Geometry():
            held.append([value.area, value.length, *value.bounds])
        case Mapping():
            for key in [*value][:SEVERAL]:
                if not (isinstance(key, str) and TIMED.search(key)):
                    _collect(key, deep, held, met, inside)
                    _collect(value[key], deep, held, met, inside)
        case tuple() if hasattr(value, "_fields"):
            _collect(value._asdict(), deep, held, met, inside)
        case list() | tuple() if value and all(type(each) is float for each in value):
            held.append(value[:MOST])
        case list() | tuple():
            held.append([len(value)])
            for each in value[:SEVERAL]:
                _collect(each, deep, held, met, inside)
        case _ if type(value).__module__.startswith(inside) and deep and id(value) not in met:
            met.add(id(value))
            named = {each.name for each in dataclasses.fields(value)} if dataclasses.is_dataclass(value) else set()
            fields = {name: getattr(value, name) for name in sorted(named)} | getattr(value, "__dict__", {})
            for name in sorted(fields):
                if not TIMED.search(name):
                    _collect(fields[name], deep - 1, held, met, inside)


def _symbolic(value: Any, held: list[Any]) -> None:
    """Values at two points, the same for all; a solver has none."""
    if isinstance(value, ca.DM):
        held.append(value.full().ravel())
        return
    if not isinstance(value, ca.Function):
        value = ca.Function("asked", ca.symvar(value), [value])
    if value.class_name() not in {"SXFunction", "MXFunction", "Map", "Switch"} or value.nnz_in() > LARGE:
        return
    for scale in (0.4, 1.7):
        random = np.random.default_rng(7)
        given = [scale * random.uniform(-0.6, 1.0, value.size_in(i)) for i in range(value.n_in())]
        held += [ca.densify(each).full().ravel() for each in value.call([ca.DM(each) for each in given])]
