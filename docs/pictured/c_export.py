"""Commands of a controller in C and in Python, over the recorded run of an export."""

from __future__ import annotations

import csv
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from rehab_opt.control.command import Status
from rehab_opt.control.reasons import REASONS
from rehab_opt.export.export_c import export_c
from rehab_opt.export.recording import STATUSES
from rehab_opt.kinematics.ur5 import ur5
from rehab_opt.session.drawing import BROAD, COMMANDED, LIMIT, REFERENCE, TRUE, framed, legend_below
from rehab_opt.session.files import load_problem

PROBLEM = "robot/ur5_circle"
JOINT = 1
"""Joint whose command is drawn; the difference is over all joints."""
TICK_S = 0.001
CLOSE_UP = (2.62, 3.06)
"""[s] Around the frozen encoders."""
ALLOWED = 1e-9
"""[rad/s] Difference that `example` accepts."""
LEAST = 1e-17
"""[rad/s] Differences below this are drawn on a linear scale, which has a zero."""
SAFE = {STATUSES[each] for each in (Status.BRAKING, Status.HOLDING)}
EVERY_TICK = """\
#define main repeated
#include "main.c"
#undef main
int main(void)
{
    rehab_command command;
    int tick, joint;
    if (rehab_pose_tracker_init(&controller) != 0) {
        return 1;
    }
    for (tick = 0; tick < TICKS; ++tick) {
        step(&recorded_run[tick], &command);
        for (joint = 0; joint < 6; ++joint) {
            printf("%.17g ", command.value[joint]);
        }
        printf("\\n");
    }
    return 0;
}
"""
"""The export's example, printing every command."""
CC = ("cc", "-std=c99", "-O2", "-fno-math-errno", "-ffp-contract=off")


def c_commands() -> Figure:
    """The same ticks in Python and in C."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        export_c(load_problem(PROBLEM), folder)
        (folder / "every_tick.c").write_text(EVERY_TICK, encoding="utf-8")
        subprocess.run([*CC, "-o", "every_tick", "every_tick.c", "rehab_pose_tracker.c", "-lm"], cwd=folder, check=True)
        said = subprocess.run([folder / "every_tick"], capture_output=True, text=True, check=True).stdout
        with (folder / "recorded_run.csv").open(encoding="utf-8", newline="") as file:
            ticks = list(csv.DictReader(file))
    python = np.array([[float(tick[f"value_{joint}"]) for joint in range(6)] for tick in ticks])
    c = np.array([line.split() for line in said.splitlines()], dtype=float)
    safe = np.array([int(tick["status"]) in SAFE for tick in ticks])
    time, apart = TICK_S * np.arange(len(ticks)), np.abs(c - python).max(axis=1)

    figure = framed("One controller in Python and in C: a UR5's pose tracker, with faults among its inputs.", 4.2)
    grid = figure.subplots(2, 2, width_ratios=(2.2, 1), height_ratios=(2, 1), sharex="col", sharey="row")
    since = {REASONS[int(tick["reason"])].name: at for tick, at in zip(ticks[::-1], time[::-1], strict=True)}
    braked = np.rad2deg(abs(python[np.searchsorted(time, since["NOT_FOLLOWED"]), JOINT]))
    names = ("the whole recorded run", f"close-up: braking from {braked:.0f} deg/s")
    for (above, below), name, (first, last) in zip(grid.T, names, ((0.0, time[-1]), CLOSE_UP), strict=True):
        shown = (time >= first) & (time <= last)
        for axes in (above, below):
            axes.fill_between(
                time[shown], 0, 1, where=safe[shown], step="post", color=LIMIT, alpha=0.6, linewidth=0.8,
                transform=axes.get_xaxis_transform(), label="fallback command, at a fault",
            )  # fmt: skip
            axes.margins(x=0.01)
        degrees = (np.rad2deg(each[shown, JOINT]) for each in (python, c))
        above.step(time[shown], next(degrees), where="post", color=COMMANDED, linewidth=BROAD, label="Python")
        above.step(time[shown], next(degrees), where="post", color=TRUE, label="C")
        below.plot(time[shown], apart[shown], ".", color=TRUE)
        below.axhline(ALLOWED, color=REFERENCE, linestyle="--", label="largest difference allowed")
        above.set_title(name)
        below.set_xlabel("time [s]")
    joint = ur5().names[JOINT].replace("_", " ")
    grid[0, 0].set_ylabel(f"commanded speed of the\n{joint} joint [deg/s]")
    grid[1, 0].set_ylabel("C minus Python,\nlargest joint [rad/s]")
    grid[1, 0].set_yscale("symlog", linthresh=LEAST, linscale=0.5)
    grid[1, 0].set_ylim(-0.3 * LEAST, 1e-7)
    grid[1, 0].set_yticks([0, 1e-15, 1e-12, 1e-9])
    grid[1, 0].minorticks_off()
    top = 1.6 * np.rad2deg(python[:, JOINT].max())
    for x, words in (
        (0.4 * since["NOT_FOLLOWED"], "grey lines: single faults (NaN, a stamp, a unit);\neach brakes for a tick"),
        ((since["NOT_FOLLOWED"] + time[-1]) / 2, "encoders stand\nstill: brakes\nand holds"),
    ):
        grid[0, 0].text(x, 0.97 * top, words, ha="center", va="top")
    grid[0, 0].set_ylim(top=top)
    return legend_below(figure)
