"""Where led joints are, tick by tick: a model of delay and servo beside what the encoders read."""

from __future__ import annotations

import math
from functools import cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.held_hand import HELD, HeldHand
from rehab_opt.control.joint_feedback import JointFeedback, pole
from rehab_opt.control.watched_joints import NOT_FOLLOWED, not_followed, time_apart
from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.optim.certificate import all_true, clipped
from rehab_opt.optim.rows import PLAUSIBLE
from rehab_opt.symbolic import BufferedFunction
from rehab_opt.symbolic.record import Record

__all__ = ["FollowedJoints", "guidance"]

Array = NDArray[np.float64]

MOST_TICKS = 128
"""Longest delay, in ticks."""
LIVELY = 0.1
"""[rad/s or m/s] Joints that are slower are followed slower, by the square of their speed."""
HELD_BACK = "the hand was held back: led at recovery speed until it is free for two seconds"


@cache
def _record(n: int, ticks: int) -> Record:
    """What is remembered: for how long each joint does not follow [s], and its following error; where the model's
    joints are, how fast, and how far behind their servos hold them [rad or m]; that error as the task and the limits
    know it; commands under way, the newest first.
    """
    return Record(wrong=n, error=n, q=n, v=n, w=n, strays=n, apart=n, sent=n * ticks, known=1)


MODEL = Record(dt=1, v_v=1, v_w=1, w_v=1, w_w=1, correction=1, following=1, tolerance=1)


@cache
def _followed(n: int, ticks: int) -> ca.Function:
    """`MODEL`, memory, measured positions, last command (n,) -> memory, reference, errors (n,), what is said of them.

    Said is for how long a joint does not follow at most [s], and whether the positions are usable.
    """
    record = _record(n, ticks)
    model, memory = MODEL.symbols("model"), record.symbols("memory")
    measured, command = ca.SX.sym("measured", n), ca.SX.sym("command", n)
    usable = all_true(ca.fabs(measured) <= PLAUSIBLE)
    sent = ca.vertcat(command, memory.sent)
    arrived = sent[n * ticks :]
    # Of a servo with v = u and w = 0 at rest in u, what differs from that fades as its double pole says.
    short = memory.v - arrived
    v = arrived + model.v_v * short + model.v_w * memory.w
    w = model.w_v * short + model.w_w * memory.w
    expected = memory.q + model.dt * arrived + memory.w - w
    anew = ca.logic_and(usable, ca.logic_not(memory.known))
    error = ca.if_else(ca.logic_and(usable, memory.known), measured - expected, 0)
    follows = ca.fabs(error) <= model.tolerance
    wrong = ca.if_else(usable, time_apart(memory.wrong, 1 - follows, model.dt), memory.wrong)
    share = ca.fmin(model.correction * model.dt, 1) * follows
    q = ca.if_else(anew, measured, expected + share * error)
    pace = ca.fmin(ca.mmax(ca.fabs(v)) / LIVELY, 1) ** 2
    used = model.following * ca.logic_and(usable, follows)
    apart = memory.apart + used * (error - memory.apart)
    strays = memory.strays + pace * used * (error - memory.strays)
    under_way = model.dt * ca.sum2(ca.reshape(sent[: n * ticks], n, ticks)) + w
    after = record.of(
        wrong=wrong, error=error, q=q, v=v, w=w, strays=strays, apart=apart, sent=sent[: n * ticks],
        known=ca.logic_or(memory.known, usable),
    )  # fmt: skip
    # What is no position stays what it is, for whoever names it.
    reference = ca.if_else(ca.fabs(measured) <= PLAUSIBLE, q + under_way, measured)
    said = ca.vertcat(ca.mmax(wrong), usable)
    seen = clipped(error, -model.tolerance, model.tolerance)
    inputs, outputs = [model.column, memory.column, measured, command], [after, ca.densify(reference), seen, said]
    return ca.Function("followed_joints", inputs, outputs, {"cse": True})


def servo_rates(hz: float, dt: float) -> dict[str, float]:
    """How what a velocity servo lacks fades in a tick: of a proportional-integral loop with both poles at -p.

    v' = 2 p (u - v) + p^2 w, w' = u - v for a command u, solved exactly.
    """
    p = pole(hz)
    if not p * dt < 700.0:
        return dict.fromkeys(("v_v", "v_w", "w_v", "w_w"), 0.0)
    fading = math.exp(-p * dt)
    return {
        "v_v": fading * (1 - p * dt), "v_w": fading * p * p * dt, "w_v": -fading * dt, "w_w": fading * (1 + p * dt),
    }  # fmt: skip


