"""Sequences of the corpus that are parts of runs of shipped problem files: inverse kinematics, pose tracking, ARDIS."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

from bench.qp_recording.recording import recorded_run
from bench.qp_recording.sequence import QPSequence
from bench.solvers.shipped import regenerate_command
from rehab_opt.session.files import load_problem, problem_content, problem_of, problem_path

__all__ = ["PROBLEM_RUNS", "ProblemRun"]


class ProblemRun(NamedTuple):
    """A window of a problem's run."""

    problem: str
    stream: str
    """End of the name of the solver that is kept."""
    skip: int
    ticks: int
    about: str
    changes: Mapping[str, Any] = MappingProxyType({})
    """Keys of the file, "section.key", that are other than shipped."""

    def sequence(self, name: str) -> QPSequence:
        """The QPs of the window."""
        found = recorded_run(self._config(), skip=self.skip, ticks=self.ticks)
        kept = next(each for each in found if each.name.endswith(self.stream))
        return dataclasses.replace(kept, name=name, command=regenerate_command(name), about=self.about)

    def _config(self) -> Any:
        if not self.changes:
            return load_problem(self.problem)
        name, path = problem_path(self.problem)
        content = problem_content(path, self.problem)
        for key, value in self.changes.items():
            section, _, last = key.partition(".")
            content.setdefault(section, {})[last] = value
        return problem_of(content, name=name, file=self.problem, path=path)


SLOW_JOINTS = MappingProxyType(
    {"robot.joint_speed_deg_s": 20.0, "robot.joint_acceleration_deg_s2": 200.0, "circle.duration_s": 3.0}
)

PROBLEM_RUNS: Mapping[str, ProblemRun] = MappingProxyType(
    {
        "arm_ik/figure_eight": ProblemRun(
            "upper_limb/figure_eight", "ik_posture_step", 400, 300,
            "Iterations of the arm's inverse kinematics along a figure of eight, comfortable range of motion.",
        ),
        "pose_tracking/free": ProblemRun(
            "robot/ur5_circle", "pose_tracker", 1500, 200, "A UR5 round a circle at 1 kHz, no limit in reach.",
        ),
        "pose_tracking/limited": ProblemRun(
            "robot/ur5_circle", "pose_tracker", 1000, 250,
            "The same circle too fast for its joints: one is at its limit, the motion is slowed.", SLOW_JOINTS,
        ),
        "ardis/mecanum_within_reach": ProblemRun(
            "ardis/beyond_reach", "mecanum_x_y", 100, 150, "Chair and arm, mecanum wheels; the hand within reach.",
        ),
        "ardis/mecanum_beyond_reach": ProblemRun(
            "ardis/beyond_reach", "mecanum_x_y", 600, 200, "The chair comes along where the arm does not reach.",
        ),
        "ardis/mecanum_doorway": ProblemRun(
            "ardis/through_doorway", "mecanum_x_y", 1080, 220, "Between two posts and the walls of a corridor.",
        ),
        "ardis/mecanum_roll": ProblemRun(
            "ardis/place_on_table", "mecanum_z_roll7", 150, 150, "The stick's second mode: height and roll.",
        ),
        "ardis/differential_table": ProblemRun(
            "ardis/place_on_table", "differential_x_y", 200, 220, "A chair that cannot go sideways, at a table.",
        ),
        "ardis/differential_beyond_reach": ProblemRun(
            "ardis/beyond_reach", "differential_x_y", 650, 200, "The same chair comes along with the arm.",
        ),
        "ardis/differential_doorway": ProblemRun(
            # From tick 840 on this run amplifies what differs by rounding, until it is another way through the door.
            "ardis/through_doorway", "differential_x_y", 650, 200, "The same chair comes between posts and walls.",
        ),
    }
)  # fmt: skip
