"""Typed errors: each names the argument or file key, its value, and the expectation."""

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
    """`text` with unprintable characters replaced by Python escapes, for safe printing on a terminal."""
    if text.isprintable():
        return text
    return "".join(
        letter if letter.isprintable() else letter.encode("unicode_escape").decode("ascii") for letter in text
    )


class RehabOptError(Exception):
    """Base of all errors that this library raises on purpose."""


class ConfigurationError(RehabOptError, ValueError):
    """An argument is invalid.

    Parameters
    ----------
    argument : name of the argument, as the caller wrote it.
    value : its value.
    expected : accepted values, as the end of the sentence "expected ...".
    """

    def __init__(self, argument: str, value: object, expected: str) -> None:
        self.argument = argument
        self.value = value
        self.expected = expected
        said = repr(value)
        super().__init__(f"{argument} = {said[:LONGEST]}{'...' * (len(said) > LONGEST)}: expected {expected}")

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by parts, because errors must come back from process pools."""
        return type(self), (self.argument, self.value, self.expected), self.__dict__


class DeviceLostError(RehabOptError):
    """A device no longer answers (cable, program, power); the message says which one, since when and why."""


class SharingError(RehabOptError, TypeError):
    """An object that belongs to one thread was used by another, copied or pickled; the message says what to do."""


class ProblemFileError(RehabOptError, ValueError):
    """A problem file or recording is invalid; the message is one line of printable characters.

    Parameters
    ----------
    file : path of the file as the user gave it.
    key : dotted key, column or line in the file.
    value : its value.
    expected : accepted values.
    """

    def __init__(self, file: object, key: str, value: object, expected: str) -> None:
        self.file = str(file)
        self.key = key
        self.value = value
        self.expected = expected
        super().__init__(printable(f"{file}: {key} = {value!r}: expected {expected}"))

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by parts, as `ConfigurationError`."""
        return type(self), (self.file, self.key, self.value, self.expected), self.__dict__


class RobotFileError(ProblemFileError):
    """The description of a robot is invalid: its URDF, MJCF or robot file.

    Parameters
    ----------
    file, value, expected : as in `ProblemFileError`.
    key : the joint, link or line, and its attribute.
    """
