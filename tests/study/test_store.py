"""A study keeps whole trials, whoever is killed; what cannot be read is named; who is removed is gone."""

from __future__ import annotations

import json
import math
import os
import shutil
import sqlite3
import stat
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from rehab_opt.errors import ConfigurationError
from rehab_opt.measures.score import Measure
from rehab_opt.study.person import exported, note_written, removed
from rehab_opt.study.store import Study
from rehab_opt.study.trial import ProblemText, Session, StoredFile, Trial
from tests.refusals import refuses
from tests.study.killed import kills
from tests.study.made_studies import checked_sum, made_folders, made_trial

SECRET = "Q7#ærø-pseudonym"


def values(study: Study, person: str) -> dict[str, float]:
    question = (
        "SELECT q.name, m.value FROM sessions s JOIN trials t ON t.session = s.id "
        "JOIN measures m ON m.trial = t.id JOIN quantities q ON q.id = m.quantity WHERE s.person = ?"
    )
    return dict(study.rows(question, (person,)))


def count(study: Study) -> int:
    return int(study.rows("SELECT count(*) FROM trials")[0][0])


def test_what_goes_in_comes_out(tmp_path: Path) -> None:
    with Study(tmp_path / "new" / "study") as study:
        trial = Trial("live", [Measure("a", 0.1, "m"), Measure("b", math.nan, "s")], notes=["a note"])
        assert study.add(Session("P", "1", group="g", visit=2, date="2026-11-23"), [trial, trial]) == 2
        assert values(study, "P") == {"a": 0.1}
        assert study.rows('SELECT "group", visit, date FROM sessions') == [("g", 2, "2026-11-23")]
        assert study.rows("SELECT number, kind, status FROM trials") == [(1, "live", "done"), (2, "live", "done")]
        written = json.loads((study.folder / "P" / "1" / "002" / "trial.json").read_text())
        assert (written["notes"], written["measures"]) == (["a note"], [["a", 0.1, "m"]])


def test_samples_and_metrics_are_kept_and_what_trials_share_lies_there_once(tmp_path: Path) -> None:
    samples = {"t_s": np.array([0.0, 0.1]), "x_m": np.array([1 / 3, 2.5e-300]), "status": ["ok", "a,b"]}
    run = [tmp_path / name for name in ("metrics.json", "trace.csv")]
    for path in run:
        path.write_text(path.name)
    files = [StoredFile(path) for path in run]
    with Study(tmp_path / "s") as study:
        study.add(Session("P", "1"), [Trial("run", trace=run[1], files=files, digest=f"{i}") for i in range(3)])
        study.add(Session("P", "1"), Trial("live", trace=samples))
    home = tmp_path / "s" / "P" / "1"
    for path in run:
        path.unlink()
        assert [(home / f"00{i}" / path.name).read_text() for i in (1, 2, 3)] == [path.name] * 3
        assert (home / "001" / path.name).stat().st_nlink == 3
    rows = (home / "004" / "trace.csv").read_text().splitlines()
    assert rows[0] == "t_s,x_m,status"
    assert [float(row.split(",")[1]) for row in rows[1:]] == samples["x_m"].tolist()


def test_a_trial_of_one_digest_is_there_once_and_a_failed_one_is_replaced(tmp_path: Path) -> None:
    session, again = Session("P", "1"), StoredFile(tmp_path / "again.csv")
    with Study(tmp_path / "study") as study:
        assert study.add(session, Trial("run", digest="d", status="failed", error="why")) == 1
        assert study.add(session, Trial("run", [Measure("a", 1.0, "m")], digest="d")) == 1
        assert study.add(session, Trial("run", [Measure("a", 2.0, "m")], digest="d", files=[again])) == 0
        assert study.add(session, Trial("run", digest="d", status="failed", error="why")) == 0
        assert study.add(Session("P", "2"), Trial("run", digest="d")) == 1
        assert study.rows("SELECT status FROM trials") == [("done",)] * 2
        assert values(study, "P") == {"a": 1.0}
        again.path.touch()
        removed(study, "P")
        assert not again.path.exists()  # written by a second run of what the study had: of this person, too


