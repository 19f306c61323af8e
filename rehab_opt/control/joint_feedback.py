"""Which joint positions a controller acts on, on a robot whose servos are late and whose encoders are noisy."""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np

from rehab_opt.control.stopping import FAR
from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.kinematics.real_array import is_real

__all__ = ["JointFeedback"]

COUPLED = 0.5
"""Share of the inertia a servo is tuned to that a posture, or the motion of another joint, adds or takes away."""


@dataclass(frozen=True, kw_only=True)
class JointFeedback:
    """Act on where the joints are led, not on where they are measured: for late servos and noisy encoders.

    A measured position is old by the delay, and commands are still on their way. A controller that closes its loop over
    it turns a limit into a limit cycle and noise into motion. Here it acts on its own reference q_led instead, the
    joints' positions once all commands have arrived, as position interfaces of industrial robots want it. A model of
    delay and servo says what the encoders should read now; what they read differently is the following error e:

        e = q_measured - q_model,   q_led' = command + correction e,   d' = following (e - d) while the joints move,
        q_model = q_led, `delay` late and behind the servo, moved by the same corrections

    - The task's error is that of q_led + d: what friction holds back is led after. Joints that hardly move leave d as
      it is: integrated there, it would make sticking joints hunt, and turn noise into motion.
    - Position limits hold for q_led and for q_led + e (at the same rate, at rest, too), and joints come to them no
      nearer than others that brake may throw them off (`deviation`).
    - The target is taken to be where its twist leads it while a command is on its way (`command_delay`).
    - A hand that runs into something is noticed by where it is left behind (`held_hand`): the joints are led from rest
      anew, back to where the hand presses hardly, and no faster than `recovery_speed` (a share of the hand speeds, too)
      until the hand has been free for two seconds. One that is held for longer than `patience`, or not let go of in
      2.25 times that, is a fault. Where they begin anew faster than accelerations allow, that yields
      (`Relaxed.ACCELERATION`).

    The watch sees the hand alone, from 0.02 m/s on, and late near a singular posture. Where that is too much (see "Real
    servos" of the documentation), measure forces.

    A following error above `tolerance` for longer than `patience` is a joint that is blocked, an encoder that stands
    still, or an axis that turns the wrong way: the controller brakes, says which joint, and rests until `reset`, or
    until `enable` was released. An error that large corrects nothing, and a sample that is no number neither ends nor
    hides a fault. Nor does it change d, or what is known of the hand.

    Parameters
    ----------
    delay : [s] from a command until the joint moves, and from a position until `step` gets it, together; at most 128
        ticks, whole or not. Rather too much than too little: 3 ms more are no harm.
    servo_hz : [Hz] bandwidth of the velocity servo, -3 dB; infinite for joints that move as commanded.
    integral_action : whether a joint that moves steadily is where its commands lead: its servo has integral action, or
        feeds the speed forward. Without, as q' = k (q_commanded - q), it is behind by speed / k, k = 2 pi `servo_hz`.
    correction : [1/s] rate at which the reference comes to the measured positions. Slow: noise passes by its square
        root, and an error that a joint makes at less than `correction` times `tolerance` is no fault.
    following : [1/s] rate c at which the task's error takes over the following error of joints that move. With a gain
        g, the loop that is left has g c / ((s + g)(s + c)) times what robot and model differ by: never more than that,
        so that a delay that is another one by 3 ms, or twice an inertia, leaves it stable at any g and c.
    contact : [m] by which the hand of an arm that moves freely is not left behind all of a sudden at a steady speed, on
        a way on which its joints have a lever of 1 m together; less on others. Five times what 0.2 mrad of noise in
        each encoder make of it. A noisier arm needs more, or stops by itself: 0.003 where encoders have 12 bits.
    tolerance : [rad or m] following error that is none.
    patience : [s] for which a larger one, or a held hand, is no fault.

    Raises
    ------
    ConfigurationError : a number that cannot be used.
    """

    delay: float = 0.005
    servo_hz: float = 24.0
    integral_action: bool = True
    correction: float = 0.05
    following: float = 200.0
    contact: float = 0.001
    tolerance: float = 0.03
    patience: float = 0.1

    def __post_init__(self) -> None:
        if not isinstance(self.integral_action, bool):
            raise ConfigurationError("feedback.integral_action", self.integral_action, "True or False")
        for name in self.__dataclass_fields__.keys() - {"integral_action"}:
            least = -1e-12 if name in ("delay", "patience") else 0.0
            value = getattr(self, name)
            most = math.inf if name == "servo_hz" else 1e3
            if not (is_real(value) and least < value <= most):
                above = "of at least 0" if least else "above 0"
                end = "" if most == math.inf else f" and at most {most:g}"
                raise ConfigurationError(f"feedback.{name}", value, f"a number {above}{end}")

    @property
    def command_delay(self) -> float:
        """[s] from a command until the joint moves: half of the delay, which is all that is known of it."""
        return self.delay / 2

    def deviation(self, chain: SerialChain, last: ca.SX) -> ca.SX:
        """[rad or m] by which a joint may be thrown off where it is led, by any that brakes from `last` (n,).

        A servo is thrown off by a/p^2 of an acceleration a that lasts, and by v/(e p) of a speed v that ends at once. A
        posture or another joint makes the share COUPLED of it.
        """
        p = self.pole
        each = ca.fmin(ca.DM(np.minimum(chain.acceleration, FAR) / p**2), ca.fabs(last) / (math.e * p))
        return COUPLED * ca.mmax(each)

    @property
    def max_gain(self) -> float:
        """[1/s] 2/(3 (T + 1/p)) of the delay T and the servo's pole p: largest gain on what is measured.

        An integrator with this gain crosses unity there; T takes at most 2/3 rad of its phase, and the servo,
        (2 p s + p^2)/(s + p)^2, nearly none: 50 degrees remain, enough for 3 ms and for inertias unlike its own.
        """
        late = self.delay + 1 / self.pole
        return 2 / (3 * late) if late > 0 else math.inf

    @property
    def approach(self) -> float:
        """[1/s] rate at which limits are approached: a third of the servo's pole, so that it does not run past them."""
        return self.pole / 3

    @property
    def pole(self) -> float:
        """[1/s] p of a servo with both poles at -p, -3 dB at 2.48 p; or k."""
        return 2 * math.pi * self.servo_hz / (2.4818 if self.integral_action else 1)
