"""Limit a reference pose to a person's range of motion: a model arm tracks it, and the model's hand is the result."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.between_poses import moving_tool_function
from rehab_opt.control.pose_tracker import PoseTracker
from rehab_opt.control.velocity_controller import real_numbers
from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.kinematics.rigid import rigid
from rehab_opt.optim.certificate import all_true, clipped
from rehab_opt.symbolic import BufferedFunction, Compile

__all__ = ["PersonLimit", "model_tick"]

Array = NDArray[np.float64]

TURN_LENGTH = 0.1
"""[m/rad] Weight of the hand's rotation relative to its position."""
SETTLING, SETTLING_DT = 300, 0.05
"""Largest number of ticks, and their length [s], in which the model converges to the first pose."""
SETTLED = 1e-6
"""[rad/s] Joint speeds below which the model has converged."""
GAIN = 30.0
"""[1/s] Rate at which the model arm's pose error decays."""


def model_tick(chain: SerialChain) -> ca.Function:
    """Function: posture (n,), joint velocities (n,), time [s], ticks left -> posture, ticks left, pose (16,), twist
    (6,).

    The ticks left are for convergence to the first pose; 0 once it is reached. Pose and twist are those of the model's
    hand.
    """
    q, velocity, seconds = ca.SX.sym("q", chain.n), ca.SX.sym("velocity", chain.n), ca.SX.sym("seconds")
    ticks = ca.SX.sym("ticks")
    after = clipped(q + velocity * seconds, ca.DM(chain.lower), ca.DM(chain.upper))
    stands = all_true(ca.fabs(velocity) <= SETTLED)
    outputs = [after, ca.if_else(stands, 0, ca.fmax(ticks - 1, 0)), *moving_tool_function(chain)(after, velocity)]
    return ca.Function("model_tick", [q, velocity, seconds, ticks], outputs)


class _Model(PoseTracker):
    """Tracker of the model arm; its joints are set directly, so they are not supervised."""

    watched = False

    def self_motion(self, q: ca.SX, turn: ca.SX, jacobian: ca.SX, seconds: ca.SX, braking: ca.SX) -> ca.SX:
        return ca.SX.zeros(self.chain.n)


class PersonLimit:
    """Pose nearest to a moving reference that a model arm with the person's range of motion can follow.

    The model arm satisfies its joint limits exactly and never jumps. From another start posture, the model may reach
    more poses.

    Parameters
    ----------
    person : the arm, with finite limits, in the robot's base frame (`dataclasses.replace(human_arm(...), base=...)`).
    grip : (4, 4) pose of the robot's tool in the arm's hand frame.
    start : (n,) [rad] start of the search for the first pose; default the middle of the range of motion.
    dt : tick [s]. backup, compile : as for `PoseTracker`.
    """

    def __init__(
        self,
        person: SerialChain,
        *,
        grip: ArrayLike,
        dt: float,
        start: ArrayLike | None = None,
        backup: str | None = None,
        compile: Compile = None,
    ) -> None:
        if not isinstance(person, SerialChain) or not np.all(np.isfinite([person.lower, person.upper])):
            raise ConfigurationError("person", person, "a SerialChain with finite joint limits")
        chain = replace(person, tool=person.tool @ rigid("grip", grip), acceleration=np.full(person.n, np.inf))
        self.chain = chain
        self.start: Array = (person.lower + person.upper) / 2
        """(n,) [rad] start posture of the model."""
        if start is not None:
            self.start = real_numbers("start", start, (person.n,))
            if not np.all((self.start >= person.lower) & (self.start <= person.upper)):
                raise ConfigurationError("start", start, "a posture within the person's range of motion")
        weights = [1.0, 1.0, 1.0, *(TURN_LENGTH**2,) * 3]

        def tracker(dt: float) -> PoseTracker:
            return _Model(
                chain, dt=dt, gain=GAIN, linear_speed=3.0, angular_speed=10.0, task_weights=weights, backup=backup,
                compile=compile,
            )  # fmt: skip

        self._tracker, self._settler = tracker(dt), tracker(SETTLING_DT)
        self._tick = BufferedFunction(model_tick(chain))
        self.reset()

    def reset(self) -> None:
        """Reset to `start`."""
        self.q: Array | None = None
        """(n,) posture of the model [rad]; None before the first pose."""
        self._tracker.reset()
        self._settler.reset()
        self._settling = float(SETTLING)
        """Remaining ticks for convergence to the first pose; 0 once it is reached."""

    def settle(self, pose: Array, *, ticks: int = SETTLING) -> bool:
        """Converge to the first pose in at most `ticks` ticks; return whether the model has converged."""
        if self.q is None:
            self.q = self.start.copy()
        while self._settling > 0 and ticks > 0:
            ticks -= 1
            self._settling = float(self._go(self._settler, pose, np.zeros(6))[1][0])
        return self._settling == 0.0

    def limited(self, pose: Array, twist: Array) -> tuple[Array, Array]:
        """Pose (4, 4) and twist (6,) of the model's hand after this tick."""
        self.settle(pose)
        *_, pose, twist = self._go(self._tracker, pose, twist)
        return pose.reshape(4, 4).copy(), twist.copy()

    def _go(self, tracker: PoseTracker, pose: Array, twist: Array) -> tuple[Array, ...]:
        assert self.q is not None
        self.q = self._tick.of(self.q, tracker.step(self.q, pose, twist).value, tracker.dt, self._settling)
        return self._tick.outputs
