"""A hand led along the other hand's mirrored path: every bound at every tick, and faults that are one line."""

from __future__ import annotations

import csv
import io
import json
import math
import runpy
import tomllib
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from problems.mirror import motions
from rehab_opt.control.conditioning import Conditioned
from rehab_opt.errors import ProblemFileError
from rehab_opt.session.files import ProblemFile, load_problem, problem_of, shipped_problems
from rehab_opt.session.mirror.laws import BEFORE, LAWS, PLAN, STEP
from rehab_opt.session.mirror.metrics import CAUSES, causes, passed_fraction
from rehab_opt.session.mirror.run import task_of
from rehab_opt.session.mirror.scene import laid_out
from rehab_opt.session.outcome import Outcome
from rehab_opt.session.report import metrics_json, write_trace
from rehab_opt.session.run import checked, run_problem
from rehab_opt.session.systems import NotMet, system_named
from rehab_opt.session.trace import Trace
from tests.control.mirror_campaign import closed_form
from tests.refusals import refuses

Array = np.ndarray
Write = Callable[[str, str | bytes], Path]

FLOOR, DEVIATION, SPEED = 0.3, 0.05, 0.25
NAMES = ("pick_fruit", "open_refrigerator")
ALL = (*NAMES, pytest.param("vr_hand", marks=pytest.mark.nightly))
FOLDER = shipped_problems()["mirror/pick_fruit"].parent
ROWS = (FOLDER / "pick_fruit.csv").read_text().splitlines()
SHARED: dict[str, Outcome] = {}


@pytest.fixture
def ran(recorded: Callable[[str], Path]) -> Callable[[str], Outcome]:
    """The outcome of a shipped problem; each is run once."""

    def run(name: str) -> Outcome:
        if name == "vr_hand":
            recorded("vr_hand_tracker/tracker_record_rows_1_3000.csv")
        if name not in SHARED:
            outcome = run_problem(load_problem(f"mirror/{name}"))
            SHARED[name] = outcome
        return SHARED[name]

    return run


def ends(outcome: Outcome, led: Trace) -> Array:
    """(M, n) where each tick leads."""
    return led["joint"] + led["command"] / outcome.metrics["parameters"]["tracker"]["rate_hz"]


def content(name: str = "pick_fruit") -> dict[str, Any]:
    """What a shipped file says."""
    return tomllib.loads((FOLDER / f"{name}.toml").read_text())


# ------------------------------------------------------------------------------------------------------- the bounds
@pytest.mark.parametrize("law", [STEP, PLAN])
@pytest.mark.parametrize("name", ALL)
def test_floor_deviation_speeds_and_planes_hold_at_every_tick(
    name: str, law: str, ran: Callable[[str], Outcome]
) -> None:
    outcome = ran(name)
    led, robot = outcome.traces[law,], task_of(outcome).robot
    dt, after = 1.0 / outcome.metrics["parameters"]["tracker"]["rate_hz"], ends(outcome, led)
    assert led["_complete"]
    assert min(map(closed_form, after)) >= FLOOR - 1e-6
    np.testing.assert_allclose(led["manipulability"], [closed_form(q) for q in led["joint"]], atol=1e-6)
    np.testing.assert_allclose(after[:-1], led["joint"][1:], atol=1e-12)

    here = np.array([robot.pose(q)[:3, 3] for q in led["joint"]])
    there = np.array([robot.pose(q)[:3, 3] for q in after])
    asked = led["_reference"][:, :3, 3]
    beyond = np.linalg.norm(there - asked, axis=1) - led["_short"][:, 0]
    assert np.nanmax(beyond) <= DEVIATION + 1e-9
    assert np.linalg.norm(there - here, axis=1).max() <= SPEED * dt * (1 + 1e-6)

    assert np.all(np.abs(led["command"]) <= robot.velocity)
    assert np.all((after >= robot.lower - 1e-9) & (after <= robot.upper + 1e-9))
    change = np.abs(np.diff(led["command"], axis=0, prepend=np.zeros((1, robot.n))))
    for over, what in zip(np.any(change > robot.acceleration * dt + 1e-9, axis=1), led["relaxed"], strict=True):
        assert not over or "acceleration" in what

    symbol = ca.SX.sym("q", robot.n)
    frames = ca.Function("frames", [symbol], [ca.horzcat(*(f[:3, 3] for f in robot.frames_expression(symbol)))])
    points = np.array([np.array(frames(q)) for q in after[::5]])[:, :, 2:]  # the first two stay where they are
    for plane in outcome.metrics["parameters"]["tracker"]["keep_out"]:
        room = np.einsum("i,nij->nj", plane["normal"], points - np.array(plane["point_m"])[None, :, None])
        assert room.min() >= -1e-9


