"""Many people at once: nobody's failure is anybody else's, and nothing is computed twice."""

from __future__ import annotations

import csv
import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from rehab_opt.errors import ConfigurationError, ProblemFileError
from rehab_opt.session.many.participant import Participant
from rehab_opt.session.many.results import ResultRow
from rehab_opt.session.many.run import GROUPS, PARQUET, RESULTS, run_many
from tests.session.stand_in_work import person, quick

ROOT = str(Path(__file__).resolve().parents[2])


def done(people: Sequence[Participant], out: Path, *, executor: Executor | None = None) -> dict[str, ResultRow]:
    rows = run_many(people, out=out, executor=executor, workers=2, work=quick)
    assert [row.participant for row in rows] == [each.name for each in people]
    with (out / RESULTS).open(encoding="utf-8", newline="") as file:
        written = list(csv.DictReader(file))
    assert [(row["participant"], row["status"], row["error"]) for row in written] == [
        (row.participant, row.status, row.error) for row in rows
    ]
    return {row.participant: row for row in rows}


def test_five_of_forty_fail_each_in_their_own_row(tmp_path: Path) -> None:
    people = [person(f"P{i:03}") for i in range(40)]
    broken = {17: "killed", 18: "broken", 25: "odd", 30: "refused", 39: "killed"}
    for i, what in broken.items():
        people[i] = person(people[i].name, what)
    told: list[tuple[int, int]] = []
    rows = run_many(people, out=tmp_path, workers=2, work=quick, progress=lambda _, k, n: told.append((k, n)))
    failed = {i: row for i, row in enumerate(rows) if row.status != "done"}
    assert failed.keys() == broken.keys()
    assert [failed[i].status for i in sorted(failed)] == ["failed", "failed", "failed", "refused", "failed"]
    assert "its worker process died" in failed[17].error
    assert "its worker process died" in failed[39].error
    assert failed[18].error == "ZeroDivisionError: a mistake in two lines"
    assert failed[30].error == "hand = 3: expected one of two"
    assert told[-1] == (40, 40)
    assert (tmp_path / "P032" / "metrics.json").read_text(encoding="utf-8") == "P032"
    assert not (tmp_path / "P017").exists()


def test_one_that_hangs_is_killed_and_blocks_nobody(tmp_path: Path) -> None:
    people = [person("A", "slow"), person("B"), person("C", "slow"), person("D")]
    rows = run_many(people, out=tmp_path, workers=2, work=quick, timeout_s=3.0)
    assert [row.status for row in rows] == ["failed", "done", "failed", "done"]
    assert rows[0].error == rows[2].error == "TimeoutError: not done after 3 s"
    assert not (tmp_path / "A").exists()
    for bad in (0.0, math.nan, math.inf):
        with pytest.raises(ConfigurationError, match="--timeout"):
            run_many(people, out=tmp_path, work=quick, timeout_s=bad)


THREADS = """
from rehab_opt.session.many.pools import answers
from tests.session.stand_in_work import blas_threads
if __name__ == "__main__":
    print([*answers([0], blas_threads, executor=None, workers=1)], blas_threads(0))
"""


@pytest.mark.parametrize("own", [None, "2"])
def test_a_worker_computes_in_one_thread_unless_the_user_says_more(tmp_path: Path, own: str | None) -> None:
    (tmp_path / "threads.py").write_text(f"import sys\nsys.path.insert(0, {ROOT!r})\n{THREADS}", encoding="utf-8")
    others = {key: value for key, value in os.environ.items() if key != "OPENBLAS_NUM_THREADS"}
    given = {} if own is None else {"OPENBLAS_NUM_THREADS": own}
    command = [sys.executable, str(tmp_path / "threads.py")]
    done = subprocess.run(command, env=others | given, check=True, capture_output=True, text=True)
    assert done.stdout == f"[(0, {own or '1'!r})] {own}\n"


