"""Map between workspaces: motion from source to target, force back with the same power. Section V, Rossa et al."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from rehab_opt.errors import ConfigurationError
from rehab_opt.workspace.audit import Audit, random_points
from rehab_opt.workspace.certificate import Certificate, certificate
from rehab_opt.workspace.controller_map import ControllerMap
from rehab_opt.workspace.least_distortion import Task, least_distorted, room_kept
from rehab_opt.workspace.plane_map import PlaneMap
from rehab_opt.workspace.point_arguments import point_array, real_number
from rehab_opt.workspace.polar import LANDMARKS, polar_landmarks
from rehab_opt.workspace.similarity import checked_path, largest_copy, resampled
from rehab_opt.workspace.spline import ThinPlateSpline

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from rehab_opt.workspace.region import Workspace

__all__ = ["WorkspaceMap"]

# Largest number of landmarks of the published rule.
MOST = 2000
# Number of points whose images serve as starts of the inverse.
STARTS = 2000
# A drawing's image over the largest copy that fits, points along it, and the weight of their mean squared distance from
# that copy in sets of unit area.
TASK_SIZE, TASK_POINTS, TASK_WEIGHT = 0.88, 200, 1000.0
# Largest scale of that image over sqrt(area of the target / area of the source): all else has to be squeezed for it.
TASK_SCALE = 1.5
# Largest distance of a preimage from the source due to rounding [m].
ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class WorkspaceMap:
    """A smooth map from one workspace into another, made by `between`.

    A point outside the source is first moved to the nearest point of the source, so that a certified map leads into the
    target from anywhere; `spline` alone extrapolates. Immutable and picklable; threads may share it.

    Attributes
    ----------
    source, target : the workspaces.
    spline : the map without this projection: a `PlaneBSpline` ("safe") or a `ThinPlateSpline` ("polar").
    rule : "safe" or "polar".
    certificate : proven properties; they also say if a safe map could not be certified.
    """

    source: Workspace
    target: Workspace
    spline: PlaneMap
    rule: Literal["safe", "polar"]
    certificate: Certificate = field(repr=False)

    @classmethod
    def between(
        cls,
        source: Workspace,
        target: Workspace,
        *,
        rule: Literal["safe", "polar"] = "safe",
        landmarks: int | None = None,
        rotation: float | Literal["best"] = 0.0,
    ) -> WorkspaceMap:
        """The map of one workspace into another.

        Parameters
        ----------
        source, target : each in one piece and without holes.
        rule : "safe": no folds, inside the target, least distortion; it takes a few seconds, more for deep slits and
            slivers. "polar": the paper's rule, for comparison.
        landmarks : number of landmarks of the rule "polar", 20 by default; the safe rule has none.
        rotation : angle [rad], counterclockwise, by which directions turn on average. With 0, a movement away from the
            body stays one. "best": the angle of least distortion. The map never mirrors.

        Raises
        ------
        ConfigurationError : source or target is empty, or not one piece without holes.
        """
        _check(source, target, rule, landmarks, rotation)
        if rule == "polar":
            pairs = polar_landmarks(source.polygon, target.polygon, landmarks=landmarks or LANDMARKS, rotation=rotation)
            published = ThinPlateSpline(*pairs)
            return cls(source, target, published, rule, certificate(published, source, target))
        spline, proven = least_distorted(source, target, rotation=rotation)
        return cls(source, target, spline, rule, proven)

    @classmethod
    def for_task(
        cls,
        source: Workspace,
        target: Workspace,
        path: ArrayLike,
        *,
        rotation: float | Literal["best"] = "best",
        size: float = TASK_SIZE,
    ) -> WorkspaceMap:
        """The safe map that preserves the shape of a drawing: near the path it is almost a similarity.

        Parameters
        ----------
        source, target : each in one piece and without holes.
        path : (N, 2) [m] in the source: the drawing, or all demonstrations one after another.
        rotation : angle [rad] by which the drawing turns; "best": the angle at which the largest copy fits.
        size : size of the drawing's image relative to the largest copy that fits (`similarity.largest_copy`), up to 1.
            A small drawing is enlarged at most by 1.5 times the overall ratio, because everything else must be
            squeezed.

        Raises
        ------
        ConfigurationError : as `between`; a path that leaves the source.
        """
        _check(source, target, "safe", None, rotation)
        points = checked_path(path)
        if not np.all(source.contains(points)):
            raise ConfigurationError("path", path, "points of the source")
        if not 0.0 < real_number(size) <= 1.0:
            raise ConfigurationError("size", size, "a fraction of the largest copy, above 0 and up to 1")
        copy = largest_copy(points, target, rotation=rotation, margin=room_kept(target))
        largest = TASK_SCALE * math.sqrt(target.area / source.area) / copy.scale
        copy = copy.about(points.mean(axis=0), min(size, largest))
        few = resampled(points, TASK_POINTS)
        task = Task(few, copy(few), TASK_WEIGHT)
        spline, proven = least_distorted(source, target, rotation=copy.turn, task=task)
        return cls(source, target, spline, "safe", proven)

    # ------------------------------------------------------------------------------------------------ the map
    def __call__(self, points: ArrayLike) -> NDArray[np.float64]:
        """Images [m] of points (2,) or (N, 2) [m], after projection into the source. NaN gives NaN."""
        return self.spline(self._inside(points))

    def jacobian(self, points: ArrayLike) -> NDArray[np.float64]:
        """Derivatives d image_i / d point_j, (2, 2) or (N, 2, 2); outside the source, those at its nearest point."""
        return self.spline.jacobian(self._inside(points))

    def inverse(self, points: ArrayLike) -> NDArray[np.float64]:
        """Points of the source [m] with these images (2,) or (N, 2) [m]; NaN if there is none.

        Newton's method on the map finds them exactly. The inverse does not cover the whole target (see the audit's
        coverage); to map the whole target, build the map in the other direction.
        """
        wanted = point_array(points)
        many = wanted.reshape(-1, 2)
        found = np.full_like(many, np.nan)
        finite = np.isfinite(many).all(axis=1)
        if finite.any():
            tree, at = self._starts
            found[finite] = self.spline.inverse(many[finite], start=at[tree.query(many[finite])[1]])
            far = ~(np.atleast_1d(self.source.distance(found)) <= ROUNDING)
            found[far] = np.nan
        return found.reshape(wanted.shape)

    @property
    def rotation(self) -> float:
        """Angle [rad], counterclockwise, by which directions turn on average over the source."""
        mean = self.spline.jacobian(random_points(self.source, STARTS, 0)).mean(axis=0)
        return float(np.arctan2(mean[1, 0] - mean[0, 1], mean[0, 0] + mean[1, 1]))

    # ------------------------------------------------------------------------------------------------ its safety
    def audit(self, samples: int = 20_000, seed: int = 0) -> Audit:
        """Audit at random points of the source, with the certificate for the points in between.

        Raises
        ------
        ConfigurationError : `samples` is not a positive integer.
        """
        if isinstance(samples, bool) or not isinstance(samples, int | np.integer) or not samples >= 1:
            raise ConfigurationError("samples", samples, "a whole number of points, 1 or more")
        points = random_points(self.source, samples, seed)
        images, slopes = self.spline(points), self.spline.jacobian(points)
        stretch = np.linalg.svd(slopes, compute_uv=False)
        back = np.linalg.norm(self.inverse(images) - points, axis=1)
        determinant = np.linalg.det(slopes)
        return Audit(
            samples=samples,
            folded=float(np.mean(~(determinant > 0.0))),
            outside=float(np.mean(~self.target.contains(images))),
            max_stretch=float(stretch.max()),
            min_stretch=float(stretch.min()),
            overall_ratio=float(np.sqrt(self.target.area / self.source.area)),
            round_trip=float(np.where(np.isnan(back), np.inf, back).max()),
            coverage=float(np.abs(determinant).mean() * self.source.area / self.target.area),
            certificate=self.certificate,
            target_accuracy=self.target.accuracy,
        )

    def for_controller(self, *, unsafe: bool = False) -> ControllerMap:
        """The map in the form that controllers accept.

        Raises
        ------
        ConfigurationError : the audit fails, unless `unsafe` is True.
        """
        return ControllerMap(self.source, self.spline, self._audit, unsafe=unsafe)

    @cached_property
    def _audit(self) -> Audit:
        return self.audit()

    @cached_property
    def _starts(self) -> tuple[Any, NDArray[np.float64]]:
        """A search tree of images, and the points that have these images."""
        from scipy.spatial import cKDTree  # noqa: PLC0415  (slow to import)

        points = random_points(self.source, STARTS, 0)
        return cKDTree(self.spline(points)), points

    def _inside(self, points: ArrayLike) -> NDArray[np.float64]:
        given = np.array(point_array(points))
        many = given.reshape(-1, 2)
        for k in np.flatnonzero(~np.atleast_1d(self.source.contains(many))):
            many[k] = self.source.nearest(many[k])
        return many.reshape(given.shape)

    def __repr__(self) -> str:
        return (
            f"WorkspaceMap({self.source.area:.4g} m^2 -> {self.target.area:.4g} m^2, rule={self.rule!r}, "
            f"{self.spline.parameters} coefficients)"
        )


def _check(source: Workspace, target: Workspace, rule: str, landmarks: int | None, rotation: float | str) -> None:
    for name, each in (("source", source), ("target", target)):
        if each.empty:
            raise ConfigurationError(
                name, each, f"a workspace that is not empty{f' ({each.reason})' * bool(each.reason)}"
            )
    for what in ("components", "holes"):
        here, there = getattr(source, what), getattr(target, what)
        wanted = 1 if what == "components" else 0
        name, each = ("source", source) if here != wanted else ("target", target)
        if here != wanted or there != wanted:
            singular = what[:-1]
            both = f"source has {here} {what if here != 1 else singular}, target {there}"
            raise ConfigurationError(name, each, f"one component without holes in both workspaces; {both}")
    if rule not in ("safe", "polar"):  # a tuple, so that unhashable values are refused, too
        raise ConfigurationError("rule", rule, '"safe" or "polar"')
    if landmarks is not None:
        counted = isinstance(landmarks, int | np.integer) and not isinstance(landmarks, bool)
        if rule != "polar" or not (counted and 3 <= landmarks <= MOST):
            raise ConfigurationError(
                "landmarks", landmarks, f'None, or a whole number from 3 to {MOST} of rule "polar"'
            )
    if not (isinstance(rotation, str) and rotation == "best") and not np.isfinite(real_number(rotation)):
        raise ConfigurationError("rotation", rotation, 'an angle in radians, or "best"')
