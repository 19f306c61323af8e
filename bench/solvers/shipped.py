"""Where the recorded QPs and programmes lie, and the command that makes one again."""

from __future__ import annotations

from pathlib import Path

__all__ = ["families", "regenerate_command", "shipped_nlp_instances", "shipped_sequences"]

FOLDER = Path(__file__).parent


def shipped_sequences() -> dict[str, Path]:
    """Name and file of every sequence of QPs, in the order of their names."""
    return _files("qp")


def shipped_nlp_instances() -> dict[str, Path]:
    """Name and file of all instances of programmes, in the order of their names."""
    return _files("nlp")


def families() -> tuple[str, ...]:
    """The families of the sequences, in the order of their names."""
    return tuple(dict.fromkeys(name.partition("/")[0] for name in shipped_sequences()))


def regenerate_command(name: str) -> str:
    """What makes the file of that name again, on a shell."""
    return f"python -m bench.solvers.regenerate {name}"


def _files(kind: str) -> dict[str, Path]:
    folder = FOLDER / kind
    return {path.relative_to(folder).with_suffix("").as_posix(): path for path in sorted(folder.glob("*/*.npz"))}
