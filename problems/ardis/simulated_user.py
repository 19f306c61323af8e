"""Write the stick recordings of this folder: `python problems/ardis/simulated_user.py [problem ...]`.

A simulated user watches the hand and steers it to the goals of the problem file, one after the other, with the
modes of the stick in turn, changed over by the switch where little is left to do in one, until the hand is near;
then the gripper, where the goal asks for it. The stick is moved 20 times a second at most, in steps of a hundredth;
nothing is random, and a recording has a row where something changes.
Each drive gets a recording of its own, since the user reacts to where the robot goes.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.joystick import StickMode
from rehab_opt.session.ardis.outcome import Motion, simulate_motion
from rehab_opt.session.ardis.problem import ArdisProblem, DriveName, GoalSection
from rehab_opt.session.ardis.robot import joystick_of, resolver_of, robot_of, start_of
from rehab_opt.session.ardis.stick import HEADER, Moment, StickSample
from rehab_opt.session.files import ProblemFile, load_problem

RATE = 20.0  # [Hz] of the stick
NEAR = 0.5  # share of a goal's tolerance at which the user is content
SLOW = 0.8  # [1/s] deflection falls in proportion to the distance below speed / SLOW
PRESS = 0.25  # [s] that a button is held down
PAUSE = 0.3  # [s] after a button
LONGEST = 120.0  # [s]
DEAD = 0.12  # of the stick, which the user feels and goes beyond


class User:
    """Whoever steers: see the module."""

    duration = LONGEST

    def __init__(self, goals: list[GoalSection], modes: Sequence[StickMode]) -> None:
        self.goals, self.modes = list(goals), {mode.name: mode for mode in modes}
        self.samples: list[tuple[float, StickSample]] = []
        self.closed, self.busy_until, self.pressed_until, self.button = False, 0.5, 0.0, ""
        self.done_at: float | None = None

    def at(self, moment: Moment) -> StickSample | None:
        """Decide 20 times a second, and hold."""
        if self.done_at is not None and moment.time > self.done_at + 0.5:
            return None
        if not self.samples or moment.time >= self.samples[-1][0] + 1 / RATE - 1e-9:
            self.samples.append((moment.time, self.decide(moment)))
        return self.samples[-1][1]

    def decide(self, moment: Moment) -> StickSample:
        """The next sample."""
        if moment.time < self.busy_until:
            down = self.button if moment.time < self.pressed_until else ""
            return StickSample((0.0, 0.0), switch=down == "switch", gripper=down == "gripper")
        while self.goals:
            goal = self.goals[0]
            error = np.array(goal.hand_m) - moment.hand
            near, size = NEAR * goal.within_m, float(np.linalg.norm(error))
            if size <= 1.2 * near:
                if goal.gripper is not None and (goal.gripper == "closed") != self.closed:
                    self.closed = not self.closed
                    return self.press("gripper", moment.time)
                self.goals.pop(0)
                continue
            ways = self.ways(error, moment)
            mine = float(np.hypot(*ways))
            other = math.sqrt(max(size**2 - mine**2, 0.0))
            # What is in hand is finished before changing over.
            if mine <= 0.6 * near or (mine <= near and other > 3 * near):
                return self.press("switch", moment.time)
            fraction = DEAD + (1 - DEAD) * min(SLOW * mine / self.modes[moment.mode].speeds[0], 1.0)
            return StickSample((round(fraction * ways[0] / mine, 2) + 0.0, round(fraction * ways[1] / mine, 2) + 0.0))
        if self.done_at is None:
            self.done_at = moment.time
        return StickSample((0.0, 0.0))

    def press(self, button: str, time: float) -> StickSample:
        """Let the stick go and press a button."""
        self.button, self.pressed_until, self.busy_until = button, time + PRESS, time + PRESS + PAUSE
        return StickSample((0.0, 0.0), switch=button == "switch", gripper=button == "gripper")

    def ways(self, error: NDArray[np.float64], moment: Moment) -> tuple[float, float]:
        """How far it still is along the two rows of the stick's mode [m]; the wrist is as it should be."""
        cos, sin = math.cos(moment.q[2]), math.sin(moment.q[2])
        along = {"x": cos * error[0] + sin * error[1], "y": cos * error[1] - sin * error[0], "z": error[2]}
        first, second = self.modes[moment.mode].rows
        return float(along.get(first, 0.0)), float(along.get(second, 0.0))


def steered(config: ProblemFile[ArdisProblem], drive: DriveName) -> tuple[User, Motion]:
    """The user at the stick of one drive."""
    robot, joystick = robot_of(config), joystick_of(config)
    user = User(config.problem.goals, joystick.modes)
    law = resolver_of(config, robot, drive)
    motion = simulate_motion(robot, law, joystick, user, start_of(config, robot), dt=1 / config.problem.run.rate_hz)
    return user, motion


def stick_csv(user: User) -> str:
    """The text of a recording: the first and the last sample, and those at which something changes."""
    rows = []
    for time, sample in user.samples:
        forward, left = sample.axes
        rows.append((f"{time:.2f}", f"{forward:.2f},{left:.2f},{int(sample.switch)},{int(sample.gripper)}"))
    changes = [row for before, row in pairwise(rows) if row[1] != before[1]]
    told = dict.fromkeys([rows[0], *changes, rows[-1]])
    return "\n".join([",".join(HEADER), *(f"{time},{stick}" for time, stick in told)]) + "\n"


if __name__ == "__main__":
    folder = Path(__file__).parent
    for path in sorted(folder.glob("*.toml")):
        if sys.argv[1:] and path.stem not in sys.argv[1:]:
            continue
        problem = load_problem(str(path))
        for each in problem.problem.stick.recordings:
            user, motion = steered(problem, each)
            print(f"{path.stem} {each}: {motion.time[-1]:.1f} s, goals left {[goal.name for goal in user.goals]}")
            file = folder / f"{path.stem}_{each}.csv"
            file.write_text(stick_csv(user), encoding="utf-8", newline="\n")
