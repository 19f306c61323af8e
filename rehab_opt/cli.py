"""The command `rehab-opt`: run, list and check problem files.

Bad input ends with one line on the error stream and exit code 2; nothing is written then.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

from rehab_opt.errors import ConfigurationError, ProblemFileError, RehabOptError

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

MOST_OF_A_VALUE = 120  # characters of a message

Problem = Annotated[str, typer.Argument(metavar="FILE", help="A problem file, or the name of a shipped problem.")]


def main(arguments: list[str] | None = None) -> None:
    """Entry point; `arguments` default to those of the command line."""
    with _on_interrupt(_interrupted):
        try:
            try:
                app(args=arguments)
            finally:
                sys.stdout.flush()
        except RehabOptError as problem:
            _refuse(problem)
        except OSError as problem:
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # what could not be printed fails no second time at the end
            place = str(problem.filename or "standard output")
            _refuse(ConfigurationError(place, problem.strerror, "a place that can be read and written to"))


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
    folder = out if out is not None else Path("out") / loaded.name
    try:
        checked_folder(folder)
    except OSError as problem:
        raise ConfigurationError("--out", str(folder), f"a folder's name ({problem.strerror})") from problem
    with _keys_of_the_user(loaded, solver):
        outcome = _run_with_progress(loaded, law=_law(law), solver=_solver(solver, law))
    with _undisturbed():
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
    with _keys_of_the_user(loaded, None):
        notes = checked(loaded)
    print(f"{loaded.name}: {loaded.problem.title}")
    for note in notes:
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


def _solver(solver: str | None, law: str) -> str | None:
    from rehab_opt.session.schema import UNUSABLE_SOLVERS  # noqa: PLC0415

    if solver == "" or solver in UNUSABLE_SOLVERS:
        raise ConfigurationError("--solver", solver, "the name of a solver that this problem can be given to")
    if solver is not None and law == "published":
        raise ConfigurationError("--solver", solver, "no such option with --law published, which needs no solver")
    return solver


@contextmanager
def _keys_of_the_user(loaded: ProblemFile, solver: str | None) -> Iterator[None]:
    """Name the option or the key of the problem file where a law or a reader speaks of its own argument.

    Raises
    ------
    ConfigurationError : `--solver` is refused.
    ProblemFileError : a key of the file is.
    """
    problem = loaded.problem
    try:
        yield
    except ProblemFileError as refused:
        if not refused.key.startswith("recording."):
            raise
        raise ProblemFileError(loaded.file, refused.key, refused.value, refused.expected) from refused
    except ConfigurationError as refused:
        if refused.argument != "solver" or solver is None:
            raise
        raise ConfigurationError("--solver", refused.value, refused.expected) from refused
    except RuntimeError as failed:
        if "::init for" not in str(failed):  # not CasADi's word for a solver that it cannot make
            raise
        expected = "a solver that this problem can be given to"
        if solver is not None:
            raise ConfigurationError("--solver", solver, expected) from failed
        key, section = (
            ("optimised", problem.optimised) if problem.system == "upper_limb" else ("tracker", problem.tracker)
        )
        raise ProblemFileError(loaded.file, f"{key}.solver", section.solver, expected) from failed


def _refuse(problem: RehabOptError) -> NoReturn:
    """One line on the error stream, whatever a file name holds, and exit code 2."""
    text, value = str(problem), repr(getattr(problem, "value", ""))
    if len(value) > MOST_OF_A_VALUE:
        text = text.replace(value, value[:MOST_OF_A_VALUE] + "...")
    line = "".join(letter if letter.isprintable() else " " for letter in text)
    print(f"rehab-opt: {line}", file=sys.stderr)
    sys.exit(2)


def _interrupted(*_: Any) -> NoReturn:
    """End at once: CasADi would swallow an exception and raise another one."""
    clear = b"\r\x1b[2K\x1b[?25h" if os.isatty(2) else b""  # a progress bar hides the cursor
    os.write(2, clear + b"rehab-opt: interrupted\n")
    os._exit(130)


@contextmanager
def _on_interrupt(handler: Any) -> Iterator[None]:
    """Ctrl-C calls `handler` meanwhile; only the main thread may say so."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def _undisturbed() -> Iterator[None]:
    """Ctrl-C waits until the files of a run are all there, or none."""
    came: list[bool] = []
    with _on_interrupt(lambda *_: came.append(True)):
        yield
    if came:
        _interrupted()


def _law(law: str) -> Law:
    if law not in ("published", "optimised", "both"):
        raise ConfigurationError("--law", law, "published, optimised or both")
    return law  # type: ignore[return-value]


if __name__ == "__main__":
    main()
