"""Tick of a mirrored hand: select the reference pose to track, and the clock's pace."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.command import Command, Status
from rehab_opt.control.interaction import Interaction
from rehab_opt.control.judged_state import GIVEN
from rehab_opt.control.mirror_pace import COUNTED, PACE, REMEMBERED, TRIED
from rehab_opt.control.mirror_statement import MirrorStatement
from rehab_opt.control.mirror_tick import NOTE, NOTICED
from rehab_opt.control.person_limit import PersonLimit
from rehab_opt.control.reasons import NUMBER
from rehab_opt.control.reference_clock import ReferenceClock
from rehab_opt.control.velocity_controller import real_numbers
from rehab_opt.optim.fallback_chain import FUSED
from rehab_opt.symbolic import BufferedFunction

__all__ = ["BRIDGE", "MirrorFollowing"]

Array = NDArray[np.float64]

SETTLING_TICKS = 3
"""Steps of the led arm's model in a tick, while the model converges to its first pose."""
BRIDGE = 0.5
"""A jump of the reference is bridged at this fraction of the hand's largest speeds."""
THEN, LIVE = REMEMBERED["then"], REMEMBERED["live"]
TARGET, MOTION = TRIED.places["target"], TRIED.places["motion"]
RATE, APART, ASIDE = (REMEMBERED["pace"] + PACE[name] for name in ("rate", "apart", "aside"))


