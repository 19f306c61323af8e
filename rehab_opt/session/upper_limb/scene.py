"""`system = "upper_limb"`: the optimised and the published controller move an arm along a recorded hand path."""

from __future__ import annotations

import inspect
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.arm_ik import ArmIK
from rehab_opt.control.command import Status
from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.measures.path import path_length
from rehab_opt.published.tangent_law import TangentLaw
from rehab_opt.recordings.recording import size_note
from rehab_opt.session.arm_keys import ArmSection, ranges_by_name
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.outcome import (
    Array,
    Names,
    Outcome,
    Progress,
    error_metrics,
    joint_metrics,
    path_fractions,
    reason_counts,
    status_counts,
    time_metrics,
)
from rehab_opt.session.participant import participant_arm, placed_recording
from rehab_opt.session.refusals import refused_as
from rehab_opt.session.schema import keys_of
from rehab_opt.session.systems import NotMet, System
from rehab_opt.session.trace import Trace
from rehab_opt.session.upper_limb.drive import DT, bounds_of_drive, driven, hand_and_tilt, law_columns
from rehab_opt.session.upper_limb.problem import OptimisedSection, PublishedSection, UpperLimb

Config = ProblemFile[UpperLimb]
LAWS = ("optimised", "published")
KEYS = keys_of(arm=ArmSection, optimised=OptimisedSection, published=PublishedSection)
"""Keys of the problem file, by argument of the controllers."""
FOLLOWED = 1e-3
"""A sample counts as followed if the hand is within this distance [m] of it, and the handle's tilt is allowed."""
REACHED = 2e-6
"""Tolerance [m] for checking `ArmIK`'s claim that the hand is within 1e-6 m of a sample."""
ROUNDING = 1e-6  # tolerance [rad] of the handle's tilt
DRIVEN_DEG = 0.01  # tolerance [deg] of the handle's tilt for a drive, which also moves between the samples
LOOKED_AT = 40
"""Number of samples, equally spaced in time, for which `check` tests whether the hand reaches them."""


