"""The columns of trace.csv of a mirrored motion: the closed loop, tick by tick, and the plan below it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rehab_opt.session.mirror.outcome import MirrorOutcome
from rehab_opt.session.systems import Column
from rehab_opt.session.trace_columns import joint_columns, point_columns

__all__ = ["mirror_columns"]


def mirror_columns(outcome: MirrorOutcome) -> Iterator[Column]:
    """One row a tick of each law, one law after the other; cells are empty where there is no reference."""
    laws = outcome.laws
    yield "law", tuple(name for name, led in laws.items() for _ in led.time)
    for name in ("time", "lag"):
        unit = "t_s" if name == "time" else "lag_s"
        yield unit, np.concatenate([getattr(led, name) for led in laws.values()]).tolist()
    yield "pace", np.concatenate([led.pace for led in laws.values()]).tolist()
    yield from point_columns("reference", np.concatenate([led.reference[:, :3, 3] for led in laws.values()]))
    yield from point_columns("tool", np.concatenate([led.tool[:, :3, 3] for led in laws.values()]))
    yield "deviation_m", np.concatenate([led.deviation for led in laws.values()]).tolist()
    yield "turn_rad", np.concatenate([led.turn for led in laws.values()]).tolist()
    yield "manipulability", np.concatenate([led.manipulability for led in laws.values()]).tolist()
    yield "status", tuple(each for led in laws.values() for each in led.status)
    yield "yielded", tuple(each for led in laws.values() for each in led.yielded)
    yield from joint_columns("joint", outcome.chain, np.concatenate([led.q for led in laws.values()]), "rad")
    yield from joint_columns("command", outcome.chain, np.concatenate([led.command for led in laws.values()]), "rad_s")
