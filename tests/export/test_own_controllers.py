"""A controller that was made in Python becomes C by one call, and commands the same."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import rehab_opt
from rehab_opt import (
    Clearance,
    ConfigurationError,
    Limit,
    PoseTracker,
    Smoother,
    export_c,
    ur5,
)
from rehab_opt.control.bilateral import Bilateral
from rehab_opt.control.redundancy import RedundancyResolver
from rehab_opt.kinematics.ardis import ardis
from rehab_opt.session.files import load_problem
from tests.control.test_limit import TABLE, elbow_above
from tests.export.assisting import made, made_along_a_path
from tests.export.calling_c import SAME, Built, largest_difference, shared
from tests.export.mirroring import redundant
from tests.export.pairing import sides
from tests.refusals import refuses


def with_a_table(**options: object) -> PoseTracker:
    """A tracker as its user makes one, backup and all, whose elbow stays above a table."""
    robot = ur5(acceleration=np.full(6, 10.0))
    return PoseTracker(robot, dt=0.005, compile=False, limits=[elbow_above(TABLE)], **options)  # type: ignore[arg-type]


def hostile_run(seed: int, ticks: int) -> list[dict[str, np.ndarray]]:
    """States on and beyond every limit, poses that are none, twists of any size and numbers that are not."""
    rng, robot = np.random.default_rng(seed), ur5()
    run = []
    for _ in range(ticks):
        q = rng.uniform(robot.lower, robot.upper) * rng.choice([0.2, 0.5, 1.0, 1.01])
        pose = robot.pose(q + rng.normal(size=6) * rng.choice([1e-6, 1e-2, 1.0]))
        tick = {"q": q, "pose": pose, "twist": rng.normal(size=6) * rng.choice([0.0, 0.1, 10.0])}
        if rng.random() < 0.1:
            array = tick[str(rng.choice(list(tick)))]
            array.flat[rng.integers(array.size)] = rng.choice([np.nan, np.inf, -np.inf, 1e7, -9e5, 1e300])
        run.append(tick)
    return run


def test_a_tracker_with_a_limit_of_its_own_commands_the_same_in_c(built: Built, tmp_path: Path) -> None:
    export_c(with_a_table(), tmp_path, run=hostile_run(7, 1500))
    assert largest_difference(tmp_path, "pose_tracker", built) <= SAME
    statuses = {line.split(",")[-4] for line in (tmp_path / "recorded_run.csv").read_text().splitlines()[1:]}
    assert statuses >= {"0", "2", "3"}  # solved, braking, holding


def fixed() -> RedundancyResolver:
    """An arm on a chair that stands, its elbow above a table."""
    above = Limit(lambda chain, q: chain.frames_expression(q)[6][2, 3] - 0.95)
    options = {"row_sets": [("x", "y"), ("z",)], "keep_out": False, "limits": [above]}
    return RedundancyResolver(ardis(), drive="fixed", compile=False, **options)  # type: ignore[arg-type]


def arms_and_hands() -> dict[str, tuple[Callable[[], object], tuple[str, ...]]]:
    """What may be made in Python, and the folders of its C."""
    return {
        "pose_tracker": (with_a_table, ("",)),
        "redundancy_fixed": (fixed, ("",)),
        "assistance": (lambda: made("assist", backup=None), ("",)),
        "path_assistance": (made_along_a_path, ("",)),
        "pair": (lambda: Bilateral(*sides(), delay=0.01), ("helper_side", "participant_side")),
    }  # fmt: skip


@pytest.mark.nightly
@pytest.mark.parametrize("kind", arms_and_hands())
def test_without_a_run_of_its_own_it_repeats_a_random_one(kind: str, built: Built, tmp_path: Path) -> None:
    make, folders = arms_and_hands()[kind]
    export_c(make(), tmp_path / "c")
    for folder in folders:
        assert largest_difference(tmp_path / "c" / folder, folder or kind, built) <= SAME


def test_the_header_says_whose_joints_what_limits_which_tick_and_what_is_computed(tmp_path: Path) -> None:
    robot = ur5(velocity=2.25, acceleration=np.full(6, 12.5))
    headers = {}
    for name, dt, speed in (
        ("first", 0.004, 0.3),
        ("again", 0.004, 0.3),
        ("slower", 0.004, 0.2),
        ("later", 0.005, 0.3),
    ):
        export_c(PoseTracker(robot, dt=dt, linear_speed=speed, compile=False), tmp_path / name)
        headers[name] = (tmp_path / name / "rehab_pose_tracker.h").read_text()
    header = headers["first"]
    for i, joint in enumerate(robot.names):
        found = re.search(rf"^ \*\s+{joint} \[rad\]((?:\s+\S+){{4}})$", header, re.MULTILINE)
        assert found is not None, joint
        expected = robot.lower[i], robot.upper[i], 2.25, 12.5
        assert [float(each) for each in found[1].split()] == pytest.approx(expected, rel=1e-8)
    assert "hand: at most 0.3 m/s" in header
    assert "#define REHAB_POSE_TRACKER_DT 0.004 " in header
    assert f'#define REHAB_POSE_TRACKER_VERSION "{rehab_opt.__version__}"' in header
    model = {name: re.search(r'_MODEL "([0-9a-f]{64})"', text)[1] for name, text in headers.items()}  # type: ignore[index]
    assert model["first"] == model["again"]
    assert len(set(model.values())) == 3


@pytest.mark.nightly
@pytest.mark.parametrize("memory", [None, 62_000])
def test_a_mirror_keeps_to_its_memory(memory: int | None, built: Built, tmp_path: Path) -> None:
    tracker = redundant()
    most = tracker.clock.most
    export_c(tracker, tmp_path, memory=memory)
    library = shared(tmp_path, "mirror_tracker", built)
    assert library.controller_size() <= (memory or 96_000)
    assert largest_difference(tmp_path, "mirror_tracker", built) <= SAME
    assert "REHAB_THINNED = 4 /* no more samples fit" in (tmp_path / "rehab_mirror_tracker.h").read_text()
    assert tracker.clock.most == most


def test_a_tracker_goes_on_with_its_backup_afterwards(tmp_path: Path) -> None:
    """What export leaves behind is a tracker that was reset, and no other."""
    tracker, other = with_a_table(), with_a_table()
    export_c(tracker, tmp_path)
    for tick in hostile_run(3, 50):
        assert str(tracker.step(**tick)) == str(other.step(**tick))


def test_what_cannot_become_c_is_refused_by_name(tmp_path: Path) -> None:
    plain, folder, file = PoseTracker(ur5(), compile=False), tmp_path / "c", tmp_path / "file"
    file.touch()
    smoother = Smoother(axes=1, dt=0.01, velocity=1.0, acceleration=1.0, jerk=1.0)
    proxqp = PoseTracker(ur5(), solver="proxqp", compile=False)
    refuses(export_c, ((smoother, folder), "controller = ", "MirrorTracker", "PoseTracker"))
    refuses(export_c, ((proxqp, folder), "solver = 'proxqp': expected qrqp"))
    refuses(export_c, *(((plain, where), "folder = ") for where in (None, 5, file, file / "below")))
    sized = partial(export_c, plain, folder)
    refuses(sized, *(({"memory": size}, "memory = ", "a number of bytes") for size in (0, -1, 1e4, True)))
    for controller in (Bilateral(*sides()), load_problem("robot/ur5_circle")):
        refuses(partial(export_c, controller, folder), ({"run": [{}]}, "run = '1 ticks': expected None"))
    with pytest.raises(ConfigurationError, match=r"memory = 5000: expected at least (\d+) bytes") as refused:
        export_c(plain, folder, memory=5000)
    least = int(re.search(r"at least (\d+)", str(refused.value))[1])  # type: ignore[index]
    export_c(plain, tmp_path / "least", memory=least)
    tick = {"q": np.zeros(6), "pose": np.eye(4), "twist": np.zeros(6)}
    refuses(
        partial(export_c, plain, folder),
        ({"run": []}, "run = []: expected a list of at least one tick"),
        ({"run": [3]}, "run = [3]: expected a list"),
        ({"run": [tick, {**tick, "twist": np.zeros(3)}]}, "run[1]['twist'] = ", "shape (6,)"),
        ({"run": [{"q": np.zeros(6)}]}, "run[0] = ['q']: expected pose among them"),
        ({"run": [{**tick, "obstacles": []}]}, "run[0]['obstacles'] = []: expected None"),
    )
    among = PoseTracker(ur5(), compile=False, limits=[Clearance(margin=0.02, moving=1)])
    refuses(partial(export_c, among, folder), ({"run": [tick]}, "run[0]['obstacles'] = None: expected up to 1 Moving"))
    assert not folder.exists()
