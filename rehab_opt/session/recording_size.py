"""How large, how long and how fast a recording is, and whether that looks like another unit."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rehab_opt.session.recording import Recording

__all__ = ["size_note", "strange_sizes"]

SMALLEST = 2e-3
"""[m] A movement of less is nobody's task."""
FASTEST, SLOWEST = 10.0, 1e-3
"""[m/s] No hand is faster (a thrown ball leaves it at 40); one that is slower throughout hardly moves."""

UNEVEN, EVEN = 1.1, 1e-2
"""Of steps from sample to sample: the largest over the smallest, and how much they differ, over their mean."""


def size_note(recording: Recording) -> str:
    """Samples, duration, extent and speed in one sentence."""
    said = f"{len(recording.time)} samples over {recording.duration:.4g} s"
    if not recording.points.shape[1]:
        return said
    sides = " x ".join(f"{1e3 * side:.3g}" for side in np.ptp(recording.points, axis=0))
    speed = _speeds(recording)
    length = float(np.linalg.norm(np.diff(recording.points, axis=0), axis=1).sum())
    mean = length / recording.duration
    return f"{said}; {sides} mm large, {1e3 * length:.4g} mm long; mean speed {1e3 * mean:.3g} mm/s, p99 " + (
        f"{1e3 * np.percentile(speed, 99):.3g} mm/s"
    )


def strange_sizes(recording: Recording) -> Iterator[str]:
    """Notes on a movement so small, fast or slow that its lengths or times are likely in another unit than it says, or
    whose times are likely in another column.
    """
    if not recording.points.shape[1]:
        return
    steps = np.diff(recording.time)
    for axis, along in zip("xyz", np.diff(recording.points, axis=0).T, strict=False):
        if steps.max() > UNEVEN * steps.min() and along.mean() > 0 and np.ptp(along) < EVEN * along.mean():
            yield f"{axis} grows by the same in each sample, and time does not: is one taken for the other?"
    extent, usual = float(np.ptp(recording.points, axis=0).max()), float(np.percentile(_speeds(recording), 90))
    if 0 < extent < SMALLEST:
        yield (
            f"the whole movement is {1e3 * extent:.3g} mm large: are these metres that its header calls "
            "millimetres, or another unit?"
        )
    elif usual > FASTEST:
        yield f"a tenth of its samples is faster than {usual:.3g} m/s: are the times, or lengths, in another unit?"
    elif 0 < usual < SLOWEST:
        yield f"nine tenths of its samples are slower than {1e3 * usual:.3g} mm/s: milliseconds taken for seconds?"


def _speeds(recording: Recording) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """(N - 1,) [m/s]"""
    steps = np.linalg.norm(np.diff(recording.points, axis=0), axis=1)
    return np.asarray(steps / np.diff(recording.time))
