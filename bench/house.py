"""How large the house is, and what it is made of: `python -m bench.house`, in a checkout with the extra `test`."""

from __future__ import annotations

import ast
import io
import subprocess
import sys
import tempfile
import tokenize
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path

from rich.console import Console

from bench.verdict import Reported, Verdict, all_met, print_verdicts

__all__ = ["main"]

ROOT = Path(__file__).parents[1]
OF_EXAMPLES = {"main.c.in", "recorded_run.h.in", "CMakeLists.txt.in", "README.md.in"}
LAYOUT = frozenset(
    {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}
)


def main(_: Sequence[str] | None = None) -> int:
    """Count and weigh."""
    console = Console()
    session, every = (sorted(folder.rglob("*.py")) for folder in (ROOT / "rehab_opt/session", ROOT / "rehab_opt"))
    asked = [
        Verdict("README.md", (ROOT / "README.md").stat().st_size, "<=", 6000, "bytes"),
        Verdict("session/, thousand lines", sum(map(_lines, session)) / 1e3, "<=", 9.5),
        Verdict("session/, files", len(session), "<=", 85),
        Verdict("rehab_opt, thousand lines", sum(map(_lines, every)) / 1e3, "<=", 33.2),  # 7 fewer than on 2026-11-22
    ]
    making, ticking = _passed()
    written_c = [each for each in (ROOT / "rehab_opt/export/templates").iterdir() if each.name not in OF_EXAMPLES]
    asked += [
        Verdict("hand-written C, lines", sum(map(_lines, written_c)) - _names_of_parts(), "<=", 900),
        Verdict("files that a twist passes, chair and arm", len(making), "<=", 14),
    ]
    told = [
        Reported("files that it passes once the controller is made", len(ticking)),
        Reported(
            "of those that it passes before, files of 100 lines and more",
            sum(_lines(Path(each)) >= 100 for each in making),
        ),
        Reported("session/, thousand lines without docstrings, comments, imports, empty ones", _code(session)),
        Reported("session/, files that hold more than a docstring", sum(_code_lines(each) > 0 for each in session)),
        Reported("rehab_opt, thousand lines without docstrings, comments, imports, empty ones", _code(every)),
    ]
    with tempfile.TemporaryDirectory() as scratch:
        build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", scratch]
        subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
        (wheel,) = Path(scratch).iterdir()
        asked.append(Verdict("wheel", wheel.stat().st_size / 1e6, "<=", 1.0, "MB"))
        told += [Reported(f"wheel, {what} [MB]", size / 1e6) for what, size in _weights(wheel)]
    print_verdicts(console, asked)
    for each in told:
        console.print(str(each), highlight=False, soft_wrap=True)
    return int(not all_met(asked))


def _passed() -> tuple[set[str], set[str]]:
    """Files of rehab_opt that run between a twist and its command: with the making of the tick, and without."""
    import numpy as np  # noqa: PLC0415  (heavy)

    from rehab_opt import RedundancyResolver, ardis  # noqa: PLC0415
    from rehab_opt.kinematics.ardis import ARDIS_READY  # noqa: PLC0415

    robot, files = ardis(), set[str]()
    sys.setprofile(lambda frame, *_: files.add(frame.f_code.co_filename))
    try:
        resolver = RedundancyResolver(robot, compile=False)
        resolver.step(ARDIS_READY, [0.1, 0.05, 0.0])
        every = files.copy()
        files.clear()
        resolver.step(np.array(ARDIS_READY), np.array([0.1, 0.05, 0.0]))
    finally:
        sys.setprofile(None)
    ours = str(ROOT / "rehab_opt")
    return {each for each in every if each.startswith(ours)}, {each for each in files if each.startswith(ours)}


def _names_of_parts() -> int:
    """Lines of parts.in that say which file the next ones are."""
    return (ROOT / "rehab_opt/export/templates/parts.in").read_text(encoding="utf-8").count("\n===") + 1


def _lines(file: Path) -> int:
    return len(file.read_text(encoding="utf-8").splitlines())


def _code(files: Sequence[Path]) -> float:
    return sum(map(_code_lines, files)) / 1e3


def _code_lines(file: Path) -> int:
    text = file.read_text(encoding="utf-8")
    held: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in LAYOUT:
            held.update(range(token.start[0], token.end[0] + 1))
    return len(held - _texts(text) - _imports(text))


def _texts(text: str) -> set[int]:
    """Lines of docstrings, of attributes too."""
    found: set[int] = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            found.update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    return found


def _imports(text: str) -> set[int]:
    found: set[int] = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import | ast.ImportFrom):
            found.update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    return found


def _weights(wheel: Path) -> Iterator[tuple[str, int]]:
    """What the parts of a wheel weigh as they are compressed in it."""
    with zipfile.ZipFile(wheel) as archive:
        parts = archive.infolist()
        python = [each for each in parts if each.filename.endswith(".py")]
        bare = 0
        for each in python:
            text = archive.read(each).decode()
            told = _texts(text)
            lines = [line for number, line in enumerate(text.splitlines(), 1) if number not in told]
            bare += len(zlib.compress("\n".join(line for line in lines if line.lstrip()[:1] != "#").encode()))
    whole = sum(each.compress_size for each in python)
    problems = sum(each.compress_size for each in parts if "/problems/" in each.filename)
    yield "Python", whole
    yield "docstrings and comments of it", whole - bare
    yield "problems with their recordings", problems
    yield (
        "directory and hashes of its files",
        wheel.stat().st_size - sum(each.compress_size for each in parts if not each.filename.endswith("RECORD")),
    )


if __name__ == "__main__":
    sys.exit(main())
