"""Where led joints are, tick by tick: a model of delay and servo beside what the encoders read."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import casadi as ca

from rehab_opt.control.held_hand import HELD, hand_memory, held_hand, largest
from rehab_opt.control.joint_feedback import JointFeedback
from rehab_opt.control.watched_joints import HAND_HELD, time_apart
from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.optim.certificate import all_true, clipped
from rehab_opt.optim.rows import MAX_MAGNITUDE
from rehab_opt.symbolic.record import Record

__all__ = ["SAID", "FollowedJoints", "guidance"]

MAX_TICKS, ROUNDING = 128, 1e-6
"""Longest delay, in ticks; what of a tick is none."""
LIVELY = 0.1
"""[rad/s or m/s] Joints that are slower are followed slower, by the square of their speed."""
SAID = Record(fault=1, joint=1, far=1, touched=1, held=1)
"""Of a tick: the fault, 0 for none, the joint that it is of, by how much that does not follow [rad or m]; whether the
hand is held from now on, and whether it is held."""


@cache
def guidance(n: int) -> Record:
    """What a tick knows of led joints: from there to where they are, as task and as limits have it (n,); by how much
    servos are slower than the command at them [rad/s or m/s] (n,); how early a target must be taken [s]; and `HELD`.
    All zero where nothing is measured, as in a plan.
    """
    held = {name: place.stop - place.start for name, place in HELD.places.items()}
    return Record(strays=n, apart=n, behind=n, early=1, **held)


class FollowedJoints:
    """n led joints, once a tick.

    Parameters
    ----------
    feedback : what is known of the robot. n : how many joints. dt : [s] a tick.
    chain : of the hand that is watched for contact; None for none.

    Raises
    ------
    ConfigurationError : a delay of more than 128 ticks.

    Attributes
    ----------
    size : how many numbers are remembered. hand : whether a hand is watched.
    tick : memory, measured positions, last command (n,) -> memory, where the joints are led (n,), what `guidance` names
        (without a hand, where they are from there on (n,), as limits have it), the command to go on from (n,), `SAID`.
    start : velocities (n,) -> memory where nothing else is known.
    """

    def __init__(self, feedback: JointFeedback, n: int, *, dt: float, chain: SerialChain | None = None) -> None:
        if not isinstance(feedback, JointFeedback):
            raise ConfigurationError("feedback", feedback, "a JointFeedback, or None for measured positions")
        ticks = max(math.ceil(feedback.delay / dt - ROUNDING), 0)
        if ticks > MAX_TICKS:
            raise ConfigurationError("feedback.delay", feedback.delay, f"at most {MAX_TICKS} ticks of {dt:g} s")
        self._n, self.hand = n, chain is not None
        self.memory = _memory(n, ticks, hand=self.hand)
        self.size = self.memory.size
        self.tick = self._tick(feedback, dt=dt, chain=chain)
        self.start = self._start(feedback)

    def _start(self, feedback: JointFeedback) -> ca.Function:
        n, record = self._n, self.memory
        velocity, column = ca.SX.sym("velocity", n), ca.SX.zeros(record.size)
        for name in ("v", "commands"):
            place = record.places[name]
            column[place] = ca.repmat(velocity, (place.stop - place.start) // n, 1)
        column[record.places["w"]] = servo_after(feedback, velocity, velocity, velocity, math.inf)[1]
        if record["hand"] < record.size:
            at = record["hand"] + hand_memory(n)["velocity"]
            column[at : at + n] = velocity
        return ca.Function("led_from", [velocity], [column])

    def _tick(self, feedback: JointFeedback, *, dt: float, chain: SerialChain | None) -> ca.Function:
        n, record = self._n, self.memory
        memory = record.symbols("memory")
        measured, command = ca.SX.sym("measured", n), ca.SX.sym("command", n)
        tolerance = feedback.tolerance
        valid = all_true(ca.fabs(measured) <= MAX_MAGNITUDE)
        commands = ca.vertcat(command, memory.commands)
        under_way, arrived = commands[:-n], commands[-n:]
        # Where the delay ends within a tick, the oldest command acts until then, the next one for the rest.
        rest = under_way.numel() // n * dt - feedback.delay
        rest = rest if rest > ROUNDING * dt else 0.0
        acting = [(arrived, dt - rest), *([(under_way[-n:], rest)] if rest else [])]
        v, w, expected = memory.v, memory.w, memory.q
        for arrived, seconds in acting:
            v, w = servo_after(feedback, v, w, arrived, seconds)
            expected += seconds * arrived
        expected += memory.w - w
        anew = ca.logic_and(valid, ca.logic_not(memory.known))
        error = ca.if_else(ca.logic_and(valid, memory.known), measured - expected, 0)
        follows = ca.fabs(error) <= tolerance
        wrong = ca.if_else(valid, time_apart(memory.wrong, 1 - follows, dt), memory.wrong)
        q = ca.if_else(anew, measured, expected + min(feedback.correction * dt, 1) * follows * error)
        pace = ca.fmin(ca.mmax(ca.fabs(v)) / LIVELY, 1) ** 2
        used = -math.expm1(-feedback.following * dt) * ca.logic_and(valid, follows)
        after = {
            "wrong": wrong, "error": error, "q": q, "v": v, "w": w, "commands": under_way,
            "strays": memory.strays + pace * used * (error - memory.strays),
            "apart": memory.apart + used * (error - memory.apart),
            "known": ca.logic_or(memory.known, valid),
        }  # fmt: skip
        # What is no position stays what it is, for whoever names it; so do its others while none is known.
        led = q + dt * ca.sum2(ca.reshape(under_way, n, under_way.numel() // n)) - rest * arrived + w
        led = ca.if_else(ca.logic_and(ca.fabs(measured) <= MAX_MAGNITUDE, after["known"]), led, measured)
        longest, joint = largest(wrong)
        fault, guided, touched, held = longest > feedback.patience, after["apart"], ca.SX(0), ca.SX(0)
        after["hand"] = memory.hand
        if chain is not None:
            before = hand_memory(n).parts(memory.hand)
            seen = clipped(error, -tolerance, tolerance)
            felt = held_hand(chain, feedback, dt, before, led, seen, v)
            # A sample that is no number says nothing of the hand, and must not be remembered.
            after["hand"] = ca.if_else(valid, felt.memory, memory.hand)
            touched, stuck = ca.logic_and(valid, felt.touched), valid * felt.stuck * (1 - fault)
            joint, fault = ca.if_else(stuck, felt.joint, joint), fault + HAND_HELD * stuck
            state = HELD.parts(after["hand"][: HELD.size])
            held, early = state.held, ca.SX(feedback.command_delay)
            guided = guidance(n).of(
                strays=after["strays"], apart=after["apart"], behind=arrived - v, early=early,
                held=held, way=state.way, room=state.room,
            )  # fmt: skip
        far = sum((ca.if_else(joint == i, ca.fabs(error[i]), 0) for i in range(n)), ca.SX(0))
        kept = ca.if_else(memory.fault[0] > 0, memory.fault, ca.vertcat(fault, joint, far))
        said = ca.vertcat(kept, touched, held)
        outputs = [record.of(**after, fault=kept), led, guided, ca.if_else(touched, 0, command), said]
        inputs = [memory.column, measured, command]
        return ca.Function("led_joints", inputs, [ca.densify(each) for each in outputs], {"cse": True})


@cache
def _memory(n: int, ticks: int, *, hand: bool) -> Record:
    """What is remembered: for how long each joint does not follow [s], and its following error; where the model's
    joints are, how fast, and how far behind their servos hold them [rad or m]; that error as the task and the limits
    know it; commands under way, the newest first; the first three of `SAID`, kept; what the hand's watch remembers.
    """
    size = hand_memory(n).size if hand else 0
    return Record(wrong=n, error=n, q=n, v=n, w=n, strays=n, apart=n, commands=n * ticks, known=1, fault=3, hand=size)


def servo_after(feedback: JointFeedback, v: Any, w: Any, u: Any, seconds: float) -> tuple[Any, Any]:
    """Velocity v and position error w of servos some seconds into a command u, solved exactly.

    v' = 2 p (u - v) + p^2 w, w' = u - v, of a proportional-integral loop with both poles at -p; without integral action
    v = p w. What differs from rest, in v = u and w = 0 or u/p, fades.
    """
    p, t = feedback.pole, seconds
    rest = 0 * u if feedback.integral_action else u / p
    if not p * t < 700.0:
        return u, rest
    short, lacks, fading = v - u, w - rest, math.exp(-p * t)
    if not feedback.integral_action:
        return u + fading * p * lacks, rest + fading * lacks
    faster = fading * (1 - p * t) * short + fading * p * p * t * lacks
    return u + faster, -fading * t * short + fading * (1 + p * t) * lacks
