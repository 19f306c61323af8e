"""What has been measured, one line a pass, only ever added to: an interrupted comparison goes on where it stopped."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, NamedTuple

from bench.solvers.entrant import Entrant
from bench.solvers.instances import Instances
from bench.solvers.judgement import Judged, Outcome
from bench.solvers.passes import Pass, Rules
from rehab_opt.session.inputs import software_digest
from rehab_opt.symbolic.compiled import compilation_wanted

__all__ = ["RECORD", "Key", "keep_pass", "kept_passes", "key_of", "versions_of"]

RECORD = "passes.jsonl"


class Key(NamedTuple):
    """A pass is done again where any of these differs."""

    solver: str
    sequence: str
    mode: str
    digest: str


def key_of(entrant: Entrant, sequence: Instances, mode: str, *, rules: Rules, processor: str) -> Key:
    """Key of a pass: its names, the numbers, the source of the library and of this, versions, rules and processor."""
    source = [software_digest(), _own_digest()]
    rest = [sequence.digest, sequence.tolerance, *source, versions_of(entrant), rules, processor]
    if not compilation_wanted():
        rest.append("virtual machine")
    digest = hashlib.sha256(json.dumps(rest).encode())
    return Key(entrant.name, sequence.name, mode, digest.hexdigest()[:16])


@cache
def _own_digest() -> str:
    """Of the comparison's source, which is no part of the library's."""
    sources = sorted(Path(__file__).parent.glob("*.py"))
    return hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()


def versions_of(entrant: Entrant) -> dict[str, str]:
    """Of every package that the entrant needs."""
    found = {}
    for name in entrant.packages:
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


def keep_pass(file: Path, key: Key, done: Pass) -> None:
    """Add one line to the file."""
    columns: dict[str, list[Any]] = {
        "outcomes": [tick.outcome.value for tick in done.ticks],
        "seconds": [_number(tick.seconds) for tick in done.ticks],
        "residuals": [_number(tick.residual) for tick in done.ticks],
        "distances": [_number(tick.distance) for tick in done.ticks],
        "said": [tick.said for tick in done.ticks],
    }
    line = json.dumps({**key._asdict(), "load": _number(done.load), **columns}, allow_nan=False)
    whole = not file.exists() or file.read_bytes().endswith(b"\n")
    with file.open("a", encoding="utf-8") as out:
        out.write(("" if whole else "\n") + line + "\n")


def kept_passes(file: Path) -> dict[Key, Pass]:
    """What an earlier run left; a line that was cut off is none."""
    return dict(_lines(file)) if file.exists() else {}


def _lines(file: Path) -> Iterator[tuple[Key, Pass]]:
    for line in file.read_text(encoding="utf-8", errors="replace").splitlines():
        try:
            read = json.loads(line)
            key = Key(*(str(read[name]) for name in Key._fields))
            columns = [read[name] for name in ("outcomes", "seconds", "residuals", "distances", "said")]
            ticks = tuple(
                Judged(Outcome(outcome), _read(seconds), _read(residual), _read(distance, math.nan), str(said))
                for outcome, seconds, residual, distance, said in zip(*columns, strict=True)
            )
            load = _read(read.get("load"), math.nan)
        except (ValueError, KeyError, TypeError):
            continue
        yield key, Pass(key.solver, key.sequence, key.mode, ticks, load)


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _read(value: Any, absent: float = math.inf) -> float:
    return absent if value is None else float(value)
