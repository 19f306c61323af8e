"""Whatever file is given, it is read or refused within seconds, and nothing in it reaches a terminal as a command."""

from __future__ import annotations

import os
import signal
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.table import Table
from rich.text import Text

from rehab_opt import ProblemFileError
from rehab_opt.cli import main
from rehab_opt.recordings.reading import read_recording
from rehab_opt.session.files import load_problem
from rehab_opt.session.many.participants import participants_in_folder, participants_of
from rehab_opt.terminal import printer
from rehab_opt.text_file import (
    DEEPEST_KEY,
    MAX_COLUMNS,
    MAX_PROBLEM_SIZE,
    MAX_RECORDING_SIZE,
    MAX_TABLE_SIZE,
    check_key_depth,
)
from tests.session.test_files import ARM, CSV

Write = Callable[[str, str | bytes], Path]

LIMIT = 2.0
"""[s] of processor time."""
PATIENCE = 60.0
"""[s] after which something waits for ever, on a busy machine, too."""
ESCAPES = "te\x1b[31mst \x1b]0;other\x07 \x9b2J \u202e [/b] [red]"


@contextmanager
def within(seconds: float) -> Iterator[None]:
    """Fail where it takes more processor time, or would wait for ever."""

    def late(number: int, _frame: FrameType | None) -> None:
        pytest.fail(f"longer than {seconds} s" if number == signal.SIGPROF else "waits for ever")

    before = {number: signal.signal(number, late) for number in (signal.SIGPROF, signal.SIGALRM)}
    signal.setitimer(signal.ITIMER_PROF, seconds)
    signal.setitimer(signal.ITIMER_REAL, PATIENCE)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.setitimer(signal.ITIMER_REAL, 0)
        for number, handler in before.items():
            signal.signal(number, handler)


# -------------------------------------------------------------------------------------- pipes, devices, huge files
@pytest.fixture
def pipe(tmp_path: Path) -> Callable[[str], Path]:
    def make(name: str) -> Path:
        os.mkfifo(tmp_path / name)
        return tmp_path / name

    return make


def test_a_pipe_is_no_problem_no_table_and_no_participant(pipe: Callable[[str], Path]) -> None:
    table, problem = pipe("people.csv"), pipe("problem.toml")
    with within(LIMIT):
        for read in (lambda: load_problem(str(problem)), lambda: participants_of(table)):
            with pytest.raises(ProblemFileError, match="file = 'a pipe': expected a file"):
                read()
        assert "'a pipe'" in participants_in_folder(problem.parent)[0].error


def test_a_huge_file_is_refused_with_its_size_and_the_limit(tmp_path: Path) -> None:
    for name, largest, read in (
        ("a.toml", MAX_PROBLEM_SIZE, lambda path: load_problem(str(path))),
        ("people.csv", MAX_TABLE_SIZE, participants_of),
        ("path.csv", MAX_RECORDING_SIZE, read_recording),
    ):
        with (tmp_path / name).open("wb") as file:
            file.truncate(30_000_000_000)  # sparse: it takes no place
        with within(LIMIT), pytest.raises(ProblemFileError) as refusal:
            read(tmp_path / name)
        assert refusal.value.value == "30000 MB"
        assert refusal.value.expected.startswith(f"at most {largest / 1e6:g} MB")
        (tmp_path / name).unlink()


# ------------------------------------------------------------------------------------------------ columns and keys
def header_of(suffix: str, more: int) -> str:
    columns = ["t_s", "x_m", "y_m", *(f"c{i}_deg" for i in range(more))]
    row = ",".join(["0"] * len(columns))
    if suffix == "mot":
        return "\n".join(["inDegrees=yes", "endheader", ",".join(["time", *columns[1:]]), row])
    if suffix == "trc":
        names = "\t".join(["Frame#", "Time", *columns[2:]])
        return "\n".join(["PathFileType", "Units", "mm", names, "", row.replace(",", "\t")])
    return "\n".join([",".join(columns), row])


