"""Tick of a mirrored hand along a recording that is known in advance: a preview lays out most ticks."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.command import Command, Relaxed, Status
from rehab_opt.control.interaction import FELT
from rehab_opt.control.mirror_following import RATE, THEN, MirrorFollowing
from rehab_opt.control.mirror_pace import QUICKENING
from rehab_opt.control.mirror_statement import SPARE, WHOLE
from rehab_opt.control.mirror_tick import VERDICT
from rehab_opt.control.preview import Layout, Preview
from rehab_opt.control.reasons import NUMBER
from rehab_opt.control.reference_clock import JUMP, SPIN
from rehab_opt.optim.fallback_chain import FUSED
from rehab_opt.optim.fused import FUSED_SOLVERS

__all__ = ["MirrorPreview"]

Array = NDArray[np.float64]

SPAN = 64, 128
"""Initial and largest number of ticks in a layout; after a layout of which every tick was used, the number doubles."""
REST = 32
"""Largest number of ticks between an unusual tick and the next layout; the number starts at one and doubles."""

_OK, _NAN, _new, _read_only = Status.OK, math.nan, tuple.__new__, np.frombuffer
_BOUNDS, _TASK = tuple(Relaxed(i) for i in range(8)), int(Relaxed.TASK)
_USUAL, _LEADS_TO = VERDICT["usual"], VERDICT["then"]
_NOTHING = Layout(np.zeros((0, 4, 4)), np.zeros((0, 6)), [], [])


class MirrorPreview(MirrorFollowing):
    """Tick of `MirrorTracker.plan`; the reference comes from the preview of a recording.

    The usual tick is one call of a fused function, certified as in `MirrorTracker.step`. `MirrorFollowing` computes
    all other ticks.
    """

    def _begin(self) -> None:
        super()._begin()
        self._preview: Preview | None = None
        self._laid, self._flat, self._next = _NOTHING, np.zeros((0, 16)), 0
        self._span, self._rest, self._resting = SPAN[0], 1, 0
        self._origin = 0

    def preview(self, q: Array, poses: Array, twists: Array, stamps: Array) -> None:
        """Pass a whole recording to the clock: poses (N, 4, 4), twists (N, 6) and time stamps (N,) [s]."""
        self._claim()  # not needed in a plan
        clock, here = self.clock, self.chain.pose(q)
        self._live = False
        first = float(stamps[0]) - self.dt
        clock.start(here, np.zeros(6), stamp=first)
        seconds = np.diff(stamps, prepend=first)
        way = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
        cosine = 0.5 * (np.einsum("nij,nij->n", poses[1:, :3, :3], poses[:-1, :3, :3]) - 1.0)
        turn = np.arccos(np.clip(cosine, -1.0, 1.0))
        jumps = (way > JUMP * seconds[1:] + 1e-3) | (turn > SPIN * seconds[1:] + 1e-2)
        starts = [0, *(np.flatnonzero(jumps) + 1).tolist()]
        for i, j in zip(starts, [*starts[1:], len(poses)], strict=True):
            clock.push(poses[i], twists[i], seconds=float(seconds[i]), bridge=True, thinning=False)
            clock.extend(poses[i + 1 : j], twists[i + 1 : j], seconds[i + 1 : j])
        clock.slow_ahead(
            linear_speed=SPARE * self.linear_speed, angular_speed=SPARE * self.angular_speed, quickening=QUICKENING
        )

    def follow(self, q: Array) -> Command:
        """One tick along the clock's preview."""
        if self._resting > 0 or not self._verdict[_USUAL]:
            self._resting -= 1
        elif self._next < len(self._laid.paces) or self._lay_out():
            command = self._as_laid_out(q)
            if command is not None:
                self._rest = 1
                return command
            self._laid, self._span = _NOTHING, SPAN[0]
            self._resting, self._rest = self._rest, min(2 * self._rest, REST)
        self._q[:] = q
        here = self._moving.of(q, self._last).reshape(4, 4)
        return self._tracked(here, self._moving.outputs[1].copy(), previewed=True)

    def brake(self, q: Array) -> Command:
        """One tick towards rest, within the bounds."""
        self._q[:] = q
        return self._stopped(np.array([NUMBER["NOT_ENABLED"], -1.0, -1.0]))._replace(reason="the plan ends here")

    def tools(self, path: list[Array]) -> Array:
        """Poses of the tool (M, 4, 4) at the postures `path`; faster than `chain.pose` for each."""
        q, pose = self._moving.inputs[0], self._moving.outputs[0].reshape(4, 4)
        found = np.empty((len(path), 4, 4))
        for i, each in enumerate(path):
            q[:] = each
            self._moving.evaluate()
            found[i] = pose
        return found

    # ---------------------------------------------------------------------------------------------------- layout
    def _lay_out(self) -> bool:
        """Lay out the next ticks from the clock's position; return whether there are any."""
        clock = self.clock
        plain = self._limit is None and not self._felt[FELT["active"]]
        if not plain or clock.bridging or self._solvers.solver != FUSED:
            return False
        if self._preview is None:
            self._preview = clock.preview(
                linear_speed=SPARE * self.linear_speed, angular_speed=SPARE * self.angular_speed
            )
            self._origin = clock.passed
        place = clock.passed - self._origin, clock.fraction
        self._laid = self._preview.ahead(place, self._remembered[RATE], self._span, dt=self.dt, quickening=QUICKENING)
        self._flat, self._next, self._span = self._laid.poses.reshape(-1, 16), 0, min(2 * self._span, SPAN[1])
        self._place = place[0]
        return bool(self._laid.paces)

    def _as_laid_out(self, q: Array) -> Command | None:
        """Command of the next tick in the layout; None if the tick is not a usual one."""
        k, laid = self._next, self._laid
        verdict = self._verdict
        self._q[:] = q
        self._views[1][:] = self._flat[k].data
        self._views[2][:] = laid.twists[k].data
        self._told[0] = _NAN  # see `FallbackChain`: after a failure inside, the outputs are unchanged
        self._function.evaluate()
        left, residual, who, relaxed, share, _ = self._head.tolist()
        if left or not verdict[_USUAL]:
            return None
        self._solvers.keep[:] = self._solvers.answer
        self._next = k + 1
        pace, (at, fraction) = laid.paces[k], laid.places[k]
        self.clock.go_on(at - self._place, fraction, pace * self.dt)
        memory, self._place, self.followed = self._remembered, at, laid.poses[k]
        memory[THEN], memory[RATE] = verdict[_LEADS_TO], pace
        self._held[:] = laid.poses[k][:3, 3]
        self._short_by = self._beyond_person = (0.0, 0.0)
        flags = int(relaxed)
        if pace < WHOLE:
            self.counts["slowed"] += 1
            flags |= _TASK
        value = _read_only(self._velocity.tobytes())
        solver = FUSED_SOLVERS[int(who)]
        return _new(Command, (value, _OK, solver, residual, -1, "", _BOUNDS[flags], pace * share, None))
