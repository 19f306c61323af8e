"""The stages of the fallback chain that C has: the solver inside the generated code, and no other behind it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from rehab_opt.errors import ConfigurationError
from rehab_opt.optim.fallback_chain import FUSED, FallbackChain

__all__ = ["as_in_c"]


@contextmanager
def as_in_c(*chains: FallbackChain) -> Iterator[None]:
    """No backup is asked within, so that a run that is recorded here is one that C repeats.

    Raises
    ------
    ConfigurationError : a solver that does not become C.
    """
    for chain in chains:
        if chain.solver != FUSED:
            raise ConfigurationError("solver", chain.solver, f"{FUSED}, which can become C")
    backups = [chain.backup for chain in chains]
    try:
        for chain in chains:
            chain.backup = FUSED
        yield
    finally:
        for chain, backup in zip(chains, backups, strict=True):
            chain.backup = backup
