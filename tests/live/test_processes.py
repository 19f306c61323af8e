"""The page's process and the controller's: one hangs, or is killed."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from rehab_opt.loop.logged import read_log
from rehab_opt.loop.of_problem import run_in_time
from rehab_opt.session.files import load_problem

client = pytest.importorskip("websockets.sync.client")

PATIENCE = 120.0
"""[s] that something may take on a busy machine."""


def test_what_was_silent_is_told_again_and_no_process_is_left(tmp_path: Path) -> None:
    pytest.importorskip("mcap")
    log = tmp_path / "killed.mcap"
    command = [sys.executable, "-m", "rehab_opt", "live", "robot/ur5_circle", "--log", str(log)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as page:
        try:
            assert page.stdout is not None
            root, token = page.stdout.readline().split()[-1].split("/?token=")
            with client.connect(f"{root.replace('http', 'ws')}/ws?token={token}", origin=root) as socket:
                told_of(socket, "frame")
                (controller,) = (it for it in children(page.pid) if b"spawn_main" in (it / "cmdline").read_bytes())
                os.kill(int(controller.name), signal.SIGSTOP)
                told_of(socket, "lost")
                os.kill(int(controller.name), signal.SIGCONT)
                assert told_of(socket, "seat") == {"commands": True, "tabs": 1, "participants": 0}
        finally:
            page.kill()
    end = time.monotonic() + PATIENCE
    while (found := stat_of(controller)) and found[0] != "Z":
        assert time.monotonic() < end
        time.sleep(0.05)
    assert read_log(log).records["reason"][-1] == b"the page's process is gone"


@pytest.mark.nightly
def test_a_log_is_shown_at_its_pace_and_commanded_by_nobody(tmp_path: Path) -> None:
    pytest.importorskip("mcap")
    log = tmp_path / "trace.mcap"
    run_in_time(load_problem("robot/ur5_circle"), seconds=0.5, log=log)
    logged = read_log(log).records
    command = [sys.executable, "-m", "rehab_opt", "live", "--replay", str(log)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as page:
        try:
            assert page.stdout is not None
            root, token = page.stdout.readline().split()[-1].split("/?token=")
            with client.connect(f"{root.replace('http', 'ws')}/ws?token={token}", origin=root) as socket:
                scene = told_of(socket, "scene")
                assert (scene["logged"], scene["controls"]) == (True, [])  # type: ignore[index]
                assert "log" in scene["title"]  # type: ignore[index]
                socket.send('{"take": true}')
                assert told_of(socket, "seat")["commands"] is False  # type: ignore[index]
                socket.send(json.dumps({"inputs": {"enable": True}, "clock": time.monotonic()}))
                message = told_of(socket, "frame", whole=True)
                assert message["time"] in logged["time"]  # type: ignore[index]
                assert message["words"]["status"].encode() in logged["status"]  # type: ignore[index]
                joints = np.array(message["frame"]["joints"])  # type: ignore[index]
                assert np.abs(logged["true_position"] - joints).max(axis=1).min() < 1e-3
        finally:
            page.kill()


def children(process: int) -> list[Path]:
    return [it for it in Path("/proc").glob("[0-9]*") if stat_of(it)[1:2] == [str(process)]]


def stat_of(process: Path) -> list[str]:
    """State, parent and more; nothing of a process that has ended meanwhile."""
    try:
        return (process / "stat").read_text(encoding="utf-8").rpartition(") ")[2].split()
    except (FileNotFoundError, ProcessLookupError):
        return []


def told_of(socket: object, name: str, *, whole: bool = False) -> object:
    """What the page is told next under this name."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        message = json.loads(socket.recv(timeout=PATIENCE))  # type: ignore[attr-defined]
        if name in message:
            return message if whole else message[name]
    return pytest.fail(f"nothing was told of {name!r}")
