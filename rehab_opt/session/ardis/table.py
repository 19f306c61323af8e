"""What chair and arm did under one stick, as a table for the terminal."""

from __future__ import annotations

from collections.abc import Callable

from rich.table import Table
from rich.text import Text

from rehab_opt.session.ardis.outcome import LAWS, ArdisOutcome
from rehab_opt.session.shown import Numbers, Rows, counts, law_table

__all__ = ["brief", "table"]


def table(outcome: ArdisOutcome) -> Table:
    """Rows of quantities with their units, a column for each drive and law."""
    columns = _columns(outcome)
    grid = law_table(outcome.title, columns, (*FIRST_ROWS, *MORE_ROWS))
    for goal in outcome.goals:
        shares = (_leg(of["legs"].get(goal.name)) for of in columns.values())
        grid.add_row(Text(f"  on the way to: {goal.name}"), *shares)
    return grid


def brief(outcome: ArdisOutcome) -> Table:
    """The first of them."""
    return law_table(outcome.title, _columns(outcome), FIRST_ROWS)


def _columns(outcome: ArdisOutcome) -> dict[str, Numbers]:
    drives = outcome.metrics["drives"]
    return {f"{drive}\n{law}": drives[drive][law] for drive in drives for law in LAWS}


def _shares(name: str) -> Callable[[Numbers], str]:
    def cell(of: Numbers) -> str:
        arm = of[f"hand_{name}_arm_share"]
        return "-" if arm is None else f"{100 * arm:z.0f} / {100 * (1 - arm):z.0f}"

    return cell


def _leg(of: Numbers | None) -> str:
    if of is None:
        return "not reached"
    energy, alone = of["kinetic_energy_mean_J"], of["kinetic_energy_chair_alone_mean_J"]
    return f"{_shares('path')(of)}; {_joules(energy)} / {_joules(alone)}"


def _joules(energy: float | None) -> str:
    return "-" if energy is None else f"{energy:.2g}"


def _margin(kind: str) -> Callable[[Numbers], str]:
    def cell(of: Numbers) -> str:
        if of["excess_max"].get(kind) is None:
            return "-"
        return f"{-of['excess_max'][kind] + 0.0:.3g} ({100 * of['broken_share'][kind]:.1f} %)"

    return cell


def _residual(of: Numbers) -> str:
    residual = of["rolling_residual_max_m_s"]
    return "no such row" if residual is None else f"{residual:.1e}"


FIRST_ROWS: Rows = (
    ("goals reached", lambda of: f"{of['goals_met']} of {len(of['goals'])}"),
    ("duration, s", lambda of: f"{of['duration_s']:.1f}"),
    ("ticks that break a limit, %", lambda of: f"{100 * of['broken_any_share']:.2f}"),
    ("room to joint limits, rad (ticks beyond)", _margin("position")),
    ("arm to chair and user, m", _margin("keep_out")),
    ("chair to obstacles, m", _margin("obstacles")),
    ("ticks by status", lambda of: counts(of["status"])),
)
MORE_ROWS: Rows = (
    ("path of the hand; of the chair, m", lambda of: f"{of['hand_path_m']:.2f}; {of['chair_path_m']:.2f}"),
    ("hand's path given by arm / chair, %", _shares("path")),
    ("hand's turning given by arm / chair, %", _shares("turn")),
    (
        "mean kinetic energy / chair alone, J",
        lambda of: f"{_joules(of['kinetic_energy_mean_J'])} / {_joules(of['kinetic_energy_chair_alone_mean_J'])}",
    ),
    ("room to speeds, m/s or rad/s (ticks beyond)", _margin("velocity")),
    ("to accelerations, m/s^2 or rad/s^2", _margin("acceleration")),
    ("to wheel speeds, rad/s", _margin("wheels")),
    ("motion that the drive does not allow, m/s", _residual),
    ("largest tilt of the hand from its start, deg", lambda of: f"{of['hand_tilt_max_deg']:.2g}"),
    ("ticks in which something yielded", lambda of: counts(of["yielded"]) or "0"),
    ("ways: arm / chair, %; mean energy / chair alone, J", lambda of: ""),
)
