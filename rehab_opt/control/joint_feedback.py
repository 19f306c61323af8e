"""Which joint positions a controller acts on, on a robot whose servos are late and whose encoders are noisy."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.optim.certificate import all_true
from rehab_opt.optim.rows import PLAUSIBLE
from rehab_opt.symbolic import BufferedFunction
from rehab_opt.symbolic.record import Record

__all__ = ["FollowedJoints", "JointFeedback"]

Array = NDArray[np.float64]

MOST_TICKS = 128
"""Longest delay, in ticks."""


@dataclass(frozen=True, kw_only=True)
class JointFeedback:
    """Act on where the joints are led, not on where they are measured: for late servos and noisy encoders.

    A measured position is old by the delay, and commands are still on their way. A controller that closes its loop over
    it turns a limit into a limit cycle and noise into motion. Here it acts on its own reference instead, the joints'
    positions once all commands have arrived, as position interfaces of industrial robots want it. A model of delay and
    servo says what the encoders should read now; what they read differently is the following error, of which the share
    `correction` dt goes into the reference in each tick:

        e = q_measured - q_model,  reference' = command + correction e,
        q_model = the reference, `delay` late and behind the servo, moved by the same corrections

    A following error above `tolerance` for longer than `patience` is a joint that is blocked, an encoder that stands
    still, or an axis that turns the wrong way: the controller brakes, says which joint, and rests until `reset`, as
    drives do: a servo that was held may still push by what it lags behind. An error that large corrects nothing, and a
    sample that is no number neither ends nor hides a fault.

    Limits hold for where the joints are led. The joints themselves may be beyond one by the following error: where the
    servo has caught up that is nothing, but up to `tolerance` is no fault.

    Parameters
    ----------
    delay : [s] from a command until the joint moves, and from a position until it is told, together; at most 128 ticks.
        3 ms more or less are no harm.
    servo_hz : [Hz] bandwidth of the velocity servo; infinite for joints that move as commanded.
    correction : [1/s] rate at which the reference comes to the measured positions. Slow: noise passes by its square
        root, and an error that a joint makes at less than `correction` times `tolerance` is no fault.
    tolerance : [rad or m] following error that is none.
    patience : [s] for which a larger one is no fault.

    Raises
    ------
    ConfigurationError : a number that cannot be used.
    """

    delay: float = 0.005
    servo_hz: float = 24.0
    correction: float = 0.05
    tolerance: float = 0.03
    patience: float = 0.1

    def __post_init__(self) -> None:
        """Check every number."""
        for name, least in (
            ("delay", -1e-12), ("servo_hz", 0.0), ("correction", 0.0), ("tolerance", 0.0), ("patience", -1e-12),
        ):  # fmt: skip
            value = getattr(self, name)
            most = math.inf if name == "servo_hz" else 1e3
            if not (isinstance(value, float | int | np.floating | np.integer) and least < value <= most):
                raise ConfigurationError(f"feedback.{name}", value, f"a number above {least:g}")

    @property
    def approach(self) -> float:
        """[1/s] rate at which limits are approached: a third of the servo's pole, so that it does not run past them."""
        return pole(self.servo_hz) / 3


def pole(servo_hz: float) -> float:
    """[1/s] p, of a proportional-integral velocity servo with both poles at -p: -3 dB at 2.48 p."""
    return 2 * math.pi * servo_hz / 2.4818


@cache
def _record(n: int, ticks: int) -> Record:
    """What is remembered: where the model's joints are, how fast, and how far behind their servos hold them [rad or m];
    commands under way, the newest first; for how long a joint does not follow [s], and once that is a fault, which
    joint, counted from 1, by how much.
    """
    return Record(q=n, v=n, w=n, sent=n * ticks, wrong=1, fault=1, far=1, known=1)


MODEL = Record(dt=1, v_v=1, v_w=1, w_v=1, w_w=1, correction=1, tolerance=1, patience=1)


