"""Claims about recording: a recorder sees each tick's own QP, once, and costs nothing where there is none."""

import math
import shlex
from pathlib import Path

import numpy as np
import pytest

from bench.qp_recording import recording
from bench.qp_recording.recording import recorded_run
from bench.qp_recording.sequence import read_sequence
from bench.record import main
from rehab_opt import PoseTracker, ur5
from rehab_opt.control.arm_ik import ArmIK
from rehab_opt.kinematics.human_arm import human_arm
from rehab_opt.optim.backends import backend
from rehab_opt.optim.fallback_chain import FallbackChain
from rehab_opt.optim.qp import Statement
from rehab_opt.optim.recorder import recorder_now, recording_qps
from rehab_opt.optim.rows import Instance, parameter, variable, within
from rehab_opt.session.files import ProblemFile, load_problem, problem_content, problem_of, problem_path

POSE = np.array([0.3, -1.3, 1.7, -1.9, -1.4, 0.2])


def tracker(**options: object) -> PoseTracker:
    return PoseTracker(ur5(velocity=0.2), dt=0.01, compile=False, **options)  # type: ignore[arg-type]


def moved(robot: PoseTracker, ticks: int) -> list[Instance]:
    """Follow a pose that runs away; what the tracker itself says its QPs are."""
    q, told = POSE.copy(), []
    for tick in range(ticks):
        pose = robot.chain.pose(POSE)
        pose[0, 3] += 0.01 * tick
        twist = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        told.append(robot.instance(q, pose, twist))
        q = q + robot.dt * robot.step(q, pose, twist).value
    return told


def assert_same(seen: list[Instance], told: list[Instance]) -> None:
    assert len(seen) == len(told)
    for one, other in zip(seen, told, strict=True):
        for a, b in zip(one, other, strict=True):
            np.testing.assert_array_equal(a, b)


# ------------------------------------------------------------------------------------------------------------ recorder
@pytest.mark.parametrize("solver", ["qrqp", "proxqp", "daqp"])
def test_a_recorder_sees_each_tick_s_own_qp_once(solver: str) -> None:
    with recording_qps() as recorder:
        told = moved(tracker(solver=solver), 12)
    (stream,) = recorder.streams
    assert (stream.name, stream.ticks) == ("pose_tracker", True)
    assert stream.tolerance == tracker().tolerance
    assert_same(stream.instances(), told)


def test_what_is_tried_again_is_seen_once() -> None:
    """The backup answers: qrqp is made to fail, and is tried twice before."""
    target, x = parameter("target", 1), variable("x", 1, lower=-1.0, upper=1.0)
    statement = Statement(
        "again", parameters=[target], variables=[x], minimise=(x.symbol - target) ** 2 / 2,
        subject_to=[within(x.symbol, -0.5, 0.5)],
    )  # fmt: skip
    with recording_qps() as again:
        other = FallbackChain(statement, solver="qrqp", backup="proxqp", tolerance=1e-9, compile=False)
        plain = other.function.evaluate

        def failing() -> None:
            plain()
            other.verdict[0] = math.nan

        other.function.evaluate = failing
        other.parameters[:] = 0.7
        assert other() == "proxqp"
    assert [stream.met for stream in again.streams] == [1]
    (qp,) = again.streams[0].instances()
    assert qp.g[0] == -0.7


def test_a_command_with_a_recorder_is_the_command_without() -> None:
    def commands() -> list[bytes]:
        robot, q = tracker(), POSE.copy()
        pose = robot.chain.pose(POSE + 0.3)
        return [robot.step(q, pose, np.zeros(6)).value.tobytes() for _ in range(5)]

    with recording_qps():
        seen = commands()
    assert seen == commands()


def test_the_iterations_of_inverse_kinematics_are_seen_as_the_qps_that_gave_their_steps() -> None:
    """Each QP, solved by another solver, leads to where the next iteration begins."""
    arm = human_arm(range_of_motion="regular")
    with recording_qps() as recorder:
        ArmIK(arm, compile=False).solve(
            arm.pose((arm.lower + arm.upper) / 2)[:3, 3] + 0.05, (arm.lower + arm.upper) / 2
        )
    stream = next(each for each in recorder.streams if each.name == "ik_posture_step" and len(each) > 2)
    checked = 0
    assert stream.ticks is False
    starts = [values[1] for values in stream.seen]
    for qp, here, there in zip(stream.instances(), starts, starts[1:], strict=False):
        step = backend("proxqp", qp.g.size, qp.rows_lower.size).solve(qp).x
        if np.abs(there - here).max() < 0.5:  # else another start
            np.testing.assert_allclose(here + step, there, atol=1e-7)
            checked += 1
    assert checked >= 2


