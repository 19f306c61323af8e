"""The two controllers that turn a hand path into joint values, ours and the published one, and a drive that gets
these.
"""

from __future__ import annotations

import inspect
import math
from contextlib import AbstractContextManager
from typing import Any

import numpy as np

from rehab_opt.control.arm_ik import ArmIK
from rehab_opt.control.smoothing import smooth_path
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.published.tangent_law import TangentLaw
from rehab_opt.session.arm_keys import ArmSection
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.outcome import Array, Progress
from rehab_opt.session.refusals import refused_as
from rehab_opt.session.schema import keys_of
from rehab_opt.session.upper_limb.outcome import DrivenArm, LawResult
from rehab_opt.session.upper_limb.problem import OptimisedSection, PublishedSection, SmoothingSection, UpperLimb

__all__ = ["LAWS", "driven", "follower", "hand_and_tilt", "track_reference"]

LAWS = ("optimised", "published")
KEYS = keys_of(arm=ArmSection, optimised=OptimisedSection, published=PublishedSection)
"""Where the problem file says what a controller calls by its own name."""


def track_reference(
    law: str, arm: SerialChain, path: Array, config: ProblemFile[UpperLimb], *, solver: str | None, progress: Progress
) -> LawResult:
    """Run a controller along the path (N, 3) [m]; positions and tilts are recomputed from its joint values.

    Raises
    ------
    ProblemFileError : the controller refuses a value of the file.
    ConfigurationError : the controller refuses `solver`.
    """
    law_of_arm = follower(law, arm, config, solver=solver)
    progress(f"{law} law", 0, 1)
    with _refused(law, config.file, solver):
        answer = law_of_arm.follow(path)  # in one piece: posture costs refer to the samples before
    progress(f"{law} law", 1, 1)
    hand, tilt = hand_and_tilt(arm, answer.q)
    return LawResult(
        law=law,
        q=answer.q,
        hand=hand,
        position_error=np.linalg.norm(hand - path, axis=1),
        handle_tilt=tilt,
        status=tuple(status.value for status in answer.status),
        reason=tuple(getattr(answer, "reason", [""] * len(path))),
        seconds=answer.seconds,
        metrics={"parameters": _parameters(law_of_arm, config.problem, solver)},
    )


def hand_and_tilt(arm: SerialChain, q: Array) -> tuple[Array, Array]:
    """Hands (N, 3) [m], and angles (N,) [rad] of the handle from the vertical, of postures q (N, n)."""
    poses = np.array([arm.pose(posture) for posture in q])
    hand, handle = poses[:, :3, 3], poses[:, :3, 0]
    return hand, np.arctan2(np.hypot(handle[:, 0], handle[:, 1]), handle[:, 2])


def follower(law: str, arm: SerialChain, config: ProblemFile[UpperLimb], *, solver: str | None = None) -> Any:
    """The controller with the file's parameters, ready to `follow` a path; raises as `track_reference`."""
    problem, tilt = config.problem, math.radians(config.problem.arm.handle_tilt_deg)
    with _refused(law, config.file, solver):
        if law == "published":
            return TangentLaw(arm, dt=1 / problem.run.rate_hz, handle_tilt=tilt, **problem.published.arguments())
        given = problem.optimised.arguments() | ({"solver": solver} if solver else {})
        return ArmIK(arm, handle_tilt=tilt, **given)


def _parameters(law: Any, problem: UpperLimb, solver: str | None) -> dict[str, Any]:
    """What the controller runs with, its own defaults included."""
    if hasattr(law, "gain"):
        return {
            "gain_per_s": law.gain,
            "damping": law.damping,
            "saturation": law.saturation,
            "steps_a_sample": law.substeps,
        }
    own = inspect.signature(type(law)).parameters
    return {
        "solver": solver or problem.optimised.solver or own["solver"].default,
        "backup": own["backup"].default,
        "posture_cost": dict(problem.optimised.posture_cost),
    }


def _refused(law: str, file: str, solver: str | None) -> AbstractContextManager[None]:
    return refused_as(file, lambda name: KEYS.get(name.partition("[")[0], f"{law}.{name}"), option=solver)


DT = 0.001  # [s]
OFF, OVER = 1e-4, math.radians(1e-3)
"""[m, rad] by which hand and handle may leave their ways amid two postures."""
LONG = 0.02
"""[rad] Steps of a joint up to this, from posture to posture, are curves near enough to lines."""
HEAVY = 100.0
"""What the cosine of the handle's tilt counts for against the hand's place [m]."""
DAMPING, ROUNDING = 1e-2, 1e-9
"""[m/rad] What a step counts for at first; [rad] by which its bounds are apart where a joint is at its limit."""
HALVINGS, STEPS = 6, 20
"""Of the way from sample to sample, and of Newton's to a posture amid two."""


