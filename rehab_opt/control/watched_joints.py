"""Whether joints follow their commands: the way that each has moved beside the way that it was commanded."""

from __future__ import annotations

from functools import cache
from typing import cast

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.optim.certificate import all_true
from rehab_opt.optim.rows import PLAUSIBLE
from rehab_opt.symbolic import BufferedFunction
from rehab_opt.symbolic.record import Record

__all__ = ["NOT_FOLLOWED", "WatchedJoints", "memory_of_watch", "overdue", "watched_joints"]

Array = NDArray[np.float64]

NOT_FOLLOWED = "does not follow"
"""What a reason says of a joint at fault."""
SHARE = 0.08
"""A joint follows that has moved this share of the way that it was commanded: a caller may integrate a tenth of it."""
TOLERANCE = 0.03
"""[rad or m] Commanded way on which a joint is judged: at most two stretches of half of it are needed."""
PATIENCE, TICKS = 0.15, 5
"""[s, ticks] for which a joint that does not follow is none: 2.6 delays pass until one that turns back has done so."""
FADING = 0.05
"""[1/s] Rate at which ways are forgotten: a joint that is commanded more slowly than 0.75 mrad/s is not judged."""


STANDS = 0.05
"""[s] States without a stamp that are the same for no longer are those of an encoder slower than the ticks."""


@cache
def memory_of_watch(n: int) -> Record:
    """What is remembered of n joints: where each was seen; the way that it was commanded since it was last seen to
    follow, and that it has moved [rad or m]; for how long it does not follow [s]; the joint at fault, counted from 1,
    with both of its ways; whether there was a position; whether the place of a base is measured; the way that each was
    commanded, and the time [s], since there was a new state.
    """
    return Record(
        seen=n, led=n, moved=n, wrong=n, fault=1, fault_led=1, fault_moved=1, known=1, placed=1, pending=n, waited=1
    )


def overdue(wrong: ca.SX, patience: float | ca.SX, size: ca.SX) -> ca.SX:
    """Number, from 1 on, of the joint of the largest `size` (n,) of those `wrong` [s] (n,) for too long; 0 for none."""
    joint, most = ca.SX(0), ca.SX(-1)
    for i in range(wrong.numel()):
        worse = ca.logic_and(wrong[i] > patience, size[i] > most)
        joint, most = ca.if_else(worse, i + 1, joint), ca.if_else(worse, size[i], most)
    return joint


def watched_joints(chain: SerialChain, *, dt: float, base: int) -> ca.Function:
    """`memory_of_watch`, measured positions, last command (n,), whether they have a stamp -> memory, what is said.

    Said are the joint at fault, counted from 1, 0 for none, the way that it was commanded and that it has moved.

    Parameters
    ----------
    chain : whose joints. dt : [s] a tick.
    base : how many of the first joints are the place of a base. Where that never changes it is taken not to be
        measured.
    """
    n, window = chain.n, TOLERANCE / 2
    memory, measured, command = memory_of_watch(n).symbols("memory"), ca.SX.sym("measured", n), ca.SX.sym("command", n)
    stamped = ca.SX.sym("stamped")
    pending, waited = memory.pending + dt * command, memory.waited + dt
    stood = waited > max(STANDS, dt) + dt / 2
    way, time = ca.if_else(stood, dt * command, pending), ca.if_else(stood, dt, waited)
    keep = 1 - ca.fmin(FADING * time, 1)
    usable = all_true(ca.fabs(measured) <= PLAUSIBLE)
    step = ca.if_else(ca.logic_and(usable, memory.known), measured - memory.seen, 0)
    # Farther than a joint goes: states that are not one motion of it.
    jumped = ca.logic_not(ca.fabs(step) <= ca.DM(2 * np.minimum(chain.velocity, PLAUSIBLE)) * time + window)
    anew = ca.logic_or(ca.logic_not(memory.known), jumped)
    placed = ca.logic_or(memory.placed, ca.logic_not(all_true(step[:base] == 0)))
    led, moved = keep * memory.led + way, keep * memory.moved + step
    led = ca.if_else(ca.vertcat(*(placed if i < base else 1 for i in range(n))), led, 0)
    along = moved * ca.sign(led)
    judged, follows = ca.fabs(led) > window, along >= SHARE * ca.fabs(led)
    lost = ca.logic_and(judged, ca.logic_not(follows))
    waits = ca.fmax(memory.wrong + time * (2 * lost - 1), 0)
    wrong = ca.if_else(anew, 0, ca.if_else(usable, waits, memory.wrong))
    joint = overdue(wrong, max(PATIENCE, TICKS * dt), ca.fabs(led) - along)
    fault, fault_led, fault_moved = memory.fault, memory.fault_led, memory.fault_moved
    for i in range(n):
        new = ca.logic_and(joint == i + 1, ca.logic_not(memory.fault))
        fault, fault_led = ca.if_else(new, i + 1, fault), ca.if_else(new, led[i], fault_led)
        fault_moved = ca.if_else(new, moved[i], fault_moved)
    begins = ca.logic_or(anew, ca.logic_and(judged, follows))
    after = memory_of_watch(n).of(
        seen=ca.if_else(usable, measured, memory.seen), led=ca.if_else(begins, 0, led),
        moved=ca.if_else(begins, 0, moved), wrong=wrong, fault=fault, fault_led=fault_led, fault_moved=fault_moved,
        known=ca.logic_or(memory.known, usable), placed=placed, pending=ca.SX(n, 1), waited=ca.SX(0),
    )  # fmt: skip
    # A state without a stamp that is the same number by number is the same state, not a later one.
    same = ca.logic_and(ca.logic_and(memory.known, ca.logic_not(stamped)), all_true(measured == memory.seen))
    stays = memory_of_watch(n).changed(memory, pending=pending, waited=waited).column
    after = ca.if_else(same, stays, after)
    said = memory_of_watch(n).parts(after)
    return ca.Function(
        "watched_joints", [memory.column, measured, command, stamped],
        [after, ca.vertcat(said.fault, said.fault_led, said.fault_moved)], {"cse": True},
    )  # fmt: skip


