"""Whether each folder's tests see its faults: `python -m tests.mutation --faults 100 --seed S`.

A seed draws faults evenly from all that `operators` can do to `rehab_opt`. Each is planted in a copy of the tree, and
the tests of its folder run, the nearest first, up to the first that fails. A test that also fails without the fault
does not count. Each fault ends as a line of JSON, so that an interrupted run goes on where it stopped.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import queue
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections import Counter
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

from tests.judge.__main__ import head, write
from tests.mutation.nearest import NEAREST, ROOT, folder, test_files
from tests.mutation.operators import Fault, faults

MARKERS = "<!-- faults: begin -->", "<!-- faults: end -->"
EQUIVALENT = Path(__file__).with_name("equivalent.toml")
COPIED = ("rehab_opt", "tests", "problems", "bench", "docs", "examples", "pyproject.toml", "README.md", "CHANGELOG.md",
          "CITATION.cff", "CONTRIBUTING.md", "INTENDED_USE.md", "LICENSE")  # fmt: skip
HANGING = 200
"""[s] that one test may take; a fault that makes it longer is found."""
ENDINGS = "PASSED|FAILED|ERROR|SKIPPED|XFAIL|Timeout|Fatal Python"
"""What stands behind a test's name."""
WRONG_CALL, NO_TESTS = 4, 5
"""What pytest returns where it cannot begin, also since a conftest.py cannot be loaded; and where no test is there."""


class Told(NamedTuple):
    """What the tests say of a fault."""

    found: bool
    test: str
    """The first that fails, the file where it is not one test."""
    words: str
    seconds: float


def drawn(seed: int, only: Iterable[str] = ()) -> list[Fault]:
    """All faults of the library, or of some of its folders, in the order that a seed draws them.

    The order comes from what a fault is, not from where it stands: a changed line changes no other draw.
    """
    alike, ranks = Counter[tuple[str, ...]](), {}
    for path in sorted((ROOT / "rehab_opt").rglob("*.py")):
        file = str(path.relative_to(ROOT))
        if not only or folder(file) in only:
            for fault in faults(file, path.read_bytes()):
                alike[fault.key] += 1
                ranks[fault] = random.Random(repr((seed, *fault.key, alike[fault.key]))).random()
    return sorted(ranks, key=lambda fault: ranks[fault])


def reasons() -> dict[tuple[str, ...], str]:
    """Key of a fault that changes no number -> why, and what shows it on 10^4 inputs."""
    known = tomllib.loads(EQUIVALENT.read_text(encoding="utf-8")).get("fault", [])
    return {tuple(each[name] for name in ("file", "function", "operator", "before", "after")): each["reason"]
            for each in known}  # fmt: skip


def copy_tree(root: Path) -> None:
    """Put what tests need into a folder, to plant faults there."""
    for name in COPIED:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, root / name, ignore=shutil.ignore_patterns("__pycache__", "out"))
        elif (ROOT / name).exists():
            shutil.copy2(ROOT / name, root / name)


def run(root: Path, tests: Sequence[str], options: Iterable[str], seconds: float = math.inf) -> tuple[int, str]:
    """What pytest returns and writes, run in `root`. TimeoutError after so many seconds."""
    shutil.rmtree(root / ".hypothesis", ignore_errors=True)  # no example of another fault
    command = [sys.executable, "-m", "pytest", "-v", "--tb=no", "-rfE", "-p", "no:cacheprovider",
               "-o", f"faulthandler_timeout={HANGING}", "-o", "faulthandler_exit_on_timeout=true"]  # fmt: skip
    with (root / "log.txt").open("w+", encoding="utf-8", errors="replace") as output:
        process = subprocess.Popen([*command, *options, *tests], cwd=root, stdout=output, stderr=subprocess.STDOUT,
                                   # Bytecode of another fault of this second and size would be taken for this one's.
                                   env=os.environ | {"PYTHONPATH": str(root), "COLUMNS": "300",
                                                     "PYTHONDONTWRITEBYTECODE": "1"},
                                   start_new_session=True)  # fmt: skip
        try:
            ended = process.wait(None if seconds == math.inf else seconds)
        except subprocess.TimeoutExpired:
            raise TimeoutError(f"{tests} take more than {seconds:.0f} s") from None
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
        output.seek(0)
        return ended, output.read()


def tried(root: Path, fault: Fault, skipped: Iterable[str], seconds: float) -> Told:
    """The tests of the fault's folder, without those skipped, in a copy of the tree with the fault in it."""
    path, begin, files = root / fault.file, time.monotonic(), test_files(root, fault.file)
    source, stamp = path.read_bytes(), path.stat().st_mtime
    options = ["-x", *(f"--deselect={each}" for each in skipped)]
    try:
        path.write_bytes(fault.planted(source))
        os.utime(path, (stamp + 10, stamp + 10))  # so that no bytecode of one is taken for the other's
        for part in (files[:NEAREST], files[NEAREST:]):
            if not part:
                continue
            ended, text = run(root, part, options, begin + seconds - time.monotonic())
            if ended == WRONG_CALL and "conftest" not in text:
                raise RuntimeError(text[-2000:])
            if ended not in {0, NO_TESTS}:
                begun = re.findall(rf"^(tests/\S+?\.py::.*?)(?: (?:{ENDINGS}).*)?$", text, re.MULTILINE)
                said = re.findall(r"^(?:FAILED|ERROR) .*? - (.*)$", text, re.MULTILINE)
                words = said[-1][:200] if said else f"pytest ends with {ended}"
                return Told(True, begun[-1].strip() if begun else part[0], words, time.monotonic() - begin)
    except TimeoutError:
        return Told(False, "", f"stopped after {seconds:.0f} s", time.monotonic() - begin)
    finally:
        path.write_bytes(source)
        os.utime(path, (stamp, stamp))
    return Told(False, "", f"{len(files)} files pass", time.monotonic() - begin)


