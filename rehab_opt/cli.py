"""The command `rehab-opt`: list, check and run problem files, and export their controllers.

Invalid input gives one line on the error stream and exit code 2, and writes no file. Exit code 0 means that the
command succeeded, not that a hand reached its goal: the notes and numbers of `run` report that. `check` exits with 0
if `run` would.
"""

from __future__ import annotations

import contextlib
import os
import shlex
import signal
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rehab_opt.errors import ConfigurationError, printable
from rehab_opt.study.commands import app as study_app
from rehab_opt.study.commands import report
from rehab_opt.study.options import CovariateOption, PersonOption, SessionOption, StudyOption, destination
from rehab_opt.terminal import (
    bars,
    brief,
    ending_in_a_line,
    grouped,
    no_folder,
    not_there_yet,
    numbers_in,
    on_interrupt,
    one_of,
    output_file,
    printer,
    say,
    undisturbed,
    writable,
)
from rehab_opt.version import __version__

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

app.add_typer(study_app, name="study")
app.command()(report)

FifoOption = Annotated[
    int | None, typer.Option(min=1, max=99, help="Real-time priority (SCHED_FIFO) of the loop's thread.")
]
LogOption = Annotated[Path | None, typer.Option(help="Log every tick to this .mcap, for `replay` and Foxglove.")]
Problem = Annotated[str, typer.Argument(metavar="FILE", help="A problem file, or the name of a shipped problem.")]


def main(arguments: list[str] | None = None) -> None:
    """Entry point of the command; `arguments` default to those of the command line."""
    os.environ.setdefault("REHAB_OPT_COMPILE", "wait")  # a short run would end before code compiled meanwhile is ready
    with ending_in_a_line():
        app(args=arguments)


def _print_version(asked: bool) -> None:
    if asked:
        say(f"rehab-opt {__version__}")
        raise typer.Exit


