"""Proof that the judge can see: `python -m tests.judge.faults --seed S --write`.

Faults are drawn by a seed from all that `fault_operators` can do to `control/` and `optim/`, evenly over the modules,
and planted in a copy of the package, one at a time. Each must be found by the slice of a judge that CI runs, or by the
campaign of `--ticks`: by a claim that breaks, a situation that is seen too seldom, or an error where there was none.
Whatever is so without the fault does not count. Faults with which no controller can be made are listed, and others
drawn in their place; those of `equivalent_faults.toml` are listed with the reason why no promise can tell them.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import random
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, as_completed, wait
from contextlib import contextmanager
from functools import cache, partial
from pathlib import Path
from typing import NamedTuple

from tests.judge.__main__ import head, parts, write
from tests.judge.fault_operators import OPERATORS, Fault, faults
from tests.judge.fault_trial import Hearing, Outcome, copied, heard
from tests.judge.numbering import FIXED_SEED
from tests.judge.verdict import ROOT, judges

MARKERS = "<!-- faults: begin -->", "<!-- faults: end -->"
EQUIVALENT = Path(__file__).with_name("equivalent_faults.toml")
FOLDERS = ("rehab_opt/control", "rehab_opt/optim")
TOLD = {"found", "not found"}
"""Verdicts of faults that a promise can tell."""
SLOWER = 10.0
"""Times as long as without a fault is too slow: a build's time limit sees it."""
FIRST_PART = 8
"""A campaign is heard up to this part of its ticks first: most faults are found there."""


class Found(NamedTuple):
    """A fault, and what was said of it."""

    fault: Fault
    verdict: str
    """"found", "not found", "equivalent" or "no controller"."""
    words: str


class Sound(NamedTuple):
    """What the judges say of the package as it is."""

    slices: dict[Hearing, Outcome]
    """Quickest first."""
    called: dict[str, set[str]]
    """Judge -> functions that its slices call, as `file:name`."""


def drawn(seed: int) -> Iterator[Fault]:
    """Each module in turn; of it each operator in turn, and of that a place.

    The order comes from what a fault is, not from where it stands: whoever changes a line changes no other draw.
    """
    paths = [path for folder in FOLDERS for path in (ROOT / folder).glob("*.py")]
    names = sorted((str(path.relative_to(ROOT)) for path in paths), key=partial(rank, seed))
    yield from in_turn([_of_module(seed, name) for name in names])


def _of_module(seed: int, name: str) -> Iterator[Fault]:
    """All faults of one module."""
    alike = Counter[tuple[str, ...]]()
    ranks = {}
    for fault in faults(name, (ROOT / name).read_bytes()):
        alike[fault.key] += 1
        ranks[fault] = rank(seed, *fault.key, alike[fault.key])
    each = sorted(ranks, key=lambda fault: ranks[fault])
    operators = sorted(OPERATORS, key=lambda operator: rank(seed, name, operator))
    return in_turn([iter([fault for fault in each if fault.operator == operator]) for operator in operators])


def in_turn(rows: list[Iterator[Fault]]) -> Iterator[Fault]:
    """The first of each row, then the second of each."""
    return (fault for turn in itertools.zip_longest(*rows) for fault in turn if fault)


def rank(*words: object) -> float:
    """A number drawn for these words."""
    return random.Random(repr(words)).random()


@cache
def reasons() -> dict[tuple[str, ...], str]:
    """Key of a fault -> why no promise can tell it."""
    names = ("file", "function", "operator", "before", "after")
    known = tomllib.loads(EQUIVALENT.read_text(encoding="utf-8"))["fault"]
    return {tuple(each[name] for name in names): each["reason"] for each in known}


