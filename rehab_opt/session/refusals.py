"""Errors about arguments of the library, renamed to what the user wrote: a key of the file, or an option."""

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
    """Name a file's key in an error about an argument.

    Parameters
    ----------
    file : name of the file in errors.
    key : maps the library's name of an argument to the file's key.
    option : value of `--solver`, if given: then an error about the solver is not the file's.

    Raises
    ------
    ProblemFileError : replaces a ConfigurationError; or `error`.
    """
    try:
        yield
    except ConfigurationError as refused:
        if refused.argument == "solver" and option is not None:
            raise
        raise error(file, key(refused.argument), refused.value, refused.expected) from refused


def checked_solver(solver: str | None) -> str | None:
    """Check the solver of `--solver` early; a solver that the library chooses is checked when it is built.

    Raises
    ------
    ConfigurationError : empty, or known to fail.
    """
    if solver == "" or solver in UNUSABLE_SOLVERS:
        raise ConfigurationError("--solver", solver, USABLE)
    return solver


@contextmanager
def solver_refusals(option: str | None, *, file: str, key: str, value: str | None) -> Iterator[None]:
    """Name `--solver` or the file's key if building a solver fails.

    Parameters
    ----------
    option : value of `--solver`, if given.
    key, value : those of the file, used if `--solver` was not given.

    Raises
    ------
    ConfigurationError : `--solver` is invalid.
    ProblemFileError : the key of the file is invalid.
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
