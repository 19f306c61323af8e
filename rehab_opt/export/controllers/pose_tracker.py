"""Export of `PoseTracker`, `system = "pose_tracking"`."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from rehab_opt.control.command import Command
from rehab_opt.control.damped import PASSES
from rehab_opt.control.limit import PostureLimits
from rehab_opt.control.pose_tracker import PoseTracker
from rehab_opt.export.exported import ExportedController, ExportedVelocity, Law, refuse_other_solvers
from rehab_opt.export.recording import (
    NO_ITERATIONS,
    STAMPED,
    RunTick,
    about_run,
    encoders,
    recorded,
    standing,
    thinned,
    with_faults,
)  # fmt: skip
from rehab_opt.optim.fallback_chain import BACKUP, as_in_c
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.outcome import Progress
from rehab_opt.session.pose_tracking import PoseTracking, PoseTrackingScene, tracker_of

__all__ = ["NO_BACKUP", "TRACKER", "exported_pose_tracker", "exported_tracker", "moving_argument", "moving_values"]

CALL = "rehab_pose_tracker_step(&controller, tick->q, tick->pose, tick->twist,{moving} tick->enable, tick->stamp, out);"
USAGE = """\
static rehab_pose_tracker controller;
rehab_command command;

rehab_pose_tracker_init(&controller);
for (;;) {{ /* every tick */
    rehab_pose_tracker_step(&controller, q, pose, twist,{moving} enable, stamp, &command);
    send(command.value); /* joint velocities, rad/s or m/s */
}}"""
MOVING_INPUT = """
 * obstacles[{size}]  what moves, 14 numbers each: start and end [m], their velocities [m/s], radius [m], and 1;
 *           0 in the last place says that there is none"""
PLAIN = {
    "pose": "where the tool should be now",
    "null_input": "An input",
    **dict.fromkeys(("force_input", "force_argument", "scale"), ""),
}
TRACKER = {"declared": "tracker.h", "begin": "tracker.c"}
NO_BACKUP = (
    f"There is no backup solver. Where Python would use {BACKUP}, C gives the safe command and "
    "`REHAB_NOT_CERTIFIED`; the recorded run is of a Python controller without the backup, too."
)
DIFFERENCES = (
    NO_BACKUP,
    STAMPED,
    "An input that is NULL counts as not a number; Python raises an error for an argument of the wrong shape.",
    NO_ITERATIONS,
)


def exported_pose_tracker(config: ProblemFile[PoseTracking], *, progress: Progress) -> ExportedController:
    """Prepare the `PoseTracker` of a problem file for export; its recorded run is that of the problem.

    Raises
    ------
    ProblemFileError : a solver without C code, or an invalid value in the file.
    """
    problem = config.problem
    refuse_other_solvers(config, "tracker.solver")
    scene = PoseTrackingScene(config, None)
    tracker = tracker_of(problem, scene.chain, file=config.file)
    run = scene.run(lambda _, *how_far: progress("following the path", *how_far))
    kept = thinned(len(run["t_s"]))
    step = 1 if len(kept) < 2 else int(kept[1])
    part = "" if step == 1 else f" (one tick of {step}, since the run is longer)"
    valid: list[RunTick] = [{"q": run["joint"][i], "pose": scene.poses[i], "twist": scene.twists[i]} for i in kept]
    if problem.clearance is not None and problem.clearance.moving:
        valid = [
            {**each, "obstacles": told}
            for each, told in zip(valid, problem.clearance.moving_at(run["t_s"][kept]), strict=True)
        ]
    title = f"{problem.title}: joint velocities that make a tool follow a pose"
    return exported_tracker(tracker, valid, title=title, of=f"`rehab-opt run {config.name}`{part}")


def exported_tracker(tracker: PoseTracker, run: Sequence[RunTick], *, title: str, of: str) -> ExportedController:
    """Prepare a `PoseTracker` for export, also one with your own limits.

    Parameters
    ----------
    tracker : the controller; the export resets it. It repeats the run without a backup solver, because C has none.
    run : ticks of a valid run, each with q (n,), pose (4, 4) and twist (6,); for a tracker with moving capsules also
        `obstacles` (k, 14) from `moving_numbers`. C repeats the run with faults added. The joints move as commanded
        from the first q.
    title : short description. of : origin of the run in words.

    Raises
    ------
    ConfigurationError : a solver without C code, or a chain with too many joints for a command.
    """
    valid, joints, moves = encoders(run, dt=tracker.dt)
    ticks = with_faults(valid, dt=tracker.dt, max_age=tracker.max_age, more=_faults(tracker))
    ticks += standing(ticks, moves, dt=tracker.dt)
    about = about_run(len(ticks), of)

    def answer(tick: RunTick) -> Command:
        around = {"obstacles": tick["obstacles"]} if tracker.limits.moving else {}
        return tracker.step(
            tick["q"], tick["pose"], tick["twist"], **around, enable=tick["enable"], stamp=tick["stamp"]
        )

    with as_in_c(tracker._solvers):
        tracker.reset()
        recording = recorded(answer, ticks, about, joints=joints)
    tracker.reset()
    return ExportedVelocity(
        name="pose_tracker",
        title=title,
        laws=(Law("pose_tracker", tracker),),
        interface="pose_tracker",
        call=CALL.format(moving=moving_argument(tracker.limits, "tick->")),
        usage=USAGE.format(moving=moving_argument(tracker.limits)),
        values=moving_values(tracker.limits, "parameters + JOINTS + 22") | PLAIN,
        pieces=TRACKER,
        recording=recording,
        differences=DIFFERENCES,
        solves=2 * (PASSES + 1),  # of the unconstrained motion and of the QP; all of them again from a cold start
    )


def moving_argument(limits: PostureLimits, owner: str = "") -> str:
    """C text that passes the moving capsules to a call; empty if the tracker has none."""
    return f" {owner}obstacles," if limits.moving_size else ""


def moving_values(limits: PostureLimits, where: str) -> dict[str, str]:
    """Values for the templates about moving capsules; `where` is C text for their address among the parameters."""
    told = limits.moving_size
    return {
        "moving_argument": " const double *obstacles," if told else "",
        "moving_input": MOVING_INPUT.format(size=told) if told else "",
        "set_moving": f"\n    set_inputs({where}, obstacles, {told});" if told else "",
    }


def _faults(tracker: PoseTracker) -> tuple[Callable[[RunTick], RunTick], ...]:
    """Functions that change the inputs of a valid tick: some make them invalid, some unusual."""
    chain = tracker.chain
    return (
        lambda tick: {**tick, "pose": 1.1 * tick["pose"]},  # no rigid transform
        lambda tick: {**tick, "pose": np.zeros((4, 4))},
        lambda tick: {**tick, "twist": 1e4 * np.ones(6)},
        lambda tick: {**tick, "q": np.minimum(chain.upper, 10.0) + 0.05},  # beyond every limit
        lambda tick: {**tick, "q": np.minimum(chain.upper, 10.0) - 1e-4, "twist": np.ones(6)},
    )
