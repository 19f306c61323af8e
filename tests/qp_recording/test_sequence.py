"""Claims about sequences of QPs: written to the last bit, read with nothing taken on trust."""

import contextlib
import dataclasses
import io
import json
import math
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.qp_recording import array_file
from bench.qp_recording.sequence import ARRAYS, QPSequence, read_sequence, sequence_of, write_sequence
from rehab_opt import ConfigurationError, ProblemFileError
from rehab_opt.optim.rows import Instance
from tests.refusals import refuses


def small(ticks: int = 3, **changes: Any) -> QPSequence:
    """Two variables, one row; the gradient moves."""
    instances = [
        Instance(
            np.eye(2), np.array([float(k), 1.0]), np.ones((1, 2)), np.array([-1.0]), np.array([np.inf]),
            np.full(2, -np.inf), np.full(2, 2.0),
        )
        for k in range(ticks)
    ]  # fmt: skip
    made = sequence_of("some/small", instances, dt=0.01, tolerance=1e-8, command="make", about="Small.")
    return dataclasses.replace(made, **changes)


# --------------------------------------------------------------------------------------------------------- round trip
def test_what_is_written_is_read_to_the_last_bit_and_nobody_changes_it(tmp_path: Path) -> None:
    odd = np.array([[-0.0, 5e-324], [1.7e308, 0.1], [np.pi, -1e-310]])
    rows = {"rows": odd[:, None], "rows_lower": -abs(odd[:, :1]), "rows_upper": np.array([[np.inf]])}
    marks = (("nan",), (), ("nan", "infeasible"))
    for sequence in (
        small(),
        small(gradient=odd, marks=marks, dt=math.nan, about='"ä\n\u2028', command="", **rows),
        small(hessian=np.eye(2) * abs(odd[:, :1, None]), lower=np.full((3, 2), -np.inf), marks=(("degenerate",),)),
    ):
        write_sequence(tmp_path / "trip.npz", sequence)
        read = read_sequence(tmp_path / "trip.npz")
        for key in ARRAYS:
            before, after = getattr(sequence, key), getattr(read, key)
            assert (after.shape, after.tobytes()) == (before.shape, before.tobytes())
        for key in ("name", "tolerance", "marks", "command", "about"):
            assert getattr(read, key) == getattr(sequence, key)
        assert (dict(read.versions), len(read)) == (dict(sequence.versions), len(sequence))
        np.testing.assert_equal(read.dt, sequence.dt)
        with pytest.raises(ValueError, match="read-only"):
            read[0].g[0] = 7.0


def test_the_same_sequence_makes_the_same_bytes(tmp_path: Path) -> None:
    write_sequence(tmp_path / "a.npz", small())
    write_sequence(tmp_path / "b.npz", small())
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_what_does_not_change_in_time_is_kept_once_and_stands_in_every_tick() -> None:
    sequence = small(5)
    assert len(sequence.hessian) == len(sequence.rows) == 1
    assert len(sequence.gradient) == len(sequence) == 5
    np.testing.assert_array_equal(sequence[4].H, np.eye(2))
    assert [qp.g[0] for qp in sequence] == [0.0, 1.0, 2.0, 3.0, 4.0]
    np.testing.assert_array_equal(sequence[-1].g, sequence[4].g)
    with pytest.raises(IndexError):
        sequence[5]


def test_qpsolvers_gets_the_same_problem() -> None:
    problem = small().problem(2)
    np.testing.assert_array_equal(problem.q, [2.0, 1.0])
    np.testing.assert_array_equal(problem.G, [[-1.0, -1.0]])  # -1 <= x + y, the other side is open
    np.testing.assert_array_equal(problem.h, [1.0])
    np.testing.assert_array_equal(problem.ub, [2.0, 2.0])


