"""Numbers of a run as cells of its table."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

__all__ = [
    "ROUNDING_DEG",
    "Numbers",
    "Rows",
    "counts",
    "length",
    "margin",
    "millimetres",
    "speed",
    "spread",
    "statuses",
    "times",
]

Numbers = Mapping[str, Any]
Rows = tuple[tuple[str, Callable[[Numbers], str]], ...]
"""Label, with its unit, and what to write there."""

ROUNDING_DEG = 1e-4  # tilts that differ by less are the same tilt
SMALL = 1e-3  # [mm] what is less is no length of a hand's path


def spread(name: str, unit: str) -> Callable[[Numbers], str]:
    """Mean, 95th percentile and maximum."""
    return lambda of: " / ".join(f"{of[f'{name}_{part}_{unit}']:.3g}" for part in ("mean", "p95", "max"))


def millimetres(name: str) -> Callable[[Numbers], str]:
    """Mean, 95th percentile and maximum of a length."""

    def cell(of: Numbers) -> str:
        of_all = [1e3 * of[f"{name}_{part}_m"] for part in ("mean", "p95", "max")]
        return f"all < {SMALL:g}" if max(of_all) < SMALL else " / ".join(length(part) for part in of_all)

    return cell


def length(millimetres: float) -> str:
    """A length, or that it is next to nothing."""
    return f"{millimetres:.3g}" if millimetres >= SMALL or millimetres == 0 else f"< {SMALL:g}"


def times(name: str) -> Callable[[Numbers], str]:
    """Median, 99th percentile and maximum of durations."""
    return lambda of: " / ".join(f"{of[f'{name}_{part}_ms']:.3g}" for part in ("median", "p99", "max"))


def margin(of: Numbers) -> str:
    """Least distance to a joint limit."""
    margin, joint = of["joint_limit_margin_min_deg"], of["joint_limit_margin_joint"]
    if margin is None:
        return "no limits"
    return f"{margin + 0.0 if abs(margin) >= 5e-4 else 0.0:.3f} ({joint.replace('_', ' ')})"


def speed(of: Numbers) -> str:
    """Speed of the fastest joint."""
    share = 100 * of["joint_speed_max_share_of_limit"]
    return (
        f"{of['joint_speed_max_deg_s']:.3g} ({share:.0f} % of limit, {of['joint_speed_max_joint'].replace('_', ' ')})"
    )


def statuses(of: Numbers) -> str:
    """How often each status occurred."""
    said = counts(of["status"])
    refuted = of.get("status_refuted", 0)
    return f"{said} ({refuted} REFUTED)" if refuted else said


def counts(counts: Mapping[str, int]) -> str:
    """How often each thing occurred."""
    return ", ".join(f"{count} {what}" for what, count in counts.items())
