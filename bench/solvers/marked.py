"""What goes wrong, made from real ticks: QPs without a solution, degenerate, badly scaled, and with broken numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from bench.qp_recording.sequence import QPSequence, sequence_of
from bench.solvers.shipped import regenerate_command
from rehab_opt.errors import RehabOptError
from rehab_opt.optim.backends import backend
from rehab_opt.optim.certificate import certificate_function, is_certified
from rehab_opt.optim.rows import Instance

__all__ = ["MAKERS", "badly_scaled", "contradicting", "degenerate", "with_broken_numbers"]

Array = NDArray[np.float64]

TICKS = 100
"""Of the sequence that it is made from."""
APART = 0.05
"""By how much the contradicting rows miss each other, in units of the row."""
FACTOR = 1e4
"""Units of the variables and rows differ by up to this, both ways."""
BROKEN_EVERY = 10
"""Ticks from one broken one to the next."""


def contradicting(sequence: QPSequence, name: str) -> QPSequence:
    """In each tick two rows more that cannot both hold: the sum of the variables below, and above, the same number."""

    def made(qp: Instance) -> Instance:
        row = np.ones(qp.g.size)
        pair, middle = np.stack([row, row]), 0.0
        lower, upper = np.array([-np.inf, middle + APART]), np.array([middle - APART, np.inf])
        return _with_rows(qp, pair, lower, upper)

    about = "two rows contradict each other: no x exists"
    return _remade(sequence, name, [made(qp) for qp in sequence], marks=[("infeasible",)], about=about)


def shut_out(sequence: QPSequence, name: str) -> QPSequence:
    """In each tick one row more that the bounds of the variables exclude, by little."""

    def made(qp: Instance) -> Instance:
        index = int(np.flatnonzero(np.isfinite(qp.upper))[0])
        row = np.zeros((1, qp.g.size))
        row[0, index] = 1.0
        return _with_rows(qp, row, np.array([qp.upper[index] + APART]), np.array([np.inf]))

    about = "one row asks for more than a bound allows: no x exists"
    return _remade(sequence, name, [made(qp) for qp in sequence], marks=[("infeasible",)], about=about)


def degenerate(sequence: QPSequence, name: str) -> QPSequence:
    """Every row twice, a row without coefficients, and the first variable's bounds closed at its own answer."""

    def made(qp: Instance, x: Array) -> Instance:
        held = np.array(x[:1])
        empty = np.zeros((1, qp.g.size))
        twice = _with_rows(qp, np.vstack([qp.A, empty]), np.append(qp.rows_lower, -1.0), np.append(qp.rows_upper, 1.0))
        lower, upper = np.array(qp.lower), np.array(qp.upper)
        lower[0] = upper[0] = held[0]
        return twice._replace(lower=lower, upper=upper)

    instances = [made(qp, x) for qp, x in zip(sequence, _answers(sequence), strict=True)]
    about = "every row stands twice, one is empty, and one variable has bounds of no width"
    return _remade(sequence, name, instances, marks=[("degenerate",)], about=about)


def badly_scaled(sequence: QPSequence, name: str) -> QPSequence:
    """The same QPs in unfit units: variables and rows scaled from 1/FACTOR to FACTOR.

    With x = D y, min 1/2 y'DHDy + g'Dy, R rows_lower <= R A D y <= R rows_upper. A residual of the stationarity is
    larger by up to FACTOR in these units, and the tolerance with it.
    """
    d = FACTOR ** np.linspace(-1.0, 1.0, sequence.n)
    r = FACTOR ** np.linspace(1.0, -1.0, sequence.m)

    def made(qp: Instance) -> Instance:
        return Instance(
            qp.H * np.outer(d, d), qp.g * d, qp.A * np.outer(r, d), qp.rows_lower * r, qp.rows_upper * r,
            qp.lower / d, qp.upper / d,
        )  # fmt: skip

    about = f"variables and rows in units that differ by up to {FACTOR:g} both ways"
    tolerance = sequence.tolerance * FACTOR
    return _remade(
        sequence, name, [made(qp) for qp in sequence], marks=[("badly_scaled",)], about=about, tolerance=tolerance
    )


def with_broken_numbers(sequence: QPSequence, name: str) -> QPSequence:
    """Every tenth tick holds a number that is none: what comes after it shows whether a warm start was poisoned."""
    instances, marks = [], []
    for tick, qp in enumerate(sequence):
        broken = tick % BROKEN_EVERY == BROKEN_EVERY - 1
        marks.append(("nan",) if broken else ())
        instances.append(_broken(qp, tick // BROKEN_EVERY) if broken else qp)
    about = f"NaN or infinity in every {BROKEN_EVERY}th tick, the others as they were"
    return _remade(sequence, name, instances, marks=marks, about=about)


def _broken(qp: Instance, which: int) -> Instance:
    """One number of the cost, a row or a bound, in turn, replaced."""
    key, value = (("g", np.nan), ("H", np.nan), ("lower", np.nan), ("g", np.inf), ("upper", np.nan))[which % 5]
    array = np.array(getattr(qp, key))
    array.flat[0] = value
    return qp._replace(**{key: array})


def _with_rows(qp: Instance, rows: Array, lower: Array, upper: Array) -> Instance:
    return qp._replace(
        A=np.vstack([qp.A, rows]),
        rows_lower=np.concatenate([qp.rows_lower, lower]),
        rows_upper=np.concatenate([qp.rows_upper, upper]),
    )


def _answers(sequence: QPSequence) -> list[Array]:
    """Certified answers of the ticks.

    Raises
    ------
    RehabOptError : one has none.
    """
    solver, certify = backend("proxqp", sequence.n, sequence.m), certificate_function(sequence.n, sequence.m)
    answers = []
    for qp in sequence:
        x, residual = certify(*qp, 1, *solver.solve(qp)[:3])
        if not is_certified(float(residual), sequence.tolerance):
            raise RehabOptError(f"{sequence.name}: no certified answer to make a degenerate QP from ({residual})")
        answers.append(np.array(x).reshape(-1))
    return answers


def _remade(
    sequence: QPSequence,
    name: str,
    instances: Sequence[Instance],
    *,
    marks: Sequence[Sequence[str]],
    about: str,
    tolerance: float | None = None,
) -> QPSequence:
    return sequence_of(
        name, instances, dt=sequence.dt, tolerance=sequence.tolerance if tolerance is None else tolerance,
        command=regenerate_command(name), about=f"{sequence.name}, {about}.", marks=marks,
    )  # fmt: skip


MAKERS: Mapping[str, tuple[str, Callable[[QPSequence, str], QPSequence]]] = MappingProxyType(
    {
        "infeasible/ardis": ("ardis/mecanum_doorway", contradicting),
        "infeasible/pose_tracking": ("pose_tracking/limited", shut_out),
        "infeasible/mirror": ("mirror/late", contradicting),
        "degenerate/ardis": ("ardis/differential_table", degenerate),
        "degenerate/mirror": ("mirror/late", degenerate),
        "badly_scaled/ardis": ("ardis/mecanum_beyond_reach", badly_scaled),
        "badly_scaled/pose_tracking": ("pose_tracking/limited", badly_scaled),
        "nan/pose_tracking": ("pose_tracking/limited", with_broken_numbers),
        "nan/ardis": ("ardis/mecanum_doorway", with_broken_numbers),
    }
)
"""Name of each marked sequence with the sequence it is made from, and how."""
