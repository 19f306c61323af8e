"""Ring buffer of records in shared memory: one process writes, any process reads, and none of them waits."""

from __future__ import annotations

import json
import struct
import sys
import threading
import time
import zlib
from multiprocessing import resource_tracker
from multiprocessing.shared_memory import SharedMemory
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError

__all__ = ["Newest", "News", "SharedRing"]

Array = NDArray[np.float64]

MAGIC = b"rehab-1\0"
_HEADER = struct.Struct("=8sQQQ")  # magic, number of the newest record (0: none yet), depth, length of the layout
_NEWEST = 1  # index of the newest record's number in the header, counted in 8-byte numbers
_SLOT = struct.Struct("=QdQ")  # number of the record, time of writing [s], CRC-32 of both and of the record
_CHECKED = 16  # number of bytes of a slot's head that the CRC covers
_TRIES = 8
_QUIET = threading.Lock()


class Newest(NamedTuple):
    """A record with its number and time."""

    number: int
    """Number of the record, from 1."""
    time: float
    """`time.monotonic` [s] when the record was written."""
    record: np.void
    """Copy of the record; `record["force"]` is the field `force`."""


class News(NamedTuple):
    """Records written since a reader's last call."""

    records: NDArray[np.void]
    """New records (k,), oldest first."""
    lost: int
    """Number of records that were overwritten before the reader read them."""