@pytest.mark.parametrize("law", [STEP, PLAN])
@pytest.mark.parametrize("name", ALL)
def test_a_drive_passes_what_the_law_does_within_every_bound_and_is_what_the_table_begins_with(
    name: str, law: str, ran: Callable[[str], Outcome]
) -> None:
    outcome = ran(name)
    led, numbers, task = outcome.traces[law,], outcome.metrics["laws"][law], task_of(outcome)
    drive, robot, reference = led["_drive"].item(), task.robot, task.setup.reference
    dt = drive["t_s"][1] - drive["t_s"][0]
    assert min(map(closed_form, drive["joint"])) >= FLOOR - 1e-4
    places = np.array([robot.pose(q)[:3, 3] for q in drive["joint"]])
    assert np.linalg.norm(np.diff(places, axis=0), axis=1).max() <= SPEED * dt * (1 + 1e-6)
    assert np.all(np.abs(np.diff(drive["joint"], axis=0)) <= robot.velocity * dt * (1 + 1e-9))
    assert np.all(np.abs(np.diff(drive["joint"], 2, axis=0)) <= robot.acceleration * dt**2 * (1 + 1e-9))
    jerk = math.radians(outcome.metrics["parameters"]["smoothing"]["jerk_deg_s3"])
    assert np.abs(np.diff(drive["joint"], 3, axis=0)).max() <= jerk * dt**3 * (1 + 1e-6)
    assert np.nanmax(np.abs(drive["deviation_m"])) <= np.nanmax(led["deviation_m"]) + 1e-3
    asked = reference.poses[~reference.lost]
    assert numbers["drive"]["passed_fraction_of_time"] == passed_fraction(drive["_tool"], asked)
    assert numbers["drive"]["passed_fraction_of_time"] >= 0.99 * numbers["passed_fraction_of_time"]
    assert led["t_s"][-1] <= drive["t_s"][-1] + dt <= 1.1 * led["t_s"][-1]
    seconds = numbers["drive"]["seconds_by_cause"]
    assert sum(seconds.values()) == pytest.approx(len(drive["t_s"]) * dt)
    np.testing.assert_allclose(drive["manipulability"], [closed_form(q) for q in drive["joint"]], atol=1e-6)
    if name != "vr_hand":  # whose arm does not come to all that is asked
        when = drive["t_s"] - drive["lag_s"]
        begun = when > 0.05  # before, the reference is on its way from the hand
        clock = (reference.times - reference.times[0])[~reference.lost]
        places = np.column_stack([np.interp(when, clock, asked[:, i, 3]) for i in range(3)])
        apart = np.linalg.norm(drive["_tool"][:, :3, 3] - places, axis=1)
        np.testing.assert_allclose(apart[begun], drive["deviation_m"][begun], atol=1e-5)
        assert drive["pace"][begun].sum() * dt == pytest.approx(np.ptp(when[begun]), abs=0.05)
    few = system_named("mirror").brief(outcome)
    assert few is not None
    cells = list(few.columns[1 + LAWS.index(law)].cells)
    assert float(str(cells[0])) == pytest.approx(100 * numbers["drive"]["passed_fraction_of_time"], rel=5e-3)
    assert float(str(cells[2])) == pytest.approx(drive["t_s"][-1], rel=5e-3)


# ------------------------------------------------------------------------------------------- keeping to the reference


# ---------------------------------------------------------------------------------------------- the real hand


