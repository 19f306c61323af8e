"""The B-spline map between workspaces with the least distortion, refined until it is proven one-to-one.

Both sets are scaled to unit area. The source is grown and the target shrunk a little, which leaves a margin for the
proof. Coefficients minimise, over points of the grown source,

    sum_q a_q (f(J_q) / 4)^2 + pull of the outline's image to the target's outline + anchor + roughness,
    f(J) = |J|^2 / det J + (1 + det J^2) / det J,

which is least if J is a rotation and grows without bound towards det J = 0. Descent starts from a harmonic map
(`harmonic`) and may fold temporarily: det J is smoothed around zero, less in each round. If the proof fails or too
little of the target is used, the descent starts again with other weights of the pull and of the anchor, which draws the
map to the one-to-one harmonic map.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rehab_opt.workspace.audit import MAX_STRETCH, SMALLEST_STRETCH, random_points
from rehab_opt.workspace.bspline import PlaneBSpline, net_columns
from rehab_opt.workspace.certificate import Certificate, examined, outline_polygon
from rehab_opt.workspace.harmonic import harmonic_images
from rehab_opt.workspace.triangulation import PlaneMesh, cross, grown, inradius, mesh_of, shrunk

if TYPE_CHECKING:
    from shapely import Polygon

    from rehab_opt.workspace.region import Workspace

__all__ = ["Task", "least_distorted", "room_kept"]

Array = NDArray[np.float64]

CELL, TASK_CELL = 0.11, 0.08
"""Cell size over sqrt(area), without and with a task."""
GROWTH, SHRINKAGE, MAX_SHRINKAGE = 0.04, 0.04, 0.3
"""Growth of the source as a fraction of sqrt(area). Shrinkage of the target as a fraction of its inradius: the value to
which the target's accuracy is added, and the largest value of the sum."""
BEYOND = 0.02
"""Width of the net's border around the grown source, over sqrt(area)."""
OUTLINE_POINTS, DRAWN = 400, 0.012
"""The source's outline, grown by the fraction `DRAWN` of sqrt(area), is pulled to the target's outline at this number
of points."""
OUTLINE_WEIGHT = 0.25
"""Weight of an outline point in the mean distortion, relative to an inner point."""
PULL_OUTSIDE, TIGHTER = 1000.0, 4.0
"""Weight of squared distances outside the target's outline, and its factor per round."""
ROUGHNESS = 2e-2
"""Weight of squared second derivatives; it determines otherwise free coefficients."""
DET_AT_FIRST, DET_LEAST, LOWER = 0.3, 1e-3, 0.3
"""Smoothing width of det J: first value, last value, and factor per round."""
OUT_ALLOWED = 3e-3
"""Largest distance of the pulled outline outside the shrunk target, over sqrt(area)."""
ROUNDS, ITERATIONS, SAMPLES = 11, 60, 2000
ATTEMPTS = (
    (0.0, False, 1.0, 80.0),
    (0.0, False, 1.0, 200.0),
    (100.0, False, 1.0, 80.0),
    (4.0, False, 1.0, 50.0),
    (100.0, True, 1.0, 50.0),
)
TASK_ATTEMPTS = ((0.0, False, 1.0, 80.0), (0.0, False, 0.2, 80.0), (0.0, False, 0.05, 80.0), (0.0, False, 0.0, 80.0))
"""For each attempt: weight of the mean squared distance from the harmonic map; whether knots are inserted first; factor
on the task's weight; weight of squared distances from the target's outline inside it. Each begins at the harmonic
map."""
LEAST_USED = 0.6
"""Fraction of the target's area that a map without a task should use; with less, the next attempt follows."""
TURN_WEIGHT = 100.0


class Task(NamedTuple):
    """Points (n, 2) [m] around which the map should be a similarity, their images (n, 2) [m], and a weight."""

    points: Array
    images: Array
    weight: float


