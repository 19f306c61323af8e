"""Write what a measuring command prints into RESULTS.md: `python -m bench.results imports "arm_ik --targets 100"`.

Each name runs as `python -m bench.NAME`. Its section has the date, the machine, the versions, every line FAIL and
NOTE, and its lines PASS: many of them as their count and those nearest to their bounds.
"""

from __future__ import annotations

import argparse
import re
import shlex
import subprocess
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from bench.machine import machine

__all__ = ["RESULTS", "main", "summarised", "write_section"]

RESULTS = Path(__file__).parent / "RESULTS.md"
PRINTED = ("PASS  ", "FAIL  ", "NOTE  ")
MANY = 4
"""Lines PASS that are all shown."""
NEAREST = 2
"""Lines PASS that are shown of more than that."""
NUMBERS = re.compile(r": (\S+)(?: \S+)? \(target [<>]= ([^\s)]+)")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run each command and write its section; 1 if one of them failed, which its section says."""
    parser = argparse.ArgumentParser(prog="python -m bench.results", description=__doc__)
    parser.add_argument("commands", nargs="+", metavar="NAME", help="a module of bench, with its options")
    failed = False
    for words in map(shlex.split, parser.parse_args(arguments).commands):
        begun = machine()
        done = subprocess.run(
            [sys.executable, "-m", f"bench.{words[0]}", *words[1:]], check=False, stdout=subprocess.PIPE, text=True
        )
        printed = [line for line in done.stdout.splitlines() if line.startswith(PRINTED)]
        shown = [f"    {line}" for line in summarised(printed)]
        if not shown:
            shown = [f"It ended with exit code {done.returncode} and printed no number."]
        versions = ", ".join(f"{name} {version(name)}" for name in ("casadi", "numpy", "scipy"))
        lines = [
            f"## bench.{words[0]}",
            "",
            f"{datetime.now(UTC):%Y-%m-%d}, {'; '.join(f'{key} {value}' for key, value in begun.items())}; {versions}.",
            "",
            f"    python -m bench.{shlex.join(words)}",
            "",
            *shown,
        ]
        print("\n".join(lines))
        write_section(RESULTS, f"bench.{words[0]}", lines)
        failed |= done.returncode != 0
    return int(failed)


def summarised(lines: Sequence[str]) -> list[str]:
    """Every line that is not a PASS; of more than `MANY` lines PASS their count and the `NEAREST` to their bounds."""
    passed = [line for line in lines if line.startswith("PASS")]
    others = [line for line in lines if not line.startswith("PASS")]
    if len(passed) <= MANY:
        return list(lines)
    nearest = sorted(passed, key=_margin)[:NEAREST]
    return [*others, f"PASS  {len(passed)} numbers, of which these are nearest to their bounds:", *nearest]


def _margin(line: str) -> float:
    """Distance from the bound as a fraction of it; infinite where the bound is zero, which is met or missed."""
    found = NUMBERS.search(line)
    if found is None or float(found[2]) == 0:
        return float("inf")
    return abs(float(found[1]) / float(found[2]) - 1)


def write_section(file: Path, name: str, lines: Sequence[str]) -> None:
    """Put lines between the marks of this name, in place of what stood there; at the end where there are none."""
    begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
    text = file.read_text(encoding="utf-8")
    before, found, rest = text.partition(begin)
    after = rest.partition(end)[2] if found else "\n"
    before = before if found else f"{text.rstrip()}\n\n"
    file.write_text(before + "\n".join([begin, *lines, end]) + after, encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
