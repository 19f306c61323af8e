"""Report of a study, or of one person in a study, as one HTML page without scripts and external files."""

from __future__ import annotations

import datetime
import math
import os
import shutil
import subprocess
import tempfile
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from rehab_opt.errors import ConfigurationError, printable
from rehab_opt.study import summary
from rehab_opt.study.figures import COLOURS, FIRST, LAST, outline_figure, progress_figure
from rehab_opt.study.store import Study
from rehab_opt.study.summary import Interval, Quantity, SessionMean, grouped, interval
from rehab_opt.version import __version__

__all__ = ["report_html", "write_pdf"]


class Plain(NamedTuple):
    """A measure in plain words, its better direction (1 larger, -1 smaller, 0 neither), and its possible range."""

    words: str
    better: int = 0
    least: float = -math.inf
    most: float = math.inf


PLAIN = {
    "success": Plain("Trials that succeeded", 1, 0.0, 1.0),
    "movement_time": Plain("Movement time", -1, 0.0),
    "time_to_target": Plain("Time to the target", -1, 0.0),
    "end_error": Plain("Distance from the target at the end", -1, 0.0),
    "final_distance": Plain("Distance from the target at the end", -1, 0.0),
    "deviation_mean": Plain("Deviation from the path", -1, 0.0),
    "path_ratio": Plain("Path of the hand over the straight line", -1, 1.0),
    "path_length_ratio": Plain("Path of the hand over the straight line", -1, 1.0),
    "sparc": Plain("Smoothness (SPARC, nearer 0 is smoother)", 1, most=0.0),
    "smoothness_sparc": Plain("Smoothness (SPARC, nearer 0 is smoother)", 1, most=0.0),
    "velocity_peaks": Plain("Velocity peaks", -1, 1.0),
    "speed_peak": Plain("Peak speed", 0, 0.0),
    "workspace_area": Plain("Workspace used", 1, 0.0),
    "workspace_volume": Plain("Workspace used", 1, 0.0),
    "area": Plain("Workspace in reach", 1, 0.0),
}
"""Measures in a report, in their order; other measures are drawn only if a study has none of these."""
SCALES = {"m": (1e3, "mm"), "m^2": (1e4, "cm²"), "m^3": (1e6, "cm³"), "m/s": (1e3, "mm/s"), "1": (1.0, "")}
MAX_DRAWN = 8
MAX_OUTLINED = 40
"""Largest number of drawn outlines of a group; more outlines would hide one another."""
DAYS_OF_A_WEEK = 7
FEWEST_FOR_A_TREND = 4
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
Means = Mapping[Quantity, Sequence[SessionMean]]


def report_html(study: Study, person: str | None = None, *, today: datetime.date | None = None) -> str:
    """The report as HTML.

    Parameters
    ----------
    study : an open study. person : None for all people.
    today : date on the page, by default the current one.

    Raises
    ------
    ConfigurationError : the person is unknown.
    """
    import jinja2  # noqa: PLC0415

    if person is not None:
        summary.check_there(study, person)
    # Unprintable characters and HTML in a study's texts are escaped.
    pages = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent), autoescape=True, undefined=jinja2.StrictUndefined,
        finalize=lambda text: printable(text) if type(text) is str else text, trim_blocks=True,
    )  # fmt: skip
    with study.transaction("DEFERRED"):
        known = summary.quantities(study, person)
        drawn = sorted((each for each in known if _key(each) in PLAIN), key=lambda each: [*PLAIN].index(_key(each)))
        means = summary.session_means(study, (drawn or known)[:MAX_DRAWN], person, lambda each: _plain(each)[2:])
        content = {
            "title": person or study.folder.name, "everybody": person is None, "version": __version__,
            "day": (today or datetime.date.today()).isoformat(), "unread": study.bad() if person is None else [],
            "facts": _facts(study, person), "safety": _safety(study, person), **_charts(means, single=bool(person)),
            "changes": _changes(means if person else {}), "ground": [*_ground(study, person)],
            "trends": _trends({} if person else means), "contrasts": _contrasts({} if person else means),
            "extremes": _extremes(study, means, person), "people": _people(study, person), **_bounds(study, person),
        }  # fmt: skip
    return pages.get_template("report.html.j2").render(content)