@pytest.mark.parametrize(("name", "whole"), [("pick_fruit", False), ("open_refrigerator", True)])
def test_check_says_how_much_is_in_reach_and_the_run_passes_that(
    name: str, whole: bool, ran: Callable[[str], Outcome]
) -> None:
    notes = checked(load_problem(f"mirror/{name}"))
    (reach,) = (note for note in notes if note.startswith("in reach, above the floor"))
    assert percent(reach) == pytest.approx(ran(name).metrics["laws"][PLAN]["passed_fraction_of_time"], abs=0.08)
    assert (percent(reach) == 1.0) is whole
    assert [note for note in notes if isinstance(note, NotMet)] == ([] if whole else [reach])


def percent(note: str) -> float:
    """The share that a note tells."""
    return float(note.partition(" %")[0].split()[-1]) / 100


# ----------------------------------------------------------------------------------------------------- lost sight
@pytest.fixture(scope="module")
def blinded(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    """Five seconds of the fruit; the tracker loses the hand for 0.4 s in mid-motion, and sees it elsewhere once."""
    folder = tmp_path_factory.mktemp("blinded")
    rows = ROWS[:451]
    for i in range(180, 216):
        rows[i] = rows[i].split(",")[0] + "," * 7
    for i in (330, 331):
        cells = rows[i].split(",")
        rows[i] = ",".join([cells[0], "1.5", *cells[2:]])
    given = content()
    del given["astar"]
    outcome = run_problem(recorded_as(folder, rows, given))
    return outcome


def recorded_as(folder: Path, rows: list[str], given: dict[str, Any] | None = None) -> ProblemFile[Any]:
    """The fruit's problem, or what is `given`, with these rows as its recording."""
    given = content() if given is None else given
    (folder / "hand.csv").write_text("\n".join(rows) + "\n")
    (folder / "calibration_points.csv").write_text((FOLDER / "calibration_points.csv").read_text())
    given["recording"]["file"] = "hand.csv"
    return problem_of(given, name="test", file="test.toml", path=folder / "test.toml")


def shortly(folder: Path, given: dict[str, Any]) -> Outcome:
    """A third of a second of the fruit, with what is `given` else."""
    del given["astar"]
    given["tracker"]["patience"] = 1
    outcome = run_problem(recorded_as(folder, ROWS[:40], given))
    return outcome


def test_a_recording_of_a_few_samples_is_checked_and_one_that_trembles_told_of(tmp_path: Path) -> None:
    header, *rows = ROWS

    def notes(rows: list[str]) -> tuple[str, ...]:
        return checked(recorded_as(tmp_path, [header, *rows]))

    assert not any("tremor" in note for note in (*notes(rows[:4]), *notes(rows[:450])))
    still = [",".join([*row.split(",")[:1], *rows[0].split(",")[1:4], *row.split(",")[4:]]) for row in rows[:100]]
    for given, said in ((still, True), (rows[:450], False)):
        assert ("the hand stays within 1 mm: it only turns, if at all" in notes(given)) is said
    noise, shaken = np.random.default_rng(2).normal(scale=2e-3, size=(450, 3)), []
    for row, by in zip(rows, noise, strict=False):
        cells = row.split(",")
        shaken.append(
            ",".join([cells[0], *(f"{float(x) + d:.6f}" for x, d in zip(cells[1:4], by, strict=True)), *cells[4:]])
        )
    assert any("tremor" in note for note in notes(shaken))


def test_a_start_inside_a_keep_out_is_told(tmp_path: Path) -> None:
    given = content()
    given["tracker"]["keep_out"][1]["point_m"] = [0.4, 0.0, 0.0]
    told = [note for note in shortly(tmp_path, given).notes if "keep_out" in note]
    assert len(told) == 1
    assert "mm inside tracker.keep_out.1, and moves no deeper" in told[0]


def test_lost_sight_is_held_told_and_gone_on_from(blinded: Outcome, tmp_path: Path) -> None:
    assert blinded.metrics["reference"]["gaps"] == 2  # the spike of two samples is left out
    assert blinded.metrics["reference"]["samples_dropped"] == 2
    assert any("36 of 450 samples hold no pose" in note for note in blinded.notes)
    assert any("sight lost 2 times" in note for note in blinded.notes)
    for law in (STEP, PLAN):
        led = blinded.traces[law,]
        assert led["_complete"]
        assert min(map(closed_form, ends(blinded, led))) >= FLOOR - 1e-6
        assert np.linalg.norm(np.diff(led["_tool"][:, :3, 3], axis=0), axis=1).max() <= SPEED / 200 * (1 + 1e-6)
    led = blinded.traces[STEP,]
    change = np.abs(np.diff(led["command"], axis=0)).max(axis=1)
    for over, what in zip(change > 15.0 / 200 + 1e-9, led["relaxed"][1:], strict=True):
        assert not over or "acceleration" in what
    lost = np.flatnonzero(np.isin(led["status"], ("braking", "holding")))
    assert len(lost) > 0.4 * 200
    assert change[lost[0] - 1 : lost[0] + 20].max() <= 15.0 / 200 + 1e-9  # in full motion, and far from where it began
    assert all("not a valid number" in led["_reason"][k] for k in lost)
    np.testing.assert_allclose(led["command"][lost[60]], 0.0, atol=1e-9)
    assert led["deviation_m"][-1] < 5e-4
    json.loads(metrics_json(blinded), parse_constant=pytest.fail)


def test_trace_has_empty_cells_where_nothing_is_seen(blinded: Outcome, tmp_path: Path) -> None:
    write_trace(blinded, tmp_path / "trace.csv")
    text = (tmp_path / "trace.csv").read_text()
    assert "nan" not in text
    rows = list(csv.DictReader(io.StringIO(text)))
    assert len(rows) == sum(len(led["t_s"]) for led in blinded.traces.values())
    empty = [row for row in rows if row["reference_x_m"] == ""]
    assert 0.4 * 200 < len(empty) < 0.6 * 200
    assert {row["law"] for row in empty} == {BEFORE}  # the clock of the others stands at the last pose seen
    assert all(row["deviation_m"] == "" and float(row["joint_elbow_rad"]) for row in empty)


def test_shipped_recordings_are_what_their_generator_writes(tmp_path: Path) -> None:
    script = runpy.run_path(str(FOLDER / "motions.py"))
    for task, file in (("pick_fruit", "pick_fruit.csv"), ("refrigerator_door", "refrigerator_door.csv")):
        fresh = np.loadtxt(io.StringIO(script["recorded"](script[task]())), delimiter=",", skiprows=1)
        np.testing.assert_allclose(fresh, np.loadtxt(FOLDER / file, delimiter=",", skiprows=1), atol=2e-6)
    wiping = script["wipe_table"]()
    turning = script["turning"](len(wiping))
    for fresh, file in (
        (script["recorded"](wiping, turning), "wipe_table.csv"),
        (script["tracked"](np.array(turning) @ script["HELMET"]), "wipe_table_helmet.csv"),
    ):
        written = np.loadtxt(io.StringIO(fresh), delimiter=",", skiprows=1)
        np.testing.assert_allclose(written, np.loadtxt(FOLDER / file, delimiter=",", skiprows=1), atol=2e-6)


# --------------------------------------------------------------------- the second situation, and a patient who moves


def tracked(written: Write, patient: Array | None, cut: Callable[[str], str] = str) -> Path:
    """A problem file's place beside the fruit's recording and a track of the patient's poses (N, 4, 4)."""
    path = written("pick_fruit.csv", "\n".join(ROWS))
    if patient is not None:
        written("helmet.csv", cut(motions.tracked(patient)))
    return path.with_name("test.toml")


def placed(path: Path, **patient: Any) -> Conditioned:
    """The fruit's reference where the recording's frame lies exactly and the filter hardly lags."""
    given = content()
    given["placement"] = {"origin_m": motions.VR_POSE[:3, 3].tolist(), "turn_deg": 180.0}
    given["conditioning"] = {"cutoff_hz": 1000.0}
    given["patient"] |= patient
    return laid_out(problem_of(given, name="test", file="test.toml", path=path)).reference


SAMPLES = len(ROWS) - 1


def test_a_patient_who_has_turned_mirrors_in_a_plane_turned_by_as_much(written: Write) -> None:
    angles = math.radians(30.0) * np.minimum(np.arange(SAMPLES) / 180.0, 1.0)
    turned = np.array([motions.around(np.eye(4), motions.HELMET[:3, 3], angle) for angle in angles])
    path = tracked(written, turned @ motions.HELMET)
    moving, still = placed(path, track_file="helmet.csv"), placed(path)
    rotated = placed(path, facing_deg=210.0, sagittal_point_m=motions.HELMET[:3, 3].tolist())
    settled = moving.times > 2.2
    np.testing.assert_allclose(moving.poses[settled], rotated.poses[settled], atol=1e-4)
    np.testing.assert_allclose(moving.twists[settled], rotated.twists[settled], atol=1e-2)
    np.testing.assert_allclose(moving.poses[0], still.poses[0], atol=1e-5)
    assert np.abs(moving.poses[settled] - still.poses[settled]).max() > 0.1


def test_a_patient_who_moves_with_the_hand_has_the_mirrored_hand_at_rest_beside_it(written: Write) -> None:
    path = tracked(written, None)
    moving, hand = placed(path, track_file="pick_fruit.csv"), motions.MIRROR.poses(placed(path).poses)
    beside = np.linalg.inv(hand) @ moving.poses
    np.testing.assert_allclose(beside, np.broadcast_to(beside[0], beside.shape), atol=1e-3)
    assert np.ptp(moving.poses[:, :3, 3], axis=0).max() > 0.2


def without_a_pose(text: str, cell: str) -> str:
    """A track whose fifth sample has this cell for a place."""
    lines = text.splitlines()
    cells = lines[5].split(",")
    lines[5] = ",".join([*cells[:3], cell, *cells[4:]])
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("cut", "expected"),
    [
        (lambda text: text.rsplit("\n", 2)[0], r"helmet.csv: samples = 1139: expected 1140, as many as in pick_fruit"),
        (lambda text: text.replace("0.022222,", "0.032222,"), r"helmet.csv: sample 3, t_s = 0.032222: .*0.022222 s"),
        (lambda text: without_a_pose(text, ""), r"sample 5 = .*no pose.*: expected a pose of the patient"),
        (lambda text: without_a_pose(text, "nan"), r"sample 5 = .*no pose.*: expected a pose of the patient"),
    ],
    ids=["shorter", "other_stamps", "empty", "nan"],
)
def test_a_track_that_does_not_fit_the_recording_is_refused(
    written: Write, cut: Callable[[str], str], expected: str
) -> None:
    path = tracked(written, np.tile(motions.HELMET, (SAMPLES, 1, 1)), cut)
    with pytest.raises(ProblemFileError, match=expected):
        placed(path, track_file="helmet.csv")


