"""What of a problem's spring, damper, slew limit and rate lets its force swing the hand."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from rehab_opt.session.scenario.laws import ForceLaw
from rehab_opt.session.scenario.trial import Law

__all__ = ["BOUNDED", "swinging_notes"]

BOUNDED: tuple[Law, ...] = ("assisted", "together", "delayed")
"""Laws that have a slew limit."""


def swinging_notes(laws: Mapping[Law, ForceLaw]) -> Iterator[str]:
    """What `settling_notes` has to say of each law, in the keys of a problem file."""
    for name, law in laws.items():
        for note in law.notes:
            yield f"{name}: {note.replace('slew_limit =', 'assistance.slew_limit_N_s =')}"