@cache
def guidance(n: int) -> Record:
    """What a tick knows of led joints: from there to where they are, as task and as limits have it (n,); how early a
    target must be taken [s]; and `HELD`. All of it is zero where nothing is measured, as in a plan.
    """
    return Record(strays=n, apart=n, early=1, **{name: place.stop - place.start for name, place in HELD.places.items()})


class FollowedJoints:
    """The memory of a `JointFeedback`; call it once a tick.

    Parameters
    ----------
    feedback : what is known of the robot. names : (n,) of its joints. dt : [s] a tick.
    chain : of the hand that is watched for contact; None for none.

    Raises
    ------
    ConfigurationError : a delay of more than 128 ticks.
    """

    touched: bool = False
    """Whether the hand is held from the last tick on."""
    note: str = ""
    """What is to be said of a tick without a fault."""
    errors: Array
    """(n,) following errors of the last tick [rad or m], within the tolerance."""

    def __init__(
        self, feedback: JointFeedback, names: tuple[str, ...], *, dt: float, chain: SerialChain | None = None
    ) -> None:
        if not isinstance(feedback, JointFeedback):
            raise ConfigurationError("feedback", feedback, "a JointFeedback, or None for measured positions")
        ticks = round(feedback.delay / dt)
        if ticks > MOST_TICKS:
            raise ConfigurationError("feedback.delay", feedback.delay, f"at most {MOST_TICKS} ticks of {dt:g} s")
        self._names, self._record = names, _record(len(names), ticks)
        self._function = BufferedFunction(_followed(len(names), ticks))
        model, self._memory, self._measured, self._command = self._function.inputs
        self._after, self._reference, self.errors, self._said = self._function.outputs
        places = self._record.places
        self._velocity, self._strays = (
            self._memory[places["v"]],
            self._memory[places["strays"].start : places["apart"].stop],
        )
        self._hand, self._fault, self._early, self._patience = None, "", feedback.command_delay, feedback.patience
        if chain is not None:
            self._hand = HeldHand(
                chain, contact=feedback.contact, patience=feedback.patience, pole=pole(feedback.servo_hz), dt=dt
            )
        model[:] = MODEL.numbers(
            dt=dt,
            **servo_rates(feedback.servo_hz, dt),
            correction=feedback.correction,
            following=-math.expm1(-feedback.following * dt),
            tolerance=feedback.tolerance,
        )

    def reset(self, velocity: Array) -> None:
        """Nothing is known but what the joints do now (n,)."""
        self._memory[:] = 0.0
        for name in ("v", "sent"):
            place = self._record.places[name]
            self._memory[place] = np.tile(velocity, (place.stop - place.start) // len(velocity))
        self.touched, self.note, self._fault = False, "", ""
        if self._hand is not None:
            self._hand.reset(velocity)

    @property
    def measured(self) -> Array:
        """(n,) positions of the last tick, as they were measured."""
        return self._measured

    def lead(self, q: Array, last: Array, guided: Array | None = None) -> str:
        """Put the reference into `q` (n,) in place of what was measured, after the command `last` (n,).

        Returns why the joints do not follow; empty where they do. What `guidance` names goes into `guided`; without a
        hand that is watched, where they are from there on (n,), as limits have it.
        """
        self._measured[:], self._command[:] = q, last
        self._function.evaluate()
        self._memory[:], q[:] = self._after, self._reference
        longest, usable = self._said.tolist()
        if longest > self._patience and not self._fault:
            self._fault = not_followed(self._names, self._memory)
        if guided is None:
            return self._fault
        if self._hand is None:
            guided[:] = self._memory[self._record.places["apart"]]
        else:
            # A sample that is no number says nothing of the hand, and must not be remembered.
            self.touched, stuck = self._hand.feel(q, self.errors, self._velocity) if usable else (False, "")
            state, n = self._hand.state, len(q)
            guided[: 2 * n], guided[2 * n], guided[2 * n + 1 :] = self._strays, self._early, state
            self.note = HELD_BACK if state[0] else ""
            if stuck and not self._fault:
                at = abs(self.errors[self._names.index(stuck)])
                self._fault = f"{stuck} {NOT_FOLLOWED}: the hand is held back, the joint by {at:.2g} rad or m"
        return self._fault
