"""Refusals of what the library was given, in the words of where it was given: a key of the file, or an option."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rehab_opt.errors import ConfigurationError, ProblemFileError
from rehab_opt.session.schema import UNUSABLE_SOLVERS, USABLE

__all__ = ["checked_solver", "refused_as", "solver_refusals"]


@contextmanager
def refused_as(
    file: object,
    key: Callable[[str], str] = str,
    *,
    option: str | None = None,
    error: type[ProblemFileError] = ProblemFileError,
) -> Iterator[None]:
    """Name a file's key where an argument is refused.

    Parameters
    ----------
    file : what its user calls it.
    key : from the library's own name of the argument.
    option : the value of `--solver`, if it was given: then a refused solver is not the file's.

    Raises
    ------
    ProblemFileError : or `error`, in place of a ConfigurationError.
    """
    try:
        yield
    except ConfigurationError as refused:
        if refused.argument == "solver" and option is not None:
            raise
        raise error(file, key(refused.argument), refused.value, refused.expected) from refused


def checked_solver(solver: str | None) -> str | None:
    """The solver of `--solver`; what a library asks for by the same name is checked where it is made.

    Raises
    ------
    ConfigurationError : it is empty, or known to be invalid.
    """
    if solver == "" or solver in UNUSABLE_SOLVERS:
        raise ConfigurationError("--solver", solver, USABLE)
    return solver


@contextmanager
def solver_refusals(option: str | None, *, file: str, key: str, value: str | None) -> Iterator[None]:
    """Name `--solver` or the file's key where making a solver fails.

    Parameters
    ----------
    option : the value of `--solver`, if it was given.
    key, value : of the file, which counts where it was not.

    Raises
    ------
    ConfigurationError : `--solver` is refused.
    ProblemFileError : the key of the file is.
    """
    try:
        yield
    except ConfigurationError as refused:
        if refused.argument != "solver" or option is None:
            raise
        raise ConfigurationError("--solver", refused.value, refused.expected) from refused
    except RuntimeError as failed:
        if "::init for" not in str(failed):  # not CasADi's word for a solver that it cannot make
            raise
        if option is not None:
            raise ConfigurationError("--solver", option, USABLE) from failed
        raise ProblemFileError(file, key, value, USABLE) from failed
