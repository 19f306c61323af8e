"""The command `rehab-opt`: run, list and check problem files, one or many; export their controllers.

Bad input ends with one line on the error stream and exit code 2; nothing is written then.
"""

from __future__ import annotations

import os
import shlex
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rehab_opt import __version__
from rehab_opt.errors import ConfigurationError, RehabOptError, printable
from rehab_opt.terminal import (
    bars,
    interrupted,
    no_folder,
    numbers_in,
    on_interrupt,
    one_of,
    printer,
    refuse,
    say,
    undisturbed,
    writable,
)

if TYPE_CHECKING:
    from rehab_opt.session.files import ProblemFile
    from rehab_opt.session.outcome import Outcome

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
    os.environ.setdefault("REHAB_OPT_COMPILE", "wait")  # a run that is over before its code is ready gains nothing
    with on_interrupt(interrupted):
        try:
            try:
                app(args=arguments)
            finally:
                sys.stdout.flush()
        except RehabOptError as problem:
            refuse(problem)
        except OSError as problem:
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # what could not be printed fails no second time at the end
            place = str(problem.filename or "standard output")
            refuse(ConfigurationError(place, problem.strerror, "a place that can be read and written to"))


def _print_version(asked: bool) -> None:
    if asked:
        say(f"rehab-opt {__version__}")
        raise typer.Exit


@app.callback()
def options(
    _version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and end.")
    ] = False,
) -> None:
    """What stands before the command."""


@app.command()
def run(
    file: Problem,
    *,
    out: Annotated[Path | None, typer.Option(help="Folder of the result; ./out/<problem> by default.")] = None,
    solver: Annotated[str | None, typer.Option(help="Solver of the optimised law, instead of the file's.")] = None,
    law: Annotated[str | None, typer.Option(help="Of an upper limb: published, optimised or both (default).")] = None,
    plant: Annotated[
        str | None, typer.Option(help="Of a robot: ideal, or mujoco (mass, servos, delays); the file's by default.")
    ] = None,
    also: Annotated[str | None, typer.Option(help="Figures as pdf or svg, too; both: pdf,svg.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace the files of an earlier run in the folder.")] = False,
) -> None:
    """Run a problem; print its table; write metrics.json, trace.csv and figures.

    Where an earlier run has written its files, the folder gets a number: figure_eight-2.
    """
    from rehab_opt.session.files import load_problem  # noqa: PLC0415
    from rehab_opt.session.report import FIGURE_FORMATS, free_folder, write_report  # noqa: PLC0415
    from rehab_opt.session.systems import system_named  # noqa: PLC0415

    loaded = load_problem(file)
    formats = [] if also is None else [one_of("--also", each, FIGURE_FORMATS) for each in also.split(",")]
    chosen = out if out is not None else Path("out") / loaded.name
    folder = writable(chosen) if force else free_folder(writable(chosen))
    outcome = _run_with_progress(loaded, law=law, plant=plant, solver=solver)
    with undisturbed():
        written = write_report(outcome, folder, also=formats)
    console = printer()
    console.print(system_named(outcome.system).table(outcome))
    for note in outcome.notes:
        console.print(f"- {note}", highlight=False)
    names = ", ".join(path.name for path in written)
    console.print(f"written to {folder}: {names}", highlight=False, soft_wrap=True)


@app.command(name="list")
def list_problems() -> None:
    """List the shipped problems, and whether the recordings they need are present."""
    from rich.table import Column, Table  # noqa: PLC0415

    from rehab_opt.session.files import load_problem, recording_state, shipped_problems  # noqa: PLC0415

    table = Table(Column("problem", no_wrap=True), "title", "recording")
    for name in shipped_problems():
        loaded = load_problem(name)
        table.add_row(name, loaded.problem.title, recording_state(loaded))
    printer().print(table)