def test_what_cannot_be_kept_is_refused(tmp_path: Path) -> None:
    refuses(
        lambda **bad: Session(**{"person": "P", "name": "-1", **bad}),
        *[({"person": bad}, "person") for bad in ("", "P\n", "=1+1", "Anna Meier", "meier@example.org", 5, "a/b")],
        *[({"person": bad}, "person") for bad in ("..", ".P", "P.", "study.json", "index.db", "\N{SNAKE}" * 60)],
        *[({"name": bad}, "session") for bad in ("\x1b[2J", "-x", "../x", "1:2", ".", "con?")],
        ({"visit": 1.5}, "visit"), ({"visit": -1}, "visit"),
        ({"date": "23.11.2026"}, "date"), ({"date": "2026-02-30"}, "date"),
    )  # fmt: skip
    refuses(
        lambda **bad: Trial("live", **bad),
        ({"condition": "=1+1"}, "condition"), ({"condition": 2}, "condition"), ({"seconds": "a"}, "seconds"),
        ({"measures": [Measure("a", 1.0, "m"), Measure("a", 2.0, "m")]}, "each measure once"),
    )  # fmt: skip
    with Study(tmp_path / "study") as study:
        study.add(Session("P", "1"), [])
        study.add(Session("P", "1", group="g", visit=2, date="2026-11-23"), [])
        study.add(Session("P", "1"), [])
        contradictions = [({"group": "other"}, "group"), ({"visit": 3}, "visit"), ({"date": "2026-11-24"}, "date")]
        refuses(lambda **other: study.add(Session("P", "1", **other), []), *contradictions)
        refuses(lambda **other: study.check(Session("P", "1", **other)), *contradictions)
        study.check(Session("new", "1"))
    assert not (tmp_path / "study" / "new").exists()


def test_what_is_no_study_is_refused_and_stays_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("participant,age\nP01,30\n")
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "mine.txt").write_text("mine")
    for name in ("file", "other"):
        with pytest.raises(ConfigurationError, match=r"a study's folder|Not a directory"):
            Study(tmp_path / name)
    with pytest.raises(ConfigurationError, match="a study's folder"):
        Study(tmp_path / "absent", create=False)
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["file", "mine.txt", "other"]


def test_the_index_follows_from_the_folders(tmp_path: Path) -> None:
    """Absent, spoilt, of another version, or older than what lies there: it is made anew, with the same numbers."""
    root = tmp_path / "s"
    made_folders(root, 3, 2, 4)
    sums = "SELECT name, count(*), sum(value) FROM measures JOIN quantities ON id = quantity GROUP BY 1"
    with Study(root) as study:
        first = study.rows(sums)
        assert (count(study), len(first), first[0][1]) == (24, 10, 24)
    for spoil in ("", "no database", "PRAGMA user_version = 99"):
        if spoil.startswith("PRAGMA"):
            with closing(sqlite3.connect(root / "index.db")) as db:
                db.execute(spoil)
        else:
            (root / "index.db").unlink()
            (root / "index.db").write_bytes(spoil.encode() * 1000)
        with Study(root, create=False) as study:
            again = study.rows(sums)
        assert [row[:2] for row in again] == [row[:2] for row in first]
        assert [row[2] for row in again] == pytest.approx([row[2] for row in first])
    shutil.copytree(root / "P0000" / "week 1" / "001", root / "P0000" / "week 1" / "007")
    shutil.rmtree(root / "P0001" / "week 2")
    (root / "P0002" / "week 1" / "002").rename(root / "P0002" / "week 1" / "004-old")
    with Study(root) as study:
        assert count(study) == 24 + 1 - 4 - 1
        assert study.rows("SELECT number FROM trials ORDER BY 1 DESC LIMIT 1") == [(7,)]


def test_a_run_that_is_copied_into_a_session_is_a_trial_of_it(tmp_path: Path) -> None:
    metrics = {
        "problem": "p",
        "metrics": {"tilt_max_deg": 1.0, "tilt_limit_deg": 2.0, "status": {"ok": 9, "backup": 1}},
    }
    with Study(tmp_path / "s") as study:
        study.add(Session("P", "1"), [])
    (tmp_path / "s" / "P" / "1" / "001").mkdir()
    (tmp_path / "s" / "P" / "1" / "001" / "metrics.json").write_text(json.dumps(metrics))
    with Study(tmp_path / "s") as study:
        assert values(study, "P") == {"tilt_max": 1.0, "tilt_limit": 2.0}
        assert study.rows("SELECT name, value, bound, unit FROM bounds") == [("tilt", 1.0, 2.0, "deg")]
        assert study.rows("SELECT text, times FROM events") == [("backup", 1.0)]