def slices(seed: int) -> list[Hearing]:
    """What CI hears: each judge twice."""
    return [
        Hearing(name, module.CI_TICKS // 2, each) for name, module in judges().items() for each in (FIXED_SEED, seed)
    ]


def campaign(ticks: int, seed: int) -> dict[str, Hearing]:
    """What `python -m tests.judge --ticks N --seed S` hears, by judge."""
    return {name: Hearing(name, fraction, each) for name, fraction, each in parts(list(judges()), ticks, seed, 1)}


def without_fault(seed: int, processes: int = 1) -> Sound:
    """The slices of the package as it is, and which functions they call.

    Each judge in a process of its own: what a judge before it has made and cached, it would not be seen to call.
    """
    by_judge = {name: list(both) for name, both in itertools.groupby(slices(seed), key=lambda each: each.judge)}

    def asked(name: str) -> tuple[list[Outcome], set[str]]:
        with copied() as root:
            path = root / "called.json"
            told = list(heard(root, by_judge[name], seconds=3000.0, seen=path))
            return told, {*json.loads(path.read_text(encoding="utf-8"))[name]}

    with ThreadPoolExecutor(processes) as pool:
        found = dict(zip(by_judge, pool.map(asked, by_judge), strict=True))
    told = [pair for name, (each, _) in found.items() for pair in zip(by_judge[name], each, strict=True)]
    called = {name: each for name, (_, each) in found.items()}
    return Sound(dict(sorted(told, key=lambda each: each[1].seconds)), called)


def concerned(fault: Fault, called: dict[str, set[str]]) -> list[str]:
    """Judges that call the function with the fault; of one outside of all functions, those that call its module."""
    here = f"{fault.file}:{fault.function}"
    found = [name for name, each in called.items() if here in each]
    return found or [name for name, each in called.items() if any(one.startswith(f"{fault.file}:") for one in each)]


def tried(fault: Fault, sound: Sound) -> Found:
    """The slices of the judges concerned."""
    if not (names := concerned(fault, sound.called)):
        return Found(fault, "not found", "no judge calls it")
    ticks, usual = 0, {each: outcome for each, outcome in sound.slices.items() if each.judge in names}
    limit = SLOWER * sum(each.seconds for each in usual.values())
    with planted(fault) as root:
        for hearing, outcome in zip(usual, heard(root, list(usual), seconds=limit), strict=False):
            if found := said(fault, outcome, usual[hearing], ticks):
                return found
            ticks += outcome.ticks
    return Found(fault, "not found", f"{ticks} ticks of {', '.join(names)}")


def tried_longer(fault: Fault, sound: Sound, whole: dict[str, Hearing]) -> Found:
    """The campaign of the judges concerned, quickest first."""
    if not (names := concerned(fault, sound.called)):
        return Found(fault, "not found", "no judge calls it")
    usual = [outcome for outcome in sound.slices.values() if outcome.judge in names]
    ticks = sum(each.ticks for each in usual)
    pace = {name: max(each.seconds / max(each.ticks, 1) for each in usual if each.judge == name) for name in names}
    with planted(fault) as root:
        for hearing in sorted((whole[name] for name in names), key=lambda each: each.ticks * pace[each.judge]):
            for part in (hearing._replace(ticks=hearing.ticks // FIRST_PART), hearing):  # the same runs, and more
                for outcome in heard(root, [part], seconds=SLOWER * part.ticks * pace[part.judge]):
                    clean = Outcome(part.judge, 0, 0.0, {})
                    if said(fault, outcome, clean, ticks) and (found := said(fault, outcome, of_campaign(part), ticks)):
                        return found
            ticks += hearing.ticks
    return Found(fault, "not found", f"{ticks} ticks of {', '.join(names)}")


@contextmanager
def planted(fault: Fault) -> Iterator[Path]:
    """A copy of the package with the fault in it."""
    with copied() as root:
        path = root / fault.file
        path.write_bytes(fault.planted(path.read_bytes()))
        yield root


@cache
def of_campaign(hearing: Hearing) -> Outcome:
    """What a judge says in the campaign of the package as it is; heard where it says anything with a fault."""
    with copied() as root:
        return next(heard(root, [hearing], seconds=3000.0))


def said(fault: Fault, outcome: Outcome, usual: Outcome, before: int) -> Found | None:
    """What tells the fault in an outcome, if anything does."""
    if outcome.ended:
        return Found(fault, "found" if outcome.built else "no controller", f"{outcome.judge}: {outcome.ended}")
    new = {claim: numbers for claim, numbers in outcome.claims.items() if claim not in usual.claims}
    if not new:
        return None
    claim, numbers = next(iter(new.items()))
    return Found(fault, "found", f"{outcome.judge}: {claim}: {numbers} (tick {before + outcome.ticks} at the latest)")


def proof(sound: Sound, seed: int, count: int, ticks: int, processes: int) -> list[Found]:
    """`count` faults that can be told, found or not, and between them those that cannot, in the order they are drawn.

    All are heard by the slices, then those that these did not find by the campaign. Printed as soon as it is known.
    """
    whole, known, draws = campaign(ticks, seed), reasons(), enumerate(drawn(seed))
    verdicts: dict[int, Found] = {}

    def by_slices(number: int, fault: Fault) -> tuple[int, Found]:
        return number, equivalent(fault, known) or tried(fault, sound)

    def by_campaign(number: int, fault: Fault) -> tuple[int, Found]:
        return number, tried_longer(fault, sound, whole)

    with ThreadPoolExecutor(processes) as pool:
        while (left := count - sum(each.verdict in TOLD for each in verdicts.values())) > 0:
            running, heard_now = set[Future[tuple[int, Found]]](), dict[int, Found]()
            while running or sum(each.verdict in TOLD for each in heard_now.values()) < left:
                # As many at once as may all be needed: no draw is heard behind the last that counts.
                told = sum(each.verdict in TOLD for each in heard_now.values())
                while len(running) < min(processes, left - told):
                    running.add(pool.submit(by_slices, *next(draws)))
                done, running = wait(running, return_when=FIRST_COMPLETED)
                heard_now |= dict(each.result() for each in done)
                for number, found in (each.result() for each in done):
                    print(row(f"draw {number + 1}", found), flush=True)
            verdicts |= heard_now
            missed = [pool.submit(by_campaign, n, each.fault) for n, each in sorted(heard_now.items())
                      if each.verdict == "not found"]  # fmt: skip
            for future in as_completed(missed):
                number, verdicts[number] = future.result()
                print(row(f"draw {number + 1}", verdicts[number]), flush=True)
    return [verdicts[number] for number in sorted(verdicts)]


def equivalent(fault: Fault, known: dict[tuple[str, ...], str]) -> Found | None:
    """A fault that no promise can tell."""
    return Found(fault, "equivalent", known[fault.key]) if fault.key in known else None


def row(number: str, found: Found) -> str:
    """Markdown."""
    fault = found.fault
    cells = (number, f"{fault.file}:{fault.line}", fault.operator, f"`{fault.before}`", f"`{fault.after}`",
             f"{found.verdict.upper()}: {found.words}")  # fmt: skip
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def main() -> int:
    """Draw, plant, hear, list; 0 where every fault was found."""
    parser = argparse.ArgumentParser(prog="python -m tests.judge.faults", description=__doc__)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--faults", type=int, default=30)
    parser.add_argument("--ticks", type=int, default=1_000_000, help="of the campaign of all judges")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--write", action="store_true", help="put the list into bench/RESULTS.md")
    options = parser.parse_args()
    os.environ["REHAB_OPT_COMPILE"] = "0"  # a fault must reach the tick, not a library of before
    rows, counts, sound = [], Counter[str](), without_fault(options.seed, options.processes)
    without = [
        f"Not counted, since so without a fault (seed {hearing.seed}): {hearing.judge}: {', '.join(outcome.claims)}."
        for hearing, outcome in sound.slices.items()
        if outcome.claims
    ]
    print("\n".join(without), flush=True)
    for found in proof(sound, options.seed, options.faults, options.ticks, options.processes):
        counts[found.verdict] += 1
        rows.append(row(str(counts["found"] + counts["not found"]) if found.verdict in TOLD else "", found))
    print("\n".join(rows))
    summary = ", ".join(f"{count} {verdict}" for verdict, count in counts.items())
    print(f"seed {options.seed}: {summary}")
    if options.write:
        asked = f"--seed {options.seed} --faults {options.faults} --ticks {options.ticks}"
        title = "Faults that the judge finds"
        lines = [*head(f"python -m tests.judge.faults {asked}", options.seed, title=title), f"{summary}.", ""]
        lines += [*without, ""]
        lines += ["| | place | fault | before | after | verdict |", "|---|---|---|---|---|---|", *rows]
        write(lines, MARKERS)
    return int(counts["found"] < options.faults)


if __name__ == "__main__":
    sys.exit(main())
