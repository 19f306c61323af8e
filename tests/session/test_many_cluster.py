"""Many people on a dask.distributed cluster: its client's executor takes the place of a pool."""

from __future__ import annotations

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


@pytest.mark.filterwarnings("default")  # what a cluster warns of while it starts and ends is no error of ours
def test_people_are_worked_through_on_a_real_local_cluster(tmp_path: Path) -> None:
    people = [person(f"P{i}") for i in range(12)]
    people[4] = person("P4", "broken")
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        rows = run_many(people, out=tmp_path / "stub", executor=client.get_executor(), work=quick)
        anna = person("anna")
        arm = {"side": "left", "range_of_motion": "restricted", "accuracy_mm": 3.0}
        anna = replace(anna, content={**anna.content, "arm": arm})
        real = run_many([anna], out=tmp_path / "real", executor=client.get_executor())
    assert [row.status for row in rows] == ["done"] * 4 + ["failed"] + ["done"] * 7
    assert rows[4].error == "ZeroDivisionError: a mistake in two lines"
    assert real[0].status == "done"
    assert float(str(real[0].numbers["sets.restricted.area_m2"])) == pytest.approx(0.00331, rel=0.05)
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
