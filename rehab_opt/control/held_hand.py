"""Contact of the hand detected by its lag in space, long before a joint's following error is large.

The joints' following error is e (n,). A joint under dry friction follows f behind, and where it turns round it stands
still until it is led from f on one side to f on the other: a play y, y' = q' within -f <= y <= f; f is learned while it
slips. The rest of the hand's lag d = J (e + y) changes slowly in a steady motion. Without that slow part, against the
direction of motion, it is

    s = -(d - d_usual) . v / |v|,   v = J q',

of a hand that is free at most

    min(|J' v| / |v|, 1) contact + COUPLED sum_j |J_j| |q''_j| / p^2 + LATE |v - v_usual|:

a servo tuned to another inertia lags by a fraction of p^-2 q'', and an error of the delay shows where the speed
changes. A joint that brakes hard may rest elsewhere within f than y says, and is in doubt by u until it has slipped,

    u' = 2 |q''| / p - |q'|   within 0 <= u <= f;

s leaves out of d_usual . v / |v| > 0 what sum_j |J_j . v| u_j / |v| explains. Where s is more in two ticks (one sample
may lie), the hand is held. Then

- the joints' commands begin anew at rest: what was stopped may be stopped in the command, too;
- along the way v the hand may be led no further than 0.75 `contact` ahead of where it usually is, `room`;
- commanded speeds are those of recovery, until the hand has been free for CALM.
"""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

import casadi as ca

from rehab_opt.control.joint_feedback import COUPLED, JointFeedback
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.symbolic.record import Record, Values

__all__ = ["HELD", "Felt", "hand_memory", "held_hand", "largest"]

SLIPS = 2.0
"""[1/s] Rate at which f is learned: a contact is noticed long before it is taken for friction."""
USUAL = 20.0
"""[1/s] Rate at which a following error becomes the usual one: a contact outgrows it within a third of that time."""
LATE = 0.003
"""[s] Largest error of the given delay."""
SLOWEST = 0.02
"""[m/s] Hands that are slower have no way that they could be held on."""
CALM = 2.0
"""[s] for which a hand must be free until it is led as usual: a person's time to draw back."""
NOT_FREE, MEAN, LONGER = 0.6, 0.02, 2.25
"""Of `contact`, what a hand that is let go of has as room, in the mean of so many seconds, before that many times the
patience; a hand that other joints lead round one that is jammed has not."""
HELD = Record(held=1, way=3, room=1)
"""Whether the hand is held; the way that it was held on; how far it may be led on along that [m]."""


@cache
def hand_memory(n: int) -> Record:
    """What is remembered of a hand: what `HELD` names, and last f, y, u and how fast its n joints should have been."""
    return Record(held=1, way=3, room=1, usual=3, going=3, before=1, swing=1, over=1, free=1, pressed=1, mean=1,
        short=1, joint=1, known=1, friction=n, play=n, doubt=n, velocity=n)  # fmt: skip


class Felt(NamedTuple):
    """Result of one tick of the contact watch."""

    memory: ca.SX
    """What `hand_memory` names."""
    touched: ca.SX
    """Whether it is held from this tick on."""
    stuck: ca.SX
    """Whether it was held for longer than the patience."""
    joint: ca.SX
    """Number of the joint that had the largest part in it."""


def held_hand(  # noqa: PLR0917  (what is known, then what a tick brings)
    chain: SerialChain, feedback: JointFeedback, dt: float, memory: Values, q: ca.SX, error: ca.SX, velocity: ca.SX
) -> Felt:  # fmt: skip
    """One tick of the contact watch.

    Parameters
    ----------
    chain : the arm. feedback : what is known of it. dt : [s] a tick.
    memory : what `hand_memory` names. q : (n,) where the joints are led.
    error, velocity : (n,) their following error, and how fast they should be.
    """
    contact, patience, pole = feedback.contact, feedback.patience, feedback.pole
    usually, fades = -math.expm1(-USUAL * dt), math.exp(-min(pole / 2, 1 / dt) * dt)
    moves = chain.jacobian_expression(q)[:3, :]
    play, friction = memory.play + dt * velocity, memory.friction
    slips, play = ca.fabs(play) > friction, ca.fmax(ca.fmin(play, friction), -friction)
    behind, motion = moves @ (error + play), moves @ velocity
    speed = ca.norm_2(motion)
    along = motion / ca.fmax(speed, SLOWEST)

    levers = ca.vertcat(*map(ca.norm_2, ca.horzsplit(moves)))
    change = ca.fabs(velocity - memory.velocity)
    swing = ca.fmax(ca.dot(levers, change) * pole**-2 / dt, fades * memory.swing)
    was_held = memory.held > 0
    usual = ca.if_else(memory.known, memory.usual, behind)
    lever = ca.fmin(ca.norm_2(moves.T @ along), 1)  # what encoders' noise makes of the hand on this way
    explained = lever * contact + COUPLED * swing + LATE * ca.norm_2(motion - memory.going)
    doubt = ca.fmax(ca.fmin(memory.doubt + 2 * change / pole - dt * ca.fabs(velocity), friction), 0)
    ahead = ca.dot(usual, along)
    ahead -= ca.fmin(ca.fmax(ahead, 0), ca.dot(ca.fabs(moves.T @ along), doubt))
    over = ahead - ca.dot(behind, along) > explained
    touched = ca.logic_and(ca.logic_not(was_held), ca.logic_and(over, memory.over))

    way = ca.if_else(touched, along / ca.fmax(ca.norm_2(along), 1e-12), memory.way)
    before = ca.if_else(touched, -ca.dot(usual, way), memory.before)
    room = 0.75 * contact + before + ca.dot(behind, way)
    pressed = room < contact / 4
    held = ca.logic_or(touched, was_held)
    free = ca.if_else(pressed, 0, memory.free + dt)
    mean = ca.if_else(touched, room, memory.mean - math.expm1(-dt / MEAN) * (room - memory.mean))
    short = ca.if_else(mean < NOT_FREE * contact, memory.short + dt, 0)
    waits = memory.pressed + dt * ca.if_else(pressed, 1, -patience / CALM)
    held = ca.logic_and(held, free <= CALM)
    fractions = ca.fabs((moves.T @ way) * error)
    joint = ca.if_else(touched, largest(fractions)[1], memory.joint)
    learned = -math.expm1(-SLIPS * dt) * slips * ca.logic_not(ca.logic_or(held, over))
    friction = friction + learned * (ca.fmax(-ca.sign(velocity) * error, 0) - friction)
    after = hand_memory(chain.n).of(
        going=memory.going + usually * (motion - memory.going),
        held=held, way=way, room=room, before=before, swing=swing, over=over, joint=joint,
        usual=ca.if_else(held, usual, usual + usually * (behind - usual)),
        free=held * free, pressed=held * ca.fmax(waits, 0), mean=mean, short=held * short, known=ca.SX(1),
        friction=friction, play=play, doubt=doubt, velocity=velocity,
    )  # fmt: skip
    stuck = ca.logic_or(waits > patience, short > LONGER * patience)
    return Felt(after, touched, ca.logic_and(held, stuck), joint)


def largest(numbers: ca.SX) -> tuple[ca.SX, ca.SX]:
    """The largest of (n,), and the first place where it is."""
    most, place = numbers[0], ca.SX(0)
    for i in range(1, numbers.numel()):
        place, most = ca.if_else(numbers[i] > most, i, place), ca.fmax(most, numbers[i])
    return most, place
