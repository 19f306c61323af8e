"""A report is one page that loads nothing and runs nothing, whatever people and measures are called."""

from __future__ import annotations

import base64
import math
import re
import shutil
import stat
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from rehab_opt.cli import main
from rehab_opt.measures.score import Measure
from rehab_opt.study.report import BROWSERS, report_html
from rehab_opt.study.store import Study
from rehab_opt.study.trial import Bound, Event, Session, Trial
from tests.study.made_studies import made_trial

HOSTILE = [
    "<script>alert(1)</script>",
    "\"><img src=x onerror=alert(1)>",
    "</title></style></svg><iframe src='//evil'>",
    "{body} {title} %s %(x)s \\u003cscript\\u003e",
    "x' onload='alert(1)",
    "]]><!-- &lt;b&gt; &#60;",
    "W" * 100,
]  # fmt: skip


PNG = "data:image/png;base64,"


def person_of(name: str) -> str:
    """A pseudonym, which is also a folder's, as near to a hostile name as they may be."""
    return re.sub(r"[/\\\\:*?\"<>|\s]", "-", name).strip("-.")


class Page(HTMLParser):
    """Tags, attributes and text of a page; every tag that opens is to close."""

    EMPTY = frozenset({"meta", "img"})

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: set[str] = set()
        self.words: list[str] = []
        self.sources: list[str] = []
        self.open: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes |= {name for name, _ in attrs}
        self.sources += [str(value) for name, value in attrs if name == "src"]
        if tag not in self.EMPTY:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes |= {name for name, _ in attrs}

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)


def read(text: str) -> Page:
    """The page, which must load and run nothing."""
    page = Page(text)
    assert page.open == []
    assert not {"script", "iframe", "link", "object", "a", "svg", "form"} & {*page.tags}
    assert not {name for name in page.attributes if name.startswith("on") or name in ("srcset", "href", "xlink:href")}
    assert all(base64.b64decode(each.removeprefix(PNG))[:8] == b"\x89PNG\r\n\x1a\n" for each in page.sources)
    assert "url(" not in text
    assert "http" not in text.replace("http-equiv", "")
    assert "default-src 'none'" in text
    assert not re.search(r">(nan|inf|None)\b", text)
    return page


@pytest.fixture
def study(tmp_path: Path) -> Iterator[Study]:
    with Study(tmp_path / "study") as opened:
        yield opened


def test_hostile_names_are_text_and_nothing_else(study: Study) -> None:
    for name in HOSTILE:
        trial = Trial(
            "live",
            [Measure("movement_time", 1.0, "s"), Measure(name, 2.0, name)],
            condition=name,
            bounds=[Bound(name, 1.0, 2.0, name)],
            events=[Event(name, 3, name)],
            outline=[(0, 0), (1, 0), (0, 1)],
        )
        study.add(Session(person_of(name), "s", group=name), trial)
    plain = {*read(report_html(study)).tags, "figcaption"}
    for name in HOSTILE:
        page = read(report_html(study, person_of(name)))
        said = "".join(page.words)
        assert said.count(name) >= 4  # group, condition, event, bound
        assert set(page.tags) <= plain


def test_reports_of_next_to_nothing(study: Study) -> None:
    read(report_html(study))
    study.add(Session("nobody", "1"), [])
    read(report_html(study, "nobody"))
    study.add(Session("failed", "1"), Trial("run", [Measure("movement_time", 1.0, "s")], status="failed", error="x"))
    assert "1 trial not done" in "".join(read(report_html(study)).words)
    for i, value in enumerate((math.nan, 0.0, 0.0, -1e300, 1e300, 1e-300)):
        study.add(Session("odd", str(i)), Trial("live", [Measure("movement_time", value, "s")]))
    study.add(Session("odd", "0"), Trial("live", bounds=[Bound("zero", 1.0, 0.0, "N")], outline=[(0, 0)] * 3))
    read(report_html(study, "odd"))
    read(report_html(study))


def test_safety_is_green_only_where_something_was_checked(study: Study) -> None:
    def box() -> str:
        return re.search(r'<div class="(box[ a-z]*)"><b>Safety.</b> ([^<]*)', report_html(study))[0]  # type: ignore[index]

    study.add(Session("P", "1"), Trial("score", [Measure("movement_time", 1.0, "s")]))
    assert '"box unknown"' in box()
    assert "No safety events" not in box()
    study.add(Session("P", "1"), Trial("run", bounds=[Bound("force", 1.0, 2.0, "N")]))
    assert '"box"' in box()
    assert "every bound was kept; nothing is known of 1 of 2 trials" in box()
    study.add(Session("P", "1"), Trial("run", events=[Event("braking", 1.0)]))
    assert '"box alarm"' in box()


