"""Mirror therapy: joint velocities of an arm that leads a hand along the other hand's mirrored path.

This is a reconstruction of Xu, Guo, Zhang (2021), whose equations are not available to us. A QP replaces their search:
it follows the reference and keeps the manipulability above a floor.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from threading import get_ident
from typing import Any, ClassVar

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.between_poses import moving_tool_function
from rehab_opt.control.clearance import Clearance
from rehab_opt.control.command import Command, Relaxed, Status
from rehab_opt.control.hand_bounds import HandBounds, KeepOut
from rehab_opt.control.interaction import Interaction
from rehab_opt.control.judged_state import GIVEN
from rehab_opt.control.limit import Limit
from rehab_opt.control.manipulability import maximise_manipulability
from rehab_opt.control.mirror_following import BRIDGE, RATE, THEN
from rehab_opt.control.mirror_pace import FOLLOWED, REMEMBERED, MirrorPace
from rehab_opt.control.mirror_plan import MirrorPath, plan
from rehab_opt.control.mirror_preview import MirrorPreview
from rehab_opt.control.mirror_tick import VERDICT, mirror_tick
from rehab_opt.control.person_limit import PersonLimit
from rehab_opt.control.reference_clock import ReferenceClock
from rehab_opt.control.thread_owner import setting
from rehab_opt.control.velocity_controller import checked_number
from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.kinematics.plausible import check_place, check_speeds, checked_length
from rehab_opt.kinematics.room import MovingCapsule
from rehab_opt.optim.fused import FUSED_SOLVERS
from rehab_opt.symbolic import BufferedFunction, Compile

__all__ = ["MirrorTracker"]

Array = NDArray[np.float64]

NOT_TAKEN = {
    "task_weights": "turn_length instead",
    "jerk": "None with MirrorTracker, whose bounds take precedence over a drive's",
}
"""Arguments of `PoseTracker` that are refused here, with the alternative."""
_OK, _NAN, _new, _read_only = Status.OK, math.nan, tuple.__new__, np.frombuffer
_BOUNDS, _SOLVERS = {float(i): Relaxed(i) for i in range(8)}, {float(i): name for i, name in enumerate(FUSED_SOLVERS)}
_JUDGED, _USUAL, _LEADS_TO = GIVEN["judged"], VERDICT["usual"], VERDICT["then"]


class MirrorTracker(MirrorPreview):
    """Joint velocities for a hand that follows a mirrored path, away from singular postures.

    Each tick tracks, as `PoseTracker` does, the pose that a clock reads from the reference. The limits include
    w(q) / w_max >= floor and the planes `keep_out`, also while braking.

    The clock slows down if the reference is too fast for the hand, as the deviation grows, and if the person pushes.
    Near the largest deviation the clock waits; later it catches up. If a stretch is out of reach, the hand moves along
    the nearest reachable poses, and deviations are measured from them (`short`). A jump of the reference is bridged at
    half of the hand's largest speeds. Samples of a live motion tracker must first pass a `Conditioner`.

    Parameters
    ----------
    chain : any serial chain.
    floor : least w / w_max, above 0 and below 1; w is Yoshikawa's measure, w_max its maximum over all postures.
    max_deviation, max_turn : [m, rad] deviation of the tool from the reference at which the clock waits.
    linear_speed, angular_speed : [m/s, rad/s] largest hand speeds.
    keep_out : planes from `KeepOut.through(point, normal)`. At the end of a tick no capsule of a link
        (`SerialChain.capsules`), no frame origin and no tool origin is beyond a plane. Parts that no joint moves, the
        led hand, and attachments to the flange are guarded only by a capsule.
    limits : further limits of the posture, each a `Limit` or a `Clearance`.
    person : the led arm, in the robot's base frame; the reference is limited to its range of motion (`PersonLimit`).
    grip : (4, 4) pose of the tool in the person's hand frame.
    person_start : (m,) [rad] start posture of the led arm's model; by default the middle of its range.
    interaction : response of the hand to measured forces; default `Interaction()`.
    catch_up : fraction by which the clock may run fast to make up for a lag.
    turn_length : [m/rad] weight of the hand's rotation relative to its position.
    max_manipulability : w_max, if known; by default it is computed.
    gain, posture, lower, upper, velocity, acceleration : as for `PoseTracker`.
    dt, recovery_speed, solver, backup, tolerance, max_age, compile : as for `PoseTracker`.
    """

    name: ClassVar[str] = "mirror_tracker"

    floor: float = setting()
    max_deviation: float = setting()
    max_turn: float = setting()
    catch_up: float = setting()
    max_manipulability: float = setting()

    def __init__(
        self,
        chain: SerialChain,
        *,
        floor: float = 0.3,
        max_deviation: float = 0.05,
        max_turn: float = math.radians(45.0),
        linear_speed: float = 0.25,
        angular_speed: float = 1.5,
        keep_out: Sequence[KeepOut] = (),
        limits: Sequence[Limit | Clearance] = (),
        person: SerialChain | None = None,
        grip: ArrayLike | None = None,
        person_start: ArrayLike | None = None,
        interaction: Interaction | None = None,
        catch_up: float = 0.5,
        turn_length: float = 0.1,
        max_manipulability: float | None = None,
        dt: float = 0.001,
        recovery_speed: float = 0.1,
        compile: Compile = None,
        **options: Any,
    ) -> None:
        if not isinstance(chain, SerialChain):
            raise ConfigurationError("chain", chain, "a SerialChain")
        for name, expected in NOT_TAKEN.items():
            if name in options:
                raise ConfigurationError(name, options[name], expected)
        if interaction is not None and not isinstance(interaction, Interaction):
            raise ConfigurationError("interaction", interaction, "an Interaction")
        limited = chain.with_limits(**{name: options.get(name) for name in ("lower", "upper")})
        if not all(isinstance(plane, KeepOut) for plane in keep_out):
            raise ConfigurationError("keep_out", keep_out, "planes made by KeepOut.through")
        for i, plane in enumerate(keep_out):
            check_place(f"keep_out[{i}]", plane, limited)
        self.floor = checked_number("floor", floor, above=0.0, below=1.0)
        deviation = checked_number("max_deviation", max_deviation, above=0.0)
        self.max_deviation = checked_length("max_deviation", deviation, limited)
        self.max_turn = checked_number("max_turn", max_turn, above=0.0, below=math.pi)
        self.catch_up = checked_number("catch_up", catch_up, above=-1e-9, below=10.0)
        turn_length = checked_length("turn_length", checked_number("turn_length", turn_length, above=0.0), limited)
        self.max_manipulability = (
            maximise_manipulability(limited)[0]
            if max_manipulability is None
            else checked_number("max_manipulability", max_manipulability, above=0.0)
        )
        self.hand_bounds = HandBounds(limited, self.floor, self.max_manipulability, tuple(keep_out))
        if not isinstance(limits, (list, tuple)):
            raise ConfigurationError("limits", limits, "a list or tuple, each a Limit or a Clearance")
        super().__init__(
            chain, linear_speed=linear_speed, angular_speed=angular_speed, dt=dt, recovery_speed=recovery_speed,
            task_weights=[1.0, 1.0, 1.0, *(turn_length**2,) * 3], limits=[*self.hand_bounds.limits, *limits],
            compile=compile, **options,
        )  # fmt: skip
        self._limit = None
        if person is not None:
            self._limit = PersonLimit(
                person,
                grip=np.eye(4) if grip is None else grip,
                dt=dt,
                start=person_start,
                backup=options.get("backup"),
                compile=compile,
            )
        self._interaction = Interaction() if interaction is None else interaction
        checked_length("interaction.max_offset", self._interaction.max_offset, self.chain)
        check_speeds(self.chain, linear=self._interaction.speed, argument="interaction.speed")
        self._memory = np.zeros(REMEMBERED.size)
        self._remembered = self._memory.data  # memory view: twice as fast as numpy
        self._felt, self._held = (self._memory[REMEMBERED.places[name]] for name in ("felt", "held"))
        self._moving = BufferedFunction(moving_tool_function(self.chain), compile=compile)
        self.pace = MirrorPace(
            dt=dt, linear_speed=linear_speed, angular_speed=angular_speed, max_deviation=max_deviation,
            max_turn=max_turn, catch_up=catch_up,
        )  # fmt: skip
        self.parts = parts = mirror_tick(self, self.pace, self._interaction, person=person is not None)
        """Functions of a tick that uses the clock."""
        (parameters, state, given), verdict = self._function.inputs, self._function.outputs[1]

        def shared(function: ca.Function, third: Array, compile: Compile) -> BufferedFunction:
            own = {0: parameters, 1: state, 2: third, function.n_in() - 1: self._memory}
            return BufferedFunction(function, compile=compile, inputs=own)

        self._notice = shared(parts.notice, given, compile)
        self._deliver = shared(parts.deliver, verdict, compile)
        self._brake = shared(parts.brake, verdict, False)
        self._tried, self._concluded = (BufferedFunction(each, compile=compile) for each in parts[1:3])
        self.clock = ReferenceClock(
            dt, linear_speed=BRIDGE * linear_speed, angular_speed=BRIDGE * angular_speed, window=self.pace.window
        )
        """Clock of the reference."""
        self._reading = BufferedFunction(self.pace.followed_function())
        self.counts: Counter[str] = Counter()
        """Numbers of ticks (acceleration relaxed, reference slowed, clock waited, arm braked) and of stretches out of
        reach.
        """
        self._begin()

    # ------------------------------------------------------------------------------------------------ the user's
    def reset(self, velocity: ArrayLike | None = None) -> None:
        """Reset the state; `velocity` (n,) is the joints' current velocity [rad/s or m/s], by default rest."""
        super().reset(velocity)
        self._claim()
        if hasattr(self, "clock"):
            self._begin()
        self._give_away()

    @property
    def reference(self) -> Array:
        """Reference pose (4, 4) that the clock reads, before the person's arm and forces change it."""
        return self._read()[FOLLOWED.places["reference"]].reshape(4, 4)

    def _read(self) -> Array:
        accepted = np.hstack([each.reshape(-1) for each in self._accepted()]) if self._live else np.zeros(22)
        clock = self.clock
        return self._reading.of(clock.window.T, clock.now, self._live, accepted, self._memory).copy()

    @property
    def time_scale(self) -> float:
        """Approximate pace of the clock: seconds of the reference, or of a bridge, per second."""
        return float(self._memory[RATE])

    @property
    def lag(self) -> float:
        """Time [s] by which the followed pose is older than the newest sample; skipped samples count."""
        return float(self._read()[FOLLOWED["lag"]])

    @property
    def short(self) -> tuple[float, float]:
        """[m, rad] Smallest deviation within reach; `max_deviation` and `max_turn` limit the excess over it."""
        return (0.0, 0.0) if self._live else self._short_by

    @property
    def beyond_person(self) -> tuple[float, float]:
        """[m, rad] Portion of `short` due to the person's arm: its model does not reach the reference."""
        return (0.0, 0.0) if self._live else self._beyond_person

    @property
    def manipulability(self) -> float:
        """Ratio w / w_max at the end of the last command."""
        return float(self._memory[THEN])

    def step(
        self,
        q: ArrayLike,
        pose: ArrayLike,
        twist: ArrayLike,
        *,
        obstacles: Sequence[MovingCapsule] | Array | None = None,
        force: ArrayLike | None = None,
        enable: object = True,
        stamp: float | None = None,
    ) -> Command:
        """Joint velocity (n,) [rad/s, m/s] to hold until the next tick; the command's `scale` is the time scaling.

        If the state is invalid, the arm decelerates within its limits, and the clock waits. Arguments of a wrong shape
        raise `ConfigurationError`.

        Parameters
        ----------
        q : (n,) measured joint positions [rad, m].
        pose : (4, 4) current mirrored pose of the tool in the base frame.
        twist : (6,) its twist, linear [m/s] first, then angular [rad/s], in the base frame.
        obstacles : moving bodies, as for `PoseTracker.step`.
        force : (3,) [N] force of the person on the tool, in the base frame; None counts as no push. Pass a lost sample
            as NaN, which stops the arm.
        enable : dead man's switch; anything but True decelerates to rest.
        stamp : [s] time of the state; the watchdog checks it.
        """
        if self._owner != get_ident():
            self._claim()
        self._take(q, pose, twist, obstacles)
        if enable is not True or stamp is not None or not self._usual:
            self._set_enable(enable, stamp)
        self._given[_JUDGED] = 0.0
        if self._live and force is None:
            # The usual case in one compiled call: Python's layers would cost as much as the solve.
            verdict = self._verdict
            self._told[0] = verdict[0] = _NAN  # see `FallbackChain`: after a failure inside, the outputs are unchanged
            self._function.evaluate()
            left, residual, who, relaxed, scale, _ = self._head.tolist()
            if not left and verdict[_USUAL]:
                self._remembered[THEN] = verdict[_LEADS_TO]
                self._keep[:] = self._answer
                self._good = self._solvers.parameters.tobytes()
                value = _read_only(self._velocity.tobytes())
                name, bound = _SOLVERS[who], _BOUNDS[relaxed]
                return _new(Command, (value, _OK, name, residual, -1, "", bound, scale, None))
        return self._followed(force)

    # ----------------------------------------------------------------------------------------------- whole motions
    def plan(self, poses: ArrayLike, twists: ArrayLike, q: ArrayLike) -> MirrorPath:
        """Plan the whole motion along a recording, timed by Ruckig; every guarantee of `step` holds.

        Parameters
        ----------
        poses, twists : (N, 4, 4), (N, 6) mirrored poses of the tool and their twists, `dt` apart; NaN samples are
            bridged.
        q : (n,) joint positions at the start, at rest.

        Raises
        ------
        ConfigurationError : wrong shapes, no valid sample, all samples more than ten times the arm's reach away, or
            moving bodies.
        """
        if self.limits.moving:
            expected = "a Clearance without moving capsules: their future positions are unknown"
            raise ConfigurationError("moving", self.limits.moving, expected)
        return plan(self, poses, twists, q)
