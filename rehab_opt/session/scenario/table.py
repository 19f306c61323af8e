"""What came of a scenario's trials under each law, as a table for the terminal."""

from __future__ import annotations

import textwrap

from rich.table import Table
from rich.text import Text

from rehab_opt.session.scenario.measures import COVERED, law_summary
from rehab_opt.session.scenario.outcome import ScenarioOutcome
from rehab_opt.session.scenario.problem import THERAPY
from rehab_opt.session.shown import Cell, Numbers, Rows, law_table

__all__ = ["brief", "table"]

WRAPPED = 90
SUCCEEDED = "trials that succeeded, %; off at the end, mm"
"""The distance stands beside the share: two laws may end on either side of the threshold, and near each other."""
MM = 1e3
SUCCESS = {
    "stretch": "the end on the path", "assist": "at rest at the target in time,", "hold": "each point reached",
    "resist": "at rest at the target in time,", "follow": f"{100 * COVERED:g} % covered, the end",
}  # fmt: skip


def table(outcome: ScenarioOutcome) -> Table:
    """Rows of quantities with their units, a column for each law: the mean over its trials, and the worst of them."""
    summaries, grid = _summaries(outcome), _table(outcome, ())
    pairs = any("helper_force_mean_N" in of["mean"] for of in summaries.values())
    for heading, rows in _groups(outcome, pairs=pairs):
        grid.add_section()
        grid.add_row(Text(heading, style="bold"))
        for label, cell in rows:
            grid.add_row(Text(f"  {label}"), *map(cell, summaries.values()))
    return grid


def brief(outcome: ScenarioOutcome) -> Table:
    """The first of them."""
    rows: Rows = (
        *_covered(outcome, "path "),
        *_from_meant(outcome),
        (SUCCEEDED, _success),
        ("deviation, mean, mm", _number("deviation_mean_m", scale=MM)),
        ("deviation, largest, mm", _number("deviation_max_m", scale=MM)),
        ("force measured, mean, N", _number("force_measured_mean_N")),
        ("force measured, largest, N", _number("force_measured_max_N")),
        ("speed, largest, mm/s", _number("speed_max_m_s", scale=MM)),
        ("duration, s", _number("duration_s")),
        ("ticks by status, %", _statuses),
    )
    return _table(outcome, rows)


def _summaries(outcome: ScenarioOutcome) -> dict[str, Numbers]:
    return {law: law_summary(of) for law, of in outcome.measures.items()}


def _table(outcome: ScenarioOutcome, rows: Rows) -> Table:
    trials = max(map(len, outcome.trials.values()))
    said = (
        f"mode {outcome.mode}, trials each: {trials}; mean (worst trial); - is no number; success: "
        f"{SUCCESS[outcome.mode]} within {MM * outcome.within:g} mm"
    )
    return law_table("\n".join(textwrap.wrap(outcome.title, WRAPPED)), _summaries(outcome), rows, caption=said)


def _number(key: str, *, scale: float = 1.0) -> Cell:
    """Mean and worst; "never" for a time that a trial never came to."""

    def cell(of: Numbers) -> str:
        mean, worst = of["mean"].get(key), of["worst"].get(key)
        if mean is None:
            return "never" if key == "time_to_target_s" else "-"
        return f"{_short(scale * mean)} ({'never' if worst is None else _short(scale * worst)})"

    return cell


def _short(value: float) -> str:
    return f"{value:.3g}" if 0.001 <= abs(value) < 1000 or value == 0 else f"{value:.1e}"


def _percent(key: str) -> Cell:
    return lambda of: "-" if of["mean"][key] is None else f"{100 * of['mean'][key]:.3g} ({100 * of['worst'][key]:.3g})"


def _statuses(of: Numbers) -> str:
    return "\n".join(f"{100 * fraction:.3g} {status}" for status, fraction in of["mean"]["status_fraction"].items())


def _success(of: Numbers) -> str:
    return f"{100 * of['success_rate']:.0f}; {_number('final_distance_m', scale=MM)(of)}"


def _covered(outcome: ScenarioOutcome, of: str = "") -> list[tuple[str, Cell]]:
    """How much of a path was, for a path."""
    return [(f"{of}{outcome.coverage}, %", _percent("reference_covered_fraction"))] if outcome.mode == "follow" else []


