"""The documented campaign: `python -m tests.judge --ticks 10000000 --processes 2 --write`.

Ends with 1 where a claim broke or a situation was seen too seldom.
"""

from __future__ import annotations

import argparse
import os
import platform
import secrets
import sys
from concurrent.futures import ProcessPoolExecutor
from datetime import UTC, datetime
from multiprocessing import get_context

import casadi
import numpy as np
import scipy

from tests.judge.verdict import ROOT, Verdict, hearing, judges

RESULTS = ROOT / "bench" / "RESULTS.md"
SPREAD = 1_000_003
"""Between the seeds of two parts of one campaign."""


def parts(names: list[str], ticks: int, seed: int, pieces: int) -> list[tuple[str, int, int]]:
    """Promise, ticks and seed of each piece of work; the promises share the ticks by their `SHARE`."""
    fractions = {name: float(getattr(module, "SHARE", 1.0)) for name, module in judges(names).items()}
    total = sum(fractions.values())
    return [
        (name, round(ticks * fraction / total / pieces), seed + SPREAD * piece)
        for name, fraction in fractions.items()
        for piece in range(pieces)
    ]


def summary(verdicts: dict[str, Verdict]) -> list[str]:
    """Markdown: each promise's ticks and broken claims."""
    lines = ["| judge | runs | ticks | seconds | broken claims |", "|---|---|---|---|---|"]
    for name, each in verdicts.items():
        kinds = "; ".join(f"{claim} {count}" for claim, count in each.kinds.items())
        lines.append(f"| {name} | {each.runs} | {each.ticks} | {each.took:.0f} | {kinds or 0} |")
    return lines


def briefly(verdicts: dict[str, Verdict]) -> list[str]:
    """Markdown: the judges with broken claims, then the ticks of the others."""
    broken = {name: each for name, each in verdicts.items() if each.kinds}
    clean = ", ".join(f"`{name}` {each.ticks}" for name, each in verdicts.items() if name not in broken)
    return [*(summary(broken) if broken else ()), "", f"No broken claim, with the ticks of each: {clean or 'none'}."]


def details(verdicts: dict[str, Verdict]) -> list[str]:
    """Markdown: the worst of each bound, and the situations."""
    lines = ["", "| judge | claim | largest seen | bound |", "|---|---|---|---|"]
    for name, each in verdicts.items():
        lines += [f"| {name} | {claim} | {value:.6g} | {bound:.6g} |" for claim, (value, bound) in each.worst.items()]
    lines += ["", "| judge | situation | ticks | seconds | longest [s] | least ticks |", "|---|---|---|---|---|---|"]
    for name, each in verdicts.items():
        asked = each.asked
        for key in sorted({*each.seen, *asked}):
            seen = each.seen.get(key)
            counts = f"{seen.ticks} | {seen.seconds:.1f} | {seen.longest:.2f}" if seen else "0 | 0 | 0"
            lines.append(f"| {name} | {key} | {counts} | {asked.get(key, '')} |")
    return lines


def write(lines: list[str], markers: tuple[str, str]) -> None:
    """Put the lines between these markers of the results' file."""
    begin, end = markers
    text = RESULTS.read_text(encoding="utf-8") if RESULTS.exists() else f"# Results\n\n{begin}\n{end}\n"
    if begin not in text:
        text = f"{text.rstrip()}\n\n{begin}\n{end}\n"
    before, _, rest = text.partition(begin)
    RESULTS.write_text(before + "\n".join([begin, *lines, ""]) + end + rest.partition(end)[2], encoding="utf-8")


def head(command: str, seed: int, *, title: str = "The judge") -> list[str]:
    """When, where and how the numbers were made."""
    versions = f"Python {platform.python_version()}, numpy {np.__version__}, scipy {scipy.__version__}"
    return [
        f"## {title}",
        "",
        f"{datetime.now(UTC):%Y-%m-%d}, {os.cpu_count()} cores, {platform.machine()}, {platform.system()}; {versions}, "
        f"CasADi {casadi.__version__}; REHAB_OPT_COMPILE={os.environ.get('REHAB_OPT_COMPILE', '1')}; seed {seed}.",
        "",
        f"    {command}",
        "",
    ]


def main() -> int:
    """Run, print, and say whether everything held and was seen."""
    parser = argparse.ArgumentParser(prog="python -m tests.judge", description=__doc__)
    parser.add_argument("--ticks", type=int, default=1_000_000, help="of all promises together")
    parser.add_argument("--seed", type=int, help="default: another one each time")
    parser.add_argument("--only", nargs="+", metavar="NAME")
    parser.add_argument("--run", type=int, help="only this run of the seed")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--write", action="store_true", help="put the first table into bench/RESULTS.md")
    options = parser.parse_args()
    seed = secrets.randbelow(2**31) if options.seed is None else options.seed
    print(f"seed {seed}", flush=True)
    names = list(judges(options.only))
    verdicts: dict[str, Verdict] = {}
    with ProcessPoolExecutor(options.processes, mp_context=get_context("spawn")) as pool:
        work = parts(names, options.ticks, seed, options.processes)
        for verdict in pool.map(hearing, *zip(*work, strict=True), [options.run] * len(work)):
            for claim, numbers, again in verdict.broken:
                print(f"BROKEN {verdict.name}: {claim}: {numbers}\n    {again}", flush=True)
            print(f"{verdict.name}: {verdict.ticks} ticks in {verdict.took:.0f} s", file=sys.stderr, flush=True)
            if verdict.name in verdicts:
                verdicts[verdict.name].add(verdict)
            else:
                verdicts[verdict.name] = verdict
    print("\n".join([*summary(verdicts), *details(verdicts)]))
    failed = False
    for name, verdict in verdicts.items():
        failed |= bool(verdict.kinds)
        if options.run is None:
            for situation, (count, asked) in verdict.missed.items():
                failed = True
                print(f"TOO SELDOM {name}: {situation}: {count} ticks, at least {asked} asked")
    total = sum(verdict.ticks for verdict in verdicts.values())
    broken = sum(sum(verdict.kinds.values()) for verdict in verdicts.values())
    print(f"{total} ticks, {broken} broken claims, seed {seed}")
    if options.write:
        only = f" --only {' '.join(options.only)}" if options.only else ""
        command = f"python -m tests.judge --ticks {options.ticks} --seed {seed} --processes {options.processes}{only}"
        names = " ".join(options.only or ())
        title, which = (f"The judge: {names}", f"judge {names}") if names else ("The judge", "judge")
        markers = f"<!-- {which}: begin -->", f"<!-- {which}: end -->"
        said = f"{total} ticks, {broken} broken claims."
        write([*head(command, seed, title=title), said, "", *briefly(verdicts)], markers)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
