"""Make the corpus again: `python -m bench.solvers.regenerate [NAME ...] --out bench/solvers`.

Runs the controllers and writes `qp/<name>.npz` and `nlp/<name>.npz` below `--out`; a name stands for all that begin
with it. Nothing is random but for seeds that are fixed: the numbers come out the same, to rounding.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from bench.qp_recording.sequence import write_sequence
from bench.solvers import corpus, nlp_corpus
from bench.solvers.nlp_instances import write_nlp_instances
from rehab_opt.errors import ConfigurationError, RehabOptError

__all__ = ["main"]


def main(arguments: Sequence[str] | None = None) -> int:
    """Write what is asked for; exit code 2 where something is wrong."""
    parser = argparse.ArgumentParser(prog="python -m bench.solvers.regenerate", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="beginning of a name; all by default")
    parser.add_argument("--out", type=Path, default=Path("out") / "corpus", help="folder; ./out/corpus by default")
    options = parser.parse_args(arguments)
    try:
        _regenerate(options.names, options.out)
    except RehabOptError as problem:
        print(f"regenerate: {problem}", file=sys.stderr)
        return 2
    return 0


def _regenerate(asked: Sequence[str], out: Path) -> None:
    """Raises ConfigurationError where nothing has such a name."""
    known = (*corpus.names(), *(f"nlp/{name}" for name in nlp_corpus.names()))
    for each in asked:
        if not any(name.startswith(each) for name in known):
            raise ConfigurationError("NAME", each, f"the beginning of one of {', '.join(known)}")
    for name in known:
        if asked and not any(name.startswith(each) for each in asked):
            continue
        if name.startswith("nlp/"):
            path = out / f"{name}.npz"
            instances = nlp_corpus.made(name.removeprefix("nlp/"))
            write_nlp_instances(path, instances, argument="--out")
            told = f"{len(instances)} instances of {instances.statement}"
        else:
            path, sequence = out / "qp" / f"{name}.npz", corpus.made(name)
            write_sequence(path, sequence, argument="--out")
            told = f"{len(sequence)} ticks, {sequence.n} variables, {sequence.m} rows"
        print(f"{path}: {told}, {path.stat().st_size / 1e3:.0f} kB", flush=True)


if __name__ == "__main__":
    sys.exit(main())