class FollowedPath:
    """A recorded hand path in the frame of the shoulder, and the controllers that follow it.

    Raises
    ------
    ProblemFileError : the recording, or a value of the problem file, is invalid.
    ConfigurationError : `solver` is invalid.
    """

    def __init__(self, config: Config, laws: Sequence[str] = LAWS, solver: str | None = None) -> None:
        problem = self.problem = config.problem
        self._file, self._solver = config.file, solver
        self.arm = participant_arm(problem.arm, file=config.file)
        self.recording, self.path = placed_recording(
            config, problem.recording, problem.placement, side=problem.arm.side, rate=problem.run.rate_hz
        )
        self.tilt = math.radians(problem.arm.handle_tilt_deg)
        self.bounds = bounds_of_drive(self.arm, problem.smoothing)
        self.laws = {law: self._follower(law) for law in laws}

    def _follower(self, law: str) -> Any:
        """The controller `law` with the parameters of the problem file."""
        problem, tilt = self.problem, self.tilt
        with self._refused(law):
            if law == "published":
                dt = 1 / problem.run.rate_hz
                return TangentLaw(self.arm, dt=dt, handle_tilt=tilt, **problem.published.arguments())
            given = problem.optimised.arguments() | ({"solver": self._solver} if self._solver else {})
            return ArmIK(self.arm, handle_tilt=tilt, **given)

    def _refused(self, law: str) -> AbstractContextManager[None]:
        keys = lambda name: KEYS.get(name.partition("[")[0], f"{law}.{name}")  # noqa: E731
        return refused_as(self._file, keys, option=self._solver)

    def run(self, progress: Progress = lambda *_: None) -> Trace:
        """Trace with one row for each sample of the path; hand and tilt are computed from each controller's joints."""
        trace, arm, path = Trace({"t_s": self.recording.time, "path": self.path}), self.arm, self.path
        for law, follower in self.laws.items():
            progress(f"{law} law", 0, 1)
            with self._refused(law):
                answer = follower.follow(path)  # the whole path at once, since posture costs refer to earlier samples
            hand, tilt = hand_and_tilt(arm, answer.q)
            columns: dict[str, Any] = {
                "hand": hand,
                "position_error_m": np.linalg.norm(hand - path, axis=1),
                "handle_tilt_rad": tilt,
                "status": [status.value for status in answer.status],
                "_reason": list(getattr(answer, "reason", [""] * len(path))),
                "solve_time_s": answer.seconds,
                "": answer.q,
                **dict(driven(arm, answer.q, trace["t_s"], path, self.bounds, handle_tilt=self.tilt)),
            }
            for name, values in columns.items():
                hidden = "_" if name.startswith("_") else ""
                trace[f"{hidden}{law}_{name.lstrip('_')}".rstrip("_")] = np.asarray(values)
            joints = [f"{name}_rad" for name in arm.names]
            trace.parts |= {law: joints, f"{law}_drive": joints}
            progress(f"{law} law", 1, 1)
        if "optimised" in self.laws:
            trace["reachable"] = verified(law_columns(trace, "optimised"))
        return trace

    def numbers(self, trace: Trace) -> dict[str, Any]:
        """Metrics: fraction of the path within reach, and results of each controller and its drive."""
        path, reachable = trace["path"], trace.get("reachable")
        of_length, of_time = (None, None) if reachable is None else path_fractions(path, reachable)
        return {
            "samples": len(path),
            "duration_s": self.recording.duration,
            "path_length_m": path_length(path),
            "reachable_fraction_of_length": of_length,
            "reachable_fraction_of_time": of_time,
            **{law: self._law_numbers(law, trace) for law in self.laws},
        }

    def _law_numbers(self, law: str, trace: Trace) -> dict[str, Any]:
        of, path, reachable = law_columns(trace, law), trace["path"], trace.get("reachable")
        met = _met(of["position_error_m"], of["handle_tilt_rad"], self.tilt + ROUNDING)
        of_length, of_time = path_fractions(path, met)
        seen = reachable is not None and bool(reachable.any())
        refuted = {"status_refuted": int(np.count_nonzero(claimed(of) & ~verified(of)))} if law == "optimised" else {}
        return {
            "parameters": self._parameters(law),
            "followed_fraction_of_length": of_length,
            "followed_fraction_of_time": of_time,
            **error_metrics(of["position_error_m"], "position_error", "m"),
            "position_error_reachable_max_m": float(of["position_error_m"][reachable].max()) if seen else None,
            "height_off_plane_max_m": float(np.abs(of["hand"][:, 2] - path[:, 2]).max()),
            "handle_tilt_max_deg": float(np.rad2deg(of["handle_tilt_rad"].max())),
            "handle_tilt_limit_deg": self.problem.arm.handle_tilt_deg,
            **joint_metrics(self.arm, of["joint"], self.problem.run.rate_hz),
            "solve_time_first_ms": float(1e3 * of["solve_time_s"][0]),
            **time_metrics(of["solve_time_s"][1:], "solve_time"),
            "status": status_counts(of["status"].tolist()),
            "reasons": reason_counts(of["reason"].tolist()),
            "drive": self._drive_numbers(of, path, met),
            **refuted,
        }

    def _drive_numbers(self, of: Mapping[str, NDArray[Any]], path: Array, met: NDArray[np.bool_]) -> dict[str, Any]:
        allowed, joints = self.tilt + math.radians(DRIVEN_DEG), of["drive_joint"]
        fractions = path_fractions(path, _met(of["drive_position_error_m"], of["drive_handle_tilt_rad"], allowed))
        hand, tilt = hand_and_tilt(self.arm, of["drive"])
        kept = _met(np.linalg.norm(hand - path, axis=1), tilt, allowed)
        speed, acceleration = self.bounds["velocity"], self.bounds["acceleration"]
        moved, change = np.diff(joints, axis=0) / DT, np.diff(joints, 2, axis=0) / DT**2
        return {
            "bounds": {
                "speed_deg_s": float(np.rad2deg(speed.min())),
                "acceleration_deg_s2": float(np.rad2deg(acceleration.min())),
                "jerk_deg_s3": self.problem.smoothing.jerk_deg_s3,
            },
            "delay_s": float(of["drive_time_s"][-1] - of["drive_phase_s"][-1]),
            "joint_deviation_max_deg": float(np.rad2deg(of["drive_deviation"].max())),
            "joint_speed_max_fraction_of_limit": float((np.abs(moved) / speed).max()),
            "joint_acceleration_max_fraction_of_limit": float((np.abs(change) / acceleration).max(initial=0.0)),
            "followed_fraction_of_length": fractions[0],
            "followed_fraction_of_time": fractions[1],
            "kept_fraction": float(np.mean(kept[met])) if met.any() else None,
            **error_metrics(of["drive_position_error_m"], "position_error", "m"),
            "height_off_plane_max_m": float(np.abs(of["drive_hand"][:, 2] - path[0, 2]).max()),
            "handle_tilt_max_deg": float(np.rad2deg(of["drive_handle_tilt_rad"].max())),
        }

    def _parameters(self, law: str) -> dict[str, Any]:
        of, optimised = self.laws[law], self.problem.optimised
        if law == "published":
            numbers = {"gain_per_s": of.gain, "damping": of.damping, "saturation": of.saturation}
            return {**numbers, "steps_a_sample": of.substeps}
        own = inspect.signature(type(of)).parameters
        return {
            "solver": self._solver or optimised.solver or own["solver"].default,
            "backup": own["backup"].default,
            "posture_cost": dict(optimised.posture_cost),
        }

    def notes(self, trace: Trace) -> Iterator[str]:
        """Notes on the recording, the bounds of the drive, and failures of each controller."""
        numbers, of_handle = self.numbers(trace), f"{self.problem.arm.handle_tilt_deg:g} deg from the vertical"
        yield from self.recording.notes
        yield f"the handle may tilt by {of_handle}"
        bounds = numbers[next(iter(self.laws))]["drive"]["bounds"]
        yield (
            f"driven at 1 kHz within {bounds['speed_deg_s']:.0f} deg/s, {bounds['acceleration_deg_s2']:.0f} deg/s^2, "
            f"{bounds['jerk_deg_s3']:.0f} deg/s^3: speed and acceleration are the smaller of the file's and the arm's; "
            "where a joint is too slow all of them wait, and the path is kept"
        )
        for law in self.laws:
            if law == "published":
                yield from _published(numbers[law]["parameters"], winds_up=numbers["reachable_fraction_of_time"] != 1.0)
            yield from _law_notes(law, numbers[law], numbers["samples"])


