"""Geometry of an arm on a chair: its links as capsules, and the joints that move its hand."""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.kinematics.link_capsules import LinkCapsule
from rehab_opt.symbolic.matrices import determinant

__all__ = ["ArmLink", "LinkEnd", "arm_links", "arm_reach", "hand_volume", "links_as_capsules", "maximise_hand_volume"]

Array = NDArray[np.float64]

SAMPLES = 5
"""Number of random postures; a quantity that is equal at all of them counts as constant."""
SAME = 1e-9
"""[m] A smaller distance, or [m/rad] motion of the hand, is rounding."""
LOOKED_AT, REFINED = 1000, 3
"""Number of random postures that are evaluated, and number of the best of them from which a search starts."""


class LinkEnd(NamedTuple):
    """End point of a link."""

    frame: int
    """Frame number as in `LinkCapsule`: joints 1 to `frame` move the point."""
    offset: tuple[float, float, float]
    """(3,) [m] position of the point in that frame."""
    moves: bool
    """Whether a joint of the arm moves the point."""

    def place(self, frames: list[ca.SX]) -> ca.SX:
        """(3,) [m] position of the point; `frames` come from `frames_expression`."""
        frame = frames[self.frame]
        turned = frame[:3, :3] @ ca.sparsify(ca.SX(ca.DM(self.offset))) if any(self.offset) else 0
        return frame[:3, 3] + turned


class ArmLink(NamedTuple):
    """All points within `radius` [m] of the segment between two points that move with the arm."""

    begin: LinkEnd
    end: LinkEnd
    radius: float


def arm_links(chain: SerialChain, *, first: int, radius: float, moved: bool = True) -> tuple[ArmLink, ...]:
    """Capsules of the links after joint `first`; if the chain has none, segments from each joint to the next.

    Parameters
    ----------
    first : number of joints before the arm. radius : [m] radius of the segments.
    moved : True selects the links that a joint of the arm moves, False the others, such as a column on the chair.
    """
    given = [each for each in chain.capsules if each.frame > first]
    if given:
        ends = [LinkEnd(each.frame, end, True) for each in given for end in (each.start, each.end)]
        ends = [end._replace(moves=moves) for end, moves in zip(ends, _moved(chain, ends, first), strict=True)]
        pairs = list(zip(ends[::2], ends[1::2], [each.radius for each in given], strict=True))
    else:
        origins = [LinkEnd(frame, (0.0, 0.0, 0.0), True) for frame in range(first, chain.n + 2)]
        places = _places(chain, origins, first)
        kept = [0]
        for i in range(1, len(origins)):  # of two that coincide, keep the first: fewer joints move it
            if np.abs(places[i] - places[kept[-1]]).max() > SAME:
                kept.append(i)
        moves = _moved(chain, origins, first)
        ends = [origins[i]._replace(moves=moves[i]) for i in kept]
        pairs = [(begin, end, radius) for begin, end in itertools.pairwise(ends)]
    return tuple(ArmLink(begin, end, size) for begin, end, size in pairs if (begin.moves or end.moves) == moved)


def links_as_capsules(chain: SerialChain, links: tuple[ArmLink, ...], name: str) -> tuple[LinkCapsule, ...]:
    """Each link as a capsule with both ends in the frame of its far end; its near end must not move in that frame."""
    frames = chain.frames_expression(ca.SX.zeros(chain.n))
    found = []
    for i, (begin, end, radius) in enumerate(links):
        frame = frames[end.frame]
        x, y, z = np.array(ca.DM(frame[:3, :3].T @ (begin.place(frames) - frame[:3, 3]))).ravel().tolist()
        found.append(LinkCapsule(f"{name} {i}", end.frame, (x, y, z), end.offset, radius))
    return tuple(found)


def arm_reach(chain: SerialChain, links: tuple[ArmLink, ...], *, first: int) -> float:
    """[m] upper bound of the distance between any joint axis of the arm and any point of its links or its tool."""
    before, *others = chain.rows[first:]
    beside = [math.hypot(*end.offset) for link in links for end in (link.begin, link.end)]
    beside.append(float(np.linalg.norm(chain.tool[:3, 3])))
    lengths = before.across + sum(row.across + abs(row.along) for row in others)
    return float(lengths + max(beside))


def hand_volume(chain: SerialChain, q: ca.SX, *, first: int) -> ca.SX:
    """[m^6] det(J J^T), where J (3, k) is the linear Jacobian of the tool for the joints after `first`."""
    columns = chain.jacobian_expression(q)[:3, :]
    moving = [first + int(i) for i in np.flatnonzero(_moves_hand(chain, first))]
    if len(moving) == 3:
        a, b, c = (columns[:, i] for i in moving)
        return ca.dot(a, ca.cross(b, c)) ** 2
    return determinant(columns[:, moving] @ columns[:, moving].T)


def maximise_hand_volume(chain: SerialChain, *, first: int) -> float:
    """[m^3] square root of the largest `hand_volume` within the joint limits.

    L-BFGS-B searches start at the best of many random postures. The seed is fixed, so every run gives the same value.
    """
    from scipy.optimize import minimize  # noqa: PLC0415  (loaded when used)

    q = ca.SX.sym("q", chain.n)
    still = ca.vertcat(ca.SX.zeros(first), q[first:])
    volume = ca.densify(ca.substitute(hand_volume(chain, q, first=first), q, still))
    both = ca.Function("volume", [q], [-volume, -ca.densify(ca.gradient(volume, q))], {"cse": True})
    lower, upper = (np.clip(each, -math.pi, math.pi) for each in (chain.lower, chain.upper))
    lower, upper = np.minimum(lower, chain.upper), np.maximum(upper, chain.lower)  # limits beyond a turn
    drawn = np.random.default_rng(0).uniform(lower, upper, (LOOKED_AT, chain.n))
    values = both.map(LOOKED_AT)(drawn.T)[0].full().ravel()
    best = 0.0
    for posture in drawn[np.argsort(values)[:REFINED]]:
        found = minimize(
            lambda x: tuple(each.full().ravel() for each in both(x)), posture, jac=True, method="L-BFGS-B",
            bounds=list(zip(lower, upper, strict=True)),
        )  # fmt: skip
        best = max(best, -float(found.fun))
    return math.sqrt(best)


def _places(chain: SerialChain, ends: list[LinkEnd], first: int) -> Array:
    """(ends, postures, 3) [m] positions of `ends` at random postures; the joints before `first` are at zero."""
    q = ca.SX.sym("q", chain.n)
    frames = chain.frames_expression(q)
    function = ca.Function("places", [q], [ca.horzcat(*(end.place(frames) for end in ends))])
    return np.array([function(each).full().T for each in _drawn(chain, first)]).transpose(1, 0, 2)


def _moved(chain: SerialChain, ends: list[LinkEnd], first: int) -> list[bool]:
    places = _places(chain, ends, first)
    return [bool(np.ptp(place, axis=0).max() > SAME) for place in places]


def _moves_hand(chain: SerialChain, first: int) -> NDArray[np.bool_]:
    jacobians = np.array([chain.jacobian(q)[:3, first:] for q in _drawn(chain, first)])
    moves: NDArray[np.bool_] = np.abs(jacobians).max(axis=(0, 1)) > SAME
    return moves


def _drawn(chain: SerialChain, first: int) -> Array:
    drawn = np.random.default_rng(0).uniform(-1.0, 1.0, (SAMPLES, chain.n))
    drawn[:, :first] = 0.0
    return drawn
