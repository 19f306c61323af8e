"""What the comparison asks of recorded instances, whatever their kind."""

from __future__ import annotations

import hashlib
from functools import cached_property
from typing import Any, Protocol

from bench.qp_recording.sequence import ARRAYS, QPSequence
from bench.solvers.dense_qp import Certificate
from bench.solvers.reference import Reference, references
from rehab_opt.optim.backends import Answer
from rehab_opt.optim.rows import Instance

__all__ = ["Instances", "RecordedQPs"]


class Instances(Protocol):
    """Instances one after another, which a worker can be sent."""

    name: str
    tolerance: float
    command: str
    about: str
    kind: str
    """"qp" or "nlp": which entrants can take part."""

    def __len__(self) -> int: ...

    def __getitem__(self, tick: int) -> Any: ...

    def marks_of(self, tick: int) -> tuple[str, ...]:
        """What a tick is said to be beside an ordinary one."""
        ...

    @property
    def sizes(self) -> tuple[int, int]:
        """Numbers of variables and rows."""
        ...

    @property
    def digest(self) -> str:
        """Of the numbers."""
        ...

    def residual(self, tick: int, claim: Answer) -> float:
        """Our certificate's, of a claim about a tick."""
        ...

    def references(self) -> tuple[Reference, ...]:
        """Of every tick."""
        ...


class RecordedQPs:
    """A `QPSequence` in the comparison."""

    kind = "qp"

    def __init__(self, sequence: QPSequence) -> None:
        self.sequence = sequence
        self.name, self.tolerance = sequence.name, sequence.tolerance
        self.command, self.about = sequence.command, sequence.about

    def __reduce__(self) -> tuple[Any, ...]:
        return RecordedQPs, (self.sequence,)

    def __len__(self) -> int:
        return len(self.sequence)

    def __getitem__(self, tick: int) -> Instance:
        return self.sequence[tick]

    def marks_of(self, tick: int) -> tuple[str, ...]:
        """The marks of one tick."""
        return self.sequence.marks_of(tick)

    @property
    def sizes(self) -> tuple[int, int]:
        """Numbers of variables and rows."""
        return self.sequence.n, self.sequence.m

    @property
    def digest(self) -> str:
        """Of the numbers and their marks."""
        digest = hashlib.sha256(repr((self.tolerance, self.sequence.marks)).encode())
        for array in ARRAYS:
            digest.update(getattr(self.sequence, array).tobytes())
        return digest.hexdigest()

    @cached_property
    def _certificate(self) -> Certificate:
        return Certificate(*self.sizes)

    def residual(self, tick: int, claim: Answer) -> float:
        """Our certificate's, of a claim about a tick."""
        return self._certificate.residual(self.sequence[tick], claim)

    def references(self) -> tuple[Reference, ...]:
        """Of every tick."""
        return references(self.sequence)