def claimed(of: Mapping[str, NDArray[Any]]) -> NDArray[np.bool_]:
    """Array (N,): whether the controller claims for each sample that the hand is on the path."""
    return np.array([Status(status).certified for status in of["status"]])


def verified(of: Mapping[str, NDArray[Any]]) -> NDArray[np.bool_]:
    """Array (N,): whether the arm's kinematics confirm the controller's claim for each sample."""
    return np.asarray(claimed(of) & (of["position_error_m"] <= REACHED))


def _met(error: Array, tilt: Array, limit: float) -> NDArray[np.bool_]:
    """Array (N,): whether each sample is followed, for errors (N,) [m], tilts (N,) [rad] and a tilt `limit` [rad]."""
    return np.asarray((error <= FOLLOWED) & (tilt <= limit))


def _published(chosen: Mapping[str, float], *, winds_up: bool) -> Iterator[str]:
    yield (
        f"the published controller runs with k0 = {chosen['gain_per_s']:g}/s and mu = {chosen['damping']:g}: the paper "
        "gives no values, and its numbers depend on them; `python -m bench.tangent_law` prints those of a grid"
    )
    if winds_up:
        yield (
            "the published controller winds up: after a sample out of reach, its joints may stay at their limits and "
            "miss samples within reach"
        )