# ------------------------------------------------------------------------------------------------------ a file's run
def circle(**changes: object) -> ProblemFile[object]:
    name, path = problem_path("robot/ur5_circle")
    content = problem_content(path, "robot/ur5_circle")
    content["circle"] |= {"turns": 1.0, "duration_s": 2.0}
    content["tracker"]["rate_hz"] = 100.0
    return problem_of(content | changes, name=name, file="robot/ur5_circle", path=path)


def test_a_run_gives_its_sequence_with_the_tick_and_the_command_that_makes_it_again() -> None:
    (sequence,) = recorded_run(circle(), skip=10, ticks=50)
    assert sequence.name == "pose_tracking/ur5_circle_pose_tracker"
    assert (len(sequence), sequence.n, sequence.m) == (50, 6, 0)
    assert sequence.dt == 0.01
    assert sequence.command == "python -m bench.record robot/ur5_circle --skip 10 --ticks 50"
    (longer,) = recorded_run(circle(), skip=0, ticks=60)
    assert_same(list(sequence), list(longer)[10:])


def test_the_command_names_a_file_of_one_s_own_and_the_solver_and_writes_what_it_says(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own = tmp_path / "my circle.toml"
    text = problem_path("robot/ur5_circle")[1].read_text()
    own.write_text(text.replace("duration_s = 8.0", "duration_s = 2.0").replace("rate_hz = 1000.0", "rate_hz = 50.0"))
    (sequence,) = recorded_run(load_problem(str(own)), ticks=5, solver="proxqp")
    words = shlex.split(sequence.command)
    assert words == ["python", "-m", "bench.record", str(own), "--skip", "0", "--ticks", "5", "--solver=proxqp"]
    main([*words[3:], "--out", str(tmp_path / "deep" / "again.npz")])
    assert capsys.readouterr().out == f"{tmp_path / 'deep' / 'again.npz'}: 5 QPs of 6 variables and 0 rows\n"
    again = read_sequence(tmp_path / "deep" / "again.npz")
    assert again.command == sequence.command
    assert again.dt == 0.02
    assert_same(list(again), list(sequence))


class TwoSearches:
    """A run in which two solvers of one name iterate beside a controller that ticks."""

    def __call__(self, config: object, **_: object) -> None:
        recorder = recorder_now()
        assert recorder is not None
        qp = Instance(np.eye(1), np.zeros(1), np.zeros((0, 1)), np.zeros(0), np.zeros(0), np.zeros(1), np.ones(1))
        for name, ticks in (("search", False), ("search", False), ("controller", True)):
            recorder.stream(name, 1e-8, Instance, ticks=ticks).see(*qp)


def test_solvers_of_one_name_are_told_apart_and_iterations_have_no_tick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recording, "run_problem", TwoSearches())
    found = recorded_run(circle())
    assert [each.name for each in found] == [
        f"pose_tracking/ur5_circle_{name}" for name in ("search_1", "search_2", "controller")
    ]
    assert [math.isnan(each.dt) for each in found] == [True, True, False]


def test_a_folder_in_the_place_of_a_file_is_refused_before_anything_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(recording, "run_problem", TwoSearches())
    for folder, out in (("a.npz", "a.npz"), ("b_search_2.npz", "b.npz")):
        Path(folder).mkdir()
        with pytest.raises(SystemExit) as ended:
            main(["robot/ur5_circle", "--out", out])
        assert ended.value.code == 2
        told = f"rehab-opt: --out = '{folder}': expected the name of a file: a folder stands there\n"
        assert capsys.readouterr().err == told
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.npz", "b_search_2.npz"]


# -------------------------------------------------------------------------------------------------------- the command
@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["upper_limb/workspace"], "system = 'workspace'"),
        (["robot/ur5_circle", "--out", "circle.txt"], "--out"),
        (["robot/ur5_circle", "--skip", "-1"], "--skip"),
        (["robot/nothing"], "not found"),
    ],
)
def test_a_refusal_is_one_line_and_writes_nothing(
    arguments: list[str],
    told: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    line = capsys.readouterr().err
    assert told in line
    assert line.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
