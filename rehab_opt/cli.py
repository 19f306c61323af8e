"""The command `rehab-opt`: run, list and check problem files.

Bad input ends with one line on the error stream and exit code 2; nothing is written then.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rehab_opt.errors import ConfigurationError, RehabOptError

if TYPE_CHECKING:
    from rehab_opt.session.files import ProblemFile
    from rehab_opt.session.outcome import Outcome
    from rehab_opt.session.run import Law

__all__ = ["app", "main"]

app = typer.Typer(
    help="Controllers for rehabilitation and assistive robots, run on problem files. Research software, not a medical "
    "device.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)

Problem = Annotated[str, typer.Argument(metavar="FILE", help="A problem file, or the name of a shipped problem.")]


def main(arguments: list[str] | None = None) -> None:
    """Entry point; `arguments` default to those of the command line."""
    try:
        app(args=arguments)
    except RehabOptError as problem:
        line = "".join(letter if letter.isprintable() else " " for letter in str(problem))  # whatever a file name holds
        print(f"rehab-opt: {line}", file=sys.stderr)
        sys.exit(2)


@app.command()
def run(
    file: Problem,
    out: Annotated[Path | None, typer.Option(help="Folder of the result; ./out/<problem> by default.")] = None,
    solver: Annotated[str | None, typer.Option(help="Solver of the optimised law, instead of the file's.")] = None,
    law: Annotated[str, typer.Option(help="published, optimised or both.")] = "both",
) -> None:
    """Run a problem; print its table; write metrics.json, trace.csv and figures."""
    from rich.console import Console  # noqa: PLC0415  (each command loads what it uses)

    from rehab_opt.session.files import load_problem  # noqa: PLC0415
    from rehab_opt.session.report import checked_folder, write_report  # noqa: PLC0415
    from rehab_opt.session.table import result_table  # noqa: PLC0415

    loaded = load_problem(file)
    folder = checked_folder(out if out is not None else Path("out") / loaded.name)
    outcome = _run_with_progress(loaded, law=_law(law), solver=solver)
    written = write_report(outcome, folder)
    console = Console()
    console.print(result_table(outcome))
    for note in outcome.notes:
        console.print(f"- {note}", highlight=False, markup=False)
    names = ", ".join(path.name for path in written)
    console.print(f"written to {folder}: {names}", highlight=False, markup=False, soft_wrap=True)


@app.command(name="list")
def list_problems() -> None:
    """List the shipped problems, and whether the recordings they need are present."""
    from rich.console import Console  # noqa: PLC0415
    from rich.table import Table  # noqa: PLC0415

    from rehab_opt.session.files import load_problem, recording_state, shipped_problems  # noqa: PLC0415

    table = Table("problem", "title", "recording")
    for name in shipped_problems():
        loaded = load_problem(name)
        table.add_row(name, loaded.problem.title, recording_state(loaded))
    Console().print(table)


@app.command()
def check(file: Problem) -> None:
    """Check a problem file and its recording without running it."""
    from rehab_opt.session.files import load_problem  # noqa: PLC0415
    from rehab_opt.session.run import checked  # noqa: PLC0415

    loaded = load_problem(file)
    print(f"{loaded.name}: {loaded.problem.title}")
    for note in checked(loaded):
        print(f"- {note}")
    print("ok")


def _run_with_progress(loaded: ProblemFile, *, law: Law, solver: str | None) -> Outcome:
    """The run, with a bar on the error stream where that is a terminal."""
    from rich.console import Console  # noqa: PLC0415
    from rich.progress import Progress, TaskID  # noqa: PLC0415

    from rehab_opt.session.run import run_problem  # noqa: PLC0415

    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as bars:
        tasks: dict[str, TaskID] = {}

        def progress(what: str, done: int, whole: int) -> None:
            if what not in tasks:
                tasks[what] = bars.add_task(what, total=None)
            whole_known = whole if whole > 1 or done else None  # a law answers in one piece: its bar only moves
            bars.update(tasks[what], completed=done, total=whole_known)

        return run_problem(loaded, law=law, solver=solver, progress=progress)


def _law(law: str) -> Law:
    if law not in ("published", "optimised", "both"):
        raise ConfigurationError("--law", law, "published, optimised or both")
    return law  # type: ignore[return-value]


if __name__ == "__main__":
    main()