BAD = {
    "empty": b"", "cut": b'{"kind": "ru', "binary": bytes(range(256)), "list": b"[1, 2]", "no kind": b"{}",
    "deep": b"[" * 9999,
    "text for number": b'{"kind": "run", "measures": [["a", "x", "m"]]}', "surrogate": b'{"kind": "\\ud800"}',
    "label": b'{"kind": "run", "condition": "=1+1"}', "infinite": b'{"kind": "run", "bounds": [["f", 1e999, 2, "N"]]}',
    "twice": b'{"kind": "run", "measures": [["a", 1, "m"], ["a", 2, "m"]]}',
}  # fmt: skip


BAD_METRICS = (
    b"", b"[]", b'{"metrics": 3}', b'{"metrics": {"a_m": 1e999, "laws": 3}}', b'{"metrics": {"status": {"safe": "x"}}}',
    b'{"metrics": {"laws": {"a": {"trials": 3}}}}', b'{"metrics": {"n_m": ' + b"9" * 400 + b"}}",
    b'{"metrics": {"\\ud800": 3}}',
)  # fmt: skip


def test_bad_files_are_named_and_nothing_is_lost(tmp_path: Path) -> None:
    root = tmp_path / "s"
    made_folders(root, 2, 1, 2)
    home = root / "P0000" / "week 1"
    for number, content in enumerate(BAD.values(), start=11):
        (home / f"{number:03}").mkdir()
        (home / f"{number:03}" / "trial.json").write_bytes(content)
    for number, content in enumerate(BAD_METRICS, start=41):
        (home / f"{number:03}").mkdir()
        (home / f"{number:03}" / "metrics.json").write_bytes(content)
    os.mkfifo(home / "003")
    (home / "004").mkdir()
    os.mkfifo(home / "004" / "trial.json")
    (home / "notes.txt").write_text("mine")
    (root / "P0002" / "1").mkdir(parents=True)
    (root / "P0002" / "person.json").write_text('{"group": 3}')
    (root / "Anna Meier" / "1" / "001").mkdir(parents=True)
    (root / "P0001" / "x").mkdir()
    (root / "P0001" / "x" / "session.json").write_text('{"visit": "first"}')
    (root / "elsewhere").symlink_to(tmp_path)
    before = {path: path.read_bytes() for path in root.rglob("*") if path.is_file() and path.name != "index.db"}
    for _ in range(2):  # the second time by the index
        with Study(root) as study:
            said = "\n".join(study.bad())
            assert count(study) >= 4
            assert study.rows("SELECT count(*) FROM trials JOIN measures ON trial = id WHERE number < 3") == [(40,)]
        for place in (
            "P0000/week 1/003",
            "P0000/week 1/004",
            "notes.txt",
            "P0002/1: group",
            "Anna Meier/1: ",
            "P0001/x: visit",
        ):
            assert place in said, place
        for number, name in enumerate(BAD, start=11):
            assert f"P0000/week 1/{number:03}: " in said, name
        for number in (41, 42, 43, 45, 46, 47, 48):
            assert f"P0000/week 1/{number:03}: " in said, number
    assert {path: path.read_bytes() for path in before} == before
    (home / "011" / "trial.json").write_text('{"kind": "run"}')
    with Study(root) as study:
        assert "P0000/week 1/011" not in "\n".join(study.bad())
        assert study.add(Session("P0000", "week 1"), Trial("run")) == 1
    assert (home / "049" / "trial.json").exists()


@pytest.mark.skipif(os.name != "posix", reason="needs kill -9")
def test_killed_while_writing_it_has_every_finished_trial(tmp_path: Path) -> None:
    said, there = kills(tmp_path / "study", 3, seed=20261123)
    assert there >= said > 0