def failing(root: Path, tests: set[str]) -> set[str]:
    """Those of these tests, or files of tests, that do not pass without a fault."""
    ended, text = run(root, sorted(tests), ())
    if ended not in {0, 1, NO_TESTS}:
        raise RuntimeError(f"without a fault pytest ends with {ended}:\n{text[-2000:]}")
    passed = re.findall(r"^(tests/\S+?\.py::.*?) PASSED", text, re.MULTILINE)
    return {each for each in tests if each not in passed and each not in {name.partition("::")[0] for name in passed}}


def campaign(chosen: Sequence[Fault], record: Path, seconds: float, processes: int, again: bool) -> dict[Fault, Told]:
    """What the tests say of each fault; what the record has is not asked again, unless `again` and it was not found.

    What found a fault then runs once without any; where it fails, too, the rest of the folder is asked.
    """
    record.parent.mkdir(parents=True, exist_ok=True)
    known, passing = {}, set[str]()
    for line in record.read_text(encoding="utf-8").splitlines() if record.exists() else ():
        each = json.loads(line)
        passing |= {*each.get("pass_without_fault", ())}
        if "key" in each:
            known[tuple(each["key"])] = Told(*(each[name] for name in Told._fields))
    told = {fault: known[fault.key] for fault in chosen if fault.key in known}
    left = [fault for fault in chosen if fault not in told or (again and not told[fault].found)]
    skipped = set[str]()
    with ExitStack() as stack:
        free: queue.Queue[Path] = queue.Queue()
        for _ in range(processes):
            root = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="fault_"))).resolve()
            copy_tree(root)
            free.put(root)

        def one(fault: Fault) -> tuple[Fault, Told]:
            root = free.get()
            try:
                return fault, tried(root, fault, skipped, seconds)
            finally:
                free.put(root)

        while True:
            with ThreadPoolExecutor(processes) as pool:
                for fault, each in pool.map(one, left):
                    told[fault] = each
                    with record.open("a", encoding="utf-8") as file:
                        place = {"place": f"{fault.file}:{fault.line}", "key": fault.key}
                        file.write(json.dumps({**each._asdict(), **place}) + "\n")
                    print(f"{'found' if each.found else 'NOT FOUND'} {each.seconds:.0f} s {fault.file}:{fault.line} "
                          f"{fault.operator}: {fault.after}: {each.test} {each.words}", flush=True)  # fmt: skip
            asked = {each.test for each in told.values() if each.found} - passing
            broken = failing(root, asked) if asked else set()
            print(f"Fail without a fault: {', '.join(sorted(broken)) or 'none'}", flush=True)
            passing, skipped = passing | asked - broken, skipped | broken
            with record.open("a", encoding="utf-8") as file:
                file.write(json.dumps({"pass_without_fault": sorted(asked - broken)}) + "\n")
            left = [fault for fault in chosen if told[fault].test in broken]
            if not left:
                break
    return {fault: told[fault] for fault in chosen}


def row(fault: Fault, words: str) -> str:
    """Markdown."""
    cells = (f"{fault.file}:{fault.line}", fault.operator, f"`{fault.before}`", f"`{fault.after}`", words)
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def table(told: dict[Fault, Told], equivalent: dict[Fault, str]) -> list[str]:
    """Markdown: the count by folder, what was not found, and what is left out since it changes no number."""
    count = sum(each.found for each in told.values())
    folders = []
    for name in sorted({folder(fault.file) for fault in told}):
        here = [each.found for fault, each in told.items() if folder(fault.file) == name]
        folders.append(f"{name or 'single modules'} {sum(here)} of {len(here)}")
    lines = [f"**{count} of {len(told)} found**: {', '.join(folders)}."]
    lines += ["", "Not found, or left out since they change no number:", ""]
    lines += ["| place | fault | before | after | tests |", "|---|---|---|---|---|"]
    lines += [row(fault, each.words) for fault, each in told.items() if not each.found]
    lines += [row(fault, f"equivalent: {reason}") for fault, reason in equivalent.items()]
    return lines


def main() -> int:
    """Draw, plant, test, list; 0 where nine of ten faults are found."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutation", description=__doc__)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--faults", type=int, default=100)
    parser.add_argument("--only", nargs="+", default=[], metavar="FOLDER", help="of rehab_opt")
    parser.add_argument("--seconds", type=float, default=7200.0, help="for one fault, then it is not found")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--record", type=Path, help="default: out/mutation/SEED.jsonl")
    parser.add_argument("--again", action="store_true", help="run the tests again for faults that were not found")
    parser.add_argument("--write", action="store_true", help="put the table into bench/RESULTS.md")
    options = parser.parse_args()
    known, chosen, equivalent = reasons(), list[Fault](), dict[Fault, str]()
    for fault in drawn(options.seed, options.only):
        if len(chosen) == options.faults:
            break
        if fault.key in known:
            equivalent[fault] = known[fault.key]
        else:
            chosen.append(fault)
    record = options.record or ROOT / "out" / "mutation" / f"{options.seed}.jsonl"
    told = campaign(chosen, record, options.seconds, options.processes, options.again)
    lines = table(told, equivalent)
    print("\n".join(lines))
    if options.write:
        only = f" --only {' '.join(options.only)}" if options.only else ""
        command = f"python -m tests.mutation --faults {options.faults} --seed {options.seed}{only}"
        write([*head(command, options.seed, title="Faults that the tests find"), *lines], MARKERS)
    return int(10 * sum(each.found for each in told.values()) < 9 * len(told))


if __name__ == "__main__":
    sys.exit(main())