@app.command()
def check(
    file: Problem,
    picture: Annotated[
        Path | None, typer.Option(help="Folder for a picture of the arm at both ends of each movement.")
    ] = None,
) -> None:
    """Check a problem file and its recording without running it; say the range of motion as a goniometer reads it."""
    from rehab_opt.session.files import load_problem  # noqa: PLC0415
    from rehab_opt.session.run import arms_of, checked  # noqa: PLC0415

    loaded = load_problem(file)
    notes = checked(loaded)
    arms = arms_of(loaded)
    say(f"{loaded.name}: {loaded.problem.title}")
    for note in notes:
        say(f"- {note}")
    if arms:
        from rehab_opt.session.arm_picture import range_note, write_range_figures  # noqa: PLC0415

        for name, arm in arms.items():
            say(f"- {range_note(name, arm)}")
        if picture is not None:
            for path in write_range_figures(arms, writable(picture, argument="--picture"), title=loaded.problem.title):
                say(f"- written: {path}")
    elif picture is not None:
        expected = f"a problem that states a range of motion, which {loaded.problem.system!r} does not"
        raise ConfigurationError("--picture", str(picture), expected)
    say("ok")


@app.command()
def place(
    file: Problem,
    out: Annotated[
        Path | None, typer.Option(help="The problem file with these keys; nothing is written by default.")
    ] = None,
    seats: Annotated[int, typer.Option(min=20, help="Seats drawn anywhere; more follow near the best.")] = 600,
    seed: Annotated[int, typer.Option(min=0, help="Of what is drawn.")] = 0,
) -> None:
    """Look for seat, direction, grip and start of a mirrored recording; print the keys, and what `run` achieves."""
    from rehab_opt.session.files import load_problem, problem_path  # noqa: PLC0415
    from rehab_opt.session.mirror.placing import found_place  # noqa: PLC0415  (loads solvers)
    from rehab_opt.session.mirror.problem import MirrorProblem  # noqa: PLC0415
    from rehab_opt.session.problem_text import replaced_keys, value_text  # noqa: PLC0415

    loaded = load_problem(file)
    if not isinstance(loaded.problem, MirrorProblem):
        raise ConfigurationError("FILE", file, 'a problem of system = "mirror"')
    if out is not None:
        no_folder(out)
        writable(out.parent)
        recording = loaded.problem.recording.file
        beside = out.parent.resolve() == loaded.path.parent.resolve()
        if not (beside or recording.startswith("data:") or Path(recording).is_absolute()):
            raise ConfigurationError("--out", str(out), f"a file beside {file}, from where {recording} is found")
    with bars() as progress:
        found = found_place(loaded, seats=seats, seed=seed, progress=progress)
    for section, values in found.keys.items():
        say(f"[{section}]")
        for key, value in values.items():
            say(f"{key} = {value_text(value)}")
    say(
        f"step passes {100 * found.passed:.1f} % of the poses within 5 mm and 5 deg (the search counted on "
        f"{100 * found.counted:.1f} %)"
    )
    if out is not None:
        text = replaced_keys(problem_path(file)[1].read_text(encoding="utf-8"), found.keys, file=file)
        with undisturbed():
            out.write_text(text, encoding="utf-8")
        say(f"written to {out}")


@app.command()
def record(
    file: Problem,
    out: Annotated[
        Path | None,
        typer.Option(help="The .npz; ./out/<problem>.npz by default. Several solvers: each adds its name to it."),
    ] = None,
    skip: Annotated[int, typer.Option(help="QPs of each solver that are let pass first.")] = 0,
    ticks: Annotated[int, typer.Option(help="QPs of each solver that are then kept at most.")] = 1000,
    solver: Annotated[str | None, typer.Option(help="Solver of the optimised law, instead of the file's.")] = None,
) -> None:
    """Run a problem and record the QPs that its controllers solve, to compare solvers on: bench/solvers/README.md."""
    from rehab_opt.qp_recording.recording import file_names, recorded_run  # noqa: PLC0415
    from rehab_opt.qp_recording.sequence import write_sequence  # noqa: PLC0415
    from rehab_opt.session.files import load_problem  # noqa: PLC0415

    loaded = load_problem(file)
    place = out if out is not None else Path("out") / f"{loaded.name}.npz"
    if place.suffix != ".npz":
        raise ConfigurationError("--out", str(place), "a file that ends in .npz")
    no_folder(place)
    writable(place.parent)
    with bars() as progress:
        sequences = recorded_run(loaded, skip=skip, ticks=ticks, progress=progress, solver=solver)
    paths = file_names(place, sequences)
    for path in paths:  # before any of them is written
        no_folder(path)
    with undisturbed():
        for path, sequence in zip(paths, sequences, strict=True):
            write_sequence(path, sequence, argument="--out")
    for path, sequence in zip(paths, sequences, strict=True):
        say(f"{path}: {len(sequence)} QPs of {sequence.n} variables and {sequence.m} rows")