def test_a_patient_who_moves_has_no_arm_with_a_fixed_shoulder() -> None:
    given = content("vr_hand")
    given["patient"]["track_file"] = "helmet.csv"
    with pytest.raises(ProblemFileError, match=r"patient.track_file = .*no such key beside patient.arm"):
        problem_of(given, name="test", file="test.toml", path=FOLDER / "test.toml")


def spoilt(section: str, change: dict[str, Any]) -> None:
    given = content()
    given.setdefault(section, {}).update(change)
    checked(problem_of(given, name="test", file="test.toml", path=FOLDER / "test.toml"))


def test_fault_is_refused_with_its_key() -> None:
    refuses(
        spoilt,
        (("recording", {"file": "absent.csv"}), "recording.file", "a recording beside"),
        (("recording", {"back": "+z"}), "recording.back", "an axis across fingers"),
        (("recording", {"rows": [1, 10_000]}), "recording.rows", "rows from 1 to"),
        (("recording", {"rows": [9, 3]}), "recording.rows", "at least three rows"),
        (("recording", {"position_columns": [1, 2, 3]}), "recording.quaternion_columns", "both"),
        (("recording", NUMBERED), "recording.rate_hz", "no time"),
        (("placement", {"origin_m": [0.0, 0.0, 0.0]}), "placement.origin_m", "no such key beside calibration_file"),
        (("placement", {"calibration_file": "absent.csv"}), "placement.calibration_file", "a recording beside"),
        (("patient", {"track_file": "absent.csv"}), "patient.track_file", "a recording beside"),
        (("robot", {"start_deg": [0.0, 0.0]}), "robot.start_deg", "6"),
        (("tracker", {"floor": 1.0}), "tracker.floor", "less than 1"),
        (("tracker", {"floor": math.nan}), "tracker.floor"),
        (("tracker", {"keep_out": [FLAT]}), "tracker.keep_out.0.normal", "a direction"),
        (("astar", {"resolution_mm": -1.0}), "astar.resolution_mm", "greater than"),
        error=ProblemFileError,
    )


