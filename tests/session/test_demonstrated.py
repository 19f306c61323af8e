"""Fields that a problem file has learnt from a therapist's demonstrations."""

from __future__ import annotations

import csv
import runpy
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rehab_opt.errors import ProblemFileError
from rehab_opt.recordings.reading import read_recording, resampled
from rehab_opt.session.files import load_problem, problem_of, shipped_folder
from rehab_opt.session.run import checked, run_problem
from rehab_opt.session.scenario.demonstrated import learnt
from tests.refusals import refuses

SHIPPED = shipped_folder() / "upper_limb"
NAME = "scenario_2_learnt"
Write = Callable[[str, str | bytes], Path]


def content() -> dict[str, Any]:
    return tomllib.loads((SHIPPED / f"{NAME}.toml").read_text(encoding="utf-8"))


def config(change: dict[str, dict[str, Any]], path: Path = SHIPPED / f"{NAME}.toml", mode: str = "assist") -> Any:
    whole = content() | {"mode": mode}
    for section, keys in change.items():
        whole[section] = {**whole.get(section, {}), **keys}
    return problem_of(whole, name=NAME, file=f"{NAME}.toml", path=path)


def test_what_is_learnt_is_what_the_therapist_did() -> None:
    """Near enough: the therapist pulls to the nearest point, a field to all that are near; and the mean path sways."""
    lead = runpy.run_path(str(SHIPPED / "demonstrations" / "lead.py"))
    corners = np.array(lead["CORNERS"])
    length = float(np.linalg.norm(np.diff(corners, axis=0), axis=1).sum())
    led = learnt(load_problem(f"upper_limb/{NAME}"), None)
    assert led is not None
    assert led.field.fit is not None
    known = learnt(load_problem(f"upper_limb/{NAME}"), corners)
    assert known is not None
    assert known.field.fit is not None
    assert any("by which sigma was chosen" in note for note in led.notes)
    for fit in (led.field.fit, known.field.fit):
        assert fit.parameters["stiffness"] == pytest.approx(lead["STIFFNESS"], rel=0.2)
        assert fit.parameters["drag"] == pytest.approx(lead["PULL"] / (2 * length), rel=0.2)
        assert fit.held_out == (4,)
    assert known.field.fit.held_out_error < led.field.fit.held_out_error


def test_keys_that_contradict_each_other_are_refused() -> None:
    points = {"demonstrations": None, "points_m": [[-0.2, 0.5], [-0.25, 0.5]]}
    refuses(
        config,
        (({"field": {"stiffness_N_m": 1000.0}},), "field.stiffness_N_m"),
        (({"field": {"drag_N_m": 0.0}},), "field.drag_N_m"),
        (({"field": {"width_mm": 20.0}},), "field.width_mm"),
        (({"field": {"widths_mm": None}},), "field.widths_mm"),
        (({"field": {"widths_mm": [20.0, 20.0]}},), "field.widths_mm"),
        (({"task": {"demonstrations": {"files": ["a.csv", "a.csv"]}}},), "task.demonstrations.files"),
        (({"task": {"demonstrations": None}},), "task.points_m"),
        (({"task": points},), "field.stiffness_N_m"),
        (({}, SHIPPED / "resist.toml", "resist"), "task.demonstrations", "assist"),
        error=ProblemFileError,
    )


HEADER = "t_s,x_m,y_m,fx_N,fy_N\n"
LINE = [(0.02 * k, -0.16 - 0.0009 * k, 0.5, -5.0, 0.01 * (k % 3)) for k in range(100)]


def table(rows: list[tuple[float, ...]], header: str = HEADER) -> str:
    return header + "".join(",".join(f"{value:.6g}" for value in row) + "\n" for row in rows)


def test_a_recording_that_teaches_nothing_is_named(written: Write) -> None:
    def read(text: str) -> None:
        file = written("lead.csv", text)
        checked(config({"task": {"demonstrations": {"files": ["lead.csv"]}}}, file.parent / "problem.toml"))

    refuses(
        read,
        ((table([row[:3] for row in LINE], "t_s,x_m,y_m\n"),), "no forces"),
        ((table([row[:4] for row in LINE], "t_s,x_m,y_m,fx_N\n"),), "fx_N and fy_N together"),
        ((table(LINE).replace("-5,", "1e9,"),), "1e"),
        ((table(LINE[:2]),), "at least three"),
        ((table([(t, x, y, -fx, fy) for t, x, y, fx, fy in LINE]),), "hold no hand on a path"),
        error=ProblemFileError,
    )


def lead_files(folder: Path, count: int, change: Callable[[int, np.ndarray], np.ndarray]) -> Any:
    """The shipped movements, each changed, as a problem of their own."""
    names = [f"lead_{number}.csv" for number in range(1, count + 1)]
    for i, name in enumerate(names):
        rows = np.loadtxt(SHIPPED / "demonstrations" / name, delimiter=",", skiprows=1)
        (folder / name).write_text(table([tuple(row) for row in change(i, rows)]), encoding="utf-8")
    return config({"task": {"demonstrations": {"files": names}}}, folder / "problem.toml")


