"""Judges heard on a copy of the package with a fault in it: `python -m tests.judge.fault_trial`, in that copy."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple

from tests.judge.verdict import ROOT, hearing

STARTING = 30.0
"""[s] that loading takes at most; the rest of a time limit is for ticks."""
TIMED_OUT = 124
"""What the command `timeout` returns."""
BUILDING = {"<module>", "__init__"}
"""Functions of the package whose failure keeps a controller from being made: nothing could be commanded."""


class Hearing(NamedTuple):
    """One judge, asked for so many ticks with one seed."""

    judge: str
    ticks: int
    seed: int


class Outcome(NamedTuple):
    """What a judge said: broken claims and situations seen too seldom, or how it ended."""

    judge: str
    ticks: int
    seconds: float
    claims: dict[str, str]
    """Claim -> numbers of its first break."""
    ended: str = ""
    """Of a run that raised: what; "too slow" of one that ran out of time."""
    built: bool = True
    """Whether the controller could be made at all."""


@contextmanager
def copied() -> Iterator[Path]:
    """A folder with the package and its judge, to plant faults in."""
    with tempfile.TemporaryDirectory(prefix="fault_") as folder:
        root = Path(folder)
        for name in ("rehab_opt", "tests/judge"):
            shutil.copytree(ROOT / name, root / name, ignore=shutil.ignore_patterns("__pycache__"))
        (root / "tests" / "__init__.py").touch()
        yield root


def heard(root: Path, hearings: Sequence[Hearing], *, seconds: float, seen: Path | None = None) -> Iterator[Outcome]:
    """Outcomes one by one, of a process of its own that works in `root`; it ends when nobody listens any more.

    With `seen`, the functions of the package that each judge calls are written there.
    """
    command = ["timeout", str(int(STARTING + seconds)), sys.executable, "-m", "tests.judge.fault_trial"]
    environment = os.environ | {"REHAB_OPT_COMPILE": "0", "PYTHONPATH": str(root), "PYTHONDONTWRITEBYTECODE": "1"}
    told = 0
    with (
        (root / "errors.txt").open("w") as errors,
        subprocess.Popen(
            [*command, json.dumps(hearings), str(seen or "")],
            cwd=root, env=environment, stdout=subprocess.PIPE, stderr=errors, text=True,
        ) as process,
    ):  # fmt: skip
        try:
            for line in process.stdout or ():
                if line.startswith("{"):
                    told += 1
                    yield Outcome(**json.loads(line))
            if told < len(hearings):
                ended, text = process.wait(), (root / "errors.txt").read_text(encoding="utf-8")
                names = {*re.findall(r'File "[^"]*/rehab_opt/[^"]*", line \d+, in (\S+)', text)}
                last = text.strip().splitlines()[-1] if text.strip() else f"process ended with {ended}"
                words = "too slow" if ended == TIMED_OUT else last[:200]
                yield Outcome(hearings[told].judge, 0, 0.0, {}, words, not BUILDING & names)
        finally:
            process.terminate()


def main() -> None:
    """Hear, and print an outcome a line."""
    seen: dict[str, list[str]] = {}
    for judge, ticks, seed in json.loads(sys.argv[1]):
        called: set[str] = set()

        def note(frame: FrameType, event: str, _: Any, *, called: set[str] = called) -> None:
            if event == "call" and "rehab_opt/" in frame.f_code.co_filename:
                code = frame.f_code
                called.add(f"{code.co_filename[len(str(ROOT)) + 1 :]}:{code.co_qualname.replace('.<locals>', '')}")

        sys.setprofile(note if sys.argv[2] else None)
        verdict = hearing(judge, ticks, seed, None)
        sys.setprofile(None)
        claims = dict.fromkeys(verdict.kinds, "")
        claims |= {each.claim: each.numbers for each in reversed(verdict.broken)}
        claims |= {f"too seldom: {name}": f"{n} of {least} ticks" for name, (n, least) in verdict.missed.items()}
        outcome = Outcome(judge, verdict.ticks, verdict.took, claims)
        seen[judge] = sorted({*seen.get(judge, []), *called})
        print(json.dumps(outcome._asdict()), flush=True)
    if sys.argv[2]:
        Path(sys.argv[2]).write_text(json.dumps(seen), encoding="utf-8")


if __name__ == "__main__":
    main()
