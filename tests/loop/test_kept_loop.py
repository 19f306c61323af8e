"""Numbers of the loop's parts, kept: messages, records, times, and a loop on a clock of its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rehab_opt.control.command import Command, Relaxed, Status
from rehab_opt.loop import cdr, delay, messages
from rehab_opt.loop.delay import measured_delay
from rehab_opt.loop.loop import Loop
from rehab_opt.loop.records import Tick, operator_layout, state_layout
from rehab_opt.loop.replay import replayed
from rehab_opt.loop.report import FINENESS, FIRST, LoopReport, Times
from rehab_opt.loop.shared_ring import SharedRing
from rehab_opt.plants.ideal import IdealJoints
from tests.golden import assert_kept
from tests.golden.returns import Returns, sums
from tests.loop.clock import Clock


def test_a_time_on_the_edge_of_a_bin_is_in_the_bin_below() -> None:
    for octave in (0, 1, 5):
        times = Times()
        for _ in range(3):
            times.add(FIRST * 2**octave)
        times.add(1.0)
        assert times.percentile(50) == FIRST * 2 ** (octave + (octave > 0) / FINENESS)


def decide(tick: Tick) -> Command:
    """A wave, a reason now and then, an exception of its own kind of time."""
    q, wave = tick.seen.position, 0.2 * np.sin(0.3 * tick.number)
    status = Status.OK if tick.enabled else Status.HOLDING
    value = np.full(len(q), wave) - 0.1 * q if tick.enabled else np.zeros(len(q))
    return Command(value, status, "why not" if tick.number % 7 == 0 else "", 1e-9, 0, "", Relaxed.NOTHING, 1.0)


def test_parts_of_a_loop(tmp_path: Path, clock: Clock) -> None:
    pytest.importorskip("mcap.reader")
    more, plant = [], IdealJoints(0.004)
    plant.reset(np.array([0.1, -0.2]))
    clock.oversleeps = {20: 0.003, 40: 0.011, 41: 0.0, 60: 0.0021}
    rows = []
    with Returns(
        "rehab_opt/loop/",
        but="Log\\.|Ring.name|log_file|log_process|__del__|_attached|_bytes_of|scheduling|_versions|loop.remote",
    ) as seen:
        layout = state_layout(2, operator_layout(2))
        with SharedRing.create(layout, depth=256) as ring, SharedRing.create(operator_layout(2)) as operator:
            loop = Loop(plant, decide, state=ring, operator=operator, max_age=0.02, dead_man=0.03)

            def until() -> bool:
                rows.append(clock.now)
                if not 25 < len(rows) < 45:
                    operator.write(heartbeat=clock.now, push=[0.5, -0.2, 0.0] if len(rows) > 50 else [0, 0, 0])
                return len(rows) > 90

            report = loop.run(until=until)
            written = SharedRing.attach(ring.name, from_start=True).news().records
        more += [[report.ticks, report.missed, report.late, report.stale], written["position"], written["command"]]
        more += [written["missed"], written["enabled"], written["status"].tolist()]
        again = replayed(written, decide)
        spoilt = written.copy()
        spoilt["position"][30:, 1] += 0.01
        more += [
            again.same,
            again.worst,
            replayed(spoilt, decide).first,
            replayed(np.delete(written, [4, 5]), decide).first,
        ]
        write, told = cdr.record_cdr(layout), cdr.record_definition(layout)
        more += [
            told,
            np.frombuffer(write(written[3])[:400], np.uint8),
            cdr.records_of(layout, [write(written[3])])["position"],
        ]
        for text in (messages.joint_state(10**9 + 7, ["a", "b"], [1.0, 2.0], [3.0, 4.0]),
                     messages.wrench(5 * 10**9 + 1, "base", [1.0, -2.0, 3.0]), messages.floats([0.5, 1.5])
                     ):  # fmt: skip
            more.append(np.frombuffer(text, np.uint8))
        more += [[delay._fraction(each) for each in np.arange(0.0, 4.0, 0.045)]]
        still = IdealJoints(0.008)
        still.reset(np.zeros(3))
        more += [measured_delay(still, joint=2), report.lateness.percentile(50)]
        times = Times()
        for each in (0.0, -1.0, 1e-6, 3e-4, 3e-4, 0.02, 100.0):
            times.add(each)
        more += [[times.percentile(each) for each in (0, 10, 50, 60, 99, 100)], times.worst]
        more.append(str(LoopReport(3, 2, 1, 0, times, times, "none", "over", False)))
    assert_kept("loop", [seen.numbers(), [sums(each) for each in more]], relative=1e-6, absolute=1e-9)
