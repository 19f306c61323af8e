"""The result of a followed path as a table for the terminal."""

from __future__ import annotations

from rich.table import Table
from rich.text import Text

from rehab_opt.session.cells import (
    ROUNDING_DEG,
    Numbers,
    Rows,
    length,
    margin,
    millimetres,
    speed,
    statuses,
    times,
)
from rehab_opt.session.outcome import Outcome
from rehab_opt.session.upper_limb.notes import DRIVEN_DEG
from rehab_opt.session.upper_limb.outcome import ArmOutcome

__all__ = ["arm_table"]


def arm_table(outcome: ArmOutcome) -> Table:
    """Rows of quantities with their units, a column for each law."""
    table = Table(title=Text(outcome.title), caption=_caption(outcome), caption_justify="left")
    table.add_column("quantity")
    for run in outcome.laws:
        table.add_column(run.law, justify="right")
    for label, value in ARM_ROWS:
        table.add_row(label, *(value(outcome.metrics[run.law]) for run in outcome.laws))
    return table


def _caption(outcome: Outcome) -> str:
    share, of_time = (outcome.metrics[f"reachable_share_of_{of}"] for of in ("length", "time"))
    if share is None:
        return "the share of the path within reach is not known: run the optimised law"
    length = 1e3 * outcome.metrics["path_length_m"]
    return (
        f"within this arm's reach: {100 * share:.1f} % of the path's {length:.0f} mm, {100 * of_time:.1f} % of its time"
    )


def _reachable_error(of: Numbers) -> str:
    error = of["position_error_reachable_max_m"]
    return "not known" if error is None else length(1e3 * error)


def _parameters(of: Numbers) -> str:
    chosen = of["parameters"]
    if "damping" in chosen:
        return f"k0 = {chosen['gain_per_s']:g}/s, mu = {chosen['damping']:g}"
    return f"solver {chosen['solver']}"


def _tilt(of: Numbers, limit: float, rounding: float) -> str:
    tilt = of["handle_tilt_max_deg"]
    return f"{tilt:.3g} ({limit:g})" + (" BEYOND" if tilt > limit + rounding else "")


def _share(of: Numbers) -> str:
    return f"{100 * of['followed_share_of_length']:.1f}"


def _hurry(of: Numbers) -> str:
    shares = (of["drive"][f"joint_{of_what}_max_share_of_limit"] for of_what in ("speed", "acceleration"))
    return "; ".join(f"{share:.2f}" for share in shares)


ARM_ROWS: Rows = (
    ("parameters", _parameters),
    ("path followed by a drive to 1 mm, % of length", lambda of: _share(of["drive"])),
    ("   later than the recording at its end, s", lambda of: f"{of['drive']['delay_s']:.3g}"),
    ("   position error mean / p95 / max, mm", lambda of: millimetres("position_error")(of["drive"])),
    ("   handle tilt max (limit), deg", lambda of: _tilt(of["drive"], of["handle_tilt_limit_deg"], DRIVEN_DEG)),
    ("   fastest joint; acceleration, share of limit", _hurry),
    ("path followed by the law to 1 mm, % of length", _share),
    ("   position error mean / p95 / max, mm", millimetres("position_error")),
    ("   max where the path is within reach, mm", _reachable_error),
    ("   handle tilt max (limit), deg", lambda of: _tilt(of, of["handle_tilt_limit_deg"], ROUNDING_DEG)),
    ("   fastest joint, deg/s (share of limit)", speed),
    ("smallest joint-limit margin, deg", margin),
    ("solve time of the first sample, ms", lambda of: f"{of['solve_time_first_ms']:.3g}"),
    ("   of the others, median / p99 / max, ms", times("solve_time")),
    ("samples by status", statuses),
)