def write_pdf(page: Path, pdf: Path) -> None:
    """Print a page to PDF with an installed browser.

    Raises
    ------
    ConfigurationError : there is no browser, or the browser cannot print the page.
    """
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        raise ConfigurationError("--pdf", str(pdf), f"one of {', '.join(BROWSERS)} on this machine, to print the page")
    root = ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []
    with tempfile.TemporaryDirectory() as profile:  # the browser's cache of the page is deleted, too
        made = Path(profile) / "report.pdf"
        command = [browser, "--headless=new", *root, f"--user-data-dir={profile}", "--no-pdf-header-footer"]
        command += ["--disable-gpu", f"--print-to-pdf={made}", page.resolve().as_uri()]
        try:
            subprocess.run(command, check=True, capture_output=True, timeout=120)
            made.chmod(0o600)
            shutil.copy(made, pdf)
        except (OSError, subprocess.SubprocessError) as problem:
            expected = f"a page that {browser} prints ({type(problem).__name__})"
            raise ConfigurationError("--pdf", str(pdf), expected) from problem


def _key(of: Quantity) -> str:
    return of.name.rpartition(".")[2]


def _plain(of: Quantity) -> Plain:
    return PLAIN.get(_key(of), Plain(of.name))


def _possible(of: Interval, measure: Quantity, factor: float = 1.0) -> Interval:
    """A confidence interval, cut to the possible values of its measure."""
    low, high = (factor * limit for limit in _plain(measure)[2:])
    if not low <= of.mean <= high or math.isnan(of.lower):
        return of
    return of._replace(lower=max(of.lower, low), upper=min(of.upper, high))


def _scale(of: Quantity) -> tuple[float, str]:
    """Two results: the factor from a measure's unit to its displayed unit, and the displayed unit."""
    return SCALES.get(of.unit, (1.0, of.unit))


def _title(of: Quantity, *, unit: bool = False) -> str:
    """Title of a measure in plain words, with the measured object and the displayed unit."""
    inside = of.name.removesuffix(_key(of)).strip(".").replace(".", ", ") if _key(of) in PLAIN else ""
    title = f"{_plain(of).words} ({inside})" if inside else _plain(of).words
    return f"{title} [{_scale(of)[1]}]" if unit and _scale(of)[1] else title


def _table(head: str, rows: Iterable[Sequence[object]]) -> dict[str, Any]:
    """A table with the comma-separated column names in `head`; a dash stands for a missing cell."""
    return {"head": head.split(", "), "rows": [["-" if cell is None else cell for cell in row] for row in rows]}


def _facts(study: Study, person: str | None) -> str:
    if person is not None:
        ((_, group, sessions, trials, last),) = summary.people(study, person)
        facts = [group and f"group {group}", _count(sessions, "session"), _count(trials, "trial")]
        return ", ".join(filter(None, (*facts, last and f"last on {last}")))
    *counts, failed, first, last = summary.overview(study)
    facts = [_count(*each) for each in zip(counts, ("person", "session", "trial"), strict=True)]
    facts += [f"{_count(failed, 'trial')} not done"] if failed else []
    return ", ".join(facts + ([f"{first} to {last}"] if first else []))


def _changes(means: Means) -> dict[str, Any]:
    """Table of the first and last session by measure and condition, and whether the change is clear.

    A change is clear if the confidence interval of the slope excludes zero; with fewer than four sessions, if the
    intervals of the first and last mean do not overlap.
    """
    rows = []
    for measure, of in means.items():
        factor, unit = _scale(measure)
        for name, part in grouped(of, _condition).items():
            if len(part) < 2:
                continue
            ends = [interval(each.values) for each in (part[0], part[-1])]
            first, last = ends
            if len(part) >= FEWEST_FOR_A_TREND:
                line = summary.trend([each.mean for each in part])
                clear, up = line.lower > 0 or line.upper < 0, line.mean > 0
            else:
                clear, up = first.upper < last.lower or last.upper < first.lower, last.mean > first.mean
            verdict = ("changed", "better", "worse")[_plain(measure).better * (1 if up else -1)]
            if len(part) < FEWEST_FOR_A_TREND and min(first.n, last.n) < 2:
                verdict = "too few trials to compare"
            elif not clear:
                verdict = "no clear change"
            shown = (f"{_number(factor * each.mean)} {unit}".strip() for each in ends)
            rows.append([_title(measure), name, *shown, verdict])
    return _table("measure, condition, first session with it, last session with it, change", rows)