def test_rows_are_written_as_they_end_and_told_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [0.0]
    monkeypatch.setattr("rehab_opt.session.many.run.time", SimpleNamespace(monotonic=lambda: clock[0]))
    people = [person(f"P{i}") for i in range(4)]
    seen: list[tuple[str, list[str]]] = []

    def record(who: Participant, row: ResultRow, folder: Path, digest: str) -> None:
        table = tmp_path / RESULTS
        text = table.read_text(encoding="utf-8").splitlines() if table.exists() else []
        seen.append((who.name, [each["status"] for each in csv.DictReader(text)]))
        assert (folder / "metrics.json").exists()
        assert (row.participant, len(digest)) == (who.name, 64)
        clock[0] += 1.1

    with ThreadPoolExecutor(1) as pool:
        run_many(people, out=tmp_path, executor=pool, work=quick, record=record)
        assert sorted(name for name, _ in seen) == ["P0", "P1", "P2", "P3"]
        assert sorted(seen[3][1]) == ["done", "done", "done", "not run"]
        run_many(people[:1], out=tmp_path, executor=pool, work=quick, record=record)
    assert seen[4][0] == "P0"  # kept, and told all the same


def test_results_have_inputs_and_groups_their_statistics(tmp_path: Path) -> None:
    people = [
        replace(
            person("A" * length),
            inputs={"arm.side": "left", "title": f"={length}", "x": "-1"},
            covariates={"group": group},
        )
        for group, length in (("g", 1), ("g", 3), ("h", 7))
    ]
    people.append(replace(person("broken one", "broken"), covariates={"group": "h"}))
    with ThreadPoolExecutor(1) as pool:
        run_many(people, out=tmp_path, executor=pool, work=quick)
    with (tmp_path / RESULTS).open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["group"], row["input.arm.side"], row["letters"]) for row in rows] == [
        ("g", "left", "1"), ("g", "left", "3"), ("h", "left", "7"), ("h", "", ""),
    ]  # fmt: skip
    assert [(row["input.title"], row["input.x"]) for row in rows[:2]] == [("'=1", "-1"), ("'=3", "-1")]  # no formula
    typed = pytest.importorskip("pyarrow.parquet").read_table(tmp_path / PARQUET).to_pydict()
    assert typed["letters"] == [1.0, 3.0, 7.0, None]
    assert typed["input.title"] == ["=1", "=3", "=7", None]  # no spreadsheet opens it
    assert {key: typed[key] for key in ("group", "status")} == {
        key: [row[key] for row in rows] for key in ("group", "status")
    }
    with (tmp_path / GROUPS).open(encoding="utf-8", newline="") as file:
        groups = {row["group"]: row for row in csv.DictReader(file) if row["measure"] == "letters"}
    assert {key: groups["g"][key] for key in ("people", "mean", "min", "median", "max")} == {
        "people": "2", "mean": "2", "min": "1", "median": "2", "max": "3",
    }  # fmt: skip
    assert float(groups["g"]["sd"]) == pytest.approx(math.sqrt(2))
    assert (groups["h"]["people"], groups["h"]["sd"]) == ("1", "")


def test_what_is_done_is_not_done_again_and_what_failed_is(tmp_path: Path) -> None:
    log = tmp_path / "log"
    people = [person("A", f"fine {log}"), person("B", f"broken {log}"), person("C", f"fine {log}")]
    with ThreadPoolExecutor(1) as pool:
        first = done(people, tmp_path / "out", executor=pool)
        before = (tmp_path / "out" / RESULTS).read_bytes()
        second = done(people, tmp_path / "out", executor=pool)
        assert log.read_text(encoding="utf-8").split() == ["A", "B", "C", "B"]
        assert (first["A"].kept, second["A"].kept, second["B"].kept) == (False, True, False)
        assert (tmp_path / "out" / RESULTS).read_bytes() == before
        people[0] = replace(people[0], content={**people[0].content, "arm": {"side": "right"}})
        assert not done(people, tmp_path / "out", executor=pool)["A"].kept


