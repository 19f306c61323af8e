"""Solvers compared on recorded QPs: `python -m bench.solvers [--family ...] [--solver ...]` (extra `bench`).

Writes table.md, results.json and figures. What is done is not done again.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from bench.solvers.command import Interruption, bench_command
from rehab_opt.terminal import bars, ending_in_a_line, on_interrupt, undisturbed, writable

__all__ = ["main"]


def main(arguments: Sequence[str] | None = None) -> None:
    """Compare, print and write."""
    parser = argparse.ArgumentParser(prog="python -m bench.solvers", description=__doc__)
    parser.add_argument("--family", action="append", help="family, sequence or .npz; all of them by default")
    parser.add_argument("--solver", action="append", help="every installed one by default")
    parser.add_argument("--time-limit", type=float, default=1.0, help="[s] of one solve: then its process is killed")
    parser.add_argument("--out", type=Path, default=Path("out/bench"), help="folder of results, and of what was kept")
    given = parser.parse_args(arguments)
    interruption = Interruption()
    with ending_in_a_line():
        try:
            with on_interrupt(interruption), bars() as progress:
                told, place = interruption.checked(progress), writable(given.out)
                bench_command(
                    given.family, given.solver, time_limit=given.time_limit, out=place, progress=told,
                    writing=undisturbed(),
                )  # fmt: skip
        except KeyboardInterrupt:
            print("interrupted; the same command goes on from here", file=sys.stderr)
            sys.exit(130)


if __name__ == "__main__":
    main()
