"""A user's own limit appears in the C of the controller that keeps it."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from rehab_opt import Clearance, Limit, MirrorTracker, MovingCapsule, PoseTracker, export_c, ur5
from rehab_opt.kinematics.room import moving_numbers
from tests.control.clearance_world import Swinging
from tests.control.test_limit import elbow, elbow_above
from tests.export.calling_c import SAME, Built, largest_difference, ran

CLEAR = np.array([0.3, -1.4, 1.9, -1.9, -1.2, 0.4])


@pytest.fixture(scope="module")
def limited(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """C of the tracker in docs/capabilities/export_to_c.md, with a limit of its user."""
    folder = tmp_path_factory.mktemp("limited")
    elbow_up = Limit(lambda arm, q: arm.frames_expression(q)[3][2, 3] - 0.1)
    export_c(PoseTracker(ur5(velocity=1.0), dt=0.002, limits=[elbow_up], compile=False), folder)
    return folder


@pytest.mark.parametrize(
    ("compiler", "level"),
    [
        ("gcc", "-O2"),
        *(
            pytest.param(*each, marks=pytest.mark.nightly)
            for each in (("gcc", "-O3"), ("clang", "-O2"), ("clang", "-O3"))
        ),
    ],
)
def test_c_with_a_user_s_limit_builds_without_a_warning(compiler: str, level: str, limited: Path, built: Built) -> None:
    """gcc 12 warned nine times of writing out of bounds, where a work space was copied."""
    if shutil.which(compiler) is None:
        pytest.skip(f"{compiler} is not installed")
    program = f"example_{compiler}{level}"
    flags = (level, "-Wmisleading-indentation")
    done = ran(built(limited, program, "rehab_pose_tracker.c", "main.c", flags=flags, by=compiler), "0")
    assert done.returncode == 0, done.stdout


@pytest.mark.nightly
def test_c_of_a_mirrored_hand_repeats_a_run_among_bodies_that_move(built: Built, tmp_path: Path) -> None:
    """Faults of the run are among its bodies, too."""
    robot, dt, place = ur5(), 0.01, ur5().pose(CLEAR)
    limits = [Clearance(margin=0.02, moving=2), elbow_above(float(elbow(CLEAR[None])[0]) - 0.01)]
    control = MirrorTracker(
        robot, dt=dt, floor=0.4, backup="qrqp", compile=False, limits=limits, max_manipulability=0.15
    )
    swinging, pose, run = Swinging.drawn(np.random.default_rng(2), 1, 0.2), place.copy(), []
    for k in range(400):
        ahead = place[:3, 3] + [0.0, -0.2 + 0.1 * k * dt, 0.0]
        pusher = MovingCapsule(ahead, ahead, 0.05, (0.0, 0.1, 0.0), (0.0, 0.1, 0.0))
        told = moving_numbers([*swinging.at(np.array([k * dt]), np.ones(1)), pusher], 2)
        run.append({"q": CLEAR, "pose": pose, "twist": np.zeros(6), "obstacles": told})
    export_c(control, tmp_path, run=run, memory=200_000)
    assert largest_difference(tmp_path, "mirror_tracker", built) <= SAME