def driven(
    chain: SerialChain, q: Array, times: Array, path: Array, bounds: SmoothingSection, *, handle_tilt: float
) -> tuple[DrivenArm, dict[str, Any]]:
    """The joints q (N, n) [rad] at `times` (N,) [s] of a hand path (N, 3) [m], passed by `smooth_path`; its numbers.

    Speed and acceleration are bounded by the smaller of the file's and the chain's. All joints wait for the slowest,
    so that hand and handle keep their way; the hand is compared with the path at the drive's phase. Where a straight
    line of the joints would lead the hand off its way, or the handle (largest tilt `handle_tilt` [rad])
    further over, from one sample to the next, postures in between are found (`_with_between`).
    """
    speed = np.minimum(math.radians(bounds.speed_deg_s), chain.velocity)
    acceleration = np.minimum(math.radians(bounds.acceleration_deg_s2), chain.acceleration)
    finer, postures = _with_between(chain, q, times, handle_tilt)
    found = smooth_path(
        finer, postures, velocity=speed, acceleration=acceleration, jerk=math.radians(bounds.jerk_deg_s3), dt=DT,
        lower=chain.lower, upper=chain.upper,
    )  # fmt: skip
    hand, tilt = hand_and_tilt(chain, found.positions)
    asked = np.column_stack([np.interp(found.phase, times, column) for column in path.T])
    begins = np.searchsorted(found.phase, np.append(times[0], (times[1:] + times[:-1]) / 2))
    begins = np.minimum(begins, len(hand) - 1)
    passes = np.interp(times, found.phase, found.times)
    drive = DrivenArm(
        path=found,
        hand=hand,
        passes=passes,
        q=np.column_stack([np.interp(passes, found.times, column) for column in found.positions.T]),
        position_error=np.maximum.reduceat(np.linalg.norm(hand - asked, axis=1), begins),
        handle_tilt=np.maximum.reduceat(tilt, begins),
    )
    moved, change = np.diff(found.positions, axis=0) / DT, np.diff(found.positions, 2, axis=0) / DT**2
    return drive, {
        "bounds": {
            "speed_deg_s": float(np.rad2deg(speed.min())),
            "acceleration_deg_s2": float(np.rad2deg(acceleration.min())),
            "jerk_deg_s3": bounds.jerk_deg_s3,
        },
        "delay_s": found.delay,
        "joint_deviation_max_deg": float(np.rad2deg(found.deviation.max())),
        "joint_speed_max_fraction_of_limit": float((np.abs(moved) / speed).max()),
        "joint_acceleration_max_fraction_of_limit": float((np.abs(change) / acceleration).max(initial=0.0)),
    }


def _with_between(chain: SerialChain, q: Array, times: Array, handle_tilt: float) -> tuple[Array, Array]:
    """Times (M,) and postures (M, n): those given, and as many amid them as the hand and the handle need."""
    for _ in range(HALVINGS):
        hand, tilt = hand_and_tilt(chain, q)
        middle, most = (q[1:] + q[:-1]) / 2, np.maximum(np.maximum(tilt[1:], tilt[:-1]), handle_tilt)
        there, tilted = hand_and_tilt(chain, middle)
        wanted = (hand[1:] + hand[:-1]) / 2
        long = np.abs(np.diff(q, axis=0)).max(axis=1) > LONG
        off = np.flatnonzero(long | (np.linalg.norm(there - wanted, axis=1) > OFF) | (tilted > most + OVER))
        if not off.size:
            break
        more = [_amid(chain, middle[k], wanted[k], float(most[k])) for k in off.tolist()]
        q, times = np.insert(q, off + 1, more, axis=0), np.insert(times, off + 1, (times[off] + times[off + 1]) / 2)
    return times, q


def _amid(chain: SerialChain, q: Array, hand: Array, handle_tilt: float) -> Array:
    """Posture near q (n,), with the hand (3,) [m] and the handle over by so much at most; the nearest to it on the way.

    Gauss-Newton's steps within the joint limits, in which the handle comes before the hand.
    """
    from scipy.optimize import lsq_linear  # noqa: PLC0415  (loaded when used)

    best, least, damping, tried = q, math.inf, DAMPING, q
    for _ in range(STEPS):
        pose, jacobian = chain.pose(tried), chain.jacobian(tried)
        x, y, z = pose[:3, 0]
        missing = np.append(hand - pose[:3, 3], HEAVY * max(math.cos(handle_tilt) - z, 0.0))
        if (size := float(missing @ missing)) < least:
            best, least, damping, error = tried, size, damping / 10.0, missing
            rows = np.vstack([jacobian[:3], HEAVY * (y * jacobian[3] - x * jacobian[4])])
        else:
            damping *= 30.0
        stacked = np.vstack([rows, damping * np.eye(chain.n)]), np.append(error, np.zeros(chain.n))
        away = chain.lower - best - ROUNDING, chain.upper - best + ROUNDING
        tried = np.clip(best + lsq_linear(*stacked, bounds=away).x, chain.lower, chain.upper)
    return best
