"""What must be true of the chair in every tick of every run: bounds that never yield, and words that are true.

Instants within a tick are judged too, at a quarter, half and three quarters of it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rehab_opt import Relaxed
from tests.judge.chair_robot import LACKING, STAND_OFF, WHEEL_LIMIT, Array, Obstacles
from tests.judge.chair_runs import Part, Run, rolled
from tests.judge.verdict import Answers, Verdict

ROUNDING = 1e-9
"""[m, rad, m/s, rad/s] What sums of numbers of this size may miss a bound by."""
REACH = 1.1
"""[m] Of the longest arm: within a tick its way bows from its chord, and a keep-out's roundness comes towards that."""
NEAR = 0.005
"""[m] A keep-out or obstacle nearer than this is at work."""
MISSED = 2e-3
"""Fraction of the command by which the hand may be off without a word."""
STILL = 1e-5
"""[m/s, rad/s] Slower than this is at rest."""
INSTANTS = (0.25, 0.5, 0.75)


def judge_ticks(
    run: Run, verdict: Verdict, *, excused: NDArray[np.bool_] | bool = False, led: NDArray[np.bool_] | bool = False
) -> tuple[Answers, Array]:
    """Judge all that holds in every tick; the answers and u (n, 7) come back.

    `excused` says where else accelerations may yield, (n,), `led` where braking may lead joints away from a limit.
    Where accelerations do yield there, one may be led across the limit, as long as all together slow down.
    """
    chair, dt = run.chair, run.dt
    found = verdict.answers(run.commands, dt)
    value, q, ahead = found.value, run.q[:-1], run.ends
    finite = np.isfinite(value).all(axis=1)
    verdict.holds("commands are finite", finite)
    u = chair.chassis(q, value)
    before = np.vstack([run.start, u[:-1]])
    way = np.array([rolled(each, dt) for each in value]) if run.arcs else dt * value
    verdict.within("a command stays what it was when it was given", np.abs(ahead - q - way), 1e-12 + 1e-14 * np.abs(q))

    # Velocities never yield.
    verdict.within("joint speeds", np.abs(u), chair.velocity + ROUNDING)
    verdict.within("chassis speed", np.hypot(u[:, 0], u[:, 1]), chair.velocity[0] + ROUNDING)
    limit = WHEEL_LIMIT[chair.drive]
    if found.wheels is None:
        verdict.breaks("wheel speeds are told", "none")
    else:
        verdict.within("wheel speeds belong to the value", np.abs(found.wheels - chair.wheels(u)), 1e-8)
        verdict.within("wheel speeds", np.abs(found.wheels), limit + ROUNDING / 0.1)
        verdict.during("a wheel at its limit", np.max(np.abs(found.wheels), axis=1, initial=0.0) > 0.999 * limit, dt)
    if LACKING[chair.drive]:
        verdict.within("wheels roll", np.abs(u[:, LACKING[chair.drive]]), ROUNDING)
    verdict.during("a speed at its limit", np.any(np.abs(u[:, 2:]) > 0.999 * chair.velocity[2:], axis=1), dt)
    verdict.during("chassis speed at its limit", np.hypot(u[:, 0], u[:, 1]) > 0.9 * chair.velocity[0], dt)

    # Positions: never beyond, or never further.
    arm, arm_ahead = q[:, 3:], ahead[:, 3:]
    verdict.within("joint limits, above", arm_ahead - np.maximum(arm, chair.upper), ROUNDING)
    verdict.within("joint limits, below", np.minimum(arm, chair.lower) - arm_ahead, ROUNDING)
    room = np.minimum(chair.upper - arm, arm - chair.lower)
    verdict.during("a joint at its limit", np.any(np.abs(room) < 0.01, axis=1), dt)
    verdict.during("a joint outside its limits", np.any(room < -1e-6, axis=1), dt)
    gaps, then = chair.arm_gaps(q), chair.arm_gaps(ahead)
    verdict.within("keep-outs", np.minimum(gaps, 0) - then, ROUNDING)
    instants = [chair.arm_gaps(q + part * (ahead - q)) for part in INSTANTS]
    lowest = np.minimum(np.minimum(gaps, then), 0)
    turn = dt * np.abs(u[:, 3:]).sum(axis=1)[:, None]
    nearest = np.min(instants, axis=0)
    bow = (REACH + REACH**2 / (nearest + chair.radii)) * turn**2 / 8 + ROUNDING
    verdict.within("keep-outs within the tick", lowest - nearest, bow)
    verdict.during("a keep-out near", np.min(gaps, axis=1) < NEAR, dt)

    slows = np.isin(found.status, ("ok", "backup", "blocked"))[:, None] | (np.abs(u) <= np.abs(before) + 1e-12)
    whole, was = (np.linalg.norm(each / np.maximum(chair.velocity, 1e-300), axis=1) for each in (u, before))
    across = np.broadcast_to(excused, len(u)) & (found.relaxed & Relaxed.ACCELERATION.value != 0) & (whole <= was)
    verdict.holds("what is not certified only slows", slows | (across | np.broadcast_to(led, len(u)))[:, None])
    late = np.logical_or(judge_obstacles(run, verdict, u, before), excused)
    judge_acceleration(run, verdict, found, u, before, late)
    for part, ticks in zip(run.parts, run.slices, strict=True):
        judge_words(run, verdict, found, u, before, part, ticks)
    return found, u


