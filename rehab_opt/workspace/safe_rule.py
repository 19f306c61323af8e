"""Landmarks of the safe rule: from a slightly grown source into a slightly shrunk target, distorted as little as
possible.

The map is fitted on more than the source and into less than the target. So the source lies where the spline is smooth,
away from its outermost landmarks, and its image keeps a distance from the target's outline: both leave room for a
proof (`certificate`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from rehab_opt.workspace.harmonic import harmonic_images
from rehab_opt.workspace.least_distortion import PULL_INSIDE, Sampled, distortion, least_distorted, sampled
from rehab_opt.workspace.triangulation import grown, inradius, mesh_of, shrunk

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray
    from shapely import Polygon

__all__ = ["LandmarkPairs", "safe_landmarks"]

# The source grows by this share of sqrt(area), the target shrinks by this share of its inradius.
GROWTH, SHRINKAGE, MOST_SHRINKAGE = 0.04, 0.04, 0.15
# Where the outline's image is drawn to the target's outline: on the source grown by this share of sqrt(area).
DRAWN = 0.01
# Points at which distortion is summed, for each landmark, and points along the outline.
SAMPLES_PER_LANDMARK = 4
OUTLINE_SAMPLES = 320
# Landmarks at first. What is tried when a map cannot be certified: more landmarks, and a stronger pull to the outline.
LANDMARKS = 300
ATTEMPTS = ((1.0, 1.0), (1.0, 10.0), (1.6, 3.0), (2.5, 30.0))


class LandmarkPairs(NamedTuple):
    """Landmarks (n, 2) [m] in the source and their images (n, 2) [m]."""

    source: NDArray[np.float64]
    target: NDArray[np.float64]


def safe_landmarks(
    source: Polygon,
    target: Polygon,
    *,
    accuracy: float = 0.0,
    landmarks: int | None = None,
    rotation: float | Literal["best"] = 0.0,
) -> Iterator[LandmarkPairs]:
    """Pairs to fit a spline through, one attempt after the other until one can be certified.

    Parameters
    ----------
    source, target : sets without holes [m].
    accuracy : how far the true target may lie from the polygon [m]: kept clear of as well, up to `MOST_SHRINKAGE`.
    landmarks : roughly how many; None: 300 at first, up to 750 in later attempts.
    rotation : angle [rad], counterclockwise, by which directions turn on average; "best": the one that distorts least.
    """
    for more, pull in ATTEMPTS:
        count = landmarks or int(LANDMARKS * more)
        yield _pairs(source, target, accuracy=accuracy, count=count, rotation=rotation, pull=PULL_INSIDE * pull)


def _pairs(
    source: Polygon,
    target: Polygon,
    *,
    accuracy: float,
    count: int,
    rotation: float | Literal["best"],
    pull: float,
) -> LandmarkPairs:
    from shapely import affinity  # noqa: PLC0415  (light to import)

    unit = [float(np.sqrt(each.area)) for each in (source, target)]
    middle = [np.asarray(each.centroid.coords[0]) for each in (source, target)]
    # Both sets with unit area around the origin: the tolerances and weights of the optimisation then mean the same for
    # all.
    start, goal = (
        affinity.scale(affinity.translate(each, *-at), 1.0 / size, 1.0 / size, origin=(0.0, 0.0))
        for each, at, size in zip((source, target), middle, unit, strict=True)
    )
    wide, radius = grown(start, GROWTH), inradius(goal)
    narrow = shrunk(goal, min(SHRINKAGE * radius + accuracy / unit[1], MOST_SHRINKAGE * radius))
    # Euler: about 1.15 times the area of a hexagonal pattern's cells, of which those on the outline are halves.
    points = mesh_of(wide, float(np.sqrt(1.15 * wide.area / count) * 1.07)).points
    spline = _sampled(start, wide, points, count)
    best, images = np.inf, points
    for begin in harmonic_images(wide, narrow, points, rotation):
        ended = least_distorted(spline, begin, narrow, None if rotation == "best" else rotation, pull)
        value = distortion(spline.jacobians(ended), spline.shares, 0.0)
        if value < best or best == np.inf:
            best, images = value, ended
    return LandmarkPairs(points * unit[0] + middle[0], images * unit[1] + middle[1])


def _sampled(source: Polygon, wide: Polygon, landmarks: NDArray[np.float64], count: int) -> Sampled:
    """The spline through these landmarks, sampled over the source and a little beyond it, and along its outline."""
    from shapely import get_coordinates  # noqa: PLC0415

    over = mesh_of(wide.buffer(-0.3 * GROWTH), float(np.sqrt(wide.area / (count * SAMPLES_PER_LANDMARK))))
    a, b, c = (over.points[over.triangles[:, k]] for k in range(3))
    areas = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    shares = np.bincount(over.triangles.ravel(), np.repeat(areas, 3), len(over.points))
    outline = source.buffer(DRAWN).exterior
    along = get_coordinates(outline.interpolate(np.arange(OUTLINE_SAMPLES) / OUTLINE_SAMPLES, normalized=True))
    return sampled(landmarks, over.points, shares / shares.sum(), along)
