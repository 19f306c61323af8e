"""Assistance along a path that crosses itself or comes back to where it was: of the piece that the hand is at."""

from __future__ import annotations

import math
from functools import cache
from typing import Unpack

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.assistance import Assistance
from rehab_opt.control.bounded_force import ForceBounds
from rehab_opt.control.command import Command
from rehab_opt.errors import ConfigurationError
from rehab_opt.field.potential import SAMPLES_PER_WIDTH, PotentialField
from rehab_opt.field.samples import checked_paths, resampled_path
from rehab_opt.symbolic import BufferedFunction
from rehab_opt.workspace.region import Workspace

__all__ = ["REACH", "PathAssistance", "progress_function"]

Array = NDArray[np.float64]

WINDOW = 4.0
"""Widths of the field on either side that the hand is looked for and led along: further samples have no weight."""
PIECE = 2.0
"""Widths between the middles of two pieces."""
REACH, STRIDE = math.ceil(WINDOW * SAMPLES_PER_WIDTH), math.ceil(PIECE * SAMPLES_PER_WIDTH)
"""The same in samples."""


@cache
def progress_function() -> ca.Function:
    """Where along the path a hand has come to: the nearest sample within reach, and the piece whose middle is nearest.

    Returns
    -------
    Hand (2,) [m], x and y of the samples within `REACH` of the last one (4 `REACH` + 2,) [m], infinite beyond the ends,
    number of the last one, number of pieces -> number of the nearest sample, and of the piece (2,).
    """
    hand, near = ca.MX.sym("hand", 2), ca.MX.sym("near", 4 * REACH + 2)
    last, pieces = ca.MX.sym("last"), ca.MX.sym("pieces")
    across, along = near[0::2] - hand[0], near[1::2] - hand[1]
    squares = across * across + along * along
    place = last - REACH + ca.find(squares <= ca.mmin(squares))  # the first of them
    piece = ca.fmin(ca.floor((place + STRIDE // 2) / STRIDE), pieces - 1)
    return ca.Function("path_progress", [hand, near, last, pieces], [ca.vertcat(place, piece)])


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
        samples = resampled_path(points, spacing).points
        if len(samples) < 2:
            raise ConfigurationError("path", points[0].tolist(), "a path, not one place")
        self.track = np.pad(samples, ((REACH, REACH), (0, 0)), constant_values=math.inf)
        """(N + 2 `REACH`, 2) [m] samples of the path, infinite beyond its ends."""
        self._flat = self.track.ravel()
        self.pieces = tuple(
            PotentialField(
                samples[max(0, middle - REACH) : middle + REACH + 1],
                stiffness=stiffness,
                width=width,
                damping=damping,
                rest_on_target=False,
                spacing=spacing,
                compile=bounds.get("compile"),
            )
            for middle in range(0, len(samples) + STRIDE // 2, STRIDE)
        )
        self._at = self._piece = 0
        self._proceed = BufferedFunction(progress_function(), compile=bounds.get("compile"))
        self._proceed.inputs[3][0] = len(self.pieces)
        super().__init__(
            self.pieces[0],
            comfortable=comfortable,
            mode="follow",
            force_limit=force_limit,
            return_stiffness=return_stiffness,
            return_force=return_force,
            **bounds,
        )
        for field in reversed(self.pieces):
            self.aim(field)  # made now, not in the loop

    @property
    def progress(self) -> float:
        """Share of the path, 0 to 1, at which the hand is."""
        return self._at / (len(self.track) - 2 * REACH - 1)

    def reset(self, *, energy: bool = True, force: ArrayLike = (0.0, 0.0)) -> None:
        """Forget the past, see `BoundedForce.reset`: at the path's start."""
        super().reset(energy=energy, force=force)
        self._claim()
        self._lead(0, 0)
        self._give_away()

    def step(
        self, x: ArrayLike, v: ArrayLike | None = None, *, enable: object = True, stamp: float | None = None
    ) -> Command:
        """As `Assistance.step`; the progress goes on where the last tick's position was usable."""
        command = super().step(x, v, enable=enable, stamp=stamp)
        if self.usable:
            proceed, at = self._proceed, self._at
            proceed.inputs[0][:] = self.place
            proceed.inputs[1][:] = self._flat[2 * at : 2 * at + 4 * REACH + 2]
            proceed.inputs[2][0] = at
            proceed.evaluate()
            at, piece = proceed.outputs[0].tolist()
            self._lead(int(at), int(piece))
        return command

    def _lead(self, at: int, piece: int) -> None:
        self._at = at
        if piece != self._piece:
            self._piece = piece
            self.aim(self.pieces[piece])