# ------------------------------------------------------------------------------------------------------- constructor
def test_what_cannot_be_a_sequence_is_refused_by_name() -> None:
    wrong = [
        ("name", "no_family"), ("name", "/"), ("dt", 0.0), ("dt", -1.0), ("dt", math.inf), ("tolerance", 0.0),
        ("tolerance", math.nan), ("marks", (("odd",),)), ("marks", ((), ())), ("rows_lower", np.full((1, 1), np.nan)),
        ("hessian", np.ones((1, 2, 3))), ("hessian", np.full((1, 2, 2), np.inf)),
    ]  # fmt: skip
    refuses(small, *(({name: value}, f"{name} = ") for name, value in wrong))
    for name, value in (("gradient", np.ones((2, 3))), ("rows", np.ones((1, 1, 3))), ("lower", np.ones(2))):
        refuses(small, ({name: value}, " = "))  # of arrays that do not fit each other either is named
    one = small()[0]
    other = one._replace(A=np.ones((2, 2)), rows_lower=np.zeros(2), rows_upper=np.ones(2))
    rest = {"dt": 0.01, "tolerance": 1e-8, "command": "", "about": ""}
    refuses(sequence_of, *(({"name": "a/b", "instances": each} | rest, "instances") for each in ([], [one, other])))


def test_nan_may_stand_where_the_tick_is_marked_and_nowhere_else() -> None:
    gradient = np.ones((3, 2))
    gradient[1, 0] = math.nan
    small(gradient=gradient, marks=((), ("nan",), ()))
    with pytest.raises(ConfigurationError, match="gradient"):
        small(gradient=gradient, marks=((), (), ("nan",)))
    with pytest.raises(ConfigurationError, match="hessian"):  # it stands in all ticks
        small(hessian=np.full((1, 2, 2), math.nan), marks=((), ("nan",), ()))


# ------------------------------------------------------------------------------------------------------ hostile files
def content(**changes: Any) -> dict[str, Any]:
    """The members of a good file, with changes; None leaves one out."""
    sequence = small()
    meta: dict[str, Any] = {
        "format": "rehab_opt qp sequence 1", "name": "some/small", "dt": 0.01, "tolerance": 1e-8, "marks": [[]],
        "command": "", "about": "", "versions": {},
    }  # fmt: skip
    meta |= changes.pop("meta", {})
    members: dict[str, Any] = {key: getattr(sequence, key) for key in ARRAYS}
    members["meta"] = np.array(json.dumps({key: value for key, value in meta.items() if value != "left out"}))
    return {key: value for key, value in (members | changes).items() if value is not None}


def written(path: Path, members: dict[str, Any]) -> Path:
    np.savez_compressed(path, allow_pickle=True, **members)
    return path


@pytest.mark.parametrize(
    ("key", "changes"),
    [
        ("hessian", {"hessian": None}),
        ("hessian", {"hessian": np.ones((1, 2, 2), dtype=np.float32)}),
        ("hessian", {"hessian": np.full((1, 2, 2), np.nan)}),
        ("lower", {"lower": np.ones((1, 3))}),
        ("upper", {"upper": np.ones((2, 2))}),
        ("gradient", {"gradient": np.zeros((0, 2)), "hessian": np.zeros((1, 2, 2))}),
        ("surplus", {"surplus": np.ones(3)}),
        ("meta.format", {"meta": {"format": "something else"}}),
        ("meta.name", {"meta": {"name": "without_family"}}),
        ("meta.dt", {"meta": {"dt": 1e999}}),
        ("meta.dt", {"meta": {"dt": -1.0}}),
        ("meta.tolerance", {"meta": {"tolerance": math.nan}}),
        ("meta.marks", {"meta": {"marks": ["nan"]}}),
        ("meta.marks", {"meta": {"marks": [[], []]}}),
        ("meta.versions", {"meta": {"versions": []}}),
        ("meta", {"meta_text": "no json"}),
        ("meta", {"meta_text": "[" * 100_000}),
    ],
)
def test_a_file_that_is_no_sequence_is_refused_by_its_key(tmp_path: Path, key: str, changes: dict[str, Any]) -> None:
    text = changes.pop("meta_text", None)
    members = content(**changes) | ({} if text is None else {"meta": np.array(text)})
    path = written(tmp_path / "bad.npz", members)
    refuses(read_sequence, ((path,), f"{path}: {key}"), error=ProblemFileError)


