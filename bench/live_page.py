"""How a loop keeps the time beside its page in a browser, and how soon the page answers: `python -m bench.live_page`.

`rehab-opt live` of a UR5 in MuJoCo at 1 kHz, drawn by Debian's Chromium on the same machine, its dead-man held; as a
usual process and as SCHED_FIFO. The best of `--rounds` by p99.9, out of the session's own log.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console

from bench.machine import empty_loop, machine
from bench.verdict import Verdict, all_met, print_verdicts
from rehab_opt.loop.logged import read_log

__all__ = ["main"]

PROBLEM, CHROMIUM, FIFO = "robot/ur5_circle", "/usr/bin/chromium", 20
OPENED, PATIENCE = 5.0, 120.0
"""[s] that the page may take from the command, that it is waited for."""
OLD = 0.05
"""[s] of a state."""
RELEASE = """() => new Promise((told) => {
  const begun = performance.now(), status = document.getElementById("status");
  dispatchEvent(new KeyboardEvent("keydown", { code: "Escape" }));
  const rests = () => ["braking", "holding"].includes(status.textContent);
  const look = () => rests() ? told(performance.now() - begun) : setTimeout(look, 1);
  look();
})"""


class Session(NamedTuple):
    """One of so many seconds."""

    load: float
    opened: float
    """[s]"""
    frames: float
    """[Hz]"""
    released: float
    """[ms] of the page's time, the median of ten."""
    complaints: list[str]
    p999: float
    """[ms]"""
    worst: float
    """[ms]"""
    missed: int
    sent_stale: int
    held: float
    """Fraction of the ticks in which the dead-man was held."""


def session(browser: Any, seconds: float, *, fifo: int | None) -> Session:
    """Run, look, and read the log."""
    with tempfile.TemporaryDirectory() as folder:
        log, began = Path(folder) / "session.mcap", time.monotonic()
        command = [sys.executable, "-m", "rehab_opt", "live", PROBLEM, "--plant", "mujoco", "--log", str(log)]
        command += [] if fifo is None else ["--fifo", str(fifo)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as live:
            assert live.stdout is not None
            page, complaints = browser.new_page(viewport={"width": 1100, "height": 700}), list[str]()
            page.on("console", lambda said: complaints.append(said.text))
            page.on("pageerror", lambda error: complaints.append(str(error)))
            page.goto(live.stdout.readline().split()[-1])
            until(page, "live.frames > 0")
            opened, load = time.monotonic() - began, os.getloadavg()[0]
            first, since = page.evaluate("live.frames"), time.monotonic()
            while time.monotonic() < since + seconds:
                hold(page)
                page.wait_for_timeout(250)
            frames = (page.evaluate("live.frames") - first) / (time.monotonic() - since)
            released = []
            for _ in range(10):
                hold(page)
                until(page, "document.getElementById('status').textContent === 'ok'")
                released.append(page.evaluate(RELEASE))
            page.close()
            live.terminate()
        ticks = read_log(log).records
    late = 1e3 * ticks["lateness"]
    stale = int(np.count_nonzero((ticks["enabled"] == 1) & ~(ticks["age"] <= OLD)))
    return Session(
        load, opened, frames, float(np.median(released)), complaints, float(np.percentile(late, 99.9)),
        float(late.max()), int(ticks["missed"][-1]), stale, float(ticks["held"].mean()),
    )  # fmt: skip


def hold(page: Any) -> None:
    """Press the dead-man where it is not."""
    if not page.evaluate("live.inputs.enable"):
        page.dispatch_event("#deadman", "click")


def until(page: Any, text: str) -> None:
    """Wait for it; press the dead-man again where a slow machine let it lapse."""
    end = time.monotonic() + PATIENCE
    while not page.evaluate(text):
        if time.monotonic() > end:
            raise TimeoutError(text)
        if "status" in text:
            hold(page)
        page.wait_for_timeout(10)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run, print, judge."""
    from playwright.sync_api import sync_playwright  # noqa: PLC0415

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--rounds", type=int, default=3)
    options, console, verdicts = parser.parse_args(arguments), Console(width=140), list[Verdict]()
    console.print("  ".join(f"{key}: {value}" for key, value in machine().items()), highlight=False)
    with sync_playwright() as tool:
        flags = ["--no-sandbox", "--enable-unsafe-swiftshader"]
        browser = tool.chromium.launch(executable_path=CHROMIUM, args=flags)
        session(browser, 1.0, fifo=None)  # so that the cache is warm
        for name, fifo, p999, worst in (("usual", None, 6.0, None), ("SCHED_FIFO", FIFO, 0.3, 5.0)):
            ran = []
            for _ in range(options.rounds):
                console.print(f"{name}: {empty_loop(fifo)}", highlight=False)
                ran.append(session(browser, options.seconds, fifo=fifo))
                console.print(f"{name}: {ran[-1]}", highlight=False)
            best = min(ran, key=lambda each: each.p999)
            verdicts.append(Verdict(f"{name}: lateness p99.9", best.p999, "<=", p999, "ms"))
            if worst is not None:
                verdicts.append(Verdict(f"{name}: worst lateness", best.worst, "<=", worst, "ms"))
            verdicts += [
                Verdict(f"{name}: commands of a state that was too old", float(best.sent_stale), "<=", 0),
                Verdict(f"{name}: pictures of the page", best.frames, ">=", 20, "Hz"),
                Verdict(f"{name}: from the command to the first picture", best.opened, "<=", OPENED, "s"),
                Verdict(f"{name}: from the release to the page's word of it", best.released, "<=", 100, "ms"),
                Verdict(f"{name}: complaints of the page", float(len(best.complaints)), "<=", 0),
            ]
        browser.close()
    print_verdicts(console, verdicts)
    return 0 if all_met(verdicts) else 1


if __name__ == "__main__":
    raise SystemExit(main())
