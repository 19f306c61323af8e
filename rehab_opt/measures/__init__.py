"""Clinical measures of a hand's movement: pure functions on arrays, in m, s and rad.

    even = evenly_sampled(time, points)
    velocity = hand_velocity(even.points, even.rate_hz)
    spectral_arc_length(np.linalg.norm(velocity, axis=1), even.rate_hz)

`score` computes all measures of one trial, and `rehab-opt score RECORDING` those of every trial in a recording. Each
docstring states paper, unit and formula; docs/capabilities/scoring.md states the effect of noise and slow sampling.
Data that cannot be measured (not finite, too few samples, no movement) raise `ConfigurationError`.
"""

from rehab_opt.measures.path import (
    end_error,
    end_variability,
    path_length,
    path_ratio,
    path_variability,
    range_used,
    workspace_used,
)
from rehab_opt.measures.samples import EvenSamples, evenly_sampled, hand_velocity, low_passed
from rehab_opt.measures.score import Measure, Score, score
from rehab_opt.measures.speed import (
    dimensionless_jerk,
    log_dimensionless_jerk,
    mean_speed,
    movement_interval,
    movement_time,
    peak_speed,
    spectral_arc_length,
    velocity_peaks,
)

__all__ = [
    "EvenSamples",
    "Measure",
    "Score",
    "dimensionless_jerk",
    "end_error",
    "end_variability",
    "evenly_sampled",
    "hand_velocity",
    "log_dimensionless_jerk",
    "low_passed",
    "mean_speed",
    "movement_interval",
    "movement_time",
    "path_length",
    "path_ratio",
    "path_variability",
    "peak_speed",
    "range_used",
    "score",
    "spectral_arc_length",
    "velocity_peaks",
    "workspace_used",
]
