"""The process that writes a log: `python -m rehab_opt.loop.log_process`.

The first line of standard input has the settings. The input closes when logging or the loop's process ends.
"""

from __future__ import annotations

import base64
import json
import select
import sys
import time
from pathlib import Path
from typing import Any

from rehab_opt.errors import RehabOptError
from rehab_opt.loop.log_file import LogFile
from rehab_opt.loop.shared_ring import SharedRing

__all__ = ["EVERY", "log_records", "main"]

EVERY = 0.1
"""Time [s] between two chunks of the file; if the process is killed, at most this time is lost."""
LOOKS = 0.02
"""Time [s] between two reads of the ring."""


def main() -> None:
    """Write the log until standard input closes."""
    orders = json.loads(sys.stdin.buffer.readline())
    progress = SharedRing.attach(orders["progress"])
    try:
        log_records(orders, progress)
    except RehabOptError as refused:
        progress.write(failure=str(refused))
    except OSError as refused:
        progress.write(failure=f"{orders['path']}: {refused.strerror}")


def log_records(orders: dict[str, Any], progress: SharedRing) -> None:
    """Write the ring's records to the file until standard input closes. Raises OSError if writing fails."""
    ring = SharedRing.attach(orders["ring"], from_start=True)
    files = {name: base64.b64decode(data) for name, data in orders["files"].items()}
    epoch = time.time_ns() - round(1e9 * time.monotonic())
    log = LogFile(
        Path(orders["path"]), ring.layout, names=orders["names"], epoch=epoch, about=orders["about"], files=files
    )
    progress.write(alive=time.monotonic())
    written = lost = 0
    flushed, more = time.monotonic(), True
    try:
        while more:
            more = not select.select([sys.stdin], [], [], LOOKS)[0]
            news = ring.news()
            log.write(news.records)
            written, lost = written + len(news.records), lost + news.lost
            now = time.monotonic()
            if now - flushed >= EVERY:
                log.flush()
                flushed = now
                progress.write(alive=now, written=written, lost=lost)
        log.finish()
        progress.write(alive=time.monotonic(), written=written, lost=lost)
    finally:
        log.close()


if __name__ == "__main__":
    main()
