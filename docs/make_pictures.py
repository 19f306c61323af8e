"""Draw the pages' pictures from runs of shipped problems: `python docs/make_pictures.py [NAME ...]`; some minutes.

Each is a figure of the run itself, or one that `docs/pictured` makes where a run draws none, with fewer pixels and
colours so that the checkout stays small. Of these `c_commands` needs a C compiler, `loop_log` the extras `log` and
`physics`, and `study_report` a chromium.
"""

from __future__ import annotations

import io
import os
import sys
from pathlib import Path
from typing import NamedTuple

os.environ.setdefault("REHAB_OPT_COMPILE", "wait")

from matplotlib.figure import Figure
from pictured.c_export import c_commands
from pictured.conventions import frames, tick
from pictured.drawings import mapped_drawing
from pictured.loop import loop_log
from pictured.scoring import scored_reaches
from pictured.solvers import solver_times
from pictured.studies import report_page
from PIL import Image

from rehab_opt.kinematics.human_arm import human_arm
from rehab_opt.session.arm_picture import range_figure
from rehab_opt.session.drawing import fitted, styled
from rehab_opt.session.files import load_problem
from rehab_opt.session.run import run_problem
from rehab_opt.session.systems import system_named

FOLDER = Path(__file__).parent / "pictures"
COLOURS = 128
RANGE = "range_of_motion"
"""The one picture that is of no run."""
MADE = {
    "c_commands": c_commands,
    "frames": frames,
    "loop_log": loop_log,
    "mapped_drawing": mapped_drawing,
    "scored_reaches": scored_reaches,
    "solver_times": solver_times,
    "study_report": report_page,
    "tick": tick,
}
"""Of `docs/pictured`, each by what draws it."""
PAGE = 900
"""[pixels] Width of a page that a browser shows."""
DPI = 130


class Picture(NamedTuple):
    """Which figure of which run."""

    problem: str
    figure: str
    plant: str | None = None


PICTURES = {
    "figure_eight_joints": Picture("upper_limb/figure_eight", "joints"),
    "figure_eight_path": Picture("upper_limb/figure_eight", "hand_path"),
    "workspace": Picture("upper_limb/workspace", "workspace"),
    "workspace_map": Picture("upper_limb/workspace_map", "map_source_to_target"),
    "assist_field": Picture("upper_limb/scenario_2_assist", "field"),
    "assist_trials": Picture("upper_limb/scenario_2_assist", "trials"),
    "path_deviation": Picture("upper_limb/scenario_4_follow", "deviation"),
    "circle_joints": Picture("robot/ur5_circle", "joints"),
    "clearance": Picture("robot/ur5_among_bodies", "clearance"),
    "circle_servos": Picture("robot/ur5_circle", "servos", plant="mujoco"),
    "chair_from_above": Picture("ardis/beyond_reach", "top_view"),
    "mirror_in_space": Picture("mirror/pick_fruit", "space"),
    "mirror_manipulability": Picture("mirror/pick_fruit", "manipulability"),
    "drink_limits": Picture("ardis/kinova_drink", "limits"),
}


def small(figure: Figure | Image.Image) -> Image.Image:
    """The figure with few pixels and colours."""
    whole = figure if isinstance(figure, Image.Image) else _drawn(figure)
    width = PAGE if isinstance(figure, Image.Image) else whole.width // 2
    reduced = whole.resize((width, round(whole.height * width / whole.width)), Image.Resampling.LANCZOS)
    return reduced.quantize(COLOURS, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)


def _drawn(figure: Figure) -> Image.Image:
    """Twice as large, in all of its colours."""
    image = io.BytesIO()
    fitted(figure).savefig(image, dpi=2 * DPI)
    return Image.open(image).convert("RGB")


def save(name: str, figure: Figure | Image.Image) -> None:
    """Write a picture, and say how large its file is."""
    path = FOLDER / f"{name}.png"
    small(figure).save(path, optimize=True)
    print(f"{path.name}: {path.stat().st_size / 1000:.0f} kB", flush=True)


@styled()
def main(names: list[str]) -> None:
    """Draw those pictures, or all."""
    chosen = {name: PICTURES[name] for name in names or PICTURES if name not in (RANGE, *MADE)}
    FOLDER.mkdir(exist_ok=True)
    if RANGE in names or not names:
        arm = human_arm(range_of_motion="restricted")
        save(RANGE, range_figure("restricted", arm))
    for name, make in MADE.items():
        if name in names or not names:
            save(name, make())
    for run in dict.fromkeys((each.problem, each.plant) for each in chosen.values()):
        outcome = run_problem(load_problem(run[0]), plant=run[1])
        system = system_named(outcome.system)
        figures = system.figures(outcome)
        for name, picture in chosen.items():
            if (picture.problem, picture.plant) == run:
                save(name, figures[picture.figure])


if __name__ == "__main__":
    main(sys.argv[1:])
