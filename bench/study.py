"""How long a large study takes: `python -m bench.study [PEOPLE SESSIONS TRIALS [FILE]]`; 1000 20 10 by default.

Asked: `rehab-opt study show` in 1 s, a report of everybody in 10 s, as whole processes. Beside the time on the wall is
that of the processor, which a busy machine does not stretch as much. A FILE that is there is taken as such a study.
"""

from __future__ import annotations

import datetime
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from rehab_opt.study.store import Study
from rehab_opt.study.trial import Session
from tests.study.made_studies import made_trial


def made_study(file: Path, people: int, sessions: int, trials: int) -> None:
    """Write a study of so many; a commit a session, since the time of a commit is not what is measured."""
    rng = np.random.default_rng(20261123)
    begin = datetime.date(2026, 1, 5)
    with Study(file) as study:
        for person in range(people):
            group = ("stroke", "control")[person % 2]
            for number in range(sessions):
                date = (begin + datetime.timedelta(days=7 * number + int(rng.integers(3)))).isoformat()
                session = Session(f"P{person:04}", f"week {number + 1}", group=group, visit=number + 1, date=date)
                better = number / sessions * rng.uniform(0.5, 1.0)
                conditions = ("assisted", "unassisted")
                study.add(session, [made_trial(rng, better=better, condition=conditions[i % 2]) for i in range(trials)])


def main() -> None:
    """Make the study, time the commands, print a table."""
    people, sessions, trials = map(int, sys.argv[1:4] or (1000, 20, 10))
    with tempfile.TemporaryDirectory() as folder:
        file = Path(sys.argv[4]) if len(sys.argv) > 4 else Path(folder) / "study.db"
        began = time.perf_counter()
        if not file.exists():
            made_study(file, people, sessions, trials)
        size = file.stat().st_size / 1e6
        took = time.perf_counter() - began
        print(f"{people} people x {sessions} sessions x {trials} trials: {size:.0f} MB, {took:.0f} s")
        commands = {
            "show": (["study", "show"], 1.0),
            "show --person": (["study", "show", "--person", "P0000"], 1.0),
            "list": (["study", "list"], None),
            "compare": (["study", "compare", "--measure", "movement_time"], None),
            "report": (["report", "--out", f"{folder}/all.html"], 10.0),
            "report --person": (["report", "--person", "P0000", "--out", f"{folder}/one.html"], None),
        }
        for name, (words, asked) in commands.items():
            place = 2 if words[0] == "study" else 1
            command = [sys.executable, "-m", "rehab_opt", *words[:place], str(file), *words[place:]]
            taken, computed = [], []
            for _ in range(3):
                began, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
                subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
                taken.append(time.perf_counter() - began)
                after = resource.getrusage(resource.RUSAGE_CHILDREN)
                computed.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
            verdict = "" if asked is None else f" of {asked:g} s: {'PASS' if max(taken) <= asked else 'FAIL'}"
            wall, processor = (f"{min(of):.2f} to {max(of):.2f} s" for of in (taken, computed))
            print(f"| {name} | {wall}{verdict} | {processor} |", flush=True)


if __name__ == "__main__":
    main()