class WatchedJoints:
    """Finds joints that do not follow: blocked, measured by an encoder that stands still, or turning the wrong way.

    A joint's way as it was commanded, beyond TOLERANCE / 2, is held beside the way that it is measured to have moved
    since. A joint that moved SHARE of it, in its direction, follows, and both ways begin anew; one that does not for
    PATIENCE is at fault. So a fault is seen PATIENCE and TOLERANCE / speed after it begins at the latest, while neither
    a servo of 24 Hz, a delay of 50 ms, encoder noise of 0.2 mrad, nor a caller that integrates another dt is one.

    States that are not one motion are no fault: a joint that has gone farther than it can begins anew; and a state
    without a stamp that is the same as the last one, in every joint, is not taken for a later one, but what was
    commanded meanwhile counts with the next, unless it stands for longer than STANDS. So an arm all of whose joints
    stand still is found to be at fault only where states have stamps.

    Parameters
    ----------
    watched : what `watched_joints` makes. names : (n,) of the joints. memory : of `memory_of_watch`, kept elsewhere.
    """

    def __init__(self, watched: ca.Function, names: tuple[str, ...], memory: Array) -> None:
        self._names, self._function, self._memory = names, BufferedFunction(watched), memory
        self._evaluate = self._function.evaluate  # it is never exchanged
        views = (cast("memoryview[float]", each.data) for each in (*self._function.inputs, *self._function.outputs))
        self._before, self._measured, self._command, self._stamped, self._after, self._said = views

    def reset(self) -> None:
        """Nothing is known."""
        self._memory[:] = 0.0

    def take_over(self, other: WatchedJoints) -> None:
        """Remember what another one of the same joints does."""
        self._memory[:] = other._memory

    def fault(self, measured: memoryview[float], command: memoryview[float], *, stamped: float) -> str:
        """Which joint does not follow, once a tick: empty for none, the same until `reset`.

        Parameters
        ----------
        measured, command : (n,) positions now, and the command that led there. stamped : whether they have a stamp.
        """
        self._before[:], self._measured[:], self._command[:] = self._memory.data, measured, command
        self._stamped[0] = stamped
        self._evaluate()
        self._memory[:] = self._after
        if not self._said[0]:
            return ""
        joint, led, moved = self._said.tolist()
        return f"{self._names[int(joint) - 1]} {NOT_FOLLOWED}: led by {led:.2g}, it moved by {moved:.2g} rad or m"
