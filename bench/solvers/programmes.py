"""Nonlinear programmes in the comparison: each from the start its capability gives it, by every solver we offer."""

from __future__ import annotations

import hashlib
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.solvers.entrant import Claim, Entrant, Solver
from bench.solvers.nlp_instances import PLAN, NLPInstances, read_nlp_instances
from bench.solvers.reference import ACCURACY, Reference
from bench.solvers.shipped import shipped_nlp_instances
from rehab_opt.optim.backends import Answer
from rehab_opt.optim.nlp_solvers import nlp_solver
from rehab_opt.symbolic import BufferedFunction, Compile

__all__ = ["PREFIX", "PROGRAMME_ENTRANTS", "Programmes", "shipped_programmes"]

Array = NDArray[np.float64]

COMPILED = 20
"""Variables up to which a solver is compiled: a step of 48 takes the compiler a minute and is no quicker for it, since
nearly all of its time goes into the QP."""
PUSHING = 1e-7
"""Multipliers up to which a bound of an interior-point answer is not active: none of them is zero there."""
PREFIX = "nlp_"
"""Of a family's name, that it is told from the QPs of the same capability."""


class Programmes:
    """The instances of one file, as parameters and start; other processes read the file anew."""

    kind = "nlp"

    def __init__(self, path: Path) -> None:
        self._path = path
        self.name, self.tolerance = f"{PREFIX}{self._read.name}", self._read.tolerance
        self.command, self.about = self._read.command, self._read.about

    def __reduce__(self) -> tuple[Any, ...]:
        return Programmes, (self._path,)

    def __len__(self) -> int:
        return len(self._read)

    def __getitem__(self, tick: int) -> tuple[Array, Array]:
        return self._read.parameters[tick], self._read.starts[tick]

    def marks_of(self, tick: int) -> tuple[str, ...]:
        """None: all of them have an answer."""
        return ()

    @property
    def nlp(self) -> Any:
        """The statement."""
        return self._read.nlp

    @property
    def sizes(self) -> tuple[int, int]:
        """Numbers of variables and rows."""
        return self._read.nlp.n, self._read.nlp.m

    @property
    def digest(self) -> str:
        """Of the numbers."""
        return hashlib.sha256(self._path.read_bytes()).hexdigest()

    @cached_property
    def _read(self) -> NLPInstances:
        return read_nlp_instances(self._path)

    def residual(self, tick: int, claim: Answer) -> float:
        """The certificate's; infinite where a number is."""
        certify = self._certify
        certify.inputs[0][:] = self._read.parameters[tick]
        certify.inputs[1][:] = claim.x
        certify.inputs[2][:] = np.concatenate(claim[1:3])
        certify()
        return float(certify.outputs[2][0])

    @cached_property
    def _certify(self) -> BufferedFunction:
        return BufferedFunction(self._read.nlp.certify)

    def references(self) -> tuple[Reference, ...]:
        """Ipopt's from the same start, polished by our SQP: programmes have other local answers, far from it."""
        ipopt = nlp_solver(self._read.nlp, "ipopt", tolerance=0.01 * ACCURACY)
        polish = nlp_solver(self._read.nlp, "sqp", tolerance=0.01 * ACCURACY, compile=False)
        found = []
        for parameters, start in zip(self._read.parameters, self._read.starts, strict=True):
            ipopt.parameters[:] = polish.parameters[:] = parameters
            first = ipopt.solve(start)
            pushing = np.where(np.abs(first.multipliers) > PUSHING, first.multipliers, 0.0)
            answers = [first, polish.solve(first.x, pushing)]
            best = min(answers, key=lambda answer: answer.residual if answer.residual >= 0 else np.inf)
            found.append(Reference(best.x, best.residual, "ipopt", unique=True))
        return tuple(found)


def shipped_programmes() -> dict[str, Path]:
    """Name and file of every shipped set of programmes; whole plans are none."""
    found = {}
    for name, path in shipped_nlp_instances().items():
        if read_nlp_instances(path).statement != PLAN:
            found[f"{PREFIX}{name}"] = path
    return found


def by_casadi(programmes: Programmes, solver: str) -> Solver:
    """One of the solvers that `ArmIK` takes."""
    return _Programme(programmes, solver)


class _Programme:
    def __init__(self, programmes: Programmes, solver: str) -> None:
        nlp = programmes.nlp
        small: Compile = "wait" if nlp.n <= COMPILED else False
        self._solver = nlp_solver(nlp, solver, tolerance=programmes.tolerance, compile=small)

    def prepared(self, instance: tuple[Array, Array]) -> Any:
        return instance

    def solve(self, given: Any, *, warm: bool) -> Any:
        self._solver.parameters[:], start = given
        return self._solver.solve(start)

    def claim(self, instance: tuple[Array, Array], answered: Any) -> Claim:
        n = answered.x.size
        answer = Answer(answered.x, answered.multipliers[:n], answered.multipliers[n:], answered.iterations)
        return Claim(answered.certified, answer, "" if answered.certified else f"residual {answered.residual:.1e}")


PROGRAMME_ENTRANTS = tuple(
    Entrant(name, by_casadi, name, ("casadi",), kind="nlp") for name in ("sqp", "ipopt", "fatrop", "sqpmethod")
)
"""All of these generate or ship with CasADi; a plugin that is not there raises when it is made."""