NUMBERED = {"position_columns": [1, 2, 3], "quaternion_columns": [4, 5, 6, 7]}
FLAT = {"point_m": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 0.0]}


@pytest.mark.parametrize("rows", [None, [11, 650]])
def test_a_clock_that_went_back_is_told_with_its_row(tmp_path: Path, rows: list[int] | None) -> None:
    """Behind row 600 of a recording its first 100 rows follow again, and then what goes on: 100 advance nowhere."""
    given = content()
    header, *lines = ROWS
    given["recording"] |= {} if rows is None else {"rows": rows}
    scene = laid_out(recorded_as(tmp_path, [header, *lines[:600], *lines[:100], *lines[600:]], given))
    told = [note for note in scene.notes if "left out" in note]
    first, last = (float(lines[k].split(",")[0]) for k in (0, 599))
    count = 100 if rows is None else 50
    assert told == [
        f"samples left out: {count} whose stamps are not after all before them, the first in row 601: "
        f"{first:.9g} s after {last:.9g} s (did the clock begin anew?)"
    ]


HEADER = "t_s,x_m,y_m,z_m,qx,qy,qz,qw"
TOO_LONG = [f"{t},0.3,0.8,0.6,0,0,0,1" for t in (0, 1, 2, 900_000)]


def test_fault_of_a_recording_is_refused_with_its_place(tmp_path: Path) -> None:
    refuses(
        lambda *rows: checked(recorded_as(tmp_path, [*rows])),
        (("t_s,x_m,y_m", "0,0,0"), "hand.csv: line 1, column z_m", "once"),
        ((HEADER, "0,0,0,0,0,0,0,1"), "hand.csv: rows", "at least 3"),
        ((HEADER, "0,0,0,0,0,0,0,1", "1,0,0,0"), "line 3", "8, as in the header"),
        ((HEADER, *["0,zero,0,0,0,0,0,1"] * 3), "line 2, column x_m", "a finite number"),
        ((HEADER, *["0,900,0,0,0,0,0,1"] * 3), "sample 1", "another unit"),
        ((HEADER, *["0,,,,,,,"] * 5), "samples", "valid"),
        ((HEADER, *["1,0.3,0.8,0.6,0,0,0,1"] * 5), "times", "valid"),
        ((HEADER, *TOO_LONG), "tracker.rate_hz", "2000000 ticks"),
        error=ProblemFileError,
    )


