"""The ratios of the project's README from one command: `python -m bench.peers.ratios` (extra `peers`).

Runs the benches that compare with something, each in a process of its own, small by default and as the README has them
with `--full`, and prints every ratio they judge, asked and measured. One that cannot run here says why and costs the
others nothing. Exit code 1 where a ratio is missed or a bench did not run.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from rich.console import Console
from rich.table import Table

from bench.machine import machine

__all__ = ["Ratio", "main", "ratios_in"]

SMALL: Mapping[str, tuple[str, ...]] = {
    "bench.peers.pose_tracking": ("--rounds", "10"),
    "bench.peers.mobile_manipulator": ("--rounds", "8", "--ticks", "100"),
    "bench.mirror": ("--parts", "tick", "plan", "--rounds", "20"),
    "bench.spline": ("--rounds", "7"),
    "bench.assistance": ("--ticks", "3000"),
    "bench.arm_ik": ("--parts", "cold", "warm", "--targets", "100", "--samples", "200", "--paths", "1"),
    "bench.workspace": ("--ranges", "regular", "--repeats", "2", "--probes", "20", "--factor", "10"),
    "bench.scenarios": ("--people", "2"),
    "bench.defaults": ("--rounds", "3", "--ticks", "100"),
}
"""Options of a small run of each bench; none of them changes what is compared."""
SECONDS = 1800.0
NOT_ASKED = "-"
POSES = "bench.peers.pose_tracking"
VERDICT = re.compile(
    r"^(?P<word>PASS|FAIL)  (?P<what>.+): (?P<measured>\S+)(?P<unit> \S+)? "
    r"\(target (?P<relation><=|>=) (?P<asked>\S+?)(?: \S+)?\)$"
)


NOTE = re.compile(r"^NOTE  (?P<what>.+): (?P<measured>\S+) \(reported\)$")


class Ratio(NamedTuple):
    """One number of the table."""

    bench: str
    what: str
    asked: str
    """"-" where nothing was."""
    measured: float
    met: bool


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is asked for and print the table."""
    parser = argparse.ArgumentParser(prog="python -m bench.peers.ratios", description=__doc__)
    parser.add_argument("--only", nargs="+", choices=list(SMALL), default=list(SMALL), metavar="BENCH")
    parser.add_argument("--full", action="store_true", help="the sizes of the README: half an hour")
    parser.add_argument("--json", type=Path, help="write the numbers here too")
    options = parser.parse_args(arguments)
    console = Console(width=max(Console().width, 120))
    here = machine()
    console.print("  ".join(f"{key}: {value}" for key, value in here.items()), highlight=False)
    found: list[Ratio] = []
    missing: dict[str, str] = {}
    for name in options.only:
        with console.status(name):
            text, error = _output(name, () if options.full else SMALL[name])
        ratios = ratios_in(text, name)
        found += ratios
        if error or not ratios:
            missing[name] = error or "it judged no ratio"
    table = Table("bench", "ratio", "target", "measured", "met")
    for ratio in found:
        met = "-" if ratio.asked == NOT_ASKED else "yes" if ratio.met else "[red]no"
        table.add_row(ratio.bench, ratio.what, ratio.asked, f"{ratio.measured:.3g}", met)
    console.print(table)
    for name, why in missing.items():
        console.print(f"{name} did not run: {why}", style="bold red", highlight=False, markup=False, soft_wrap=True)
    if {ratio.bench for ratio in found} & {POSES} and not any("roboticstoolbox" in ratio.what for ratio in found):
        console.print("Robotics Toolbox is not installed: without its ratios", style="bold", highlight=False)
    if options.json:
        options.json.write_text(
            json.dumps({"machine": here, "ratios": [each._asdict() for each in found], "not run": missing}, indent=2)
        )
    return 0 if found and not missing and all(ratio.met for ratio in found) else 1


def ratios_in(text: str, bench: str) -> list[Ratio]:
    """The verdicts without a unit in what a bench has printed, and what it only reports."""
    found = []
    for line in text.splitlines():
        note = NOTE.match(line.strip())
        if note is not None:
            found.append(Ratio(bench, note["what"], NOT_ASKED, float(note["measured"]), met=True))
        read = VERDICT.match(line.strip())
        if read is not None and read["unit"] is None:
            asked, met = f"{read['relation']} {read['asked']}", read["word"] == "PASS"
            found.append(Ratio(bench, read["what"], asked, float(read["measured"]), met))
    return found


def _output(module: str, options: Sequence[str]) -> tuple[str, str]:
    """What a bench prints, and why it did not get to its verdicts; a missed verdict is no such reason."""
    try:
        done = subprocess.run(
            [sys.executable, "-m", module, *options], capture_output=True, text=True, timeout=SECONDS, check=False
        )
    except subprocess.TimeoutExpired:
        return "", f"not done after {SECONDS:g} s"
    judged = any(VERDICT.match(line.strip()) for line in done.stdout.splitlines())
    if judged and done.returncode in (0, 1) and "Traceback" not in done.stderr:
        return done.stdout, ""
    lines = done.stderr.strip().splitlines()
    return done.stdout, lines[-1] if lines else f"exit code {done.returncode}"


if __name__ == "__main__":
    sys.exit(main())
