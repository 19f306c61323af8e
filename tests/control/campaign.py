"""What the campaigns share: hostile numbers, the tally of what was seen, the joints nothing could hold, `main`."""

from __future__ import annotations

import argparse
import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rehab_opt import Command, Relaxed, SerialChain, Status

Array = NDArray[np.float64]
HOSTILE = (math.nan, math.inf, -math.inf, 1e300, -1e300, 1e7, 1e-320)
ROUNDING = 1e-9
"""[rad or m] What arithmetic on numbers of this size may miss a bound by."""


@dataclass
class Tally:
    """What was seen: ticks, their answers, the faults that were made, the worst of each number, and broken claims."""

    cases: int = 0
    statuses: Counter[Status] = field(default_factory=Counter)
    solvers: Counter[str] = field(default_factory=Counter)
    relaxed: Counter[Relaxed] = field(default_factory=Counter)
    faults: Counter[str] = field(default_factory=Counter)
    seen: Counter[str] = field(default_factory=Counter)
    largest: dict[str, float] = field(default_factory=dict)
    broken: list[str] = field(default_factory=list)

    def count(self, command: Command) -> None:
        """One more tick, and who answered."""
        self.cases += 1
        self.statuses[command.status] += 1
        self.solvers[command.solver] += 1
        self.relaxed[command.relaxed] += 1

    def worst(self, name: str, value: float) -> float:
        """`value`, kept where it is the largest of this name; one that is no number stays the largest."""
        known = self.largest.get(name, -math.inf)
        self.largest[name] = known if value <= known or math.isnan(known) else value
        return value

    def show(self) -> None:
        """Print it all, with the first broken claims."""
        print(f"{self.cases} ticks; faults {dict(self.faults)}")
        print("answers", {status.value: count for status, count in self.statuses.items()}, dict(self.solvers))
        print("relaxed", {str(bound): count for bound, count in self.relaxed.items()}, dict(self.seen))
        print("largest", {name: f"{value:.3g}" for name, value in self.largest.items()})
        print(f"broken claims: {len(self.broken)}", dict(Counter(line.partition(":")[0] for line in self.broken)))
        for line in self.broken[:10]:
            print(" ", line)


def must_exceed(chain: SerialChain, q: Array, last: Array, dt: float, back: Array) -> NDArray[np.bool_]:
    """Joints that, with the largest change, would be beyond a limit, further beyond, or back faster than `back`."""
    gentlest_up, gentlest_down = last - chain.acceleration * dt, last + chain.acceleration * dt
    above, below = q > chain.upper, q < chain.lower
    return (
        (q + gentlest_up * dt > np.maximum(chain.upper, q))
        | (q + gentlest_down * dt < np.minimum(chain.lower, q))
        | (above & (gentlest_down < -back))
        | (below & (gentlest_up > back))
    )


def main(
    run: Callable[[int, int], Tally], description: str | None, *, unit: str = "cases", many: int = 100_000
) -> None:
    """Command line: run, print, and exit with 1 where a claim broke."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument(f"--{unit}", type=int, default=many, dest="many")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    tally = run(options.many, options.seed)
    tally.show()
    raise SystemExit(bool(tally.broken))
