"""Objects with memory that belong to one thread, so that no second one changes it in the middle of a tick.

And their settings, of which a tick was made: no later change would reach it, and is refused.
"""

from __future__ import annotations

import threading
from threading import get_ident
from typing import Any

from rehab_opt.errors import ConfigurationError, SharingError

__all__ = ["OneThread", "setting"]

_CLAIMING = threading.Lock()


class OneThread:
    """Base of what keeps memory from tick to tick: every controller.

    The first `step` makes its thread the owner; until then any thread may set the object up. While the owner lives,
    another thread's `step`, `reset` or change of a setting raises a `SharingError`. `reset` by the owner gives the
    object away, to the thread that steps it next; a thread that has ended owns nothing. Copies and pickles, which would
    share the memory or lose it, are refused: make another object with the same arguments. Fields, maps,
    workspaces, chains and robots are immutable, and any number of controllers in any threads may share them.

    A method that ticks begins with `if self._owner != get_ident(): self._claim()`, 40 ns; one that only changes a
    setting has `_refuse_others` in its place.
    """

    _owner = 0

    def _claim(self) -> None:
        threading.current_thread()  # lists a thread that Python did not start, as `_refuse_others` wants it
        with _CLAIMING:
            self._refuse_others()
            self._owner = get_ident()

    def _give_away(self) -> None:
        self._owner = 0

    def _refuse_others(self) -> None:
        owner = self._owner
        if not owner or owner == get_ident():
            return
        for thread in threading.enumerate():
            if thread.ident == owner:
                mine = threading.current_thread().name
                raise SharingError(
                    f"this {type(self).__name__} belongs to thread {thread.name!r}, which stepped it, not to {mine!r}: "
                    "make one for each thread, or let its owner call reset() and step it no more"
                )

    def __reduce__(self) -> tuple[Any, ...]:
        raise SharingError(
            f"a {type(self).__name__} cannot be copied or pickled, since its memory would be shared or lost: "
            "make another one with the same arguments"
        )


def setting() -> Any:
    """An attribute of a class that `__init__` sets once: who lowers a speed later must not believe that it is lower."""
    return _Setting()


class _Setting:
    """Kept among the object's own attributes, from where it is read as any other."""

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __set__(self, made: object, value: object) -> None:
        if self._name in vars(made):
            kind = type(made).__name__
            raise ConfigurationError(self._name, value, f"no change once a {kind} is made: make another {kind} with it")
        vars(made)[self._name] = value