def _charts(means: Means, *, single: bool) -> dict[str, Any]:
    """Chart of each measure over the sessions, with a line for each condition and group."""
    every = [each for of in means.values() for each in of]
    alone = single or len({each.group for each in every}) == 1

    def series_of(each: SessionMean) -> str:
        return _condition(each) if alone else f"{each.group or '-'}, {_condition(each)}"

    weeks = None if single else _weeks(every)
    names = sorted({series_of(each) for each in every})
    drawn, charts = names[: len(COLOURS)], []
    for measure, of in means.items():
        factor, unit = _scale(measure)
        dated, labels = single and all(each.date for each in of), dict[float, str]()
        values: dict[str, dict[float, list[float]]] = {name: defaultdict(list) for name in names}
        for each in of:
            if dated:
                x, label = float(_day(each)), str(each.date)
            elif weeks is not None:
                x, label = weeks(each), f"{weeks(each):.0f}"
            else:
                x, label = float(each.order), each.session if single else str(each.order + 1)
            labels[x] = label
            values[series_of(each)][x] += [factor * value for value in each.values or (each.mean,)]
        if labels:
            points = {name: dict(sorted(values[name].items())) for name in drawn}
            middles = {
                name: {x: _possible(interval(ys), measure, factor) for x, ys in of.items()}
                for name, of in points.items()
            }
            better = {1: "more is better", -1: "less is better"}.get(_plain(measure).better, "")
            picture = progress_figure(points, middles, labels)
            said = ", ".join(filter(None, (unit, better)))
            charts.append({"title": _title(measure), "better": said, "picture": picture})
    along = "number of the person's session" if weeks is None else "weeks since the person's first session"
    keys = [] if names == ["all"] else [*zip(drawn, COLOURS, strict=False)]
    return {"charts": charts, "keys": keys, "hidden": names[len(COLOURS) :], "along": "" if single else along}


def _day(of: SessionMean) -> int:
    return datetime.date.fromisoformat(of.date or "").toordinal()


def _weeks(means: Sequence[SessionMean]) -> Callable[[SessionMean], float] | None:
    """Function that returns the weeks since a person's first session; None if dates are missing or span no week."""
    if not all(each.date for each in means):
        return None
    days: dict[str, list[int]] = defaultdict(list)
    for each in means:
        days[each.person].append(_day(each))
    first = {person: min(of) for person, of in days.items()}
    if not any(max(of) - min(of) >= DAYS_OF_A_WEEK for of in days.values()):
        return None
    return lambda each: float(round((_day(each) - first[each.person]) / DAYS_OF_A_WEEK))


def _ground(study: Study, person: str | None) -> Iterator[dict[str, str]]:
    """Figures of the areas that the hand covered: each session of a person, or first and last sessions of a group."""
    from shapely import MultiPoint  # noqa: PLC0415

    groups: dict[str, list[list[Any]]] = defaultdict(list)
    for (group, name), sessions in summary.ground(study, person).items():
        hulls = [MultiPoint(points).convex_hull for points in sessions.values()]
        if person is None:
            groups[group].append(hulls)
            continue
        shades = [(LAST, 0.2 + 0.4 * i / len(hulls)) for i in range(len(hulls))]
        shades[0], shades[-1] = (FIRST, 1.0), (LAST, 1.0)
        shapes = [(_corners(hull), *shade) for hull, shade in zip(hulls, shades, strict=True)]
        ends = [*dict.fromkeys((next(iter(sessions)), [*sessions][-1]))]
        yield {"title": name, "picture": outline_figure(shapes[1:] + shapes[:1]), "caption": " to ".join(ends)}
    for group, of in groups.items():
        sizes = [_said(interval([1e4 * hulls[i].area for hulls in of]), 1.0) for i in (0, 1)]
        shapes = [
            (_corners(hulls[i], hulls[0].centroid), (FIRST, LAST)[i], 0.5)
            for i in (1, 0)
            for hulls in of[:MAX_OUTLINED]
        ]
        caption = f"{_count(len(of), 'person')}: {sizes[0]} cm² at first, {sizes[1]} cm² at last; the centre of each "
        caption += f"person's first outline is at 0, 0; at most {MAX_OUTLINED} people are drawn"
        yield {"title": group, "picture": outline_figure(shapes), "caption": caption}


def _corners(of: Any, middle: Any = None) -> list[tuple[float, float]]:
    x0, y0 = (0.0, 0.0) if middle is None else (middle.x, middle.y)
    return [(x - x0, y - y0) for x, y in (of.exterior if hasattr(of, "exterior") else of).coords]


def _trends(means: Means) -> dict[str, Any]:
    rows = []
    for measure, of in means.items():
        factor, title = _scale(measure)[0], _title(measure, unit=True)
        for (group, name), part in grouped(of, lambda each: (each.group or "-", _condition(each))).items():
            over, change = (interval([*each(part).values()]) for each in (summary.of_people, summary.slopes))
            rows.append([title, group, name, over.n, _said(_possible(over, measure), factor), _said(change, factor)])
            title = ""
    return _table("measure, group, condition, people, mean (95 % interval), change per session (95 % interval)", rows)


