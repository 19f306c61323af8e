"""A study, or one person of it, as one page that a therapist reads in a minute; it loads nothing and runs nothing."""

from __future__ import annotations

import datetime
import math
import os
import shutil
import subprocess
import tempfile
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from rehab_opt.errors import ConfigurationError
from rehab_opt.study.drawing import (
    COLOURS,
    Series,
    area,
    bars,
    escaped,
    growth_chart,
    hull,
    number,
    outline_chart,
    progress_chart,
)
from rehab_opt.study.notable import Extreme, bounds, events, extreme, growth, outlines, stating_safety
from rehab_opt.study.person import check_there
from rehab_opt.study.store import Study
from rehab_opt.study.summary import (
    Interval,
    Quantity,
    SessionMean,
    grouped,
    interval,
    of_people,
    overview,
    people,
    quantities,
    session_means,
    slopes,
    trend,
)
from rehab_opt.version import __version__

__all__ = ["report_html", "write_pdf"]


class Plain(NamedTuple):
    """A measure in plain words, which way is better (1 more, -1 less, 0 neither), and its possible values."""

    words: str
    better: int
    least: float = 0.0
    most: float = math.inf


PLAIN = {
    "success": Plain("Trials that succeeded", 1, most=1.0),
    "movement_time": Plain("Movement time", -1),
    "time_to_target": Plain("Time to the target", -1),
    "end_error": Plain("Distance from the target at the end", -1),
    "final_distance": Plain("Distance from the target at the end", -1),
    "deviation_mean": Plain("Deviation from the path", -1),
    "path_ratio": Plain("Path of the hand over the straight line", -1, least=1.0),
    "path_length_ratio": Plain("Path of the hand over the straight line", -1, least=1.0),
    "sparc": Plain("Smoothness (SPARC, nearer 0 is smoother)", 1, -math.inf, 0.0),
    "smoothness_sparc": Plain("Smoothness (SPARC, nearer 0 is smoother)", 1, -math.inf, 0.0),
    "velocity_peaks": Plain("Velocity peaks", -1, least=1.0),
    "speed_peak": Plain("Peak speed", 0),
    "workspace_area": Plain("Workspace used", 1),
    "workspace_volume": Plain("Workspace used", 1),
    "area": Plain("Workspace in reach", 1),
}
"""Measures that a report draws, in its order; others are drawn where none of these is there."""
SCALES = {"m": (1e3, "mm"), "m^2": (1e4, "cm²"), "m^3": (1e6, "cm³"), "m/s": (1e3, "mm/s"), "1": (1.0, "")}
MAX_DRAWN = 8
MAX_CONDITIONS = 6
MAX_OUTLINED = 40
"""People of a group whose outlines are drawn: more hide one another."""
DAYS_OF_A_WEEK = 7
NAMED_CONDITION = "all"
BETTER, WORSE = "better", "worse"
FEWEST_FOR_A_TREND = 4
LONGEST_WORD = 24
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'">
<meta name="viewport" content="width=device-width"><title>{title}</title><style>
body {{ font: 15px/1.45 system-ui, sans-serif; color: #1a1a1a; max-width: 980px; margin: 24px auto; padding: 0 16px }}
h1 {{ font-size: 26px; margin: 0 0 2px; overflow-wrap: anywhere }}
h2 {{ font-size: 18px; margin: 28px 0 8px; border-bottom: 1px solid #ccc }}
h3 {{ font-size: 14px; margin: 0 }}
.facts, small, figcaption {{ color: #555 }}
.charts {{ display: grid; grid-template-columns: repeat(auto-fill, minmax(440px, 1fr)); gap: 18px }}
figure {{ margin: 0; break-inside: avoid }}
svg {{ max-width: 100%; height: auto; font: 12px system-ui, sans-serif; fill: #333 }}
svg .end {{ text-anchor: end }} svg .middle {{ text-anchor: middle }}
svg .grid {{ stroke: #e4e4e4 }} svg .dots {{ stroke-width: 4; stroke-linecap: round; fill: none }}
svg .line {{ fill: none; stroke-width: 1.6 }} svg .bar {{ stroke-width: 1.6 }}
svg .scale {{ stroke: #333; stroke-width: 1.5 }}
table {{ border-collapse: collapse; width: 100%; margin: 6px 0 }}
td, th {{ text-align: left; padding: 3px 10px 3px 0; border-bottom: 1px solid #eee; vertical-align: top;
  overflow-wrap: break-word }}
.long {{ overflow-wrap: anywhere; min-width: 12ch }}
.better {{ color: #007a5a; font-weight: 600 }} .worse {{ color: #c04a00; font-weight: 600 }}
.box {{ border-left: 5px solid #009e73; background: #f3faf7; padding: 8px 14px; margin: 12px 0 }}
.alarm {{ border-color: #d55e00; background: #fdf3ec }}
.unknown {{ border-color: #888; background: #f4f4f4 }}
.key {{ display: inline-block; margin-right: 16px; overflow-wrap: anywhere }}
.key i {{ display: inline-block; width: 11px; height: 11px; border-radius: 6px; margin-right: 5px }}
ul {{ margin: 4px 0; padding-left: 20px }}
@media print {{ body {{ margin: 0; max-width: none; font-size: 12px }} h2 {{ break-after: avoid }}
  details:not([open]) {{ display: none }} }}
</style></head><body>
{body}
</body></html>
"""


def report_html(study: Study, person: str | None = None, *, today: datetime.date | None = None) -> str:
    """The page.

    Parameters
    ----------
    person : None for everybody.
    today : the day that the page names.

    Raises
    ------
    ConfigurationError : nobody of that name.
    """
    if person is not None:
        check_there(study, person)
    with study.snapshot():
        drawn = _drawn(quantities(study, person))
        means = session_means(study, drawn, person)
        body = _one(study, person, means) if person is not None else _everybody(study, means)
        body += _safety_details(study, person)
    day = (today or datetime.date.today()).isoformat()
    points = "trials" if person is not None else "sessions of one person each"
    foot = (
        f"<p><small>rehab_opt {escaped(__version__)}, {day}. Research software, not a medical device. Points are "
        f"{points}, lines join means, bars are 95 % confidence intervals of the mean (Student's t, not "
        "corrected for many comparisons).</small></p>"
    )
    return PAGE.format(title=escaped(person or study.file.name), body=body + foot)


def write_pdf(page: Path, pdf: Path) -> None:
    """Print a page by a browser that is installed, without a network.

    Raises
    ------
    ConfigurationError : there is none, or it does not print.
    """
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        raise ConfigurationError("--pdf", str(pdf), f"one of {', '.join(BROWSERS)} on this machine, to print the page")
    root = ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []
    with tempfile.TemporaryDirectory() as profile:  # what the browser remembers of the page goes with it
        made = Path(profile) / "report.pdf"
        command = [browser, "--headless=new", *root, f"--user-data-dir={profile}", "--no-pdf-header-footer"]
        command += ["--disable-gpu", f"--print-to-pdf={made}", page.resolve().as_uri()]
        try:
            subprocess.run(command, check=True, capture_output=True, timeout=120)
            made.chmod(0o600)
            shutil.copy(made, pdf)
        except (OSError, subprocess.SubprocessError) as problem:
            raise ConfigurationError(
                "--pdf", str(pdf), f"a page that {browser} prints ({type(problem).__name__})"
            ) from problem


def _drawn(known: Sequence[Quantity]) -> list[Quantity]:
    """The measures to draw, best known first."""
    order = list(PLAIN)
    found = sorted((each for each in known if _plain(each) is not None), key=lambda each: order.index(_key(each)))
    return (found or list(known))[:MAX_DRAWN]


def _key(of: Quantity) -> str:
    return of.name.rpartition(".")[2]


def _plain(of: Quantity) -> Plain | None:
    return PLAIN.get(_key(of))


def _limits(of: Quantity) -> tuple[float, float]:
    """Values that a measure may have: no movement has fewer than one velocity peak."""
    plain = _plain(of)
    return (plain.least, plain.most) if plain else (-math.inf, math.inf)


def _possible(of: Interval, measure: Quantity, factor: float = 1.0) -> Interval:
    """An interval within the values that its measure may have."""
    low, high = (factor * limit for limit in _limits(measure))
    if not low <= of.mean <= high:
        return of
    return of._replace(lower=max(of.lower, low), upper=min(of.upper, high)) if math.isfinite(of.lower) else of


def _better(of: Quantity) -> int:
    plain = _plain(of)
    return plain.better if plain else 0


def _scale(of: Quantity) -> tuple[float, str]:
    """Factor to the unit in which a measure is shown, and that unit."""
    return SCALES.get(of.unit, (1.0, of.unit))


def _titled(of: Quantity) -> str:
    """In plain words, with the unit in which it is shown."""
    unit = _scale(of)[1]
    return f"{_title(of)} [{unit}]" if unit else _title(of)


def _title(of: Quantity) -> str:
    plain = _plain(of)
    if plain is None:
        return of.name
    inside = of.name.removesuffix(_key(of)).strip(".").replace(".", ", ")
    return f"{plain.words} ({inside})" if inside else plain.words


def _one(study: Study, person: str, means: dict[Quantity, list[SessionMean]]) -> str:
    mine = next(each for each in people(study) if each.name == person)
    said = [f"group {mine.group}"] if mine.group else []
    said += [_count(mine.sessions, "session"), _count(mine.trials, "trial")] + (
        [f"last on {mine.last}"] if mine.last else []
    )
    parts = [f"<h1>{escaped(person)}</h1><p class=facts>{escaped(', '.join(said))}</p>", _safety_box(study, person)]
    changes = [row for measure, of in means.items() for row in _changes(measure, of)]
    if changes:
        conditions = any(row[1] != NAMED_CONDITION for row in changes)
        head = [
            "measure",
            *(["condition"] if conditions else []),
            "first session with it",
            "last session with it",
            "change",
        ]
        rows = [row if conditions else [row[0], *row[2:]] for row in changes]
        parts.append(f"<h2>From the first session to the last</h2>{_table(head, rows)}")
    parts.append(_progress(means, single=True))
    shapes = outlines(study, person)
    if shapes:
        pictures = [(f"{each.session}{f', {each.date}' if each.date else ''}", each.points) for each in shapes]
        first, last = pictures[0][0], pictures[-1][0]
        ends = f"{first} (orange) to {last} (blue)" if len(pictures) > 1 else first
        parts.append(
            f"<h2>Ground that the hand covered</h2><figure>{outline_chart(pictures)}"
            f"<figcaption>Convex outline of each session, {escaped(ends)}; seen along the smallest extent."
            "</figcaption></figure>"
        )
    return "".join(parts) + _extremes(study, means, person)


def _everybody(study: Study, means: dict[Quantity, list[SessionMean]]) -> str:
    all_of = overview(study)
    days = f", {all_of.first} to {all_of.last}" if all_of.first else ""
    failed = f"; {_count(all_of.failed, 'trial')} not done" if all_of.failed else ""
    counts = ((all_of.people, "person"), (all_of.sessions, "session"), (all_of.trials, "trial"))
    said = ", ".join(_count(*each) for each in counts) + failed + days
    parts = [f"<h1>{escaped(study.file.name)}</h1><p class=facts>{escaped(said)}</p>", _safety_box(study, None)]
    parts += [
        _progress(means, single=False),
        _growth(study),
        _trends(means),
        _contrasts(means),
        _extremes(study, means, None),
    ]
    rows: list[Sequence[object]] = [
        [each.name, each.group or "-", each.sessions, each.trials, each.last or "-"] for each in people(study)
    ]
    listed = _table(["person", "group", "sessions", "trials", "last day"], rows)
    return (
        "".join(parts) + f"<h2>People</h2><details><summary>{_count(len(rows), 'person')}</summary>{listed}</details>"
    )


def _progress(means: dict[Quantity, list[SessionMean]], *, single: bool) -> str:
    """A chart of each measure over the sessions, under each condition."""
    charts = []
    groups = {each.group for of in means.values() for each in of}
    alone = single or len(groups) == 1

    def series_of(each: SessionMean) -> str:
        return _condition(each) if alone else f"{each.group or '-'}, {_condition(each)}"

    weeks = None if single else _weeks(means)
    names = sorted({series_of(each) for of in means.values() for each in of})
    shown, hidden = names[:MAX_CONDITIONS], names[MAX_CONDITIONS:]
    for measure, of in means.items():
        factor, unit = _scale(measure)
        places: dict[float, str] = {}
        dated = single and all(each.date for each in of)
        values: dict[str, dict[float, list[float]]] = {name: defaultdict(list) for name in names}
        for each in of:
            if dated:
                x, label = float(datetime.date.fromisoformat(each.date or "").toordinal()), each.date or ""
            elif weeks is not None:
                x, label = weeks(each), f"{weeks(each):.0f}"
            else:
                x, label = float(each.order), each.session if single else str(each.order + 1)
            places[x] = label
            values[series_of(each)][x] += [factor * value for value in each.values or (each.of.mean,)]
        series = []
        for name in shown:
            points = [(x, value) for x, ys in values[name].items() for value in ys]
            means_at = [(x, _possible(interval(ys), measure, factor)) for x, ys in sorted(values[name].items())]
            series.append(Series(name, points, means_at))
        if not places:
            continue
        better = {1: "more is better", -1: "less is better"}.get(_better(measure), "")
        chart = progress_chart(series, sorted(places.items()))
        title = f"<h3>{escaped(_title(measure))} <small>{escaped(', '.join(filter(None, (unit, better))))}</small></h3>"
        charts.append(f"<figure>{title}{chart}</figure>")
    if not charts:
        return "<p>No measures.</p>"
    keys = "".join(
        f'<span class=key><i style="background:{COLOURS[i]}"></i>{escaped(name)}</span>' for i, name in enumerate(shown)
    )
    legend = f"<p>{keys}</p>" if names != [NAMED_CONDITION] else ""
    more = f"<p><small>Not drawn: {escaped(', '.join(hidden))}</small></p>" if hidden else ""
    along = "sessions, counted from 1" if weeks is None else "weeks from their first day"
    axis = "" if single else f"<p><small>Along x: the person's {along}.</small></p>"
    return f"<h2>Progress</h2>{legend}<div class=charts>{''.join(charts)}</div>{more}{axis}"


def _growth(study: Study) -> str:
    """Of each group the ground that its people's hands covered at first and at last."""
    figures = []
    for group, grown in growth(study, most=MAX_OUTLINED).items():
        outlines_of = [(name, hull(first), hull(last)) for name, first, last in grown]
        first = interval([1e4 * area(corners) for _, corners, _ in outlines_of])
        last = interval([1e4 * area(corners) for *_, corners in outlines_of])
        figures.append(
            f"<figure><h3>{escaped(group or 'no group')}</h3>{growth_chart(outlines_of)}"
            f"<figcaption>{_count(len(grown), 'person')}: {_said(first, 1.0)} cm² at first, {_said(last, 1.0)} cm² at "
            "last</figcaption></figure>"
        )
    if not figures:
        return ""
    note = (
        "<p><small>Convex outlines of each person's first session (orange) and last one (blue), laid over one "
        f"another by the middle of the first; of {MAX_OUTLINED} people of a group at most.</small></p>"
    )
    return f"<h2>Ground that hands covered</h2><div class=charts>{''.join(figures)}</div>{note}"


def _weeks(means: dict[Quantity, list[SessionMean]]) -> Callable[[SessionMean], float] | None:
    """Weeks from a person's first day on, where every session has a day and one person at least comes for weeks."""
    days: dict[str, list[int]] = defaultdict(list)
    for each in (each for of in means.values() for each in of):
        if each.date is None:
            return None
        days[each.person].append(datetime.date.fromisoformat(each.date).toordinal())
    first = {person: min(of) for person, of in days.items()}
    if not any(max(of) - min(of) >= DAYS_OF_A_WEEK for of in days.values()):
        return None

    def weeks(of: SessionMean) -> float:
        day = datetime.date.fromisoformat(of.date or "").toordinal()
        return float(round((day - first[of.person]) / DAYS_OF_A_WEEK))

    return weeks


def _changes(measure: Quantity, means: Sequence[SessionMean]) -> Iterable[list[object]]:
    """Of each condition a row: first session, last session, and whether what lies between is a clear change.

    From four sessions on it is where the interval of the slope through their means leaves out zero, else
    where the intervals of first and last mean are apart.
    """
    factor, unit = _scale(measure)
    for name, part in grouped(means, _condition).items():
        first, last = part[0].of, part[-1].of
        if len(part) < 2:
            continue
        if len(part) >= FEWEST_FOR_A_TREND:
            line = trend([each.of.mean for each in part])
            clear, up = line.lower > 0 or line.upper < 0, line.mean > 0
        else:
            clear, up = first.upper < last.lower or last.upper < first.lower, last.mean > first.mean
        way = _better(measure) * (1 if up else -1)
        verdict = {1: BETTER, -1: WORSE, 0: "changed"}[way] if clear else "no clear change"
        if len(part) < FEWEST_FOR_A_TREND and min(first.n, last.n) < 2:
            verdict = "too few trials to compare"
        ends = (f"{number(factor * of.mean)} {unit}" for of in (first, last))
        yield [_title(measure), name, *ends, verdict]


def _trends(means: dict[Quantity, list[SessionMean]]) -> str:
    rows = []
    for measure, of in means.items():
        factor = _scale(measure)[0]
        title = _titled(measure)
        for (group, name), part in grouped(of, lambda each: (each.group or "-", _condition(each))).items():
            over, change = (interval(list(each(part).values())) for each in (of_people, slopes))
            over = _possible(over, measure)
            rows.append([title, group, name, over.n, _said(over, factor), _said(change, factor)])
            title = ""
    head = ["measure", "group", "condition", "people", "mean (95 % interval)", "change a session (95 % interval)"]
    note = "<p><small>Each person counts once: mean of their sessions, slope of their own straight line.</small></p>"
    return f"<h2>Groups and conditions</h2>{_table(head, rows)}{note}"


def _contrasts(means: dict[Quantity, list[SessionMean]]) -> str:
    """Of people who had two conditions, how much these differ within them."""
    rows = []
    for measure, of in means.items():
        own = {name: of_people(part) for name, part in grouped(of, _condition).items()}
        for first, second in pairwise(own):
            both = own[first].keys() & own[second].keys()
            if both:
                less = interval([own[second][person] - own[first][person] for person in sorted(both)])
                rows.append([_titled(measure), f"{second} less {first}", less.n, _said(less, _scale(measure)[0])])
    if not rows:
        return ""
    return (
        f"<h2>Conditions within people</h2>{_table(['measure', 'difference', 'people', 'mean (95 % interval)'], rows)}"
    )


def _extremes(study: Study, means: dict[Quantity, list[SessionMean]], person: str | None) -> str:
    rows = []
    for measure in means:
        better = _better(measure)
        if better:
            least, most = _limits(measure)
            ends = [
                extreme(study, measure, largest=way * better > 0, person=person, least=least, most=most)
                for way in (1, -1)
            ]
            rows.append([_titled(measure), *(_where(end, _scale(measure)[0], person) for end in ends)])
    return f"<h2>Best and worst trial</h2>{_table(['measure', 'best', 'worst'], rows)}" if rows else ""


def _where(end: Extreme | None, factor: float, person: str | None) -> str:
    if end is None:
        return "-"
    parts = [*([] if person else [end.person]), end.session, end.date, f"trial {end.trial}", end.condition]
    return f"{number(factor * end.value)} ({', '.join(filter(None, parts))})"


def _safety_box(study: Study, person: str | None) -> str:
    """Events and bounds in a line: green only where bounds are known, and all of them were kept."""
    found, limits, (stating, trials) = events(study, person), bounds(study, person), stating_safety(study, person)
    passed = sum(each.passed for each in limits)
    if not found and not limits:
        kind, said = " unknown", "Nothing is known: no trial states a bound or a safety event"
    else:
        kind = " alarm" if found or passed else ""
        of = len({(each.person, each.session, each.trial) for each in found})
        said = f"{_count(len(found), 'event')} in {_count(of, 'trial')}" if found else "No safety events"
        kept = "every bound was kept" if not passed else f"a bound was passed {_count(passed, 'time')}"
        said += f"; {kept}" if limits else "; no bounds are known"
        said += f"; nothing is known of {trials - stating} of {_count(trials, 'trial')}" if stating < trials else ""
    return f'<div class="box{kind}"><b>Safety.</b> {escaped(said)}.</div>'


def _safety_details(study: Study, person: str | None) -> str:
    parts = []
    limits = bounds(study, person)
    if limits:
        drawn = bars((each.name, each.value / each.bound) for each in limits[:12])
        head = ["what", "nearest to its bound", "bound", "trials that passed it"]
        nearest: list[Sequence[object]] = [
            [name, f"{number(value)} {unit}", f"{number(bound)} {unit}", f"{over} of {count}"]
            for name, value, bound, unit, over, count in limits
        ]
        parts.append(f"<h2>Forces and other bounds</h2><figure>{drawn}</figure>{_table(head, nearest)}")
    found = events(study, person)
    if found:
        kinds: dict[tuple[str, str], list[tuple[str, float]]] = defaultdict(list)
        for name, _, _, _, text, times, unit in found:
            kinds[text, unit].append((name, times))
        rows: list[Sequence[object]] = [
            [text, len(of), len({name for name, _ in of}), f"{number(max(times for _, times in of))} {unit}"]
            for (text, unit), of in sorted(kinds.items(), key=lambda item: -len(item[1]))
        ]
        parts.append(f"<h2>Safety events</h2>{_table(['what', 'trials', 'people', 'most in one trial'], rows)}")
        each = [
            [*([] if person else [name]), session, date or "-", trial, text, f"{number(times)} {unit}"]
            for name, session, date, trial, text, times, unit in found
        ]
        head = [*([] if person else ["person"]), "session", "day", "trial", "what", "how often"]
        opened = " open" if len(each) <= 40 else ""
        parts.append(f"<details{opened}><summary>Every event</summary>{_table(head, each)}</details>")
    return "".join(parts)


def _table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    top = "".join(f"<th>{escaped(cell)}</th>" for cell in head)
    body = "".join(f"<tr>{''.join(map(_cell, row))}</tr>\n" for row in rows)
    return f"<table><tr>{top}</tr>\n{body}</table>"


def _cell(cell: object) -> str:
    text = str(cell)
    long = "long" if any(len(word) > LONGEST_WORD for word in text.split()) else ""
    kind = text if text in (BETTER, WORSE) else long
    return f'<td class="{kind}">{escaped(text)}</td>' if kind else f"<td>{escaped(text)}</td>"


def _condition(of: SessionMean) -> str:
    return of.condition or NAMED_CONDITION


def _said(of: Interval, factor: float) -> str:
    if not of.n:
        return "-"
    if of.n < 2:
        return f"{number(factor * of.mean)} (one value)"
    mean, lower, upper = (number(factor * end, within=factor * (of.upper - of.lower)) for end in of[:3])
    return f"{mean} ({lower} to {upper})"


def _count(count: int, what: str) -> str:
    return f"{count} {what}" if count == 1 else f"{count} {'people' if what == 'person' else what + 's'}"
