"""DAQP's C in place of the stages of a compiled tick: `python -m bench.compiled_daqp FOLDER`.

The solve of a velocity tick is a chain of stages, each asked where those before it have no certified answer: A, the
statement's analytic solution; L, the active set of the last tick; D, the dual active set. Here they stand alone, are
left out, or make way for CasADi's qrqp (Q) or for DAQP's C, compiled beside them: its workspace is set up once, it is
told the active set of the last tick, and all of its problem is updated, since all of it changes. All solve the same
ticks: the recorded QPs, and those of controllers that are led at random. The time is that from a tick's parameters to
a certified answer; rounds alternate, a tick's time is the least of its rounds. Ticks count in which A does not hold.

FOLDER is DAQP's source distribution, unpacked (0.11 is known to work): `pip download --no-deps --no-binary :all: daqp`.
"""

from __future__ import annotations

import argparse
import ctypes
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from bench.compiled_ticks import Ticks, led_at_random, recorded
from bench.machine import machine
from bench.verdict import Reported, Verdict, all_met, print_verdicts
from rehab_opt.export.generated import generated, renamed
from rehab_opt.optim import fused as ours
from rehab_opt.optim.qp import Statement
from rehab_opt.symbolic.compiled import FLAGS

__all__ = ["main"]

Array = NDArray[np.float64]
SHIPPED, WARM, COLD = "A L D, as shipped", 2, 1
CHAINS = {SHIPPED: "AS", "L D": "LD", "A D": "AD", "A L Q": "ALQ", "A": "A", "L": "L", "D": "D", "Q": "Q", "A L": "AL"}
"""By their stages; S is L and D as shipped."""
WITH_DAQP = {
    "daqp, cold": ("", COLD), "daqp": ("", WARM), "A daqp": ("A", WARM), "A L daqp": ("AL", WARM),
    "behind all": ("AS", WARM),
}  # fmt: skip
"""DAQP behind a chain."""
Measured = dict[str, tuple[Array, Array]]
"""By variant: the least time of each tick [us], and its residual."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print a table for each set of ticks and the verdicts."""
    parser = argparse.ArgumentParser(prog="python -m bench.compiled_daqp", description=__doc__)
    parser.add_argument("folder", type=Path, help="DAQP's source distribution, unpacked")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--ticks", type=int, default=15_000, help="of each controller that is led at random")
    parser.add_argument("--only", default="", help="a part of the names of the sets of ticks")
    options = parser.parse_args(arguments)
    source, console = options.folder / "csrc", Console(width=max(Console().width, 110))
    if not (source / "include" / "api.h").is_file():
        print(f"{options.folder} holds no csrc/include/api.h: unpack DAQP's source distribution there", file=sys.stderr)
        return 1
    console.print("  ".join(f"{key}: {value}" for key, value in machine().items()), highlight=False)
    missed, allocated, total = 0, 0, 0
    with tempfile.TemporaryDirectory() as scratch:
        for ticks in (*recorded(options.only), *led_at_random(options.ticks, options.only)):
            found, more = measured(ticks, built(ticks, source, Path(scratch)), options.rounds)
            certified = {name: each[1] <= ticks.tolerance for name, each in found.items()}
            left = ~certified["A"]
            table = Table(
                "stages", "no answer", "median, us", "mean", "p99", "largest", title=f"{ticks.name}: {left.sum()}"
            )
            for name, (spent, _) in found.items():
                some = spent[left] if left.any() else np.full(1, np.nan)
                numbers = (np.median(some), some.mean(), np.percentile(some, 99), some.max())
                table.add_row(name, f"{(~certified[name])[left].sum()}", *(f"{number:.2f}" for number in numbers))
            console.print(table)
            for name in ("daqp", "A L daqp") if left.any() else ():
                for what, of in {"median": np.median, "p99": partial(np.percentile, q=99)}.items():
                    ratio = of(found[name][0][left]) / of(found[SHIPPED][0][left])
                    console.print(str(Reported(f"{ticks.name}: {name} / as shipped, {what}", ratio)), highlight=False)
            missed += int((~certified[SHIPPED] & (certified["behind all"] | certified["daqp, cold"])).sum())
            allocated, total = allocated + more, total + len(left)
    verdicts = [
        Verdict(f"of {total} ticks, those without an answer as shipped that DAQP answers", missed, "<=", 0),
        Verdict("allocations in DAQP's ticks once it is set up", allocated, "<=", 0),
    ]
    print_verdicts(console, verdicts)
    return int(not all_met(verdicts))


