"""Terminal output of the command line: progress bars, one-line errors, Ctrl-C, output folders."""

from __future__ import annotations

import math
import os
import re
import signal
import sys
import threading
import time
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from rehab_opt.errors import ConfigurationError, RehabOptError, printable

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, ConsoleRenderable, RenderResult

    from rehab_opt.session.outcome import Progress

__all__ = [
    "bars",
    "brief",
    "ending_in_a_line",
    "grouped",
    "interrupted",
    "no_folder",
    "not_there_yet",
    "numbers_in",
    "on_interrupt",
    "one_of",
    "output_file",
    "printer",
    "refuse",
    "say",
    "undisturbed",
    "writable",
]

MAX_OF_A_VALUE = 120  # characters of a value in an error message
COMPILING = "compiling functions, once on this machine, 5 to 60 s each (REHAB_OPT_COMPILE=0 runs without compiling)"
BETWEEN_LINES = 60.0
"""Time [s] between two progress lines if the error stream is not a terminal."""


def say(text: str) -> None:
    """Print one line with control characters escaped."""
    print(printable(text))


def printer() -> Console:
    """Console for tables and lines; it ignores rich's markup in texts and escapes control characters."""
    from rich.console import Console  # noqa: PLC0415
    from rich.console import RenderHook as Hook  # noqa: PLC0415

    class Escaping(Hook):
        """Wraps each printed object in an `_Escaped`."""

        def process_renderables(self, renderables: list[ConsoleRenderable]) -> list[ConsoleRenderable]:
            return [_Escaped(each) for each in renderables]

    console = Console(markup=False)
    console.push_render_hook(Escaping())
    return console


OF_ROBOT, FEW = re.compile(r"\b(joint|link|body|line) \S+"), 2
"""Two settings of `brief`: pattern of a robot's part or a line in a note; number of similar notes that all stay."""


def brief(notes: Iterable[str]) -> list[str]:
    """Notes to print: of many that differ only in numbers or joints, the first one with the count of the others."""
    alike: dict[str, list[str]] = {}
    for note in notes:
        kind, count = OF_ROBOT.subn("", note)
        alike.setdefault(re.sub(r"[\d.]+", "", kind) if count else note, []).append(note)
    return [
        note if len(same) <= FEW else f"{note} (and {len(same) - 1} more like this: --all)"
        for same in alike.values()
        for note in same[: None if len(same) <= FEW else 1]
    ]


def grouped(notes: Iterable[str]) -> Iterator[str]:
    """Notes as lines of a list; notes with the same prefix, such as `assisted: `, are grouped below the prefix."""
    of: dict[str, list[str]] = {}
    for note in notes:
        name, colon, rest = note.partition(": ")
        of.setdefault(name if colon else "", []).append(rest if colon else note)
    for name, said in of.items():
        if name and len(said) > 1:
            yield from (f"- {name}:", *(f"  - {each}" for each in said))
        else:
            yield from (f"- {name}: {each}" if name else f"- {each}" for each in said)


class _Escaped:
    """A printed object with control characters escaped, except line ends and rich's own styles."""

    def __init__(self, content: ConsoleRenderable) -> None:
        self.content = content

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        for segment in console.render(self.content, options):
            if segment.control:
                yield segment
            else:
                yield segment._replace(text="\n".join(map(printable, segment.text.split("\n"))))


@contextmanager
def bars() -> Iterator[Progress]:
    """Progress on the error stream: bars on a terminal, otherwise one line a minute; compilation is reported, too."""
    from rich.console import Console  # noqa: PLC0415
    from rich.progress import Progress as Bars  # noqa: PLC0415
    from rich.progress import TaskID  # noqa: PLC0415

    from rehab_opt.symbolic.compiled import tell_of_waiting  # noqa: PLC0415

    console = Console(stderr=True)
    with Bars(console=console, transient=True, disable=not console.is_terminal) as shown:
        tasks: dict[str, TaskID] = {}
        said = time.monotonic()
        begun: dict[str, tuple[float, int]] = {}

        def progress(what: str, done: int, whole: int) -> None:
            nonlocal said
            now = time.monotonic()
            began, before = begun.setdefault(what, (now, done))
            if not console.is_terminal and now - said >= BETWEEN_LINES:
                said = now
                left = math.ceil((now - began) / (done - before) * (whole - done) / 60) if done > before else None
                ahead = "" if left is None else f", about {left} min left"
                line = f"rehab-opt: {printable(what)}, {done} of {whole}{ahead}"
                print(line, file=sys.stderr, flush=True)
            if what not in tasks:
                tasks[what] = shown.add_task(what, total=None)
            whole_known = whole if whole > 1 or done else None  # a task of one step has no measurable progress
            shown.update(tasks[what], completed=done, total=whole_known)

        waits: list[float] = []

        @contextmanager
        def compiling(name: str) -> Iterator[None]:
            if not waits and not console.is_terminal:
                print(f"rehab-opt: {COMPILING}", file=sys.stderr, flush=True)
            waits.append(time.monotonic())
            task = shown.add_task(f"{COMPILING}: function {len(waits)}, {name}", total=None)
            yield
            waits[-1] = time.monotonic() - waits[-1]
            shown.remove_task(task)

        with tell_of_waiting(compiling):
            yield progress
    if waits:
        functions = "1 function" if len(waits) == 1 else f"{len(waits)} functions"
        print(f"rehab-opt: compiled {functions} in {sum(waits):.0f} s", file=sys.stderr, flush=True)


