"""What is in the records of a loop: what it did in a tick, and what its operator wants."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

__all__ = ["operator_layout", "state_layout"]

STATUS, REASON = 16, 240
"""Bytes of a status and of a reason; a longer one is cut."""


def operator_layout(joints: int, *, axes: int = 4, targets: int = 1, force: int = 3) -> np.dtype[Any]:
    """What whoever operates a robot may want, as a page, a stick or a program of one's own writes it.

    Fields
    ------
    heartbeat : [s] `time.monotonic` when the dead man's switch was last known to be held; not held: NaN.
    stick (axes,) : deflections, -1 to 1. buttons : a bit each.
    target (targets, 4, 4) : poses in the base frame [m], the tool's first; twist (targets, 6) how they move [m/s,
        rad/s]. Where a problem has hands in a plane, column 3 holds their places.
    push (force,) : [N] on the hand of a simulated robot.
    frozen (joints,) : 1 where an encoder shall stand still; noise [rad, m] of the encoders, delay [s] of what is
        measured: faults of a simulated robot.

    Parameters
    ----------
    joints : of the plant. axes : of the stick. targets : how many hands are led. force : components, 2 or 3.
    """
    return np.dtype(
        [
            ("heartbeat", "<f8"),
            ("stick", "<f8", (axes,)),
            ("buttons", "<u8"),
            ("target", "<f8", (targets, 4, 4)),
            ("twist", "<f8", (targets, 6)),
            ("push", "<f8", (force,)),
            ("frozen", "<u8", (joints,)),
            ("noise", "<f8"),
            ("delay", "<f8"),
        ]
    )


def state_layout(
    joints: int, operator: np.dtype[Any] | None = None, *, command: int | None = None, wheels: int = 0, force: int = 3
) -> np.dtype[Any]:
    """One tick of a loop: what the controller was given, what it answered, what is so, and how the time was kept.

    Numbers of 8 bytes each, then texts: the order in which `rehab_opt.loop.cdr` writes them.

    Fields
    ------
    record : its number, from 1 on, one more each. tick : from 0 on, left-out ones counted. time : [s] of its deadline
        since the loop began. clock : [s] `time.monotonic` of it.
    stamp : [s] of the measurement, on the plant's clock. position, velocity (joints,), force (force,) : measured.
    enabled : 1 if the controller was told to move. asked_before : 0, or if it was asked twice in this tick, 1 if it was
        told not to move at first, 2 if it was told to. age : [s] of the measurement when the command was sent.
    held : 1 while the dead man's switch is. operated : 1 once the operator has written anything. All fields of
        `operator`, with `operator_` before their names.
    command (command,) : what was answered, and wheels (wheels,). scale, residual, yielded : see `Command`.
    true_position, true_velocity, effort (joints,), true_force (force,) : the plant's truth; of a device, what it says.
    lateness : [s] from the deadline to the begin of the tick. tick_time : [s] from there until the command was sent.
    missed : ticks left out so far. stale : commands refused so far because their state was too old.
    status, reason : texts.
    """
    size = joints if command is None else command
    fields: list[tuple[Any, ...]] = [
        ("record", "<u8"),
        ("tick", "<u8"),
        ("time", "<f8"),
        ("clock", "<f8"),
        ("stamp", "<f8"),
        ("position", "<f8", (joints,)),
        ("velocity", "<f8", (joints,)),
        ("force", "<f8", (force,)),
        ("enabled", "<u8"),
        ("asked_before", "<u8"),
        ("held", "<u8"),
        ("operated", "<u8"),
        ("age", "<f8"),
    ]
    for name, (each, *_) in ({} if operator is None else dict(operator.fields or {})).items():
        fields.append((f"operator_{name}", each.base, each.shape) if each.shape else (f"operator_{name}", each))
    fields += [
        ("command", "<f8", (size,)),
        ("wheels", "<f8", (wheels,)),
        ("scale", "<f8"),
        ("residual", "<f8"),
        ("yielded", "<u8"),
        ("true_position", "<f8", (joints,)),
        ("true_velocity", "<f8", (joints,)),
        ("effort", "<f8", (joints,)),
        ("true_force", "<f8", (force,)),
        ("lateness", "<f8"),
        ("tick_time", "<f8"),
        ("missed", "<u8"),
        ("stale", "<u8"),
        ("status", f"S{STATUS}"),
        ("reason", f"S{REASON}"),
    ]
    return np.dtype([each for each in fields if len(each) < 3 or math.prod(each[2])])