def test_a_writer_killed_between_folder_and_index_loses_nothing(tmp_path: Path) -> None:
    with Study(tmp_path / "s") as study:
        study.add(Session("P", "1"), Trial("run", digest="a"))
        before = (tmp_path / "s" / "index.db").read_bytes()
        study.add(Session("P", "1"), Trial("run", [Measure("a", 1.0, "m")], digest="b"))
    (tmp_path / "s" / "index.db").write_bytes(before)
    code = (  # killed once the trace is there, and the trial is not
        "import os, sys; from pathlib import Path; from rehab_opt.study import store, trial\n"
        "store.trial_format = lambda: os._exit(9)\nwith store.Study(sys.argv[1]) as s:\n"
        " s.add(trial.Session('P', '1'), trial.Trial('run', trace={'t_s': [0.0]}))"
    )
    assert subprocess.run([sys.executable, "-c", code, str(tmp_path / "s")], check=False).returncode == 9
    with Study(tmp_path / "s") as study:
        assert (count(study), values(study, "P")) == (2, {"a": 1.0})
        assert study.add(Session("P", "1"), Trial("run", digest="b")) == 0
        assert study.add(Session("P", "1"), Trial("run", digest="c")) == 1
        assert study.bad() == []


def test_processes_write_at_once(tmp_path: Path) -> None:
    root = tmp_path / "study"
    command = [sys.executable, "-m", "tests.study.made_studies", str(root)]
    writers = [subprocess.Popen([*command, name, "30"], stdout=subprocess.DEVNULL) for name in ("A", "B", "A2")]
    assert [writer.wait(timeout=120) for writer in writers] == [0, 0, 0]
    assert checked_sum(root) == 90
    code = (
        "import sys; from tests.study.test_store import *\nwith Study(sys.argv[1]) as s:\n"
        " for i in range(25): s.add(Session('C', 's'), Trial('run', digest=f'{i}'))"
    )
    writers = [subprocess.Popen([sys.executable, "-c", code, str(root)]) for _ in range(3)]
    assert [writer.wait(timeout=120) for writer in writers] == [0, 0, 0]
    with Study(root) as study:
        assert count(study) == 115  # in one session, of one digest once, whoever was first
        assert len([*(root / "C" / "s").glob("[0-9]*")]) == 25


def test_only_the_owner_reads_it(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        with Study(tmp_path / "study") as study:
            study.add(Session("P", "1"), Trial("live", trace={"t_s": [0.0]}))
        files = [path for path in (tmp_path / "study").rglob("*") if path.is_file()]
        assert {stat.S_IMODE(path.stat().st_mode) for path in files} == {0o600}
        assert len(files) == 4
        (tmp_path / "study").chmod(0o755)
        Study(tmp_path / "study").close()
        assert stat.S_IMODE((tmp_path / "study").stat().st_mode) == 0o700
    finally:
        os.umask(before)


def test_on_a_full_disk_a_study_is_read_and_what_is_added_is_refused_in_words(tmp_path: Path) -> None:
    resource = pytest.importorskip("resource")  # not on Windows
    made_folders(tmp_path / "s", 1, 1, 2)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, limits[1]))  # no file may grow
    try:
        with Study(tmp_path / "s", create=False) as study:
            assert count(study) == 2  # by an index in memory
            with pytest.raises(ConfigurationError, match="can be read and written to"):
                study.add(Session("P", "1"), Trial("live"))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    with Study(tmp_path / "s") as study:
        assert (count(study), study.bad()) == (2, [])


def bytes_below(folder: Path) -> bytes:
    names = "\n".join(str(path.relative_to(folder)) for path in folder.rglob("*"))
    return names.encode() + b"".join(path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file())