@app.callback()
def options(
    _version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Options before the command."""


@app.command()
def run(
    file: Problem,
    *,
    out: Annotated[Path | None, typer.Option(help="Folder for the results; default ./out/<problem>.")] = None,
    solver: Annotated[str | None, typer.Option(help="Solver of our controller; default: the problem's.")] = None,
    law: Annotated[str | None, typer.Option(help="Upper limb: published, optimised or both (default).")] = None,
    plant: Annotated[str | None, typer.Option(help="Robot: ideal, or mujoco (mass, servos, delays).")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace the files of an earlier run in the folder.")] = False,
    whole: Annotated[bool, typer.Option("--all", help="Print the whole table, not only the main numbers.")] = False,
    study: StudyOption = None,
    person: PersonOption = None,
    session: SessionOption = None,
    covariate: CovariateOption = None,
) -> None:
    """Run a problem, print a table of results, and write metrics.json, trace.csv and figures to a folder.

    If the folder has files of an earlier run, a new folder with a number is made: figure_eight-2.
    """
    from rehab_opt.session.files import load_problem  # noqa: PLC0415
    from rehab_opt.session.report import free_folder, write_report  # noqa: PLC0415
    from rehab_opt.session.systems import system_named  # noqa: PLC0415

    config = load_problem(file)
    into = destination(study, person, session, covariate)
    chosen = out if out is not None else Path("out") / config.name
    folder = writable(chosen) if force else free_folder(writable(chosen))
    began, options = time.perf_counter(), {"law": law, "plant": plant, "solver": solver}
    outcome = _run_with_progress(config, **options)
    with undisturbed():
        written = write_report(outcome, folder)
        if into is not None:
            from rehab_opt.study.record import run_trials  # noqa: PLC0415

            new = into.add(run_trials(config, outcome, options, files=written, seconds=time.perf_counter() - began))
    console, system = printer(), system_named(outcome.system)
    few = None if whole else system.brief(outcome)
    console.print(few if few is not None else system.table(outcome))
    for line in grouped(outcome.notes if whole else brief(outcome.notes)):
        console.print(line, highlight=False)
    if few is not None:
        console.print("- more numbers: --all, and metrics.json", highlight=False)
    if into is not None:
        say(into.written(new))
    names = ", ".join(path.name for path in written)
    console.print(f"written to {folder}: {names}", highlight=False, soft_wrap=True)


@app.command()
def live(
    file: Annotated[str | None, typer.Argument(metavar="FILE", help="As for run; none with --replay.")] = None,
    *,
    plant: Annotated[str | None, typer.Option(help="Robot: ideal, or mujoco; default: the problem's.")] = None,
    solver: Annotated[str | None, typer.Option(help="Solver of our controller; default: the problem's.")] = None,
    host: Annotated[str, typer.Option(help="Address of this machine for the page.")] = "127.0.0.1",
    replay: Annotated[Path | None, typer.Option(metavar="LOG", help="Show a log of `loop` or `live` instead.")] = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port of the page; 0: any free port.")] = 0,
    log: LogOption = None,
    fifo: FifoOption = None,
    study: StudyOption = None,
    person: PersonOption = None,
    session: SessionOption = None,
    covariate: CovariateOption = None,
) -> None:
    """Run a problem in real time and print the address of its interactive page; Ctrl-C ends the run.

    With --study, a trial is stored each time the dead man's switch is held for at least one second.
    """
    from rehab_opt.live.session import show_live  # noqa: PLC0415

    if (file is None) == (replay is None) or (replay is not None and (plant or solver or study or log)):
        said = " ".join(str(each) for each in (file, replay) if each is not None)
        raise ConfigurationError(
            "FILE", said, "a problem; or --replay with a log, which sets plant and solver and is no trial"
        )

    _log_folder(log)
    into, trials = destination(study, person, session, covariate), None
    if into is not None and file is not None:
        from rehab_opt.session.files import problem_path  # noqa: PLC0415
        from rehab_opt.study.live import LiveTrials  # noqa: PLC0415
        from rehab_opt.study.trial import ProblemText  # noqa: PLC0415

        name, path = problem_path(file)
        trials = LiveTrials(into, ProblemText(name, path.read_text(encoding="utf-8")))

    def ready(page: str, participant: str) -> None:
        say(f"open {page}")
        say(f"the participant's screen: {participant}")
        does = "move the robot" if replay is None else "see the log"
        say(f"anyone with these links can {does}; Ctrl-C ends it")
        sys.stdout.flush()

    with contextlib.suppress(KeyboardInterrupt), on_interrupt(signal.default_int_handler):
        again, shown = replay is not None, str(file if replay is None else replay)
        show_live(
            shown, plant=plant, solver=solver, again=again, log=log, fifo=fifo, host=host, port=port, ready=ready,
            watching=trials,
        )  # fmt: skip
    if into is not None and trials is not None:
        with undisturbed():
            trials.end()
        held = f"no trial for {into.folder}: the dead man's switch was never held for a second"
        say(into.written(trials.written) if trials.written else held)


@app.command()
def film(
    file: Problem,
    *,
    out: Annotated[Path | None, typer.Option(help="The .gif; default ./out/<problem>.gif.")] = None,
    seconds: Annotated[float, typer.Option(min=0.1, max=600, help="Duration of the film in s.")] = 8.0,
    plant: Annotated[str | None, typer.Option(help="As for run.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing .gif.")] = False,
) -> None:
    """Simulate a problem without user inputs and write a film that looks like the page of `live`."""
    from rehab_opt.live.film import write_film  # noqa: PLC0415  (loads matplotlib)
    from rehab_opt.session.files import load_problem  # noqa: PLC0415

    config = load_problem(file)
    from rehab_opt.session.run import live_problem  # noqa: PLC0415

    place = output_file(out, config.name, ".gif")
    not_there_yet(place, force=force)
    with bars() as progress:
        problem = live_problem(config, plant=plant)
        place.parent.mkdir(parents=True, exist_ok=True)
        count = write_film(problem, place, seconds=seconds, progress=progress)
    say(f"written to {place}: {count} pictures, {place.stat().st_size / 1e3:.0f} kB")


@app.command()
def loop(
    file: Problem,
    *,
    seconds: Annotated[float, typer.Option(min=0.01, max=86400, help="Duration in s.")] = 10.0,
    log: LogOption = None,
    fifo: FifoOption = None,
    gamepad: Annotated[
        Path | None, typer.Option(metavar="DEVICE", help="Gamepad, /dev/input/js0; button 4: dead man's switch.")
    ] = None,
    plant: Annotated[str | None, typer.Option(help="As for run.")] = None,
    solver: Annotated[str | None, typer.Option(help="As for run.")] = None,
) -> None:
    """Run a problem in real time on its simulated or real robot, and report the timing."""
    from rehab_opt.loop.of_problem import run_in_time  # noqa: PLC0415  (loads solvers)
    from rehab_opt.session.files import load_problem  # noqa: PLC0415

    config = load_problem(file)
    _log_folder(log)
    report, lost = run_in_time(
        config, seconds=seconds, plant=plant, solver=solver, log=log, fifo=fifo, gamepad=gamepad
    )  # fmt: skip
    for line in str(report).splitlines():
        say(line)
    if log is not None:
        say(f"written to {log}" + (f"; {lost} records were lost: the log was too slow" if lost else ""))


@app.command()
def delay(
    file: Problem,
    *,
    joint: Annotated[int, typer.Option(min=1, help="Number, from 1, of the joint that swings by 9 deg each way.")] = 1,
    plant: Annotated[str | None, typer.Option(help="As for run.")] = None,
    fifo: FifoOption = None,
) -> None:
    """Swing one joint of a problem's robot for 4 s and print the measured delay of the robot."""
    from rehab_opt.loop.of_problem import delay_of  # noqa: PLC0415  (loads solvers)
    from rehab_opt.session.files import load_problem  # noqa: PLC0415

    late = delay_of(load_problem(file), joint=joint - 1, plant=plant, fifo=fifo)
    say(f"delay of the robot: {1e3 * late:.1f} ms; controllers allow for 100 ms")


@app.command()
def replay(log: Annotated[Path, typer.Argument(metavar="LOG", help="An .mcap of `loop` or `live`.")]) -> None:
    """Compute every command of a log again from the logged inputs; exit code 1 if a command differs."""
    from rehab_opt.loop.logged import read_log  # noqa: PLC0415
    from rehab_opt.loop.of_problem import replay_problem  # noqa: PLC0415

    logged = read_log(log)
    again = replay_problem(logged)
    if not logged.whole:
        say("the log is incomplete: its disk was full, or its writer was killed")
    say(f"{again.same} of {again.ticks} commands are equal; their largest difference is {again.worst:.1e}")
    if again.first:
        versions = ", ".join(
            f"{name} {logged.about[name]}" for name in ("rehab_opt", "numpy", "casadi") if name in logged.about
        )
        say(f"first difference: {again.first}; logged by {versions}")
        raise typer.Exit(1)


@app.command(name="list")
def list_problems() -> None:
    """List the shipped problems, and whether their recordings are on this machine."""
    from rich.table import Column, Table  # noqa: PLC0415

    from rehab_opt.session.files import recording_state, shipped_problems  # noqa: PLC0415

    table = Table(Column("problem", no_wrap=True), "title", "recording")
    for name in shipped_problems():
        table.add_row(name, *recording_state(name))
    printer().print(table)


@app.command()
def keys(
    system: Annotated[
        str, typer.Argument(help="A `system` of problem files; or robot, for robot files.", metavar="SYSTEM")
    ],
) -> None:
    """Print the keys of a system's problem files, each with its meaning, values and default."""
    from rich.box import SIMPLE  # noqa: PLC0415
    from rich.table import Column, Table  # noqa: PLC0415

    from rehab_opt.session.keys import keys_of  # noqa: PLC0415
    from rehab_opt.session.robot_file import RobotFile  # noqa: PLC0415
    from rehab_opt.session.systems import system_named, systems  # noqa: PLC0415

    if system not in (*systems(), "robot"):
        raise ConfigurationError("SYSTEM", system, f"one of {', '.join(systems())}, robot")
    plain = str.maketrans("", "", "`*")
    for each in keys_of(RobotFile if system == "robot" else system_named(system).schema):
        say(" ".join(each.head.translate(plain).split()))
        table = Table(
            Column("key", no_wrap=True),
            Column("meaning", ratio=3, overflow="fold"),
            Column("values", ratio=2, overflow="fold"),
            box=SIMPLE,
        )
        for key, values, default, meaning in each.rows:
            of = "required: " if default == "required" else f"{default} by default: " if default else ""
            table.add_row(*(cell.translate(plain) for cell in (key.rpartition(".")[2], meaning, of + values)))
        printer().print(table)
        if each.refused:
            say(each.refused.translate(plain))


@app.command()
def check(
    file: Problem,
    picture: Annotated[
        Path | None, typer.Option(help="Folder for a picture of the arm at both ends of each movement.")
    ] = None,
    *,
    force: Annotated[bool, typer.Option("--force", help="Replace existing pictures.")] = False,
    whole: Annotated[bool, typer.Option("--all", help="Print all notes, also similar ones.")] = False,
) -> None:
    """Check a problem file and its recordings, and print the arm's range of motion in goniometer angles."""
    from rehab_opt.session.files import load_problem  # noqa: PLC0415
    from rehab_opt.session.systems import NotMet  # noqa: PLC0415

    config = load_problem(file)
    from rehab_opt.session.report import CAPTIONS  # noqa: PLC0415
    from rehab_opt.session.run import arms_of, checked  # noqa: PLC0415

    notes = checked(config)
    arms, pictures = arms_of(config), []
    if picture is not None:
        if not arms:
            expected = f"a problem with a range of motion, which {config.problem.system!r} does not have"
            raise ConfigurationError("--picture", str(picture), expected)
        folder = writable(picture, argument="--picture")
        pictures = [folder / f"arm_{number}.png" for number in range(1, len(arms) + 1)]
        for path in (*pictures, folder / CAPTIONS):
            not_there_yet(path, force=force, argument="--picture")
    say(f"{config.name}: {config.problem.title}")
    for note in notes if whole else brief(notes):
        say(f"- {note}")
    if arms:
        from rehab_opt.session.arm_picture import range_note, write_range_figures  # noqa: PLC0415

        side = getattr(getattr(config.problem, "arm", None), "side", "")
        for name, arm in arms.items():
            say(f"- {range_note(name, arm, side=side)}")
        if pictures:
            written = write_range_figures(arms, folder, title=config.problem.title)
            say(f"written to {folder}: {', '.join(path.name for path in written)}")
    met = not any(isinstance(note, NotMet) for note in notes)
    say("ok" if met else "valid, but the run will not do all that the file asks (see the notes)")


@app.command()
def place(
    file: Problem,
    out: Annotated[
        Path | None, typer.Option(help="Problem file to write with the found keys; default: only print the keys.")
    ] = None,
    seats: Annotated[int, typer.Option(min=20, help="Number of random seats to try before refining the best.")] = 600,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random seats.")] = 0,
    *,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False,
) -> None:
    """Find seat, direction, grip and start for a mirror problem; print them as file keys, with the result of a run."""
    from rehab_opt.session.files import load_problem, problem_path  # noqa: PLC0415
    from rehab_opt.session.mirror.placing import (  # noqa: PLC0415
        found_place,
        replaced_keys,
        value_text,
    )
    from rehab_opt.session.mirror.problem import MirrorProblem  # noqa: PLC0415

    config = load_problem(file)
    if not isinstance(config.problem, MirrorProblem):
        raise ConfigurationError("FILE", file, 'a problem of system = "mirror"')
    if out is not None:
        no_folder(out)
        writable(out.parent)
        recording = config.problem.recording.file
        beside = out.parent.resolve() == config.path.parent.resolve()
        if not (beside or recording.startswith("data:") or Path(recording).is_absolute()):
            raise ConfigurationError("--out", str(out), f"a file beside {file}, from where {recording} is found")
        not_there_yet(out, force=force, inputs=(config.path, config.path.parent / recording))
    with bars() as progress:
        found = found_place(config, seats=seats, seed=seed, progress=progress)
    for section, values in found.keys.items():
        say(f"[{section}]")
        for key, value in values.items():
            say(f"{key} = {value_text(value)}")
    say(
        f"path followed within 5 mm and 5 deg: {100 * found.passed:.1f} % of the poses (estimate of the search "
        f"{100 * found.counted:.1f} %)"
    )
    if out is not None:
        text = replaced_keys(problem_path(file)[1].read_text(encoding="utf-8"), found.keys, file=file)
        with undisturbed():
            out.write_text(text, encoding="utf-8")
        say(f"written to {out}")


@app.command()
def score(
    recordings: Annotated[list[str], typer.Argument(metavar="RECORDING...", help="Recordings of a hand, one or more.")],
    *,
    columns: Annotated[str | None, typer.Option(help="Columns of x, y (and z), by name or number.")] = None,
    marker: Annotated[str | None, typer.Option(help="The hand's marker in motion capture, or its number.")] = None,
    time_column: Annotated[str | None, typer.Option(help="Column of times in a .csv.")] = None,
    rate_hz: Annotated[float | None, typer.Option(help="Sampling rate that replaces the file's times.")] = None,
    units: Annotated[
        str | None, typer.Option(help="Units of length, angle and time that replace the file's, such as mm,deg,us.")
    ] = None,
    up: Annotated[str | None, typer.Option(help="Axis that points up: y, -z, ...; default z.")] = None,
    window_s: Annotated[str | None, typer.Option(help="Window from,to in s after the first sample.")] = None,
    trials: Annotated[
        str | None, typer.Option(help="Column of a .csv with trial numbers; event(s) of a .c3d: begin or begin,end.")
    ] = None,
    separator: Annotated[str, typer.Option(help="Separator of a .csv: comma, semicolon, tab or blank.")] = "comma",
    decimal: Annotated[str, typer.Option(help="Decimal sign of a .csv: point or comma.")] = "point",
    count_mm: Annotated[float | None, typer.Option(help="Millimetres per raw count, or per unit of a .c3d.")] = None,
    tick_ms: Annotated[float | None, typer.Option(help="Milliseconds per raw count of time.")] = None,
    target: Annotated[str | None, typer.Option(help="Target of each movement: x,y(,z) in m.")] = None,
    pause: Annotated[float | None, typer.Option(help="Rest in s between trials; default: one trial a file.")] = None,
    repeats: Annotated[
        bool, typer.Option("--repeats", help="All trials repeat one movement: measure their variability, too.")
    ] = False,
    cutoff: Annotated[float, typer.Option(help="Cut-off of the low-pass filter, in Hz.")] = 10.0,
    threshold: Annotated[float, typer.Option(help="Fraction of the peak speed at which a movement begins.")] = 0.05,
    range_of_motion: Annotated[
        bool, typer.Option("--range-of-motion", help="Print only the range of joint angles, as keys of an arm.")
    ] = False,
    out: Annotated[Path | None, typer.Option(help="A .csv; default: standard output.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing .csv.")] = False,
    study: StudyOption = None,
    person: PersonOption = None,
    session: SessionOption = None,
    covariate: CovariateOption = None,
) -> None:
    """Measure movement time, speed, smoothness, path and range of recorded trials; print one CSV row per measure.

    Notes on gaps, noise and rest are printed on the error stream. The module rehab_opt.measures has the formulas.
    """
    from rehab_opt.recordings.tables import SEPARATORS  # noqa: PLC0415
    from rehab_opt.session.scoring import range_of_motion_keys, score_recordings, write_rows  # noqa: PLC0415

    if out is not None:
        no_folder(out)
        writable(out.parent)
        not_there_yet(out, force=force, inputs=map(Path, recordings))
    if range_of_motion and out is not None:
        raise ConfigurationError("--out", str(out), "no --out with --range-of-motion, whose keys are printed")
    into = destination(study, person, session, covariate)
    how: dict[str, Any] = {
        "reading": {
            "columns": None if columns is None else columns.split(","),
            "marker": marker,
            "separator": one_of("--separator", separator, SEPARATORS),
            "decimal": one_of("--decimal", decimal, ("point", "comma")),
            "count_mm": count_mm,
            "tick_ms": tick_ms,
            "time_column": time_column,
            "rate_hz": rate_hz,
            "units": None if units is None else units.split(","),
            "up": up,
            "window_s": None if window_s is None else numbers_in("--window-s", window_s),
            "trials": trials,
        },
        "target": None if target is None else numbers_in("--target", target),
        "pause": pause,
        "cutoff_hz": cutoff,
        "threshold": threshold,
    }
    scored = score_recordings(recordings, repeats=repeats, **how)
    if into is not None:
        from rehab_opt.study.record import score_trials  # noqa: PLC0415

        with undisturbed():
            new = into.add(score_trials(scored, how))
        print(printable(f"rehab-opt: {into.written(new)}"), file=sys.stderr)  # standard output has only the rows
    if range_of_motion:
        print("\n".join(range_of_motion_keys(scored)))
    elif out is None:
        write_rows(scored.rows, sys.stdout)
    else:
        with undisturbed():
            out.parent.mkdir(parents=True, exist_ok=True)
            write_rows(scored.rows, out)
    for note in scored.notes:
        print(printable(f"rehab-opt: {note}"), file=sys.stderr)
    if out is not None:
        say(f"written to {out}: {len(scored.rows)} rows")
    for problem in scored.refused:
        print(printable(f"rehab-opt: not measured: {problem}"), file=sys.stderr)
    if scored.refused:
        raise typer.Exit(1)


@app.command()
def many(
    people: Annotated[
        Path, typer.Argument(metavar="TABLE_OR_FOLDER", help="A .csv, or a folder with a problem file per participant.")
    ],
    problem: Annotated[
        str | None, typer.Option(help="Problem that the table's rows modify; default upper_limb/workspace.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the results; default ./out/many/<name>.")] = None,
    workers: Annotated[int | None, typer.Option(help="Number of processes; default: one per core.")] = None,
    *,
    timeout: Annotated[float, typer.Option(help="Time limit in s for a participant's process.")] = 3600.0,
    study: StudyOption = None,
    session: SessionOption = None,
) -> None:
    """Run a problem for many participants; write a folder for each participant, and results.csv.

    Finished participants are skipped, so an interrupted run can be continued. With --study, results are also stored in
    the study, in the session that --session or the table's column names. Exit code 1: some rows failed; see
    results.csv.
    """
    from rehab_opt.session.many.participants import participants_of  # noqa: PLC0415
    from rehab_opt.session.many.results import counted, failed_table  # noqa: PLC0415
    from rehab_opt.session.many.run import GROUPS, RESULTS, run_many  # noqa: PLC0415
    from rehab_opt.study.many import study_of_many  # noqa: PLC0415

    participants = participants_of(people, problem=problem)
    folder = writable(out if out is not None else Path("out") / "many" / people.resolve().name.removesuffix(".csv"))
    try:
        with ExitStack() as opened, on_interrupt(signal.default_int_handler), bars() as progress:
            recorder = study_of_many(opened, study, session, table=folder / RESULTS)
            rows = run_many(
                participants if recorder is None else recorder.checked(participants),
                out=folder,
                workers=workers,
                progress=progress,
                timeout_s=timeout,
                record=(lambda *_: None) if recorder is None else recorder,
            )
    except KeyboardInterrupt:
        print("rehab-opt: interrupted", file=sys.stderr)
        raise typer.Exit(130) from None
    console = printer()
    failed = any(row.error for row in rows)
    if failed:
        console.print(failed_table(rows))
    console.print(counted(rows), highlight=False)
    console.print(f"written to {folder}: {RESULTS}, {GROUPS}", highlight=False, soft_wrap=True)
    if failed:
        raise typer.Exit(1)


@app.command(name="export-c")
def export_controller(
    file: Problem,
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder for the C files; created if missing.")],
    memory: Annotated[
        int | None,
        typer.Option(metavar="BYTES", help="Largest size of the controller's C struct; mirror default: 96000."),
    ] = None,
) -> None:
    """Write a problem's controller as C source and header, and a recorded run for comparison; print how to build it."""
    from rehab_opt.export.export_c import export_c  # noqa: PLC0415
    from rehab_opt.session.files import load_problem  # noqa: PLC0415

    config = load_problem(file)
    with bars() as progress:
        place = writable(folder, argument="DIR")
        written = export_c(config, place, memory=memory, progress=progress, writing=undisturbed())
    for place in sorted({path.parent for path in written}):
        say(f"written to {place}: {', '.join(path.name for path in written if path.parent == place)}")
        source, build = shlex.quote(str(place)), shlex.quote(str(place / "build"))
        example = shlex.quote(str(place / "build" / "example"))
        say(f"build it and compare it with Python: cmake -S {source} -B {build} && cmake --build {build} && {example}")


def _log_folder(log: Path | None) -> None:
    """Make the folder of a log, if any; raise an error if the log exists, since it may belong to another session."""
    if log is not None:
        if log.exists():
            raise ConfigurationError("--log", str(log), "a new file; this one exists")
        writable(log.parent, argument="--log")
        log.parent.mkdir(parents=True, exist_ok=True)


def _run_with_progress(config: ProblemFile[Any], **options: str | None) -> Outcome:
    from rehab_opt.session.run import run_problem  # noqa: PLC0415

    with bars() as progress:
        return run_problem(config, progress=progress, **options)
