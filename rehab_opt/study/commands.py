"""The commands `rehab-opt study list | show | compare | export | remove` and `rehab-opt report`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rehab_opt.errors import ConfigurationError, printable
from rehab_opt.terminal import no_folder, one_of, printer, say, undisturbed, writable

if TYPE_CHECKING:
    from rehab_opt.study.store import Study
    from rehab_opt.study.summary import Interval

__all__ = ["app", "report"]

app = typer.Typer(help="Show, export or remove the people of a study, a folder of trials.", no_args_is_help=True)

StudyFolder = Annotated[Path, typer.Argument(metavar="STUDY", help="Folder of the study.")]
Somebody = Annotated[str | None, typer.Option("--person", help="Only this person; default: all people.")]
MAX_LISTED = 40
"""Largest number of measures printed in a terminal; `export` writes all measures."""


@app.command(name="list")
def list_people(study: StudyFolder) -> None:
    """Print all people of a study: group, numbers of sessions and trials, last day."""
    from rehab_opt.study.summary import people  # noqa: PLC0415

    with _open(study) as store:
        for name, group, sessions, trials, last in people(store):
            say("  ".join((name, group or "-", f"{sessions} sessions", f"{trials} trials", last or "-")))


@app.command()
def show(study: StudyFolder, person: Somebody = None) -> None:
    """Print the size of a study; for one person, the sessions and the measures of the first and last session."""
    from rich.table import Table  # noqa: PLC0415

    from rehab_opt.study.summary import check_there, interval, overview, quantities, session_means, sessions  # noqa: PLC0415

    with _open(study) as store, store.refusals(), store.transaction("DEFERRED"):
        if person is None:
            everybody, visits, trials, failed, first, last = overview(store)
            say(f"{everybody} people, {visits} sessions, {trials} trials{f', {first} to {last}' if first else ''}")
            if failed:
                say(f"{failed} trials are not done")
            known = [each.label for each in quantities(store)]
            say(f"measures: {', '.join(known[:MAX_LISTED])}{', ...' if len(known) > MAX_LISTED else ''}")
            return
        check_there(store, person)
        table = Table("session", "visit", "day", "condition", "trials", "not done")
        for row in sessions(store, person):
            table.add_row(*("-" if each is None else str(each) for each in row))
        numbers = Table("measure", "condition", "first session with it", "last session with it")
        for each, means in session_means(store, quantities(store, person)[:MAX_LISTED], person).items():
            for condition in dict.fromkeys(mean.condition for mean in means):
                under = [interval(mean.values) for mean in means if mean.condition == condition]
                numbers.add_row(each.label, condition or "-", _written(under[0]), _written(under[-1]))
        printer().print(table, numbers)


@app.command()
def compare(
    study: StudyFolder,
    measure: Annotated[str, typer.Option(help="Name of a measure, as in `show`.")],
    person: Somebody = None,
) -> None:
    """Compare a measure between groups and conditions: means and trends over people, each counted once."""
    from rich.table import Table  # noqa: PLC0415

    from rehab_opt.study import summary  # noqa: PLC0415

    with _open(study) as store, store.refusals(), store.transaction("DEFERRED"):
        if person is not None:
            summary.check_there(store, person)
        chosen = summary.quantity(store, measure)
        means = summary.session_means(store, [chosen], person)[chosen]
    table = Table("group", "condition", "people", "mean (95 % interval)", "change per session (95 % interval)")
    by = summary.grouped(means, lambda each: (each.group or "-", each.condition or "-"))
    for (group, condition), part in by.items():
        over, change = (summary.interval([*each(part).values()]) for each in (summary.of_people, summary.slopes))
        table.add_row(group, condition, str(over.n), _written(over), _written(change))
    console = printer()
    console.print(chosen.label, highlight=False)
    console.print(table)


@app.command()
def export(
    study: StudyFolder,
    out: Annotated[Path, typer.Option(help="Folder of the files, new or empty.")],
    person: Somebody = None,
    format: Annotated[str, typer.Option("--format", help="csv; or parquet, in addition to csv.")] = "csv",
) -> None:
    """Write all measures to measures.csv, one value per row; for one person, also copy the person's folder."""
    from rehab_opt.study.person import exported  # noqa: PLC0415

    one_of("--format", format, ("csv", "parquet"))
    with _open(study) as store:
        written = exported(store, person, out, parquet=format == "parquet")
    say(f"written to {out}: {len(written)} files")


@app.command()
def remove(
    study: StudyFolder,
    person: Annotated[str, typer.Option("--person", help="Person whose sessions, trials and traces are deleted.")],
    yes: Annotated[bool, typer.Option("--yes", help="Delete without asking.")] = False,
) -> None:
    """Delete a person's folder and results in other folders, and all exports and reports that include the person."""
    from rehab_opt.study.person import removed  # noqa: PLC0415

    with _open(study) as store:
        if not yes and not typer.confirm(f"delete everything of {person!r}?"):
            raise typer.Exit(1)
        with undisturbed():
            kept, others = removed(store, person)
    say(f"{person} is deleted")
    for path in others:
        say(f"- also deleted, since it covers all people; write it again: {path}")
    for path in kept:
        say(f"- a recording of theirs stays, since it is not part of the study: {path}")


def report(
    study: StudyFolder,
    person: Somebody = None,
    out: Annotated[
        Path | None, typer.Option(help="File of the page; default: STUDY-report.html or STUDY-PERSON-report.html.")
    ] = None,
    pdf: Annotated[Path | None, typer.Option(help="Also print the page to this .pdf, with chromium.")] = None,
) -> None:
    """Write a report of a study or of one person as an HTML page: progress, workspace, best trials, forces, safety."""
    from rehab_opt.study.person import note_written  # noqa: PLC0415
    from rehab_opt.study.report import report_html, write_pdf  # noqa: PLC0415
    from rehab_opt.study.store import private  # noqa: PLC0415

    page = (
        out
        if out is not None
        else study.parent / f"{'-'.join(filter(None, (study.resolve().name, person)))}-report.html"
    )
    taken = set[Path]()
    for argument, file in (("--out", page), ("--pdf", pdf)):
        if file is None:
            continue
        no_folder(file, argument=argument)
        if file.resolve() in taken or study.resolve() in file.resolve().parents:
            raise ConfigurationError(argument, str(file), "a file outside the study that is not the page")
        taken.add(file.resolve())
        writable(file.parent, argument=argument)
    with _open(study) as store:
        text = report_html(store, person)
        note_written(store, taken, person)
    with undisturbed():
        page.parent.mkdir(parents=True, exist_ok=True)
        private(page, text)
        if pdf is not None:
            write_pdf(page, pdf)
    say(f"written to {page}{f' and {pdf}' if pdf else ''}")


def _open(study: Path) -> Study:
    from rehab_opt.study.store import Study  # noqa: PLC0415

    try:
        opened = Study(study, create=False)
    except ConfigurationError as refused:
        raise ConfigurationError("STUDY", refused.value, refused.expected) from refused
    for each in opened.bad():
        print(printable(f"rehab-opt: not read: {each}"), file=sys.stderr)
    return opened


def _written(of: Interval) -> str:
    if not of.n:
        return "-"
    if of.n < 2:
        return f"{of.mean:.4g} (one value)"
    return f"{of.mean:.4g} ({of.lower:.4g} to {of.upper:.4g}; {of.n})"