def _contrasts(means: Means) -> dict[str, Any]:
    """Table of mean differences between two conditions; each difference is between results of the same person."""
    rows = []
    for measure, of in means.items():
        own = {name: summary.of_people(part) for name, part in grouped(of, _condition).items()}
        for first, second in pairwise(own):
            both = own[first].keys() & own[second].keys()
            if both:
                less = interval([own[second][person] - own[first][person] for person in sorted(both)])
                difference = f"{second} minus {first}"
                rows.append([_title(measure, unit=True), difference, less.n, _said(less, _scale(measure)[0])])
    return _table("measure, difference, people, mean (95 % interval)", rows)


def _extremes(study: Study, means: Means, person: str | None) -> dict[str, Any]:
    rows = []
    for measure in means:
        cells, values = [], set()
        for way in (1, -1) if _plain(measure).better else ():
            largest = way * _plain(measure).better > 0
            end = summary.extreme(study, measure, _plain(measure)[2:], largest=largest, person=person)
            if end is not None:
                who, session, day, number, condition, value = end
                where = ", ".join(filter(None, (None if person else who, session, day, f"trial {number}", condition)))
                cells.append(f"{_number(_scale(measure)[0] * value)} ({where})")
                values.add(value)
        rows += [[_title(measure, unit=True), *cells]] if len(values) > 1 else []
    return _table("measure, best, worst", rows)


def _people(study: Study, person: str | None) -> dict[str, Any]:
    return _table("person, group, sessions, trials, last day", summary.people(study) if person is None else ())


def _safety(study: Study, person: str | None) -> dict[str, str]:
    """One sentence on events and bounds; an alarm if there was an event or a value passed its bound."""
    found, limits = summary.events(study, person), summary.bounds(study, person)
    stating, trials = summary.stating_safety(study, person)
    passed = sum(over for *_, over, _ in limits)
    if not found and not limits:
        return {"kind": " unknown", "text": "Nothing is known: no trial states a bound or a safety event"}
    of = len({(who, session, number) for who, session, _, number, *_ in found})
    text = f"{_count(len(found), 'event')} in {_count(of, 'trial')}" if found else "No safety events"
    kept = "every bound was kept" if not passed else f"a bound was passed {_count(passed, 'time')}"
    text += f"; {kept}" if limits else "; no bounds are known"
    text += f"; nothing is known of {trials - stating} of {_count(trials, 'trial')}" if stating < trials else ""
    return {"kind": " alarm" if found or passed else "", "text": text}


def _bounds(study: Study, person: str | None) -> dict[str, Any]:
    """Three tables: the values that came closest to their bounds, the kinds of safety events, and all events."""
    limits, found = summary.bounds(study, person), summary.events(study, person)
    nearest = [
        [
            name,
            f"{_number(value)} {unit}",
            f"{_number(bound)} {unit}",
            f"{100 * value / bound:.0f} %",
            f"{over} of {count}",
        ]
        for name, value, bound, unit, over, count in limits
    ]
    kinds: dict[tuple[str, str], list[tuple[str, float]]] = defaultdict(list)
    for who, _, _, _, text, times, unit in found:
        kinds[text, unit].append((who, times))
    counted = [
        [text, len(of), len({name for name, _ in of}), f"{_number(max(times for _, times in of))} {unit}"]
        for (text, unit), of in sorted(kinds.items(), key=lambda item: -len(item[1]))
    ]
    every = [[*of[:5], f"{_number(of[5])} {of[6]}"][0 if person is None else 1 :] for of in found]
    head = "person, session, day, trial, event, count"
    return {
        "bounds": _table("quantity, closest value, bound, value / bound, trials beyond the bound", nearest),
        "kinds": _table("event, trials, people, largest count in a trial", counted),
        "events": _table(head if person is None else head.removeprefix("person, "), every),
    }


def _condition(of: SessionMean) -> str:
    return of.condition or "all"


def _number(value: float, *, within: float = 0.0) -> str:
    """Number with three significant digits, or more if needed to distinguish numbers that differ by `within`."""
    if not math.isfinite(value):
        return "-"
    figures = 3
    if 0 < within < abs(value):
        figures = min(max(3, 2 + math.ceil(math.log10(abs(value) / within))), 7)
    return f"{value:.{figures}g}" if not 1000 <= abs(value) < 1e6 else f"{value:.0f}"


def _said(of: Interval, factor: float) -> str:
    if of.n < 2:
        return f"{_number(factor * of.mean)} (one value)" if of.n else "-"
    mean, lower, upper = (_number(factor * end, within=factor * (of.upper - of.lower)) for end in of[:3])
    return f"{mean} ({lower} to {upper})"


def _count(count: int, what: str) -> str:
    return f"{count} {what}" if count == 1 else f"{count} {'people' if what == 'person' else what + 's'}"
