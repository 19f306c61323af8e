"""Reasons why a command is not a plain OK, and notes on it: numbers for C, text for Python."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from rehab_opt.errors import ConfigurationError

__all__ = ["NOTES", "NUMBER", "REASONS", "Note", "Reason", "notes_of", "reason_number", "reason_text"]


class Reason(NamedTuple):
    """Reason for a command that is not a plain OK."""

    name: str
    """Name of the constant in C, after REHAB_."""
    text: str
    """Text of `rehab_reason` in C."""
    python: str | None
    """Characteristic part of Python's text; None if Python has no such reason."""
    told: str = ""
    """Format of Python's text, with details of the tick; empty if it equals `text`."""


REASONS = (
    Reason("FINE", "", None),
    Reason("NOT_ENABLED", "not enabled", "not enabled"),
    Reason("STAMP_NOT_FINITE", "stamp is not finite", "stamp is not finite"),
    Reason("STAMP_GAP", "gap in stamps", "gap in stamps", "gap in stamps: {:.3g} s, at most {:.3g} s"),
    Reason("STAMP_BACKWARDS", "stamp went backwards", "stamp went backwards", "stamp went backwards by {:.3g} s"),
    Reason("STAMP_REPEATED", "stamp repeated", "stamp repeated"),
    Reason(
        "STATE_STALE",
        "state is stale, or the loop faster than dt",
        "state is stale",
        "state is stale, or the loop faster than dt: {:.3g} s behind the ticks, at most {:.3g} s",
    ),
    Reason("INPUT_INVALID", "an input is not a valid number", "not a valid number"),
    Reason(
        "NOT_CERTIFIED",
        "no certified answer",
        "no solver gave a certified answer",
        "no solver gave a certified answer (residual {:.1e})",
    ),
    Reason("INPUT_TOO_LARGE", "the numbers are too large to be meant", "the numbers are too large"),
    Reason("POSE_NOT_RIGID", "pose is not a rigid transform", "pose is not a rigid transform"),
    Reason("ROWS_DEPENDENT", "the rows are dependent at this posture", "the rows are dependent"),
    Reason("ROWS_UNKNOWN", "rows or frame that this controller was not made for", None),
    Reason("NOT_INITIALISED", "the controller was not initialised", None),
    Reason(
        "POSITION_INVALID",
        "x is not a valid position",
        "not a valid position",
        "x is ({}, {}), not a valid position: is it in metres?",
    ),
    Reason(
        "VELOCITY_INVALID",
        "v is not a valid velocity",
        "not a valid velocity",
        "v is ({}, {}), not a valid velocity",
    ),
    Reason(
        "HAND_TOO_FAST",
        "the hand moves faster than its speed cap",
        "hand moves at",
        "hand moves at {:.3g} m/s, at most {:g} m/s",
    ),
    Reason(
        "POSITION_JUMPED",
        "the position moved faster than a hand",
        "position moved",
        "position moved {:.3g} m in {:.3g} s, at most {:g} m/s",
    ),
    Reason("ENERGY_SPENT", "energy left does not afford a slower release", "energy left does not afford"),
    Reason("FIELD_NO_NUMBER", "the field gives no number here", "the field gives no number here"),
    Reason("MODEL_SETTLES", "the model of the led arm finds its posture", "the model of the led arm finds its"),
    Reason("FORCE_AT_LIMIT", "the interaction force is at its limit, or was just now", "interaction force of"),
    Reason("NOTHING_LEFT", "the bounds leave nothing of the motion or force", "the bounds leave nothing"),
    Reason("STAMP_MISSING", "stamp is missing", "stamp is missing"),
    Reason(
        "ENERGY_LOW",
        "little energy is left in the tank",
        "little energy is left",
        "little energy is left in the tank: {:.3g} J afford {:.3g} N",
    ),
    Reason(
        "POSITION_REPEATS",
        "the position repeats itself, as a frozen sensor's does: energy is set aside",
        "the position repeats itself",
        "the position repeats itself, as a frozen sensor's does: energy is set aside, {:.3g} J afford {:.3g} N",
    ),
    Reason("STAMP_NO_NUMBER", "stamp is not a number of seconds", "stamp is not a number of seconds"),
    Reason(
        "HAND_STANDS",
        "the hand stood under force or is elsewhere after a gap: let go until it comes to another place of the path",
        "the hand stood under force",
    ),
    Reason("NOT_FOLLOWED", "a joint does not follow: `element` says which", "does not follow"),
    Reason(
        "LOOP_SLOW",
        "the loop is slower than dt",
        "the loop is slower than dt",
        "the loop is slower than dt: stamps advance by {:.3g} s a tick, dt is {:.3g} s",
    ),
    Reason(
        "POSE_TOO_FAR",
        "pose is farther than ten times the arm's reach: is it in metres?",
        "ten times the arm's reach",
    ),
    Reason("POSITIONS_IMPOSSIBLE", "no joint can have come to these positions", "no joint can have come to these"),
    Reason("JOINT_BLOCKS", "a joint at its limit blocks the motion: `element` says which", "at its limit blocks"),
    Reason("LIMIT_BLOCKS", "a limit of the posture blocks the motion", "a limit of the posture blocks"),
    Reason("POSTURE_SINGULAR", "no joint moves the tool that way: the posture is singular", "the posture is singular"),
    Reason("OUT_OF_REACH", "the pose is out of reach", "the pose is out of reach"),
)
"""Reasons in the order of their numbers, which stay the same in later releases."""
NUMBER = {reason.name: number for number, reason in enumerate(REASONS)}
"""Number of each reason, by its name."""


def reason_text(number: float, details: Iterable[float]) -> str:
    """Python's text of a tick's reason, with the details that its format needs."""
    reason = REASONS[int(number)]
    return reason.told.format(*details) if reason.told else reason.text


def reason_number(reason: str) -> int:
    """Number of the reason of a Python `Command`, without its notes; `ConfigurationError` for an unknown reason."""
    reason = without_notes(reason)
    if not reason:
        return 0
    for number, each in enumerate(REASONS):
        if each.python is not None and each.python in reason:
            return number
    raise ConfigurationError("reason", reason, "one of those that C knows")


class Note(NamedTuple):
    """A note on a command that is not a fault."""

    name: str
    """Name of the constant in C, after REHAB_."""
    text: str
    python: str
    """Characteristic part of Python's text."""


NOTES = (
    Note("SLOWED", "the reference is followed below its own pace", "of its pace"),
    Note("BRIDGING", "a jump of the reference is bridged", "bridging a jump of the reference"),
    Note(
        "THINNED", "no more samples fit: every second one that waited was left out", "every second sample that waited"
    ),
)
"""Notes in the order of their numbers (1, 2, 4), which stay the same in later releases. Python joins several notes
with semicolons.
"""


def notes_of(reason: str) -> int:
    """Sum of the numbers of all notes that a Python `Command` has in its reason."""
    return sum(2**i for i, note in enumerate(NOTES) if note.python in reason)


def without_notes(reason: str) -> str:
    """Reason of a Python `Command` without its notes."""
    return "; ".join(part for part in reason.split("; ") if not any(note.python in part for note in NOTES))
