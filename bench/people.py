"""What many people cost: `python -m bench.people set` and `python -m bench.people memory`.

`set`: processor time of all that a person's arm is asked for, beside 5 s: the slices of the regular and of the
restricted range at 1 mm, the volume of the regular one, and the safe maps both ways. People as in
`bench.workspace_maps`; the first one, with whom functions are made and loaded, is not counted. In one thread of BLAS,
as in workers of `many`.

`memory`: RAM of `run_many` and of its workers while 10 000 people are handed out and written, with 60 numbers and
0.1 MB of files each; what a worker computes is left out.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy is loaded

import argparse
import itertools
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from rich.console import Console

from bench.machine import machine, resident_megabytes
from bench.verdict import Reported, Verdict
from bench.workspace_maps import arms_of
from rehab_opt.errors import ConfigurationError
from rehab_opt.session.many.participant import Participant, PersonResult
from rehab_opt.session.many.run import run_many
from rehab_opt.workspace.mapping import WorkspaceMap
from rehab_opt.workspace.reach import planar_workspace
from rehab_opt.workspace.volume import reachable_volume

PARTS = ("slices", "volume", "maps")


def main() -> int:
    options = argparse.ArgumentParser(prog="python -m bench.people", description=__doc__)
    options.add_argument("part", choices=("set", "memory"))
    options.add_argument("--people", type=int)
    options.add_argument("--seed", type=int, default=20261124)
    asked = options.parse_args()
    console = Console(width=150)
    console.print("  ".join(f"{key}: {value}" for key, value in machine().items()), highlight=False)
    said = list(whole_sets(asked.people or 5, asked.seed) if asked.part == "set" else memory(asked.people or 10_000))
    for each in said:
        console.print(str(each), highlight=False, soft_wrap=True)
    return 0 if all(each.met for each in said if isinstance(each, Verdict)) else 1


def whole_sets(count: int, seed: int) -> Iterator[Verdict | Reported]:
    """Of so many people who have all of it."""
    taken: list[list[float]] = []
    number = -1
    while len(taken) <= count:
        number += 1
        regular, restricted = arms_of(seed, number)
        at = [time.process_time()]
        wide, narrow = planar_workspace(regular), planar_workspace(restricted)
        at.append(time.process_time())
        reachable_volume(regular)
        at.append(time.process_time())
        try:
            proven = [WorkspaceMap.between(*pair).certificate.valid for pair in ((wide, narrow), (narrow, wide))]
        except ConfigurationError:  # holes, several parts, or nothing: no map of it exists
            continue
        at.append(time.process_time())
        taken.append([after - before for before, after in itertools.pairwise(at)])
        seconds = ", ".join(f"{name} {of:.2f} s" for name, of in zip(PARTS, taken[-1], strict=True))
        print(f"person {number}: {seconds}, {sum(proven)} of 2 maps proven", flush=True)
    for name, of in zip(PARTS, zip(*taken[1:], strict=True), strict=True):
        yield Reported(f"{name}, median of {count} people, s", statistics.median(of))
    yield Verdict(f"whole set, median of {count} people", statistics.median(map(sum, taken[1:])), "<=", 5.0, "s")


def stand_in(person: Participant) -> PersonResult:
    """A result of a size that a run has."""
    numbers = {f"sets.regular.number_{i}_m": float(person.name[1:]) + i for i in range(60)}
    return PersonResult({"metrics.json": b"{}", "figure.png": os.urandom(100_000)}, numbers, 0.001)


def memory(count: int) -> Iterator[Verdict | Reported]:
    """Of this process and of two workers, after a tenth of the people and at the end."""
    seen: list[tuple[int, float, float]] = []

    def progress(_: str, done: int, whole: int) -> None:
        if done and done % (whole // 10) == 0:
            seen.append((done, resident_megabytes(), max(map(_megabytes, _children()))))
            print(f"{done} people: {seen[-1][1]:.0f} MB, a worker {seen[-1][2]:.0f} MB", flush=True)

    content = {"system": "workspace", "title": "-", "arm": {"side": "left", "range_of_motion": "regular"}}
    people = [Participant(f"P{i}", content, f"P{i}.toml", Path(f"P{i}.toml")) for i in range(count)]
    with tempfile.TemporaryDirectory() as folder:
        run_many(people, out=Path(folder), workers=2, work=stand_in, progress=progress, timeout_s=3600.0)
    (early, own, worker), (last, own_at_last, worker_at_last) = seen[0], seen[-1]
    yield Reported(
        "kB that each person more takes, their row of 60 numbers", 1e3 * (own_at_last - own) / (last - early)
    )
    yield Verdict("memory of a worker at the end / after a tenth of the people", worker_at_last / worker, "<=", 1.05)


def _children() -> list[int]:
    return [int(word) for word in Path(f"/proc/self/task/{os.getpid()}/children").read_text(encoding="ascii").split()]


def _megabytes(process: int) -> float:
    try:
        pages = Path(f"/proc/{process}/statm").read_text(encoding="ascii").split()[1]
    except (OSError, IndexError):
        return 0.0
    return int(pages) * os.sysconf("SC_PAGE_SIZE") / 1e6


if __name__ == "__main__":
    sys.exit(main())