@cache
def _followed(n: int, ticks: int) -> ca.Function:
    """`MODEL`, memory, measured positions (n,), last command (n,) -> memory, reference (n,), joint at fault, error."""
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
    size, worst = ca.fabs(error[0]), ca.SX(1)
    for i in range(1, n):
        worst, size = ca.if_else(ca.fabs(error[i]) > size, i + 1, worst), ca.fmax(size, ca.fabs(error[i]))
    waits = ca.if_else(size > model.tolerance, memory.wrong + model.dt, ca.fmax(memory.wrong - model.dt, 0))
    wrong = ca.if_else(usable, waits, memory.wrong)
    new = ca.logic_and(wrong > model.patience, ca.logic_not(memory.fault))
    fault, far = ca.if_else(new, worst, memory.fault), ca.if_else(new, size, memory.far)
    share = ca.fmin(model.correction * model.dt, 1) * (ca.fabs(error) <= model.tolerance)
    q = ca.if_else(anew, measured, expected + share * error)
    under_way = model.dt * ca.sum2(ca.reshape(sent[: n * ticks], n, ticks)) + w
    after = record.of(
        q=q, v=v, w=w, sent=sent[: n * ticks], wrong=wrong, fault=fault, far=far,
        known=ca.logic_or(memory.known, usable),
    )  # fmt: skip
    # What is no position stays what it is, for whoever names it.
    reference = ca.if_else(ca.fabs(measured) <= PLAUSIBLE, q + under_way, measured)
    said = ca.vertcat(fault, ca.if_else(fault, far, size))
    inputs = [model.column, memory.column, measured, command]
    return ca.Function("followed_joints", inputs, [after, ca.densify(reference), said], {"cse": True})


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


class FollowedJoints:
    """The memory of a `JointFeedback`; call it once a tick.

    Parameters
    ----------
    feedback : what is known of the robot. names : (n,) of its joints. dt : [s] a tick.

    Raises
    ------
    ConfigurationError : a delay of more than 128 ticks.
    """

    error: float = 0.0
    """[rad or m] the largest following error of the last tick; once a joint is at fault, that of the fault."""

    def __init__(self, feedback: JointFeedback, names: tuple[str, ...], *, dt: float) -> None:
        if not isinstance(feedback, JointFeedback):
            raise ConfigurationError("feedback", feedback, "a JointFeedback, or None for measured positions")
        ticks = round(feedback.delay / dt)
        if ticks > MOST_TICKS:
            raise ConfigurationError("feedback.delay", feedback.delay, f"at most {MOST_TICKS} ticks of {dt:g} s")
        self._names, self._record = names, _record(len(names), ticks)
        self._function = BufferedFunction(_followed(len(names), ticks))
        model, self._memory, self._measured, self._command = self._function.inputs
        self._after, self._reference, self._said = self._function.outputs
        model[:] = MODEL.numbers(
            dt=dt,
            **servo_rates(feedback.servo_hz, dt),
            correction=feedback.correction,
            tolerance=feedback.tolerance,
            patience=feedback.patience,
        )

    def reset(self, velocity: Array) -> None:
        """Nothing is known but what the joints do now (n,)."""
        self._memory[:] = 0.0
        for name in ("v", "sent"):
            place = self._record.places[name]
            self._memory[place] = np.tile(velocity, (place.stop - place.start) // len(velocity))

    def lead(self, q: Array, last: Array) -> str:
        """Put the reference into `q` (n,) in place of what was measured, after the command `last` (n,).

        Returns why the joints do not follow; empty where they do.
        """
        self._measured[:], self._command[:] = q, last
        self._function.evaluate()
        self._memory[:], q[:] = self._after, self._reference
        joint, self.error = self._said.tolist()
        if not joint:
            return ""
        return f"{self._names[int(joint) - 1]} does not follow: {self.error:.2g} rad or m from where it was led"