@app.command()
def score(
    recordings: Annotated[list[str], typer.Argument(metavar="RECORDING...", help="Recordings of a hand, one or more.")],
    *,
    columns: Annotated[str | None, typer.Option(help="Columns of x, y (and z), with commas between.")] = None,
    marker: Annotated[str | None, typer.Option(help="The hand's marker in a motion-capture file.")] = None,
    separator: Annotated[str, typer.Option(help="Of a .csv: comma, semicolon or tab.")] = "comma",
    decimal: Annotated[str, typer.Option(help="Of a .csv: point or comma.")] = "point",
    count_mm: Annotated[float | None, typer.Option(help="Millimetres that one raw count is.")] = None,
    tick_ms: Annotated[float | None, typer.Option(help="Milliseconds that one raw count of time is.")] = None,
    target: Annotated[str | None, typer.Option(help="x,y(,z) [m] where each movement was to end.")] = None,
    pause: Annotated[float | None, typer.Option(help="Rest [s] that ends a trial; by default a file is one.")] = None,
    repeats: Annotated[
        bool, typer.Option("--repeats", help="All trials are of one movement: how they vary, too.")
    ] = False,
    cutoff: Annotated[float, typer.Option(help="Of the low-pass before speeds are taken [Hz].")] = 10.0,
    threshold: Annotated[float, typer.Option(help="Fraction of the peak speed where a movement begins.")] = 0.05,
    out: Annotated[Path | None, typer.Option(help="A .csv; standard output by default.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace the .csv where there is one.")] = False,
) -> None:
    """Measure the trials of recordings: movement time, speed, smoothness, path, range; a row each, as CSV.

    Notes, on the error stream, say what to know of the numbers: gaps, noise, rest. rehab_opt.measures has the formulas.
    """
    from rehab_opt.session.scoring import score_recordings, write_rows  # noqa: PLC0415
    from rehab_opt.session.tables import SEPARATORS  # noqa: PLC0415

    if out is not None:
        no_folder(out)
        writable(out.parent)
        if out.exists() and not force:
            raise ConfigurationError("--out", str(out), "a file that is not there yet, or --force to replace it")
        if any(out.exists() and Path(each).exists() and out.samefile(each) for each in recordings):
            raise ConfigurationError("--out", str(out), "another file than the recordings")
    scored = score_recordings(
        recordings,
        reading={
            "columns": None if columns is None else columns.split(","),
            "marker": marker,
            "separator": one_of("--separator", separator, SEPARATORS),
            "decimal": one_of("--decimal", decimal, ("point", "comma")),
            "count_mm": count_mm,
            "tick_ms": tick_ms,
        },
        target=None if target is None else numbers_in("--target", target),
        pause=pause,
        repeats=repeats,
        cutoff_hz=cutoff,
        threshold=threshold,
    )
    if out is None:
        write_rows(scored.rows, sys.stdout)
    else:
        with undisturbed():
            out.parent.mkdir(parents=True, exist_ok=True)
            with out.open("w", encoding="utf-8", newline="") as file:
                write_rows(scored.rows, file)
    for note in scored.notes:
        print(printable(f"rehab-opt: {note}"), file=sys.stderr)
    if out is not None:
        say(f"written to {out}: {len(scored.rows)} rows")