class SharedRing:
    """The last `depth` records of one writer, for any number of readers in any process.

    The writer writes to the slot after the newest one. A reader copies a slot and accepts the copy only if its number
    and CRC are right. So no process waits, and no reader gets a half-written record, even on processors that reorder
    stores. If the writer is killed while writing, the previous record stays readable.

    Make a ring with `create` and pass its `name` to other processes, which `attach`. The memory is removed when the
    process that created the ring closes it or ends. Use each object in one thread only.
    """

    def __init__(self, memory: SharedMemory, *, owner: bool) -> None:
        """Use `create` or `attach` instead."""
        self._memory, self._owner = memory, owner
        buffer = _bytes_of(memory)
        _, newest, self.depth, length = _HEADER.unpack_from(buffer)
        text = bytes(buffer[_HEADER.size : _HEADER.size + length])
        self.layout = np.dtype(
            [tuple(each) if len(each) < 3 else (*each[:2], tuple(each[2])) for each in json.loads(text)]
        )
        """dtype of the records."""
        self._begin = _in_eights(_HEADER.size + length)
        self._slot = _in_eights(_SLOT.size + self.layout.itemsize)
        self._buffer = buffer
        # A view as native numbers stores 8 bytes at once; `struct` would store byte by byte.
        self._numbers = buffer[: _HEADER.size].cast("Q")
        self._draft = bytearray(self.layout.itemsize)
        self._record = np.frombuffer(self._draft, dtype=self.layout)[0:1].reshape(())
        self._number = self._read = int(newest)
        self._found: Newest | None = None

    @classmethod
    def create(cls, layout: np.dtype[Any], *, depth: int = 4, name: str | None = None) -> Self:
        """Create a ring.

        Parameters
        ----------
        layout : structured dtype of a record, with numbers, arrays and byte strings.
        depth : number of stored records. A viewer needs 4; a log needs its largest lag in records.
        name : name of the ring, unique on this machine; random by default.

        Raises
        ------
        ConfigurationError : the dtype has no names, the depth is below 2, the name is in use, or there is no shared
            memory.
        """
        if layout.names is None or layout.hasobject:
            raise ConfigurationError("layout", layout, "a structured dtype without objects")
        if not (isinstance(depth, int) and 2 <= depth <= 1 << 20):
            raise ConfigurationError("depth", depth, f"a whole number from 2 to {1 << 20}")
        text = json.dumps(layout.descr).encode()
        size = _in_eights(_HEADER.size + len(text)) + depth * _in_eights(_SLOT.size + layout.itemsize)
        try:
            memory = SharedMemory(name, create=True, size=size)
        except OSError as refused:
            expected = f"a name that is not in use, and {size} bytes of shared memory ({refused.strerror})"
            raise ConfigurationError("name", name, expected) from refused
        buffer = _bytes_of(memory)
        _HEADER.pack_into(buffer, 0, MAGIC, 0, depth, len(text))
        buffer[_HEADER.size : _HEADER.size + len(text)] = text
        return cls(memory, owner=True)

    @classmethod
    def attach(cls, name: str, *, from_start: bool = False) -> Self:
        """Attach to a ring of another process; with `from_start`, `news` also returns records written before.

        Raises
        ------
        ConfigurationError : there is no ring of this name.
        """
        try:
            memory = _attached(name)
        except OSError as absent:
            raise ConfigurationError("name", name, "the name of a ring that a running process made") from absent
        if memory.size < _HEADER.size or bytes(_bytes_of(memory)[:8]) != MAGIC:
            memory.close()
            raise ConfigurationError("name", name, "shared memory that is a ring")
        ring = cls(memory, owner=False)
        ring._read = 0 if from_start else ring._read
        return ring

    @property
    def name(self) -> str:
        """Name of the ring, for `attach`."""
        return self._memory.name

    @property
    def record(self) -> NDArray[np.void]:
        """Record that `publish` writes; its fields, such as `record["force"]`, keep their values until set."""
        return self._record

    def publish(self) -> None:
        """Write `record` to the ring as the newest record."""
        number = self._number + 1
        begin = self._begin + (number % self.depth) * self._slot
        now, buffer = time.monotonic(), self._buffer
        head = _SLOT.pack(number, now, 0)[:_CHECKED]
        check = zlib.crc32(self._draft, zlib.crc32(head))
        _SLOT.pack_into(buffer, begin, number, now, check)
        buffer[begin + _SLOT.size : begin + _SLOT.size + len(self._draft)] = self._draft
        self._numbers[_NEWEST] = number
        self._number = number

    def write(self, **fields: ArrayLike | str | bytes) -> None:
        """Set these fields of `record`, keep its other fields, and publish the record."""
        for name, value in fields.items():
            field = self._record[name]
            field[...] = shortened(value, field.dtype.itemsize) if isinstance(value, str) else value
        self.publish()

    def latest(self) -> Newest | None:
        """The newest record; None before the first record."""
        for _ in range(_TRIES):
            number = self._numbers[_NEWEST]
            # If the writer overwrites a slot while it is read, the next older record is tried.
            for one in range(number, max(number - self.depth, 0), -1):
                found = self._slot_of(one)
                if found is not None:
                    self._found = found
                    return found
            if not number:
                return None
        return self._found

    def news(self) -> News:
        """Records since the last call; in the first call, since this object was made."""
        newest = self._numbers[_NEWEST]
        first = max(self._read + 1, newest - self.depth + 1)
        found = [each.record for each in map(self._slot_of, range(first, newest + 1)) if each is not None]
        lost = newest - self._read - len(found)
        self._read = newest
        return News(np.array(found, dtype=self.layout), lost)

    def close(self) -> None:
        """Release the memory; the process that created the ring also removes it."""
        self._numbers.release()
        self._buffer = memoryview(b"")
        self._memory.close()
        if self._owner:
            self._owner = False
            self._memory.unlink()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __del__(self) -> None:
        if hasattr(self, "_numbers"):
            self._numbers.release()  # shared memory cannot be closed while a view exists

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the ring's name; the unpickled object attaches to the ring."""
        return SharedRing.attach, (self.name,)

    def _slot_of(self, number: int) -> Newest | None:
        """The record with this number; None if the record is incomplete or overwritten."""
        begin = self._begin + (number % self.depth) * self._slot
        copied = bytes(self._buffer[begin : begin + _SLOT.size + self.layout.itemsize])
        found, when, check = _SLOT.unpack_from(copied)
        if found != number or check != zlib.crc32(copied[_SLOT.size :], zlib.crc32(copied[:_CHECKED])):
            return None
        return Newest(number, when, np.frombuffer(copied, self.layout, 1, _SLOT.size)[0])


def shortened(text: str, size: int) -> bytes:
    """`text` in UTF-8, truncated between characters to at most `size` bytes."""
    return text.encode()[:size].decode(errors="ignore").encode()


def _in_eights(size: int) -> int:
    return -(-size // 8) * 8


def _bytes_of(memory: SharedMemory) -> memoryview:
    return memory.buf if memory.buf is not None else memoryview(b"")


def _attached(name: str) -> SharedMemory:
    """Attach without Python's resource tracker, which would remove the memory of the other process."""
    if sys.version_info >= (3, 13):
        return SharedMemory(name, track=False)
    with _QUIET:
        usual, resource_tracker.register = resource_tracker.register, lambda *_: None
        try:
            return SharedMemory(name)
        finally:
            resource_tracker.register = usual
