"""Assistance along a path that may cross itself, reverse, or close, based on the progress along it."""

from __future__ import annotations

from typing import Unpack, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.assistance_statement import TINY
from rehab_opt.control.bounded_force import BoundedForce, ForceBounds
from rehab_opt.control.command import Command
from rehab_opt.control.force_tick import DESIRED
from rehab_opt.control.gate import GATE, PULL_BACK, SPRING, DesiredForce, guided_force
from rehab_opt.control.path_progress import BEFORE, BESIDE, PATH_MODEL, PROGRESS, progress_function
from rehab_opt.control.thread_owner import setting
from rehab_opt.control.velocity_controller import checked_number
from rehab_opt.errors import ConfigurationError
from rehab_opt.field.potential import sample_spacing
from rehab_opt.field.samples import checked_paths, resampled_path
from rehab_opt.field.settling import settling_notes
from rehab_opt.kinematics.real_array import positive
from rehab_opt.symbolic import BufferedFunction
from rehab_opt.workspace.edge_distance import edge_columns
from rehab_opt.workspace.region import Workspace

__all__ = ["PathAssistance"]

Array = NDArray[np.float64]


class PathAssistance(BoundedForce):
    """Force [N] of a spring that pulls a hand to its progress point on a path; bounded as in `BoundedForce`.

    min  |F - F_desired|^2  within the bounds of `BoundedForce`, where inside the comfortable workspace

        F_desired = S (p(s) - x) - D (v - (v.t) t),

    x and v are the hand's position and velocity, p(s) is the path point of the last tick, and t the path's direction
    there. Along the path the hand moves freely. Outside the workspace the force pulls back to it, as `Assistance` does
    in mode "follow". The path coordinate s follows the hand, see `path_progress`. The help ends at the path's end;
    `reset` restarts it.

    A hand that stands still under more than 0.1 of `force_limit` is released: the force fades within 0.3 s, and the
    command is BLOCKED. Once the hand is at another point of the path, at most 20 widths away, the force grows again.

    Parameters
    ----------
    path : (N, 2) [m] from start to end.
    stiffness, damping : S [N/m], D [N s/m] across the path.
    width : [m] scale of the path: detours shorter than two widths may be cut. A hand that moves by less than a width in
        0.3 s stands still.
    comfortable, force_limit, return_stiffness, return_force, bounds : see `Assistance`.
    """

    comfortable: Workspace = setting()

    def __init__(
        self,
        path: ArrayLike,
        *,
        stiffness: float,
        width: float,
        damping: float = 0.0,
        comfortable: Workspace,
        force_limit: float = 30.0,
        return_stiffness: float = 500.0,
        return_force: float = 10.0,
        **bounds: Unpack[ForceBounds],
    ) -> None:
        paths = checked_paths(path)
        if len(paths) != 1:
            raise ConfigurationError("path", f"{len(paths)} paths", "one path (N, 2) in metres")
        points = paths[0]
        sampled = resampled_path(points, *sample_spacing(positive("width", width), None))
        if len(sampled.points) < 2:
            raise ConfigurationError("path", points[0].tolist(), "at least two places (N, 2) in metres")
        if not isinstance(comfortable, Workspace) or comfortable.empty:
            raise ConfigurationError("comfortable", comfortable, "a Workspace that is not empty")
        away = float(np.min(comfortable.distance(sampled.points)))
        if away > 0:
            raise ConfigurationError("path", f"{away:.3g} m or more outside `comfortable`", "a path through it")
        self.comfortable = comfortable
        self.spring = SPRING.numbers(
            stiffness=checked_number("stiffness", stiffness, above=0.0, below=1e7),
            damping=checked_number("damping", damping, above=-TINY, below=1e6),
        )
        self.gate = GATE.numbers(
            acts_inside=True,
            pull_limit=checked_number("force_limit", force_limit, above=0.0, below=1e4),
            onset=0.0,
            back=PULL_BACK.numbers(
                stiffness=checked_number("return_stiffness", return_stiffness, above=0.0),
                force=checked_number("return_force", return_force, above=0.0),
            ),
        )
        self.track = np.pad(sampled.points, ((BEFORE, BESIDE), (0, 0)), mode="edge")
        """(N, 2) [m] samples of the path; the first and the last are repeated."""
        self._flat = self.track.ravel()
        option = bounds.get("compile")
        self._edges = edge_columns(comfortable.polygon)
        self._pull = BufferedFunction(guided_force(len(self._edges)), compile=option)
        super().__init__(self._pulled(), force_limit=force_limit, **bounds)
        self.path_model = PATH_MODEL.numbers(
            stiffness=stiffness,
            spacing=float(sampled.travelled[1]),
            last=len(sampled.points) - 1,
            force_limit=force_limit,
            speed_cap=self.speed_cap,
            dt=self.dt,
        )
        self._proceed = BufferedFunction(progress_function(), compile=option)
        self._proceed.inputs[0][:] = self.path_model
        self._begin()

    def _pulled(self) -> DesiredForce:
        hand, force = (cast("memoryview[float]", each.data) for each in (self._pull.inputs[0], self._pull.outputs[0]))
        for held, values in zip(self._pull.inputs[4:], (self.spring, self.gate, self._edges), strict=True):
            held[...] = values

        def desired(x: float, y: float, vx: float, vy: float) -> tuple[float, float]:
            hand[0], hand[1], hand[2], hand[3] = x, y, vx, vy
            self._pull.evaluate()
            return force[0], force[1]

        return desired

    @property
    def progress(self) -> float:
        """Largest fraction of the path, 0 to 1, that the hand has reached."""
        return float(self._state_of_path[PROGRESS["furthest"]] / self.path_model[PATH_MODEL["last"]])

    @property
    def reference_progress(self) -> float:
        """Fraction of the path, 0 to 1, of the point that the spring pulls to."""
        return float(self._state_of_path[PROGRESS["at"]] / self.path_model[PATH_MODEL["last"]])

    @property
    def notes(self) -> tuple[str, ...]:
        """Warnings if spring, bounds and delay do not fit together, with better values; see `settling_notes`."""
        bounds = {"force_limit": self.force_limit, "slew_limit": self.slew_limit}
        stiffness, damping = self.spring.tolist()
        return tuple(settling_notes(stiffness, damping, **bounds, **self._late_by))

    @property
    def at_start(self) -> Array:
        """`PROGRESS` of a hand at the path's start."""
        first, second = self.track[BEFORE : BEFORE + 2]
        full: dict[str, ArrayLike] = dict.fromkeys(PROGRESS.places, 0.0)
        along = (second - first) / np.linalg.norm(second - first)
        return PROGRESS.numbers(**full | {"grip": 1.0, "gap": 1.0, "place": first, "along": along})

    def reset(self, *, energy: bool = True, force: ArrayLike = (0.0, 0.0)) -> None:
        """Reset as `BoundedForce.reset` does, with the hand at the path's start."""
        super().reset(energy=energy, force=force)
        if hasattr(self, "_proceed"):  # not yet in the constructor
            self._begin()

    def step(
        self, x: ArrayLike, v: ArrayLike | None = None, *, enable: object = True, stamp: float | None = None
    ) -> Command:
        """As `BoundedForce.step`; a valid position also updates the progress."""
        command = super().step(x, v, enable=enable, stamp=stamp)
        if not self.valid:
            self._state_of_path[PROGRESS["gap"]] = 1.0
            return command
        state = self._state_of_path
        proceed, at = self._proceed, int(state[PROGRESS["at"]])
        _, old, hand, force, beside = proceed.inputs
        old[:], hand[:], force[:] = state, self.place, self._force
        beside.T.ravel()[:] = self._flat[2 * at : 2 * (at + BESIDE)]
        proceed.evaluate()
        self._lead(proceed.outputs[0])
        return command

    def _begin(self) -> None:
        self._lead(self.at_start)

    def _lead(self, state: Array) -> None:
        self._state_of_path = state.copy()
        _, place, along, fraction, *_ = self._pull.inputs
        place[:], along[:] = state[PROGRESS.places["place"]], state[PROGRESS.places["along"]]
        fraction[:] = state[PROGRESS.places["grip"]]
        self._desired_view[DESIRED["lets_go"]] = state[PROGRESS["away"]]
