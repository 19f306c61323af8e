"""The result of a run as a table for the terminal."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from rich.table import Table
from rich.text import Text

from rehab_opt.session.notes import ROUNDING_DEG
from rehab_opt.session.outcome import ArmOutcome, Outcome

__all__ = ["result_table"]

Numbers = Mapping[str, Any]

TRACKER = "PoseTracker"
SHARE_SHOWN = 0.05  # [%] shares that differ by less look the same
SMALL = 1e-3  # [mm] what is less is no length of a hand's path


def result_table(outcome: Outcome) -> Table:
    """Rows of quantities with their units, a column for each law."""
    arm = isinstance(outcome, ArmOutcome)
    laws = {run.law: run.law for run in outcome.laws} if isinstance(outcome, ArmOutcome) else {"optimised": TRACKER}
    table = Table(title=Text(outcome.title), caption=_caption(outcome) if arm else None, caption_justify="left")
    table.add_column("quantity")
    for name in laws.values():
        table.add_column(name, justify="right")
    for label, value in ARM_ROWS if arm else ROBOT_ROWS:
        table.add_row(label, *(value(outcome.metrics[law]) for law in laws))
    return table


def _caption(outcome: Outcome) -> str:
    share, of_time = (outcome.metrics[f"reachable_share_of_{of}"] for of in ("length", "time"))
    if share is None:
        return "the share of the path within reach is not known: run the optimised law"
    length = 1e3 * outcome.metrics["path_length_m"]
    return (
        f"within this arm's reach: {100 * share:.1f} % of the path's {length:.0f} mm, {100 * of_time:.1f} % of its time"
    )


def _spread(name: str, unit: str) -> Callable[[Numbers], str]:
    return lambda of: " / ".join(f"{of[f'{name}_{part}_{unit}']:.3g}" for part in ("mean", "p95", "max"))


def _millimetres(name: str) -> Callable[[Numbers], str]:
    """Mean, 95th percentile and maximum of a length."""

    def cell(of: Numbers) -> str:
        spread = [1e3 * of[f"{name}_{part}_m"] for part in ("mean", "p95", "max")]
        return f"all < {SMALL:g}" if max(spread) < SMALL else " / ".join(_length(length) for length in spread)

    return cell


def _length(millimetres: float) -> str:
    return f"{millimetres:.3g}" if millimetres >= SMALL or millimetres == 0 else f"< {SMALL:g}"


def _times(name: str) -> Callable[[Numbers], str]:
    return lambda of: " / ".join(f"{of[f'{name}_{part}_ms']:.3g}" for part in ("median", "p99", "max"))


def _margin(of: Numbers) -> str:
    margin, joint = of["joint_limit_margin_min_deg"], of["joint_limit_margin_joint"]
    if margin is None:
        return "no limits"
    return f"{margin + 0.0 if abs(margin) >= 5e-4 else 0.0:.3f} ({joint.replace('_', ' ')})"


def _speed(of: Numbers) -> str:
    share = 100 * of["joint_speed_max_share_of_limit"]
    return (
        f"{of['joint_speed_max_deg_s']:.3g} ({share:.0f} % of limit, {of['joint_speed_max_joint'].replace('_', ' ')})"
    )


def _reachable_error(of: Numbers) -> str:
    error = of["position_error_reachable_max_m"]
    return "not known" if error is None else _length(1e3 * error)


def _parameters(of: Numbers) -> str:
    chosen = of["parameters"]
    if "damping" in chosen:
        return f"k0 = {chosen['gain_per_s']:g}/s, mu = {chosen['damping']:g}"
    return f"solver {chosen['solver']}"


def _tilt(of: Numbers, limit: float) -> str:
    tilt = of["handle_tilt_max_deg"]
    return f"{tilt:.3g} ({limit:g})" + (" BEYOND" if tilt > limit + ROUNDING_DEG else "")


def _delivered(of: Numbers) -> str:
    least, moving = 100 * of["scale_min"], of["scale_min_moving"]
    if moving is None or 100 * moving - least < SHARE_SHOWN:
        return f"{least:.1f}"
    return f"{100 * moving:.1f} ({least:.1f} below 1 mm/s)"


def _statuses(of: Numbers) -> str:
    said = _counts(of["status"])
    refuted = of.get("status_refuted", 0)
    return f"{said} ({refuted} REFUTED)" if refuted else said


def _counts(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {what}" for what, count in counts.items())


Rows = tuple[tuple[str, Callable[[Numbers], str]], ...]

ARM_ROWS: Rows = (
    ("parameters", _parameters),
    ("path followed to 1 mm, % of length", lambda of: f"{100 * of['followed_share_of_length']:.1f}"),
    ("position error mean / p95 / max, mm", _millimetres("position_error")),
    ("   max where the path is within reach, mm", _reachable_error),
    ("handle tilt max (limit), deg", lambda of: _tilt(of, of["handle_tilt_limit_deg"])),
    ("smallest joint-limit margin, deg", _margin),
    ("fastest joint, deg/s (share of limit)", _speed),
    ("solve time of the first sample, ms", lambda of: f"{of['solve_time_first_ms']:.3g}"),
    ("   of the others, median / p99 / max, ms", _times("solve_time")),
    ("samples by status", _statuses),
    (
        "smoothed: path followed to 1 mm, % of length",
        lambda of: f"{100 * of['smoothed']['followed_share_of_length']:.1f}",
    ),
    ("   handle tilt max (limit), deg", lambda of: _tilt(of["smoothed"], of["handle_tilt_limit_deg"])),
    (
        "   lag, ms; largest deviation, deg",
        lambda of: f"{1e3 * of['smoothed']['lag_s']:.0f}; {of['smoothed']['deviation_max_deg']:.3g}",
    ),
    ("   hand from the law's own, max, mm", lambda of: _length(1e3 * of["smoothed"]["hand_deviation_max_m"])),
    ("   ticks by status", lambda of: _counts(of["smoothed"]["status"])),
)

ROBOT_ROWS: Rows = (
    ("parameters", _parameters),
    ("position error mean / p95 / max, mm", _millimetres("position_error")),
    ("orientation error mean / p95 / max, deg", _spread("orientation_error", "deg")),
    ("smallest joint-limit margin, deg", _margin),
    ("fastest joint, deg/s (share of limit)", _speed),
    ("least share of the asked motion delivered, %", _delivered),
    ("tick time median / p99 / max, ms", _times("tick")),
    ("ticks by status", _statuses),
    (
        "ticks in which something yielded",
        lambda of: _counts(of["yielded"]) or "0",
    ),
)
