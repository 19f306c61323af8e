"""The whole comparison: every solver on every sequence, cold and warm, and what is written of it."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.qp_recording.sequence import read_sequence
from bench.solvers.entrant import Entrant
from bench.solvers.instances import Instances, RecordedQPs
from bench.solvers.judgement import Judge
from bench.solvers.machine import machine
from bench.solvers.passes import MODES, Pass, Rules, passed
from bench.solvers.programmes import Programmes, shipped_programmes
from bench.solvers.recommendation import recommendation_grid, recommendations
from bench.solvers.record import RECORD, Key, keep_pass, kept_passes, key_of, versions_of
from bench.solvers.reference import ACCURACY, Reference
from bench.solvers.shipped import shipped_sequences
from bench.solvers.summary import Row, comparable, rows_of
from bench.solvers.table import Grid, as_markdown, family_grids, overview_grids, refusal_grid
from bench.solvers.worker import THREADS, Worker
from rehab_opt.errors import ConfigurationError

__all__ = ["Comparison", "chosen_sequences", "compare", "header", "write_comparison"]

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Comparison:
    """What a comparison has found, whole or as far as it got.

    Parameters
    ----------
    done : every pass.
    hopeless : (T,) of each sequence: which ticks have no answer.
    about : machine, versions, settings, sequences and their references.
    limit : [s] of a solve.
    """

    done: tuple[Pass, ...]
    hopeless: dict[str, NDArray[np.bool_]]
    about: dict[str, Any]
    limit: float

    @cached_property
    def passes(self) -> tuple[Pass, ...]:
        """Those that can be compared: on the sequences of a family that all of its solvers have been through."""
        return comparable(self.done)

    @cached_property
    def rows(self) -> tuple[Row, ...]:
        """A row for every family, solver and mode."""
        return rows_of(self.passes, self.hopeless, limit=self.limit)

    @property
    def grids(self) -> list[Grid]:
        """The tables, in the order in which they are read."""
        refusals, advice = refusal_grid(self.rows), recommendation_grid(recommendations(self.rows))
        tail = [grid for grid in (refusals, advice) if grid.cells]
        return [*overview_grids(self.rows), *family_grids(self.rows), *tail]


def chosen_sequences(families: Sequence[str] | None) -> tuple[Instances, ...]:
    """The shipped sequences and programmes of these families; a name may also be that of one of them, or a file of QPs.

    Raises
    ------
    ConfigurationError : a name of neither kind. ProblemFileError : a file that is no sequence.
    """
    programmes = shipped_programmes()
    shipped = shipped_sequences() | programmes
    known = tuple(dict.fromkeys(name.partition("/")[0] for name in shipped))
    chosen: dict[str, Path] = {}
    for name in families or known:
        found = {each: path for each, path in shipped.items() if name in (each, each.partition("/")[0])}
        if not found and Path(name).is_file():
            found = {name: Path(name)}
        if not found:
            raise ConfigurationError("--family", name, f"a family: {', '.join(known)}; or a sequence, or its file")
        chosen |= found
    return tuple(
        Programmes(path) if name in programmes else RecordedQPs(read_sequence(path)) for name, path in chosen.items()
    )


def compare(
    sequences: Sequence[Instances],
    entrants: Sequence[Entrant],
    *,
    out: Path,
    rules: Rules,
    progress: Progress = lambda *_: None,
) -> Iterator[Comparison]:
    """Solve everything; yields what is known after each pass, the last one being all of it.

    Every finished pass is a line of `passes.jsonl` in `out`; passes that stand there, of the same numbers, versions,
    rules and processor, are not made again.

    Parameters
    ----------
    progress : told how many passes are done.

    Raises
    ------
    ConfigurationError : two sequences of one name.
    """
    if len({sequence.name for sequence in sequences}) < len(sequences):
        raise ConfigurationError("--family", [sequence.name for sequence in sequences], "sequences of different names")
    out.mkdir(parents=True, exist_ok=True)
    here, kept = machine(), kept_passes(out / RECORD)
    done: list[Pass] = []
    hopeless: dict[str, NDArray[np.bool_]] = {}
    about: dict[str, Any] = {
        "machine": here,
        "versions": {name: text for each in entrants for name, text in versions_of(each).items()},
        "settings": {**rules._asdict(), "threads": dict(THREADS), "reference_residual": ACCURACY},
        "sequences": {},
    }
    whole = sum(len(_own(sequence, entrants)) for sequence in sequences)
    worker = Worker()
    try:
        for sequence in sequences:
            known = sequence.references()
            judge = Judge(sequence, known, limit=rules.limit)
            hopeless[sequence.name] = np.array([judge.hopeless(tick) for tick in range(len(sequence))])
            about["sequences"][sequence.name] = _described(sequence, known)
            for entrant, mode in _own(sequence, entrants):
                progress("solvers on sequences", len(done), whole)
                key: Key = key_of(entrant, sequence, mode, rules=rules, processor=here["processor"])
                one = kept.get(key)
                if one is None:
                    one = passed(worker, entrant, sequence, mode=mode, judge=judge, rules=rules)
                    keep_pass(out / RECORD, key, one)
                done.append(one)
                now = {"loads": _loads(done), "passes": {"done": len(done), "of": whole}}
                yield Comparison(tuple(done), hopeless, {**about, **now}, rules.limit)
            progress("solvers on sequences", len(done), whole)
    finally:
        worker.stop()


def _own(sequence: Instances, entrants: Sequence[Entrant]) -> list[tuple[Entrant, str]]:
    """Who takes part in a sequence, in which modes."""
    return [(each, mode) for each in entrants if each.kind == sequence.kind for mode in MODES[sequence.kind]]


def write_comparison(found: Comparison, out: Path) -> tuple[Path, ...]:
    """Write results.json, table.md and the figures."""
    from bench.solvers.figures import figures_of  # noqa: PLC0415  (matplotlib)
    from rehab_opt.session.drawing import styled  # noqa: PLC0415
    from rehab_opt.session.report import write_figures  # noqa: PLC0415

    results, table = out / "results.json", out / "table.md"
    content = {**found.about, "rows": [_strict(row._asdict()) for row in found.rows]}
    results.write_text(json.dumps(_strict(content), indent=1, allow_nan=False) + "\n", encoding="utf-8")
    table.write_text(header(found) + "\n\n" + "\n".join(as_markdown(grid) for grid in found.grids), encoding="utf-8")
    with styled():
        figures = write_figures(figures_of(found.passes, found.rows, found.hopeless), out, "Solvers compared")
    return (results, table, *figures)


def header(found: Comparison) -> str:
    """One paragraph: where it was measured, with what, by which rules; first of all, whether it is whole."""
    about, settings, passes = found.about, found.about["settings"], found.about["passes"]
    part = "" if passes["done"] == passes["of"] else f"Not whole: {passes['done']} of {passes['of']} passes. "
    versions = ", ".join(f"{name} {text}" for name, text in sorted(about["versions"].items()))
    here = ", ".join(f"{name}: {text}" for name, text in about["machine"].items() if name != "load")
    return (
        f"{part}{here}, load: {about['loads']}, threads of a solver: 1. {versions}. "
        f"Time limit of a solve {settings['limit']:g} s; each tick's time is the smallest of at most "
        f"{settings['repeats']} passes; solved means certified at the sequence's tolerance."
    )


def _loads(passes: Sequence[Pass]) -> str:
    """Of the machine while each pass was made."""
    known = [done.load for done in passes if math.isfinite(done.load)]
    return f"{min(known):.1f} to {max(known):.1f}, median {np.median(known):.1f}" if known else "unknown"


def _described(sequence: Instances, known: Sequence[Reference]) -> dict[str, Any]:
    answered = [each for each in known if each.solver]
    return {
        "about": sequence.about,
        "command": sequence.command,
        "ticks": len(sequence),
        "variables": sequence.sizes[0],
        "rows": sequence.sizes[1],
        "tolerance": sequence.tolerance,
        "references": {name: sum(each.solver == name for each in known) for name in {each.solver for each in answered}},
        "references_within_accuracy": sum(each.residual <= ACCURACY for each in answered),
        "largest_reference_residual": max((each.residual for each in answered), default=math.nan),
    }


def _strict(value: Any) -> Any:
    """The same with null for what JSON has no number for."""
    if isinstance(value, Mapping):
        return {str(key): _strict(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_strict(each) for each in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
