"""Mirror therapy: joint velocities of an arm that leads a hand along the other hand's mirrored path.

The equations of the paper (Xu, Guo, Zhang 2021) are lost from the text at hand: this is a reconstruction of what it
describes, a manipulability floor under a path that otherwise keeps to the reference, as a QP instead of a search.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import Any, ClassVar

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.command import Bound, Command, Status
from rehab_opt.control.hand_bounds import HandBounds, KeepOut
from rehab_opt.control.interaction import Interaction
from rehab_opt.control.mirror_plan import MirrorPath, plan
from rehab_opt.control.manipulability import largest_manipulability, way_out
from rehab_opt.control.person_limit import PersonLimit
from rehab_opt.control.pose_tracker import Motion, PoseTracker, Tick
from rehab_opt.control.reference_clock import ReferenceClock
from rehab_opt.control.stopping import VelocityBounds
from rehab_opt.control.velocity_controller import checked_number
from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.kinematics.frames import ROTATION_TOLERANCE, rotation_vector
from rehab_opt.optim.fused import FUSED_SOLVERS
from rehab_opt.optim.qp import PLAUSIBLE, Instance, parameter
from rehab_opt.symbolic import BufferedFunction, compiled

__all__ = ["MirrorTracker"]

Array = NDArray[np.float64]

FLAT = 2e-3
"""[1/rad] Slope of w / w_max below which the gradient shows no way up."""
WHOLE = 0.999
"""Share of the wanted motion from which nothing was slowed."""
CALM, WAITS = 0.45, 0.9
"""Shares of the largest deviation up to which the clock keeps its pace, and from which it waits."""
SPARE = 0.95
"""Share of the hand speeds that the reference may take: the rest is for catching up with it."""
HASTE = 4.0
"""[1] Feedback on the error asks for at most this many times the largest hand speed."""
QUICKENING, CATCHING_UP = 0.1, 0.3
"""[s] in which the clock regains its pace, and in which it makes up for its lag."""
GIVEN_UP = 3.0
"""[s] of waiting with all the future known, after which a plan ends incomplete."""
STUCK = 0.1, 0.005
"""[s, m/s] How long the clock must have waited, and how slow the hand be, before a stretch of path is given up."""
JUMP, SPIN = 5.0, 30.0
"""[m/s, rad/s] Faster samples than a hand can move: a jump of the tracker, and bridged."""
BRIDGE = 0.5
"""Share of the hand speeds at which a jump is bridged."""
HALVINGS = 12

_OK, _NAN, _new, _read_only = Status.OK, math.nan, tuple.__new__, np.frombuffer
_BOUNDS = tuple(Bound(i) for i in range(8))


class MirrorTracker(PoseTracker):
    """Joint velocities for a hand that is led along a mirrored path, kept out of singular postures.

    `PoseTracker`'s QP with the rows of `HandBounds`: w(q) + grad w . q' dt stays above the floor as a discrete barrier,
    the hand near the reference and out of what it must not enter. Then the true state at the end of the tick is
    computed, and the step shortened where the tangents promised too much: w(q + q' dt) / w_max >= min(floor, w / w_max)
    holds in every tick, also while braking. Where the acceleration bound is in the way of it, it yields, is flagged and
    counted.

    The reference is read by a clock. It slows down where the reference is faster than the hand may be, where the
    deviation grows and where the person pushes, waits at the largest deviation, and catches up afterwards; what was
    slowed is late, not cut. A stretch that the arm cannot do at all is left out once the reference is back
    within reach. Jumps of the reference are bridged at half the hand speeds; the first bridge starts at the hand.

    Parameters
    ----------
    chain : any serial chain.
    floor : least w / w_max, above 0 and below 1; w is Yoshikawa's measure, w_max the chain's own maximum (`largest`).
    max_deviation : [m] of the tool from the reference that the clock stands at.
    max_turn : [rad] of the tool from it, from which the clock waits; no bound of the QP.
    linear_speed, angular_speed : [m/s, rad/s] largest hand speeds; the linear one holds exactly, in every tick.
    keep_out : planes that no part of the arm crosses: `KeepOut.through(point, normal)`.
    person : the arm that is led, in the robot's base frame; the reference is limited to its range of motion
        (`PersonLimit`). grip : (4, 4) pose of the tool in its hand frame.
    interaction : how measured forces slow and turn aside; default `Interaction()`.
    catch_up : share by which the clock may run fast to make up for a lag.
    turn_length : [m/rad] what a turn of the hand counts for against its place where both cannot be had.
    rate : [1/s] at which the distance to a bound may decay.
    largest : w_max where it is known; searched for by default, which takes half a second.
    gain, posture, lower, upper, velocity, acceleration, dt, return_speed, solver, backup, tolerance, max_age, compile :
        as for `PoseTracker`.

    Raises
    ------
    ConfigurationError : an argument that cannot be used.
    """

    name: ClassVar[str] = "mirror_tracker"
    memory_extra = 1  # what the last tick lost of w / w_max against its tangent

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
        person: SerialChain | None = None,
        grip: ArrayLike | None = None,
        interaction: Interaction | None = None,
        catch_up: float = 0.5,
        turn_length: float = 0.1,
        rate: float = 20.0,
        largest: float | None = None,
        dt: float = 0.001,
        return_speed: float = 0.1,
        compile: bool | None = None,
        **options: Any,
    ) -> None:
        if not isinstance(chain, SerialChain):
            raise ConfigurationError("chain", chain, "a SerialChain")
        if any(name in options for name in ("task_weights",)):
            raise ConfigurationError("task_weights", options["task_weights"], "turn_length instead")
        checked_number("dt", dt, above=0.0, below=1.0)
        limited = chain.with_limits(
            **{name: options.get(name) for name in ("lower", "upper", "velocity", "acceleration")}
        )
        if not all(isinstance(plane, KeepOut) for plane in keep_out):
            raise ConfigurationError("keep_out", keep_out, "planes made by KeepOut.through")
        self.floor = checked_number("floor", floor, above=0.0, below=1.0)
        self.max_deviation = checked_number("max_deviation", max_deviation, above=0.0)
        self.max_turn = checked_number("max_turn", max_turn, above=0.0, below=math.pi)
        self.catch_up = checked_number("catch_up", catch_up, above=-1e-9, below=10.0)
        turn_length = checked_number("turn_length", turn_length, above=0.0)
        self.largest = largest_manipulability(limited)[0] if largest is None else checked_number(
            "largest", largest, above=0.0
        )
        self.hand_bounds = HandBounds(
            limited, self.floor, self.largest, checked_number("linear_speed", linear_speed, above=0.0),
            self.max_deviation, tuple(keep_out), checked_number("rate", rate, above=0.0), dt,
            checked_number("return_speed", return_speed, above=0.0, below=1.0),
        )  # fmt: skip
        self.row_count = self.hand_bounds.count
        super().__init__(
            chain, linear_speed=linear_speed, angular_speed=angular_speed, dt=dt, return_speed=return_speed,
            task_weights=[1.0, 1.0, 1.0, *(turn_length**2,) * 3], compile=compile, **options,
        )  # fmt: skip
        self._limit = None
        if person is not None:
            self._limit = PersonLimit(person, grip=np.eye(4) if grip is None else grip, dt=dt, compile=compile)
        self._interaction = (Interaction() if interaction is None else interaction).started(dt)
        self._audit = BufferedFunction(self._auditing())
        symbol = ca.SX.sym("q", self.chain.n)
        tool = ca.Function("tool", [symbol], [ca.densify(self.chain.pose_expression(symbol))], {"cse": True})
        self._tool = BufferedFunction(compiled(tool, compile=compile))
        self.clock = ReferenceClock(dt, linear_speed=BRIDGE * linear_speed, angular_speed=BRIDGE * angular_speed)
        """Where the reference is read."""
        self.counts: Counter[str] = Counter()
        """How many ticks yielded acceleration, were shortened, waited, braked, and how many stretches were left out."""
        self._begin()

    # ---------------------------------------------------------------------------------------------- the statement
    def others(self) -> list[ca.SX]:
        """From the target to the deviation's centre (3,), and what stands for a gradient that vanishes (n,)."""
        return [parameter("offset", 3), parameter("lead", self.chain.n)]

    @property
    def shapes(self) -> tuple[tuple[int, ...], ...]:  # type: ignore[override]
        """Shapes of the statement's parameters after q."""
        return ((4, 4), (6,), (3,), (self.chain.n,))

    def rows(self, tick: Tick, bounds: VelocityBounds) -> tuple[ca.SX, ca.SX, VelocityBounds]:
        """See `HandBounds.rows`."""
        offset, lead = tick.others
        return self.hand_bounds.rows(
            tick.q, centre=tick.target[:3, 3] + offset, lead=lead, loss=tick.memory[-1], bounds=bounds
        )

    def hand_speeds(self) -> tuple[float, float]:
        """The wanted motion is slowed, not the asked one: what the floor takes from it must not slow the rest."""
        return self.linear_speed, self.angular_speed

    def _asked_twist(self, pose: ca.SX, target: ca.SX, twist: ca.SX) -> tuple[ca.SX, ca.SX]:
        feedback = self._settling * ca.vertcat(
            target[:3, 3] - pose[:3, 3], rotation_vector(target[:3, :3] @ pose[:3, :3].T)
        )
        linear, angular = ca.norm_2(feedback[:3]), ca.norm_2(feedback[3:])
        excess = ca.fmax(linear / (HASTE * self.linear_speed), angular / (HASTE * self.angular_speed))
        return twist + feedback / ca.fmax(excess, 1), ca.SX(1)

    def outcome(self, tick: Tick, motion: Motion) -> ca.SX:
        """Yielded, share of the wanted motion, nothing unusual, bounds truly kept, w before and after, w is flat."""
        q, centre = tick.q, tick.target[:3, 3] + tick.others[0]
        yielded = super().outcome(tick, motion)[0]
        share = ca.if_else(motion.speed > 1e-9, motion.scale, 1)
        kept, w, then, _ = self.hand_bounds.kept(q, motion.velocity, centre)
        slope = ca.sumsqr(self.hand_bounds.manipulability(q)[1])
        flat = ca.logic_and(slope < FLAT**2, w < self.floor)
        here = self.chain.pose_expression(q)
        away = ca.sumsqr(here[:3, 3] - centre)
        turned = ca.sumsqr(rotation_vector(tick.target[:3, :3] @ here[:3, :3].T))
        usual = [
            kept, share >= WHOLE, ca.logic_not(flat), motion.outside < 0.5,
            ca.logic_or(yielded == int(Bound.NOTHING), yielded == int(Bound.TASK)),
            away <= (CALM * self.max_deviation) ** 2, turned <= (CALM * self.max_turn) ** 2,
            ca.sumsqr(tick.twist[:3]) <= (SPARE * self.linear_speed) ** 2,
            ca.sumsqr(tick.twist[3:]) <= (SPARE * self.angular_speed) ** 2,
        ]  # fmt: skip
        fine = ca.SX(1)
        for condition in usual:
            fine = ca.logic_and(fine, condition)
        return ca.vertcat(yielded, share, fine, kept, w, then, flat)

    def remembered(self, tick: Tick, motion: Motion) -> ca.SX:
        """Velocity, where it leads, and the loss of w against its tangent."""
        _, w, then, _ = self.hand_bounds.kept(tick.q, motion.velocity, tick.target[:3, 3])
        gradient = self.hand_bounds.manipulability(tick.q)[1]
        loss = ca.fmax(w + ca.dot(gradient, motion.velocity) * self.dt - then, 0)
        return ca.vertcat(super().remembered(tick, motion), ca.fmin(loss, self.floor))

    def _auditing(self) -> ca.Function:
        """q, velocity, centre -> see `HandBounds.kept`."""
        q, velocity, centre = ca.SX.sym("q", self.chain.n), ca.SX.sym("v", self.chain.n), ca.SX.sym("centre", 3)
        kept = self.hand_bounds.kept(q, velocity, centre)
        return ca.Function("audit", [q, velocity, centre], [ca.densify(ca.vertcat(*kept))], {"cse": True})

    # ------------------------------------------------------------------------------------------------ the user's
    def reset(self, velocity: ArrayLike | None = None) -> None:
        """Forget the past; `velocity` (n,) is what the joints do now [rad/s or m/s], rest by default."""
        super().reset(velocity)
        self._ladder.memory[2 * self.chain.n :] = 0.0
        if hasattr(self, "clock"):
            self._begin()

    def instance(self, q: ArrayLike, *inputs: ArrayLike) -> Instance:
        """The QP of a tick at q, pose and twist, as numbers, for inspection."""
        return super().instance(q, *inputs, *(np.zeros(3), np.zeros(self.chain.n))[len(inputs) - 2 :])

    @property
    def reference(self) -> Array:
        """(4, 4) the pose that the clock stands at, before the person's range of motion and forces are considered."""
        if self._live:
            return np.frombuffer(self._good[0]).reshape(4, 4).copy()
        return np.full((4, 4), math.nan) if self.clock.empty else self.clock.read()[0].copy()

    @property
    def time_scale(self) -> float:
        """Seconds of the reference followed in a second, in the last tick."""
        return self._rate

    @property
    def lag(self) -> float:
        """[s] by which the reference that is followed is older than the newest, bridges included."""
        return 0.0 if self._live else self.clock.lag

    @property
    def manipulability(self) -> float:
        """w / w_max where the last command leads."""
        return self._then

    def step(
        self,
        q: ArrayLike,
        pose: ArrayLike,
        twist: ArrayLike,
        *,
        force: ArrayLike | None = None,
        enable: object = True,
        stamp: float | None = None,
    ) -> Command:
        """Joint velocity (n,) [rad/s, m/s] to hold until the next tick; its `scale` is the time scaling, at most 1.

        Never raises on numbers: what is not usable gives the safe command, decelerating within the limits, and its
        reason; the clock waits meanwhile.

        Parameters
        ----------
        q : (n,) joint positions now [rad, m].
        pose : (4, 4) the mirrored pose of the tool now, in the base frame.
        twist : (6,) how that moves, linear [m/s] first, then angular [rad/s], in the base frame.
        force : (3,) [N] that the person exerts on the tool, in the base frame, where it is measured.
        enable : the dead-man input; anything but true decelerates to rest.
        stamp : time of the state [s]; checked by the watchdog when given.

        Raises
        ------
        ConfigurationError : an argument of the wrong shape.
        """
        if not self._live or force is not None:
            return self._followed(q, pose, twist, force, self._refusal(enable, stamp))
        try:
            q_view, pose_view, twist_view, _, _ = self._views
            q_view[:] = q  # type: ignore[assignment]
            twist_view[:] = twist  # type: ignore[assignment]
            pose_view[:] = pose.ravel()  # type: ignore[union-attr]
            usual = pose.ndim == 2 and len(pose) == 4  # type: ignore[union-attr, arg-type]
        except (ValueError, TypeError, AttributeError):
            usual = False
        reason = self._refusal(enable, stamp)
        if usual and not reason and self._fused:
            verdict = self._verdict
            verdict[0] = _NAN
            self._evaluate()
            residual, _, who, yielded, scale, usual, _, _, then, _ = verdict.tolist()
            if usual and 0.0 <= residual <= self.tolerance:
                self._keep[:] = self._answer
                self._good = pose_view.tobytes(), twist_view.tobytes()
                self._then = then
                value = _read_only(self._velocity.tobytes())
                return _new(
                    Command, (value, _OK, FUSED_SOLVERS[int(who)], residual, -1, "", _BOUNDS[int(yielded)], scale)
                )
        return self._followed(q, pose, twist, force, reason)

    # ----------------------------------------------------------------------------------------------- whole motions
    def plan(self, poses: ArrayLike, twists: ArrayLike, q: ArrayLike) -> MirrorPath:
        """The whole motion along a recording, with every guarantee of `step` and the future known.

        The clock slows down ahead of what is too fast, and knows at once where a stretch it must leave out ends.

        Parameters
        ----------
        poses, twists : (N, 4, 4), (N, 6) mirrored poses of the tool and how they move, `dt` apart; samples with NaN are
            lost sight, and bridged.
        q : (n,) joint positions at the start, at rest.

        Raises
        ------
        ConfigurationError : wrong shapes, or nothing usable.
        """
        return plan(self, poses, twists, q)

    def foresee(self, q: Array, poses: Array, twists: Array, stamps: Array) -> list[tuple[float, float]]:
        """Hand a whole recording to the clock; its time and the recording's of each sample."""
        clock, marks = self.clock, []
        here = self.chain.pose(q)
        self._live = False
        clock.start(here, np.zeros(6))
        before, stamp = here, stamps[0] - self.dt
        for pose, twist, now in zip(poses, twists, stamps.tolist(), strict=True):
            seconds = now - stamp
            jumps = self._jumps(before, pose, seconds) or len(marks) == 0
            clock.push(pose, twist, seconds=seconds, bridge=jumps)
            marks.append((clock.lag, now))
            before, stamp = pose, now
        clock.slow_ahead(
            linear_speed=SPARE * self.linear_speed, angular_speed=SPARE * self.angular_speed, quickening=QUICKENING
        )
        return marks

    def follow(self, q: Array) -> Command:
        """One tick along what the clock foresees."""
        self._q[:] = q
        here = self._tool.of(q)
        return self._tracked(here, foreseen=True)

    def tool(self, q: Array) -> Array:
        """(4, 4) pose of the tool, as `chain.pose`, faster."""
        return self._tool.of(q)

    @property
    def given_up(self) -> bool:
        """Whether the clock has waited for so long that nothing will change."""
        return self._waited > GIVEN_UP

    # ------------------------------------------------------------------------------------------- the careful way
    def _begin(self) -> None:
        self.clock.reset()
        if self._limit is not None:
            self._limit.reset()
        self._interaction.reset()
        self._rate, self._share, self._then = 1.0, 1.0, math.nan
        self._waited = 0.0
        self._live = False
        self._good = b"", b""
        self._centre: Array | None = None
        self.followed: Array = np.full((4, 4), math.nan)
        """(4, 4) the reference of the last tick with a clock, before the range of motion and forces."""
        self._still, self._lead_w, self._lead_age = np.zeros(self.chain.n), -1.0, 0
        self._inputs[2][:] = self._inputs[3][:] = 0.0

    def _followed(
        self, q: ArrayLike, pose: ArrayLike, twist: ArrayLike, force: ArrayLike | None, reason: str
    ) -> Command:
        """One tick with the clock."""
        lead = self._inputs[3].copy()
        self._write((q, pose, twist, np.zeros(3), lead))
        pose, twist = self._inputs[0].copy(), self._inputs[1].copy()
        if self._live:
            good, motion = (np.frombuffer(part) for part in self._good)
            self.clock.start(good.reshape(4, 4), motion)
            self._live = False
        pushed = self._interaction.feel(force)
        reason = reason or self._unusable(pose, twist) or pushed
        if reason:
            return self._safe(reason)
        here = self._tool.of(self._q)
        self._take(here, pose, twist)
        return self._tracked(here)

    def _tracked(self, here: Array, *, foreseen: bool = False) -> Command:
        """One tick of following what the clock holds."""
        self._bridging = self.clock.bridging
        now = self.clock.read()
        rate = self._pace(here, *now, foreseen=foreseen)
        target, motion, ahead = self._reference(here, now, rate)
        self._rate = ahead / self.dt
        self._note_waiting(here)
        self.followed = target
        centre = target[:3, 3].copy()
        self._centre = centre
        motion = motion * self._rate
        if self._limit is not None:
            target, motion = self._limit.limited(target, motion)
        if self._interaction.active:
            target = target.copy()
            target[:3, 3] += self._interaction.offset
        if target is not self.followed:
            self._inputs[2][:] = centre - target[:3, 3]
        self._inputs[0][:], self._inputs[1][:] = target, motion
        self._last_before = self._last.copy()
        solver = self._ladder()
        if not solver:
            return self._safe(self._fault())
        return self._delivered(solver, centre)

    def _delivered(self, solver: str, centre: Array) -> Command:
        """The command of a certified answer, shortened where the true state asks for it."""
        ladder = self._ladder
        residual, _, _, yielded, share, _, kept, w, then, flat = ladder.verdict.tolist()
        status, notes = Status.OK, []
        if solver == ladder.backup != ladder.solver:
            status, notes = Status.BACKUP, [f"{ladder.solver} gave no certified answer"]
        value = np.frombuffer(self._velocity.tobytes())
        flags = _BOUNDS[int(yielded)]
        if not kept:
            value, flags = self._shortened(value, centre, flags)
            notes.append("step shortened: the bounds' tangents promised too much")
            then = self._then
        if flags & Bound.ACCELERATION:
            self.counts["acceleration"] += 1
        self._then, self._share = then, share
        self._find_way_out(bool(flat), w)
        slow = min(1.0, self._rate) * share
        if self._rate < WHOLE:
            self.counts["slowed"] += 1
            flags |= Bound.TASK
            notes.append(f"the reference is followed at {self._rate:.0%} of its pace, {self.clock.lag:.2f} s behind")
        if self._bridging:
            notes.append("bridging a jump of the reference")
        usual = self._limit is None and not self._interaction.active and self.clock.current and not flat
        if usual and self._rate >= WHOLE and share >= WHOLE:
            pose, twist = self.clock.read()
            self._good, self._live, self._rate = (pose.tobytes(), twist.tobytes()), True, 1.0
            self._inputs[2][:] = self._inputs[3][:] = 0.0
        return Command(value, status, solver, residual, ladder.iterations, "; ".join(notes), flags, slow)

    def _take(self, here: Array, pose: Array, twist: Array) -> None:
        """Hand a sample to the clock, bridging what no hand can do."""
        clock = self.clock
        if clock.empty:
            clock.start(here, np.zeros(6))
            clock.push(pose, twist, bridge=True)
            return
        clock.push(pose, twist, bridge=self._jumps(clock.newest, pose, self.dt))

    def _jumps(self, before: Array, pose: Array, seconds: float) -> bool:
        """Whether no hand goes from one pose to the next in this time."""
        return _distance(pose, before) > JUMP * seconds + 1e-3 or _angle(pose, before) > SPIN * seconds + 1e-2

    def _pace(self, here: Array, pose: Array, twist: Array, *, foreseen: bool) -> float:
        """Seconds of the reference to follow in a second; what is foreseen is not late."""
        clock = self.clock
        x, y, z, turning_x, turning_y, turning_z = twist.tolist()
        speed, turning = math.hypot(x, y, z), math.hypot(turning_x, turning_y, turning_z)
        pace = 1.0
        if not foreseen and self._interaction.pace == 1.0:  # nobody is hurried who pushes
            pace += min(self.catch_up, max(clock.lag - self.dt, 0.0) / CATCHING_UP)
        worst = max(_distance(here, pose) / self.max_deviation, _angle(here, pose) / self.max_turn)
        pace *= min(max((WAITS - worst) / (WAITS - CALM), 0.0), 1.0) * self._interaction.pace
        linear, angular = SPARE * self.linear_speed, SPARE * self.angular_speed
        pace = min(pace, clock.pace, linear / max(speed, 1e-9), angular / max(turning, 1e-9))
        before = self._rate * (self._share if self._share < WHOLE else 1.0)
        return min(pace, max(before, 0.0) + self.dt / QUICKENING)

    def _reference(self, here: Array, now: tuple[Array, Array], rate: float) -> tuple[Array, Array, float]:
        """Pose and twist to follow now, and the reference seconds gone on by: as many as the deviation allows."""
        clock, ahead = self.clock, rate * self.dt
        allowed = max(WAITS * self.max_deviation, _distance(now[0], here))
        for _ in range(3):
            pose, twist = clock.read(ahead)
            if _distance(pose, here) <= allowed:
                clock.advance(ahead)
                return pose, twist, ahead
            ahead *= 0.5
        return *now, 0.0

    def _note_waiting(self, here: Array) -> None:
        """Leave out the stretch the clock waits at, once a later pose is within reach of a hand that stands."""
        if self._rate > 0.02:
            self._waited = 0.0
            return
        self.counts["waited"] += 1
        self._waited += self.dt
        hand = self.chain.jacobian(self._q)[:3] @ self._last
        if self._waited < STUCK[0] or float(np.linalg.norm(hand)) > STUCK[1]:
            return
        positions, poses, _ = self.clock.waiting()
        near = np.flatnonzero(np.linalg.norm(positions - here[:3, 3], axis=1) <= CALM * self.max_deviation)
        first = self.clock.read()[0]
        beyond = np.linalg.norm(positions - first[:3, 3], axis=1)
        for index in near.tolist():
            if _angle(here, poses[index]) <= CALM * self.max_turn and beyond[: index + 1].max() > 1e-3:
                self.clock.skip(index + 1)
                self.counts["left out"] += 1
                self._waited = 0.0
                return

    # --------------------------------------------------------------------------------------------- true bounds
    def _kept(self, value: Array, centre: Array) -> bool:
        kept, _, self._then, _ = self._audit.of(self._audited, value, centre).tolist()
        return bool(kept)

    @property
    def _audited(self) -> Array:
        """(n,) positions that can be used: as measured, or where the last command led."""
        return np.where(np.abs(self._q) <= PLAUSIBLE, self._q, self._predicted)

    def _shortened(self, value: Array, centre: Array, flags: Bound) -> tuple[Array, Bound]:
        """The longest part of a step that keeps every bound truly, to a thousandth; and what yields to it."""
        short, long = 0.0, 1.0
        for _ in range(HALVINGS):
            middle = (short + long) / 2
            short, long = (middle, long) if self._kept(middle * value, centre) else (short, middle)
        value = short * value + 0.0
        value.setflags(write=False)
        q, n = self._audited, self.chain.n
        self._kept(value, centre)
        if np.any(np.abs(value - self._last_before) > self.chain.acceleration * self.dt * (1 + 1e-9) + 1e-12):
            flags |= Bound.ACCELERATION
        self.counts["shortened"] += 1
        self._ladder.memory[: 2 * n] = np.concatenate([value, q + value * self.dt])
        return value, flags | Bound.TASK

    def _safe(self, reason: str) -> Command:
        """Decelerate within the bounds, and faster where the floor or the planes ask for it."""
        self._live, self._waited = False, 0.0
        self._rate = 0.0
        self.counts["braked"] += 1
        self._last_before = self._last.copy()
        command = super()._safe(reason)
        centre = self._centre
        q = self._audited
        if centre is None:
            centre = self.chain.pose(q)[:3, 3]
        self._ladder.memory[2 * self.chain.n :] = 0.0
        if command.value.any() and not self._kept(command.value, centre):
            value, flags = self._shortened(command.value, centre, command.yielded)
            if flags & Bound.ACCELERATION:
                self.counts["acceleration"] += 1
            status = Status.BRAKING if value.any() else Status.HOLDING
            command = command._replace(value=value, yielded=flags, status=status)
        return command

    def _find_way_out(self, flat: bool, w: float) -> None:
        """What stands for the gradient in the next tick, where there is none."""
        lead = self._inputs[3]
        if not flat:
            if lead.any():
                lead[:] = 0.0
            return
        self._lead_age = 0 if w > self._lead_w + 1e-7 else self._lead_age + 1
        self._lead_w = max(w, self._lead_w) if lead.any() else w
        if not lead.any() or self._lead_age > 200:
            lead[:] = way_out(self.chain, self._q, turn=self._lead_age)
            self._lead_age = 0

    def _unusable(self, pose: Array, twist: Array) -> str:
        """Why a state or sample cannot be used, or nothing."""
        for name, array in (("q", self._q), ("pose", pose), ("twist", twist)):
            bad = ~(np.abs(array) <= PLAUSIBLE)
            if bad.any():
                where = ", ".join(str(i) for i in np.argwhere(bad)[0])
                return f"{name}[{where}] is {array[bad][0]}, not a usable number"
        rotation = pose[:3, :3]
        skewed = float(np.linalg.norm(rotation @ rotation.T - np.eye(3)))
        level = np.array_equal(pose[3], (0.0, 0.0, 0.0, 1.0))
        if not (skewed <= ROTATION_TOLERANCE and np.linalg.det(rotation) > 0 and level):
            return self.requirement
        return ""


def _distance(a: Array, b: Array) -> float:
    """[m] between the origins of two poses."""
    (_, _, _, ax), (_, _, _, ay), (_, _, _, az), _ = a.tolist()
    (_, _, _, bx), (_, _, _, by), (_, _, _, bz), _ = b.tolist()
    return math.hypot(ax - bx, ay - by, az - bz)


def _angle(one: Array, other: Array) -> float:
    """[rad] between the axes of two poses, to 1e-7: from the trace of one's inverse times the other."""
    (a, b, c, _), (d, e, f, _), (g, h, i, _), _ = one.tolist()
    (j, k, l, _), (m, n, o, _), (p, q, r, _), _ = other.tolist()
    trace = a * j + b * k + c * l + d * m + e * n + f * o + g * p + h * q + i * r
    return math.acos(min(max(0.5 * (trace - 1.0), -1.0), 1.0))
