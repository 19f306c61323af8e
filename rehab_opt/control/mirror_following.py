"""A mirrored hand's reference clock at work: what is followed in a tick, and how fast."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.between_poses import angle_between, distance_between
from rehab_opt.control.command import Bound, Command, Status
from rehab_opt.control.mirror_statement import CALM, SPARE, WHOLE, Held
from rehab_opt.control.mirror_waiting import MirrorWaiting
from rehab_opt.control.person_limit import PersonLimit
from rehab_opt.optim.rows import PLAUSIBLE
from rehab_opt.symbolic import BufferedFunction

__all__ = ["BRIDGE", "MirrorFollowing"]

Array = NDArray[np.float64]

WAITS = 0.9
"""Share of the largest deviation from which the clock waits."""
PACES = (1.0, 0.5, 0.25, 0.0)
"""Shares of the clock's pace that are tried."""
QUICKENING, CATCHING_UP = 0.1, 0.3
"""[s] in which the clock regains its pace, and in which it makes up for its lag."""
RUSH = 4.0
"""Share by which the clock may run fast while the reference rests: to let that time pass leads no further away."""
AT_LEAST = 0.02
"""Share by which the clock runs fast while it is late at all: so that it does catch up."""
STILL = 0.01, 0.1
"""[m/s, rad/s] A reference up to these rests."""
JUMP, SPIN = 5.0, 30.0
"""[m/s, rad/s] Faster samples than a hand can move: a jump of the tracker, and bridged."""
SETTLING_TICKS = 3
"""Of the model of the led arm while it finds its posture, in each tick: more would not fit into a quick one."""
BRIDGE = 0.5
"""Share of the hand speeds at which a jump is bridged."""
UNSEEN = np.full(3, math.nan)