def test_result_half_written_or_half_deleted_does_not_count(tmp_path: Path) -> None:
    with ThreadPoolExecutor(1) as pool:
        done([person("A"), person("B"), person("C")], tmp_path, executor=pool)
        (tmp_path / "A" / "result.json").write_text('{"digest": ', encoding="utf-8")
        (tmp_path / "B" / "metrics.json").unlink()
        rows = done([person("A"), person("B"), person("C")], tmp_path, executor=pool)
    assert {name: row.kept for name, row in rows.items()} == {"A": False, "B": False, "C": True}
    assert all(row.status == "done" for row in rows.values())


def test_failure_leaves_no_result_of_earlier_inputs_and_nothing_of_others_is_touched(tmp_path: Path) -> None:
    with ThreadPoolExecutor(1) as pool:
        done([person("A"), person("B")], tmp_path, executor=pool)
        (tmp_path / "A" / "notes.txt").write_text("mine", encoding="utf-8")
        rows = done([person("A", "broken"), replace(person("B"), error="unreadable")], tmp_path, executor=pool)
    assert (rows["A"].status, rows["B"].status, rows["B"].error) == ("failed", "refused", "unreadable")
    assert [path.name for path in (tmp_path / "A").iterdir()] == ["notes.txt"]
    assert not (tmp_path / "B").exists()


def test_place_that_cannot_be_written_to_is_its_own_row(tmp_path: Path) -> None:
    for name in "AB":
        (tmp_path / name).write_text("a file where a folder should be", encoding="utf-8")
    with ThreadPoolExecutor(1) as pool:
        rows = done([person("A"), person("B", "broken"), person("C")], tmp_path, executor=pool)
    assert [row.status for row in rows.values()] == ["failed", "failed", "done"]
    assert "cannot be written to" in rows["A"].error
    assert (tmp_path / "A").is_file()


def test_nobody_usable_is_the_first_ones_refusal_and_nothing_is_written(tmp_path: Path) -> None:
    wrong = [replace(person(name), content={"system": name}) for name in "AB"]
    with pytest.raises(ProblemFileError, match=r"A\.toml: system = 'A'"):
        run_many(wrong, out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


MANY = """
import signal
import sys
from pathlib import Path
from rehab_opt.session.many.run import run_many
from tests.session.stand_in_work import person, quick
if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background is started with it ignored
    log, what = sys.argv[1], sys.argv[2]
    people = [person("A", f"fine {log}"), person("B", f"{what} {log}"), person("C", f"fine {log}")]
    run_many(people, out=Path("out"), workers=1, work=quick)
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")
@pytest.mark.parametrize("how", ["SIGINT", pytest.param("SIGKILL", marks=pytest.mark.nightly)])
def test_interrupted_run_goes_on_where_it_was(tmp_path: Path, how: str) -> None:
    log = tmp_path / "log"
    (tmp_path / "many.py").write_text(f"import sys\nsys.path.insert(0, {ROOT!r})\n{MANY}", encoding="utf-8")
    command = [sys.executable, "many.py", str(log)]
    with subprocess.Popen([*command, "slow"], cwd=tmp_path, stderr=subprocess.DEVNULL) as process:
        for _ in range(1200):  # however slow the machine
            if log.exists() and log.read_text(encoding="utf-8").split() == ["A", "B"]:
                break
            time.sleep(0.1)
        process.send_signal(getattr(signal, how))
        assert process.wait(timeout=120) != 0
    out = tmp_path / "out"
    assert (out / "A" / "result.json").exists()
    assert not (out / "B").exists()
    if how == "SIGINT":
        with (out / RESULTS).open(encoding="utf-8", newline="") as file:
            assert [row["status"] for row in csv.DictReader(file)] == ["done", "not run", "not run"]
    subprocess.run([*command, "fine"], cwd=tmp_path, check=True)
    assert log.read_text(encoding="utf-8").split() == ["A", "B", "B", "C"]
    with (out / RESULTS).open(encoding="utf-8", newline="") as file:
        assert [row["status"] for row in csv.DictReader(file)] == ["done"] * 3
