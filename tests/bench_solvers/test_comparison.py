"""A whole comparison: what it writes, and that an interrupted one goes on where it stopped."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from bench.solvers import record
from bench.solvers.entrant import Entrant
from bench.solvers.instances import RecordedQPs
from bench.solvers.passes import Rules
from bench.solvers.record import RECORD
from bench.solvers.run import Comparison, compare, write_comparison
from tests.bench_solvers.fake_solvers import Counted, boxes, entrant

RULES = Rules(limit=0.5, repeats=1)
NAN = ((), ("nan",), (), (), (), ())


def whole(out: Path, who: list[Entrant], **options: object) -> Comparison:
    sequences = [RecordedQPs(each) for each in (boxes(), boxes(name="box/second"), boxes(name="box/nan", marks=NAN))]
    return list(compare(sequences, who, out=out, rules=RULES, **options))[-1]  # type: ignore[arg-type]


def test_a_table_figures_and_numbers_are_written(tmp_path: Path) -> None:
    found = whole(tmp_path, [entrant("is honest"), entrant("lies")])
    written = {path.name for path in write_comparison(found, tmp_path)}
    figures = {f"box_{kind}.{suffix}" for kind in ("profile", "times", "accuracy") for suffix in ("png", "pdf")}
    assert written == {"results.json", "table.md", "captions.md", *figures}
    assert all((tmp_path / name).read_bytes().startswith((b"\x89PNG", b"%PDF")) for name in figures)
    results = json.loads((tmp_path / "results.json").read_text())
    assert results["settings"]["threads"]["OMP_NUM_THREADS"] == "1"
    assert results["machine"]["processor"]
    rows = {(row["family"], row["solver"], row["mode"]): row for row in results["rows"]}
    assert rows["box", "is honest", "warm"]["solved"] == 1.0
    assert rows["box", "lies", "cold"]["failures"]["wrong answer"] == 3
    assert rows["box", "is honest", "cold"]["claimed"] == 1
    table = (tmp_path / "table.md").read_text()
    assert "### box: 17 instances" in table
    assert "3 wrong" in table


def test_what_is_done_is_not_done_again(tmp_path: Path) -> None:
    made = tmp_path / "made"
    who = Entrant("counted", Counted, str(made))

    class Stopped(Exception):  # noqa: N818
        pass

    def interrupt(what: str, done: int, of: int) -> None:
        assert of == 6
        if done == 3:
            raise Stopped

    with pytest.raises(Stopped):
        whole(tmp_path, [who], progress=interrupt)
    assert len((tmp_path / RECORD).read_text().splitlines()) == 3
    before = len(made.read_text())
    with (tmp_path / RECORD).open("a") as lines:
        lines.write('{"solver": "counted", "sequence": "box/sec')  # cut off while it was written
    found = whole(tmp_path, [who])
    again = len(made.read_text()) - before
    assert len(found.passes) == 6
    assert again == before  # three passes then, three now
    assert repr(whole(tmp_path, [who]).rows) == repr(found.rows)  # NaN is not equal to itself
    assert len(made.read_text()) == 2 * before


def test_passes_of_another_state_of_the_library_are_made_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = tmp_path / "made"
    who = Entrant("counted", Counted, str(made))
    list(compare([RecordedQPs(boxes())], [who], out=tmp_path, rules=RULES))
    before = len(made.read_text())
    monkeypatch.setattr(record, "software_digest", lambda: "one line is other")
    list(compare([RecordedQPs(boxes())], [who], out=tmp_path, rules=RULES))
    assert len(made.read_text()) == 2 * before