def least_distorted(
    source: Workspace, target: Workspace, *, rotation: float | Literal["best"], task: Task | None = None
) -> tuple[PlaneBSpline, Certificate]:
    """The least distorted map that is proven and within the audit's bounds of stretch, or the best attempt.

    Parameters
    ----------
    source, target : each one piece without holes.
    rotation : angle [rad], counterclockwise, by which directions turn on average; "best": the angle of least
        distortion.
    task : points where the map should be a similarity with the turn `rotation`, or None.
    """
    frames = _Frame(outline_polygon(source)), _Frame(outline_polygon(target))
    start, goal = (frame.scaled for frame in frames)
    narrow = shrunk(goal, room_kept(target) / frames[1].unit)
    wide = grown(start, GROWTH)
    mesh = mesh_of(wide, CELL / 3.0)
    scaled = task and Task(frames[0].to_unit(task.points), frames[1].to_unit(task.images), task.weight)
    tried: list[tuple[bool, bool, float, float, PlaneBSpline, Certificate]] = []
    for images in harmonic_images(wide, narrow, mesh.points, rotation):
        turn = None if rotation == "best" or task else rotation
        net = _Net(wide, mesh, start, narrow, rotation=turn, task=scaled)
        doubtful = np.empty((0, 2))
        for anchor, knots, *weights in ATTEMPTS if task is None else TASK_ATTEMPTS:
            net.refine(frames[0].to_unit(doubtful), knots=knots)
            coefficients, value = net.descended(images, (anchor, *weights))
            spline = _in_metres(net, coefficients, *frames)
            proven, doubtful = examined(spline, source, target)
            even, used = _evenness(spline, source, target)
            unused = max(0.0, LEAST_USED - used) if task is None else 0.0
            tried.append((not proven.valid, not even, unused, value, spline, proven))
            if proven.valid and even and unused <= 0.0:
                break
    return min(tried, key=lambda each: each[:4])[4:]


def _evenness(spline: PlaneBSpline, source: Workspace, target: Workspace) -> tuple[bool, float]:
    """Two results: whether all sampled stretches are within the audit's bounds; the fraction of the target used."""
    ratio = np.sqrt(target.area / source.area)
    stretch = np.linalg.svd(spline.evaluate(random_points(source, SAMPLES, 0))[1], compute_uv=False) / ratio
    even = bool(stretch.max() <= MAX_STRETCH and stretch.min() >= SMALLEST_STRETCH)
    return even, float(stretch.prod(axis=1).mean())


def room_kept(target: Workspace) -> float:
    """Distance [m] that images should keep from the target's outline."""
    radius = inradius(outline_polygon(target))
    return min(SHRINKAGE * radius + target.accuracy, MAX_SHRINKAGE * radius)


class _Frame:
    def __init__(self, polygon: Polygon) -> None:
        from shapely import transform  # noqa: PLC0415  (light to import)

        self.middle, self.unit = np.array(polygon.centroid.coords[0]), polygon.area**0.5
        self.scaled = transform(polygon, self.to_unit)

    def to_unit(self, points: Array) -> Array:
        return np.asarray((points - self.middle) / self.unit)


def _in_metres(net: _Net, coefficients: Array, source: _Frame, target: _Frame) -> PlaneBSpline:
    shape = (net.cells[0] + 3, net.cells[1] + 3, 2)
    return PlaneBSpline(
        source.middle + source.unit * net.low,
        source.unit * net.step,
        target.middle + target.unit * coefficients.reshape(shape),
    )


class _Anchor(NamedTuple):
    """Cost that draws the points columns @ C to `images` (m, 2): weighted squared distances."""

    columns: Any
    images: Array
    weights: Array


