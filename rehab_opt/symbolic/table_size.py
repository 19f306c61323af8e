"""For how many rows of a table code is compiled: tables of nearly one size share it."""

from __future__ import annotations

__all__ = ["table_size", "table_step"]


def table_size(count: int) -> int:
    """Rows to compile for, at least `count` of 1 and more: at most an eighth above it, or three."""
    step = table_step(count)
    return -(-count // step) * step


def table_step(count: int) -> int:
    """What `table_size` is a multiple of: a power of two from four on."""
    return max(4, (1 << count.bit_length()) >> 4)