def _law_notes(law: str, of: Mapping[str, Any], samples: int) -> Iterator[str]:
    for reason, count in of["reasons"].items():
        yield f"the {law} controller, {count} of {samples} samples: {reason}"
    if (ratio := of["joint_speed_max_fraction_of_limit"]) > 1:
        yield (
            f"the {law} controller moves {of['joint_speed_max_joint'].replace('_', ' ')} at {ratio:.1f} times its "
            f"speed limit: the drive takes {of['drive']['delay_s']:.3g} s longer than the recording"
        )
    tilt, limit = of["drive"]["handle_tilt_max_deg"], of["handle_tilt_limit_deg"]
    if tilt > limit + DRIVEN_DEG:
        yield (
            f"HANDLE BEYOND ITS TILT: driven along the {law} controller's joints, the handle tilts by up to {tilt:.3g} "
            f"deg, {limit:g} deg are allowed; no controller limits the tilt between two samples that are far apart"
        )


class UpperLimbSystem(System[UpperLimb, FollowedPath]):
    """System in which the optimised and the published controller follow a recorded hand path."""

    schema = UpperLimb
    drawing = "rehab_opt.session.upper_limb.figures"
    first = (
        "drive: followed", "drive: delay", "drive: position_error", "drive: handle_tilt", "handle_tilt_limit",
        "joint_limit_margin", "status",
    )  # fmt: skip
    options = frozenset({"law", "solver"})
    solver_key = "optimised.solver"

    def scenes(self, config: Config, options: Mapping[str, str]) -> dict[Names, FollowedPath]:
        """One scene; options: `law` ("optimised", "published", "both"), `solver` of the optimised controller."""
        law, solver = options.get("law", "both"), options.get("solver")
        if law not in ("both", *LAWS):
            raise ConfigurationError("--law", law, "published, optimised or both")
        if solver is not None and law == "published":
            raise ConfigurationError("--solver", solver, "no such option with `--law published`, which needs no solver")
        return {(): FollowedPath(config, LAWS if law == "both" else (law,), solver)}

    def columns(self, outcome: Outcome) -> Mapping[str, Mapping[str, Any]]:
        """One column for each controller."""
        return {law: outcome.metrics[law] for law in LAWS if law in outcome.metrics}

    def caption(self, outcome: Outcome) -> str:
        """Caption of the table: fraction of the path that the arm reaches."""
        part, of_time = (outcome.metrics[f"reachable_fraction_of_{of}"] for of in ("length", "time"))
        if part is None:
            return "the fraction of the path within reach is not known: run the optimised controller"
        length = 1e3 * outcome.metrics["path_length_m"]
        reach = f"within this arm's reach: {100 * part:.1f} % of the path's {length:.0f} mm"
        return f"{reach}, {100 * of_time:.1f} % of its time"

    def check(self, config: Config) -> tuple[str, ...]:
        """Read the recording and build the controllers; report how many of 40 samples the hand reaches."""
        scene = FollowedPath(config)
        path = scene.path
        places = path[np.unique(np.linspace(0, len(path) - 1, LOOKED_AT).round().astype(int))]
        answer = ArmIK(scene.arm, handle_tilt=scene.tilt).follow(places)
        near = np.array([status.certified for status in answer.status])
        said = f"in reach: {near.sum()} of {len(places)} samples looked at ({100 * near.mean():.0f} %)"
        if not near.all():
            away = np.linalg.norm(hand_and_tilt(scene.arm, answer.q)[0] - places, axis=1)[~near]
            low, high = 1e3 * away.min(), 1e3 * away.max()
            said = NotMet(f"{said}; from the others the hand stays {low:.3g} to {high:.3g} mm away")
        return (*scene.recording.notes, size_note(scene.recording), said)

    def arms(self, config: Config) -> dict[str, SerialChain]:
        """The participant's arm."""
        section = config.problem.arm
        (name,) = ranges_by_name(section.range_of_motion)
        return {name: participant_arm(section, file=config.file)}
