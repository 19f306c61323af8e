"""Force field around demonstrated paths: Eqs. (15)-(22), Rossa et al., at rest on its target."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.field.arguments import as_point, as_points, checked_drag, path_stiffness, per_axis
from rehab_opt.field.assembly import DragAlong, assembled, rest_point
from rehab_opt.field.energy import Kernel, energies_and_forces, field_kernel, stiffness_at
from rehab_opt.field.samples import SampledPath, Samples, checked_paths, resampled_path
from rehab_opt.field.settling import fitting_damping
from rehab_opt.kinematics.real_array import checked_array, positive

if TYPE_CHECKING:
    from rehab_opt.field.fit import Fit
from rehab_opt.symbolic import Compile, PerThread

__all__ = ["SAMPLES_PER_WIDTH", "PotentialField", "sample_spacing"]

Array = NDArray[np.float64]

SAMPLES_PER_WIDTH = 4
"""Samples per sigma; beyond two, more samples change the field by less than rounding."""
WIDEST = 1.0
"""[m] Largest width; a larger one is in millimetres."""
FLAT = 1e-6
"""A negative curvature up to this fraction of the stiffness is rounding."""


class PotentialField:
    """Energy Phi(x) and force F(x, v) = -grad Phi - D v that lead a hand along demonstrated paths.

    The energy offset phi_0 of a sample is the drag k1 times the square of a length along the path. If this is the
    remaining length, the drag leads a hand to the target (Eq. 21). If it is the travelled length, the drag resists the
    motion towards the target, most strongly at the target. (With the published k1 < 0 and the remaining length, the
    resistance falls towards the target.)

    Immutable; it can be pickled and shared by threads. The first evaluation compiles the function, and each thread has
    its own buffers.

    Parameters
    ----------
    path : (N, 2) [m] one path, or a sequence of them; a single point is a path, too.
    stiffness : S [N/m], scalar or (2,) per axis; or per point of the path, (N,) or (N, 2); for several paths a sequence
        of these.
    width : sigma [m], over which the influences of points blend.
    drag : k1 [N/m]; the force along the path is 2 k1 (length). F / (2 path length) gives a resistance of F newtons at
        the target.
    damping : D [N s/m], scalar or (2,); by default sqrt(S m) of the stiffest sample and a hand of m = 2.4 kg, see
        `settling`.
    drag_along : "remaining" or "travelled".
    rest_on_target : continue the path beyond its ends so that the force at its target is zero (see `continuation`);
        False is the published field, which rests up to a sigma short of it.
    spacing : [m] between samples along the path; a quarter of the width by default.
    compile : see `BufferedFunction`.

    Raises
    ------
    ConfigurationError : an argument is invalid; with `rest_on_target`, paths without a common target, a negative drag,
        or a path that returns to its target so that the field cannot rest there.
    """

    drag: float
    """[N/m] k1; NaN if phi_0 does not follow Eq. (21)."""
    samples: Samples
    """Samples of the paths, merged if there are many, and their continuation."""
    fit: Fit | None = None
    """Quality of a learnt field."""

    def __init__(
        self,
        path: ArrayLike | Sequence[ArrayLike],
        *,
        stiffness: ArrayLike | Sequence[ArrayLike],
        width: float,
        drag: float = 0.0,
        damping: ArrayLike | None = None,
        drag_along: DragAlong = "remaining",
        rest_on_target: bool = True,
        spacing: float | None = None,
        compile: Compile = None,
    ) -> None:
        given = checked_paths(path)
        width = positive("width", width)
        step, source = sample_spacing(width, spacing)
        paths = [resampled_path(points, step, source) for points in given]
        if drag_along not in get_args(DragAlong):
            raise ConfigurationError("drag_along", drag_along, "'remaining' or 'travelled'")
        drag = checked_drag(drag, drag_along, rest_on_target)
        stiff = path_stiffness(stiffness, given, paths)
        damping = fitting_damping(max(float(each.max()) for each in stiff)) if damping is None else damping
        offsets = [drag * getattr(path, drag_along) ** 2 for path in paths]
        self._set(paths, offsets, stiff, width, damping, drag_along, rest_on_target, compile)
        self.drag = drag
        if self.target is not None and not self.rests:
            raise ConfigurationError(
                "path",
                f"one whose field curves by {self.rest_stiffness:.3g} N/m at {self.target}",
                "a path that does not come back to its target, or rest_on_target=False",
            )

    @classmethod
    def of_samples(
        cls,
        paths: Sequence[SampledPath],
        offsets: Sequence[Array],
        stiffness: Sequence[Array],
        *,
        width: float,
        damping: ArrayLike = 0.0,
        rest_on_target: bool = True,
        compile: Compile = None,
    ) -> PotentialField:
        """Make a field from `offsets` phi_0 (m,) [J] and `stiffness` S (m, 2) [N/m] of each path; its `drag` is NaN.

        The force at the target is zero; `rests` says whether the target is a minimum of the energy.
        """
        field = cls.__new__(cls)
        field._set(list(paths), list(offsets), list(stiffness), width, damping, "remaining", rest_on_target, compile)
        field.drag = math.nan
        return field

    @classmethod
    def learn(cls, demonstrations: Sequence[Any], **options: Any) -> PotentialField:
        """Learn the field that reproduces recorded forces, with its errors in `fit`; options as in `learnt_field`."""
        from rehab_opt.field.learning import learnt_field  # noqa: PLC0415  (solvers load when something is learnt)

        return learnt_field(demonstrations, **options)

    def _set(  # noqa: PLR0917  (the two ways to make one)
        self,
        paths: list[SampledPath],
        offsets: list[Array],
        stiffness: list[Array],
        width: float,
        damping: ArrayLike,
        drag_along: DragAlong,
        rest_on_target: bool,
        compile: Compile,
    ) -> None:
        if not isinstance(rest_on_target, bool):
            raise ConfigurationError("rest_on_target", rest_on_target, "True or False")
        self.paths = tuple(paths)
        self.width = width
        self.damping = per_axis("damping", damping)
        self.drag_along: DragAlong = drag_along
        self.target = rest_point(paths, drag_along, width) if rest_on_target else None
        self.samples = assembled(paths, offsets, stiffness, along=drag_along, width=width, target=self.target)
        self.count = sum(len(path.points) for path in paths)
        self._compile = compile

    # --------------------------------------------------------------------------------------------------- what it is
    @property
    def length(self) -> float:
        """[m] length of the longest path."""
        return max(float(path.travelled[-1]) for path in self.paths)

    @property
    def rest_stiffness(self) -> float:
        """[N/m] smallest curvature of the energy at the target in any direction; NaN without a target."""
        return math.nan if self.target is None else float(np.linalg.eigvalsh(self.stiffness(self.target))[0])

    @property
    def rests(self) -> bool:
        """Whether the target is a minimum of the energy, apart from rounding."""
        return self.rest_stiffness >= -FLAT * max(1.0, float(self.samples.stiffness.max()))

    def __repr__(self) -> str:
        kept = f", evaluated as {len(self.samples.points)}" if len(self.samples.points) != self.count else ""
        return f"PotentialField({len(self.paths)} paths, {self.count} samples{kept}, width {self.width:g} m)"

    # ----------------------------------------------------------------------------------------------- what it answers
    def energy(self, x: ArrayLike) -> float | Array:
        """Energy Phi [J], a float at x (2,) or an array (N,) at x (N, 2) [m]; NaN for points that are not finite."""
        points = as_points(x)
        if points.shape == (2,):
            self.pull(float(points[0]), float(points[1]))
            return float(self._kernel.mine.energy[0])
        return np.asarray(energies_and_forces(self._kernel.mine, points)[0])

    def force(self, x: ArrayLike, v: ArrayLike | None = None) -> Array:
        """F [N] at x (2,) or (N, 2) [m] for hand velocities v of the same shape [m/s], zero by default.

        The force is not bounded and grows with the distance from the path. `Assistance` bounds it.
        """
        points = as_points(x)
        if points.shape == (2,):
            force = np.array(self.pull(float(points[0]), float(points[1])))
        else:
            force = np.asarray(energies_and_forces(self._kernel.mine, points)[1])
        if v is None:
            return force
        velocity = checked_array("v", v, f"numbers (shape {force.shape}) in metres per second")
        if velocity.shape != force.shape:
            raise ConfigurationError("v", velocity.shape, f"an array of shape {force.shape}")
        return force - self.damping * velocity

    def pull(self, x: float, y: float) -> tuple[float, float]:
        """-grad Phi [N] at one point, for a control loop."""
        point, _, elastic, function = self._kernel.mine
        point[0] = x
        point[1] = y
        function.evaluate()
        return elastic[0], elastic[1]

    def stiffness(self, x: ArrayLike) -> Array:
        """(2, 2) [N/m] second derivative of Phi at x (2,)."""
        return stiffness_at(self.samples, self.width, as_point(x))

    @cached_property
    def _kernel(self) -> PerThread[Kernel]:
        return field_kernel(self.samples, self.width, compile=self._compile)

    def __getstate__(self) -> dict[str, Any]:
        """State without compiled code, for use in another process."""
        return {name: value for name, value in self.__dict__.items() if name != "_kernel"}


def sample_spacing(width: float, spacing: float | None) -> tuple[float, str]:
    """Two results: distance [m] between samples of a field of `width` [m], and the name of the argument that set it."""
    if not width <= WIDEST:
        raise ConfigurationError("width", width, f"at most {WIDEST:g} m")
    return (width / SAMPLES_PER_WIDTH, "width") if spacing is None else (positive("spacing", spacing), "spacing")
