"""The chair's law: a stick held still gives the hand this velocity, or less of it, or a stop where no more is possible.

"Against" is the component of the hand's velocity opposite to the command, "across" the length of what is square to it,
both as fractions of the command; the hand's velocity is by finite differences over the tick of the judge's own forward
kinematics, in the frame that was asked. It is judged from T + 1 s after the command began, T = max v/a of the joints.
Where wheels hold their speeds, so that the chair goes along an arc, the half of its turn within a tick is allowed for.

A tick is *strict* where |hand| <= 1.02, against <= 0.02 and across <= 0.05. Others are of a braking episode: a stretch
of consecutive ticks that are not strict lasts at most T, and in it along <= 1.02, against <= 0.15 and across <= 0.15.
Where the hand does less than 2 % of the command for the last second of a run, and for T where that is longer, it has
stopped, and then no velocity within the true bounds leads the hand exactly along the command at 5 % of it: see
`Chair.fastest`. A robot that brakes is led for up to T to where it rests, and may pass places where more is possible.
After `RESTED` of the status `BLOCKED` the chair has come to rest but for self-motion: see `TURNS` and `GOES`.

Now and then an arm alone, slow to stop, is led at keep-outs: see `judge_standing`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rehab_opt import RedundancyResolver, Status
from tests.judge.chair_claims import judge_ticks
from tests.judge.chair_robot import Array, Chair, Obstacles
from tests.judge.chair_runs import (
    OTHER_SETS,
    READY,
    SETS,
    Part,
    Run,
    command,
    held,
    motion,
    other_resolver,
    posture,
    record,
    resolver,
)
from tests.judge.numbering import Runs, judging
from tests.judge.verdict import Verdict

GUARANTEES = ("G12",)
LEAST = {
    "solver closed form": 1e5,
    "solver active set": 3e5,
    "solver dual active set": 2e3,
    "a keep-out near": 2e4,
    "a joint at its limit": 5e4,
    "the hand as asked": 2e5,
    "the hand slowed": 2e4,
    "the hand stopped, asked of the linear programme": 5,
    "blocked, and the chair to rest": 1e5,
    "begun in motion": 20,
    "run again after a reset": 5e3,
    "status ok": 5e5,
    "stands before a keep-out": 25,
}
CI_TICKS = 18_000
SHARE = 3.0
DT = 0.01
SIZE, AGAINST, ACROSS = 0.02, 0.02, 0.05
"""Of the command at ticks of up to `DT`, above by dt: the chord of a turning hand's way is up to 3 % off."""
BRAKING = 0.15
STOPPED, POSSIBLE = 0.02, 0.05
RESTED, TURNS, GOES = 4.0, 0.1, 0.05
"""[s, rad/s, m/s] Of a chair that has been blocked for the first."""
SAME, AGAIN = 1e-6, 5
"""[m/s, rad/s] between a run and the same again, of one run in so many: a solver may begin from another guess."""
OTHERS = 13
"""One run in this many is of a random robot."""
STANDING, LED = 26, 3
"""One run in this many is of so many commands that lead an arm to keep-outs."""
LONG, HELD = 0.02, 10.0
"""[s] Their ticks: in long ones an arm stops further off; and how long each is held, in 1.1 T."""
BESIDE, FAR, WELL = 0.03, 0.3, 0.1
"""[m] An arm nearer than this is stopped by a keep-out; [rad] its joints are that far from their limits at least, and
[m/rad] the hand that far from singular postures."""
RESTS = 2e-5
"""[m/s] A slower hand stands, but for the end of braking in proportion: that comes nearer by 1.1 T of it."""