# --------------------------------------------------------------------------------------------------------------- stages
def stage(statement: Statement, letter: str) -> ca.Function:
    """Complete parameters, memory, start -> x, multipliers, residual, who answered, by one stage alone."""
    full, memory, start = inputs = ours._inputs(statement)
    if letter == "A":
        answer = ca.vertcat(*statement.screen(full, memory)[:2], 1)
    elif letter == "L":
        answer = ca.vertcat(ours._last_active_set(statement)(full, memory, start[statement.n :]), 2)
    elif letter == "D":
        answer = ours._dual_active_set(statement)(full, memory)
    else:
        return ours._made(statement) if letter == "S" else ours._qrqp(statement)
    return ca.Function(f"stage_{letter}", inputs, [answer])


def chain(stages: dict[str, ca.Function], letters: str, inputs: list[ca.MX]) -> ca.Function:
    """The stages in turn, each where those before it have no answer."""
    function = stages[letters[-1]]
    for k in reversed(range(len(letters) - 1)):
        found, name = stages[letters[k]](*inputs), f"chain_{letters[k:]}"
        answer = ours._choice(f"{name}_choice", function)(found[-2] <= ours.ANALYTIC_TOLERANCE, found, *inputs)
        function = ca.Function(name, inputs, [answer])
    return function


# ---------------------------------------------------------------------------------------------------------- measurement
def built(ticks: Ticks, source: Path, folder: Path) -> ctypes.CDLL:
    """Library of all chains of a statement, with DAQP beside them."""
    stated = ticks.statement
    stages, inputs = {letter: stage(stated, letter) for letter in "ALDQS"}, ours._inputs(stated)
    parts = [*(chain(stages, letters, inputs) for letters in CHAINS.values()), stated.build, stated.certify]
    functions = [renamed(function, f"part_{i}") for i, function in enumerate(parts)]
    code = generated(functions)
    values = {
        "FUNCTIONS": ", ".join(function.name() for function in functions), "BUILD": len(CHAINS),
        "CERTIFY": len(CHAINS) + 1, "ARGUMENTS": code.arguments, "RESULTS": code.results,
        "INTEGERS": code.integers + 1, "REALS": code.reals + 1, "VARS": stated.n, "ROWS": stated.m,
        "FULL": ticks.full.shape[1], "MEMORY": ticks.memory.shape[1],
    }  # fmt: skip
    defined = "".join(f"#define {name} {value}\n" for name, value in values.items())
    library, written = folder / f"{len(list(folder.iterdir()))}.so", folder / "driver.c"
    before, driver = "#include <stddef.h>\n#define CASADI_SYMBOL_EXPORT static\n", Path(__file__).with_suffix(".c")
    written.write_text(f"{before}{code.code}\n{defined}{driver.read_text(encoding='utf-8')}")
    counted = ["-Dmalloc=counted_malloc", "-Dcalloc=counted_calloc", f"-I{source / 'include'}"]
    sources = [str(written), *map(str, sorted((source / "src").glob("*.c")))]
    flags = ["-O3", *FLAGS[1:], "-std=gnu99", *counted]
    subprocess.run(["cc", *flags, *sources, "-o", str(library), "-lm"], check=True)
    return ctypes.CDLL(str(library))


def measured(ticks: Ticks, library: ctypes.CDLL, rounds: int) -> tuple[Measured, int]:
    """Times and residuals, and how often memory was allocated once DAQP was set up."""
    count, found, begun = len(ticks.full), Measured(), 0
    full, memory = np.ascontiguousarray(ticks.full), np.ascontiguousarray(ticks.memory)
    answers, spent = np.empty((count, 2 * ticks.statement.n + ticks.statement.m + 2)), np.empty(count)
    library.allocated.restype = ctypes.c_long
    places = list(CHAINS.values())
    variants = {name: (i, 0, 0.0) for i, name in enumerate(CHAINS)}
    for name, (letters, daqp) in WITH_DAQP.items():
        accept = ticks.tolerance if letters == CHAINS[SHIPPED] else ours.ANALYTIC_TOLERANCE
        variants[name] = (places.index(letters) if letters else -1, daqp, accept)
    for k in range(-1, rounds):  # the first round sets up
        for name, (which, daqp, accept) in variants.items():
            pointers = (ctypes.c_void_p(each.ctypes.data) for each in (full, memory, answers, spent))
            doubles = ctypes.c_double(accept), ctypes.c_double(ticks.tolerance)
            library.run(which, daqp, *doubles, ctypes.c_long(count), *pointers)
            least = np.minimum(spent, found[name][0]) if k > 0 else spent.copy()
            found[name] = least, answers[:, -2].copy()
        begun = library.allocated() if k < 0 else begun
    return {name: (each[0] / 1e3, each[1]) for name, each in found.items()}, library.allocated() - begun


if __name__ == "__main__":
    sys.exit(main())
