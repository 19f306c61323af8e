"""Each trial as a dot: what the laws did to deviation, force, speed and the clinical measures."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rehab_opt.session.drawing import GRID, MM, REFERENCE, framed, legend_below
from rehab_opt.session.scenario.measures import REACHES
from rehab_opt.session.scenario.outcome import ScenarioOutcome
from rehab_opt.session.scenario.plane_drawing import LAW_COLOURS

__all__ = ["compared", "comparison_figure"]

PERCENT = 100.0
SIDEWAYS = 0.18
"""Of a place on the axis: trials are set apart by so much to either side."""


def compared(outcome: ScenarioOutcome) -> tuple[tuple[str, str, float], ...]:
    """Label, key of the measure, and factor to the label's unit."""
    if outcome.mode == "hold":
        return (
            ("deviation, mean [mm]", "deviation_mean_m", MM),
            ("measured force\nwhile holding, mean [N]", "force_measured_held_mean_N", 1.0),
            ("speed while holding,\nmean [mm/s]", "speed_held_mean_m_s", MM),
            ("time on target [%]", "time_on_target_share", PERCENT),
        )
    whole = (
        ("deviation, mean [mm]", "deviation_mean_m", MM),
        ("measured force,\nmean [N]", "force_measured_mean_N", 1.0),
        ("speed, mean [mm/s]", "speed_mean_m_s", MM),
        ("smoothness, SPARC\n(nearer 0 is smoother)", "smoothness_sparc", 1.0),
    )
    if outcome.mode in REACHES:
        outside = ("deviation outside $W_c$,\nmean [mm]", "deviation_outside_mean_m", MM)
        return (outside, *whole[1:], ("distance to the target\nat the end [mm]", "final_distance_m", MM))
    return (*whole, ("path covered\nin order [%]", "reference_covered_share", PERCENT))


def comparison_figure(outcome: ScenarioOutcome) -> Figure:
    """A panel for each measure, laws beside each other, a bar at their mean."""
    chosen = compared(outcome)
    figure = framed(f"{outcome.title}\nevery trial under each law", 2.9 * len(chosen), 4.2)
    for axes, (label, key, factor) in zip(figure.subplots(1, len(chosen)), chosen, strict=True):
        _draw_measure(axes, outcome, key, factor)
        axes.set_title(label, fontsize=9.5, loc="left")
        axes.grid(**{**GRID, "axis": "y"})
    figure.axes[0].plot([], [], "o", color=REFERENCE, markersize=4, alpha=0.6, label="one trial")
    figure.axes[0].plot([], [], color=REFERENCE, linewidth=2.2, label="mean of the trials, also as a number")
    legend_below(figure, figure.axes[0], 2)
    return figure


def _draw_measure(axes: Axes, outcome: ScenarioOutcome, key: str, factor: float) -> None:
    for place, (law, measures) in enumerate(outcome.measures.items()):
        values = np.array([factor * of[key] for of in measures if of[key] is not None])
        if not len(values):
            axes.annotate("none", (place, 0.5), xycoords=("data", "axes fraction"), ha="center", fontsize=8)
            continue
        sideways = place + np.linspace(-SIDEWAYS, SIDEWAYS, len(values)) if len(values) > 1 else [place]
        axes.plot(sideways, values, "o", color=LAW_COLOURS[law], markersize=4, alpha=0.6)
        mean = values.mean()
        axes.plot([place - 0.32, place + 0.32], [mean, mean], color=LAW_COLOURS[law], linewidth=2.2)
        axes.annotate(
            f"{mean:.3g}", (place, 0.98), xycoords=("data", "axes fraction"), ha="center", va="top", fontsize=8.5,
            color=LAW_COLOURS[law],
        )  # fmt: skip
    axes.set_xlim(-0.6, len(outcome.measures) - 0.4)
    axes.set_xticks(range(len(outcome.measures)), list(outcome.measures), fontsize=8)
    low, high = axes.get_ylim()
    low = low if key == "smoothness_sparc" else 0.0
    high = 100.0 if factor == PERCENT else high
    axes.set_ylim(low, high + 0.15 * (high - low))  # room for the numbers
    if factor == PERCENT:
        axes.set_yticks(np.linspace(0, PERCENT, 6))