@pytest.mark.parametrize("bad", ["absent", "folder", "text", "empty", "cut", "flipped"])
def test_a_file_that_is_no_archive_is_refused(tmp_path: Path, bad: str) -> None:
    path = tmp_path / "bad.npz"
    good = written(tmp_path / "good.npz", content()).read_bytes()
    if bad == "folder":
        path.mkdir()
    elif bad != "absent":
        flipped = bytearray(good)
        with zipfile.ZipFile(tmp_path / "good.npz") as archive:
            last = max(archive.infolist(), key=lambda member: member.header_offset)
        flipped[archive.start_dir - last.compress_size // 2] ^= 0xFF  # in the middle of its data
        path.write_bytes(
            {"text": b"no zip", "empty": b"", "cut": good[: len(good) // 2], "flipped": bytes(flipped)}[bad]
        )
    with pytest.raises(ProblemFileError):
        read_sequence(path)


@given(data=st.data())
@settings(max_examples=150, deadline=None)
def test_a_damaged_file_is_read_as_a_sequence_or_refused_and_nothing_else(
    data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("damaged") / "file.npz"
    damaged = bytearray(written(path, content()).read_bytes())
    for at, value in data.draw(st.lists(st.tuples(st.integers(0, len(damaged) - 1), st.integers(0, 255)), max_size=5)):
        damaged[at] = value
    path.write_bytes(bytes(damaged))
    with contextlib.suppress(ProblemFileError):
        read_sequence(path)


def test_an_array_that_claims_more_than_there_is_takes_no_memory(tmp_path: Path) -> None:
    claim = io.BytesIO()
    np.lib.format.write_array_header_1_0(claim, {"descr": "<f8", "fortran_order": False, "shape": (10**12, 8, 8)})
    path = written(tmp_path / "claim.npz", content(hessian=None))
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("hessian.npy", claim.getvalue())
    with pytest.raises(ProblemFileError) as refused:
        read_sequence(path)
    assert refused.value.key == "hessian"


def test_a_small_file_that_unpacks_to_more_than_is_sane_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(array_file, "MAX_BYTES", 100_000)
    path = written(tmp_path / "bomb.npz", content(gradient=np.zeros((100_000, 2))))
    assert path.stat().st_size < 10_000
    with pytest.raises(ProblemFileError, match="unpacked"):
        read_sequence(path)


def test_no_pickle_is_opened(tmp_path: Path) -> None:
    """What a pickle would do stands in its bytes: here, to make a file."""

    class Trap:
        def __reduce__(self) -> tuple[Any, ...]:
            return Path.touch, (tmp_path / "sprung",)

    path = written(tmp_path / "trap.npz", content(hessian=np.array([Trap()], dtype=object)))
    with pytest.raises(ProblemFileError):
        read_sequence(path)
    assert not (tmp_path / "sprung").exists()


# ------------------------------------------------------------------------------------------------------ what H must be
def test_a_cost_that_solvers_would_read_differently_or_that_is_not_convex_is_refused(tmp_path: Path) -> None:
    write_sequence(tmp_path / "a.npz", small())
    meta, arrays = array_file.read_arrays(tmp_path / "a.npz")
    for hessian, named in (
        ([[1.0, 0.5], [0.0, 1.0]], "not symmetric in tick 1"),
        ([[1.0, 2.0], [2.0, 1.0]], "not positive semidefinite in tick 1"),
        ([[-1.0, 0.0], [0.0, -1.0]], "not positive semidefinite in tick 1"),
    ):
        whole = np.stack([np.eye(2), np.array(hessian), np.eye(2)])
        refuses(small, ({"hessian": whole}, f"hessian = '{named}'"))
        array_file.write_arrays(tmp_path / "a.npz", meta, {**arrays, "hessian": whole})
        refuses(read_sequence, ((tmp_path / "a.npz",), named), error=ProblemFileError)
