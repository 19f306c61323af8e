"""Export of `MirrorTracker`, `system = "mirror"`, without `plan`."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.control import mirror_following
from rehab_opt.control.command import Command
from rehab_opt.control.damped import PASSES
from rehab_opt.control.mirror import MirrorTracker
from rehab_opt.control.mirror_pace import AIMED, COUNTED, FOLLOWED, PACE, REMEMBERED, SAID, TRIED
from rehab_opt.control.mirror_tick import NOTICED, VERDICT
from rehab_opt.control.person_limit import SETTLING, SETTLING_DT, PersonLimit, model_tick
from rehab_opt.control.reference_clock import CLOCK, KEPT, SAMPLE
from rehab_opt.errors import ConfigurationError
from rehab_opt.export.c_text import initialiser, layout, number
from rehab_opt.export.controllers.pose_tracker import NO_BACKUP, TRACKER, moving_argument, moving_values
from rehab_opt.export.exported import BYTES, ExportedVelocity, Law
from rehab_opt.export.generated import renamed
from rehab_opt.export.recording import (
    MAX_TICKS,
    NO_ITERATIONS,
    STAMPED,
    Joints,
    Run,
    RunTick,
    recorded,
    standing,
    with_faults,
)
from rehab_opt.optim.fallback_chain import as_in_c
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.mirror.laws import tracker_of
from rehab_opt.session.mirror.problem import MirrorProblem
from rehab_opt.session.mirror.scene import laid_out
from rehab_opt.session.outcome import Progress

__all__ = ["ExportedMirror", "exported_mirror", "exported_mirror_problem"]

Array = NDArray[np.float64]

NAME = "mirror_tracker"
MEMORY = 96_000
"""[bytes] Default size of the C struct."""
LEAST = 16
"""Smallest size of the buffer of reference samples, in samples."""
CALL = (
    f"rehab_{NAME}_step(&controller, tick->q, tick->pose, tick->twist,{{moving}} "
    "tick->with_force ? tick->force : NULL, tick->enable, tick->stamp, out);"
)
USAGE = f"""\
static rehab_{NAME} controller; /* static: it is large */
rehab_command command;

