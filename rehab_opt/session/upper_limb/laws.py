"""The two laws that turn a hand path into joint values, ours and the published one."""

from __future__ import annotations

import inspect
import math
from contextlib import AbstractContextManager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.session.outcome import Progress
from rehab_opt.session.refusals import refused_as
from rehab_opt.session.upper_limb.outcome import LawResult
from rehab_opt.session.upper_limb.problem import UpperLimb

__all__ = ["LAWS", "followed", "follower", "hand_and_tilt"]

Array = NDArray[np.float64]

LAWS = ("optimised", "published")
KEYS = {
    "handle_tilt": "arm.handle_tilt_deg",
    "posture_cost": "optimised.posture_cost",
    "solver": "optimised.solver",
    "gain": "published.gain_per_s",
    "damping": "published.damping",
}
"""Where the problem file says what a law calls by its own name."""


def followed(
    law: str,
    arm: SerialChain,
    path: Array,
    problem: UpperLimb,
    *,
    file: str,
    solver: str | None,
    progress: Progress,
) -> LawResult:
    """Run a law along the path (N, 3) [m]; positions and tilts are recomputed from its joint values.

    Raises
    ------
    ProblemFileError : the law refuses a value of the file.
    ConfigurationError : the law refuses `solver`.
    """
    law_of_arm = follower(law, arm, problem, file=file, solver=solver)
    progress(f"{law} law", 0, 1)
    with _refused(law, file, solver):
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
        metrics={"parameters": _parameters(law_of_arm, problem, solver)},
    )


def hand_and_tilt(arm: SerialChain, q: Array) -> tuple[Array, Array]:
    """Hands (N, 3) [m], and angles (N,) [rad] of the handle from the vertical, of postures q (N, n)."""
    poses = np.array([arm.pose(posture) for posture in q])
    hand, handle = poses[:, :3, 3], poses[:, :3, 0]
    return hand, np.arctan2(np.hypot(handle[:, 0], handle[:, 1]), handle[:, 2])


def follower(law: str, arm: SerialChain, problem: UpperLimb, *, file: str, solver: str | None = None) -> Any:
    """The law with the file's parameters, ready to `follow` a path.

    Raises
    ------
    ProblemFileError : the law refuses a value of the file.
    ConfigurationError : the law refuses `solver`.
    """
    with _refused(law, file, solver):
        return _optimised(arm, problem, solver) if law == "optimised" else _published(arm, problem)


def _parameters(law: Any, problem: UpperLimb, solver: str | None) -> dict[str, Any]:
    """What the law runs with, its own defaults included."""
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


def _optimised(arm: SerialChain, problem: UpperLimb, solver: str | None) -> Any:
    from rehab_opt.control.arm_ik import ArmIK  # noqa: PLC0415  (loads solvers)

    chosen = solver or problem.optimised.solver
    given: dict[str, Any] = {} if chosen is None else {"solver": chosen}
    return ArmIK(
        arm,
        handle_tilt=math.radians(problem.arm.handle_tilt_deg),
        posture_cost=problem.optimised.posture_cost,
        **given,
    )


def _published(arm: SerialChain, problem: UpperLimb) -> Any:
    from rehab_opt.published.tangent_law import TangentLaw  # noqa: PLC0415

    given: dict[str, Any] = {"gain": problem.published.gain_per_s, "damping": problem.published.damping}
    return TangentLaw(
        arm,
        dt=1 / problem.run.rate_hz,
        handle_tilt=math.radians(problem.arm.handle_tilt_deg),
        **{name: value for name, value in given.items() if value is not None},
    )
