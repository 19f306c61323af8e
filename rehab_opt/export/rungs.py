"""The rungs of the ladder that C has: the solver inside the generated code, and no other behind it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from rehab_opt.errors import ConfigurationError
from rehab_opt.optim.ladder import FUSED, Ladder

__all__ = ["as_in_c"]


@contextmanager
def as_in_c(*ladders: Ladder) -> Iterator[None]:
    """No backup is asked within, so that a run that is recorded here is one that C repeats.

    Raises
    ------
    ConfigurationError : a solver that does not become C.
    """
    for ladder in ladders:
        if ladder.solver != FUSED:
            raise ConfigurationError("solver", ladder.solver, f"{FUSED}, which can become C")
    backups = [ladder.backup for ladder in ladders]
    try:
        for ladder in ladders:
            ladder.backup = FUSED
        yield
    finally:
        for ladder, backup in zip(ladders, backups, strict=True):
            ladder.backup = backup
