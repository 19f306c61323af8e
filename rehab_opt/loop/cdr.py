"""Messages in ROS 2's wire format: little-endian plain CDR (OMG, "DDS-XTypes" 1.3, section 7.4)."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError

__all__ = ["Cdr", "record_cdr", "record_definition", "records_of"]

HEADER = b"\0\1\0\0"
"""First bytes of a message: little-endian plain CDR without options."""
SIMPLE = {"<f8": "float64", "<u8": "uint64"}


class Cdr:
    """A message that is written field by field; each number is aligned to a multiple of its size."""

    def __init__(self) -> None:
        self._bytes = bytearray(HEADER)

    def number(self, code: str, value: float) -> Self:
        """Append one number; `code` is a format code of `struct`: i, I or d."""
        size = struct.calcsize(code)
        return self._aligned(size, struct.pack("<" + code, value))

    def text(self, text: str) -> Self:
        """Append a string."""
        data = text.encode() + b"\0"
        self.number("I", len(data))._bytes += data
        return self

    def texts(self, texts: Sequence[str]) -> Self:
        """Append a sequence of strings."""
        self.number("I", len(texts))
        for each in texts:
            self.text(each)
        return self

    def numbers(self, values: ArrayLike) -> Self:
        """Append a sequence of float64."""
        array = np.ascontiguousarray(values, dtype="<f8")
        self.number("I", array.size)
        return self._aligned(8, array.tobytes()) if array.size else self  # an empty sequence has nothing to align

    def _aligned(self, size: int, data: bytes) -> Self:
        self._bytes += bytes(-(len(self._bytes) - len(HEADER)) % size) + data
        return self

    def done(self) -> bytes:
        """Return the message's bytes."""
        return bytes(self._bytes)


def record_definition(layout: np.dtype[Any]) -> str:
    """ROS 2 message definition (.msg) of a record in which 8-byte numbers come before texts.

    Raises
    ------
    ConfigurationError : a field has another type, or a number follows a text.
    """
    lines, texts = [], False
    for name, (kind, *_) in dict(layout.fields or {}).items():
        simple = SIMPLE.get(kind.base.str)
        texts = texts or kind.kind == "S"
        if kind.kind != "S" and (simple is None or texts):
            raise ConfigurationError("layout", f"{name}: {kind}", "float64 and uint64, then byte strings")
        size = int(np.prod(kind.shape)) if kind.shape else 0
        lines.append(f"string {name}" if simple is None else f"{simple}[{size}] {name}" if size else f"{simple} {name}")
    return "\n".join(lines)


def record_cdr(layout: np.dtype[Any]) -> Callable[[np.void], bytes]:
    """Function that converts a record to a message of `record_definition` without rounding numbers."""
    record_definition(layout)
    fixed, texts = _split(layout)

    def written(record: np.void) -> bytes:
        message = Cdr()
        message._bytes += record.tobytes()[:fixed]
        for name in texts:
            message.text(record[name].decode(errors="replace"))
        return message.done()

    return written


def records_of(layout: np.dtype[Any], messages: Sequence[bytes]) -> NDArray[np.void]:
    """Convert N messages of `record_cdr` back to records (N,)."""
    fixed, texts = _split(layout)
    records = np.zeros(len(messages), dtype=layout)
    rows = records.view(np.uint8).reshape(len(messages), layout.itemsize)
    for i, message in enumerate(messages):
        place = len(HEADER) + fixed
        rows[i, :fixed] = np.frombuffer(message, np.uint8, fixed, len(HEADER))
        for name in texts:
            place += -(place - len(HEADER)) % 4
            (size,) = struct.unpack_from("<I", message, place)
            records[name][i] = message[place + 4 : place + 3 + size]
            place += 4 + size
    return records


def _split(layout: np.dtype[Any]) -> tuple[int, list[str]]:
    """Two results: the size [byte] of a record's numbers, and the names of its text fields."""
    fields = dict(layout.fields or {})
    texts = [name for name, (kind, *_) in fields.items() if kind.kind == "S"]
    return (fields[texts[0]][1] if texts else layout.itemsize), texts
