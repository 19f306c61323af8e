"""Numbers kept to compare with, so that what a change alters is seen and meant.

Of every shipped problem metrics and the head of the trace; of single parts what `assert_kept` is given. What is right
is for other tests to say. `REHAB_OPT_KEEP=1 python -m pytest TEST` keeps new numbers of a part; with
`REHAB_OPT_KEEP=same`, in another environment, those that rounding leads elsewhere there are kept no longer.
`python -m tests.golden NAME` keeps those of a problem.
"""

from __future__ import annotations

import itertools
import json
import math
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

# As the tests' conftest does: with more threads sums round otherwise, and a map that is searched for ends elsewhere.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from rehab_opt.session.files import load_problem
from rehab_opt.session.run import run_problem

FOLDER, PARTS = Path(__file__).parent / "numbers", Path(__file__).parent / "parts"
KEEP, OPEN = "REHAB_OPT_KEEP", "~"
"""Variable that keeps numbers; what stands for one that is not the same everywhere."""
HEAD = 40
"""Rows of the trace that are kept."""
RELATIVE, ABSOLUTE = 1e-3, 1e-6
"""A number may differ by this fraction of itself, and by this in its unit: a closed loop amplifies rounding."""
COUNT = 2
"""Ticks by which a count may differ."""
TIMED = re.compile(r"_ms$|computing_s$|learning_s$|solve_time_s(\[|$)|\.seconds$")
"""Keys of the time that the computer took, which is not compared."""


def golden_file(name: str) -> Path:
    """File of a shipped problem's numbers."""
    return FOLDER / f"{name.replace('/', '.')}.json"


def measured(name: str) -> dict[str, Any]:
    """Metrics without the parameters, and the first `HEAD` rows of the trace, of a run of a shipped problem."""
    outcome = run_problem(load_problem(name))
    metrics = {key: value for key, value in outcome.metrics.items() if key != "parameters"}
    trace = {header: [*map(_plain, itertools.islice(cells, HEAD))] for header, cells in outcome.trace()}
    return json.loads(json.dumps({"metrics": metrics, "trace": trace}))  # type: ignore[no-any-return]


def assert_kept(name: str, new: Any, *, relative: float = 1e-6, absolute: float = 1e-9) -> None:
    """The numbers, arrays and texts of a part are those kept in `tests/golden/parts/NAME.json`; counts are equal."""
    file, tolerance = PARTS / f"{name}.json", (relative, absolute, 0)
    new = json.loads(json.dumps(new, default=_rounded))
    if os.environ.get(KEEP) == "1":
        file.write_text(json.dumps(new) + "\n")
    kept = json.loads(file.read_text())
    if os.environ.get(KEEP) == "same":
        kept = _same(kept, new, tolerance)
        file.write_text(json.dumps(kept) + "\n")
    found = list(differences(kept, new, tolerance=tolerance))
    assert not found, f"{len(found)} numbers differ; {KEEP}=1 keeps the new ones:\n" + "\n".join(found[:20])


def differences(
    kept: Any, new: Any, key: str = "", *, tolerance: tuple[float, float, int] = (RELATIVE, ABSOLUTE, COUNT)
) -> Iterator[str]:
    """Each value that is not within the tolerances, with the value kept and the new one."""
    if (isinstance(kept, str) and kept == OPEN) or TIMED.search(key):
        return
    if isinstance(kept, dict) and isinstance(new, dict):
        for each in [*kept, *(name for name in new if name not in kept)]:
            yield from differences(
                kept.get(each, "absent"), new.get(each, "absent"), f"{key}.{each}".lstrip("."), tolerance=tolerance
            )
    elif isinstance(kept, list) and isinstance(new, list) and len(kept) == len(new):
        for i, (one, other) in enumerate(zip(kept, new, strict=True)):
            yield from differences(one, other, f"{key}[{i}]", tolerance=tolerance)
    elif not _alike(kept, new, *tolerance):
        yield f"{key}: {kept} -> {new}"


def _alike(kept: Any, new: Any, relative: float, absolute: float, count: int) -> bool:
    if not all(isinstance(each, int | float) and not isinstance(each, bool) for each in (kept, new)):
        return bool(kept == new)
    if math.isnan(kept) or math.isnan(new):
        return math.isnan(kept) and math.isnan(new)
    if isinstance(kept, int) and isinstance(new, int):
        absolute, relative = count, relative if count else 0
    return kept == new or abs(new - kept) <= absolute + relative * abs(kept)


def _same(kept: Any, new: Any, tolerance: tuple[float, float, int]) -> Any:
    """What is kept, `OPEN` in place of what differs."""
    if isinstance(kept, dict) and isinstance(new, dict):
        return {key: _same(kept.get(key, OPEN), new.get(key, OPEN), tolerance) for key in kept | new}
    if isinstance(kept, list) and isinstance(new, list) and len(kept) == len(new):
        return [_same(one, other, tolerance) for one, other in zip(kept, new, strict=True)]
    return OPEN if list(differences(kept, new, tolerance=tolerance)) else kept


def _rounded(value: Any) -> Any:
    """An array as lists of numbers of twelve digits."""
    values = np.asarray(value)
    return [float(f"{each:.12g}") for each in values.ravel()] if values.dtype.kind == "f" else values.ravel().tolist()


def _plain(value: Any) -> Any:
    """Python's own number or text, a float with nine digits as in trace.csv."""
    value = value.item() if hasattr(value, "item") else value
    return float(f"{value:.9g}") if isinstance(value, float) else value
