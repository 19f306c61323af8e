"""Distances and nearest contacts of pairs of bodies: links of an arm, and bodies around it.

Every function takes joint positions q (n,), moving capsules (14 k,) from `moving_numbers`, and the time [s] for which
the capsules continue at their velocities.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property, reduce
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.clearance import Clearance
from rehab_opt.control.contacts import (
    CONTACT,
    CONTACTS,
    FAR,
    Approach,
    ball_above,
    capsule_and_box,
    capsule_and_capsule,
)  # fmt: skip
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.kinematics.room import MOVING
from rehab_opt.optim.certificate import all_true, clipped

__all__ = ["ClearancePairs", "least", "linked_pairs"]

Array = NDArray[np.float64]

SAMPLES = 200
"""Number of random postures at which links are checked for overlap."""
MOSTLY = 0.5
"""Links that overlap in more than this fraction of the postures count as neighbours."""
SAME = 1e-9
"""[m] Smaller motions count as rounding."""
ALIKE = 1e-7
"""[1, m] Contacts whose normals and moments differ by less than this count as equal."""
BEHIND = 4.0
"""The rank of a contact is its room, plus up to this factor times the distance by which it exceeds its pair's least
distance.
"""
TIE = 1e-12
"""[m] Rank difference that puts equal contacts in a definite order."""
APPROACH = 11
"""Number of values of an `Approach`."""
THERE = MOVING - 1
"""Index of a moving capsule's flag."""


class Kind(NamedTuple):
    """Functions for pairs of one kind.

    Each function takes the column with the geometry of a pair; `room` and `contacts` also take the pair's `Approach`.
    """

    distance: ca.Function
    room: ca.Function
    contacts: ca.Function
    """Result (9, 5): one contact per column, with its rank as last entry."""


@cache
def _kinds() -> tuple[Kind, Kind]:
    c, b, numbers = ca.SX.sym("column", 19), ca.SX.sym("column", 22), ca.SX.sym("approach", APPROACH)
    near = Approach(numbers[:6], numbers[6], numbers[7:])
    of_capsules = capsule_and_capsule((c[:3], c[3:6]), (c[6:9], c[9:12]), c[18], (c[12:15], c[15:18]), near)
    of_boxes = capsule_and_box((b[:3], b[3:6]), ca.reshape(b[6:15], 3, 3), b[15:18], b[18:21], b[21], near=near)
    made = []
    for name, column, (distance, room, contacts) in (("capsules", c, of_capsules), ("box", b, of_boxes)):
        away, rooms = contacts[0, :], contacts[CONTACT, :]
        behind = BEHIND * (away - ca.mmin(away)) * clipped(rooms / ca.fmax(away, SAME), 0, 1)
        ranked = ca.vertcat(contacts[:CONTACT, :], rooms + behind)
        made.append(
            Kind(
                ca.Function(f"distance_of_{name}", [column], [distance], {"cse": True}),
                *(
                    ca.Function(f"{what}_of_{name}", [column, numbers], [ca.densify(each)], {"cse": True})
                    for what, each in (("room", room), ("contacts", ranked))
                ),
            )
        )
    return made[0], made[1]


