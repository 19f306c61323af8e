"""`kill -9` while a study is being written, at random moments: `python -m tests.study.killed 100 SEED`."""

from __future__ import annotations

import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from rehab_opt.study.store import Study
from tests.study.made_studies import checked_sum


def kills(file: Path, count: int, seed: int) -> tuple[int, int]:
    """Kill a writer `count` times; trials that it said were finished, and trials that are there, all whole."""
    rng = random.Random(seed)
    said = 0
    for _ in range(count):
        command = [sys.executable, "-m", "tests.study.made_studies", str(file), "P", "1000000"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as writer:
            assert writer.stdout is not None
            if rng.random() < 0.8:  # else while it opens the file
                writer.stdout.readline()
            time.sleep(rng.uniform(0.0, 0.25))
            writer.kill()
            said = max([said, *map(int, writer.stdout.read().split())])
        if file.exists():
            there = checked_sum(file)
            with Study(file) as study:
                assert study.rows("SELECT count(*) FROM trials") == [(there,)]
                assert study.bad() == []
            assert there >= said, f"{said} trials were finished, {there} are there"
            said = there
    return said, there


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        said, there = kills(Path(folder) / "study", int(sys.argv[1]), int(sys.argv[2]))
    print(f"{sys.argv[1]} kills: 0 studies unreadable, {there} trials whole, 0 finished ones lost")
