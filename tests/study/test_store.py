"""A study keeps whole trials, whoever writes, and whoever is killed; and keeps nothing of whom it is to forget."""

from __future__ import annotations

import math
import os
import sqlite3
import stat
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from rehab_opt.errors import ConfigurationError
from rehab_opt.measures.score import Measure
from rehab_opt.study.database import APPLICATION, VERSIONS
from rehab_opt.study.person import exported, removed
from rehab_opt.study.store import Study
from rehab_opt.study.trial import ProblemText, Session, StoredFile, Trial
from tests.refusals import refuses
from tests.study.killed import kills
from tests.study.made_studies import checked_sum, made_trial

SECRET = "Q7#ærø-pseudonym"


def values(study: Study, person: str) -> dict[str, float | None]:
    question = (
        "SELECT q.name, m.value FROM people p JOIN sessions s ON s.person = p.id JOIN trials t ON t.session = s.id "
        "JOIN measures m ON m.trial = t.id JOIN quantities q ON q.id = m.quantity WHERE p.name = ?"
    )
    return dict(study.rows(question, (person,)))


def test_what_goes_in_comes_out(tmp_path: Path) -> None:
    with Study(tmp_path / "new" / "study.db") as study:
        trial = Trial("live", [Measure("a", 0.1, "m"), Measure("b", math.nan, "s")], notes=["a note"])
        assert study.add(Session("P", "1", group="g", visit=2, date="2026-11-23"), [trial, trial]) == 2
        assert values(study, "P") == {"a": 0.1, "b": None}
        assert study.rows("SELECT number, notes FROM trials") == [(1, '["a note"]'), (2, '["a note"]')]
        assert study.rows('SELECT "group", visit, date FROM people, sessions') == [("g", 2, "2026-11-23")]


def test_a_trial_of_one_digest_is_there_once_and_a_failed_one_is_replaced(tmp_path: Path) -> None:
    session = Session("P", "1")
    with Study(tmp_path / "study.db") as study:
        assert study.add(session, Trial("run", digest="d", status="failed", error="why")) == 1
        assert not study.has(session, "d")
        assert study.add(session, Trial("run", [Measure("a", 1.0, "m")], digest="d")) == 1
        assert study.add(session, Trial("run", [Measure("a", 2.0, "m")], digest="d")) == 0
        assert study.add(session, Trial("run", digest="d", status="failed", error="why")) == 0
        assert study.has(session, "d")
        assert not study.has(Session("P", "2"), "d")
        assert study.rows("SELECT number, status FROM trials") == [(1, "done")]
        assert values(study, "P") == {"a": 1.0}
        file = tmp_path / "trace.csv"
        file.touch()
        study.add(session, Trial("run", digest="e", files=[StoredFile(file)]))
        assert study.has(session, "e")
        file.unlink()
        assert not study.has(session, "e")  # to be done again


def test_one_refused_trial_leaves_none_of_its_commit(tmp_path: Path) -> None:
    with Study(tmp_path / "study.db") as study:
        good = Trial("live", [Measure("a", 1.0, "m")])
        with pytest.raises(ConfigurationError, match="UNIQUE constraint"):
            study.add(Session("P", "1"), [good, Trial("live", [Measure("a", 1.0, "m"), Measure("a", 2.0, "m")])])
        assert study.rows("SELECT * FROM people") == []


def test_what_cannot_be_kept_is_refused(tmp_path: Path) -> None:
    refuses(
        lambda **bad: Session(**{"person": "P", "name": "-1", **bad}),
        ({"person": ""}, "person"),
        ({"person": "P\n"}, "person"),
        ({"person": "=1+1"}, "person"),
        ({"person": "Anna Meier"}, "person"),
        ({"person": "meier@example.org"}, "person"),
        ({"person": 5}, "person"),
        ({"name": "\x1b[2J"}, "session"),
        ({"name": "-x"}, "session"),
        ({"visit": 1.5}, "visit"),
        ({"visit": -1}, "visit"),
        ({"date": "23.11.2026"}, "date"),
        ({"date": "2026-02-30"}, "date"),
    )
    refuses(
        lambda **bad: Trial("live", **bad),
        ({"condition": "=1+1"}, "condition"),
        ({"condition": 2}, "condition"),
        ({"seconds": "a"}, "seconds"),
    )
    with Study(tmp_path / "study.db") as study:
        study.add(Session("P", "1"), [])
        study.add(Session("P", "1", group="g", visit=2, date="2026-11-23"), [])
        study.add(Session("P", "1"), [])
        refuses(
            lambda **other: study.add(Session("P", "1", **other), []),
            ({"group": "other"}, "group"),
            ({"visit": 3}, "visit"),
            ({"date": "2026-11-24"}, "date"),
        )


