"""Convert errors about arguments of a function to errors about a key of the problem file or an option."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rehab_opt.errors import ConfigurationError, ProblemFileError
from rehab_opt.session.schema import UNUSABLE_SOLVERS, USABLE


@contextmanager
def refused_as(
    file: object,
    key: Callable[[str], str] = str,
    *,
    option: str | None = None,
    error: type[ProblemFileError] = ProblemFileError,
) -> Iterator[None]:
    """Context in which an error about an argument becomes an error about a key of the problem file.

    Parameters
    ----------
    file : name of the problem file in error messages.
    key : function from the name of an argument to the key of the problem file.
    option : value of `--solver`, if given; then an error about the solver is not changed.
    error : class of the new error.

    Raises
    ------
    ProblemFileError : in place of a ConfigurationError.
    """
    try:
        yield
    except ConfigurationError as refused:
        if refused.argument == "solver" and option is not None:
            raise
        raise error(file, key(refused.argument), refused.value, refused.expected) from refused


def checked_solver(solver: str | None) -> str | None:
    """Check the value of `--solver` before the run, and return it.

    Raises
    ------
    ConfigurationError : the name is empty, or the solver is known to fail.
    """
    if solver == "" or solver in UNUSABLE_SOLVERS:
        raise ConfigurationError("--solver", solver, USABLE)
    return solver


@contextmanager
def solver_refusals(option: str | None, *, file: str, key: str, value: str | None) -> Iterator[None]:
    """Context in which a failure to build a solver becomes an error about `--solver` or the problem file's key.

    Parameters
    ----------
    option : value of `--solver`, if given. file : name of the problem file in error messages.
    key, value : the solver's key in the problem file and its value, named in the error without `--solver`.

    Raises
    ------
    ConfigurationError : the solver of `--solver` is invalid.
    ProblemFileError : the solver in the problem file is invalid.
    """
    try:
        yield
    except ConfigurationError as refused:
        if refused.argument != "solver" or option is None:
            raise
        raise ConfigurationError("--solver", refused.value, refused.expected) from refused
    except RuntimeError as failed:
        if "::init for" not in str(failed):  # CasADi's message if it cannot build a solver has this text
            raise
        if option is not None:
            raise ConfigurationError("--solver", option, USABLE) from failed
        raise ProblemFileError(file, key, value, USABLE) from failed
