"""One stick, chair and arm: the shipped problems reach their goals within every limit, and faults are one line."""

from __future__ import annotations

import io
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from numpy.typing import ArrayLike
from rich.console import Console

from rehab_opt.control.joystick import Joystick, StickMode
from rehab_opt.control.obstacles import Disc, HalfPlane
from rehab_opt.errors import ProblemFileError
from rehab_opt.kinematics.ardis import ARDIS_READY, ardis
from rehab_opt.plants.ideal import IdealJoints
from rehab_opt.plants.plant import Measurement
from rehab_opt.session.ardis.clearance import arm_gaps, arm_points, chair_corners, chair_gaps
from rehab_opt.session.ardis.measures import KEPT, excesses, goals_met
from rehab_opt.session.ardis.problem import GoalSection
from rehab_opt.session.ardis.robot import joystick_of
from rehab_opt.session.ardis.scene import ArdisScene, ArdisSystem
from rehab_opt.session.ardis.stick import HEADER, LET_GO, Moment, read_stick
from rehab_opt.session.ardis.user import PATIENCE, SimulatedUser
from rehab_opt.session.files import ProblemFile, load_problem, problem_of
from rehab_opt.session.outcome import Outcome
from rehab_opt.session.report import write_report
from rehab_opt.session.run import checked, run_problem
from rehab_opt.session.systems import NotMet
from tests.control.redundancy_campaign import segment_distance
from tests.refusals import refuses

SCENES = {"button": "press_lift_button", "doorway": "through_doorway", "beyond": "beyond_reach"}
Write = Callable[[str, str | bytes], Path]


def run(name: str) -> Outcome:
    outcome = run_problem(load_problem(name))
    return outcome


def scene_of(outcome: Outcome) -> ArdisScene:
    """Ours on the first drive: robot, room and goals are those of all."""
    return next(scene for scene in outcome.scenes.values() if scene.law == "optimised")


@pytest.fixture(scope="module")
def button() -> Outcome:
    return run(f"ardis/{SCENES['button']}")


@pytest.fixture(scope="module")
def doorway() -> Outcome:
    return run(f"ardis/{SCENES['doorway']}")


@pytest.fixture(scope="module")
def beyond() -> Outcome:
    return run(f"ardis/{SCENES['beyond']}")


NIGHTLY = pytest.mark.nightly
ALL = pytest.mark.parametrize(
    "scene", ["button", pytest.param("doorway", marks=NIGHTLY), pytest.param("beyond", marks=NIGHTLY)]
)


@ALL
def test_users_reach_their_goals_with_both_drives_and_ours_breaks_no_limit(
    scene: str, request: pytest.FixtureRequest
) -> None:
    outcome = request.getfixturevalue(scene)
    assert {drive for drive, _ in outcome.traces} == {"mecanum", "differential"}
    for numbers in outcome.metrics["drives"].values():
        ours = numbers["optimised"]
        assert ours["goals_met"] == numbers["published"]["goals_met"] == len(scene_of(outcome).problem.goals) > 0
        assert ours["broken_any_fraction"] == 0.0
        assert max(value for value in ours["excess_max"].values() if value is not None) <= 1e-6
        assert sum(ours["status"].values()) == ours["ticks"]
        assert set(ours["status"]) <= {"ok", "backup"}
        assert ours["wheel_residual_max_m_s"] < 1e-9
        assert ours["at_rest_at_the_end"]


@ALL
def test_wheels_that_roll_never_slip(scene: str, request: pytest.FixtureRequest) -> None:
    outcome = request.getfixturevalue(scene)
    assert outcome.metrics["drives"]["differential"]["optimised"]["rolling_residual_max_m_s"] <= 1e-9
    trace = outcome.traces["differential", "optimised"]
    heading, world = trace["joint"][:, 2], trace["_world"]
    slip = np.sin(heading) * world[:, 0] - np.cos(heading) * world[:, 1]
    assert np.abs(slip).max() <= 1e-9


@NIGHTLY
def test_chair_passes_between_the_posts(doorway: Outcome) -> None:
    scene = scene_of(doorway)
    for trace in (of for (_, law), of in doorway.traces.items() if law == "optimised"):
        corners = chair_corners(scene.robot.outline, trace["joint"][::20])
        assert corners[0, :, 0].max() < 2.05
        assert corners[-1, :, 0].min() > 2.2
        for chair in map(shapely.Polygon, corners):
            for post in (each for each in scene.room if isinstance(each, Disc)):
                assert chair.distance(shapely.Point(post.centre)) >= post.radius - 1e-6