class MirrorFollowing(MirrorStatement):
    """Tick of `MirrorTracker` in all cases but the usual one: a lag, a push, a limited range of motion, or a fault."""

    clock: ReferenceClock
    counts: Counter[str]
    _interaction: Interaction
    _limit: PersonLimit | None
    _tried: BufferedFunction
    _concluded: BufferedFunction
    _moving: BufferedFunction
    _notice: BufferedFunction
    _deliver: BufferedFunction
    _brake: BufferedFunction
    _memory: Array
    """Memory `REMEMBERED`; `_remembered`, `_felt` (state of the force response) and `_held` (position) are its views.
    """
    _remembered: memoryview[Any]
    _felt: Array
    _held: Array

    def _begin(self) -> None:
        self.clock.reset()
        self.counts.clear()
        if self._limit is not None:
            self._limit.reset()
        self._memory[:] = self.beginning_of_memory()
        self._short_by = self._beyond_person = (0.0, 0.0)
        self._live = False
        self._good = b""
        self.followed: Array = np.full((4, 4), math.nan)
        """(4, 4) reference pose of the last tick that used the clock, before the person's arm and forces change it."""
        self._given[GIVEN["judged"]] = 1.0  # except in `step`, where a state is measured

    def beginning_of_memory(self) -> Array:
        """Initial memory `REMEMBERED`."""
        memory, at = np.zeros(REMEMBERED.size), REMEMBERED.places
        memory[at["held"]] = memory[at["aim"]] = memory[THEN] = math.nan
        memory[at["felt"]], memory[RATE] = self._interaction.start, 1.0
        return memory

    def _followed(self, force: ArrayLike | None) -> Command:
        notice, clock = self._notice, self.clock
        *_, felt, measured, accepted, _ = notice.inputs
        felt[:], measured[:] = 0.0 if force is None else real_numbers("force", force, (3,)), force is not None
        if self._live:
            last, motion = self._accepted()
            accepted[:16], accepted[16:] = last.reshape(-1), motion
            clock.start(last, motion)
            self._live = False
        notice.evaluate()
        self._q[:], self._solvers.everything[:], self._memory[:], said = notice.outputs
        self._given[GIVEN["judged"]] = 1.0
        here, hand = said[NOTICED["here"] : NOTICED["hand"]].reshape(4, 4), said[NOTICED["hand"] :]
        settled = said[0] or self._limit is None or self._limit.settle(here, ticks=SETTLING_TICKS)
        if not settled:
            said[0] = NUMBER["MODEL_SETTLES"]
        if said[0]:
            clock.lost += self.dt
            return self._stopped(said[: NOTICED["here"]])
        pose, twist, first = self._inputs[0], self._inputs[1], clock.empty
        if first:
            clock.start(here, np.zeros(6))
        clock.push(pose, twist, bridge=first)
        return self._tracked(here, hand)

    def _tracked(self, here: Array, hand: Array, *, previewed: bool = False) -> Command:
        """One tick along the clock for a tool at pose `here`, twist `hand`; the clock catches up unless `previewed`."""
        clock, limit, memory = self.clock, self._limit, self._memory
        at, samples, entries = clock.now, clock.window.T, here.reshape(-1)
        near = self._tried.of(samples, at, memory, (not previewed, clock.pace), entries)
        taken = self._tried.outputs[1].copy()
        if limit is not None:
            target, taken[MOTION] = limit.limited(taken[TARGET].reshape(4, 4), taken[MOTION])
            taken[TARGET] = target.reshape(-1)
        self.followed = taken[:16].reshape(4, 4).copy()
        memory[:] = self._concluded.of(samples, at, near, entries, hand, taken, memory)
        _, said, after, aimed = self._concluded.outputs
        self._inputs[0][:], self._inputs[1][:] = aimed[:16].reshape(4, 4), aimed[16:]
        passed, *_, far, turned = said.tolist()
        _, fraction, lag, *_ = after.tolist()
        clock.stand(int(passed), fraction, lag)
        self._beyond_person, self._short_by = (far, turned), (memory[APART] + far, memory[ASIDE] + turned)
        solver = self._solvers()
        return self._delivered(solver, said) if solver else self._stopped(np.zeros(3))

    def _delivered(self, solver: str, said: Array) -> Command:
        deliver, solvers, clock = self._deliver, self._solvers, self.clock
        _, _, _, *inputs, _ = deliver.inputs
        for array, values in zip(inputs, (said, clock.window[0], clock.thinned), strict=True):
            array[:] = values
        deliver.evaluate()
        solvers.parameters[:], told, self._memory[:] = deliver.outputs
        self._live = bool(self._memory[LIVE]) and solvers.solver == FUSED
        self._memory[LIVE], self._good = self._live, solvers.parameters.tobytes()
        self._count()
        command = self._as_told(told.data)._replace(solver=solver, iterations=solvers.iterations)
        if solver == solvers.backup != solvers.solver:
            words = f"{solvers.solver} gave no certified answer", command.reason
            command = command._replace(status=Status.BACKUP, reason="; ".join(filter(None, words)))
        return command

    def _stopped(self, why: Array) -> Command:
        """Fallback command; `why` (3,) are the first three values of `NOTICED`."""
        self._live = False
        self._brake.inputs[3][:] = why
        self._brake.evaluate()
        self._solvers.everything[:], told, self._memory[:] = self._brake.outputs
        self._count()
        return self._as_told(told.data)

    def _count(self) -> None:
        counted = self._memory[REMEMBERED.places["counted"]]
        for name, times in zip(COUNTED.places, counted.tolist(), strict=True):
            if times:
                self.counts[name] += int(times)
        counted[:] = 0.0

    def _accepted(self) -> tuple[Array, Array]:
        good = np.frombuffer(self._good)[self.chain.n :].copy()
        return good[:16].reshape(4, 4), good[16:22]

    def _noted(self, notes: int) -> str:
        if not notes:
            return ""
        pace, behind = self._memory[RATE], self.clock.behind
        words = {
            "SLOWED": f"the reference is followed at {pace:.0%} of its pace, {behind:.2f} s behind",
            "BRIDGING": "bridging a jump of the reference",
            "THINNED": f"every second sample that waited was left out: {self.clock.most} wait at most",
        }
        return "; ".join(each for name, each in words.items() if notes & NOTE[name])

    def _words(self, reason: float, where: float, element: float, details: Sequence[float]) -> str:
        """Text of a reason; `where` is the index of the faulty argument of `step`, obstacles and force counted last."""
        if reason == NUMBER["FORCE_AT_LIMIT"]:
            return self._interaction.too_large(self._felt)
        if reason == NUMBER["INPUT_INVALID"] and where == 3 + (self.limits.moving_size > 0):
            return "force is not a valid number"
        return super()._words(reason, where if where < 3 else -1, element, details)
