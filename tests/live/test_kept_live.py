"""Numbers of the page's parts, kept: seats, gates, inputs, pictures and messages."""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np

from rehab_opt.live import film, server
from rehab_opt.live.seats import Gate, Seats, inputs_of
from rehab_opt.session.files import load_problem
from rehab_opt.session.live.problem import LiveInputs
from rehab_opt.session.run import live_problem
from tests.golden import assert_kept
from tests.golden.returns import Returns, sums

GIVEN: dict[str, tuple[Any, ...]] = {
    "enable": (True, 1), "target": ([0.1, 0.2, 0.3], None, [20.0, 0, 0], [20.1, 0, 0], [0, math.nan, 0]),
    "push": ([1, 2, 3], [100.0, 0, 0], [-100.5, 0, 0], [0, 0]), "stick": ([0.5, -1.0], [1.0, 1.01], [-1, math.inf]),
    "switch": (True, None), "gripper": (True,), "frozen": (-1, 0, 5, 6, 2.5, -2), "noise": (0.0, 0.05, 0.051, -0.1),
    "delay": (0.0, 0.5, 0.51, "x"), "helper": ([0.1, 0.1, 0.0], [30, 0, 0]),
}  # fmt: skip


def test_the_pages_parts(tmp_path: Path) -> None:
    more: list[Any] = []
    usual = {key: values[0] for key, values in GIVEN.items()}
    with Returns("rehab_opt/live/", but="_page|Gate") as seen:
        for key, values in GIVEN.items():
            more += [inputs_of(usual | {key: value}, joints=6) for value in values]
            more.append(inputs_of({name: each for name, each in usual.items() if name != key}, joints=6))
        for hands in (1, 2):
            seats, held = Seats(hands=hands), LiveInputs(enable=True, target=(0.1, 0.2, 0.3))
            tabs = [seats.join(participant=each) for each in (False, True, False)]
            for k, (tab, sent) in enumerate(itertools.product(tabs, (None, 0.0, 0.1, 0.35))):
                seats.hear(tab, held, now=0.1 * k, sent=sent)
                seats.hear(tab, held, now=0.1 * k + 1e-3, sent=None if sent is None else sent + 0.2)
                seats.point(tab, (0.1, k, 0.2) if k % 3 else None)
                more += [seats.current, seats.state(tab), seats.heartbeat, seats.lapsed, seats.commander]
                if k in (3, 7):
                    seats.take(tabs[k % 2 * 2 - 1])
            for tab in tabs:
                seats.leave(tab)
                more += [seats.current, seats.commander]
            for k in range(120):  # more than a tab may say at once
                seats.hear(seats.join(participant=False) if not k else 4, held, now=20 + 1e-4 * k)
        for flat in (False, True):
            project = film._projection(np.array([0.2, 0.0, 0.3]), 0.3, 0.6, flat=flat)
            more.append(project(np.random.default_rng(0).uniform(-1, 1, (9, 3))))
        more.append(server._finite({"a": [math.nan, 1.0, (2, math.inf)]}))
        more.append(server._text(b"a\xff"))
        more.append(
            film.write_film(live_problem(load_problem("robot/ur5_among_bodies")), tmp_path / "a.gif", seconds=0.4)
        )
    gate = Gate(["LOCALHOST", "127.0.0.1", "::1", "0:0:0:0:0:0:0:1"], 80)
    own = sorted(gate.hosts)
    for hosts, origins, socket in itertools.product(([], own[:1], own[:2], ["evil"], [own[0].upper()]),
                                                    ([], [f"http://{own[0]}"], ["http://evil"], ["a", "b"]),
                                                    (True, False)):  # fmt: skip
        for target in ("/?token=", f"/?token={gate.token}", f"/?token={gate.token}&token={gate.token}"):
            more.append(gate.refusal(target, hosts, origins, socket=socket))
    assert_kept("live", [seen.numbers(), [sums(each) for each in more], own], relative=1e-6, absolute=1e-9)
