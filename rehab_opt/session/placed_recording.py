"""The recording that a problem names, read, resampled and laid where the problem wants it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rehab_opt.errors import ProblemFileError
from rehab_opt.session.files import ProblemFile, recording_path
from rehab_opt.session.participant import checked_hand, placed_path
from rehab_opt.session.recording import Recording
from rehab_opt.session.recordings import read_recording, resampled
from rehab_opt.session.schema import PlacementSection, PlanarPlacement, Problem, RecordingSection, Side

__all__ = ["placed_recording"]

Array = NDArray[np.float64]


def placed_recording(
    loaded: ProblemFile[Problem],
    source: RecordingSection,
    placement: PlanarPlacement | PlacementSection,
    *,
    side: Side,
    rate: float,
    keys: str = "",
) -> tuple[Recording, Array]:
    """The recording at `rate` [Hz], and its path (N, 3) [m] where the placement puts it (z is 0 if it says none).

    Parameters
    ----------
    side : of the arm that is to follow it.
    keys : what stands before `recording` and `placement` in the problem file, with its dot.

    Raises
    ------
    ProblemFileError : it is absent, unreadable, or of the other hand and not mirrored.
    """
    try:
        checked_hand(source, side=side, file=loaded.file)
        path = recording_path(loaded, source.file)
        recording = read_recording(path, name=source.file, **source.reading())
        recording = resampled(recording, rate)
        points, sentence = placed_path(recording, placement, mirror=source.mirror, file=loaded.file)
    except ProblemFileError as refused:
        if not refused.key.startswith(("recording.", "placement")):
            raise  # a line or a column of the recording itself
        raise ProblemFileError(loaded.file, keys + refused.key, refused.value, refused.expected) from refused
    return recording.noting(sentence), points
