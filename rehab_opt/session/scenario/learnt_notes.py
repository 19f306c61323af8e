"""What a reader has to know of a learnt field, in sentences."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rehab_opt.field.demonstration import Demonstration
from rehab_opt.field.fit import Fit
from rehab_opt.session.scenario.problem import ScenarioProblem

__all__ = ["learnt_notes"]

RESTING, MOSTLY = 0.005, 0.6
"""[m/s] A hand slower than this rests; share of samples from which on rests decide what is learnt."""
CLEARLY = 2.0
"""Standard errors: a stiffness that is less above zero is told to be hardly known."""
WORST = 0.5
"""Share of the held-out forces from which on a field reproduces them badly."""


def learnt_notes(problem: ScenarioProblem, fit: Fit, shown: tuple[Demonstration, ...]) -> Iterator[str]:
    """What was learnt, how well it does, and what to look for in the recordings."""
    yield from _fit_notes(fit, len(shown))
    yield from _data_notes(problem, shown)


def _data_notes(problem: ScenarioProblem, shown: tuple[Demonstration, ...]) -> Iterator[str]:
    """What to look for in the recordings."""
    slow = [float(np.mean(np.linalg.norm(each.velocities, axis=1) < RESTING)) for each in shown]
    if max(slow) > MOSTLY:
        assert problem.task.demonstrations is not None
        file = problem.task.demonstrations.files[int(np.argmax(slow))]
        yield (
            f"{file}: the hand rests in {100 * max(slow):.0f} % of the samples, which count like the others: S and D "
            "are largely those of the rests, unless they are cut off"
        )
    largest, limit = max(float(np.linalg.norm(each.forces, axis=1).max()) for each in shown), problem.assistance
    if largest > 2 * limit.force_limit_N:
        yield (
            f"the recorded forces reach {largest:.3g} N: the field is stiffer than assistance.force_limit_N = "
            f"{limit.force_limit_N:g} lets it be"
        )


def _fit_notes(fit: Fit, shown: int) -> Iterator[str]:
    """What was learnt, in sentences."""
    said, spread = fit.parameters, fit.standard_error
    numbers = ", ".join(
        f"{symbol} = {said[name]:.3g} +- {spread[name]:.2g} {unit}"
        for symbol, name, unit in (("S", "stiffness", "N/m"), ("k1", "drag", "N/m"), ("D", "damping", "N s/m"))
    )
    held = len(fit.held_out)
    yield (
        f"the field was learnt from {shown - held} of {shown} demonstrations: {numbers}, "
        f"sigma = {1e3 * fit.width:g} mm; {fit.training_error:.2g} N are left"
    )
    if held:
        flattered = ", by which sigma was chosen" if fit.chosen_on_held_out else ""
        bad = ": it does not reproduce them well" if not fit.held_out_share <= WORST else ""
        yield (
            f"of the {held} held out{flattered}, its forces are {fit.held_out_error:.2g} N off, "
            f"{100 * fit.held_out_share:.0f} % of what was recorded (a constant stiffness: "
            f"{fit.constant_stiffness_error:.2g} N){bad}"
        )
    if not said["stiffness"] > CLEARLY * spread["stiffness"]:
        yield "the demonstrations hardly tell S: more of them, or such as stray further from the path, would"
    if fit.unidentified:
        yield f"the demonstrations do not tell {', '.join(fit.unidentified)}: the regularisation chose"
