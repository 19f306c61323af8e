"""Continue a path beyond its ends, so that the field rests exactly on its target.

Eq. (17) averages over the samples near a point, and at the end of a path all of them lie to one side: the field pulls
back with about 0.4 S sigma there, and rests about one sigma short of its target. Continued by its own reflection
through the end, the path has samples on both sides:

- at the end where the field rests, a reflected sample has the energy offset phi_0 of its original. The field is
symmetric there, and its gradient at the end is zero for any path;
- at the other end phi_0 is continued as an odd function, so that the drag there is that of the path.

At the end where the field rests, phi_0 of the reflected samples is raised by 1/2 d^T S d - a u. Here d is the vector
from that end, and u its component along the path. This brings a hand that overshoots back to the target; the factor a
is chosen so that the force along the path stays zero there. Across a curved path some tenths of a newton remain, which
a linear term (`lean`) of the reflected samples cancels. At the other end phi_0 is raised only from two sigma beyond the
end on, so that it does not pull a hand on the path backwards.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rehab_opt.field.energy import energies_and_forces, field_kernel
from rehab_opt.field.samples import Samples

__all__ = ["REACH", "PathEnd", "at_rest", "reflected"]

Array = NDArray[np.float64]

REACH = 6.0
"""[sigma] Samples further from an end are not reflected; their relative weight there is below exp(-18) = 1.5e-8."""
AWAY = 2.0
"""[sigma] Beyond the end where the field does not rest, the field brings a hand back from this distance on."""
SAME = 1e-9
"""[sigma] A sample nearer to the end than this is its own reflection."""


class PathEnd(NamedTuple):
    """End of a path through which samples are reflected."""

    point: Array
    """(2,) [m]"""
    offset: float | None
    """phi_0 [J] at the end for an odd continuation, or None for an even one."""
    held: bool
    """Whether the field brings back a hand that is beyond the end."""


def at_rest(samples: Samples, target: Array, width: float) -> Samples:
    """`samples` and their mirror images through `target` (2,), so that the force at the target is zero."""
    mirrored = reflected(samples, PathEnd(target, None, held=True), width)
    if not len(mirrored.points):
        return samples
    whole = samples.joined(mirrored)
    force = energies_and_forces(field_kernel(whole, width, compile=False).mine, target[None])[1][0]
    square = ((whole.points - target) ** 2).sum(axis=1) / (2 * width**2)
    weights = np.exp(whole.log_weights - square)
    fraction = weights[len(samples.points) :].sum() / weights.sum()
    lean = np.broadcast_to(force / fraction, mirrored.points.shape)
    away = target - mirrored.points
    # The slope is about the target, not about the sample: there it changes the force but not the energy.
    return samples.joined(mirrored._replace(lean=lean, offsets=mirrored.offsets - (lean * away).sum(axis=1)))


def reflected(samples: Samples, end: PathEnd, width: float) -> Samples:
    """`samples` near `end`, mirrored through it; the `lean` of `samples` must be zero."""
    distance = np.linalg.norm(samples.points - end.point, axis=1)
    near = samples.taken((distance <= REACH * width) & (distance > SAME * width))
    away = end.point - near.points  # positions of the reflections relative to the end
    offsets = near.offsets.copy() if end.offset is None else 2 * end.offset - near.offsets
    raised = 0.5 * (near.stiffness * away**2).sum(axis=1)
    if end.held and end.offset is not None:
        distance = np.linalg.norm(away, axis=1)
        offsets = offsets + raised * np.maximum(0.0, 1.0 - AWAY * width / np.maximum(distance, SAME * width)) ** 2
    elif end.held and len(away):
        weights = np.exp(near.log_weights - (away**2).sum(axis=1) / (2 * width**2))
        moments = (away * weights[:, None]).T @ away
        along = away @ np.linalg.eigh(moments)[1][:, -1]
        offsets = offsets + raised - along * (weights @ (along * raised)) / (weights @ along**2)
    return near._replace(points=end.point + away, offsets=offsets)
