"""`rehab-opt study list | show | compare | export | remove`: what is in a study, and what leaves it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rehab_opt.errors import ConfigurationError
from rehab_opt.terminal import no_folder, one_of, printer, say, undisturbed, writable

if TYPE_CHECKING:
    from rehab_opt.study.store import Study
    from rehab_opt.study.summary import Interval, Quantity

__all__ = ["app", "report"]

app = typer.Typer(help="A study's people, sessions and trials, in one file.", no_args_is_help=True)

StudyFile = Annotated[Path, typer.Argument(metavar="STUDY", help="File of the study.")]
Somebody = Annotated[str | None, typer.Option("--person", help="One person; everybody by default.")]
MAX_LISTED = 40
"""Rows of a table that a terminal shows; all of them are in what `export` writes."""


@app.command(name="list")
def list_people(study: StudyFile) -> None:
    """Print everybody: group, sessions, trials, last day."""
    from rehab_opt.study.summary import people  # noqa: PLC0415

    with _open(study) as store:
        for each in people(store):
            parts = (each.group or "-", f"{each.sessions} sessions", f"{each.trials} trials", each.last or "-")
            say("  ".join((each.name, *parts)))


@app.command()
def show(study: StudyFile, person: Somebody = None) -> None:
    """Print how much there is; of one person the sessions, and their measures in the first and the last of them."""
    from rich.table import Table  # noqa: PLC0415

    from rehab_opt.study.person import check_there  # noqa: PLC0415
    from rehab_opt.study.summary import overview, quantities, session_means, sessions  # noqa: PLC0415

    with _open(study) as store, store.snapshot():
        if person is None:
            all_of = overview(store)
            days = f", {all_of.first} to {all_of.last}" if all_of.first else ""
            say(f"{all_of.people} people, {all_of.sessions} sessions, {all_of.trials} trials{days}")
            if all_of.failed:
                say(f"{all_of.failed} trials are not done")
            known = [f"{each.name} [{each.unit}]" if each.unit else each.name for each in quantities(store)]
            say(f"measures: {', '.join(known[:MAX_LISTED])}{', ...' if len(known) > MAX_LISTED else ''}")
            return
        check_there(store, person)
        table = Table("session", "visit", "day", "condition", "trials", "not done")
        for row in sessions(store, person):
            table.add_row(*("-" if each is None else str(each) for each in row))
        numbers = Table("measure", "condition", "first session with it", "last session with it")
        for each, means in session_means(store, quantities(store, person)[:MAX_LISTED], person).items():
            for condition in dict.fromkeys(mean.condition for mean in means):
                under = [mean.of for mean in means if mean.condition == condition]
                numbers.add_row(_label(each), condition or "-", _written(under[0]), _written(under[-1]))
        printer().print(table, numbers)


@app.command()
def compare(
    study: StudyFile,
    measure: Annotated[str, typer.Option(help="Name of a measure, as `show` says it.")],
    person: Somebody = None,
) -> None:
    """Compare a measure between groups and conditions: means over people, each counted once, and their trends."""
    from rich.table import Table  # noqa: PLC0415

    from rehab_opt.study.person import check_there  # noqa: PLC0415
    from rehab_opt.study.summary import grouped, interval, of_people, quantity, session_means, slopes  # noqa: PLC0415

    with _open(study) as store, store.snapshot():
        if person is not None:
            check_there(store, person)
        chosen = quantity(store, measure)
        means = session_means(store, [chosen], person)[chosen]
    table = Table("group", "condition", "people", "mean (95 % interval)", "change a session (95 % interval)")
    for (group, condition), part in grouped(means, lambda each: (each.group or "-", each.condition or "-")).items():
        over, change = (interval(list(each(part).values())) for each in (of_people, slopes))
        table.add_row(group, condition, str(over.n), _written(over), _written(change))
    console = printer()
    console.print(_label(chosen), highlight=False)
    console.print(table)


@app.command()
def export(
    study: StudyFile,
    out: Annotated[Path, typer.Option(help="Folder, new or empty.")],
    person: Somebody = None,
    format: Annotated[str, typer.Option("--format", help="csv, parquet.")] = "csv",
) -> None:
    """Write measures.csv in long format; of one person everything, their problems and traces too."""
    from rehab_opt.study.parquet import write_parquet  # noqa: PLC0415
    from rehab_opt.study.person import exported  # noqa: PLC0415

    one_of("--format", format, ("csv", "parquet"))
    with _open(study) as store:
        written = exported(store, person, out)
    if format == "parquet":
        written += (write_parquet(written[0]),)
    say(f"written to {out}: {len(written)} files")


@app.command()
def remove(
    study: StudyFile,
    person: Annotated[str, typer.Option("--person", help="Whose sessions, trials and traces are to be deleted.")],
    yes: Annotated[bool, typer.Option("--yes", help="Delete without a question.")] = False,
) -> None:
    """Delete one person from the study's file, which keeps no byte of them, and the traces that runs have written."""
    from rehab_opt.study.person import removed  # noqa: PLC0415

    with _open(study) as store:
        if not yes and not typer.confirm(f"delete everything of {person!r}?"):
            raise typer.Exit(1)
        with undisturbed():
            kept = removed(store, person)
    say(f"{person} is deleted")
    for path in kept:
        say(f"- a recording of theirs stays, it was not the study's: {path}")


def report(
    study: StudyFile,
    person: Somebody = None,
    out: Annotated[Path | None, typer.Option(help="The page; <study>-report.html by default.")] = None,
    pdf: Annotated[Path | None, typer.Option(help="The page as PDF, too; chromium prints it.")] = None,
) -> None:
    """Write a study, or one person of it, as one page: progress, workspace, best and worst trials, forces, safety."""
    from rehab_opt.study.person import private_text  # noqa: PLC0415
    from rehab_opt.study.report import report_html, write_pdf  # noqa: PLC0415

    page = out if out is not None else study.with_name(f"{study.stem}-report.html")
    taken = {study.resolve()}
    for argument, file in (("--out", page), ("--pdf", pdf)):
        if file is None:
            continue
        no_folder(file, argument=argument)
        if file.resolve() in taken:
            raise ConfigurationError(argument, str(file), "another file than the study, and than the page")
        taken.add(file.resolve())
        writable(file.parent, argument=argument)
    with _open(study) as store:
        text = report_html(store, person)
    with undisturbed():
        page.parent.mkdir(parents=True, exist_ok=True)
        private_text(page, text)
        if pdf is not None:
            write_pdf(page, pdf)
    say(f"written to {page}{f' and {pdf}' if pdf else ''}")


def _open(study: Path) -> Study:
    from rehab_opt.study.store import Study  # noqa: PLC0415

    try:
        return Study(study, create=False)
    except ConfigurationError as refused:
        raise ConfigurationError("STUDY", refused.value, refused.expected) from refused


def _label(quantity: Quantity) -> str:
    return f"{quantity.name} [{quantity.unit}]" if quantity.unit else quantity.name


def _written(of: Interval) -> str:
    if not of.n:
        return "-"
    if of.n < 2:
        return f"{of.mean:.4g} (one value)"
    return f"{of.mean:.4g} ({of.lower:.4g} to {of.upper:.4g}; {of.n})"