@pytest.mark.parametrize("suffix", ["csv", "mot", "trc"])
def test_a_hundred_thousand_columns_are_refused_with_the_limit(written: Write, suffix: str) -> None:
    path = written(f"path.{suffix}", header_of(suffix, 100_000))
    with within(LIMIT), pytest.raises(ProblemFileError, match=f"columns': expected at most {MAX_COLUMNS} columns"):
        read_recording(path, **({"marker": "x"} if suffix == "trc" else {}))


part = st.sampled_from(["a", "turn_deg", "-", "7", '"b c"', "'d.e'", '"="', '"\\"."', '"#"'])
dot = st.sampled_from([".", " . ", ".\t"])


@given(
    st.lists(part, min_size=DEEPEST_KEY - 3, max_size=DEEPEST_KEY + 3),
    dot,
    st.sampled_from(
        ["{} = 1", "[{}]", "[[{}]]", "x = {{{} = 1}}", 'x = {{y = """\n""", {} = 1}}', "x = [{{{} = '''\n'''}}]"]
    ),
)
def test_a_key_is_refused_where_it_has_more_parts_than_may_be(parts: list[str], between: str, form: str) -> None:
    text = "title = 'x'\n" + form.format(between.join(parts)) + "\n"
    tomllib.loads(text)
    if len(parts) <= DEEPEST_KEY:
        check_key_depth(text, name="a.toml")
        return
    with pytest.raises(ProblemFileError, match=f"a key of {len(parts)} parts'") as refusal:
        check_key_depth(text, name="a.toml")
    assert refusal.value.key == ("line 3" if 'y = """' in form else "line 2")


@pytest.mark.parametrize(
    "content",
    [
        ARM + "a." * 50_000 + "b = 1\n",
        ARM + f"[{'a.' * 16_000}b]\n" + "".join(f"k{i}=1\n" for i in range(8000)),
        "".join(f"a.b{i}.c = 1\n" for i in range(50_000)) + ARM,
        ARM + "".join(f"{'a.' * 30}k{i}=1\n" for i in range(3500)),
        ARM + "'" * 250_000,
        ARM + "a" * 250_000,
    ],
    ids=range(6),
)
def test_any_toml_is_refused_within_seconds(written: Write, content: str) -> None:
    path = written("problem.toml", content)
    with within(2 * LIMIT), pytest.raises(ProblemFileError):
        load_problem(str(path))


# ------------------------------------------------------------------------------------------------ what is printed
def harmless(text: str) -> bool:
    return all(letter.isprintable() or letter == "\n" for letter in text)


@given(st.text() | st.just(ESCAPES))
def test_no_text_reaches_the_terminal_as_a_command(text: str) -> None:
    table = Table("name", title=Text(text), caption=text)
    table.add_row(text)
    console = printer()
    with console.capture() as printed:
        console.print(table)
        console.print(text)
        console.print(text, highlight=False, soft_wrap=True)
    assert harmless(printed.get())


def test_check_prints_titles_and_headers_with_their_escapes_written_out(
    written: Write, capsys: pytest.CaptureFixture[str]
) -> None:
    title = "".join(f"\\u{ord(letter):04x}" for letter in ESCAPES)
    written("path.csv", CSV.replace("\n", ",\x1b[31mred\n", 1).replace("0\n", "0,0\n").replace("0.01\n", "0.01,0\n"))
    main_of("check", str(written("problem.toml", ARM.replace('"test"', f'"{title}"'))))
    printed = capsys.readouterr().out
    assert harmless(printed)
    assert printed.startswith("problem: te\\x1b[31mst \\x1b]0;other\\x07 \\x9b2J \\u202e [/b] [red]\n")
    assert "columns not read: \\x1b[31mred\n" in printed


def main_of(*arguments: str) -> None:
    with pytest.raises(SystemExit) as ended:
        main(list(arguments))
    assert not ended.value.code
