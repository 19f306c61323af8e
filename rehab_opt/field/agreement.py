"""Whether demonstrations show one movement along one path: a mean of opposite ones would be nobody's."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.field.demonstration import Demonstration
from rehab_opt.field.samples import arc_length, interpolated, strides

__all__ = ["check_agreement", "check_closeness"]

Array = NDArray[np.float64]

PLACES = 100
"""Places compared, at equal shares of both lengths."""
TURNED = 0.1
"""Share of the length: a path that is nearer by more than this when it is gone backwards is gone backwards. (A straight
one is nearer by half, a circle by a fifth; one that goes out and comes back the same way by nothing.)"""


def check_agreement(demonstrations: Sequence[Demonstration], paths: Sequence[Array] | None, width: float) -> None:
    """Refuse a demonstration that goes backwards along `paths` (N, 2) [m], or, without any, against the first one.

    Raises
    ------
    ConfigurationError : names it by its number, from 0.
    """
    against = "the path" if paths else "demonstrations[0]"
    shapes = [_places(each, width) for each in paths or [demonstrations[0].positions]]
    lengths = [float(arc_length(shape)[-1]) for shape in shapes]
    for i, each in enumerate(demonstrations):
        shown = _places(each.positions, width)
        aways = [min(_away(shown, shape), _away(shown, shape[::-1])) for shape in shapes]
        nearest = int(np.argmin(aways))
        shape = shapes[nearest]
        if _away(shown, shape) - _away(shown, shape[::-1]) > TURNED * lengths[nearest]:
            expected = f"movements in one direction (turned round it is nearer to {against})"
            raise ConfigurationError(f"demonstrations[{i}]", f"a movement against {against}", expected)


def check_closeness(demonstrations: Sequence[Demonstration], paths: Sequence[Array], width: float) -> None:
    """Refuse a demonstration of which most lies further from the samples of all paths (m, 2) [m] than `width` [m].

    Raises
    ------
    ConfigurationError : names it by its number, from 0.
    """
    from scipy.spatial import KDTree  # noqa: PLC0415  (heavy, and needed only where something is learnt)

    samples = KDTree(np.concatenate(paths))
    for i, each in enumerate(demonstrations):
        away = float(np.median(samples.query(each.positions)[0]))
        if not away <= width:
            value = f"a movement that is mostly {1e3 * away:.3g} mm or more from the field's path"
            expected = f"within width, at most {1e3 * width:g} mm, of it (another path or frame?)"
            raise ConfigurationError(f"demonstrations[{i}]", value, expected)


def _places(points: Array, width: float) -> Array:
    walked = strides(np.asarray(points, dtype=np.float64), width / 4)
    return interpolated(walked, walked, np.linspace(0.0, 1.0, PLACES) * arc_length(walked)[-1])


def _away(one: Array, other: Array) -> float:
    return float(np.linalg.norm(one - other, axis=1).mean())
