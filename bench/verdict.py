"""A number that was asked for beside the one that was measured, as a line that says PASS or FAIL."""

from __future__ import annotations

from typing import Literal, NamedTuple

from rich.console import Console

__all__ = ["Reported", "Verdict", "all_met", "print_verdicts"]


class Verdict(NamedTuple):
    """One number to reach."""

    what: str
    measured: float
    relation: Literal["<=", ">="]
    asked: float
    unit: str = ""

    @property
    def met(self) -> bool:
        """Whether it is reached; NaN is not."""
        return self.measured <= self.asked if self.relation == "<=" else self.measured >= self.asked

    def __str__(self) -> str:
        word = "PASS" if self.met else "FAIL"
        unit = f" {self.unit}" if self.unit else ""
        return f"{word}  {self.what}: {self.measured:.4g}{unit} (target {self.relation} {self.asked:.4g}{unit})"


class Reported(NamedTuple):
    """A ratio beside a peer of which nothing was asked."""

    what: str
    measured: float

    def __str__(self) -> str:
        return f"NOTE  {self.what}: {self.measured:.4g} (reported)"


def all_met(verdicts: list[Verdict]) -> bool:
    """Whether every number is reached."""
    return all(verdict.met for verdict in verdicts)


def print_verdicts(console: Console, verdicts: list[Verdict]) -> None:
    """One line a number."""
    for verdict in verdicts:
        console.print(str(verdict), style="green" if verdict.met else "bold red", highlight=False, soft_wrap=True)
