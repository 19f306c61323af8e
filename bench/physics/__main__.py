"""Controllers on robots with mass, servos, delays and noise: `python -m bench.physics --tasks N --seed S [--write]`.

Prints what is measured beside the bound of issue 15, the worst of all tasks at each delay. Exit code 1 where one is
missed. Rows without a bound are for comparison.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from datetime import UTC, datetime
from importlib.metadata import version
from multiprocessing import get_context
from pathlib import Path

from bench.machine import machine
from bench.physics.rows import TASKS, Done, Measured, done, measured
from bench.physics.setting import CELLS

__all__ = ["main", "table"]

RESULTS = Path(__file__).parents[1] / "RESULTS.md"
BEGIN, END, TABLE = "<!-- physics: begin -->", "<!-- physics: end -->", "<!-- physics table: "
HEAD = """\
## Robots with mass, servos, delays and noise

Every number is of the true robot, a simulated UR5 or iiwa 14, under a controller with default settings. Force
controllers get the true delay, 3 ms more or 3 ms less, in turn. Columns are delays, half of the command and half of
the measurement; encoder noise is 0, 0.1 or 0.2 mrad, the rate 500 Hz or 1 kHz. [Real
servos](../docs/capabilities/real_servos.md) says why a hand presses a wall so hard."""
DEAREST_FIRST = ("tracking", "hand", "energy", "need", "help", "limit", "mirror", "push", "blocked", "frozen")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run, print, and say whether every bound holds."""
    parser = argparse.ArgumentParser(prog="python -m bench.physics", description=__doc__)
    parser.add_argument("--tasks", type=int, default=len(CELLS), help="of each kind, spread over the cells in turn")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="+", choices=list(TASKS), default=list(TASKS))
    parser.add_argument("--ideal", action="store_true", help="joints that move as commanded, without delay and noise")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--write", action="store_true", help="put the tables into bench/RESULTS.md")
    options = parser.parse_args(arguments)
    os.environ.setdefault("REHAB_OPT_COMPILE", "0")  # the same answers, and no minute of compiling for each controller
    names = [name for name in DEAREST_FIRST if name in options.only]
    # Every process has tasks of every kind: controllers are built once in each.
    work = [
        (name, range(part, options.tasks, options.processes), options.seed, options.ideal)
        for name in names
        for part in range(min(options.processes, options.tasks))
    ]
    found: dict[str, list[Done]] = {name: [] for name in names}
    if options.processes == 1:
        for each in work:
            found[each[0]] += done(*each)
    else:
        with ProcessPoolExecutor(options.processes, mp_context=get_context("spawn")) as pool:
            for each, of in zip(work, pool.map(done, *zip(*work, strict=True)), strict=True):
                found[each[0]] += of
    rows = {name: measured({name: found[name]}) for name in names}
    tables = {name: [*_head(options, name), *table(each)] for name, each in rows.items()}
    print("  ".join(f"{key}: {value}" for key, value in machine().items()))
    print("\n".join(line for lines in tables.values() for line in lines))
    if options.write:
        _write(tables)
    return int(any(row.verdict == "FAIL" for each in rows.values() for row in each))


def table(rows: Sequence[Measured]) -> list[str]:
    """The rows as Markdown, a column for each delay."""
    delays = sorted({delay for row in rows for delay in row.by_delay})
    heads = [f"{1e3 * delay:g} ms" for delay in delays]
    lines = [
        f"| what | bound | {' | '.join(heads)} | all | tasks | |",
        f"|---|---|{'---|' * len(delays)}---|---|---|",
    ]
    for each in rows:
        row = each.row
        numbers = [_number(each.by_delay.get(delay, math.nan)) for delay in delays]
        cells = [row.what, _bound(row.at_least, row.at_most, row.unit), *numbers, _number(each.total)]
        lines.append(f"| {' | '.join(cells)} | {each.tasks} | {each.verdict} |")
    return lines


def _bound(low: float, high: float, unit: str) -> str:
    if high == math.inf:
        return (f">= {low:g} {unit}" if low > -math.inf else f"- {unit}").rstrip()
    return (f"{low:g} to {high:g} {unit}" if low > -math.inf else f"<= {high:g} {unit}").rstrip()


def _number(value: float) -> str:
    if math.isnan(value):
        return "-"
    return "never" if value == math.inf else "none" if value == -math.inf else f"{value:.3g}"


def _head(options: argparse.Namespace, name: str) -> list[str]:
    """The command that gives a table again, where and when it was run."""
    told = " --ideal" if options.ideal else ""
    command = f"python -m bench.physics --only {name} --tasks {options.tasks} --seed {options.seed}{told}"
    return [f"`{command}`, {datetime.now(UTC):%Y-%m-%d}; MuJoCo {version('mujoco')}.", ""]


def _write(tables: Mapping[str, Sequence[str]]) -> None:
    """Put these tables in place of those of the same names; the others stay as they are."""
    text = RESULTS.read_text(encoding="utf-8") if RESULTS.exists() else "# Results\n"
    if BEGIN not in text:
        text = f"{text.rstrip()}\n\n{BEGIN}\n{END}\n"
    before, _, rest = text.partition(BEGIN)
    old, _, after = rest.partition(END)
    all_of_them = {part.partition(" -->")[0]: part.partition("-->")[2].strip() for part in old.split(TABLE)[1:]}
    all_of_them |= {name: "\n".join(lines) for name, lines in tables.items()}
    parts = [HEAD, *(f"{TABLE}{name} -->\n{all_of_them[name]}" for name in TASKS if name in all_of_them)]
    RESULTS.write_text(f"{before}{BEGIN}\n" + "\n\n".join(parts) + f"\n{END}{after}", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