def test_forces_of_the_other_sign_or_with_a_large_offset_teach_no_stiffness_not_even_a_rounding_one(
    tmp_path: Path,
) -> None:
    for factor, offset in ((-1.0, 0.0), (1.0, 12.0)):
        turned = lead_files(tmp_path, 5, lambda _, rows, f=factor, o=offset: rows * (1, 1, 1, f, f) + (0, 0, 0, o, -o))  # type: ignore[misc]
        with pytest.raises(ProblemFileError, match=r"task\.demonstrations.*hold no hand"):
            learnt(turned, None)


def test_a_third_coordinate_that_is_left_out_is_said(tmp_path: Path) -> None:
    """Hands that rose by 0.3 m, under 40 N along it, taught a field of the plane without a word."""
    problem = lead_files(tmp_path, 5, lambda _, rows: rows)
    for file in tmp_path.glob("lead_*.csv"):
        t, x, y, fx, fy = np.loadtxt(file, delimiter=",", skiprows=1).T
        rows = np.column_stack((t, x, y, 0.3 * t / t[-1], fx, fy, np.full_like(t, -40.0)))
        file.write_text(table([tuple(row) for row in rows], "t_s,x_m,y_m,z_m,fx_N,fy_N,fz_N\n"), encoding="utf-8")
    found = learnt(problem, None)
    assert found is not None
    said = "projected onto the plane (300 mm of height, up to 40 N along it left out)"
    assert [note for note in found.notes if "projected" in note] == [f"lead_{i}.csv: {said}" for i in range(1, 6)]


@pytest.mark.parametrize("turned", [0, 2])
def test_a_movement_the_other_way_is_refused_by_its_file(tmp_path: Path, turned: int) -> None:
    def backwards(i: int, rows: np.ndarray) -> np.ndarray:
        return np.column_stack((rows[:, 0], rows[::-1, 1:])) if i == turned else rows

    with pytest.raises(ProblemFileError, match=r"lead_\d\.csv: a movement against lead_1\.csv") as refused:
        learnt(lead_files(tmp_path, 5, backwards), None)
    assert refused.value.key == "task.demonstrations.files"


@pytest.mark.parametrize(
    ("path", "said"),
    [([[-0.25, 0.493], [-0.16, 0.505]], "against the path"), ([[-0.16, 0.42], [-0.25, 0.42]], "mostly 7")],
)
def test_a_path_that_is_not_the_one_that_was_shown_is_refused(path: list[list[float]], said: str) -> None:
    with pytest.raises(ProblemFileError, match=said):
        learnt(config({}), np.array(path))


def test_a_slip_of_a_unit_is_refused(tmp_path: Path) -> None:
    refuses(
        lambda *scales: learnt(lead_files(tmp_path, 1, lambda _, rows: rows * scales), None),
        ((1, 1, 1, 1e2, 1e2), "largest force of ", "another unit"),
        ((1, 1, 1, 1e-3, 1e-3), "largest force of ", "another unit"),
        ((1e-3, 1, 1, 1, 1), "m/s", "another unit"),
        ((1e3, 1, 1, 1, 1), "m/s", "another unit"),
        error=ProblemFileError,
    )


def test_a_check_says_what_the_run_does_of_a_hand_that_swings() -> None:
    slow = config({"assistance": {"slew_limit_N_s": 20.0}, "task": {"trials": 1}, "run": {"rate_hz": 200.0}})
    swings = [note for note in checked(slow) if "assistance.slew_limit_N_s" in note]
    assert swings
    assert set(swings) <= set(run_problem(slow).notes)


@pytest.mark.parametrize("judge", [checked, run_problem])
def test_a_path_that_no_arm_reaches_is_refused_by_its_demonstrations(written: Write, judge: Callable[..., Any]) -> None:
    away = [(t, x + 0.6, y, fx, fy) for t, x, y, fx, fy in shipped_rows()]
    file = written("lead.csv", table(away))
    with pytest.raises(ProblemFileError) as refused:
        judge(config({"task": {"demonstrations": {"files": ["lead.csv"]}}}, file.parent / "problem.toml"))
    assert refused.value.key == "task.demonstrations"


def shipped_rows() -> list[tuple[float, ...]]:
    with (SHIPPED / "demonstrations" / "lead_1.csv").open(encoding="utf-8", newline="") as file:
        return [tuple(map(float, row)) for row in list(csv.reader(file))[1:]]


def test_forces_of_a_recording_are_resampled_with_its_places(written: Write) -> None:
    rows = [(0.1 * k, 0.01 * k, 0.0, 2.0 * k, -k) for k in range(5)]
    fine = resampled(read_recording(written("lead.csv", table(rows))), 20.0)
    np.testing.assert_allclose(fine.forces, np.column_stack([20 * fine.time, -10 * fine.time]), atol=1e-12)
    assert read_recording(written("plain.csv", "t_s,x_m,y_m\n0,0,0\n1,1,1\n")).forces.shape == (2, 0)
