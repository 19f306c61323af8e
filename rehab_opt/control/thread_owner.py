"""Objects with state that belong to one thread, so that no other thread changes them during a tick.

Their settings are fixed at construction, since a tick's functions are made from them.
"""

from __future__ import annotations

import threading
from threading import get_ident
from typing import Any

from rehab_opt.errors import ConfigurationError, SharingError

__all__ = ["OneThread", "setting"]

_CLAIMING = threading.Lock()


class OneThread:
    """Base class of every object that keeps state between ticks, such as a controller.

    The thread of the first `step` becomes the owner. While the owner lives, `step`, `reset` or a change of a setting by
    another thread raises `SharingError`. `reset` by the owner releases the object to the next thread that steps it.
    Copies and pickles are refused. Fields, maps, workspaces, chains and robots are immutable and can be shared.

    A method that runs a tick starts with `if self._owner != get_ident(): self._claim()`. A method that only changes a
    setting calls `_refuse_others`.
    """

    _owner = 0

    def _claim(self) -> None:
        threading.current_thread()  # registers a thread that Python did not start, for `_refuse_others`
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
                    "make one per thread, or let its owner call reset() and stop stepping it"
                )

    def __reduce__(self) -> tuple[Any, ...]:
        raise SharingError(
            f"a {type(self).__name__} cannot be copied or pickled, since its memory would be shared or lost: "
            "make another one with the same arguments"
        )


def setting() -> Any:
    """Class attribute that `__init__` sets once; a later change raises an error."""
    return _Setting()


class _Setting:
    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __set__(self, made: object, value: object) -> None:
        if self._name in vars(made):
            kind = type(made).__name__
            raise ConfigurationError(self._name, value, f"no change once a {kind} is made: make another {kind} with it")
        vars(made)[self._name] = value
