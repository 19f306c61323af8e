"""Whether joints follow their commands, from commanded and measured travel alone, without a model of the robot."""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np

from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.optim.rows import MAX_MAGNITUDE
from rehab_opt.symbolic.record import Record

__all__ = [
    "HAND_HELD",
    "memory_of_watch",
    "not_followed",
    "patience_of",
    "time_apart",
    "watched_joints",
]

HAND_HELD = 2.0
"""The fault of a hand that was held for too long; that of a joint that was too far off for too long is 1."""
SHARE = 0.08
"""A joint follows that has moved this share of the way that it was commanded: a caller may integrate a tenth of it."""
TOLERANCE = 0.03
"""[rad or m] Commanded way on which a joint is judged: at most two stretches of half of it are needed."""
PATIENCE, TICKS = 0.15, 5
"""[s, ticks] for which a joint that does not follow is none: 2.6 delays pass until one that turns back has done so."""
FADING = 0.05
"""[1/s] Rate at which ways are forgotten: a joint that is commanded more slowly than 0.75 mrad/s is not judged."""
STANDS = 0.05
"""[s] An encoder slower than the ticks shows the same position for no longer: by as much a joint may seem to jump."""


@cache
def memory_of_watch(n: int) -> Record:
    """What is remembered of n joints: for how long each does not follow [s]; how far it is from where it was led, and
    the way that it was led, since it was last seen to follow [rad or m]; where it was seen; the
    time from when any was last seen to move to the next tick [s], 0 of none; whether the place of a base is measured.
    """
    return Record(wrong=n, apart=n, led=n, seen=n, since=1, placed=1)


def time_apart(wrong: ca.SX, apart: ca.SX, dt: float | ca.SX) -> ca.SX:
    """(n,) [s] for which each joint does not follow, after one more tick in which those of `apart` (n,) do not.

    A joint that does not follow for longer than its patience is at fault, until a reset (`judged_state`). Time
    in which it does comes off again, so that what shows one time in two is no fault and what shows more often is.
    """
    return ca.fmax(wrong + dt * (2 * apart - 1), 0)


def patience_of(dt: float) -> float:
    """[s] for which a joint of `watched_joints` may not follow."""
    return max(PATIENCE, TICKS * dt)


def watched_joints(chain: SerialChain, *, dt: float, base: int, base_alone: bool = False) -> ca.Function:
    """`memory_of_watch`, measured positions, last command (n,) -> memory, longest time that one does not follow [s].

    A joint's way as it was commanded, beyond TOLERANCE / 2, is held beside the way that it is measured to have moved
    since. A joint that moved SHARE of it, in its direction, follows, and both ways begin anew; one that does not for
    PATIENCE is at fault: blocked, measured by an encoder that stands still, or turning the wrong way. A fault is seen
    PATIENCE and TOLERANCE / speed after it begins at the latest, while neither a servo of 24 Hz, a delay of 50 ms,
    encoder noise of 0.2 mrad, nor a caller that integrates another dt is one.

    A joint that has gone farther than it can begins anew: such states are not one motion. The same state, asked about
    again and again, is one in which nothing moves. While positions are not usable, joints are led on and not judged.
    Written for few operations.

    Parameters
    ----------
    chain : whose joints. dt : [s] a tick.
    base : how many of the first joints are the place of a base. Where that never changes it is taken not to be
        measured.
    base_alone : whether the others are led, so that a model of their delay judges them (`FollowedJoints`): a delay of
        0.1 s, which is told, is no fault.
    """
    n, window, keep = chain.n, TOLERANCE / 2, 1 - FADING * dt
    memory, measured, command = memory_of_watch(n).symbols("memory"), ca.SX.sym("measured", n), ca.SX.sym("command", n)
    valid, known = ca.sum1(ca.fabs(measured)) <= MAX_MAGNITUDE, memory.since > 0
    seen = ca.if_else(valid, measured, memory.seen)
    step = seen - memory.seen
    # Farther than a joint goes, or never seen before: states that are not one motion of it. The way begins anew.
    most = ca.DM(2 * np.minimum(chain.velocity, MAX_MAGNITUDE)) * memory.since + window * known
    one_motion = ca.fabs(step) <= most
    way = dt * command
    led, apart = keep * memory.led + way, ca.if_else(one_motion, keep * memory.apart + way - step, 0)
    placed = memory.placed
    if base:
        placed = ca.logic_or(placed, known * ca.sum1(ca.fabs(step[:base])) > 0)
        one_motion[:base] *= placed
    if base_alone:
        one_motion[base:] = 0
    led *= one_motion
    judged = valid * (ca.fabs(led) > window)
    # moved sign(led) < SHARE |led|, with moved = led - apart
    lost = ca.logic_and(judged, led * (apart - (1 - SHARE) * led) > 0)
    goes_on = 1 - judged + lost
    still = ca.sum1(ca.fabs(step)) == 0
    after = memory_of_watch(n).of(
        wrong=one_motion * time_apart(memory.wrong, lost, dt * valid), apart=goes_on * apart, led=goes_on * led,
        seen=seen, since=ca.logic_or(valid, known) * (dt + still * ca.fmin(memory.since, STANDS)), placed=placed,
    )  # fmt: skip
    return ca.Function("watched_joints", [memory.column, measured, command], [after, ca.mmax(after[:n])])


def not_followed(name: str, far: float, fault: float) -> str:
    """What is said of a joint at fault, `far` [rad or m] from where it was led, by the kind of fault."""
    if fault == HAND_HELD:
        return f"{name} does not follow: the hand is held back, the joint by {far:.2g} rad or m"
    return f"{name} does not follow: {far:.2g} rad or m from where it was led"
