"""Whole-arm clearance: the arm's links, modelled as capsules, keep a distance from the bodies around them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.kinematics.link_capsules import Capsule
from rehab_opt.kinematics.plausible import check_place
from rehab_opt.kinematics.room import Box, KeepOut

__all__ = ["Clearance", "checked_clearance"]

EXACT = 1e-9
"""Largest entry of R R' - I for which the matrix R counts as a rotation."""


@dataclass(frozen=True, eq=False)
class Clearance:
    """Distance that a robot's links keep from each other and from other bodies, at the end of every tick.

    d(q, t) >= margin, for every pair of a link's capsule (`SerialChain.capsules`) and another body, through the barrier

    grad d . q' + n . (-v) >= -rate (d - margin)

    with n the direction from body to link and v the velocity of the body's nearest point. The following holds if joints
    move as commanded and moving bodies keep the velocity that the caller passes.
    - Fixed bodies: no pair comes nearer than `margin`, and a pair that is already nearer gets no nearer, also while
      braking.
    - Moving bodies: the arm moves away within speed and joint limits, and may exceed its acceleration limits. If no
      such velocity exists, or the arm is not enabled, the body may come nearer by its own motion; `Relaxed.POSITION`
      reports it. The arm's own motion never brings a body nearer.

    Parameters
    ----------
    margin : [m] least distance, not negative; it does not include the robot's tracking error.
    self_margin : [m] least distance between links.
    planes : half-spaces, from `KeepOut.through`; each whole link stays out of them.
    capsules, boxes : fixed bodies in the base frame.
    moving : largest number of moving capsules, see `PoseTracker.step`; a person's arm has three, from `arm_capsules`.
    pairs : pairs of link names that keep clear of each other; () for none. None selects all pairs that are not
        neighbours and do not overlap in half of all postures.
    max_contacts : number of contacts that get QP rows in a tick. The arm stops before all other contacts, but does not
        slide along them. An arm on a chair needs at least the default.
    rate : [1/s] largest decay rate of the distance to the margin; by default that of a `Limit`.
    """

    margin: float
    self_margin: float = 0.0
    planes: Sequence[KeepOut] = ()
    capsules: Sequence[Capsule] = ()
    boxes: Sequence[Box] = ()
    moving: int = 0
    pairs: Sequence[tuple[str, str]] | None = None
    max_contacts: int = 8
    rate: float | None = None


def checked_clearance(argument: str, given: Clearance, chain: SerialChain) -> Clearance:
    """Check a clearance for a chain and return it.

    Raises `ConfigurationError` for an invalid number or body, unknown link names, or a chain without capsules.
    """

    def refuse(name: str, value: object, expected: str) -> ConfigurationError:
        return ConfigurationError(f"{argument}.{name}", value, expected)

    if not chain.capsules:
        raise ConfigurationError(
            "chain",
            chain.names,
            "a robot with capsules on its links: from_urdf(..., capsules='collision')",
        )
    for name, low, high, whole in (
        ("margin", 0, 1, False),
        ("self_margin", 0, 1, False),
        ("moving", 0, 100, True),
        ("max_contacts", 1, 100, True),
    ):
        value = getattr(given, name)
        kinds = (int, np.integer) if whole else (int, float, np.number)
        if isinstance(value, bool) or not isinstance(value, kinds) or not low <= value <= high:
            raise refuse(name, value, f"a {'whole ' if whole else ''}number from {low} to {high}")
    if not (given.rate is None or (isinstance(given.rate, (int, float)) and 0 < given.rate < math.inf)):
        raise refuse("rate", given.rate, "a number above zero, or None")
    for name, kind in (("planes", KeepOut), ("capsules", Capsule), ("boxes", Box)):
        bodies = getattr(given, name)
        if not isinstance(bodies, (list, tuple)):
            raise refuse(name, bodies, f"a list or tuple of {kind.__name__}")
        for i, body in enumerate(bodies):
            if not isinstance(body, kind) or not _usable(body):
                sizes = "above zero" if kind is Box else "of zero or more"
                raise refuse(f"{name}[{i}]", body, f"a {kind.__name__} of finite numbers, sizes {sizes}")
            check_place(f"{argument}.{name}[{i}]", body, chain)
    names = [each.name for each in chain.capsules]
    for i, pair in enumerate(given.pairs or ()):
        if not (isinstance(pair, tuple) and len(pair) == 2 and set(pair) <= set(names)) or pair[0] == pair[1]:
            raise refuse(f"pairs[{i}]", pair, f"two of the links' capsules, {', '.join(names)}")
    return given


def _usable(body: KeepOut | Capsule | Box) -> bool:
    numbers = [part for part in body if not isinstance(part, str)]
    try:
        finite = all(np.all(np.isfinite(np.asarray(part, dtype=np.float64))) for part in numbers)
        if isinstance(body, Box):
            shapes = [np.shape(part) for part in numbers] == [(3,), (3,), (3, 3)]
            turn = np.asarray(body.turn)
            return finite and shapes and min(body.size) > 0 and bool(np.abs(turn @ turn.T - np.eye(3)).max() <= EXACT)
        if isinstance(body, Capsule):
            return finite and [np.shape(part) for part in numbers] == [(3,), (3,), ()] and body.radius >= 0
        return finite and [np.shape(part) for part in numbers] == [(3,), ()]
    except (TypeError, ValueError):
        return False
