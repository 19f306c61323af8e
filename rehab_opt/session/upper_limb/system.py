"""`system = "upper_limb"`: what a session asks of it."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.arm_ik import ArmIK
from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.outcome import Progress
from rehab_opt.session.participant import participant_arm, placed_recording
from rehab_opt.session.recording import size_note
from rehab_opt.session.systems import Needed, System
from rehab_opt.session.upper_limb.laws import LAWS, follower
from rehab_opt.session.upper_limb.outcome import ArmOutcome
from rehab_opt.session.upper_limb.problem import UpperLimb
from rehab_opt.session.workspaces.sections import ranges_by_name

__all__ = ["UpperLimbSystem", "reach_note"]

Array = NDArray[np.float64]


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
    return f"{said}; from the others the hand stays {1e3 * away.min():.3g} to {1e3 * away.max():.3g} mm away"


BOTH = "both"


class UpperLimbSystem(System[UpperLimb, ArmOutcome]):
    """A recorded hand path followed by the optimised and the published law."""

    schema = UpperLimb
    shown = ("rehab_opt.session.upper_limb.shown",)
    options = frozenset({"law", "solver"})
    solver_key = "optimised.solver"

    def recordings(self, problem: UpperLimb) -> tuple[Needed, ...]:
        """The recorded path."""
        return (Needed("recording.file", problem.recording.file),)

    def check(self, loaded: ProblemFile[UpperLimb]) -> tuple[str, ...]:
        """Reads the recording and builds the laws."""
        problem = loaded.problem
        (arm,) = self.arms(loaded).values()
        recording, path = placed_recording(
            loaded, problem.recording, problem.placement, side=problem.arm.side, rate=problem.run.rate_hz
        )
        for law in LAWS:
            follower(law, arm, problem, file=loaded.file)
        return (*recording.notes, size_note(recording), reach_note(arm, path, handle_tilt=problem.arm.handle_tilt_deg))

    def arms(self, loaded: ProblemFile[UpperLimb]) -> dict[str, SerialChain]:
        """The participant's one."""
        section = loaded.problem.arm
        (name,) = ranges_by_name(section.range_of_motion)
        return {name: participant_arm(section, file=loaded.file)}

    def run(self, loaded: ProblemFile[UpperLimb], *, options: Mapping[str, str], progress: Progress) -> ArmOutcome:
        """Options: `law` ("optimised", "published", "both") and `solver` of the optimised one."""
        from rehab_opt.session.upper_limb.run import run_upper_limb  # noqa: PLC0415  (loads the smoother)

        law, solver = options.get("law", BOTH), options.get("solver")
        if law not in (BOTH, *LAWS):
            raise ConfigurationError("--law", law, "published, optimised or both")
        if solver is not None and law == "published":
            raise ConfigurationError("--solver", solver, "no such option with --law published, which needs no solver")
        return run_upper_limb(loaded, laws=LAWS if law == BOTH else (law,), solver=solver, progress=progress)

    def seconds_a_tick(self, problem: UpperLimb) -> float:
        """NaN: its QPs are the iterations of inverse kinematics, one or more a sample."""
        return math.nan