def judge_obstacles(run: Run, verdict: Verdict, u: Array, before: Array) -> Array:
    """(n,) whether an obstacle came too late for all to brake together, or around the chair; T + 1 s from then.

    Longer where there was no tick since then from which all could have braked together: a post that appeared on the
    outline stays on it while the chair slides along.
    """
    chair, dt = run.chair, run.dt
    late, obstacles, came_late = np.zeros(len(u), dtype=bool), (), False
    settled = round((chair.braking_time + 1.0) / dt)
    for part, ticks in zip(run.parts, run.slices, strict=True):
        if part.obstacles is not None:
            obstacles = tuple(part.obstacles)
            at = run.q[ticks.start]
            came_late = bool(obstacles) and not chair.brakes_in_time(at, before[ticks.start], obstacles, dt)
        if came_late:
            in_time = (
                k for k in range(ticks.start, ticks.stop) if chair.brakes_in_time(run.q[k], before[k], obstacles, dt)
            )
            end = next(in_time, None)
            came_late = end is None
            late[ticks.start : ticks.stop if end is None else end] = True
            if part.obstacles is not None:
                late[ticks.start : ticks.start + settled] = True
        if obstacles:
            nearest = _judge_gaps(run, verdict, obstacles, ticks)
            for k in np.flatnonzero(nearest < 0) + ticks.start:  # one that appeared around the chair
                late[k : k + settled] = True
    verdict.during("an obstacle came too late", late, dt)
    return late


def _judge_gaps(run: Run, verdict: Verdict, obstacles: Obstacles, ticks: slice) -> Array:
    """Never into an obstacle, nor deeper; the nearest gap (n,) at each tick's begin [m]."""
    q, ahead = run.q[ticks], run.ends[ticks]
    gaps = run.chair.obstacle_gaps(q, obstacles)
    instants = [run.chair.obstacle_gaps(q + part * (ahead - q), obstacles) for part in (*INSTANTS, 1.0)]
    verdict.within("obstacles", np.minimum(gaps, 0) - np.min(instants, axis=0), ROUNDING)
    nearest = np.min(gaps, axis=1)
    verdict.during("obstacles around", np.isfinite(nearest), run.dt)
    verdict.during("an obstacle near", nearest < 2 * NEAR, run.dt)
    verdict.during("within an obstacle", nearest < 0, run.dt)
    return np.asarray(nearest)


def judge_acceleration(run: Run, verdict: Verdict, found: Answers, u: Array, before: Array, late: Array) -> None:
    """Never more than a dt a tick, but where an obstacle came too late or a joint, or the arm, was outside.

    And while a velocity given to `reset` brakes, T, where on that way the arm passes a keep-out within `STAND_OFF`: it
    comes too late for the room that the controller keeps there, as the docstring says. All else is judged there, too.
    """
    chair, dt = run.chair, run.dt
    allowed = np.minimum(chair.acceleration * dt, 2 * chair.velocity)
    change = np.abs(u - before)
    hurried = np.any(change > allowed * (1 + 1e-6) + ROUNDING, axis=1)
    flagged = (found.relaxed & Relaxed.ACCELERATION.value) != 0
    verdict.holds("a change beyond the acceleration is flagged", ~hurried | flagged)
    arm = run.q[:-1, 3:]
    outside = np.any((arm > chair.upper + ROUNDING) | (arm < chair.lower - ROUNDING), axis=1)
    outside |= np.min(chair.arm_gaps(run.q[:-1]), axis=1) < -ROUNDING
    excused = late | outside
    if run.start.any() and np.min(chair.arm_gaps(chair.braked(run.q[0], run.start, dt))) <= STAND_OFF:
        excused[: round(chair.braking_time / dt)] = True
    factor = np.where(excused[:, None], 0.0, change / allowed)
    verdict.within("acceleration is never relaxed", factor, 1 + 1e-6)
    verdict.during("beyond the acceleration, too late", hurried & excused, dt)
    verdict.during("an acceleration at its bound", np.any(change > 0.99 * allowed, axis=1), dt)


