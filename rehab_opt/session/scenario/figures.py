"""Figures of scenarios, like Figs. 4, 6, 7, 9 and 10 of Rossa et al."""

from __future__ import annotations

from matplotlib.figure import Figure

from rehab_opt.session.scenario.along_figure import along_figure
from rehab_opt.session.scenario.comparison_figure import comparison_figure
from rehab_opt.session.scenario.deviation_figure import deviation_figure
from rehab_opt.session.scenario.field_figure import field_figure
from rehab_opt.session.scenario.learnt_figure import learnt_figure
from rehab_opt.session.scenario.measures import REACHES
from rehab_opt.session.scenario.outcome import ScenarioOutcome
from rehab_opt.session.scenario.parameter_figure import parameter_figure
from rehab_opt.session.scenario.robot_figure import late_trial, robot_figure
from rehab_opt.session.scenario.together_figure import pairs_of, together_figure
from rehab_opt.session.scenario.trials_figure import trials_figure

__all__ = ["scenario_figures"]


def scenario_figures(outcome: ScenarioOutcome) -> dict[str, Figure]:
    """The figures by file name (without suffix).

    "parameters" is left out for "hold": around a single point the field is a spring, whatever sigma and k1.
    """
    drawn = {
        "field": field_figure(outcome),
        "trials": trials_figure(outcome),
        "comparison": comparison_figure(outcome),
    }
    if outcome.shown:
        drawn["learnt"] = learnt_figure(outcome)
    if outcome.mode != "hold":
        drawn["parameters"] = parameter_figure(outcome)
    if outcome.mode not in REACHES:
        drawn["deviation"] = deviation_figure(outcome)
    if outcome.mode == "resist":
        drawn["along"] = along_figure(outcome)
    if pairs_of(outcome):
        drawn["together"] = together_figure(outcome)
    late = late_trial(outcome)
    if late is not None:
        drawn["robot"] = robot_figure(outcome.title, late)
    return drawn
