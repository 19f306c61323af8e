"""Rows of many people go into a study as they end, under their own covariates, and once."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import pytest

from rehab_opt.errors import ConfigurationError
from rehab_opt.session.many.participant import Participant, PersonResult
from rehab_opt.session.many.run import RESULTS, run_many
from rehab_opt.study.many import study_of_many
from rehab_opt.study.person import removed
from rehab_opt.study.store import Study
from tests.session.stand_in_work import person


def work(participant: Participant) -> PersonResult:
    """A run that measured how long a name is."""
    metrics = f'{{"metrics": {{"name_m": {len(participant.name)}, "status": {{"ok": 3, "backup": 1}}}}}}'
    return PersonResult({"metrics.json": metrics.encode(), "trace.csv": b"t_s\n0\n"}, {"name_m": 1}, 0.1)


def of(name: str, **covariates: str) -> Participant:
    return replace(person(name), covariates=covariates)


@pytest.fixture
def run(tmp_path: Path) -> Callable[..., list[str]]:
    """Status of each of some people, whose results went into a study."""

    def ran(
        *people: Participant, session: str | None = "s", work: Callable[[Participant], PersonResult] = work
    ) -> list[str]:
        with ExitStack() as opened, ThreadPoolExecutor(1) as pool:
            recorder = study_of_many(opened, tmp_path / "study", session, table=tmp_path / "out" / RESULTS)
            assert recorder is not None
            rows = run_many(recorder.checked(people), out=tmp_path / "out", executor=pool, work=work, record=recorder)
        return [row.status for row in rows]

    return ran


def test_results_go_into_the_study_with_covariates_and_once(run: Callable[..., list[str]], tmp_path: Path) -> None:
    people = [of("Ann", group="g", visit="1", condition="c"), of("Bo", session="other")]
    assert run(*people) == ["done", "done"]
    shutil.rmtree(tmp_path / "study")  # what is computed goes into another study without being computed again
    assert run(*people, work=broken) == run(*people, work=broken) == ["done", "done"]
    with Study(tmp_path / "study") as study:
        found = study.rows(
            'SELECT s.person, s."group", s.name, s.visit, t.kind, t.condition, t.status, q.name, m.value, q.unit, '
            "e.text FROM sessions s JOIN trials t ON t.session = s.id "
            "JOIN measures m ON m.trial = t.id JOIN quantities q ON q.id = m.quantity JOIN events e ON e.trial = t.id "
            "ORDER BY s.person"
        )
    assert found == [
        ("Ann", "g", "s", 1, "many", "c", "done", "name", 3.0, "m", "backup"),
        ("Bo", None, "other", None, "many", None, "done", "name", 2.0, "m", "backup"),
    ]


def broken(participant: Participant) -> PersonResult:
    raise ZeroDivisionError


def test_what_failed_is_in_the_study_until_it_is_done(run: Callable[..., list[str]], tmp_path: Path) -> None:
    statuses = []
    for doing in (broken, work):
        run(of("Ann"), work=doing)
        with Study(tmp_path / "study") as study:
            (status,) = study.rows("SELECT status FROM trials")
        (trial,) = (json.loads(path.read_text()) for path in tmp_path.glob("study/Ann/s/*/trial.json"))
        statuses.append((*status, trial["error"]))
    assert statuses == [("failed", "ZeroDivisionError:"), ("done", "")]


def test_covariates_that_do_not_fit_are_their_own_row(run: Callable[..., list[str]]) -> None:
    people = [of("A", visit="first"), of("B", date="today"), of("C", group="g"), of("D", condition="x\n")]
    assert run(*people) == ["refused", "refused", "done", "refused"]
    assert run(of("C", group="other"), of("E")) == ["refused", "done"]
    with pytest.raises(ConfigurationError), ExitStack() as opened:
        study_of_many(opened, None, "s", table=Path("x"))


def test_a_removed_person_leaves_folder_and_table(run: Callable[..., list[str]], tmp_path: Path) -> None:
    run(of("Ann"), of("Bo"))
    with Study(tmp_path / "study") as study:
        removed(study, "Ann")
    left = [
        path for path in tmp_path.rglob("*") if "Ann" in path.name or (path.is_file() and b"Ann" in path.read_bytes())
    ]
    assert left == []
    assert (tmp_path / "out" / "Bo" / "trace.csv").exists()
    assert ",done," in (tmp_path / "out" / RESULTS).read_text()