@pytest.mark.parametrize(
    ("name", "pattern"),
    [("place_on_table", [False, True, False]), pytest.param("pick_from_floor", [False, True], marks=NIGHTLY)],
)
def test_gripper_closes_on_the_cup_and_opens_on_the_table(name: str, pattern: list[bool]) -> None:
    config = load_problem(f"ardis/{name}")
    scene = ArdisScene(config, None, "mecanum")
    trace = scene.run(lambda *_: None)
    closed = trace["gripper_closed"]
    assert closed[np.concatenate([[True], np.diff(closed)])].tolist() == pattern
    assert None not in goals_met(trace, config.problem.goals)
    for limit, over in excesses(scene.robot, "mecanum", trace, 0.01, scene.room).items():
        assert over.max() <= KEPT, limit


def test_clearances_are_those_of_shapely() -> None:
    robot, rng = ardis(), np.random.default_rng(4)
    q = np.concatenate([rng.uniform(-1, 1, (40, 3)), rng.uniform(-1, 1, (40, 4))], axis=1)
    room = (Disc((0.9, 0.4), 0.2), Disc((-1.5, 0.1), 0.05), HalfPlane((0.0, 2.0), 3.0))
    gaps = chair_gaps(robot.outline, room, q)
    for corners, row in zip(chair_corners(robot.outline, q), gaps, strict=True):
        chair = shapely.Polygon(corners)
        for post, gap in zip(room[:2], row, strict=False):
            distance = chair.distance(shapely.Point(post.centre))
            if distance > 0:
                assert gap == pytest.approx(distance - post.radius, abs=1e-9)
            else:
                assert gap < -post.radius + 1e-9
        assert row[2] == pytest.approx(1.5 - corners[:, 1].max(), abs=1e-9)
    points = arm_points(robot, np.column_stack([0 * q[:, :3], q[:, 3:]]))
    for (shoulder, elbow, hand), row in zip(points, arm_gaps(robot, q), strict=True):
        oracle = [
            segment_distance(*link, capsule) - capsule.radius - robot.arm_radius
            for capsule in robot.keep_out
            for link in ((shoulder, elbow), (elbow, hand))
        ]
        np.testing.assert_allclose(row, oracle, atol=1e-9)


def steered(folder: Path, rows: str, goal: list[float]) -> ProblemFile[Any]:
    """A problem with one stick of these samples, and one goal."""
    (folder / "s.csv").write_text(",".join(HEADER) + "\n" + rows)
    goals = [{"name": "there", "hand_m": goal}]
    content = {"system": "ardis", "title": "test", "stick": {"mecanum": "s.csv"}, "goals": goals}
    return problem_of(content, name="test", file="test.toml", path=folder / "test.toml")


def not_met(notes: tuple[str, ...]) -> list[str]:
    return [note for note in notes if isinstance(note, NotMet)]


def test_stick_that_was_never_let_go_is_said_to_move_nothing(tmp_path: Path) -> None:
    config = steered(tmp_path, "0,1,0,0,0\n1,1,0,0,0\n2,0,0,0,0\n3,1,0,0,0\n4,0,0,0,0\n", [5.0, 0.0, 0.7])
    outcome = run_problem(config)
    note = "mecanum drive: for 2.0 s the stick moves nothing: the stick must be released first"
    assert not_met(checked(config)) == not_met(outcome.notes) == [note]
    for law, numbers in outcome.metrics["drives"]["mecanum"].items():
        assert numbers["stick_ignored"] == {"the stick must be released first": 200}, law
        assert not outcome.traces["mecanum", law]["_world"][:200].any()
    assert sum(reason != "" for reason in dict(outcome.trace())["stick_ignored"]) == 2 * 200
    files = write_report(outcome, tmp_path / "out")
    figures = {f"{name}.{suffix}" for name in ("hand", "limits", "top_view") for suffix in ("png", "pdf")}
    assert {file.name for file in files} == {"captions.md", "metrics.json", "trace.csv", *figures}
    text = io.StringIO()
    system = ArdisSystem()
    Console(file=text, width=200).print(system.table(outcome))
    assert "200 the stick must be released first" in " ".join(text.getvalue().split())
    assert system.brief(outcome).row_count <= 8 < system.table(outcome).row_count