def _from_meant(outcome: ScenarioOutcome) -> Rows:
    """How far, over time, the hand was from where the person meant to be."""
    label, follows = "from where the person meant to be, mean over time, mm", outcome.mode == "follow"
    return ((label, _number("from_intended_mean_m", scale=MM)),) if follows else ()


def _groups(outcome: ScenarioOutcome, *, pairs: bool) -> list[tuple[str, list[tuple[str, Cell]]]]:
    """Headings and rows: what says nothing about a mode is left out."""
    mode = outcome.mode
    reaches, holds = mode in THERAPY, mode == "hold"
    deviation: list[tuple[str, Cell]] = [
        ("mean, mm", _number("deviation_mean_m", scale=MM)),
        ("root mean square, mm", _number("deviation_rms_m", scale=MM)),
        ("95th percentile, mm", _number("deviation_p95_m", scale=MM)),
        ("largest, mm", _number("deviation_max_m", scale=MM)),
        ("mean outside W_c, mm", _number("deviation_outside_mean_m", scale=MM)),
        ("from where the person meant to be, mm", _number("from_intended_mean_m", scale=MM)),
    ]
    force: list[tuple[str, Cell]] = [
        ("measured, mean, N", _number("force_measured_mean_N")),
        ("measured, largest, N", _number("force_measured_max_N")),
        ("commanded, mean, N", _number("force_commanded_mean_N")),
        ("commanded, largest, N", _number("force_commanded_max_N")),
        ("commanded, largest change, N/s", _number("force_change_max_N_s")),
        ("work on the hand, J", _number("energy_delivered_J")),
    ]
    if reaches:
        force += [
            ("desired inside W_c, largest, N", _number("force_desired_inside_max_N")),
            ("zero after entering W_c, s", _number("time_to_zero_force_after_entry_max_s")),
        ]
    if mode == "resist":
        force += [
            ("towards the target, last quarter, N", _number("force_along_reference_last_quarter_mean_N")),
            ("towards the target, before it, N", _number("force_along_reference_before_mean_N")),
        ]
    motion: list[tuple[str, Cell]] = [
        ("speed, mean, mm/s", _number("speed_mean_m_s", scale=MM)),
        ("speed, largest, mm/s", _number("speed_max_m_s", scale=MM)),
        ("duration, s", _number("duration_s")),
    ]
    if holds:
        force.append(("measured while holding, mean, N", _number("force_measured_held_mean_N")))
        motion.append(("speed while holding, mean, mm/s", _number("speed_held_mean_m_s", scale=MM)))
    clinical: list[tuple[str, Cell]] = [
        (SUCCEEDED, _success),
        (
            "path of the hand / straight line" if reaches else "path of the hand / meant path",
            _number("path_length_ratio"),
        ),
        ("time on target, s", _number("time_on_target_s")),
    ]
    if reaches:
        clinical.insert(2, ("time to the target, s", _number("time_to_target_s")))
    else:
        clinical.append(("time on target, %", _percent("time_on_target_fraction")))
    if not holds:
        clinical.insert(1, ("smoothness (SPARC; nearer 0 is smoother)", _number("smoothness_sparc")))
    if holds:
        clinical.append(("points reached, %", _percent("goals_reached_fraction")))
    law: list[tuple[str, Cell]] = [
        ("ticks inside W_c, %", _percent("inside_fraction")),
        ("ticks by status, %", _statuses),
        ("releases", _number("releases")),
    ]
    pair: list[tuple[str, Cell]] = [
        ("force that the helper feels, mean, N", _number("helper_force_mean_N")),
        ("force that the helper feels, largest, N", _number("helper_force_max_N")),
        ("helper from where they meant to be, mm", _number("helper_deviation_mean_m", scale=MM)),
        ("drawn by both hands together, at most, J", _number("pair_energy_drawn_max_J")),
        ("energy left in a tank, least, J", _number("pair_energy_left_min_J")),
    ]
    headings: list[tuple[str, list[tuple[str, Cell]]]] = [
        ("Deviation from the point to be held" if holds else "Deviation from the reference", deviation),
        ("Force", force),
        ("Speed and time", motion),
        ("Clinical measures", clinical),
        ("Workspace and law", law),
    ]
    if mode == "follow":
        headings.insert(0, ("The path", _covered(outcome)))
        headings[1] = ("Deviation from the place of the path that is due", deviation)
    if pairs:
        headings.insert(-1, ("Helper and participant", pair))
    return headings
