"""Trials in which the force came too late: a law whose slew limit does not go with its stiffness and damping."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from rehab_opt.session.scenario.trial import Law, Trial

__all__ = ["late_share", "swinging_notes"]

BOUNDED: tuple[Law, ...] = ("assisted", "together", "delayed")
"""Laws that have a slew limit."""
OFTEN = 0.2
"""Share of the ticks with a force. In `scenario_2_assist` with S of 300 to 8000 N/m, D of 5 to 600 N s/m, slew limits
of 60 to 1000 N/s and ticks of 1 and 10 ms it was at most 0.15 where the hand came to rest, and 0.24 to 0.74 where it
swung (in all but one of these until the tank was empty). At 50 Hz, where the shipped springs and dampers chatter, it
was 0.39 to 0.97."""
FULL = 0.99
"""Share of the slew limit from which on it is the limit that decides."""


def late_share(trial: Trial, *, slew_limit: float) -> float:
    """Share of the ticks with a force in which it changed as fast as `slew_limit` [N/s] allows; 0 without a force."""
    change = np.linalg.norm(np.diff(trial.commanded, axis=0, prepend=0.0), axis=1)
    late = change >= FULL * slew_limit * float(trial.time[1] - trial.time[0]) if len(trial.time) > 1 else change < 0
    given = (trial.wanted != 0).any(axis=1) | (trial.commanded != 0).any(axis=1)
    return float((late & given).sum() / given.sum()) if given.any() else 0.0


def swinging_notes(trials: Mapping[Law, tuple[Trial, ...]], *, slew_limit: float) -> Iterator[str]:
    """A note for each law whose force was late: what comes late drives a swing, until the energy tank is empty."""
    for law in BOUNDED:
        worst = max((late_share(trial, slew_limit=slew_limit) for trial in trials.get(law, ())), default=0.0)
        if worst > OFTEN:
            yield (
                f"{law}: in {100 * worst:.0f} % of the ticks with a force it changed as fast as "
                f"assistance.slew_limit_N_s = {slew_limit:g} allows: it comes too late and can swing the hand; slew "
                "limit, run.rate_hz, stiffness and damping do not go together"
            )
