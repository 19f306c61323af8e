"""Every script in `examples` runs as it stands, and says what it shows."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def printed_by(name: str) -> str:
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    script = ROOT / "examples" / name
    done = subprocess.run([sys.executable, script], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def numbers(text: str) -> list[float]:
    return [float(each) for each in re.findall(r"-?\d+(?:\.\d+)?", text)]


def test_every_example_is_claimed_here() -> None:
    claimed = {"follow_pose.py", "help_along_path.py", "own_limit.py"}
    assert {path.name for path in (ROOT / "examples").glob("*.py")} == claimed


def test_a_pose_that_moves_too_fast_is_followed_slowly() -> None:
    delivered, _ = numbers(printed_by("follow_pose.py"))
    assert 0 < delivered < 100


def test_the_elbow_passes_the_table_without_the_limit_and_not_with_it() -> None:
    without, limited = printed_by("own_limit.py").splitlines()
    assert numbers(without)[1] < -10.0
    assert numbers(limited)[1] == pytest.approx(0.0, abs=0.5)  # [mm]


def test_help_stays_within_its_force_limit() -> None:
    *_, largest = numbers(printed_by("help_along_path.py"))
    assert 0 < largest <= 30
