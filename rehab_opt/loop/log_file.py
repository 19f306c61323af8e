"""Log file of a loop in MCAP format, which Foxglove displays and ROS 2 plays back."""

from __future__ import annotations

import io
import json
import os
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.loop.cdr import record_cdr, record_definition
from rehab_opt.loop.messages import JOINT_STATE, WRENCH, joint_state, wrench

__all__ = ["ABOUT", "TICK", "LogFile", "mcap_module"]

EXTRA = "log"
TICK = "rehab_opt/msg/Tick"
ABOUT = "rehab_opt"
"""Name of the log's metadata record."""
SHOWN_HZ = 100.0
"""Rate [Hz] of the messages of joints and forces for 3-D views; ticks are written at the loop's rate."""
FRAME = "base"


def mcap_module(name: str) -> ModuleType:
    """Import the module `mcap.name`.

    Raises
    ------
    ConfigurationError : mcap is not installed.
    """
    try:
        return import_module(f"mcap.{name}")
    except ImportError as absent:
        expected = f"the package mcap, which is not installed: pip install 'rehab_opt[{EXTRA}]'"
        raise ConfigurationError("log", name, expected) from absent


class LogFile:
    """MCAP file of ROS 2 messages (CDR): ticks, joints and the force on the hand.

    Ticks are `rehab_opt/msg/Tick` messages with exact numbers. Joints are `sensor_msgs/JointState` and forces
    `geometry_msgs/WrenchStamped` messages, for 3-D views. After each `flush` the file is readable. If a write fails, as
    on a full disk, the file keeps its earlier chunks.

    Parameters
    ----------
    path : path of the file, which is overwritten. layout : dtype of the records. names : names of the joints.
    epoch : time [ns] since 1970 at which `time.monotonic` was zero.
    about : metadata. files : contents of the problem's files by name.

    Raises
    ------
    ConfigurationError : mcap is not installed. OSError : the file cannot be written.
    """

    def __init__(
        self,
        path: Path,
        layout: np.dtype[Any],
        *,
        names: Sequence[str],
        epoch: int,
        about: Mapping[str, str],
        files: Mapping[str, bytes],
    ) -> None:
        writer = mcap_module("writer")
        self._names, self._epoch, self._shown = tuple(names), epoch, -1.0
        self._to_cdr = record_cdr(layout)
        self._file = _WholeWrites(path)
        self._writer = writer.Writer(self._file, chunk_size=1 << 30, enable_data_crcs=True)  # `flush` ends a chunk
        self._writer.start(profile="ros2", library=f"rehab_opt {about.get('rehab_opt', '')}")
        told = {**about, "layout": json.dumps(layout.descr), "names": json.dumps(self._names)}
        self._writer.add_metadata(ABOUT, told)
        for name, data in files.items():
            self._writer.add_attachment(
                create_time=0, log_time=0, name=name, media_type="application/octet-stream", data=data
            )
        self._tick = self._channel("/tick", TICK, record_definition(layout))
        self._joints = self._channel("/joint_states", *JOINT_STATE)
        self._force = self._channel("/force", *WRENCH)
        self._file.flush()

    def _channel(self, topic: str, name: str, definition: str) -> int:
        schema = self._writer.register_schema(name, "ros2msg", definition.encode())
        return int(self._writer.register_channel(topic, "cdr", schema))

    def write(self, records: NDArray[np.void]) -> None:
        """Buffer records until the next flush."""
        for record in records:
            clock = float(record["clock"])
            now, add = self._epoch + round(1e9 * clock), self._writer.add_message
            add(self._tick, now, self._to_cdr(record), now, int(record["tick"]) & 0xFFFFFFFF)
            if clock - self._shown >= 1 / SHOWN_HZ:
                self._shown = clock
                told = joint_state(now, self._names, record["position"], record["velocity"])
                add(self._joints, now, told, now)
                add(self._force, now, wrench(now, FRAME, record["force"].tolist()), now)

    def flush(self) -> None:
        """Write the buffered records as one chunk.

        Raises
        ------
        OSError : writing failed; earlier chunks stay in the file.
        """
        self._writer.flush()

    def finish(self) -> None:
        """Write the buffered records and the index, and close the file. Raises as `flush`."""
        self._writer.finish()
        self._file.flush()
        self._file.close()

    def close(self) -> None:
        """Close the file without writing the buffered records."""
        self._file.close()


class _WholeWrites(io.BytesIO):
    """A file in which `flush` writes either all bytes since the last flush or none."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._descriptor, self._written = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644), 0

    def tell(self) -> int:
        return self._written + super().tell()

    def flush(self) -> None:
        if self.closed:
            return
        kept = memoryview(self.getvalue())
        self.seek(0)
        self.truncate()
        done = 0
        try:
            while done < len(kept):
                done += os.write(self._descriptor, kept[done:])
        except OSError:
            os.ftruncate(self._descriptor, self._written)
            os.lseek(self._descriptor, self._written, os.SEEK_SET)
            raise
        self._written += done

    def close(self) -> None:
        if not self.closed:
            os.close(self._descriptor)
        super().close()
