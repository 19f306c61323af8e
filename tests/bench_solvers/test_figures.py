"""What the figures show."""

from __future__ import annotations

import numpy as np

from bench.solvers.figures import figures_of
from bench.solvers.judgement import Judged, Outcome
from bench.solvers.passes import Pass
from bench.solvers.summary import rows_of

TICKS = 8


def passes(**seconds: float) -> list[Pass]:
    """Solvers that take as long each time, or fail each time (infinite)."""

    def judged(time: float) -> Judged:
        return Judged(Outcome.SOLVED if np.isfinite(time) else Outcome.WRONG, min(time, 1.0), 1e-12, 1e-12)

    return [
        Pass(solver, "box/plain", mode, (judged(time),) * TICKS) for solver, time in seconds.items()
        for mode in ("cold", "warm")
    ]  # fmt: skip


def drawn(**seconds: float) -> dict[str, object]:
    made, hopeless = passes(**seconds), {"box/plain": np.zeros(TICKS, dtype=bool)}
    return dict(figures_of(made, rows_of(made, hopeless, limit=1.0), hopeless))


def test_a_solver_a_thousand_times_slower_is_seen_to_solve_what_it_solves() -> None:
    figure = drawn(quick=1e-6, slow=2e-3)["box_profile"]
    for axes in figure.axes:  # type: ignore[attr-defined]
        (slow,) = [line for line in axes.get_lines() if line.get_label() == "slow"]
        x, y = slow.get_data()
        assert (np.diff(x) >= 0).all()
        assert axes.get_xlim()[1] >= 2000 * (1 - 1e-12)
        assert y[x < 1999].max() == 0.0
        assert y[-1] == 1.0


def test_failures_of_all_ticks_are_100_percent() -> None:
    figure = drawn(quick=1e-6, never=np.inf)["box_times"]
    notes = [text.get_text() for axes in figure.axes for text in axes.texts]  # type: ignore[attr-defined]
    assert notes == ["100 % failed"] * 2
