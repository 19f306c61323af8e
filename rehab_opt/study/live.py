"""Trials of a live session: a trial lasts while the dead man's switch is held, and is stored when it is released."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.measures.score import Measure, score
from rehab_opt.session.live.problem import Seen
from rehab_opt.study.options import Destination
from rehab_opt.study.record import outline, versions
from rehab_opt.study.trial import Bound, Event, ProblemText, Trial

__all__ = ["LiveTrials"]

Array = NDArray[np.float64]

SHORTEST = 1.0
"""Shortest duration [s] of a trial."""
USUAL = "ok"


class LiveTrials:
    """Stores the frames of a live page, 30 per second, as trials of a study; `LivePage` calls its methods.

    A trial has the mean and maximum of each plotted number, bounds for numbers with a limit, an event for each status
    other than "ok", measures of the hand's path, and all samples.

    Parameters
    ----------
    into : study and session of the trials.
    problem : the problem that runs live.
    """

    def __init__(self, into: Destination, problem: ProblemText) -> None:
        self._into, self._problem = into, problem
        self._plots: Sequence[Mapping[str, Any]] = ()
        self._seen: list[Seen] = []
        self.written = 0

    def begin(self, plots: Sequence[Mapping[str, Any]]) -> None:
        """Set the plotted numbers, each with `name`, `unit`, and `line` if the number has a limit."""
        self._plots = plots

    def see(self, seen: Seen) -> None:
        """Add one frame of the page; a released switch ends the trial. Raises as `Study.add`."""
        if not seen.held:
            self.end()
        elif not self._seen or seen.time > self._seen[-1].time:
            self._seen.append(seen)

    def end(self) -> None:
        """Store the current trial if it lasts at least 1 s."""
        seen, self._seen = self._seen, []
        if seen and seen[-1].time - seen[0].time >= SHORTEST:
            self.written += self._into.add([self._trial(seen)])

    def _trial(self, seen: Sequence[Seen]) -> Trial:
        time = np.array([each.time for each in seen]) - seen[0].time
        numbers = np.array([each.numbers for each in seen], dtype=np.float64)
        trace: dict[str, Any] = {"t_s": time, "status": [each.status for each in seen]}
        measures = [Measure("held", float(time[-1]), "s")]
        bounds = []
        for plot, values in zip(self._plots, numbers.T, strict=False):
            name, unit = plot["name"], plot.get("unit", "")
            trace[f"{name} [{unit}]"] = values
            known = values[np.isfinite(values)]
            if known.size:
                measures += [Measure(f"{name}, mean", float(known.mean()), unit)]
                measures += [Measure(f"{name}, largest", float(known.max()), unit)]
                if math.isfinite(plot.get("line", math.nan)):
                    bounds.append(Bound(name, float(known.max()), float(plot["line"]), unit))
        notes, ground = ["seen 30 times a second: what was shorter may be missing"], []
        if all(each.hand is not None for each in seen):
            hand = np.array([each.hand for each in seen], dtype=np.float64)
            trace |= {f"hand_{axis}_m": values for axis, values in zip("xyz", hand.T, strict=True)}
            try:
                scored = score(time, hand)
                measures += scored.measures
                notes += scored.notes
                ground = outline(scored.movement)
            except ConfigurationError as refused:
                notes.append(f"the hand was not measured: {refused}")
        return Trial(
            "live", measures, bounds=bounds, events=list(_events(seen)), outline=ground, trace=trace, notes=notes,
            problem=self._problem, software=versions(), seconds=float(time[-1]),
        )  # fmt: skip


def _events(seen: Sequence[Seen]) -> Iterator[Event]:
    """Events of a trial: frames with a status other than "ok", by reason; skipped ticks; withheld commands."""
    counted = Counter(": ".join(filter(None, (each.status, each.reason))) for each in seen if each.status != USUAL)
    for what, times in counted.items():
        yield Event(what, times, "pictures")
    for what, times in (
        ("ticks left out", seen[-1].missed - seen[0].missed),
        ("stale", seen[-1].stale - seen[0].stale),
    ):
        if times:
            yield Event(what, times)
