"""What `import rehab_opt` costs above `import casadi, numpy`: `python -m bench.imports`.

Fresh interpreters, alternating, so that a drift of the machine hits both; compared are medians.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
from collections.abc import Sequence

from rich.console import Console

from bench.machine import machine
from bench.verdict import Verdict, all_met, print_verdicts

__all__ = ["main"]

_TIMED = "import time; begun = time.perf_counter(); import {}; print(time.perf_counter() - begun)"
_HEAVY = ("matplotlib", "ruckig", "osqp", "proxsuite", "qpsolvers", "scipy", "pydantic", "typer", "rich", "shapely")


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and judge; also name the heavy packages that came along."""
    parser = argparse.ArgumentParser(prog="python -m bench.imports", description=__doc__)
    parser.add_argument("--repeats", type=int, default=15)
    options = parser.parse_args(arguments)
    console = Console()
    console.print("  ".join(f"{key}: {value}" for key, value in machine().items()), highlight=False)
    base: list[float] = []
    ours: list[float] = []
    for warming in (True, *[False] * options.repeats):  # the first pair fills the disk cache and the byte code
        pair = seconds("casadi, numpy"), seconds("casadi, numpy, rehab_opt")
        if not warming:
            base.append(pair[0])
            ours.append(pair[1])
    before, after = statistics.median(base), statistics.median(ours)
    console.print(f"import casadi, numpy: {before:.3f} s; with rehab_opt: {after:.3f} s", highlight=False)
    console.print(f"loaded with it: {', '.join(loaded()) or 'none of ' + ', '.join(_HEAVY)}", soft_wrap=True)
    verdicts = [Verdict("import rehab_opt", after - before, "<=", 0.15, "s")]
    print_verdicts(console, verdicts)
    return 0 if all_met(verdicts) else 1


def seconds(modules: str) -> float:
    """Time of one import statement in a fresh interpreter [s]."""
    return float(_answer(_TIMED.format(modules)))


def loaded() -> list[str]:
    """Heavy packages that `import rehab_opt` loads and `import casadi, numpy` does not need."""
    names = _answer("import rehab_opt, sys; print(*{name.split('.')[0] for name in sys.modules})").split()
    return [name for name in _HEAVY if name in names]


def _answer(code: str) -> str:
    return subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout


if __name__ == "__main__":
    sys.exit(main())