class MirrorFollowing(MirrorWaiting):
    """The tick of `MirrorTracker` wherever something is unusual: late, pushed, led by a range of motion, or faulty."""

    catch_up: float
    _limit: PersonLimit | None
    _tool: BufferedFunction
    _rigid: BufferedFunction

    def _begin(self) -> None:
        self.clock.reset()
        self.counts.clear()
        if self._limit is not None:
            self._limit.reset()
        self._interaction.reset()
        self._rate, self._share, self._then = 1.0, 1.0, math.nan
        self._begin_waiting()
        self._live = False
        self._good = b""
        self._held: Held | None = None
        self._aim: Array | None = None
        self.followed: Array = np.full((4, 4), math.nan)
        """(4, 4) the reference of the last tick with a clock, before the range of motion and forces."""
        self._lead_w, self._lead_age = -1.0, 0
        self._inputs[2][:] = self._inputs[3][:] = 0.0

    def _followed(self, force: ArrayLike | None, reason: str, note: str) -> Command:
        """One tick with the clock, on what stands in the parameters."""
        self._inputs[2][:] = 0.0
        pose, twist = self._inputs[0].copy(), self._inputs[1].copy()
        if self._live:
            last, motion = self._accepted()
            self.clock.start(last, motion)
            self._live, self._held = False, Held(last[:3, 3], last, self.max_turn)
        # Work is done where the hand is measured, also where its joints are led ahead of that.
        seen = self._tool.of(self._q if self._feedback is None else self._feedback.measured)
        pushed = self._interaction.feel(force, UNSEEN if self._held is None else seen[:3, 3] - self._held.centre)
        here = seen if self._feedback is None else self._tool.of(self._q)
        reason = reason or self._unusable(pose, twist) or pushed
        if reason:
            self.clock.lost += self.dt
            return self._safe(reason)
        if self._limit is not None and not self._limit.settle(here, ticks=SETTLING_TICKS):
            self.clock.lost += self.dt
            return self._safe("the model of the led arm finds its posture")
        self._take(here, pose, twist)
        return self._tracked(here, note=note)

    def _tracked(self, here: Array, *, foreseen: bool = False, note: str = "") -> Command:
        """One tick of following what the clock holds."""
        self._bridging = self.clock.bridging
        now = self.clock.read()
        aim = now[0] if self._aim is None else self._aim
        rate = self._pace(here, *now, foreseen=foreseen)
        self._last_before = self._last.copy()
        target, motion, self._rate = self._reference(here, now, rate)
        self._note_waiting(here, aim)
        self._short_by = self._missing(target)
        if self._interaction.active:
            target = target.copy()
            target[:3, 3] += self._interaction.offset
            motion = motion.copy()
            motion[:3] += self._interaction.velocity
        assert self._held is not None
        self._inputs[2][:] = self._held.centre - target[:3, 3]
        self._inputs[0][:], self._inputs[1][:] = target, motion
        solver = self._ladder()
        if not solver:
            return self._safe(self._fault())
        return self._delivered(solver, self._held, note)

    def _delivered(self, solver: str, held: Held, note: str) -> Command:
        """The command of a certified answer, shortened where the true state asks for it."""
        ladder = self._ladder
        residual, _, _, yielded, share, _, kept, w, then, flat = ladder.verdict.tolist()
        status, notes = Status.OK, [note] if note else []
        if solver == ladder.backup != ladder.solver:
            status, notes = Status.BACKUP, [f"{ladder.solver} gave no certified answer"]
        value = np.frombuffer(self._velocity.tobytes())
        flags = Bound(int(yielded))
        if not (kept and self._kept(self._q, value, held)):
            value, flags = self._shortened(self._q.copy(), value, held, flags)
            notes.append("step shortened: the bounds' tangents promised too much")
        else:
            self._then = then
        if flags & Bound.ACCELERATION:
            self.counts["acceleration"] += 1
        self._share = share
        self._find_way_out(bool(flat), w)
        slow = min(1.0, self._rate) * share
        if self._rate < WHOLE:
            self.counts["slowed"] += 1
            flags |= Bound.TASK
            notes.append(f"the reference is followed at {self._rate:.0%} of its pace, {self.clock.behind:.2f} s behind")
        if self._bridging:
            notes.append("bridging a jump of the reference")
        if self.clock.thinned:
            notes.append(f"every second sample that waited was left out: {self.clock.most} wait at most")
        usual = (
            self._limit is None and not self._interaction.active and self.clock.current and not flat and not self._short
        )
        if usual and self._rate >= WHOLE and share >= WHOLE:
            pose, twist = self.clock.read()
            self._inputs[0][:], self._inputs[1][:] = pose, twist
            self._inputs[2][:] = self._inputs[3][:] = 0.0
            self._good, self._live, self._rate = self._ladder.parameters.tobytes(), self._fused, 1.0
        return Command(value, status, solver, residual, ladder.iterations, "; ".join(notes), flags, slow)

    def _accepted(self) -> tuple[Array, Array]:
        """Pose (4, 4) and twist (6,) of the last tick that needed no clock."""
        _, pose, twist, _ = np.split(np.frombuffer(self._good), np.cumsum((self.chain.n, 16, 6)))
        return pose.reshape(4, 4).copy(), twist.copy()

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
        return (
            distance_between(pose, before) > JUMP * seconds + 1e-3
            or angle_between(pose, before) > SPIN * seconds + 1e-2
        )

    def _pace(self, here: Array, pose: Array, twist: Array, *, foreseen: bool) -> float:
        """Seconds of the reference to follow in a second; what is foreseen is not late."""
        clock = self.clock
        x, y, z, turning_x, turning_y, turning_z = twist.tolist()
        speed = math.sqrt(x * x + y * y + z * z)
        turning = math.sqrt(turning_x * turning_x + turning_y * turning_y + turning_z * turning_z)
        # What the person's arm cannot do of the reference is no reason to dwell there: it would not come to an end.
        aim = pose if self._aim is None else self._aim
        away, turned = self._beyond(here, aim)
        eased = min(max((WAITS - max(away / self.max_deviation, turned / self.max_turn)) / (WAITS - CALM), 0.0), 1.0)
        pace = 1.0
        if not foreseen and self._interaction.pace == 1.0:  # nobody is hurried who pushes
            late = clock.lag - self.dt
            if late > 0.0 and not clock.is_still(*STILL):
                pace += min(self.catch_up, late / CATCHING_UP + AT_LEAST)
            elif late > 0.0 and eased == 1.0:
                # What rests is passed at full haste to the last tick: nothing moves that would have to be slowed down.
                pace += RUSH
        pace *= eased * self._interaction.pace
        linear, angular = SPARE * self.linear_speed, SPARE * self.angular_speed
        pace = min(pace, clock.pace, linear / max(speed, 1e-9), angular / max(turning, 1e-9))
        # A hand that stands short of the reference has no share of the motion towards it: that is no reason to wait.
        before = self._rate * (self._share if self._share < WHOLE and not self._short else 1.0)
        return min(pace, max(before, 0.0) + self.dt / QUICKENING)

    def _reference(self, here: Array, now: tuple[Array, Array], rate: float) -> tuple[Array, Array, float]:
        """Pose and twist to follow now, and the pace: as much as the deviation allows, and braking near that.

        Where not even the reference as it is does, because the model of the person's arm moves, it stands, too.
        """
        clock, limit, q = self.clock, self._limit, self._q.copy()
        posture = None if limit is None else limit.q
        beyond = 0.0 if self._aim is None else distance_between(now[0], self._aim)
        allowed = max(WAITS * self.max_deviation + self._apart + beyond, distance_between(now[0], here))
        for part in PACES:
            pace = part * rate
            pose, twist = clock.read(pace * self.dt) if pace > 0.0 else now
            if distance_between(pose, here) > allowed and pace > 0.0:
                continue
            target, motion = pose, pace * twist
            if limit is not None:
                limit.q = posture
                target, motion = limit.limited(target, motion)
            held = Held(self._cut(here, target), target, self.max_turn + self._aside)
            if self._held is None or (self._near(here, held) and self._kept(q, self._slowed_alike, held)):
                break
        else:
            if limit is not None:
                limit.q = posture
            assert self._held is not None
            held = self._held
            pose, target, motion = now[0], held.target, np.zeros(6)
        if pace > 0.0:
            clock.advance(pace * self.dt)
        self.followed, self._held = pose, held
        if limit is not None:
            self._aim = target
        return target, motion, pace

    def _near(self, here: Array, held: Held) -> bool:
        """Whether what the person's arm does now stays within the hand's bounds, or comes nearer to it."""
        before = self._held
        if before is None or self._limit is None:
            return True
        away, turned = math.dist(here[:3, 3], before.centre), angle_between(here, before.target)
        return math.dist(here[:3, 3], held.centre) <= max(WAITS * self.max_deviation, away) and (
            angle_between(here, held.target) <= max(WAITS * self.max_turn + self._aside, turned)
        )

    def _safe(self, reason: str) -> Command:
        """Decelerate within the bounds, and faster where the floor or the planes ask for it."""
        self._live, self._waited, self._stood = False, 0.0, 0.0
        self._rate = 0.0
        self.counts["braked"] += 1
        self._last_before = self._last.copy()
        q, held = self._audited, self._held  # before the prediction goes on
        command = super()._safe(reason)
        if held is None:
            here = self.chain.pose(q)
            held = Held(here[:3, 3], here, self.max_turn)
        self._ladder.memory[2 * self.chain.n :] = 0.0
        if command.value.any() and not self._kept(q, command.value, held):
            value, flags = self._shortened(q, command.value, held, command.yielded)
            if flags & Bound.ACCELERATION:
                self.counts["acceleration"] += 1
            status = Status.BRAKING if value.any() else Status.HOLDING
            command = command._replace(value=value, yielded=flags, status=status)
        return command

    def _unusable(self, pose: Array, twist: Array) -> str:
        """Why a state or sample cannot be used, or nothing."""
        moving = [("obstacles", self._inputs[-1])] if self.limits.moving else []
        for name, array in (("q", self._q), ("pose", pose), ("twist", twist), *moving):
            bad = ~(np.abs(array) <= PLAUSIBLE)
            if bad.any():
                where = ", ".join(str(i) for i in np.argwhere(bad)[0])
                return f"{name}[{where}] is {array[bad][0]}, not a usable number"
        return "" if self._rigid.of(pose.ravel())[0] else self.requirement