rehab_{NAME}_init(&controller);
for (;;) {{{{ /* every tick */
    rehab_{NAME}_step(&controller, q, pose, twist,{{moving}} NULL, enable, stamp, &command);
    send(command.value); /* joint velocities, rad/s or m/s */
}}}}"""
FORCED = {
    "pose": "the mirrored pose of the tool now", "force_argument": "const double *force,",
    "scale": "; scale: the time scaling, at most 1", "null_input": "An input other than force",
}  # fmt: skip
"""Arguments and texts of the C step that a `PoseTracker` lacks."""
DIFFERENCES = (
    NO_BACKUP,
    "`plan`, which knows the whole recording, is not there. A controller that may wait for a file may run in Python.",
    "Python's remarks on a command that is no fault (a slowed reference, a bridge) are "
    "`notes`, without their numbers; `reason` is why it is the safe command.",
    STAMPED,
    "Another input than force that is NULL counts as not a number; Python raises an error for an argument of the "
    "wrong shape. A force that is NULL is one that nothing measures, as None is in Python.",
    NO_ITERATIONS,
)
SAME = (
    "At most {0} samples of the reference wait here while the clock does, in Python {1}. Where one more arrives, every "
    "second one of those that wait is left out, with `REHAB_THINNED`, and the path between its neighbours is straight; "
    "their time is kept, and nothing is dropped at either end. `memory` of `export_c` has room for more; in Python "
    "`clock.most` is the number.",
)
OF_A_PERSON = (
    "The same in both: the reference is limited by a model of the led arm, a QP of its own in every tick. At first it "
    f"finds from the middle of its range to the tool, {mirror_following.SETTLING_TICKS} steps a tick and {SETTLING} at "
    "most: until then the robot comes to rest where it is, and the reason is `REHAB_MODEL_SETTLES`.",
)


@dataclass(frozen=True, eq=False, kw_only=True)
class ExportedMirror(ExportedVelocity):
    """A tracker of mirrored poses for export.

    Parameters
    ----------
    tracker : the controller in Python.
    waiting : number of samples in the buffer of reference samples.
    """

    tracker: MirrorTracker
    waiting: int = 0

    def functions(self) -> list[ca.Function]:
        """CasADi functions of the velocity controllers and of the clock."""
        tracker = self.tracker
        speeds = mirror_following.BRIDGE * tracker.linear_speed, mirror_following.BRIDGE * tracker.angular_speed
        clock, parts = tracker.pace.clock, tracker.parts
        extra = {
            "started": clock.started_function(),
            "taken": clock.taken_function(*speeds),
            "followed": tracker.pace.followed_function(),
            "notices": parts.notice,
            "tried_pace": parts.tried,
            "concluded": parts.concluded,
            "delivers": parts.deliver,
            "brakes": parts.brake,
        }
        if tracker._limit is not None:
            extra["person_tick"] = model_tick(tracker._limit.chain)
        return [*super().functions(), *(renamed(function, name) for name, function in extra.items())]

    def shape(self) -> dict[str, str]:
        """Values for the templates of velocity controllers, clock, time scaling and forces."""
        shape = super().shape()
        numbers = int(shape["numbers"]) + SAMPLE.size * (self.waiting + _besides(self.tracker)) + 120
        return {**shape, "numbers": str(numbers), "waiting": str(self.waiting), **_constants(self.tracker)}


def exported_mirror_problem(
    config: ProblemFile[MirrorProblem], *, memory: int = MEMORY, progress: Progress
) -> ExportedMirror:
    """Prepare the `MirrorTracker` of a problem file for export, with a recorded run along the file's recording.

    Raises
    ------
    ProblemFileError : an invalid recording or value of the file.
    """
    problem, scene = config.problem, laid_out(config)
    tracker = tracker_of(problem, scene, file=config.file)
    poses, twists = scene.reference.poses, scene.reference.twists
    return exported_mirror(
        tracker, scene.start, poses, twists, title=problem.title, source=f"the recording of `{config.name}`",
        memory=memory, progress=progress,
    )  # fmt: skip


def exported_mirror(
    tracker: MirrorTracker,
    start: Array,
    poses: Array,
    twists: Array,
    *,
    bodies: Array | None = None,
    title: str,
    source: str,
    memory: int = MEMORY,
    progress: Progress = lambda *_: None,
) -> ExportedMirror:
    """Prepare a `MirrorTracker` for export, with a recorded run of a robot that moves as commanded.

    Parameters
    ----------
    tracker : the controller; the export resets it.
    start : (n,) [rad, m] joint positions at the start; the robot is at rest.
    poses, twists : (N, 4, 4), (N, 6) reference of each tick; as many ticks as fit into a recorded run are used.
    bodies : (N, k, 14) moving capsules from `moving_numbers`, for a tracker with such bodies.
    title, source : short description of the tracker, and of the origin of the poses.
    memory : [bytes] largest size of the C struct; the buffer of reference samples takes the memory that remains.

    Raises
    ------
    ConfigurationError : a solver without C code, a chain with too many joints for a command, or too little memory.
    """
    limit = tracker._limit
    laws = [Law("mirror", tracker)]
    pieces = {"types": "mirror_types.h", "person_limit": "no_person.c", "force_input": "force_input.h", **TRACKER}
    values = moving_values(tracker.limits, "parameters + MOVING") | FORCED
    more, solves = MEMBERS, 2 * (PASSES + 1)
    fallback_chains = [tracker._solvers]
    if limit is not None:
        laws += [Law("following", limit._tracker), Law("settling", limit._settler)]
        pieces |= {"person_limit": "person_limit.c"}
        fallback_chains += [limit._tracker._solvers, limit._settler._solvers]
        values |= _person(limit)
        more += PERSON_MEMBERS.format(limit.chain.n)
        solves *= max(2, mirror_following.SETTLING_TICKS)  # model and robot in a tick, or many of the model alone
    exported = ExportedMirror(
        name=NAME,
        title=f"{title}: joint velocities that lead a hand along a mirrored path",
        laws=laws,
        tracker=tracker,
        interface="mirror",
        call=CALL.format(moving=moving_argument(tracker.limits, "tick->")),
        usage=USAGE.format(moving=moving_argument(tracker.limits)),
        recording=Run((), (), "", ()),
        differences=(),
        solves=solves,
        values=values,
        pieces=pieces,
    )
    most = tracker.clock.most
    waiting = min(most, (memory - exported.bytes) // (BYTES * SAMPLE.size))
    if waiting < LEAST:
        needed = exported.bytes + BYTES * SAMPLE.size * LEAST
        raise ConfigurationError("memory", memory, f"at least {needed} bytes, {LEAST} samples that wait among them")
    try:
        with as_in_c(*fallback_chains):
            tracker.clock.most = waiting
            recording = mirror_run(tracker, start, poses, twists, bodies, source=source, progress=progress)
    finally:
        tracker.clock.most = most
        tracker.reset()
    same = (SAME[0].format(waiting, most), *SAME[1:], *(OF_A_PERSON if limit is not None else ()))
    return replace(
        exported,
        recording=recording,
        differences=(*DIFFERENCES, *same),
        waiting=waiting,
        more_memory=more.format(
            slots=waiting + _besides(tracker),
            **{record: each.size for record, each in RECORDS.items()},
        ),
    )


# ------------------------------------------------------------------------------------------------ template values
RECORDS = {
    "sample": SAMPLE, "pace": PACE, "tried": TRIED, "aimed": AIMED, "said": SAID, "noticed": NOTICED,
    "clock": CLOCK, "verdict": VERDICT, "counted": COUNTED, "remembered": REMEMBERED,
    "followed": FOLLOWED,
}  # fmt: skip
NOTHING_FOLLOWED = FOLLOWED.numbers(reference=math.nan, time_scale=0.0, lag=0.0, manipulability=math.nan, counted=0.0)
MEMBERS = """\
struct {{
    double sample[{slots}][{sample}]; /* of the reference: pose's rows, twist, [s] since the one before, stamp */
    double now[{clock}];           /* ahead, fraction, lag, lost, newest: see CLOCK in Python */
    int first;                     /* the one at hand */
    int thinned;                   /* whether the last sample made every second one go that waited */
}} clock;
double accepted[22];               /* pose and twist of the last tick that needed no clock */
double memory[{remembered}];       /* pace, forces, where the hand is led to, counts */
"""
PERSON_MEMBERS = (
    "double person[{0}]; /* posture of the model of the led arm */\ndouble settling; /* ticks left to find it */\n"
)


def _besides(tracker: MirrorTracker) -> int:
    """Number of buffered samples that are not waiting: two that bridge a jump, and two windows of the clock."""
    return 2 + 2 * tracker.pace.window


def _person(limit: PersonLimit) -> dict[str, str]:
    return {
        "settling_ticks": str(mirror_following.SETTLING_TICKS),
        "max_settling": str(SETTLING),
        "settling_dt": number(SETTLING_DT),
        "person_joints": str(limit.chain.n),
        "person_start": initialiser(limit.start),
    }


def _constants(tracker: MirrorTracker) -> dict[str, str]:
    return {
        "stop_at": number(tracker._interaction.stop_at),
        "window": str(tracker.pace.window),
        "kept": str(KEPT),
        "remembered": initialiser(tracker.beginning_of_memory()),
        "nothing_followed": initialiser(NOTHING_FOLLOWED),
        "places": ", ".join(layout(name, record.places) for name, record in RECORDS.items()),
    }


PUSH = 12.0
"""[N] Largest force of most pushes in the recorded run; one further push exceeds the force that stops the arm."""


def mirror_run(
    tracker: MirrorTracker, start: Array, poses: Array, twists: Array, bodies: Array | None, *, source: str,
    progress: Progress,
) -> Run:  # fmt: skip
    """The recorded run along poses (N, 4, 4) and twists (N, 6) from the posture `start`, with faults and forces.

    The robot moves as commanded. `bodies` (N, k, 14) are moving capsules, or None. `source` describes the origin of the
    poses.
    """
    count = min(len(poses), MAX_TICKS)
    pushed, strong = range(count // 2, 5 * count // 8), 1.1 * tracker._interaction.stop_at
    valid: list[RunTick] = [
        {"q": start, "pose": pose, "twist": twist, "force": _force(k, pushed, strong), "with_force": int(k in pushed)}
        for k, (pose, twist) in enumerate(zip(poses[:count], twists[:count], strict=True))
    ]
    if bodies is not None:
        valid = [{**tick, "obstacles": told} for tick, told in zip(valid, bodies[:count], strict=True)]
    faulty = with_faults(valid, dt=tracker.dt, max_age=tracker.max_age, more=_faults(tracker))
    faulty += standing(faulty, valid[-1], dt=tracker.dt)
    tracker.reset()
    about = (
        f"{len(faulty)} ticks along {source}, the robot moving as commanded, with faults among them: "
        "numbers that are none, stamps that are wrong, the enable input released, jumps, forces; encoders with "
        "noise of 0.1 mrad in the second half"
    )
    joints = Joints(start, dt=tracker.dt, ticks=count)
    return recorded(
        lambda tick: _answer(tracker, tick), faulty, about, joints=joints,
        progress=lambda k: progress("recorded", k, count) if k % 500 == 0 else None,
    )  # fmt: skip


def _answer(tracker: MirrorTracker, tick: RunTick) -> Command:
    force = tick["force"] if tick["with_force"] else None
    return tracker.step(
        tick["q"], tick["pose"], tick["twist"], obstacles=tick.get("obstacles"), force=force, enable=tick["enable"],
        stamp=tick["stamp"],
    )  # fmt: skip


def _force(k: int, pushed: range, strong: float) -> Array:
    """(3,) [N] force in tick k: a push that grows and fades over `pushed`, with five ticks at `strong` newtons."""
    if k not in pushed:
        return np.zeros(3)
    fraction = (k - pushed.start) / len(pushed)
    size = strong if abs(k - pushed.start - len(pushed) // 3) < 3 else PUSH * math.sin(math.pi * fraction)
    return np.array([0.6, -0.8, 0.2]) * size


def _faults(tracker: MirrorTracker) -> tuple[Callable[[RunTick], RunTick], ...]:
    """Functions that change the inputs of a valid tick: some make them invalid, some unusual."""
    chain, jump = tracker.chain, np.array([0.1, -0.1, 0.05])

    def jumped(tick: RunTick) -> RunTick:
        pose = np.array(tick["pose"])
        pose[:3, 3] += jump
        return {**tick, "pose": pose}

    return (
        lambda tick: {**tick, "pose": 1.1 * tick["pose"]},  # no rigid transform
        lambda tick: {**tick, "pose": np.zeros((4, 4))},
        lambda tick: {**tick, "twist": 1e4 * np.ones(6)},
        lambda tick: {**tick, "q": np.minimum(chain.upper, 10.0) + 0.05},  # beyond every limit
        lambda tick: {**tick, "force": np.full(3, np.nan), "with_force": 1},
        jumped,
    )
