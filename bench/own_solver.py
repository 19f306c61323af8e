"""A solver of one's own in the comparison: `python bench/own_solver.py`, in a checkout with the extra `bench`.

It may raise, hang, crash or claim a wrong answer: each is counted apart, and no other solver is disturbed.
"""

from pathlib import Path

import numpy as np

from bench.solvers.entrants import Claim, Entrant, entrants_named
from bench.solvers.passes import Rules
from bench.solvers.run import chosen_sequences, compare, write_comparison
from rehab_opt.optim.backends import Answer


class Projected:
    """Gauss-Seidel within a box: it takes no rows, and its answer is not exact."""

    def prepared(self, qp):  # not timed: the QP in the solver's own terms
        if qp.rows_lower.size:
            raise ValueError("it knows no rows")
        return qp

    def solve(self, qp, *, warm):  # timed; not warm: as if it had solved nothing before
        x = np.clip(np.zeros(qp.g.size), qp.lower, qp.upper)
        for _ in range(20):
            for i in range(x.size):
                x[i] = np.clip(x[i] - (qp.H[i] @ x + qp.g[i]) / qp.H[i, i], qp.lower[i], qp.upper[i])
        return x

    def claim(self, qp, x):  # its word, its answer with multipliers (positive at an upper bound), why not
        return Claim(True, Answer(x, -(qp.H @ x + qp.g), np.zeros(0), 20))


def make(recorded, option):  # `recorded.sequence` is a QPSequence
    return Projected()


if __name__ == "__main__":  # workers import this file
    taking_part = [*entrants_named(["daqp"]), Entrant("projected", make)]
    out = Path("out/mine")
    for found in compare(chosen_sequences(["pose_tracking/free"]), taking_part, out=out, rules=Rules(limit=1.0)):
        print(len(found.done), "passes")
    write_comparison(found, out)