@dataclass(frozen=True, eq=False)
class ClearancePairs:
    """Pairs of bodies that a checked `Clearance` keeps apart, for one chain.

    A link that no joint moves (a base, or a link that turns about its own axis) is paired only with other links.
    """

    clearance: Clearance
    chain: SerialChain

    @cached_property
    def names(self) -> tuple[tuple[str, str], ...]:
        """Names of both bodies of each pair, as in `distances`; a plane makes a pair with each moving link end."""
        given, links = self.clearance, self.chain.capsules
        others = [*(each.name for each in given.capsules), *(f"moving {i}" for i in range(given.moving))]
        free = [links[i].name for i in self.free]
        pairs = [(links[i].name, links[j].name) for i, j in self.linked]
        pairs += [(link, other) for link in free for other in others]
        pairs += [(link, box.name) for link in free for box in given.boxes]
        return (*pairs, *((links[i].name, f"plane {j}") for i, _, j in self._before_planes))

    @cached_property
    def max_contacts(self) -> int:
        """Number of contacts that get QP rows."""
        contacts = self._spans_of_balls.shape[1] + CONTACTS * sum(self._looked_at)
        return int(min(self.clearance.max_contacts, contacts))

    @property
    def size(self) -> int:
        """Length of the column of `nearest`."""
        return self.max_contacts * (self.chain.n + 2) + 1

    @property
    def moving_size(self) -> int:
        """Number of values of the moving capsules."""
        return MOVING * self.clearance.moving

    @cached_property
    def distances(self) -> ca.Function:
        """Function: q, moving capsules, time -> distance [m] of every pair, minus the margin."""
        q, told, time = ca.MX.sym("q", self.chain.n), ca.MX.sym("moving", self.moving_size), ca.MX.sym("time")
        *columns, _, heights, _ = self._placed(q, told, time)
        apart = [each for cells, kind in zip(columns, _kinds(), strict=True) for each in _mapped(kind.distance, cells)]
        return ca.Function("distances", [q, told, time], [ca.vertcat(*(each.T for each in apart), heights)])

    @cached_property
    def nearest(self) -> ca.Function:
        """Function: q, last velocity, moving capsules, time -> column of the contacts with the least room, see `read`.

        `Approach` defines the room of a contact. The last entry of the column is the least distance of all pairs at q,
        minus the margin.
        """
        n, k = self.chain.n, self.max_contacts
        q, last = ca.MX.sym("q", n), ca.MX.sym("last", n)
        told, time = ca.MX.sym("moving", self.moving_size), ca.MX.sym("time")
        *columns, balls, _, screws = self._placed(q + last * time / 2, told, time / 2)
        *approaches, rooms = self._approaches(screws, last, balls)
        contacts, spans = [ca.vertcat(balls, rooms)], [ca.MX(ca.DM(self._spans_of_balls))]
        parts = (columns, approaches, _kinds(), self._looked_at, self._spans)
        for cells, near, kind, looked_at, span in zip(*parts, strict=True):
            if not looked_at:
                continue
            joints = ca.MX(ca.DM(span))
            if looked_at < cells.size2():
                which = least(cells.size2(), looked_at)(kind.room.map(cells.size2())(cells, near).T)
                cells, near, joints = cells[:, which], near[:, which], joints[:, which]  # noqa: PLW2901
            contacts.append(ca.reshape(kind.contacts.map(looked_at)(cells, near), CONTACT + 1, -1))
            spans.append(ca.reshape(ca.repmat(joints, CONTACTS, 1), 2, -1))
        near, joints = ca.horzcat(*contacts), ca.horzcat(*spans)
        which = least(near.size2(), k)(near[CONTACT, :].T)
        column = self._rows(k)(near[:CONTACT, which], joints[:, which], screws, last, time)
        return ca.Function("nearest", [q, last, told, time], [ca.vertcat(column, ca.mmin(self.distances(q, told, 0)))])

    def read(self, column: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Split a column of `nearest` into distances minus margin (k,), their slopes by q (k, n), and rates (k,).

        The rates are the changes of the distances per second by the bodies' own motion.
        """
        k = self.max_contacts
        return column[:k], ca.reshape(column[2 * k : -1], k, self.chain.n), column[k : 2 * k]

    # --------------------------------------------------------------------------------------------- which pairs
    @cached_property
    def free(self) -> tuple[int, ...]:
        """Indices of the links that some joint moves."""
        moved = np.ptp(_places(self.chain, 5), axis=0).reshape(len(self.chain.capsules), -1).max(axis=1) > SAME
        return tuple(int(i) for i in np.flatnonzero(moved))

    @cached_property
    def linked(self) -> tuple[tuple[int, int], ...]:
        """Pairs of links; the first link of a pair is moved by more joints."""
        return linked_pairs(self.chain, self.clearance)

    @cached_property
    def _looked_at(self) -> tuple[int, int]:
        """Number of pairs of each kind for which contacts are computed."""
        most = self.clearance.max_contacts
        return min(self._spans[0].shape[1], most), min(self._spans[1].shape[1], max(1, most // 2))

    @cached_property
    def _spans(self) -> tuple[Array, Array]:
        """Array (2, pairs) for each kind: range of joints (first, end) that move one body relative to the other."""
        frames = [min(each.frame, self.chain.n) for each in self.chain.capsules]
        given = self.clearance
        linked = [(frames[j], frames[i]) for i, j in self.linked]
        round_, boxed = (
            [(0, frames[i]) for i in self.free for _ in range(count)]
            for count in (len(given.capsules) + given.moving, len(given.boxes))
        )
        return _pairs_of_numbers([*linked, *round_]), _pairs_of_numbers(boxed)

    @cached_property
    def _spans_of_balls(self) -> Array:
        frames = [min(self.chain.capsules[i].frame, self.chain.n) for i, _, _ in self._before_planes]
        return _pairs_of_numbers([(0, frame) for frame in frames])

    @cached_property
    def _before_planes(self) -> tuple[tuple[int, int, int], ...]:
        places, planes = _places(self.chain, 5), self.clearance.planes
        return tuple(
            (i, end, j)
            for i in self.free
            for j, plane in enumerate(planes)
            for end in range(2 if self.chain.capsules[i].start != self.chain.capsules[i].end else 1)
            if np.ptp(places[:, i, end] @ np.array(plane.normal)) > SAME and self._thickest(i, end)
        )

    def _thickest(self, link: int, end: int) -> bool:
        number = self._ends_by_number["link", link][0][end]
        radii = {
            i: radius for (kind, i), (both, radius) in self._ends_by_number.items() if kind == "link" and number in both
        }
        return max(radii, key=lambda i: (radii[i], -i)) == link

    @cached_property
    def lead(self) -> float:
        """[s] Time constant of the barrier, see `Approach`."""
        chain, rate = self.chain, self.clearance.rate
        return float(np.max(chain.velocity / chain.acceleration)) if rate is None else 1 / rate

    @cached_property
    def _told(self) -> tuple[Array, Array]:
        """Flags (4, pairs) of both bodies' ends, for each kind; 0 for an end that the pair of a thicker body covers."""
        bodies = [("link", i) for i in self.free], [("body", i) for i, _ in enumerate(self.clearance.capsules)]
        moving = [("moving", i) for i in range(self.clearance.moving)]
        pairs = [(("link", i), ("link", j)) for i, j in self.linked]
        pairs += [(link, other) for link in bodies[0] for other in (*bodies[1], *moving)]
        boxed = [(link, ("box", i)) for link in bodies[0] for i, _ in enumerate(self.clearance.boxes)]
        told = []
        for some in (pairs, boxed):
            sides = [((a, 0, b), (a, 1, b), (b, 0, a), (b, 1, a)) for a, b in some]
            tellers: dict[tuple[int, tuple[str, int]], tuple[float, int]] = {}
            for number, each in enumerate(sides):
                for body, end, other in each:
                    if body in self._ends_by_number:
                        numbers, radius = self._ends_by_number[body]
                        key, mine = (numbers[end], other), (-radius, number)
                        tellers[key] = min(tellers.get(key, mine), mine)
            found = np.ones((4, len(some)))
            for number, each in enumerate(sides):
                for row, (body, end, other) in enumerate(each):
                    if body in self._ends_by_number:
                        found[row, number] = tellers[self._ends_by_number[body][0][end], other][1] == number
            told.append(found)
        return told[0], told[1]

    @cached_property
    def _ends_by_number(self) -> dict[tuple[str, int], tuple[tuple[int, int], float]]:
        """Numbers of both ends, and radius, of each link and fixed capsule; coincident ends have equal numbers."""
        places, found, ends = _places(self.chain, 5), {}, []
        bodies = [(("link", i), places[:, i], each.radius) for i, each in enumerate(self.chain.capsules)]
        for i, each in enumerate(self.clearance.capsules):
            bodies.append((("body", i), np.broadcast_to([each.start, each.end], (len(places), 2, 3)), each.radius))
        for name, points, radius in bodies:
            numbers = []
            for end in (0, 1):
                ends.append(points[:, end])
                numbers.append(next(k for k, other in enumerate(ends) if np.abs(other - ends[-1]).max() <= SAME))
            found[name] = (numbers[0], numbers[1]), radius
        return found

    # ---------------------------------------------------------------------------------------------- expressions
    @cached_property
    def _placed(self) -> ca.Function:
        chain, given = self.chain, self.clearance
        q, told, time = ca.SX.sym("q", chain.n), ca.SX.sym("moving", self.moving_size), ca.SX.sym("time")
        frames, links, margin = chain.frames_expression(q), chain.capsules, given.margin
        ends = _ends(chain, frames)
        still = ca.SX.zeros(6)
        others = [
            (ca.SX(ca.vertcat(ca.DM(each.start), ca.DM(each.end))), still, ca.SX(each.radius))
            for each in given.capsules
        ]
        for i in range(given.moving):
            one = told[MOVING * i : MOVING * (i + 1)]
            absent = FAR * (one[THERE] == 0)
            others.append((one[:6] + time * one[6:12], one[6:12], ca.fmax(one[12], 0) - absent))
        capsules = [
            ca.vertcat(*ends[i], *ends[j], still, links[i].radius + links[j].radius + given.self_margin)
            for i, j in self.linked
        ]
        capsules += [
            ca.vertcat(*ends[i], other, speeds, links[i].radius + radius + margin)
            for i in self.free
            for other, speeds, radius in others
        ]
        boxes = [
            ca.vertcat(
                *ends[i], ca.vec(ca.DM(np.array(box.turn))), ca.DM(box.centre), ca.DM(box.size) / 2,
                links[i].radius + margin,
            )
            for i in self.free
            for box in given.boxes
        ]  # fmt: skip
        balls = [
            ball_above(
                ends[i][end], ca.DM(given.planes[j].normal), ca.SX(given.planes[j].offset + links[i].radius + margin)
            )
            for i, end, j in self._before_planes
        ]
        heights = ca.vertcat(ca.SX(0, 1), *(height for height, _ in balls))
        touching = ca.horzcat(ca.SX(CONTACT, 0), *(contact for _, contact in balls))
        outputs = [
            ca.horzcat(ca.SX(19, 0), *capsules), ca.horzcat(ca.SX(22, 0), *boxes), touching, heights,
            self._screws(frames),
        ]  # fmt: skip
        return ca.Function("placed", [q, told, time], [ca.densify(each) for each in outputs], {"cse": True})

    def _screws(self, frames: list[ca.SX]) -> ca.SX:
        """Screw (6, n) of each joint: angular and linear velocity at the base frame's origin per unit speed."""
        columns = []
        for row, frame in zip(self.chain.rows, frames, strict=False):
            axis = frame[:3, 2]
            turn, shift = (ca.SX.zeros(3), axis) if row.prismatic else (axis, ca.cross(frame[:3, 3], axis))
            columns.append(ca.vertcat(turn, shift))
        return ca.horzcat(*columns)

    @cached_property
    def _approaches(self) -> ca.Function:
        n, balls = self.chain.n, ca.SX.sym("balls", CONTACT, self._spans_of_balls.shape[1])
        screws, last = ca.SX.sym("screws", 6, n), ca.SX.sym("last", n)
        moves = [ca.SX.zeros(6)]
        for i in range(n):
            moves.append(moves[-1] + screws[:, i] * last[i])

        def approach(span: Array, told: Array) -> Approach:
            return Approach(moves[int(span[1])] - moves[int(span[0])], ca.SX(self.lead), ca.SX(ca.DM(told)))

        outputs = [
            ca.horzcat(
                ca.SX(APPROACH, 0), *(ca.vertcat(*approach(*each)) for each in zip(spans.T, told.T, strict=True))
            )
            for spans, told in zip(self._spans, self._told, strict=True)
        ]
        rooms = [
            approach(span, np.ones(4)).room(ball[0], ball[1:4], ball[4:7], 0)
            for span, ball in zip(self._spans_of_balls.T, ca.horzsplit(balls), strict=False)
        ]
        outputs.append(ca.horzcat(ca.SX(1, 0), *rooms))
        return ca.Function("approaches", [screws, last, balls], [ca.densify(each) for each in outputs], {"cse": True})

    def _rows(self, k: int) -> ca.Function:
        n = self.chain.n
        contacts, spans, screws = ca.SX.sym("contacts", CONTACT, k), ca.SX.sym("spans", 2, k), ca.SX.sym("screws", 6, n)
        last, time = ca.SX.sym("last", n), ca.SX.sym("time")
        slopes, changes, distances = [], [], []
        for j in range(k):
            distance, normal, moment, speed = ca.vertsplit(contacts[:, j], [0, 1, 4, 7, 8])
            # Links that meet in a joint share an end; two rows for that end would be dependent.
            seen = [ca.sumsqr(contacts[1:7, j] - contacts[1:7, i]) < ALIKE**2 for i in range(j)]
            there = all_true(distance < FAR / 2, *(ca.logic_not(each) for each in seen))
            slope = screws.T @ ca.vertcat(moment, normal)
            moves = [ca.logic_and(ca.logic_and(i >= spans[0, j], i < spans[1, j]), there) for i in range(n)]
            moves = [ca.logic_and(moves[i], ca.fabs(slope[i]) > SAME) for i in range(n)]  # rounding
            slopes.append(ca.vertcat(*(ca.if_else(moves[i], slope[i], 0) for i in range(n))))
            changes.append(ca.if_else(there, -speed, 0))
            distances.append(ca.if_else(there, distance, FAR) - (ca.dot(slopes[-1], last) + changes[-1]) * time / 2)
        column = ca.vertcat(*distances, *changes, ca.vec(ca.horzcat(*slopes).T))
        return ca.Function("rows", [contacts, spans, screws, last, time], [ca.densify(column)], {"cse": True})


def linked_pairs(chain: SerialChain, clearance: Clearance) -> tuple[tuple[int, int], ...]:
    """Pairs of link indices that keep clear of each other; the first link of a pair is moved by more joints."""
    links = chain.capsules
    every = [(i, j) if links[i].frame >= links[j].frame else (j, i) for i in range(len(links)) for j in range(i)]
    if clearance.pairs is not None:
        named = {frozenset(pair) for pair in clearance.pairs}
        return tuple(
            (i, j)
            for i, j in every
            if frozenset((links[i].name, links[j].name)) in named and links[i].frame != links[j].frame
        )
    apart = [(i, j) for i, j in every if links[i].frame - links[j].frame > 1]
    if not apart:
        return ()
    places, found, still = _places(chain, SAMPLES), [], np.zeros((SAMPLES, 6))
    for i, j in apart:
        radii = np.full((SAMPLES, 1), links[i].radius + links[j].radius)
        columns = np.hstack([places[:, i].reshape(SAMPLES, 6), places[:, j].reshape(SAMPLES, 6), still, radii])
        if np.mean(np.array(_kinds()[0].distance.map(SAMPLES)(columns.T)) < 0) < MOSTLY:
            found.append((i, j))
    return tuple(found)


def _ends(chain: SerialChain, frames: list[ca.SX]) -> list[tuple[ca.SX, ca.SX]]:
    """Ends (3,), (3,) [m] of each link's segment."""
    places = [(frames[each.frame][:3, :3], frames[each.frame][:3, 3], each) for each in chain.capsules]
    return [(turn @ ca.DM(link.start) + origin, turn @ ca.DM(link.end) + origin) for turn, origin, link in places]


def _places(chain: SerialChain, count: int) -> Array:
    """(count, links, 2, 3) [m] ends of the links at random postures; each joint stays within one turn."""
    q = ca.SX.sym("q", chain.n)
    ends = ca.vertcat(*(end for both in _ends(chain, chain.frames_expression(q)) for end in both))
    lower, upper = np.maximum(chain.lower, -np.pi), np.minimum(chain.upper, np.pi)
    drawn = np.random.default_rng(0).uniform(np.minimum(lower, chain.upper), np.maximum(upper, lower), (count, chain.n))
    places = np.array(ca.Function("places", [q], [ca.densify(ends)]).map(count)(drawn.T))
    return places.T.reshape(count, len(chain.capsules), 2, 3)


def _mapped(function: ca.Function, cells: ca.MX) -> list[ca.MX]:
    return [function.map(cells.size2())(cells)] if cells.size2() else []


def least(count: int, k: int) -> ca.Function:
    """Function: column -> indices of its k smallest entries, in ascending order of the entries."""
    column = ca.SX.sym("column", count)
    keys, given = [ca.SX(2 * FAR)] * k, [column[i] + i * TIE for i in range(count)]
    for key in given:
        for j in range(k):
            keys[j], key = ca.fmin(keys[j], key), ca.fmax(keys[j], key)  # noqa: PLW2901
    which = [reduce(ca.fmax, [i * (each == key) for i, each in enumerate(given)], ca.SX(0)) for key in keys]
    return ca.Function(f"least_{k}_of_{count}", [column], [ca.vertcat(*which)])


def _pairs_of_numbers(pairs: list[tuple[int, int]]) -> Array:
    return np.array(pairs, dtype=np.float64).reshape(-1, 2).T
