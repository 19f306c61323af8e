"""Numbers and pages of a study that a seed makes, kept."""

from __future__ import annotations

import datetime
import re
from pathlib import Path

import numpy as np

from rehab_opt.study import drawing, summary
from rehab_opt.study.drawing import Series, growth_chart, outline_chart, progress_chart
from rehab_opt.study.notable import bounds, events, extreme, growth, outlines, stating_safety
from rehab_opt.study.person import exported
from rehab_opt.study.record import metric_trials, outline
from rehab_opt.study.report import report_html
from rehab_opt.study.store import Study
from rehab_opt.study.summary import Interval
from rehab_opt.study.trial import Event, Session, Trial
from tests.golden import assert_kept
from tests.golden.returns import Returns, sums
from tests.study.made_studies import made_trial

NUMBER = re.compile(r"-?\d+\.?\d*")


def test_a_study(tmp_path: Path) -> None:
    rng, more, pages = np.random.default_rng(3), [], []
    with Returns("rehab_opt/study/", but="Study\\.|_private|database|versions|exported|person\\.") as seen, \
         Study(tmp_path / "study.db") as study:  # fmt: skip
        for name, group in (("A", "one"), ("B", "one"), ("C", "two"), ("D", None)):
            for visit in range(4 if name != "D" else 1):
                date = datetime.date(2026, 1, 5) + datetime.timedelta(days=9 * visit)
                session = Session(name, f"s{visit}", group=group, visit=visit, date=date.isoformat())
                trials = [made_trial(rng, better=visit / 4, condition=("with", "without")[k % 2]) for k in range(4)]
                study.add(
                    session,
                    [*trials, Trial("run", status="failed", error="x", events=[Event("braking", 2.0)])][
                        : 5 - visit % 2
                    ],
                )
        for person in (None, "A", "D"):
            known = summary.quantities(study, person)
            all_means = summary.session_means(study, known, person)
            for quantity in known[:4]:
                means = all_means[quantity]
                more += [
                    means,
                    summary.of_people(means),
                    summary.slopes(means),
                    extreme(study, quantity, largest=True, person=person),
                ]
            more += [events(study, person), bounds(study, person), stating_safety(study, person)]
            page = report_html(study, person, today=datetime.date(2026, 2, 3))
            pages.append([NUMBER.sub("#", page).count("#"), *sums(np.array([*map(float, NUMBER.findall(page))]))])
            pages.append(sums([*map(str.strip, NUMBER.sub("#", page).split("<"))][:20000]))
        more += [summary.overview(study), summary.people(study), outlines(study, "A"), growth(study, most=3)]
        more += [exported(study, "A", tmp_path / "out")[0].name]
        for values in ([], [1.0], [1.0, 3.0], [2.0, 2.5, 9.0], [*range(12)], [*range(40)]):
            more += [summary.interval(values), summary.trend(values) if len(values) > 2 else 0]
        points = rng.normal(size=(30, 2))
        more += [
            drawing.hull(points.tolist()),
            drawing.area(drawing.hull(points.tolist())),
            outline(points),
            outline(points[:2]),
        ]
        more += [
            drawing.number(each, within=within) for each in (0.0, 1.25, -1234.5, 1e-5, 9.995) for within in (0.0, 10.0)
        ]
        shapes = [("a", points[:9].tolist()), ("b", (0.2 * points[9:20]).tolist())]
        series = [
            Series("a", [(0.0, 1.0), (1.0, -2.5)], [(0.0, Interval(1.0, 0.5, 2.0, 3)), (1.0, Interval(3, 2, 3.5, 4))])
        ]
        for chart in (progress_chart(series, [(0.0, "x"), (1.0, "y")]), progress_chart([], []),
                      outline_chart(shapes), growth_chart([("p", *[each[1] for each in shapes])]),
                      drawing.bars([("x", 0.2), ("y", 1.3)])):  # fmt: skip
            more += [np.array([*map(float, NUMBER.findall(chart))]), NUMBER.sub("#", chart)]
        metrics = {
            "status": {"ok": 3, "braking": 2},
            "laws": {"a": {"error_max_m": 0.2, "force_max_N": 3.0}},
            "tick_median_ms": 2.0,
            "force_commanded_max_N": 8.0,
            "joint_speed_max_fraction_of_limit": 0.7,
            "n": 3,
            "x_deg": 2.5,
            "none": None,
        }
        more += [metric_trials(metrics, Trial("run"))]
    assert_kept("study", [seen.numbers(), [sums(each) for each in more], pages], relative=1e-6, absolute=1e-9)
