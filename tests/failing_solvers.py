"""Solvers that fail when a test says so, in controllers that are told nothing of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from rehab_opt.optim import backends, fallback_chain
from rehab_opt.optim.backends import Answer, Backend, no_answer
from rehab_opt.optim.recorder import QPRecorder, Stream
from rehab_opt.optim.rows import Instance

__all__ = ["Failures", "failing_solvers"]


class Failures(QPRecorder):
    """What fails in the controllers that were made within `failing_solvers`; may be set between ticks."""

    primary = False
    """The fused function returns before it writes anything, as generated code may."""
    backup = False
    """The backup solver gives no answer."""

    @property
    def every(self) -> bool:
        """Whether no solver answers."""
        return self.primary and self.backup

    @every.setter
    def every(self, fails: bool) -> None:
        self.primary = self.backup = fails

    def watched(
        self, solve: Callable[[], None], stream: Stream, values: Callable[[], Any], *, unless: object = None
    ) -> Callable[[], None]:
        """`solve`, unless it is to fail."""

        def solved() -> None:
            if not self.primary:
                solve()

        return solved


class _Backup:
    """A backend that fails when it is told to."""

    def __init__(self, backend: Backend, failures: Failures) -> None:
        self.name, self.forget = backend.name, backend.forget
        self.backend, self.failures = backend, failures

    def solve(self, qp: Instance) -> Answer:
        return no_answer(qp.g.size, len(qp.rows_lower)) if self.failures.backup else self.backend.solve(qp)


@contextmanager
def failing_solvers() -> Iterator[Failures]:
    """Within it, controllers are made whose solvers fail when what it gives says so, now or later."""
    failures, made = Failures(), backends.backend
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fallback_chain, "recorder_now", lambda: failures)
        patch.setattr(backends, "backend", lambda *size, **more: _Backup(made(*size, **more), failures))
        yield failures
