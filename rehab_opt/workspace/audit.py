"""Audit of a map between workspaces: statistics at random points, and a proof for the points between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from rehab_opt.workspace.certificate import Certificate
    from rehab_opt.workspace.region import Workspace

__all__ = ["MAX_STRETCH", "ROUND_TRIP", "SMALLEST_STRETCH", "Audit", "random_points"]

# Local stretch over the pair's overall ratio from which a map is refused. Between a disc and a set ten times as long as
# wide a map of equal areas must stretch by sqrt(10) = 3.2 somewhere; half as much again is a margin for shape. If W_c
# (6 cm) drives W_r (overall 5.4), a tremor of 2 mm then moves the other side by 5.4 cm at most.
MAX_STRETCH = 5.0
SMALLEST_STRETCH = 1.0 / MAX_STRETCH
# [m]
ROUND_TRIP = 1e-9


@dataclass(frozen=True)
class Audit:
    """Results of the audit of one map.

    samples : number of points drawn uniformly from the source.
    folded : fraction of the samples where det J <= 0 or is NaN.
    outside : fraction of the samples mapped outside the target.
    max_stretch, min_stretch : singular values of J over the samples [-].
    overall_ratio : sqrt(area of the target / area of the source) [-].
    round_trip : largest |inverse(map(x)) - x| [m]; infinite if an inverse was not found.
    coverage : fraction of the target's area that the image of the source covers.
    certificate : proof that also covers the points between the samples.
    target_accuracy : largest distance of the target's true outline from its polygon [m]; the proven margin must exceed
        it.
    """

    samples: int
    folded: float
    outside: float
    max_stretch: float
    min_stretch: float
    overall_ratio: float
    round_trip: float
    coverage: float
    certificate: Certificate
    target_accuracy: float

    @property
    def passed(self) -> bool:
        """Whether a controller may use the map."""
        return not self.reasons

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why the audit failed: one sentence for each number outside its threshold; NaN counts as outside."""
        ratio, margin, accuracy = self.overall_ratio, self.certificate.margin, self.target_accuracy
        largest, smallest = self.max_stretch / ratio, self.min_stretch / ratio
        found = {
            f"folded over {self.folded:.3%} of the source (0 allowed)": self.folded <= 0.0,
            f"{self.outside:.3%} of the source is mapped outside the target (0 allowed)": self.outside <= 0.0,
            f"stretches {largest:.3g} times the overall ratio {ratio:.3g} (at most {MAX_STRETCH:.3g})": (
                largest <= MAX_STRETCH
            ),
            f"squeezes to {smallest:.3g} of the overall ratio {ratio:.3g} (at least {SMALLEST_STRETCH:.3g})": (
                smallest >= SMALLEST_STRETCH
            ),
            f"round trip {self.round_trip:.2g} m (at most {ROUND_TRIP:.0e} m)": self.round_trip <= ROUND_TRIP,
            f"not certified: {self.certificate.reason or 'a bound is not positive'}": self.certificate.valid,
            f"proven {1e3 * margin:.3g} mm inside a target known to {1e3 * accuracy:.3g} mm": margin >= accuracy,
        }
        return tuple(reason for reason, within in found.items() if not within)

    def __str__(self) -> str:
        proven, ratio = self.certificate, self.overall_ratio
        lines = [
            f"folded {self.folded:.3%}, outside {self.outside:.3%} of {self.samples} points",
            f"stretch {self.min_stretch / ratio:.3g} to {self.max_stretch / ratio:.3g}"
            f" times the overall ratio {ratio:.4g}",
            f"round trip {self.round_trip:.2g} m; {self.coverage:.1%} of the target used",
            f"proven: det J >= {proven.determinant:.3g}, {1e3 * proven.margin:.3g} mm inside, one-to-one"
            if proven.valid
            else f"not certified: {proven.reason}",
        ]
        return "; ".join(lines)


def random_points(workspace: Workspace, samples: int, seed: int) -> NDArray[np.float64]:
    """Uniformly random points (samples, 2) [m] in a workspace, which must not be empty."""
    random = np.random.default_rng(seed)
    left, bottom, right, top = workspace.polygon.bounds
    fraction = workspace.area / ((right - left) * (top - bottom))
    found = np.empty((0, 2))
    while len(found) < samples:
        drawn = random.uniform((left, bottom), (right, top), (int(1.1 * samples / fraction) + 16, 2))
        found = np.concatenate([found, drawn[workspace.contains(drawn)]])
    return found[:samples]
