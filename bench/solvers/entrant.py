"""One who takes part in the comparison: a solver, how it is made, and what it claims."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

from rehab_opt.optim.backends import Answer

__all__ = ["Claim", "Entrant", "Solver"]


class Claim(NamedTuple):
    """What a solver says of one instance."""

    word: bool
    """Whether it says that it solved it."""
    answer: Answer
    said: str = ""
    """Why not."""


class Solver(Protocol):
    """One solver at work on one sequence. Only `solve` is timed."""

    def prepared(self, instance: Any, /) -> Any:
        """The instance in the solver's own type."""
        ...

    def solve(self, given: Any, *, warm: bool) -> Any:
        """What the solver answers, in its own type; not warm: knowing nothing of what it solved before."""
        ...

    def claim(self, instance: Any, answered: Any, /) -> Claim:
        """What it says."""
        ...


@dataclass(frozen=True)
class Entrant:
    """A name, and how its solver is made in another process.

    Parameters
    ----------
    name : as `--solver` has it.
    make : importable by name, of the instances (`Instances`) and `solver`.
    solver : what `make` is told.
    packages : whose versions matter.
    kind : of the instances that it takes.
    """

    name: str
    make: Callable[[Any, str], Solver]
    solver: str = ""
    packages: tuple[str, ...] = ()
    kind: str = "qp"
