"""Columns of a table of samples by name and unit, however a header writes them: `x_mm`, `X [mm]`, `x (mm)`, `x/mm`."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from types import MappingProxyType

__all__ = ["ANGLE", "COUNTS", "FORCE", "LENGTH", "TIME", "UNITS", "canonical_name", "unit_of"]

TIME = MappingProxyType({"s": 1.0, "ms": 1e-3})
LENGTH = MappingProxyType({"m": 1.0, "cm": 1e-2, "mm": 1e-3})
ANGLE = MappingProxyType({"rad": 1.0, "deg": math.pi / 180})
FORCE = MappingProxyType({"N": 1.0})
UNITS: Mapping[str, float] = MappingProxyType({**TIME, **LENGTH, **ANGLE, **FORCE})
COUNTS = "counts"
"""The unit of a column of raw counts, whose header names none."""
SPELLINGS = {"sec": "s", "second": "s", "seconds": "s", "msec": "ms", "meter": "m", "metre": "m", "°": "deg",
             "degree": "deg", "degrees": "deg", "radian": "rad", "radians": "rad"}  # fmt: skip
HAND = ("t", "time", "x", "y", "z", "fx", "fy", "fz")
"""Names that are known in capitals, too."""
LONGEST = 200
_WITH_UNIT = re.compile(r"([^\[\]()/]+)(?:\[([^\[\]()/]+)\]|\(([^\[\]()/]+)\)|/([^\[\]()/]+))")


def canonical_name(cell: str) -> str:
    """`name_unit` of a header's cell; the cell itself where it names no unit that is known."""
    cell = cell.strip().strip('"').strip()
    if len(cell) > LONGEST:
        return cell
    found = _WITH_UNIT.fullmatch(cell)
    if found is None:
        name, _, unit = cell.rpartition("_")
    else:
        name, unit = found[1].strip(), next(group for group in found.groups()[1:] if group is not None).strip()
    name = name.lower() if name.lower() in HAND else name
    unit = SPELLINGS.get(unit.lower(), unit)
    if name and unit in UNITS:
        return f"{name}_{unit}"
    return cell.lower() if cell.lower() in HAND else cell


def unit_of(column: str) -> str:
    """The unit that a canonical name ends in; `COUNTS` for one of the hand's that has none."""
    return COUNTS if column in HAND else column.rpartition("_")[2]
