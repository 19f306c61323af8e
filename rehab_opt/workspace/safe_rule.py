"""Landmarks of the safe rule: from a slightly grown source into a slightly shrunk target, distorted as little as
possible.

The map is fitted on more than the source and into less than the target. So the source lies where the spline is smooth,
away from its outermost landmarks, and its image keeps a distance from the target's outline: both leave room for a
proof (`certificate`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rehab_opt.workspace.harmonic import harmonic_images
from rehab_opt.workspace.least_distortion import PULL_INSIDE, Sampled, distortion, least_distorted, sampled
from rehab_opt.workspace.triangulation import grown, inradius, mesh_of, shrunk

if TYPE_CHECKING:
    from collections.abc import Callable

    from shapely import LinearRing, Polygon

__all__ = ["LandmarkPairs", "safe_landmarks"]

Array = NDArray[np.float64]

# The source grows by this share of sqrt(area), the target shrinks by this share of its inradius.
GROWTH, SHRINKAGE, MAX_SHRINKAGE = 0.04, 0.04, 0.3
# Where the outline's image is drawn to the target's outline: on the source grown by this share of sqrt(area).
DRAWN = 0.01
# Points at which distortion is summed, for each landmark, and points along the outline.
SAMPLES_PER_LANDMARK = 4
OUTLINE_SAMPLES = 320
OUTLINE_SHARE = 0.25
# Landmarks at first. How often a map that is not proven goes on from where it is, what its pull to the outline is then
# multiplied by, and how near to others landmarks and samples may be added, in spacings of the samples.
LANDMARKS = 300
REFINEMENTS, EASED = 3, 0.3
APART_LANDMARKS, APART_SAMPLES = 0.8, 0.25


class LandmarkPairs(NamedTuple):
    """Landmarks (n, 2) [m] in the source and their images (n, 2) [m]."""

    source: Array
    target: Array


def safe_landmarks(
    source: Polygon,
    target: Polygon,
    unproven: Callable[[LandmarkPairs], Array],
    *,
    accuracy: float = 0.0,
    landmarks: int | None = None,
    rotation: float | Literal["best"] = 0.0,
) -> None:
    """Look for pairs to fit a spline through until nothing of it is unproven.

    Where something is, landmarks and samples are added, the landmarks with the images that the spline has: the map is
    the same, with more freedom and seen more closely there, and the descent goes on from it.

    Parameters
    ----------
    source, target : sets without holes [m].
    unproven : gets what was found; points (m, 2) [m] of the source around which it is not good enough, none to end.
    accuracy : how far the true target may lie from the polygon [m]: kept clear of as well, up to `MAX_SHRINKAGE`.
    landmarks : roughly how many at first; None: 300.
    rotation : angle [rad], counterclockwise, by which directions turn on average; "best": the one that distorts least.
    """
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
    narrow = shrunk(goal, min(SHRINKAGE * radius + 1.6 * accuracy / unit[1], MAX_SHRINKAGE * radius))
    count = landmarks or LANDMARKS
    # Euler: about 1.15 times the area of a hexagonal pattern's cells, of which those on the outline are halves.
    points = mesh_of(wide, float(np.sqrt(1.15 * wide.area / count) * 1.07)).points
    samples = _Samples.of(start, wide, float(np.sqrt(wide.area / (count * SAMPLES_PER_LANDMARK))))
    spline, turn, pull = samples.through(points), None if rotation == "best" else rotation, PULL_INSIDE
    begun = harmonic_images(wide, narrow, points, rotation)
    ended = [least_distorted(spline, each, narrow, turn) for each in begun]
    images = min(ended, key=lambda each: distortion(spline.jacobians(each), spline.fractions, 0.0))
    for left in reversed(range(REFINEMENTS + 1)):
        at = unproven(LandmarkPairs(points * unit[0] + middle[0], images * unit[1] + middle[1]))
        if not len(at) or not left:
            return
        at = (at - middle[0]) / unit[0]
        more = _apart(at, points, APART_LANDMARKS * samples.spacing)
        images = np.concatenate([images, sampled(points, more, np.ones(len(more)), more).outline @ images])
        points, samples, pull = np.concatenate([points, more]), samples.refined(at), EASED * pull
        images = least_distorted(samples.through(points), images, narrow, turn, pull)


class _Samples(NamedTuple):
    """Where distortion is summed, and where the outline's image is drawn to the target's; lengths over sqrt(area).

    inside, fractions : points (m, 2) and the areas (m,) that they stand for.
    outline, along : the curve, and the shares of its length at which it is looked at, ascending.
    spacing : distance between points, where they are next added.
    """

    inside: Array
    fractions: Array
    outline: LinearRing
    along: Array
    spacing: float

    @classmethod
    def of(cls, source: Polygon, wide: Polygon, spacing: float) -> _Samples:
        """Over the source and a little beyond it, and along its outline."""
        over = mesh_of(wide.buffer(-0.3 * GROWTH), spacing)
        a, b, c = (over.points[over.triangles[:, k]] for k in range(3))
        areas = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
        fractions = np.bincount(over.triangles.ravel(), np.repeat(areas, 3), len(over.points)).astype(np.float64)
        along = np.arange(OUTLINE_SAMPLES) / OUTLINE_SAMPLES
        return cls(over.points, fractions, source.buffer(DRAWN).exterior, along, spacing)

    def refined(self, at: Array) -> _Samples:
        """With more of them around these points (m, 2), and twice as near to each other the next time."""
        from shapely import points  # noqa: PLC0415

        more = _apart(at, self.inside, APART_SAMPLES * self.spacing)
        fractions = np.concatenate([self.fractions, np.full(len(more), self.fractions.mean())])
        places = points(at)
        near = places[self.outline.distance(places) < self.spacing]
        steps = OUTLINE_SAMPLES / APART_SAMPLES
        along = np.union1d(self.along, np.round(self.outline.project(near, normalized=True) * steps) % steps / steps)
        inside = np.concatenate([self.inside, more])
        return _Samples(inside, fractions, self.outline, along, 0.5 * self.spacing)

    def through(self, landmarks: Array) -> Sampled:
        """The spline through landmarks (n, 2), seen here."""
        from shapely import get_coordinates  # noqa: PLC0415

        outline = get_coordinates(self.outline.interpolate(self.along, normalized=True))
        # Folds begin at the outline, so its points count too, for little area.
        fractions = np.concatenate([self.fractions, np.full(len(outline), OUTLINE_SHARE * self.fractions.mean())])
        return sampled(landmarks, np.concatenate([self.inside, outline]), fractions / fractions.sum(), outline)


def _apart(points: Array, others: Array, distance: float) -> Array:
    """Those of the points (m, 2) that are that far from the others and from those before them, (k, 2)."""
    kept = others
    for point in points:
        if np.hypot(*(kept - point).T).min() >= distance:
            kept = np.concatenate([kept, point[None]])
    return kept[len(others) :]
