"""Deflections and buttons of a stick over time, from a recording."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ProblemFileError
from rehab_opt.recordings.tables import numbers_below
from rehab_opt.session.live.problem import LiveInputs
from rehab_opt.session.outcome import Array
from rehab_opt.text_file import LATEST, shown, text_lines

HEADER = ("t_s", "forward", "left", "switch", "gripper")
MAX_SAMPLES = 200_000
LONGEST = 3600.0
"""[s] Largest duration of a recording; a longer one probably has its times in another unit."""


LET_GO = LiveInputs(enable=True)
"""A stick at rest."""


class Moment(NamedTuple):
    """The state that the user of a stick sees."""

    time: float
    """Time [s]."""
    q: Array
    """(7,) joint positions [m, rad]."""
    hand: Array
    """(3,) [m] position of the hand in the world frame."""
    mode: str
    """Current mode of the stick."""


class StickRecording(NamedTuple):
    """Samples of a stick, each held until the next one.

    Parameters
    ----------
    time : (N,) [s] increasing from zero. axes : (N, 2) deflections forward and to the left.
    switch, gripper : (N,) whether the button is pressed.
    """

    time: Array
    axes: Array
    switch: NDArray[np.bool_]
    gripper: NDArray[np.bool_]

    @property
    def duration(self) -> float:
        """Time of the last sample [s]."""
        return float(self.time[-1])

    def at(self, moment: Moment) -> LiveInputs | None:
        """The stick's sample at `moment.time`; None after the last sample."""
        if moment.time > self.duration + 1e-9:
            return None
        k = max(int(np.searchsorted(self.time, moment.time + 1e-9, side="right")) - 1, 0)
        forward, left = self.axes[k].tolist()
        return LiveInputs(
            enable=True, stick=(forward, left), switch=bool(self.switch[k]), gripper=bool(self.gripper[k])
        )


def read_stick(path: Path, *, name: str) -> StickRecording:
    """Read a recording of a stick: a CSV with the columns of `HEADER`; deflections -1 to 1, buttons 0 or 1."""
    lines = text_lines(path, name)
    header = tuple(cell.strip() for cell in lines[0].split(","))
    if header != HEADER:
        raise ProblemFileError(name, "line 1", shown(lines[0]), f"the header {','.join(HEADER)}")
    most = dict(zip(HEADER, (LATEST, 1.0, 1.0, 1.0, 1.0), strict=True))
    values = numbers_below(lines[1:], HEADER, HEADER, most, name=name, first=2, separator=",")
    if not 2 <= len(values) <= MAX_SAMPLES:
        raise ProblemFileError(name, "samples", len(values), f"2 to {MAX_SAMPLES}")
    for row, button in np.argwhere(~np.isin(values[:, 3:], (0.0, 1.0))).tolist():
        found = float(values[row, 3 + button])
        raise ProblemFileError(name, f"line {row + 2}, column {HEADER[3 + button]}", found, "0 or 1")
    time = values[:, 0] - values[0, 0]
    back = np.flatnonzero(~(np.diff(time) > 0))
    if back.size:
        at = int(back[0]) + 1
        value, expected = f"{values[at, 0]:.9g} s", f"more than the {values[at - 1, 0]:.9g} s before it"
        raise ProblemFileError(name, f"line {at + 2}, column t_s", value, expected)
    if not time[-1] <= LONGEST:
        raise ProblemFileError(name, "duration", f"{time[-1]:.6g} s", f"at most {LONGEST:g} s (are the times in s?)")
    return StickRecording(time, values[:, 1:3], values[:, 3] == 1.0, values[:, 4] == 1.0)
