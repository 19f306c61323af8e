"""Stands in for a person's run in tests about the many: quick, broken on demand, found by other processes."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

from rehab_opt.errors import ConfigurationError
from rehab_opt.session.many.participant import Participant, PersonResult

__all__ = ["blas_threads", "person", "quick"]


class OddError(Exception):
    """An exception that cannot be made again from its pickle."""

    def __init__(self, one: str, two: str) -> None:
        super().__init__(one + two)


def person(name: str, title: str = "fine") -> Participant:
    """A sound problem whose title tells `quick` what to do."""
    content = {"system": "workspace", "title": title, "arm": {"side": "left", "range_of_motion": "regular"}}
    return Participant(name, content, f"{name}.toml", Path(f"{name}.toml"))


def quick(participant: Participant) -> PersonResult:
    """What the title says; leaves a line in the file that follows it, if any, to be counted."""
    what, _, log = str(participant.content["title"]).partition(" ")
    if log:
        with Path(log).open("a", encoding="utf-8") as file:
            file.write(f"{participant.name}\n")
    if what == "killed":
        os.kill(os.getpid(), signal.SIGKILL if hasattr(signal, "SIGKILL") else signal.SIGTERM)
    if what == "broken":
        raise ZeroDivisionError("a mistake\nin two lines")
    if what == "odd":
        raise OddError("a", "b")
    if what == "refused":
        raise ConfigurationError("hand", 3, "one of two")
    if what == "slow":
        time.sleep(60.0)
    return PersonResult({"metrics.json": participant.name.encode()}, {"letters": len(participant.name)}, 0.001)


def blas_threads(_: object) -> str | None:
    """What numpy read when this process loaded it."""
    return os.environ.get("OPENBLAS_NUM_THREADS")
