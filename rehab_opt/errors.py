"""Exceptions: each message names the argument or file key, its value, and the expected values."""

from __future__ import annotations

from typing import Any

__all__ = [
    "ConfigurationError",
    "DeviceLostError",
    "ProblemFileError",
    "RehabOptError",
    "RobotFileError",
    "SharingError",
    "printable",
]

LONGEST = 250
"""Largest number of characters of a value in a message."""


def printable(text: str) -> str:
    """`text` with each unprintable character replaced by its Python escape, safe for a terminal."""
    if text.isprintable():
        return text
    return "".join(
        letter if letter.isprintable() else letter.encode("unicode_escape").decode("ascii") for letter in text
    )


class RehabOptError(Exception):
    """Base class of all exceptions that rehab_opt defines."""


class ConfigurationError(RehabOptError, ValueError):
    """An argument is invalid.

    Parameters
    ----------
    argument : name of the argument, as the caller wrote it.
    value : the argument's value.
    expected : description of the accepted values; completes the sentence "expected ...".
    """

    def __init__(self, argument: str, value: object, expected: str) -> None:
        self.argument = argument
        self.value = value
        self.expected = expected
        said = repr(value)
        super().__init__(f"{argument} = {said[:LONGEST]}{'...' * (len(said) > LONGEST)}: expected {expected}")

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the three arguments, so that a process pool can return the error."""
        return type(self), (self.argument, self.value, self.expected), self.__dict__


class DeviceLostError(RehabOptError):
    """A device no longer answers; the message names the device, the time without an answer and the reason."""


class SharingError(RehabOptError, TypeError):
    """An object of one thread was used in another thread, or was copied or pickled; the message says what to do."""


class ProblemFileError(RehabOptError, ValueError):
    """A problem file or a recording is invalid; the message is one line of printable characters.

    Parameters
    ----------
    file : path of the file as the user gave it.
    key : dotted key, column or line in the file.
    value : value of the key.
    expected : description of the accepted values.
    """

    def __init__(self, file: object, key: str, value: object, expected: str) -> None:
        self.file = str(file)
        self.key = key
        self.value = value
        self.expected = expected
        super().__init__(printable(f"{file}: {key} = {value!r}: expected {expected}"))

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the four arguments, as `ConfigurationError` does."""
        return type(self), (self.file, self.key, self.value, self.expected), self.__dict__


class RobotFileError(ProblemFileError):
    """A robot's URDF, MJCF or robot file is invalid.

    Parameters
    ----------
    file, value, expected : as in `ProblemFileError`.
    key : joint, link or line in the file, and the attribute.
    """
