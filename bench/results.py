"""What measuring commands say, put into RESULTS.md: `python -m bench.results imports "arm_ik --targets 100"`.

Each is run as `python -m bench.NAME`, and its lines PASS, FAIL and NOTE are the section of its name, with date, machine
and versions, in place of the section that stood there.
"""

from __future__ import annotations

import argparse
import shlex
import subprocess
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from bench.machine import machine

__all__ = ["RESULTS", "main", "write_section"]

RESULTS = Path(__file__).parent / "RESULTS.md"
SAID = ("PASS  ", "FAIL  ", "NOTE  ")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run each command and write its section; 1 where one of them failed, whose section says so."""
    parser = argparse.ArgumentParser(prog="python -m bench.results", description=__doc__)
    parser.add_argument("commands", nargs="+", metavar="NAME", help="a module of bench, with its options")
    failed = False
    for words in map(shlex.split, parser.parse_args(arguments).commands):
        begun = machine()
        done = subprocess.run(
            [sys.executable, "-m", f"bench.{words[0]}", *words[1:]], check=False, stdout=subprocess.PIPE, text=True
        )
        said = [f"    {line}" for line in done.stdout.splitlines() if line.startswith(SAID)]
        if not said:
            said = [f"It ended with exit code {done.returncode} and said no number."]
        versions = ", ".join(f"{name} {version(name)}" for name in ("rehab_opt", "casadi", "numpy", "scipy"))
        lines = [
            f"## bench.{words[0]}",
            "",
            f"{datetime.now(UTC):%Y-%m-%d}, {'; '.join(f'{key} {value}' for key, value in begun.items())}; {versions}.",
            "",
            f"    python -m bench.{shlex.join(words)}",
            "",
            *said,
        ]
        print("\n".join(lines))
        write_section(RESULTS, f"bench.{words[0]}", lines)
        failed |= done.returncode != 0
    return int(failed)


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
