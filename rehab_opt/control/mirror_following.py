"""Tick of a mirrored hand: which pose of the reference is tracked, and at what pace of its clock."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.between_poses import angle_between, distance_between
from rehab_opt.control.command import Bound, Command, Status
from rehab_opt.control.interaction import FELT, AdmittanceState
from rehab_opt.control.judged_state import GIVEN
from rehab_opt.control.mirror_pace import PACES, TRIED
from rehab_opt.control.mirror_statement import HELD, WHOLE, MirrorStatement
from rehab_opt.control.person_limit import PersonLimit
from rehab_opt.control.reasons import HELD_BACK, NUMBER
from rehab_opt.control.reference_clock import ReferenceClock
from rehab_opt.optim.fallback_chain import FUSED
from rehab_opt.symbolic import BufferedFunction

__all__ = ["BRIDGE", "MirrorFollowing"]

Array = NDArray[np.float64]

SETTLING_TICKS = 3
"""Of the model of the led arm while it finds its posture, in each tick: more would not fit into a quick one."""
BRIDGE = 0.5
"""Share of the hand speeds at which a jump is bridged."""


class MirrorFollowing(MirrorStatement):
    """The tick of `MirrorTracker` wherever something is unusual: late, pushed, led by a range of motion, or faulty."""

    clock: ReferenceClock
    _interaction: AdmittanceState
    _limit: PersonLimit | None
    _tried: BufferedFunction
    _aimed: BufferedFunction
    _concluded: BufferedFunction
    _moving: BufferedFunction
    _tool: BufferedFunction
    _rigid: BufferedFunction
    _faulty: BufferedFunction
    _hurried: BufferedFunction

    def _begin(self) -> None:
        self.clock.reset()
        self.counts.clear()
        if self._limit is not None:
            self._limit.reset()
        self._interaction.reset()
        self._rate, self._share, self._then = 1.0, 1.0, math.nan
        self._waited = self._stood = self._apart = self._aside = 0.0
        self._short_by = self._beyond_person = (0.0, 0.0)
        self._live = False
        self._good = b""
        self._held = np.full(HELD.size, math.nan)
        self._aim = np.full((4, 4), math.nan)
        self.followed: Array = np.full((4, 4), math.nan)
        """(4, 4) the reference of the last tick with a clock, before the range of motion and forces."""
        self._lead_w, self._lead_age = -1.0, 0
        self._given[GIVEN["judged"]] = 1.0  # but in `step`, where a state is measured
        self._inputs[2][:] = self._inputs[3][:] = 0.0

    def _followed(self, force: ArrayLike | None, reason: str) -> Command:
        """One tick with the clock, on what stands in the parameters."""
        self._inputs[2][:] = 0.0
        pose, twist = self._inputs[0].copy(), self._inputs[1].copy()
        if self._live:
            last, motion = self._accepted()
            self.clock.start(last, motion)
            self._live = False
            self._hold(last)
        here, hand = self._hand()
        # Work is done where the hand is measured, also where its joints are led ahead of that.
        seen = here if self.led is None else self._tool.of(self._judge.inputs[0])
        pushed = self._interaction.feel(force, seen[:3, 3] - self._held[:3])
        reason = reason or self._unusable() or pushed
        if reason:
            self.clock.lost += self.dt
            return self._safe(reason)
        if self._limit is not None and not self._limit.settle(here, ticks=SETTLING_TICKS):
            self.clock.lost += self.dt
            return self._safe("the model of the led arm finds its posture")
        first = self.clock.empty
        if first:
            self.clock.start(here, np.zeros(6))
        self.clock.push(pose, twist, bridge=first)
        return self._tracked(here, hand)

    def _hand(self) -> tuple[Array, Array]:
        """Pose (4, 4) of the tool, and how it moves (6,)."""
        pose = self._moving.of(self._q, self._last).reshape(4, 4)
        return pose, self._moving.outputs[1].copy()

    def _hold(self, pose: Array) -> None:
        """What the hand is held near, where it followed as usual."""
        self._held = HELD.numbers(centre=pose[:3, 3], target=pose.reshape(-1), turn=self.max_turn)

    def _tracked(self, here: Array, hand: Array, *, previewed: bool = False) -> Command:
        """One tick of following what the clock holds, at a pace that deviation and braking allow; see `MirrorPace`.

        Where even a standing reference is not allowed, since the model of the person's arm moves, the model stands,
        too. With `previewed`, the clock makes up no lag.
        """
        clock, limit, tried, aimed = self.clock, self._limit, self._tried, self._aimed
        posture, q, led = None if limit is None else limit.q, self._q.copy(), limit is not None
        self._last_before = self._last.copy()
        at = clock.waiting, clock.fraction, clock.lag
        pace = self._rate, self._share, self._waited, self._stood, self._apart, self._aside
        others = self._interaction.pace, not previewed, clock.pace
        felt, around = self._interaction.state[: FELT["away"]], self._bodies()

        def aim(target: Array, motion: Array, *, stays: bool) -> bool:
            poses = here.reshape(-1), target.reshape(-1)
            aimed.of(q, self._last_before, *poses, motion, near, felt, self._held, stays, around)
            return bool(aimed.outputs[1][0])

        for part in PACES:
            near = tried.of(clock.window.T, at, pace, others, here.reshape(-1), self._aim.reshape(-1), part)
            taken = tried.outputs[1].copy()
            if not taken[TRIED["fits"]]:
                continue
            target, motion = taken[:16].reshape(4, 4), taken[16:22]
            if limit is not None:
                limit.q = posture
                target, motion = limit.limited(target, motion)
            if aim(target, motion, stays=False):
                break
        else:
            if limit is not None:
                limit.q = posture
            target, led = self._held[3:19].reshape(4, 4), True
            aim(target, motion, stays=True)
        self.followed, self._held = taken[:16].reshape(4, 4).copy(), aimed.outputs[0].copy()
        if limit is not None:
            self._aim = target.copy()
        told = aimed.outputs[1]
        self._inputs[0][:], self._inputs[1][:], self._inputs[2][:] = told[1:17].reshape(4, 4), told[17:23], told[23:]
        after = self._concluded.of(clock.window.T, at, near, others[0], here.reshape(-1), hand, taken)
        self._rate, _, self._waited, self._stood, self._apart, self._aside = after.tolist()
        passed, fraction, lag, self._bridging, waits, cuts, self._short = self._concluded.outputs[1].tolist()
        clock.stand(int(passed), fraction, lag)
        if waits:
            self.counts["waited"] += 1
        if cuts:
            self.counts["cut"] += 1
        beyond = (distance_between(self.followed, target), angle_between(self.followed, target)) if led else (0.0, 0.0)
        self._beyond_person, self._short_by = beyond, (self._apart + beyond[0], self._aside + beyond[1])
        solver = self._solvers()
        if not solver:
            return self._safe("")
        return self._delivered(solver)

    def _delivered(self, solver: str) -> Command:
        """The command of a certified answer, shortened where the true state asks for it."""
        solvers = self._solvers
        residual, _, _, yielded, share, _, kept, w, then, flat = solvers.verdict.tolist()
        status, notes = Status.OK, [HELD_BACK] if self._own["held"][0] else []
        if solver == solvers.backup != solvers.solver:
            status, notes = Status.BACKUP, [f"{solvers.solver} gave no certified answer"]
        value = np.frombuffer(self._velocity.tobytes())
        flags = Bound(int(yielded))
        value, flags, shorter = self._shortened(self._q.copy(), value, self._held, flags, broken=not kept)
        if shorter:
            notes.append("step shortened: the bounds' tangents promised too much")
        else:
            self._then = then
        if flags & Bound.ACCELERATION:
            self.counts["acceleration"] += 1
        self._share = share
        self._find_escape(bool(flat), w)
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
            self._good, self._live, self._rate = self._solvers.parameters.tobytes(), solvers.solver == FUSED, 1.0
        return Command(value, status, solver, residual, solvers.iterations, "; ".join(notes), flags, slow)

    def _accepted(self) -> tuple[Array, Array]:
        """Pose (4, 4) and twist (6,) of the last tick that needed no clock."""
        _, pose, twist, _ = np.split(np.frombuffer(self._good), np.cumsum((self.chain.n, 16, 6)))
        return pose.reshape(4, 4).copy(), twist.copy()

    def _safe(self, reason: str) -> Command:
        """Decelerate within the bounds, and faster where the floor or the planes ask for it."""
        self._live, self._waited, self._stood = False, 0.0, 0.0
        self._rate = 0.0
        self.counts["braked"] += 1
        self._last_before = self._last.copy()
        command = super()._safe(reason)
        q, held = self._finish.outputs[2].copy(), self._held
        if math.isnan(held[0]):
            self._hold(self.chain.pose(q))
            held, self._held = self._held, held
        self._solvers.memory[2 * self.chain.n :] = 0.0
        value, flags, shorter = command.value, command.yielded, False
        if value.any():
            value, flags, shorter = self._shortened(q, value, held, flags, broken=False)
        if shorter:
            if flags & Bound.ACCELERATION:
                self.counts["acceleration"] += 1
            status = Status.BRAKING if value.any() else Status.HOLDING
            command = command._replace(value=value, yielded=flags, status=status)
        return command

    def _told_of_hand(self, command: Command) -> Command:
        """The same; from rest, where whatever holds the hand has stopped the joints in this tick."""
        own = self._own
        if own["touched"][0] and self._hurried.of(own["before"], self._last):
            command = command._replace(yielded=command.yielded | Bound.ACCELERATION)
        return command

    def _unusable(self) -> str:
        """What is wrong with the parameters, the pose among them, or nothing."""
        rigid = self._rigid.of(self._inputs[0].ravel())
        reason, i, k = self._faulty.of(self._solvers.parameters, rigid).tolist()
        return "" if reason == NUMBER["NOT_CERTIFIED"] else self._words(reason, i, k, ())