def test_chair_that_stops_by_itself_says_why(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An arm too weak for its weight stood for 26 of 31 s, and the report said `holding`, and of no joint."""

    class Jams(IdealJoints):
        def step(self, command: ArrayLike, push: ArrayLike | None = None) -> Measurement:
            free = np.array(command, dtype=np.float64)
            free[3] = 0.0
            return super().step(free, push)

    monkeypatch.setattr("rehab_opt.session.ardis.scene.IdealJoints", Jams)
    outcome = run_problem(steered(tmp_path, "0,0,0,0,0\n0.5,0.8,0.6,0,0\n4,0,0,0,0\n", [5.0, 0.0, 0.7]))
    ((reason, ticks),) = outcome.metrics["drives"]["mecanum"]["optimised"]["stopped"].items()
    assert ticks > 200
    joint = scene_of(outcome).chain.names[3]
    assert reason.startswith(f"{joint} does not follow: ")
    (note,) = not_met(outcome.notes)
    assert note.startswith("mecanum drive: for ")
    assert note.endswith(f"despite the stick's command: {reason}")
    assert sum(each == reason for each in dict(outcome.trace())["stopped"]) == ticks


def test_check_says_that_nothing_is_asked_for_and_that_a_goal_is_below_the_floor(tmp_path: Path) -> None:
    still = "0,0,0,0,0\n1,0.1,0,0,0\n"  # within the dead zone
    idle, below = "mecanum drive: the stick commands nothing", "goal 'there' is below the floor"
    assert not_met(checked(steered(tmp_path, still, [1.0, 0.0, -0.5]))) == [idle, below]
    assert not_met(checked(steered(tmp_path, still + "2,1,0,0,0\n", [1.0, 0.0, -0.03]))) == []


@ALL
def test_each_controller_is_steered_by_a_user_who_sees_its_own_hand(scene: str, request: pytest.FixtureRequest) -> None:
    """The published law got the stick of a user who saw ours: it missed two goals of three."""
    outcome = request.getfixturevalue(scene)
    joystick = joystick_of(load_problem(f"ardis/{SCENES[scene]}"))
    for (drive, law), trace in outcome.traces.items():
        user = SimulatedUser(scene_of(outcome).problem.goals, joystick)
        before = [joystick.modes[0].name, *trace["stick_mode"][:-1].tolist()]
        moments = map(Moment, trace["t_s"].tolist(), trace["joint"], trace["hand"], before)
        seen = [(user.at(each) or LET_GO).stick for each in moments]
        np.testing.assert_array_equal(seen, trace["stick"], err_msg=f"{drive}, {law}")


def there(*hand: float, mode: str = "plane", time: float = 1.0) -> Moment:
    return Moment(time, ARDIS_READY, np.array(hand), mode)


def test_user_pushes_an_axis_that_is_turned_round_the_other_way_and_lets_one_that_moves_nothing_alone() -> None:
    goal = GoalSection(name="ahead, left", hand_m=[1.0, 1.0, 0.0])
    for speeds, signs in (((0.2, 0.2), (1, 1)), ((-0.2, 0.2), (-1, 1)), ((0.2, -0.2), (1, -1)), ((0.0, 0.2), (0, 1))):
        user = SimulatedUser([goal], Joystick([StickMode("plane", ("x", "y"), speeds)], dead_zone=0.5))
        sample = user.at(there(0.0, 0.0, 0.0))
        assert sample is not None
        assert np.sign(sample.stick).tolist() == list(signs)
        assert math.hypot(*sample.stick) == pytest.approx(1.0, abs=0.01)
    close = SimulatedUser([goal], Joystick([StickMode("plane", ("x", "y"), (0.2, 0.2))], dead_zone=0.5))
    sample = close.at(there(0.95, 1.0, 0.0))
    assert sample is not None
    assert sample.stick[0] > 0.5, "beyond the dead zone, or nothing moves"


def test_user_lets_go_for_good_at_the_last_goal_and_where_a_goal_takes_too_long() -> None:
    goals = [GoalSection(name="here", hand_m=[0.0, 0.0, 0.0]), GoalSection(name="far", hand_m=[9.0, 0.0, 0.0])]
    done, lost = SimulatedUser(goals[:1], Joystick()), SimulatedUser(goals, Joystick())
    assert done.at(there(0.0, 0.0, 0.0)) is not None
    assert done.at(there(0.0, 0.0, 0.0, time=1.6)) is None
    assert lost.at(there(0.0, 0.0, 0.0)) is not None
    assert lost.at(there(0.0, 0.0, 0.0, time=PATIENCE)) is not None
    assert lost.at(there(0.0, 0.0, 0.0, time=1.1 + PATIENCE)) is None
    assert lost.duration == pytest.approx(2 * PATIENCE + 0.5)


def test_recording_is_held_between_its_samples(written: Write) -> None:
    path = written("stick.csv", ",".join(HEADER) + "\n5.0,0,0,0,0\n5.5,1,-0.5,0,1\n6.0,0,0,1,0\n")
    stick = read_stick(path, name="stick.csv")
    moments = [Moment(t, ARDIS_READY, np.zeros(3), "plane") for t in (0.0, 0.49, 0.5, 0.99, 1.0, 1.01)]
    samples = [stick.at(moment) for moment in moments]
    assert [sample and sample.stick[0] for sample in samples] == [0.0, 0.0, 1.0, 1.0, 0.0, None]
    assert [sample and sample.gripper for sample in samples[:5]] == [False, False, True, True, False]


def test_fault_of_a_stick_is_refused_with_its_place(written: Write) -> None:
    first = ",".join(HEADER) + "\n0,0,0,0,0\n"
    refuses(
        lambda text: read_stick(written("stick.csv", text), name="stick.csv"),
        (("t_s,x,y\n",), "line 1", "the header t_s,forward"),
        ((first,), "samples", "2 to"),
        ((first + "1,2,0,0,0\n",), "line 3, column forward", "from -1 to 1"),
        ((first + "1,nan,0,0,0\n",), "line 3, column forward", "finite"),
        ((first + "1,0,0,0.5,0\n",), "line 3, column switch", "0 or 1"),
        ((first + "0,0,0,0,0\n",), "line 3, column t_s", "more than"),
        ((first + "0,0,0,0\n",), "line 3", "5, as in the header"),
        ((first + "9000,0,0,0,0\n",), "duration", "times in s"),
        error=ProblemFileError,
    )


def test_fault_is_refused_with_its_key(written: Write, tmp_path: Path) -> None:
    written("s.csv", ",".join(HEADER) + "\n0,0,0,0,0\n0.1,0,0,0,0\n")
    content = {"system": "ardis", "title": "test", "stick": {"mecanum": "s.csv"}}

    def read(change: dict[str, Any]) -> None:
        checked(problem_of({**content, **change}, name="test", file="test.toml", path=tmp_path / "test.toml"))

    def mode(second: str) -> dict[str, Any]:
        return {"stick": {"mecanum": "s.csv", "modes": [{"name": "a", "rows": ["x", second], "speeds": [1.0, 1.0]}]}}

    refuses(
        read,
        (({"stick": {}},), "stick.simulated", "a simulated user or a recording for one of"),
        (({"stick": {"simulated": ["mecanum"]}},), "goals", "a goal for the simulated user"),
        (({"stick": {"simulated": ["mecanum"], "mecanum": "s.csv"}},), "stick.mecanum", "no recording"),
        (({"stick": {"mecanum": "absent.csv"}},), "stick.mecanum", "a recording beside"),
        (({"stick": {"mecanum": "s.csv", "tracks": "s.csv"}},), "stick.tracks", "one of the keys"),
        ((mode("x"),), "stick.modes.0.rows", "two different"),
        ((mode("w"),), "stick.modes.0.rows.1", "'roll7'"),
        (({"robot": {"arm_deg": [90.0, 0.0, 0.0, 0.0]}},), "robot.arm_deg.0", "shoulder_flexion within -165 to 20"),
        (({"room": {"walls": [{"normal": [1.0, 0.0], "offset_m": 0.2}]}},), "robot.start_m", "clear of walls"),
        (({"room": {"walls": [{"normal": [2.0, 0.0], "offset_m": 9.0}]}},), "room.walls.0.normal", "length 1"),
        (({"run": {"rate_hz": 1.0}},), "run.rate_hz", "greater than or equal to 50"),
        (({"run": {"solver": "no_such"}},), "run.solver"),
        error=ProblemFileError,
    )
