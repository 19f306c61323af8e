"""The columns of trace.csv of chair and arm under one stick."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from rehab_opt.session.ardis.loop import Motion
from rehab_opt.session.ardis.outcome import ArdisOutcome
from rehab_opt.session.systems import Column

__all__ = ["ardis_columns"]

METRES = 2


def ardis_columns(outcome: ArdisOutcome) -> Iterator[Column]:
    """One row a drive, law and tick; wheels that a drive does not have are at rest."""
    motions = [(drive, law, motion) for drive, of in outcome.drives.items() for law, motion in of.by_law.items()]

    def numbers(of: Callable[[Motion], NDArray[np.float64]]) -> list[float]:
        return [float(value) for _, _, motion in motions for value in of(motion)]

    def words(of: Callable[[Motion], tuple[str, ...]]) -> tuple[str, ...]:
        return tuple(value for _, _, motion in motions for value in of(motion))

    yield "drive", tuple(drive for drive, _, motion in motions for _ in motion.time)
    yield "law", tuple(law for _, law, motion in motions for _ in motion.time)
    yield "t_s", numbers(lambda motion: motion.time)
    for axis, name in enumerate(("forward", "left")):
        yield f"stick_{name}", numbers(lambda motion, axis=axis: motion.sticks[:, axis])  # type: ignore[misc]
    yield "stick_mode", words(lambda motion: motion.mode)
    yield "gripper_closed", [int(value) for _, _, motion in motions for value in motion.closed]
    for axis, name in enumerate("xyz"):
        yield f"hand_{name}_m", numbers(lambda motion, axis=axis: motion.hand[:, axis])  # type: ignore[misc]
    for joint, name in enumerate(outcome.robot.chain.names):
        unit = "m" if joint < METRES else "rad"
        yield f"joint_{name}_{unit}", numbers(lambda motion, joint=joint: motion.q[:, joint])  # type: ignore[misc]
    for joint, name in enumerate(outcome.robot.chain.names):
        unit = "m_s" if joint < METRES else "rad_s"
        # The chair's in its own frame, in which its limits are.
        yield f"command_{name}_{unit}", numbers(lambda motion, joint=joint: motion.chassis[:, joint])  # type: ignore[misc]
    most = max(motion.wheels.shape[1] for _, _, motion in motions)
    for wheel in range(most):
        yield f"wheel_{wheel + 1}_rad_s", numbers(lambda motion, wheel=wheel: _wheel(motion, wheel))  # type: ignore[misc]
    yield "scale", numbers(lambda motion: motion.scale)
    yield "status", words(lambda motion: motion.status)
    yield "yielded", words(lambda motion: motion.yielded)


def _wheel(motion: Motion, wheel: int) -> NDArray[np.float64]:
    return motion.wheels[:, wheel] if wheel < motion.wheels.shape[1] else np.zeros(len(motion.time))
