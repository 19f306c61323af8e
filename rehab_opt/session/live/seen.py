"""One picture of a live page, for whoever keeps what happens on it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol

__all__ = ["Seen", "Watching"]


class Seen(NamedTuple):
    """One picture of the page."""

    time: float
    """[s] of the loop."""
    held: bool
    """Whether the controller was told to move."""
    status: str
    reason: str
    missed: int
    """Ticks left out so far."""
    stale: int
    """Commands not sent so far."""
    hand: tuple[float, float, float] | None
    """[m] where the page draws one."""
    numbers: tuple[float, ...]
    """What it plots."""


class Watching(Protocol):
    """Who is told what the page draws."""

    def begin(self, plots: Sequence[Mapping[str, Any]]) -> None:
        """What the page plots: name, unit, and `line` where it has a limit."""

    def see(self, seen: Seen) -> None:
        """One picture."""
