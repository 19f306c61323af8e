"""Why a command is not a plain OK: the numbers that C gives, and how Python says the same."""

from __future__ import annotations

from typing import NamedTuple

from rehab_opt.errors import ConfigurationError
from rehab_opt.export.notes import without_notes

__all__ = ["REASONS", "Reason", "reason_number"]


class Reason(NamedTuple):
    """One reason."""

    name: str
    """Of the constant in C, behind REHAB_."""
    text: str
    """What `rehab_reason` says."""
    python: str | None
    """Part of what Python says then; None where Python never does."""


REASONS = (
    Reason("FINE", "", None),
    Reason("NOT_ENABLED", "not enabled", "not enabled"),
    Reason("STAMP_NOT_FINITE", "stamp is not finite", "stamp is not finite"),
    Reason("STAMP_GAP", "gap in stamps", "gap in stamps"),
    Reason("STAMP_BACKWARDS", "stamp went backwards", "stamp went backwards"),
    Reason("STAMP_REPEATED", "stamp repeated", "stamp repeated"),
    Reason("STATE_STALE", "state is stale", "state is stale"),
    Reason("INPUT_UNUSABLE", "an input is not a usable number", "not a usable number"),
    Reason("NOT_CERTIFIED", "no certified answer", "no solver gave a certified answer"),
    Reason("INPUT_TOO_LARGE", "the numbers are too large to be meant", "the numbers are too large"),
    Reason("POSE_NOT_RIGID", "pose is not a rigid transform", "pose is not a rigid transform"),
    Reason("ROWS_DEPENDENT", "the rows are dependent at this posture", "the rows are dependent"),
    Reason("ROWS_UNKNOWN", "rows or frame that this controller was not made for", None),
    Reason("NOT_INITIALISED", "the controller was not initialised", None),
    Reason("POSITION_UNUSABLE", "x is not a usable position", "not a usable position"),
    Reason("VELOCITY_UNUSABLE", "v is not a usable velocity", "not a usable velocity"),
    Reason("HAND_TOO_FAST", "the hand moves faster than its speed cap", "hand moves at"),
    Reason("POSITION_JUMPED", "the position moved faster than a hand", "position moved"),
    Reason("ENERGY_SPENT", "energy left does not afford a slower release", "energy left does not afford"),
    Reason("FIELD_NO_NUMBER", "the field gives no number here", "the field gives no number here"),
    Reason("MODEL_SETTLES", "the model of the led arm finds its posture", "the model of the led arm finds its"),
    Reason("FORCE_AT_LIMIT", "the interaction force is at its limit", "interaction force of"),
    Reason("NOTHING_LEFT", "the bounds leave nothing of the commanded motion", "the bounds leave nothing"),
)
"""In the order of their numbers, which never change."""


def reason_number(reason: str) -> int:
    """Number of what a `Command` of Python gives as its reason, notes aside.

    Raises
    ------
    ConfigurationError : none of these.
    """
    reason = without_notes(reason)
    if not reason:
        return 0
    for number, each in enumerate(REASONS):
        if each.python is not None and each.python in reason:
            return number
    raise ConfigurationError("reason", reason, "one of those that C knows")