def one_run(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """The two known runaways first, then random ones."""
    if number % STANDING == 2:
        led_to_keep_outs(verdict, number, rng)
        return
    if number < 2:
        rows = (("x", "y"), ("x", "y", "z"))[number]
        twist = np.array(([-0.0567, 0.0399], [-0.1104, 0.072, -0.0123])[number])
        chair, made = resolver("differential", (rows,), DT, 0)
        q, u, parts = READY.copy(), np.zeros(7), [Part(rows, "chassis", held(twist, (12.0, 15.0)[number], DT))]
        dt = DT
    else:
        if number % OTHERS == OTHERS - 1:
            rows, dt = (
                (*SETS, *OTHER_SETS)[rng.integers(len(SETS) + len(OTHER_SETS))],
                float(rng.choice([0.005, 0.01, 0.02])),
            )
            chair, made = other_resolver(rng, dt, 0, (rows,))
        else:
            rows, dt = SETS[number % 3], DT
            chair, made = resolver(("differential", "mecanum")[number // 3 % 2], (rows,), dt, 0)
        q = posture(chair, rng)
        frame = "world" if rng.random() < 0.2 else "chassis"
        u, parts = np.zeros(7), [Part(rows, frame, held(command(rng, rows), rng.uniform(8, 30), dt))]
        begun = rng.random()
        if begun < 0.25:
            u = motion(chair, q, rng, dt)
        elif begun < 0.5:
            parts.insert(0, Part(rows, frame, held(command(rng, rows), rng.uniform(1, 4), dt)))
    recorded = record(made, Run(chair, dt, u, parts, arcs=bool(rng.random() < 0.3)), q)
    verdict.begin(number, f"{chair.drive} {rows} {parts[-1].frame} dt {dt:g} {np.round(parts[-1].twist[0], 4)}")
    judge_ticks(recorded, verdict)
    if number % AGAIN == 0:
        judge_again(made, recorded, verdict)
    verdict.during("begun in motion", np.array([bool(u.any()) or len(parts) > 1]), dt)
    for part, span in zip(parts, recorded.slices, strict=True):
        judge_law(recorded, verdict, part, span)


def led_to_keep_outs(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """An arm on a chair that stands, whose last joint takes long to stop, and so all do."""
    acceleration = np.append(Chair().acceleration[:6], rng.uniform(0.8, 1.5))
    chair, rows = Chair("fixed", acceleration=acceleration), SETS[0]
    made = RedundancyResolver(chair.robot(), drive="fixed", row_sets=(rows,), dt=LONG, max_obstacles=0, compile=False)
    verdict.begin(number, f"last joint's acceleration {acceleration[6]:.3f}, led to keep-outs")
    for _ in range(LED):
        q, way = towards_keep_out(chair, rng)
        parts = [Part(rows, "chassis", held(rng.uniform(0.05, 0.1) * way, HELD * 1.1 * chair.braking_time, LONG))]
        recorded = record(made, Run(chair, LONG, np.zeros(7), parts, arcs=False), q)
        judge_ticks(recorded, verdict)
        judge_standing(recorded, verdict)


def towards_keep_out(chair: Chair, rng: np.random.Generator) -> tuple[Array, Array]:
    """(7,) an arm 4 to 7 cm off a keep-out, free to go on; (3,) about the way of its hand that leads there."""
    for _ in range(10_000):
        q = np.zeros(7)
        q[3:] = rng.uniform(chair.lower + 2 * FAR, chair.upper - 2 * FAR)
        gaps, task = chair.arm_gaps(q), chair.task(q, SETS[0], "chassis")[:, 3:6]
        if 0.04 < gaps.min() < 0.07 and np.linalg.svd(task, compute_uv=False).min() > 1.5 * WELL:
            nearer = chair.arm_gaps(q - 1e-6 * np.eye(7)[3:6]) - chair.arm_gaps(q + 1e-6 * np.eye(7)[3:6])
            way = np.linalg.solve(task.T, nearer[:, gaps.argmin()])
            way = way / np.linalg.norm(way) + 0.1 * rng.standard_normal(3)
            return q, way / np.linalg.norm(way)
    raise ValueError("no posture beside a keep-out found")


def judge_standing(run: Run, verdict: Verdict) -> None:
    """An arm that a keep-out alone stops stands no further off than is said, and by what all joints change in one tick.

    Braking in proportion has no end: what is left of the way is 1.1 T of its speed, and that is less than it was in the
    mean of the last second.
    """
    chair, second = run.chair, round(1.0 / run.dt)
    q = run.q[-second - 1 :]
    gaps, arm = chair.arm_gaps(q), q[-1, 3:6]
    speed = np.linalg.norm(np.diff(chair.hand(q), axis=0), axis=1).max() / run.dt
    room = np.minimum(chair.upper[:3] - arm, arm - chair.lower[:3]).min()
    least = np.linalg.svd(chair.task(q[-1], SETS[0], "chassis")[:, 3:6], compute_uv=False).min()
    nearest = gaps[:, gaps[-1].argmin()]
    if not (nearest[-1] < BESIDE and speed < RESTS and room > FAR and least > WELL):
        return
    time, reach = 1.1 * chair.braking_time, chair.d5 + chair.d7
    left = time * max(nearest[0] - nearest[-1], 0.0)
    said = 1e-3 + reach * (time * chair.acceleration[3:6].max() * run.dt) ** 2 / 2
    tick = reach * (run.dt**2 * chair.acceleration[chair.moving].sum()) ** 2 / 2
    verdict.within("an arm stands further before a keep-out than is said [m]", nearest[-1] - left, said + tick)
    verdict.during("stands before a keep-out", np.array([True]), run.dt)


def judge_again(made: RedundancyResolver, run: Run, verdict: Verdict) -> None:
    """The same run after `reset` gives the same commands: nothing of the past is left."""
    parts = [part._replace(twist=part.twist[:200]) for part in run.parts[:1]]
    again = record(made, Run(run.chair, run.dt, run.start, parts, run.arcs), run.q[0])
    off = [np.abs(one.value - other.value) for one, other in zip(again.commands, run.commands, strict=False)]
    verdict.within("a reset forgets the past", off, SAME)
    verdict.during("run again after a reset", np.ones(len(off), dtype=bool), run.dt)


def judge_law(run: Run, verdict: Verdict, part: Part, span: slice, obstacles: Obstacles = ()) -> None:
    """The law for one held command, from T + 1 s after its begin."""
    chair, dt = run.chair, run.dt
    begin = span.start + int(np.ceil((chair.braking_time + 1.0) / dt))
    if begin + round(1.0 / dt) >= span.stop:
        return
    q, ahead = run.q[begin : span.stop], run.q[begin + 1 : span.stop + 1]
    twist = part.twist[-1]
    hand = chair.hand_velocity(q, ahead, dt, part.rows, part.frame) / np.linalg.norm(twist)
    way = twist / np.linalg.norm(twist)
    along = hand @ way
    across, size = np.linalg.norm(hand - along[:, None] * way, axis=1), np.linalg.norm(hand, axis=1)
    chord = max(1.0, dt / DT)
    value = np.array([command.value for command in run.commands[begin : span.stop]])
    arc = run.arcs * dt / 2 * np.abs(value[:, 2]) * np.hypot(value[:, 0], value[:, 1]) / np.linalg.norm(twist)
    braking = ~((size - arc <= 1 + SIZE * chord) & (along + arc >= -AGAINST * chord) & (across - arc <= ACROSS * chord))
    longest = longest_stretch(braking) * dt
    verdict.within("law: a braking episode lasts at most T", [longest], chair.braking_time + dt / 2)
    verdict.within("law: the hand is no faster than the command", along - arc, 1 + SIZE * chord)
    verdict.within("law: against the command, braking", -along - arc, BRAKING)
    verdict.within("law: across the command, braking", across - arc, BRAKING)
    verdict.during("law judged", np.ones(len(along), dtype=bool), dt)
    verdict.during("a braking episode", braking, dt)
    blocked = np.array([command.status is Status.BLOCKED for command in run.commands[begin : span.stop]])
    since = round(RESTED / dt)
    rests = np.array([np.all(blocked[k - since : k]) for k in range(since, len(blocked) + 1)])  # from tick since - 1 on
    if rests.any():
        chair_at = value[since - 1 :][rests]
        verdict.within("law: a blocked chair turns no faster [rad/s]", np.abs(chair_at[:, 2]), TURNS)
        verdict.within("law: a blocked chair goes no faster [m/s]", np.hypot(chair_at[:, 0], chair_at[:, 1]), GOES)
    verdict.during("blocked, and the chair to rest", rests, dt)
    stood = round(max(1.0, chair.braking_time) / dt)
    if len(along) >= stood and np.all(np.abs(along[-stood:]) < STOPPED):
        # The less of both ends: arms that move while their hand hardly does pass postures where more would be possible.
        possible = min(chair.fastest(run.q[tick], twist, part.rows, part.frame, obstacles, dt)
                       for tick in (span.stop - stood, span.stop))  # fmt: skip
        if obstacles:  # beside them no promise: two or three runs of a thousand creep where the programme finds a way
            verdict.during(
                "the hand stopped beside an obstacle, not so by the programme", np.array([possible > POSSIBLE]), dt
            )
        else:
            verdict.within("law: a stop is where nothing is possible", [possible], POSSIBLE)
        verdict.during("the hand stopped, asked of the linear programme", np.array([True]), dt)


def longest_stretch(mask: NDArray[np.bool_]) -> int:
    """Most ticks on end in which the mask is true."""
    edges = np.flatnonzero(np.diff(np.r_[False, mask, False]))
    return int(np.max(edges[1::2] - edges[::2], initial=0))


run = judging(__name__, LEAST, Runs(one_run), finish=(Verdict.seldom_by_backup,))
