"""Records of one process, read by others while it writes, is killed, or is faster than they are."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator

import numpy as np
import pytest

from rehab_opt.loop.records import operator_layout, state_layout
from rehab_opt.loop.shared_ring import SharedRing
from tests.refusals import refuses

WIDE = np.dtype([("number", "<u8"), ("same", "<u8", (4000,))])
START = multiprocessing.get_context("spawn")


@pytest.fixture
def ring() -> Iterator[SharedRing]:
    with SharedRing.create(WIDE, depth=4) as made:
        yield made


def write_for_ever(name: str) -> None:
    ring = SharedRing.attach(name)
    number = 0
    while True:
        number += 1
        ring.write(number=number, same=number)


def test_what_is_written_is_read_in_the_same_layout() -> None:
    layout = state_layout(6, operator_layout(6))
    with SharedRing.create(layout, depth=8) as ring:
        reader = SharedRing.attach(ring.name)
        assert reader.layout == layout
        assert reader.latest() is None
        rng = np.random.default_rng(3)
        position, target = rng.normal(size=6), rng.normal(size=(1, 4, 4))
        before = time.monotonic()
        ring.write(position=position, operator_target=target, reason="ö" * 400, status="braking")
        newest = reader.latest()
        assert newest is not None
        assert newest.number == 1
        assert before <= newest.time <= time.monotonic()
        np.testing.assert_array_equal(newest.record["position"], position)
        np.testing.assert_array_equal(newest.record["operator_target"], target)
        assert newest.record["reason"].decode() == "ö" * 120
        reader.close()


def test_no_record_is_torn_while_another_process_writes(ring: SharedRing) -> None:
    writer = START.Process(target=write_for_ever, args=(ring.name,))
    writer.start()
    reader = SharedRing.attach(ring.name)
    while reader.latest() is None:
        time.sleep(0.01)
    numbers: list[int] = []
    while len(set(numbers)) < 200:
        newest = reader.latest()
        assert newest is not None
        numbers.append(newest.number)
        assert newest.record["number"] == newest.number
        assert np.all(newest.record["same"] == newest.number)
    os.kill(writer.pid or 0, signal.SIGKILL)
    writer.join()
    last = reader.latest()  # of a writer that was killed anywhere
    reader.close()
    assert numbers == sorted(numbers)
    assert last is not None
    assert np.all(last.record["same"] == last.number)


def test_a_half_written_record_is_not_seen(ring: SharedRing) -> None:
    """As a processor that reorders stores might show it: the number is there before all of the record is."""
    ring.write(number=1, same=1)
    ring.write(number=2, same=2)
    memory = multiprocessing.shared_memory.SharedMemory(ring.name)
    assert memory.buf is not None
    wide = WIDE.itemsize
    begin = bytes(memory.buf).index(np.uint64(2).tobytes() * 4000)
    memory.buf[begin + wide // 2] ^= 1
    newest = ring.latest()
    memory.close()
    assert newest is not None
    assert newest.number == 1


def test_a_slow_reader_is_told_how_many_it_lost(ring: SharedRing) -> None:
    for number in range(1, 4):
        ring.write(number=number)
    reader = SharedRing.attach(ring.name)
    assert reader.news().records.size == 0  # what was before it came is not news
    for number in range(4, 24):
        ring.write(number=number)
    news = reader.news()
    assert news.records["number"].tolist() == [20, 21, 22, 23]
    assert news.lost == 16
    ring.write(number=24)
    assert (reader.news().records["number"].tolist(), reader.news().lost) == ([24], 0)
    reader.close()


def test_a_foreign_process_that_looked_removes_nothing(ring: SharedRing) -> None:
    ring.write(number=5)
    code = (
        "import sys; from rehab_opt.loop.shared_ring import SharedRing; ring = SharedRing.attach(sys.argv[1]);"
        "print(ring.latest().record['number']); ring.close()"
    )
    done = subprocess.run([sys.executable, "-c", code, ring.name], capture_output=True, text=True, check=True)
    assert (done.stdout.strip(), done.stderr) == ("5", "")
    SharedRing.attach(ring.name).close()


def test_a_depth_that_is_none_and_a_name_in_use_are_refused(ring: SharedRing) -> None:
    refuses(
        SharedRing.create,
        *(({"layout": WIDE, "depth": depth}, "depth") for depth in (0, 1, 2.0, float("nan"), 1 << 40)),
    )
    refuses(SharedRing.create, ({"layout": WIDE, "name": ring.name}, "not in use"))
