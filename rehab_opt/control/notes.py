"""What is said of a command besides its reason: the numbers that C adds up, and how Python says the same."""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["HELD_BACK", "NOTES", "Note", "notes_of", "without_notes"]


class Note(NamedTuple):
    """Something that is said of a command without being a fault."""

    name: str
    """Of the constant in C, behind REHAB_."""
    text: str
    """What it means."""
    python: str
    """Part of what Python says then."""


HELD_BACK = "the hand was held back: led at recovery speed until it is free for two seconds"
NOTES = (
    Note("SHORTENED", "the step was shortened: the tangents of the bounds promised too much", "step shortened"),
    Note("SLOWED", "the reference is followed below its own pace", "of its pace"),
    Note("BRIDGING", "a jump of the reference is bridged", "bridging a jump of the reference"),
    Note(
        "THINNED", "no more samples fit: every second one that waited was left out", "every second sample that waited"
    ),
    Note("HELD_BACK", HELD_BACK, "the hand was held back"),
)
"""In the order of their numbers, 1, 2, 4, 8, 16, which never change. Python joins them by semicolons in its reason."""


def notes_of(reason: str) -> int:
    """Sum of the numbers of the notes in what a `Command` of Python gives as its reason."""
    return sum(2**i for i, note in enumerate(NOTES) if note.python in reason)


def without_notes(reason: str) -> str:
    """What is left of a reason of Python without the notes in it."""
    return "; ".join(part for part in reason.split("; ") if not any(note.python in part for note in NOTES))