def test_what_changed_is_said_and_which_way(study: Study) -> None:
    for visit in range(5):
        for e in (-0.1, 0.0, 0.1):
            measures = [
                Measure("movement_time", 2.0 - 0.2 * visit + e, "s"),
                Measure("path_ratio", 1.5 + 0.1 * visit + 0.1 * e, "1"),
                Measure("speed_peak", 0.5 + 0.1 * visit + 0.1 * e, "m/s"),
                Measure("sparc", -2.0 + (0.3, -0.3, 0.2, -0.3, 0.3)[visit] + e, "1"),
            ]
            study.add(Session("P", f"v{visit}", visit=visit), Trial("live", measures))
    text = report_html(study, "P")
    rows = dict(
        re.findall(r"<tr><td>([^<]*)</td><td>.*<td(?: class=\"\w+\")?>([^<]*)</td></tr>", text.split("Progress")[0])
    )
    assert rows["Movement time"] == "better"
    assert rows["Path of the hand over the straight line"] == "worse"
    assert rows["Peak speed"] == "changed"
    assert rows["Smoothness (SPARC, nearer 0 is smoother)"] == "no clear change"
    assert "2 s</td><td>1.2 s" in text
    assert "1.1 (v4, trial 1)</td><td>2.1 (v0, trial 3)" in text  # best and worst movement time


def test_no_best_trial_and_no_interval_is_of_values_that_cannot_be(study: Study) -> None:
    """0 velocity peaks were the best trial, and means of people had intervals below zero."""
    for person, counts in (("P", (0, 2, 3)), ("Q", (9, 30))):
        study.add(Session(person, "1"), [Trial("score", [Measure("velocity_peaks", float(n), "1")]) for n in counts])
    text = report_html(study)
    (best,) = re.findall(r"<tr><td>Velocity peaks</td><td>([^<]*)</td>", text[text.index("Best and worst") :])
    assert best.startswith("2 (")
    (mean,) = re.findall(r"<td>(\d[^<]*\([^<]*\))</td>", text[text.index("Groups and conditions") :])[:1]
    assert "(1 to" in mean


def test_values_that_cannot_be_are_in_no_mean_and_equal_trials_have_no_best(study: Study) -> None:
    """0 velocity peaks lowered the means; a workspace of 0 was the best and the worst."""
    for person, counts in (("P", (0, 4, 0)), ("Q", (6, 6))):
        trials = [
            Trial("score", [Measure("velocity_peaks", float(n), "1"), Measure("workspace_area", 0.0, "m^2")])
            for n in counts
        ]
        study.add(Session(person, "1"), trials)
    text = report_html(study)
    means = text[text.index("Groups and conditions") :]
    assert "5 (1 to" in means[means.index("Velocity peaks") :][:200]
    extremes = text[text.index("Best and worst") :].partition("</table>")[0]
    assert "4 (" in extremes
    assert "Workspace" not in extremes


def test_every_event_and_every_bound_that_was_passed_is_told(study: Study) -> None:
    trials = [
        Trial(
            "run", bounds=[Bound("force", value, 10.0, "N")], events=[Event(f"event {value}", 7)] if value > 11 else []
        )
        for value in (9.0, 12.0, 13.0)
    ]
    study.add(Session("P", "1"), trials)
    words = "".join(read(report_html(study, "P")).words)
    for expected in ("2 events in 2 trials; a bound was passed 2 times", "event 12.0", "event 13.0", "130 %", "2 of 3"):
        assert expected in words


def test_the_command_writes_a_page_for_its_owner_alone(
    study: Study, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study.add(Session("P", "1"), made_trial(np.random.default_rng(1)))
    for words, code in ((["--person", "P"], 0), (["--person", "X"], 2), (["--out", str(tmp_path)], 2)):
        with pytest.raises(SystemExit) as done:
            main(["report", str(study.folder), *words])
        assert done.value.code == code
    assert stat.S_IMODE((tmp_path / "study-P-report.html").stat().st_mode) == 0o600
    printed = capsys.readouterr()
    assert "study-P-report.html" in printed.out
    assert "somebody in this study" in printed.err


@pytest.mark.skipif(not any(map(shutil.which, BROWSERS)), reason=f"none of {', '.join(BROWSERS)} is installed")
def test_a_browser_prints_it(study: Study, tmp_path: Path) -> None:
    study.add(Session("P", "1"), made_trial(np.random.default_rng(1)))
    with pytest.raises(SystemExit) as done:
        main(["report", str(study.folder), "--pdf", str(tmp_path / "r.pdf")])
    assert done.value.code == 0
    assert (tmp_path / "r.pdf").read_bytes().startswith(b"%PDF")
