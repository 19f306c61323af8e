"""Assistance along a path that crosses itself or comes back to where it was: of the piece that the hand is at."""

from __future__ import annotations

import math
from typing import Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.assistance import Assistance
from rehab_opt.control.bounded_force import ForceBounds
from rehab_opt.control.command import Command
from rehab_opt.errors import ConfigurationError
from rehab_opt.field.potential import SAMPLES_PER_WIDTH, PotentialField
from rehab_opt.field.samples import checked_paths, resampled_path
from rehab_opt.workspace.region import Workspace

__all__ = ["PathAssistance"]

Array = NDArray[np.float64]

WINDOW = 4.0
"""Widths of the field on either side that the hand is looked for and led along: further samples have no weight."""
PIECE = 2.0
"""Widths between the middles of two pieces."""


class PathAssistance(Assistance):
    """`Assistance` in mode "follow", of the field around how far the hand has come.

    The published field is of the whole path at once: where two branches lie closer than a few widths, the hand is held
    between them, or passes from one to the other, and leaves out what is between. Here the field is that of a piece of
    the path, four widths to either side of the hand's progress; the progress is the nearest sample among these, so that
    it goes along the path, forwards or backwards, and never jumps to a branch that is further along the path than that.
    From piece to piece the force changes within its slew bound.

    Corners of a few degrees are a limit: near one, the window holds both legs, side by side. A hand on the new leg that
    is nearer to the old one turns the progress back, which then goes back along the old leg as the hand goes on: on a
    zigzag of 50 by 4 widths it came to be 102 widths of path behind the hand, with the force towards the wrong leg; its
    bounds hold there, too.

    Parameters
    ----------
    path : (N, 2) [m] from its start to its end.
    stiffness, width, damping : S [N/m], sigma [m], D [N s/m], see `PotentialField`.
    comfortable, force_limit, return_stiffness, return_force, bounds : see `Assistance`.

    Raises
    ------
    ConfigurationError : an argument that cannot be used.
    """

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
        (points,) = checked_paths(np.asarray(path))
        if len(points) < 2:
            raise ConfigurationError("path", points.shape, "at least two points (N, 2) in metres")
        if not (isinstance(width, int | float) and 0 < width < math.inf):
            raise ConfigurationError("width", width, "metres above zero")
        spacing = width / SAMPLES_PER_WIDTH
        self._samples = samples = resampled_path(points, spacing).points
        self._x, self._y = np.ascontiguousarray(samples.T)
        if len(samples) < 2:
            raise ConfigurationError("path", points[0].tolist(), "a path, not one place")
        self._reach = math.ceil(WINDOW * SAMPLES_PER_WIDTH)
        self._stride = math.ceil(PIECE * SAMPLES_PER_WIDTH)
        self.pieces = tuple(
            PotentialField(
                samples[max(0, middle - self._reach) : middle + self._reach + 1],
                stiffness=stiffness,
                width=width,
                damping=damping,
                rest_on_target=False,
                spacing=spacing,
                compile=bounds.get("compile"),
            )
            for middle in range(0, len(samples) + self._stride // 2, self._stride)
        )
        for piece in self.pieces:
            piece.pull(0.0, 0.0)  # made now, not in the loop
        self._at = self._piece = 0
        super().__init__(
            self.pieces[0],
            comfortable=comfortable,
            mode="follow",
            force_limit=force_limit,
            return_stiffness=return_stiffness,
            return_force=return_force,
            **bounds,
        )

    @property
    def progress(self) -> float:
        """Share of the path, 0 to 1, at which the hand is."""
        return self._at / (len(self._samples) - 1)

    def reset(self, *, energy: bool = True, force: ArrayLike = (0.0, 0.0)) -> None:
        """Forget the past, see `BoundedForce.reset`: at the path's start."""
        super().reset(energy=energy, force=force)
        self._claim()
        self._at = 0
        self._lead()
        self._give_away()

    def step(
        self, x: ArrayLike, v: ArrayLike | None = None, *, enable: object = True, stamp: float | None = None
    ) -> Command:
        """As `Assistance.step`; the progress goes on where the last tick's position was usable."""
        command = super().step(x, v, enable=enable, stamp=stamp)
        if self.usable:
            (x_now, y_now), first = self.place, max(0, self._at - self._reach)
            near = slice(first, self._at + self._reach + 1)
            across, along = self._x[near] - x_now, self._y[near] - y_now
            # Squared and added one by one, as in C: a fused product may find another of two places as near.
            across *= across
            along *= along
            across += along
            self._at = first + int(across.argmin())
            self._lead()
        return command

    def _lead(self) -> None:
        """The piece whose middle is nearest."""
        piece = min((self._at + self._stride // 2) // self._stride, len(self.pieces) - 1)
        if piece != self._piece:
            self._piece = piece
            self.aim(self.pieces[piece])
