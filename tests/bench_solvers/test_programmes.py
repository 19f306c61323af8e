"""Nonlinear programmes in the comparison: their own certificate judges, and another process reads them anew."""

from __future__ import annotations

import pytest

from bench.solvers.programmes import PROGRAMME_ENTRANTS, Programmes, shipped_programmes
from bench.solvers.reference import ACCURACY


@pytest.fixture(scope="module")
def boundary() -> Programmes:
    return Programmes(shipped_programmes()["nlp_boundary/regular"])


@pytest.mark.parametrize("who", PROGRAMME_ENTRANTS, ids=lambda who: who.name)
def test_what_a_solver_claims_is_what_the_certificate_says(boundary: Programmes, who: object) -> None:
    solver = who.make(boundary, who.solver)  # type: ignore[attr-defined]
    solved = 0
    for tick in range(8):
        claim = solver.claim(boundary[tick], solver.solve(solver.prepared(boundary[tick]), warm=False))
        residual = boundary.residual(tick, claim.answer)
        assert claim.word is bool(residual <= boundary.tolerance)
        moved = claim.answer._replace(x=claim.answer.x + 1e-3)
        assert not boundary.residual(tick, moved) <= boundary.tolerance
        solved += claim.word
    assert solved >= 4


def test_references_are_certified_to_1e_10(boundary: Programmes) -> None:
    known = boundary.references()
    assert len(known) == len(boundary)
    assert max(each.residual for each in known) <= ACCURACY
    assert all(each.distance(each.x) == 0.0 for each in known)