def test_nothing_of_a_removed_person_is_left(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    result, recording, table = tmp_path / SECRET / "metrics.json", tmp_path / "raw.csv", tmp_path / "results.csv"
    result.parent.mkdir()
    result.write_text("{}")
    recording.touch()
    table.write_text(f"participant,status\nP1,done\n{SECRET},done\n", encoding="utf-8")
    (tmp_path / "results.parquet").write_bytes(b"PAR1 P01")
    (tmp_path / "groups.csv").write_text("group,measure,people,mean\nstroke,area,1,0.0033\n", encoding="utf-8")
    files = [StoredFile(result), StoredFile(recording, "recording"), StoredFile(table, "table")]
    with Study(tmp_path / "s") as study:
        for i in range(150):  # an index of several pages, so that inner ones hold names, too
            study.add(Session(f"P{i}-{'x' * 80}", "1"), made_trial(rng))
            if i % 10 == 0:
                problem = ProblemText(SECRET, f"title = {SECRET}")
                trial = Trial(
                    "run", [Measure(SECRET, 1.0, "")], notes=[SECRET], problem=problem, files=files, digest=SECRET
                )
                study.add(Session(SECRET, f"{SECRET} {i}"), [trial, Trial("run", condition=SECRET)])
        assert SECRET.encode() in (tmp_path / "s" / "index.db").read_bytes()
        exported(study, SECRET, tmp_path / "theirs", parquet=True)
        exported(study, None, tmp_path / "all")
        exported(study, f"P1-{'x' * 80}", tmp_path / "other")
        (tmp_path / "all" / "own.txt").write_text("a user's")
        page = tmp_path / "page.html"
        page.write_text(SECRET)
        note_written(study, [page], SECRET)
        assert removed(study, SECRET) == ([recording], [tmp_path / "all" / "measures.csv"])
        assert SECRET.encode() not in bytes_below(tmp_path)  # while the study is open
        with pytest.raises(ConfigurationError, match="somebody in this study"):
            removed(study, SECRET)
        assert count(study) == 150
    assert SECRET.encode() not in bytes_below(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"s", "raw.csv", "results.csv", "all", "other"}
    assert table.read_text() == "participant,status\nP1,done\n"
    assert [path.name for path in (tmp_path / "all").iterdir()] == ["own.txt"]


def test_who_is_deleted_by_hand_leaves_the_index_too(tmp_path: Path) -> None:
    with Study(tmp_path / "s") as study:
        study.add(Session(SECRET, "1"), Trial("run", condition=SECRET))
        study.add(Session("P", "1"), Trial("run"))
    shutil.rmtree(tmp_path / "s" / SECRET)
    Study(tmp_path / "s").close()
    assert SECRET.encode() not in bytes_below(tmp_path)


def test_a_person_gets_all_that_is_theirs_and_nothing_of_others(tmp_path: Path) -> None:
    with Study(tmp_path / "s") as study:
        mine = made_trial(np.random.default_rng(1))
        study.add(Session("mine", "1", group="g"), [mine, mine])
        study.add(Session("theirs", "1"), made_trial(np.random.default_rng(2)))
        written = exported(study, "mine", tmp_path / "out")
        names = ["measures.csv", "person.json", "trial.json", "trial.json"]
        assert sorted(path.name for path in written) == names
        assert b"theirs" not in bytes_below(tmp_path / "out")
        rows = (tmp_path / "out" / "measures.csv").read_text().splitlines()
        assert len(rows) == 1 + 2 * len(mine.measures)
        assert rows[1].startswith("mine,g,1,,,1,,done,movement_time,")
        assert float(rows[1].split(",")[-2]) == mine.measures[0].value
        for out, person, why in (
            ("out", "mine", "empty"),
            ("s/out", "mine", "outside"),
            ("out2", "nobody", "somebody"),
        ):
            with pytest.raises(ConfigurationError, match=why):
                exported(study, person, tmp_path / out)
        assert len(exported(study, None, tmp_path / "all")) == 1
        assert "theirs" in (tmp_path / "all" / "measures.csv").read_text()
        typed = pytest.importorskip("pyarrow.parquet").read_table(
            exported(study, None, tmp_path / "p", parquet=True)[1]
        )
        assert typed.num_rows == 3 * len(mine.measures)
        assert [str(typed.schema.field(name).type) for name in ("person", "trial", "value")] == [
            "string",
            "int64",
            "double",
        ]


@pytest.mark.nightly
def test_a_thousand_people_are_shown_within_a_second(tmp_path: Path) -> None:
    """10^3 people x 20 sessions x 10 trials; the folders are made, and read for the first time, in some minutes."""
    made_folders(tmp_path / "s", 1000, 20, 10)
    command = [sys.executable, "-m", "rehab_opt", "study", "show", str(tmp_path / "s")]
    for _ in range(2):
        began = time.perf_counter()
        shown = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    assert time.perf_counter() - began <= 1.0
    assert "1000 people, 20000 sessions, 200000 trials" in shown