class _Net:
    """Cost of B-spline coefficients (n, 2) on one net, for sets of unit area."""

    def __init__(
        self,
        wide: Polygon,
        mesh: PlaneMesh,
        start: Polygon,
        narrow: Polygon,
        *,
        rotation: float | None,
        task: Task | None,
    ) -> None:
        import shapely  # noqa: PLC0415  (light to import)

        left, bottom, right, top = wide.buffer(BEYOND).bounds
        self.low, size = np.array([left, bottom]), np.array([right - left, top - bottom])
        self.cells: tuple[int, int] = tuple(np.ceil(size / (CELL if task is None else TASK_CELL)).astype(int).tolist())
        self.step = size / self.cells
        self.mesh, self.narrow, self.edge, self.rotation, self.task = mesh, narrow, narrow.exterior, rotation, task
        shapely.prepare([self.narrow, self.edge])
        a, b, c = (mesh.points[mesh.triangles[:, k]] for k in range(3))
        share = np.bincount(mesh.triangles.ravel(), np.repeat(np.abs(cross(b - a, c - a)), 3), len(mesh.points))
        self.share = share / share.sum()
        drawn = start.buffer(DRAWN).exterior
        fraction = np.arange(OUTLINE_POINTS) / OUTLINE_POINTS
        self.outline = shapely.get_coordinates(drawn.interpolate(fraction, normalized=True))
        self.places = np.concatenate([mesh.points, self.outline])
        self.weights = np.concatenate([self.share, np.full(OUTLINE_POINTS, OUTLINE_WEIGHT / len(mesh.points))])
        self._tabulate()

    def _columns(self, points: Array, dx: int = 0, dy: int = 0) -> Any:
        return net_columns(points, self.low, self.step, self.cells, (dx, dy))

    def _tabulate(self) -> None:
        from scipy.sparse import vstack  # noqa: PLC0415  (slow to import)

        sides = [self.low[i] + self.step[i] * (np.arange(self.cells[i]) + 0.5) for i in (0, 1)]
        middles = np.stack(np.meshgrid(*sides, indexing="ij"), -1).reshape(-1, 2)
        bends = [self._columns(middles, 2, 0), self._columns(middles, 0, 2), self._columns(middles, 1, 1) * 2**0.5]
        D = vstack(bends)
        self.rough = (D.T @ D * self.step.prod()).tocsc()
        self.inside, self.drawn = self._columns(self.mesh.points), self._columns(self.outline)
        self.along_x, self.along_y = self._columns(self.places, 1, 0), self._columns(self.places, 0, 1)

    def refine(self, points: Array, *, knots: bool) -> None:
        """Sum the distortion at further points (m, 2), too; `knots` also halves the size of the cells."""
        self.places = np.concatenate([self.places, points])
        self.weights = np.concatenate([self.weights, np.full(len(points), self.share.mean())])
        if knots:
            self.cells, self.step = (2 * self.cells[0], 2 * self.cells[1]), self.step / 2.0
        self._tabulate()

    def fitted(self, images: Array) -> Array:
        """Coefficients for which the mesh's points have approximately these images (n, 2)."""
        from scipy.sparse.linalg import splu  # noqa: PLC0415  (slow to import)

        weighted = self.inside.T * self.share
        return np.asarray(splu((weighted @ self.inside + 1e-7 * self.rough).tocsc()).solve(weighted @ images))

    def descended(self, images: Array, weights: tuple[float, ...]) -> tuple[Array, float]:
        """Descend from the harmonic images; two results: the coefficients of least cost, and the cost."""
        from scipy.optimize import minimize  # noqa: PLC0415  (slow to import)

        share = self.weights / self.weights.sum()
        outside, width = PULL_OUTSIDE, DET_AT_FIRST
        metric = self.along_x.T @ (self.along_x * share[:, None]) + self.along_y.T @ (self.along_y * share[:, None])
        metric = metric + weights[2] / len(self.outline) * (self.drawn.T @ self.drawn) + ROUGHNESS * self.rough
        anchors = [_Anchor(self.inside, images, weights[0] * self.share)] if weights[0] > 0.0 else []
        if self.task is not None:
            even = np.full(len(self.task.points), weights[1] * self.task.weight / len(self.task.points))
            anchors.append(_Anchor(self._columns(self.task.points), self.task.images, even))
        for each in anchors:
            metric = metric + (each.columns.T * each.weights) @ each.columns
        dense = metric.toarray()
        n = len(dense)
        root = np.linalg.cholesky(dense + 1e-9 * np.trace(dense) / n * np.eye(n))
        back = np.linalg.inv(root).T  # coordinates in which the Hessian is near the identity
        z, value = (root.T @ self.fitted(images)).ravel(), np.inf

        def cost(z: Array) -> tuple[float, Array]:
            value, slope, _, _ = self._cost(back @ z.reshape(n, 2), share, anchors, (weights[2], outside), width)
            return value, (back.T @ slope).ravel()

        for k in range(ROUNDS):
            z = minimize(cost, z, jac=True, method="L-BFGS-B", options={"maxiter": ITERATIONS, "maxcor": 15}).x
            value, _, least, off = self._cost(back @ z.reshape(n, 2), share, anchors, (weights[2], outside), width)
            if least <= 1e-2 and width > DET_LEAST / 10.0:
                width *= LOWER
                continue
            width = DET_LEAST
            if off < OUT_ALLOWED and k >= 2:
                break
            outside *= TIGHTER
        return back @ z.reshape(n, 2), value

    def _cost(
        self, C: Array, share: Array, anchors: list[_Anchor], pulls: tuple[float, float], width: float
    ) -> tuple[float, Array, float, float]:
        """Four results: cost, its gradient (n, 2), smallest det J, largest distance of an image outside the target."""
        import shapely  # noqa: PLC0415  (light to import)

        Jx, Jy = self.along_x @ C, self.along_y @ C
        det = cross(Jx, Jy)
        root = np.hypot(width, det)
        below = np.where(det > 0.0, 0.5 * (det + root), 0.5 * width**2 / (root - np.minimum(det, 0.0)))
        f = 0.25 * ((Jx**2).sum(1) + (Jy**2).sum(1) + 1.0 + det**2) / below
        by_det = 0.5 * det / below - f / root
        w = 2.0 * share * f
        gx = w[:, None] * (0.5 * Jx / below[:, None] + by_det[:, None] * np.column_stack([Jy[:, 1], -Jy[:, 0]]))
        gy = w[:, None] * (0.5 * Jy / below[:, None] + by_det[:, None] * np.column_stack([-Jx[:, 1], Jx[:, 0]]))
        value = share @ f**2
        if self.rotation is not None:
            c, s = np.cos(self.rotation), np.sin(self.rotation)
            off = share @ (0.5 * (c * (Jx[:, 1] - Jy[:, 0]) - s * (Jx[:, 0] + Jy[:, 1])))
            value += TURN_WEIGHT * off**2
            gx += TURN_WEIGHT * off * share[:, None] * np.array([-s, c])
            gy += TURN_WEIGHT * off * share[:, None] * np.array([-c, -s])
        p = self.drawn @ C
        along = shapely.line_locate_point(self.edge, shapely.points(p))
        away = p - shapely.get_coordinates(shapely.line_interpolate_point(self.edge, along))
        within = shapely.contains_xy(self.narrow, p)
        pull = np.where(within, *pulls) / len(p)
        bent = self.rough @ C
        value += pull @ (away**2).sum(1) + ROUGHNESS * (C * bent).sum()
        slope = self.along_x.T @ gx + self.along_y.T @ gy + self.drawn.T @ (2.0 * pull[:, None] * away)
        slope += 2.0 * ROUGHNESS * bent
        for each in anchors:
            miss = each.columns @ C - each.images
            value += each.weights @ (miss**2).sum(1)
            slope += each.columns.T @ (2.0 * each.weights[:, None] * miss)
        return float(value), slope, float(det.min()), float(np.hypot(*away[~within].T).max(initial=0.0))
