"""The run along a recorded path: controllers, what a drive does with their joints, numbers. Nothing is written here."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.arm_ik import ArmIK
from rehab_opt.control.command import Status
from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.measures.path import path_length
from rehab_opt.recordings.recording import size_note
from rehab_opt.session.arm_keys import ranges_by_name
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.outcome import (
    Array,
    Progress,
    error_metrics,
    joint_metrics,
    path_fractions,
    reason_counts,
    status_counts,
    time_metrics,
    with_progress,
)
from rehab_opt.session.participant import participant_arm, placed_recording
from rehab_opt.session.systems import Needed, NotMet, System
from rehab_opt.session.upper_limb.laws import LAWS, driven, follower, hand_and_tilt, track_reference
from rehab_opt.session.upper_limb.outcome import DRIVEN_DEG, ArmOutcome, LawResult, drive_note, law_notes
from rehab_opt.session.upper_limb.problem import UpperLimb

__all__ = ["FOLLOWED", "UpperLimbSystem", "reach_note", "verified"]


FOLLOWED = 1e-3
"""[m] A sample counts as followed when the hand is no further off and the handle within its tilt."""
REACHED = 2e-6
"""[m] `ArmIK` calls a sample reached to 1e-6 m; its word is checked against the kinematics with this."""
ROUNDING = 1e-6  # [rad] tilts that differ by less are the same tilt


def verified(run: LawResult) -> NDArray[np.bool_]:
    """(N,) where the controller says that the hand is on the path, and the kinematics agrees."""
    return claimed(run) & (run.position_error <= REACHED)


def claimed(run: LawResult) -> NDArray[np.bool_]:
    """(N,) where the controller says that the hand is on the path."""
    return np.array([Status(status).certified for status in run.status])


def _measured(
    run: LawResult,
    arm: SerialChain,
    times: Array,
    path: Array,
    problem: UpperLimb,
    *,
    reachable: NDArray[np.bool_] | None,
) -> LawResult:
    """The run with its drive and its numbers."""
    rate, limit = problem.run.rate_hz, math.radians(problem.arm.handle_tilt_deg)
    met = _met(run.position_error, run.handle_tilt, limit + ROUNDING)
    of_length, of_time = path_fractions(path, met)
    drive, of_drive = driven(arm, run.q, times, path, problem.smoothing, handle_tilt=limit)
    allowed = limit + math.radians(DRIVEN_DEG)
    drive_of_length, drive_of_time = path_fractions(path, _met(drive.position_error, drive.handle_tilt, allowed))
    hand, tilt = hand_and_tilt(arm, drive.q)
    kept = _met(np.linalg.norm(hand - path, axis=1), tilt, allowed)
    of_drive |= {
        "followed_fraction_of_length": drive_of_length,
        "followed_fraction_of_time": drive_of_time,
        "kept_fraction": float(np.mean(kept[met])) if met.any() else None,
        **error_metrics(drive.position_error, "position_error", "m"),
        "height_off_plane_max_m": float(np.abs(drive.hand[:, 2] - path[0, 2]).max()),
        "handle_tilt_max_deg": float(np.rad2deg(drive.handle_tilt.max())),
    }
    numbers: dict[str, Any] = {
        "parameters": run.metrics["parameters"],
        "followed_fraction_of_length": of_length,
        "followed_fraction_of_time": of_time,
        **error_metrics(run.position_error, "position_error", "m"),
        "position_error_reachable_max_m": None,
        "height_off_plane_max_m": float(np.abs(run.hand[:, 2] - path[:, 2]).max()),
        "handle_tilt_max_deg": float(np.rad2deg(run.handle_tilt.max())),
        "handle_tilt_limit_deg": problem.arm.handle_tilt_deg,
        **joint_metrics(arm, run.q, rate),
        "solve_time_first_ms": float(1e3 * run.seconds[0]),
        **time_metrics(run.seconds[1:], "solve_time"),
        "status": status_counts(run.status),
        "reasons": reason_counts(run.reason),
        "drive": of_drive,
    }
    if run.law == "optimised":
        numbers["status_refuted"] = int(np.count_nonzero(claimed(run) & ~verified(run)))
    if reachable is not None and reachable.any():
        numbers["position_error_reachable_max_m"] = float(run.position_error[reachable].max())
    return replace(run, metrics=numbers, drive=drive)


def _met(error: Array, tilt: Array, limit: float) -> NDArray[np.bool_]:
    """(N,) where a sample counts as followed; `limit` [rad] of the tilt."""
    return np.asarray((error <= FOLLOWED) & (tilt <= limit))


LOOKED_AT = 40
"""Samples, evenly along the time of the path."""


def reach_note(arm: SerialChain, path: Array, *, handle_tilt: float) -> str:
    """Of some samples of a path (N, 3) [m], how many the hand gets to, and how far off it stays from the others.

    Parameters
    ----------
    handle_tilt : [deg] largest angle between handle and vertical.
    """
    places = path[np.unique(np.linspace(0, len(path) - 1, LOOKED_AT).round().astype(int))]
    answer = ArmIK(arm, handle_tilt=math.radians(handle_tilt)).follow(places)
    near = np.array([status.certified for status in answer.status])
    said = f"in reach: {near.sum()} of {len(places)} samples looked at ({100 * near.mean():.0f} %)"
    if near.all():
        return said
    away = np.linalg.norm([arm.pose(q)[:3, 3] for q in answer.q] - places, axis=1)[~near]
    return NotMet(f"{said}; from the others the hand stays {1e3 * away.min():.3g} to {1e3 * away.max():.3g} mm away")


BOTH = "both"


class UpperLimbSystem(System[UpperLimb, ArmOutcome]):
    """A recorded hand path followed by the optimised and the published controller."""

    schema = UpperLimb
    shown = "rehab_opt.session.upper_limb.shown"
    first = (
        "drive: followed", "drive: delay", "drive: position_error", "drive: handle_tilt", "handle_tilt_limit",
        "joint_limit_margin", "status",
    )  # fmt: skip
    options = frozenset({"law", "solver"})
    solver_key = "optimised.solver"

    def columns(self, outcome: ArmOutcome) -> Mapping[str, Mapping[str, Any]]:
        """A column for each controller."""
        return {run.law: outcome.metrics[run.law] for run in outcome.laws}

    def caption(self, outcome: ArmOutcome) -> str:
        """How much of the path the arm reaches."""
        part, of_time = (outcome.metrics[f"reachable_fraction_of_{of}"] for of in ("length", "time"))
        if part is None:
            return "the fraction of the path within reach is not known: run the optimised controller"
        length = 1e3 * outcome.metrics["path_length_m"]
        reach = f"within this arm's reach: {100 * part:.1f} % of the path's {length:.0f} mm"
        return f"{reach}, {100 * of_time:.1f} % of its time"

    def recordings(self, problem: UpperLimb) -> tuple[Needed, ...]:
        """The recorded path."""
        return (Needed("recording.file", problem.recording.file),)

    def check(self, config: ProblemFile[UpperLimb]) -> tuple[str, ...]:
        """Reads the recording and builds the controllers."""
        problem = config.problem
        (arm,) = self.arms(config).values()
        recording, path = placed_recording(
            config, problem.recording, problem.placement, side=problem.arm.side, rate=problem.run.rate_hz
        )
        for law in LAWS:
            follower(law, arm, config)
        return (*recording.notes, size_note(recording), reach_note(arm, path, handle_tilt=problem.arm.handle_tilt_deg))

    def arms(self, config: ProblemFile[UpperLimb]) -> dict[str, SerialChain]:
        """The participant's one."""
        section = config.problem.arm
        (name,) = ranges_by_name(section.range_of_motion)
        return {name: participant_arm(section, file=config.file)}

    def run(self, config: ProblemFile[UpperLimb], *, options: Mapping[str, str], progress: Progress) -> ArmOutcome:
        """Options: `law` ("optimised", "published", "both") and `solver` of the optimised one."""
        law, solver = options.get("law", BOTH), options.get("solver")
        if law not in (BOTH, *LAWS):
            raise ConfigurationError("--law", law, "published, optimised or both")
        if solver is not None and law == "published":
            raise ConfigurationError("--solver", solver, "no such option with --law published, which needs no solver")
        laws = LAWS if law == BOTH else (law,)
        problem = config.problem
        arm = participant_arm(problem.arm, file=config.file)
        recording, path = placed_recording(
            config, problem.recording, problem.placement, side=problem.arm.side, rate=problem.run.rate_hz
        )
        runs = [track_reference(law, arm, path, config, solver=solver, progress=progress) for law in laws]
        reachable = next((verified(run) for run in runs if run.law == "optimised"), None)
        results = [
            _measured(run, arm, recording.time, path, problem, reachable=reachable)
            for run in with_progress(progress, "drive", runs)
        ]
        fractions = (None, None) if reachable is None else path_fractions(path, reachable)
        within_reach = reachable is not None and bool(reachable.all())
        return ArmOutcome(
            chain=arm,
            time=recording.time,
            notes=(
                *recording.notes,
                f"the handle may tilt by {problem.arm.handle_tilt_deg:g} deg from the vertical",
                drive_note(results[0].metrics["drive"]["bounds"]),
                *(note for result in results for note in law_notes(result, within_reach=within_reach)),
            ),
            metrics={
                "samples": len(path),
                "duration_s": recording.duration,
                "path_length_m": path_length(path),
                "reachable_fraction_of_length": fractions[0],
                "reachable_fraction_of_time": fractions[1],
                **{result.law: dict(result.metrics) for result in results},
            },
            path=path,
            laws=tuple(results),
            reachable=reachable,
            handle_tilt_limit=math.radians(problem.arm.handle_tilt_deg),
            gaps=recording.gaps,
        )

    def seconds_a_tick(self, problem: UpperLimb) -> float:
        """NaN: its QPs are the iterations of inverse kinematics, one or more a sample."""
        return math.nan