def judge_words(run: Run, verdict: Verdict, found: Answers, u: Array, before: Array, part: Part, ticks: slice) -> None:
    """Status, reason, scale and what was relaxed, against what the hand did."""
    chair, dt = run.chair, run.dt
    status, scale, relaxed = found.status[ticks], found.scale[ticks], found.relaxed[ticks]
    certified = (status == "ok") | (status == "backup") | (status == "blocked")
    moving = np.max(np.abs(u[ticks]), axis=1) > STILL
    verdict.holds("a plain OK gives no reason, all else does", (status == "ok") == (found.reason[ticks] == ""))
    verdict.within("what is certified has a residual", np.where(certified, found.residual[ticks], 0.0), 1e-8)
    verdict.holds("scale is from 0 to 1", (scale >= 0) & (scale <= 1))
    verdict.holds("holding is at rest", (status != "holding") | ~np.any(u[ticks], axis=1))
    if part.enable is not True or part.fault:
        why = "numbers that are none" if part.enable is True else "the dead-man released"
        verdict.holds(f"{why}: the safe command", ~certified)
        verdict.during(f"{why}, moving", moving, dt)
        return
    if part.target is not None:
        verdict.holds("moving with scale 0 is not OK", ~((scale == 0) & moving & (status == "ok")))
        return
    size = np.linalg.norm(part.twist, axis=1)
    asked = size > 1e-4
    verdict.during("command zero", size == 0, dt)
    verdict.during("command zero, moving", (size == 0) & moving, dt)
    stopped = asked & (scale == 0)
    untrue = stopped & moving & (status == "ok")
    changed = np.r_[True, np.any(np.diff(part.twist, axis=0) != 0, axis=1)]
    since = np.arange(len(size)) - np.maximum.accumulate(np.where(changed, np.arange(len(size)), 0))
    settled = since * dt >= chair.braking_time + 1.0
    verdict.holds("moving with scale 0 is not OK, held", ~(untrue & settled))
    verdict.holds("moving with scale 0 is not OK, after a change of command", ~(untrue & ~settled))
    verdict.during("stopped with scale 0", stopped & ~moving, dt)
    # The hand's velocity at both ends of the tick, and its chord: scale and flag may speak of what is between them.
    begin, value = run.q[:-1][ticks], found.value[ticks]
    end = begin + dt * value
    first, last = (
        np.einsum("nij,nj->ni", chair.task(at, part.rows, part.frame), chair.chassis(at, value)) for at in (begin, end)
    )
    hands = first, last, chair.hand_velocity(begin, end, dt, part.rows, part.frame)
    along = np.clip([np.sum(hand * part.twist, axis=1) / np.maximum(size, 1e-12) ** 2 for hand in hands], 0, 1)
    told = asked & certified
    # What is said is said of where the last velocity leads by the middle of the tick: links of a metre have turned.
    turned = np.abs(u[ticks] - before[ticks])[:, 2:].sum(axis=1) * dt / 2
    near = 2e-6 + turned * np.abs(u[ticks]).sum(axis=1)
    off = np.maximum(np.min(along, axis=0) - scale, scale - np.max(along, axis=0)) - near / np.maximum(size, 1e-9)
    verdict.within("scale is the fraction of the command that the hand does", np.where(told, off, 0.0), MISSED)
    short = [np.linalg.norm(hand - part.twist, axis=1) > MISSED * size + near for hand in hands]
    missed = np.all(short, axis=0)
    flagged = (relaxed & Relaxed.TASK.value) != 0
    verdict.holds("a hand that does another thing than asked is flagged", ~(told & missed) | flagged)
    verdict.during("the hand slowed", told & (scale < 0.9), dt)
    verdict.during("the hand as asked", told & ~missed, dt)
