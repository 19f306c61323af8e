"""Record the QPs that a problem's controllers solve: `python -m bench.record FILE [--out mine.npz]`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from bench.qp_recording.recording import TICKS, file_names, recorded_run
from bench.qp_recording.sequence import write_sequence
from rehab_opt.session.files import load_problem
from rehab_opt.terminal import bars, ending_in_a_line, no_folder, output_file, say, undisturbed

__all__ = ["main"]


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a problem, write a .npz of each solver's QPs."""
    parser = argparse.ArgumentParser(prog="python -m bench.record", description=__doc__)
    parser.add_argument("file", help="a problem file, or the name of a shipped problem")
    parser.add_argument("--out", type=Path, help="by default out/<problem>.npz; several solvers: each adds its name")
    parser.add_argument("--skip", type=int, default=0, help="QPs of each solver that are let pass first")
    parser.add_argument("--ticks", type=int, default=TICKS, help="QPs of each solver that are then kept at most")
    parser.add_argument("--solver", help="of the optimised law, instead of the file's")
    given = parser.parse_args(arguments)
    with ending_in_a_line():
        config = load_problem(given.file)
        place = output_file(given.out, config.name, ".npz")
        with bars() as progress:
            sequences = recorded_run(
                config, skip=given.skip, ticks=given.ticks, progress=progress, solver=given.solver
            )  # fmt: skip
        paths = file_names(place, sequences)
        for path in paths:  # before any of them is written
            no_folder(path)
        with undisturbed():
            for path, sequence in zip(paths, sequences, strict=True):
                write_sequence(path, sequence, argument="--out")
        for path, sequence in zip(paths, sequences, strict=True):
            say(f"{path}: {len(sequence)} QPs of {sequence.n} variables and {sequence.m} rows")


if __name__ == "__main__":
    main()
