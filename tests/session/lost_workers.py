"""Workers of a dask cluster that are killed: `python -m tests.session.lost_workers [PEOPLE]`; 8 by default.

One person takes every worker with them that they are given to. The others are done, although the scheduler computes
again what a lost worker had not handed over, and blames whoever waited beside that person four times over; in a second
run, in which nobody does, nothing is computed but that one person. Every computation leaves a line in a file, which is
counted.

A local cluster gives a worker up that has not come back within 15 s, as on a loaded machine, and waits for ever
once all are gone; here it waits longer for each.
"""

from __future__ import annotations

import sys
import tempfile
from collections import Counter
from pathlib import Path

import dask
import distributed

from rehab_opt.session.many.run import run_many
from tests.session.stand_in_work import person, quick


def main() -> None:
    """Run twice, count, say."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 8
    with (
        dask.config.set({"distributed.deploy.lost-worker-timeout": "10 minutes"}),
        tempfile.TemporaryDirectory() as folder,
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50) as cluster,
        distributed.Client(cluster) as client,
    ):
        log, out = Path(folder) / "log", Path(folder) / "out"
        people = [person(f"P{i}", f"fine {log}") for i in range(count)]
        lost = count // 2
        people[lost] = person(f"P{lost}", f"killed {log}")
        first = run_many(people, out=out, executor=client.get_executor(), work=quick)
        before = Counter(log.read_text(encoding="utf-8").split())
        people[lost] = person(f"P{lost}", f"fine {log}")
        second = run_many(people, out=out, executor=client.get_executor(), work=quick)
        after = Counter(log.read_text(encoding="utf-8").split())
    done = [row.status == "done" for row in first]
    print(f"{count} people: {sum(done)} done, {first[lost].error[:60]!r} of the one that takes workers with it")
    print(f"given to a worker more than once, since one was lost: {sum(times > 1 for times in before.values())}")
    again = {name for name in after if after[name] > before[name]}
    print(f"second run: {sum(row.status == 'done' for row in second)} done, computed again: {sorted(again)}")
    assert done == [i != lost for i in range(count)]
    assert again == {f"P{lost}"}


if __name__ == "__main__":
    main()