@app.command()
def many(
    people: Annotated[
        Path, typer.Argument(metavar="TABLE_OR_FOLDER", help="A .csv, or a folder of problem files, one a participant.")
    ],
    problem: Annotated[
        str | None, typer.Option(help="What the rows of a table change; upper_limb/workspace by default.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder of the results; ./out/many/<name> by default.")] = None,
    workers: Annotated[int | None, typer.Option(help="Processes; one for each core by default.")] = None,
) -> None:
    """Run a problem for each of many people; write a folder for each and results.csv. What is done is not done again.

    Exit code 1 if some rows are not done: results.csv says why.
    """
    from rehab_opt.session.many.participants import participants_of  # noqa: PLC0415
    from rehab_opt.session.many.run import RESULTS, run_many  # noqa: PLC0415
    from rehab_opt.session.many.summary import counted, failed_table  # noqa: PLC0415

    participants = participants_of(people, problem=problem)
    folder = writable(out if out is not None else Path("out") / "many" / people.resolve().name.removesuffix(".csv"))
    try:
        with on_interrupt(signal.default_int_handler), bars() as progress:
            rows = run_many(participants, out=folder, workers=workers, progress=progress)
    except KeyboardInterrupt:
        print("rehab-opt: interrupted", file=sys.stderr)
        raise typer.Exit(130) from None
    console = printer()
    failed = any(row.error for row in rows)
    if failed:
        console.print(failed_table(rows))
    console.print(counted(rows), highlight=False)
    console.print(f"written to {folder}: {RESULTS}", highlight=False, soft_wrap=True)
    if failed:
        raise typer.Exit(1)


@app.command()
def bench(
    family: Annotated[list[str] | None, typer.Option(help="Family or sequence; all of them by default.")] = None,
    solver: Annotated[list[str] | None, typer.Option(help="Solver; every installed one by default.")] = None,
    time_limit: Annotated[float, typer.Option(help="Seconds of one solve: then its process is killed.")] = 1.0,
    out: Annotated[Path, typer.Option(help="Folder of the results, and of what an interrupted run kept.")] = Path(
        "out/bench"
    ),
) -> None:
    """Compare solvers on recorded QPs; write table.md, results.json and figures. What is done is not done again."""
    try:
        from bench.solvers.command import Interruption, bench_command  # noqa: PLC0415  (it loads every solver)
    except ModuleNotFoundError as absent:
        if (absent.name or "").partition(".")[0] != "bench":
            raise
        needed = "the solver comparison, which a wheel leaves out: pip install -e '.[bench]' in a checkout"
        raise ConfigurationError("bench", "not installed", needed) from absent

    interruption = Interruption()
    try:
        with on_interrupt(interruption), bars() as progress:
            told = interruption.checked(progress)
            place = writable(out)
            bench_command(family, solver, time_limit=time_limit, out=place, progress=told, writing=undisturbed())
    except KeyboardInterrupt:
        print("rehab-opt: interrupted; the same command goes on from here", file=sys.stderr)
        raise typer.Exit(130) from None


@app.command(name="export-c")
def export_controller(
    file: Problem,
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of the C files; made where it is absent.")],
) -> None:
    """Write a problem's controller as C: one source and header, a recorded run that it repeats, and how to build it."""
    from rehab_opt.export.export_c import export_c  # noqa: PLC0415
    from rehab_opt.session.files import load_problem  # noqa: PLC0415

    loaded = load_problem(file)
    with bars() as progress:
        place = writable(folder, argument="DIR")
        written = export_c(loaded, place, progress=progress, writing=undisturbed())
    for place in sorted({path.parent for path in written}):
        say(f"written to {place}: {', '.join(path.name for path in written if path.parent == place)}")
        source, build = shlex.quote(str(place)), shlex.quote(str(place / "build"))
        example = shlex.quote(str(place / "build" / "example"))
        say(f"build it and compare it with Python: cmake -S {source} -B {build} && cmake --build {build} && {example}")


def _run_with_progress(loaded: ProblemFile[Any], **options: str | None) -> Outcome:
    from rehab_opt.session.run import run_problem  # noqa: PLC0415

    with bars() as progress:
        return run_problem(loaded, progress=progress, **options)


if __name__ == "__main__":
    main()
