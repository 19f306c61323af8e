"""A gamepad as the kernel's bytes tell of it."""

import os
import struct
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from rehab_opt.errors import DeviceLostError
from rehab_opt.loop.companion import Companion
from rehab_opt.loop.gamepad import Gamepad, operate
from rehab_opt.loop.records import operator_layout
from rehab_opt.loop.shared_ring import SharedRing

OPENING = 0x80
SWITCH = 4


class Cable:
    def __init__(self, pipe: tuple[int, int]) -> None:
        self.read_end, self._write_end = pipe

    def raw(self, data: bytes) -> None:
        os.write(self._write_end, data)

    def button(self, number: int, value: int, *, opening: int = 0) -> None:
        self.raw(struct.pack("=IhBB", 1000, value, 1 | opening, number))

    def axis(self, number: int, value: int, *, opening: int = 0) -> None:
        self.raw(struct.pack("=IhBB", 1000, value, 2 | opening, number))

    def pull(self) -> None:
        os.close(self._write_end)


@pytest.fixture
def cable() -> Cable:
    return Cable(os.pipe())


@pytest.fixture
def pad(cable: Cable) -> Iterator[Gamepad]:
    with Gamepad(cable.read_end, dead_man=SWITCH) as made:
        yield made


def test_a_stick_is_read_forward_and_to_the_left(pad: Gamepad, cable: Cable) -> None:
    cable.axis(0, 0, opening=OPENING)
    cable.axis(1, -32767)
    assert pad.read().forward_left == (1.0, 0.0)
    cable.axis(0, -32768)  # one more than to the other side
    cable.axis(1, 16384)
    state = pad.read()
    assert state.forward_left == pytest.approx((-0.5, 1.0), abs=1e-4)
    assert min(state.axes) == -1.0


def test_events_in_pieces_are_those_in_one(cable: Cable) -> None:
    rng = np.random.default_rng(8)
    events = b"".join(
        struct.pack("=IhBB", i, int(rng.integers(-32768, 32768)), int(rng.choice([1, 2])), int(rng.integers(8)))
        for i in range(300)
    )
    pieces, place = Cable(os.pipe()), 0
    with Gamepad(cable.read_end) as one, Gamepad(pieces.read_end) as other:
        cable.raw(events)
        while place < len(events):
            size = int(rng.integers(1, 20))
            pieces.raw(events[place : place + size])
            other.read()
            place += size
        whole, cut = one.read(), other.read()
    assert whole[:2] == cut[:2]
    assert len(whole.axes) == 8


def test_the_switch_is_held_while_its_button_is_and_must_be_let_go_first_if_it_was_down_at_the_opening(
    pad: Gamepad, cable: Cable
) -> None:
    assert not pad.read().held
    cable.button(SWITCH, 1, opening=OPENING)
    assert not pad.read().held
    cable.button(SWITCH, 1)
    assert not pad.read().held
    cable.button(SWITCH, 0)
    assert not pad.read().held
    cable.button(SWITCH, 1)
    assert pad.read().held
    cable.button(2, 1)
    state = pad.read()
    assert (state.held, state.buttons) == (True, 0b10100)
    cable.button(SWITCH, 0)
    assert not pad.read().held


def test_a_gamepad_that_is_pulled_out_is_lost_and_holds_nothing(pad: Gamepad, cable: Cable) -> None:
    with SharedRing.create(operator_layout(6)) as ring:
        cable.button(SWITCH, 0, opening=OPENING)
        pad.read()
        cable.button(SWITCH, 1)
        cable.axis(1, -32767)
        looks = [0]

        def until() -> bool:
            looks[0] += 1
            if looks[0] == 3:
                newest = ring.latest()
                assert newest is not None
                assert newest.record["stick"].tolist() == [1.0, 0.0, 0.0, 0.0]
                assert 0.0 <= time.monotonic() - newest.record["heartbeat"] < 10.0
                cable.pull()
            return False

        with pytest.raises(DeviceLostError, match="its stream has ended"):
            operate(pad, ring, until=until)
        newest = ring.latest()
        assert newest is not None
        assert np.isnan(newest.record["heartbeat"])
        assert not newest.record["stick"].any()


def test_a_process_of_its_own_reads_it_for_a_loop(tmp_path: Path) -> None:
    """As `rehab-opt loop --gamepad` begins it; what it says points nowhere: the problem's own way is followed."""
    os.mkfifo(tmp_path / "js0")
    cable = Cable((-1, os.open(tmp_path / "js0", os.O_RDWR)))
    cable.button(SWITCH, 0)
    cable.button(SWITCH, 1)
    cable.axis(1, -32767)
    with SharedRing.create(operator_layout(6, axes=2)) as ring:
        reader = Companion("rehab_opt.loop.gamepad", {"source": str(tmp_path / "js0"), "ring": ring.name})
        try:
            until = time.monotonic() + 60.0
            while (newest := ring.latest()) is None or not newest.record["stick"].any():
                assert time.monotonic() < until
                time.sleep(0.01)
        finally:
            reader.end(60.0)
        assert newest.record["stick"].tolist() == [1.0, 0.0]
        assert newest.time - newest.record["heartbeat"] < 0.05
        assert np.isnan(newest.record["target"]).all()
        last = ring.latest()
        assert last is not None
        assert np.isnan(last.record["heartbeat"])  # it has ended
    cable.pull()
