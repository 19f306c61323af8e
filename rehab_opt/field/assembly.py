"""Make the samples of a field from its paths: merge them if they are many, and continue paths if the field rests."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.field.continuation import PathEnd, at_rest, reflected
from rehab_opt.field.merging import MOST, merged
from rehab_opt.field.samples import SampledPath, Samples

__all__ = ["DragAlong", "assembled", "rest_point"]

Array = NDArray[np.float64]
DragAlong = Literal["remaining", "travelled"]


def rest_point(paths: Sequence[SampledPath], along: DragAlong, width: float) -> Array | None:
    """(2,) [m] target of a field: the mean of the paths' ends, or of their starts if drag is `along` "travelled".

    None if every path is a point, which is its own target.

    Raises
    ------
    ConfigurationError : the ends are further than `width` from their mean, so there is no common target.
    """
    if all(len(path.points) == 1 for path in paths):
        return None
    ends = np.array([path.points[-1 if along == "remaining" else 0] for path in paths])
    target: Array = ends.mean(axis=0)
    furthest = float(np.linalg.norm(ends - target, axis=1).max())
    if furthest > width:
        raise ConfigurationError(
            "path",
            f"{len(paths)} paths, one ending {furthest:.3g} m from their mean",
            f"paths that {'end' if along == 'remaining' else 'start'} within width = {width:g} m of one target, "
            "or rest_on_target=False",
        )
    return target


def assembled(
    paths: Sequence[SampledPath],
    offsets: Sequence[Array],
    stiffness: Sequence[Array],
    *,
    along: DragAlong,
    width: float,
    target: Array | None,
    most: int = MOST,
) -> Samples:
    """Samples of a field; its energy is linear in `offsets` (m,) [J] and `stiffness` (m, 2) [N/m] of each path.

    `target` is the field's `rest_point`, or None for the published field, whose paths are not continued.
    """
    own = [
        Samples.of_path(path.points, offset, stiff)
        for path, offset, stiff in zip(paths, offsets, stiffness, strict=True)
    ]
    samples = own[0]
    for each in own[1:]:
        samples = samples.joined(each)
    if target is None:
        return merged(samples, width, most)
    far = 0 if along == "remaining" else -1
    for each in own:
        end = PathEnd(each.points[far], float(each.offsets[far]), held=along == "remaining")
        samples = samples.joined(reflected(each, end, width))
    return at_rest(merged(samples, width, most), target, width)
