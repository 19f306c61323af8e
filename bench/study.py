"""How long a large study takes: `python -m bench.study [PEOPLE SESSIONS TRIALS [FOLDER]]`; 1000 20 10 by default.

Expected: `rehab-opt study show` in 1 s, a report of everybody in 10 s, as whole processes. The folders are made by
`tests.study.made_studies` with traces of 1 kB; the first command that opens them makes the index. Beside the time on
the wall is that of the processor, which a busy machine does not stretch as much. A FOLDER that is there is taken.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tests.study.made_studies import made_folders


def main() -> None:
    """Make the study, time the commands, print a table."""
    people, sessions, trials = map(int, sys.argv[1:4] or (1000, 20, 10))
    with tempfile.TemporaryDirectory() as folder:
        root = Path(sys.argv[4]) if len(sys.argv) > 4 else Path(folder) / "study"
        began = time.perf_counter()
        if not root.exists():
            made_folders(root, people, sessions, trials)
        print(
            f"{people} people x {sessions} sessions x {trials} trials: {time.perf_counter() - began:.0f} s", flush=True
        )
        commands = {
            "the index anew": (["study", "show"], None),
            "show": (["study", "show"], 1.0),
            "show --person": (["study", "show", "--person", "P0000"], 1.0),
            "list": (["study", "list"], None),
            "compare": (["study", "compare", "--measure", "movement_time"], None),
            "report": (["report", "--out", f"{folder}/all.html"], 10.0),
            "report --person": (["report", "--person", "P0000", "--out", f"{folder}/one.html"], None),
        }
        (root / "index.db").unlink(missing_ok=True)
        for name, (words, most) in commands.items():
            place = 2 if words[0] == "study" else 1
            command = [sys.executable, "-m", "rehab_opt", *words[:place], str(root), *words[place:]]
            taken, computed = [], []
            for _ in range(1 if name == "the index anew" else 3):
                began, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
                subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
                taken.append(time.perf_counter() - began)
                after = resource.getrusage(resource.RUSAGE_CHILDREN)
                computed.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
            verdict = "" if most is None else f" of {most:g} s: {'PASS' if max(taken) <= most else 'FAIL'}"
            wall, processor = (f"{min(of):.2f} to {max(of):.2f} s" for of in (taken, computed))
            print(f"| {name} | {wall}{verdict} | {processor} |", flush=True)


if __name__ == "__main__":
    main()