def test_on_a_full_disk_a_study_is_read_and_what_is_added_is_refused_in_words(tmp_path: Path) -> None:
    resource = pytest.importorskip("resource")  # not on Windows
    file = tmp_path / "s.db"
    with Study(file) as study:
        study.add(Session("P", "1"), [])
    before = file.read_bytes()
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, limits[1]))  # no file may grow
    try:
        with Study(file, create=False) as study:
            assert study.rows("SELECT name FROM people") == [("P",)]
            with pytest.raises(ConfigurationError, match="read-only, or full"):
                study.forget("P")
        with pytest.raises(ConfigurationError, match="the disk is full"):
            Study(file)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert file.read_bytes() == before


def test_only_the_owner_reads_the_file_and_its_log(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        with Study(tmp_path / "study.db") as study:
            study.add(Session("P", "1"), [])
            modes = {path.name: stat.S_IMODE(path.stat().st_mode) for path in tmp_path.iterdir()}
            (tmp_path / "study.db").chmod(0o644)
            with Study(tmp_path / "study.db"):
                again = stat.S_IMODE((tmp_path / "study.db").stat().st_mode)
    finally:
        os.umask(before)
    assert modes == {"study.db": 0o600, "study.db-wal": 0o600, "study.db-shm": 0o600}
    assert again == 0o600


def test_what_is_no_study_is_refused_and_stays_as_it_is(tmp_path: Path) -> None:
    text, other, later, spoilt = (tmp_path / name for name in ("text", "other", "later", "spoilt"))
    text.write_bytes(b"participant,age\nP01,30\n" * 100)
    with sqlite3.connect(other) as db:
        db.execute("CREATE TABLE mine (x)")
    Study(later).close()
    with sqlite3.connect(later) as db:
        db.execute(f"PRAGMA user_version = {len(VERSIONS) + 1}")
    with Study(spoilt) as study:
        for i in range(20):
            study.add(Session(f"P{i}", "1"), made_trial(np.random.default_rng(i)))
    spoilt.write_bytes(spoilt.read_bytes()[:9000] + b"\xff" * 60_000)
    before = {path: path.read_bytes() for path in (text, other, later)}
    for path, expected in ((text, "not a database"), (other, "another program's"), (later, "update")):
        with pytest.raises(ConfigurationError, match=expected):
            Study(path)
    with pytest.raises(ConfigurationError, match=r"malformed|not a database"), Study(spoilt) as study:
        study.rows("SELECT * FROM trials")
    with pytest.raises(ConfigurationError, match="a study's file"):
        Study(tmp_path / "absent", create=False)
    assert {path: path.read_bytes() for path in (text, other, later)} == before


@pytest.mark.parametrize("version", range(1, len(VERSIONS)))
def test_an_older_version_becomes_the_present_one_with_all_that_it_held(tmp_path: Path, version: int) -> None:
    file = tmp_path / "old.db"
    with sqlite3.connect(file) as db:
        for step in VERSIONS[:version]:
            db.executescript(step)
        db.executescript(
            f"""PRAGMA application_id = {APPLICATION}; PRAGMA user_version = {version};
            INSERT INTO people VALUES (1, 'P', 'g');
            INSERT INTO sessions VALUES (1, 1, '1', 2, '2026-11-23');
            INSERT INTO quantities VALUES (1, 'a', 'm');
            INSERT INTO trials VALUES (1, 1, 1, 'run', NULL, 'done', '', NULL, NULL, 'd', 1.0, '[]', '2026');
            INSERT INTO measures VALUES (1, 1, 0.5);"""
        )
    with Study(file) as study:
        assert study.rows("PRAGMA user_version") == [(len(VERSIONS),)]
        assert values(study, "P") == {"a": 0.5}
        assert study.has(Session("P", "1"), "d")
        assert study.add(Session("P", "1"), made_trial(np.random.default_rng(1))) == 1
        assert len(study.rows("SELECT * FROM bounds")) == 1


def test_a_migration_that_fails_leaves_the_old_version(tmp_path: Path) -> None:
    file = tmp_path / "old.db"
    with sqlite3.connect(file) as db:
        db.executescript(f"{VERSIONS[0]} PRAGMA application_id = {APPLICATION}; PRAGMA user_version = 1;")
        db.execute("CREATE TABLE outlines (x)")  # in the way of the last statement of the second step
    with pytest.raises(ConfigurationError, match="outlines"):
        Study(file)
    with sqlite3.connect(file) as db:
        assert db.execute("PRAGMA user_version").fetchone() == (1,)
        assert db.execute("SELECT count(*) FROM sqlite_master WHERE name = 'bounds'").fetchone() == (0,)


@pytest.mark.skipif(os.name != "posix", reason="needs kill -9")
def test_killed_while_writing_it_has_every_finished_trial(tmp_path: Path) -> None:
    said, there = kills(tmp_path / "study.db", 3, seed=20261123)
    assert there >= said > 0


def test_two_processes_write_at_once(tmp_path: Path) -> None:
    file = tmp_path / "study.db"
    command = [sys.executable, "-m", "tests.study.made_studies", str(file)]
    writers = [subprocess.Popen([*command, name, "60"], stdout=subprocess.DEVNULL) for name in ("A", "B", "A2")]
    assert [writer.wait(timeout=120) for writer in writers] == [0, 0, 0]
    with Study(file) as study:
        assert checked_sum(study) == 180
        assert study.rows("SELECT count(DISTINCT number) FROM trials GROUP BY session") == [(60,)] * 3


def test_nothing_of_a_removed_person_is_left(tmp_path: Path) -> None:
    file, rng = tmp_path / "study.db", np.random.default_rng(3)
    trace, recording = tmp_path / SECRET / "trace.csv", tmp_path / "raw.csv"
    trace.parent.mkdir()
    trace.touch()
    recording.touch()
    table = tmp_path / "results.csv"
    table.write_text(f"participant,status\nP1,done\n{SECRET},done\n", encoding="utf-8")
    (tmp_path / "results.parquet").write_bytes(b"PAR1 P01")
    (tmp_path / "groups.csv").write_text("group,measure,people,mean\nstroke,area,1,0.0033\n", encoding="utf-8")
    files = [StoredFile(trace), StoredFile(recording, "recording"), StoredFile(table, "table")]
    with Study(file) as study:
        for i in range(150):  # an index of several pages, so that inner ones hold names, too
            study.add(Session(f"P{i}-{'x' * 80}", "1"), made_trial(rng))
            if i % 10 == 0:
                problem = ProblemText(SECRET, f"title = {SECRET}")
                said = Trial("run", notes=[SECRET], error=SECRET, problem=problem, files=files)
                study.add(Session(f"{SECRET}", f"{SECRET} {i}"), said)
        assert SECRET.encode() in file.read_bytes() + (tmp_path / "study.db-wal").read_bytes()
        assert removed(study, SECRET) == (recording,)
        for path in tmp_path.iterdir():
            assert SECRET.encode() not in path.read_bytes(), path
        assert study.rows("SELECT count(*) FROM people") == [(150,)]
        assert study.rows("SELECT count(*) FROM trials") == [(150,)]
        assert study.rows("PRAGMA integrity_check") == [("ok",)]
        with pytest.raises(ConfigurationError, match="somebody in this study"):
            removed(study, SECRET)
    assert not trace.parent.exists()
    assert recording.exists()
    assert table.read_text() == "participant,status\nP1,done\n"
    assert not (tmp_path / "results.parquet").exists()
    assert not (tmp_path / "groups.csv").exists()  # of the one person of a group it said every number
    assert SECRET.encode() not in file.read_bytes()


def test_a_reader_that_holds_old_pages_is_told_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rehab_opt.study.database.WAIT_S", 0.1)
    with Study(tmp_path / "study.db") as study, Study(tmp_path / "study.db") as reader:
        study.add(Session(SECRET, "1"), [])
        with reader.snapshot():
            assert reader.rows("SELECT name FROM people") == [(SECRET,)]
            with pytest.raises(ConfigurationError, match=r"reading|locked"):
                removed(study, SECRET)
        study.forget(SECRET)
    assert SECRET.encode() not in (tmp_path / "study.db").read_bytes()


def test_a_person_gets_all_that_is_theirs_and_nothing_of_others(tmp_path: Path) -> None:
    trace = tmp_path / "trace.csv"
    trace.write_text("t_s\n0\n")
    with Study(tmp_path / "study.db") as study:
        mine = made_trial(np.random.default_rng(1), files=(StoredFile(trace),))
        study.add(Session("mine", "1", group="g"), [mine, mine])
        study.add(Session("theirs", "1"), made_trial(np.random.default_rng(2)))
        written = exported(study, "mine", tmp_path / "out")
        assert sorted(path.name for path in written) == ["1-trace.csv", "measures.csv", "person.json"]
        everything = "".join(path.read_text() for path in written)
        assert "theirs" not in everything
        assert "braking" in everything or not study.rows("SELECT * FROM events")
        rows = (tmp_path / "out" / "measures.csv").read_text().splitlines()
        assert len(rows) == 1 + 2 * len(mine.measures)
        assert rows[1].startswith("mine,g,1,,,1,,done,movement_time,")
        assert float(rows[1].split(",")[-2]) == mine.measures[0].value
        with pytest.raises(ConfigurationError, match="empty"):
            exported(study, "mine", tmp_path / "out")
        with pytest.raises(ConfigurationError, match="somebody in this study"):
            exported(study, "nobody", tmp_path / "out2")
        assert len(exported(study, None, tmp_path / "all")) == 1
        assert "theirs" in (tmp_path / "all" / "measures.csv").read_text()


def test_samples_are_kept_as_parquet_and_leave_with_the_person(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    csv, rng = tmp_path / "trace.csv", np.random.default_rng(8)
    csv.write_text("t_s,law\n0,a\n0.5,b\n")
    samples = {"t_s": np.arange(100) / 100, "x_m": rng.normal(size=100)}
    with Study(tmp_path / "s.db") as study:
        shared = [Trial("run", trace=csv, digest=f"{i}") for i in range(3)]
        assert study.add(Session("P", "1"), [*shared, Trial("score", trace=samples)]) == 4
        assert study.add(Session("P", "1"), shared) == 0  # nothing twice, no file either
        csv.unlink()
        files = sorted((tmp_path / "s.db-traces").glob("*/*"))
        assert len(files) == 2
        assert all(stat.S_IMODE(path.stat().st_mode) == 0o600 for path in files)
        assert [folder.stat().st_mode & 0o777 for folder in files[0].parents[:2]] == [0o700, 0o700]
        first, second = (parquet.read_table(path).to_pydict() for path in files)
        assert first == {"person": ["P"] * 2, "session": ["1"] * 2, "t_s": [0, 0.5], "law": ["a", "b"]}
        assert second["x_m"] == samples["x_m"].tolist()
        of = study.rows("SELECT trial, path FROM files ORDER BY trial")
        assert [study.place(path) for _, path in of] == [files[0]] * 3 + [files[1]]
        assert sorted(path.name for path in exported(study, "P", tmp_path / "out"))[:2] == [
            "1-1.parquet",
            "2-4.parquet",
        ]
        study.add(Session("Q", "1"), Trial("score", trace=samples))
        (files[0].parent / ".9.parquet.partial").touch()  # of a process that was killed
        removed(study, "P")
        assert not files[0].parent.exists()
        assert len(list((tmp_path / "s.db-traces").glob("*/*"))) == 1
