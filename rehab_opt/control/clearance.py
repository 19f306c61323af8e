"""Whole-arm clearance: the links of an arm as capsules that keep a distance from what is around them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.kinematics.link_capsules import Capsule
from rehab_opt.kinematics.room import Box, KeepOut

__all__ = ["Clearance", "checked_clearance"]

EXACT = 1e-9
"""Largest entry of R R' - I of a rotation."""


@dataclass(frozen=True, eq=False)
class Clearance:
    """Distance that a robot's links keep from each other and from what is around, at the end of every tick.

    d(q, t) >= margin, for every pair of a link's capsule (`SerialChain.capsules`) and another body, met as the barrier

    grad d . q' + n . (-v) >= -rate (d - margin)

    with n the direction from body to link and v the velocity of the body's nearest point. Rows of the QP are those
    `max_contacts` contacts nearest to their barriers at the last velocity, several of one pair where bodies lie along
    each other (`control.contacts`); all pairs are judged at the end of the tick.

    The promise, at the ends of ticks, where joints move as commanded and moving bodies as given:
    - among bodies that stand still, no pair that was clear comes nearer than `margin`, and one that was nearer gets no
      nearer, in any tick, braking ones included;
    - a body that moves is given way to within speed and joint limits: accelerations yield to it. As long as some
      velocity within them keeps every pair, none comes nearer than `margin`. Where the arm has nowhere to go, or no
      joint moves what is touched, or it brakes because it is not enabled, the body comes nearer by its own motion: the
      arm's own motion never adds to that, and `Relaxed.POSITION` says so.

    Parameters
    ----------
    margin : [m] distance kept, zero or more; the robot's tracking error is not in it.
    self_margin : [m] the same between links.
    planes : what a half-space keeps free, by `KeepOut.through`; each link counts, whole.
    capsules, boxes : bodies that stand still, in the base frame.
    moving : largest number of moving capsules in a tick, see `PoseTracker.step`; a person's arm is three of
        them, by `arm_capsules`.
    pairs : names of links that keep clear of each other, or None for those that neither are neighbours nor overlap at
        half of all postures; the tuple () for none.
    max_contacts : contacts that have rows in a tick. Others are judged at its end: the arm stops before them, but does
        not slide; what a chair promises holds of no fewer than by default.
    rate : [1/s] at which the distance to the margin may decay; by default that of a `Limit`.
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
    """The clearance with names looked up and numbers checked.

    Raises
    ------
    ConfigurationError : a number that cannot be used, a body that is none, a robot without capsules, nothing to keep
        clear of.
    """

    def refuse(name: str, value: object, expected: str) -> ConfigurationError:
        return ConfigurationError(f"{argument}.{name}", value, expected)

    if not chain.capsules:
        raise ConfigurationError(
            "chain",
            chain.names,
            "a robot whose links have capsules, which keep clear: from_urdf(..., capsules='collision')",
        )
    for name, low, high, whole in (
        ("margin", 0, 10, False),
        ("self_margin", 0, 10, False),
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
