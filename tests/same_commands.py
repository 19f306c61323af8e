"""Whether another version of the library commands the same in every tick of the judges' runs.

    python -m tests.same_commands commands.npz --ticks 100000 --seed 7    # in the tree before: writes the file
    python -m tests.same_commands commands.npz                            # in the tree after: compares with it

The runs are closed loops: what differs in one tick comes back in the next, so the first tick that differs is told, of
each judge. Ends with 1 where a status, a reason or a number of commands is another, or values are further apart than
`--within`, by default not at all.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rehab_opt import Assistance, Bilateral, MirrorTracker, PathAssistance, PoseTracker, RedundancyResolver, Smoother
from rehab_opt.control.command import Command
from tests.judge.verdict import hearing, judges

CONTROLLERS = (Assistance, Bilateral, MirrorTracker, PathAssistance, PoseTracker, RedundancyResolver, Smoother)
SMALLEST = 50
"""Ticks a judge, where few are asked for."""


@contextmanager
def heard(tick: Callable[[Any], None]) -> Iterator[None]:
    """Meanwhile, `tick` is told each answer of a public controller's `step`."""
    plain = {kind: kind.step for kind in CONTROLLERS}

    def telling(step: Callable[..., Any]) -> Callable[..., Any]:
        def told(*args: Any, **options: Any) -> Any:
            answer = step(*args, **options)
            tick(answer)
            return answer

        return told

    for kind, step in plain.items():
        kind.step = telling(step)  # type: ignore[method-assign]
    try:
        yield
    finally:
        for kind, step in plain.items():
            kind.step = step  # type: ignore[method-assign]


def commands_in(answer: Any) -> Iterator[Command]:
    """Those of a tick: a pair of sides has two."""
    if isinstance(answer, Command):
        yield answer
    elif isinstance(answer, tuple):
        for each in answer:
            yield from commands_in(each)


def commands_of(judge: str, ticks: int, seed: int) -> dict[str, NDArray[Any]]:
    """Values, one after the other, and what else a command says, of every tick of a judge's runs."""
    values, said = list[NDArray[np.float64]](), list[str]()

    def tick(answer: Any) -> None:
        for command in commands_in(answer):
            values.append(np.array(command.value, dtype=np.float64))
            said.append(f"{command.status.name} {int(command.relaxed)} {command.scale:.9g} {command.reason}")

    with heard(tick):
        hearing(judge, ticks, seed, None)
    lengths = np.array([len(each) for each in values], dtype=int)
    return {"lengths": lengths, "values": np.concatenate([*values, []]), "said": np.array(said or [""])}


def compared(before: dict[str, NDArray[Any]], after: dict[str, NDArray[Any]], within: float) -> tuple[bool, str]:
    """Whether both are alike, and what is to be said of it."""
    count = len(before["lengths"])
    if not np.array_equal(before["lengths"], after["lengths"]):
        return False, f"{count} commands before, {len(after['lengths'])} after"
    far = np.abs(before["values"] - after["values"])
    tick_of = np.repeat(np.arange(count), before["lengths"])
    other = np.flatnonzero(before["said"] != after["said"])
    beyond = tick_of[~(far <= within)]
    if other.size or beyond.size:
        k = int(min([*other[:1], *beyond[:1]]))
        apart = far[tick_of == k].max(initial=0.0)
        return (
            False,
            f"tick {k} of {count}: {apart:.3g} apart; {before['said'][k]!r} before, {after['said'][k]!r} after",
        )
    return True, f"{count} commands alike, at most {far.max(initial=0.0):.3g} apart"


def main() -> int:
    """Record, or compare where the file is there."""
    parser = argparse.ArgumentParser(prog="python -m tests.same_commands", description=__doc__)
    parser.add_argument("file", type=Path, help="written where it is absent, else compared with")
    parser.add_argument("--ticks", type=int, default=100_000, help="of all judges together")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--within", type=float, default=0.0, help="how far apart values may be")
    parser.add_argument("--only", nargs="+", metavar="NAME")
    options = parser.parse_args()
    if not options.file.exists():
        names = list(judges(options.only))
        kept: dict[str, Any] = {"ticks": options.ticks, "seed": options.seed, "names": np.array(names)}
        for name in names:
            found = commands_of(name, max(options.ticks // len(names), SMALLEST), options.seed)
            kept |= {f"{name} {key}": value for key, value in found.items()}
            print(f"{name}: {len(found['lengths'])} commands", flush=True)
        np.savez_compressed(options.file, **kept)
        return 0
    alike = True
    with np.load(options.file) as kept:
        names = [name for name in kept["names"].tolist() if options.only is None or name in options.only]
        for name in names:
            before = {key: kept[f"{name} {key}"] for key in ("lengths", "values", "said")}
            ticks = max(int(kept["ticks"]) // len(kept["names"]), SMALLEST)
            same, words = compared(before, commands_of(name, ticks, int(kept["seed"])), options.within)
            alike = alike and same
            print(f"{'same' if same else 'OTHER'} {name}: {words}", flush=True)
    return int(not alike)


if __name__ == "__main__":
    sys.exit(main())