def test_a_hand_that_a_bound_holds_off_is_not_late() -> None:
    """Within the largest deviation nothing is told to be short: pick_fruit, 18 mm off at its floor, was `late`."""
    ticks, plane = 6, object()
    led: dict[str, Any] = {
        "_short": np.zeros((ticks, 2)), "_person": np.zeros((ticks, 2)), "turn_rad": np.zeros(ticks),
        "pace": np.ones(ticks), "deviation_m": np.array([0.0, 0.018, 0.018, 0.018, 0.018, 0.018]),
        "status": ("ok",) * 5 + ("braking",), "manipulability": np.array([0.3, 0.31, 0.6, 0.6, 0.1, 0.3]),
        "joint": np.array([1.0, 1.0, 1.0, 0.0, 1.0, 0.0]), "t_s": 0.01 * np.arange(ticks),
    }  # fmt: skip
    led["_person"][0] = 0.02, 0.0
    bounds: Any = SimpleNamespace(planes=[plane], min_heights=lambda q, _: q, floor=0.3)
    drive = {"law_t_s": led["t_s"], "pace": led["pace"]}
    said = [CAUSES[k] for k in causes(Trace(led), Trace(drive), bounds)]
    assert said == ["person's arm", "floor", "late", "keep-out", "late", "stopped"]
