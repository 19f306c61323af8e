"""A live problem in a process of its own, as a user starts it."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from typing import NamedTuple

import pytest


class Address(NamedTuple):
    page: str
    participant: str
    port: int
    token: str


@pytest.fixture(scope="module")
def address() -> Iterator[Address]:
    pytest.importorskip("websockets", reason="the live page needs websockets: pip install rehab_opt[live]")
    command = [sys.executable, "-m", "rehab_opt", "live", "robot/ur5_circle"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        page, participant = (process.stdout.readline().split()[-1] for _ in range(2))
        root, token = page.split("/?token=")
        try:
            yield Address(page, participant, int(root.rpartition(":")[2]), token)
        finally:
            process.terminate()
            rest = process.stderr.read()
    assert (process.returncode, rest) == (0, "")
