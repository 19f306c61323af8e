"""Many people on a dask.distributed cluster: its client's executor takes the place of a pool."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from concurrent.futures import Executor, Future
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from rehab_opt.session.many.run import run_many
from tests.session.stand_in_work import person, quick

distributed = pytest.importorskip("distributed")
dask = pytest.importorskip("dask")


@pytest.mark.nightly
@pytest.mark.filterwarnings("default")  # what a cluster warns of while it starts and ends is no error of ours
def test_on_a_real_cluster_a_person_who_takes_workers_with_them_fails_alone(tmp_path: Path) -> None:
    """In a second run, in which nobody does, nothing is computed but that one person."""
    log, out = tmp_path / "log", tmp_path / "out"
    people = [person(f"P{i}", f"fine {log}") for i in range(8)]
    people[1] = person("P1", f"broken {log}")
    people[4] = person("P4", f"killed {log}")
    with (
        dask.config.set({"distributed.deploy.lost-worker-timeout": "10 minutes"}),  # else 15 s, on a loaded machine
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50) as cluster,
        distributed.Client(cluster) as client,
    ):
        first = run_many(people, out=out, executor=client.get_executor(), work=quick)
        before = Counter(log.read_text(encoding="utf-8").split())
        people[1], people[4] = (person(name, f"fine {log}") for name in ("P1", "P4"))
        second = run_many(people, out=out, executor=client.get_executor(), work=quick)
        after = Counter(log.read_text(encoding="utf-8").split())
        anna = person("anna")
        arm = {"side": "left", "range_of_motion": "restricted", "accuracy_mm": 3.0}
        anna = replace(anna, content={**anna.content, "arm": arm})
        (real,) = run_many([anna], out=tmp_path / "real", executor=client.get_executor())
    assert [row.status for row in first] == ["failed" if i in (1, 4) else "done" for i in range(8)]
    assert first[1].error == "ZeroDivisionError: a mistake in two lines"
    assert {row.status for row in second} == {"done"}
    assert after.keys() == {f"P{i}" for i in range(8)}
    assert {name for name in after if after[name] > before[name]} == {"P1", "P4"}
    assert real.status == "done"
    assert float(str(real.numbers["sets.restricted.area_m2"])) == pytest.approx(0.00331, rel=0.05)
    assert (tmp_path / "real" / "anna" / "workspace.png").read_bytes().startswith(b"\x89PNG")


class Blaming(Executor):
    """Gives up the first four together, as dask does with those who wait where workers are lost; then one by one."""

    def __init__(self, guilty: str) -> None:
        self._guilty, self._there = guilty, list[Future[Any]]()

    def submit(self, work: Callable[..., Any], /, *args: Any, **_: Any) -> Future[Any]:
        future: Future[Any] = Future()
        self._there.append(future)
        gone = distributed.KilledWorker(args[0].name, SimpleNamespace(address="tcp://gone"), 3)
        if len(self._there) == 4:
            for each in self._there:
                each.set_exception(gone)
        elif len(self._there) > 4 and args[0].name == self._guilty:
            future.set_exception(gone)
        elif len(self._there) > 4:
            future.set_result(work(*args))
        return future


def test_who_was_given_up_beside_somebody_else_is_computed_alone(tmp_path: Path) -> None:
    people = [person(name) for name in ("guilty", "Ada", "Ben", "Cy")]
    rows = run_many(people, out=tmp_path, executor=Blaming("guilty"), work=quick)
    assert [row.status for row in rows] == ["failed", "done", "done", "done"]
    assert rows[0].error.startswith("KilledWorker")