def writable(folder: Path, *, argument: str = "--out") -> Path:
    """Return `folder`; raise an error before the run if the folder is not writable. `argument` names the option."""
    from rehab_opt.session.report import checked_folder  # noqa: PLC0415

    try:
        return checked_folder(folder, argument=argument)
    except OSError as problem:
        raise ConfigurationError(argument, str(folder), f"a folder's name ({problem.strerror})") from problem


def no_folder(file: Path, *, argument: str = "--out") -> None:
    """Raise an error if `file` is an existing folder."""
    if file.is_dir():
        raise ConfigurationError(argument, str(file), "the name of a file: a folder stands there")


def not_there_yet(file: Path, *, force: bool, inputs: Iterable[Path] = (), argument: str = "--out") -> None:
    """Raise an error if the file is one of the inputs, or if it exists and `force` is False."""
    if file.exists() and not force:
        raise ConfigurationError(argument, str(file), "a new file, or --force to replace this one")
    if file.exists() and any(each.exists() and file.samefile(each) for each in inputs):
        raise ConfigurationError(argument, str(file), "a file that is not one of the inputs")


def output_file(out: Path | None, name: str, suffix: str) -> Path:
    """Path of `--out`, by default ./out/name.suffix; raise an error before the run if it is not writable."""
    place = out if out is not None else Path("out") / f"{name}{suffix}"
    if place.suffix != suffix:
        raise ConfigurationError("--out", str(place), f"a file that ends in {suffix}")
    no_folder(place)
    writable(place.parent)
    return place


def numbers_in(argument: str, text: str) -> list[float]:
    """Comma-separated numbers in a command-line option."""
    from rehab_opt.text_file import number_in  # noqa: PLC0415

    numbers = [number_in(part) for part in text.split(",")]
    if not all(map(math.isfinite, numbers)):
        raise ConfigurationError(argument, text, "numbers with commas between, such as 0.1,0.25")
    return numbers


def one_of(argument: str, value: str, known: Collection[str]) -> str:
    """Return `value`; raise an error if `value` is not in `known`."""
    if value not in known:
        raise ConfigurationError(argument, value, f"one of {', '.join(known)}")
    return value


def refuse(problem: RehabOptError) -> NoReturn:
    """Print the error as one line on the error stream and exit with code 2."""
    text, value = (" ".join(each.splitlines()) for each in (str(problem), repr(getattr(problem, "value", ""))))
    if len(value) > MAX_OF_A_VALUE:
        text = text.replace(value, value[:MAX_OF_A_VALUE] + "...")
    print(f"rehab-opt: {printable(text)}", file=sys.stderr)
    sys.exit(2)


def interrupted(*_: Any) -> NoReturn:
    """Exit at once; CasADi would replace a raised KeyboardInterrupt by another exception."""
    clear = b"\r\x1b[2K\x1b[?25h" if os.isatty(2) else b""  # a progress bar hides the cursor
    os.write(2, clear + b"rehab-opt: interrupted\n")
    os._exit(130)


@contextmanager
def on_interrupt(handler: Any) -> Iterator[None]:
    """Within this block, Ctrl-C calls `handler`; outside the main thread the block changes nothing."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def ending_in_a_line() -> Iterator[None]:
    """Report invalid input and file errors as one line on the error stream, with exit code 2."""
    with on_interrupt(interrupted):
        try:
            try:
                yield
            finally:
                sys.stdout.flush()
        except RehabOptError as problem:
            refuse(problem)
        except OSError as problem:
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # Python's flush at exit would fail again
            place = str(problem.filename or "output")
            refuse(ConfigurationError(place, problem.strerror, "a place that can be read and written to"))


@contextmanager
def undisturbed() -> Iterator[None]:
    """Delay Ctrl-C until all files of a run are written."""
    came: list[bool] = []
    with on_interrupt(lambda *_: came.append(True)):
        yield
    if came:
        interrupted()
