"""Typed errors: each one names the argument or file key, the value it had and what was expected."""

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
"""Letters of a value that are shown."""


def printable(text: str) -> str:
    """`text` with every unprintable character, which a terminal might obey, replaced by its Python escape."""
    if text.isprintable():
        return text
    return "".join(
        letter if letter.isprintable() else letter.encode("unicode_escape").decode("ascii") for letter in text
    )


class RehabOptError(Exception):
    """Root of every error this library raises on purpose."""


class ConfigurationError(RehabOptError, ValueError):
    """An argument cannot be used.

    Parameters
    ----------
    argument : name of the argument, as the caller wrote it.
    value : what it was.
    expected : what would have been accepted, as the end of the sentence "expected ...".
    """

    def __init__(self, argument: str, value: object, expected: str) -> None:
        self.argument = argument
        self.value = value
        self.expected = expected
        said = repr(value)
        super().__init__(f"{argument} = {said[:LONGEST]}{'...' * (len(said) > LONGEST)}: expected {expected}")

    def __reduce__(self) -> tuple[Any, ...]:
        """Made again from its parts: people are processed in pools, and an error must come back from one."""
        return type(self), (self.argument, self.value, self.expected), self.__dict__


class DeviceLostError(RehabOptError):
    """A device no longer answers: a cable, its program, its power; the message says which, since when and why."""


class SharingError(RehabOptError, TypeError):
    """An object that belongs to one thread was used by another, copied or pickled; the message says what to do."""


class ProblemFileError(RehabOptError, ValueError):
    """A problem file or recording cannot be used; the message is one line of printable characters.

    Parameters
    ----------
    file : path of the file as the user gave it.
    key : dotted key, column or line inside it.
    value : what stood there.
    expected : what would have been accepted.
    """

    def __init__(self, file: object, key: str, value: object, expected: str) -> None:
        self.file = str(file)
        self.key = key
        self.value = value
        self.expected = expected
        super().__init__(printable(f"{file}: {key} = {value!r}: expected {expected}"))

    def __reduce__(self) -> tuple[Any, ...]:
        """Made again from its parts, as a `ConfigurationError` is."""
        return type(self), (self.file, self.key, self.value, self.expected), self.__dict__


class RobotFileError(ProblemFileError):
    """The description of a robot cannot be used: its URDF, its MJCF or the few lines that name it.

    Parameters
    ----------
    file, value, expected : as of a `ProblemFileError`.
    key : the joint, link or line, and the attribute of it.
    """
