"""Nearest contacts of two bodies as expressions: capsule and capsule, capsule and box, ball and half-space.

The distance of two parallel segments is not smooth: a small tilt moves the nearest point from one end to the other. So
each function also returns the points at which two parallel bodies would touch first after a tilt. QP rows on all
contacts avoid chatter.

A contact is a column of `CONTACT` numbers: distance [m]; unit normal (3,), from the other body towards the first;
moment p x normal (3,) [m] with the contact point p; velocity of the other body's point along the normal [m/s]. A
missing contact has the distance `FAR`.
"""

from __future__ import annotations

from functools import reduce
from typing import NamedTuple

import casadi as ca

from rehab_opt.optim.certificate import all_true, clipped

__all__ = ["CONTACT", "CONTACTS", "FAR", "Approach", "ball_above", "capsule_and_box", "capsule_and_capsule"]

CONTACT = 8
"""Number of values of a contact."""
CONTACTS = 5
"""Number of contacts of two capsules, and of a capsule and a box."""
FAR = 1e3
"""[m] Distance of a missing contact or body."""
TINY = 1e-12
"""[m] Distances below this give no direction; [m^2] segments of a smaller squared length count as points."""
PARALLEL = 1e-14
"""Squared sine of the angle below which segments count as parallel, so that only their ends matter."""
SAME = 1e-9
"""Least difference of two points on a segment, as a fraction of its length."""
BESIDE, AGAIN = 5e-4, 1.0
"""[m] Two contacts of a pair that are less than `BESIDE` apart share one row: the room of the further one grows by up
to `AGAIN`.
"""


class Approach(NamedTuple):
    """Relative motion of two bodies, and flags for ends of bodies that another pair covers.

    The room of a contact is its distance minus `lead` times its closing speed. The room of a pair is the room of its
    nearest contact.
    """

    twist: ca.SX
    """(6,) [rad/s, m/s] first body relative to the other: angular velocity, and linear velocity at the origin."""
    lead: ca.SX
    """[s] Time for which the closing speed counts."""
    told: ca.SX
    """(4,) flags of the ends of both bodies; 0 for an end that the pair of an adjacent body covers."""

    def room(self, distance: ca.SX, normal: ca.SX, moment: ca.SX, speed: ca.SX | float) -> ca.SX:
        """Room [m] of a contact."""
        closing = speed - ca.dot(moment, self.twist[:3]) - ca.dot(normal, self.twist[3:])
        return distance - self.lead * ca.fmax(closing, 0)


def ball_above(centre: ca.SX, normal: ca.DM, offset: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Two results: height [m] of a ball's centre (3,) above the plane normal . p = `offset`; the contact (8,)."""
    height = ca.dot(normal, centre) - offset
    return height, ca.vertcat(height, normal, ca.cross(centre, normal), 0)


def capsule_and_capsule(
    first: tuple[ca.SX, ca.SX], other: tuple[ca.SX, ca.SX], radii: ca.SX, speeds: tuple[ca.SX, ca.SX], near: Approach
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Three results for two capsules: distance [m]; approximate room [m] of the nearest points; contacts (9, 5).

    Each column of the contacts holds one contact, and its room as last entry. Overlapping bodies have a negative
    distance, down to minus `radii` for segments that intersect.

    Parameters
    ----------
    first, other : (3,), (3,) [m] ends of the capsules' segments; equal ends make a ball.
    radii : [m] sum of both radii. near : see `Approach`.
    speeds : (3,), (3,) [m/s] velocities of the other capsule's ends.
    """
    (a, a_end), (b, b_end) = first, other
    along, across = a_end - a, b_end - b
    aa, bb, ab = ca.sumsqr(along), ca.sumsqr(across), ca.dot(along, across)
    gap = a - b
    c, f = ca.dot(along, gap), ca.dot(across, gap)
    # For each end of the first segment, its nearest point on the other; s and t are fractions along first and other.
    places = [
        (
            ca.SX(end),
            clipped((f + end * ab) / ca.fmax(bb, TINY), 0, 1),
            aa > TINY if end else ca.SX(1),
        )  # a ball has one end
        for end in (0, 1)
    ]
    for end in (0, 1):
        s = (end * ab - c) / ca.fmax(aa, TINY)
        inside = all_true(s > 0, s < 1, bb > TINY if end else ca.SX(1))  # otherwise the ends of the first cover it
        places.append((clipped(s, 0, 1), ca.SX(end), inside))
    sine = aa * bb - ab * ab
    s = (ab * f - bb * c) / ca.fmax(sine, TINY * PARALLEL)
    t = (ab * s + f) / ca.fmax(bb, TINY)
    crossing = all_true(sine > PARALLEL * aa * bb, s > 0, s < 1, t > 0, t < 1)
    places.append((clipped(s, 0, 1), clipped(t, 0, 1), crossing))
    told = [*ca.vertsplit(near.told), ca.SX(1)]

    def contact(s: ca.SX, t: ca.SX, square: ca.SX) -> ca.SX:
        here, size = a + s * along, ca.sqrt(square)
        normal = (here - b - t * across) / ca.fmax(size, TINY)
        speed = ca.dot(normal, speeds[0] + t * (speeds[1] - speeds[0]))
        moment = ca.cross(here, normal)
        return ca.vertcat(size - radii, normal, moment, speed, near.room(size - radii, normal, moment, speed))

    contacts, squares = [], []
    for (s, t, valid), own in zip(places, told, strict=True):
        square = ca.sumsqr(a + s * along - b - t * across)
        squares.append(ca.if_else(valid, square, FAR**2))
        contacts.append(_where(ca.logic_and(valid, own), contact(s, t, square)))
    sizes = ca.vertcat(ca.sqrt(aa), ca.sqrt(bb))
    on_both = [sizes * ca.vertcat(s, t) for s, t, _ in places]
    _behind_those_beside(contacts, on_both, [ca.sqrt(each) for each in squares], told)
    # Nearest points of the lines, clipped to one segment and then to the other: exact unless parallel.
    s = clipped((ab * f - bb * c) / ca.fmax(sine, TINY * PARALLEL), 0, 1)
    t = clipped((ab * s + f) / ca.fmax(bb, TINY), 0, 1)
    s = clipped((ab * t - c) / ca.fmax(aa, TINY), 0, 1)
    room = contact(s, t, ca.sumsqr(a + s * along - b - t * across))[-1]
    return ca.sqrt(reduce(ca.fmin, squares)) - radii, room, ca.horzcat(*contacts)


def _behind_those_beside(contacts: list[ca.SX], places: list[ca.SX], apart: list[ca.SX], told: list[ca.SX]) -> None:
    """Give more room to a contact beside a nearer contact, or beside a contact that another pair covers."""
    for j, place in enumerate(places):
        for i, beside in enumerate(places):
            nearer = apart[i] <= apart[j] if i < j else apart[i] < apart[j]
            if i != j:
                counts = ca.logic_and(apart[i] < FAR, ca.logic_or(nearer, ca.logic_not(told[i])))
                near = 1 - ca.sum1(ca.fabs(place - beside)) / BESIDE
                contacts[j][-1] += AGAIN * ca.if_else(counts, ca.fmax(near, 0), 0)


def _where(there: ca.SX, contact: ca.SX) -> ca.SX:
    distance, room = (ca.if_else(there, each, FAR) for each in (contact[0], contact[-1]))
    return ca.vertcat(distance, contact[1:-1], room)


def capsule_and_box(
    ends: tuple[ca.SX, ca.SX], turn: ca.SX, centre: ca.SX, half: ca.SX, radius: ca.SX, *, near: Approach
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Three results for a capsule and a box: distance [m]; room [m] of the nearest contact; contacts (9, 5).

    Each column of the contacts holds one contact, and its room as last entry. If the segment cuts the box, the distance
    is negative: minus the length of the shortest translation out of the box, minus `radius`.

    Parameters
    ----------
    ends : (3,), (3,) [m] ends of the capsule's segment. radius : [m] of the capsule. near : see `Approach`.
    turn : (3, 3) axes of the box as columns. centre : (3,) [m] of the box. half : (3,) [m] half the sizes of the box.
    """
    start, stop = (turn.T @ (end - centre) for end in ends)
    along = stop - start

    def beyond(t: ca.SX | float) -> ca.SX:
        place = start + t * along
        return place - clipped(place, -half, half)

    def slope(t: ca.SX | float) -> ca.SX:
        return ca.dot(beyond(t), along)

    # The squared distance is convex along the segment, and quadratic between the points where the segment crosses
    # the planes of faces: find the interval in which its slope changes sign.
    steep = ca.if_else(ca.fabs(along) > TINY, along, TINY)
    crossings = [clipped((side * half[i] - start[i]) / steep[i], 0, 1) for i in range(3) for side in (-1, 1)]
    knots = [ca.SX(0), ca.SX(1), *crossings]
    slopes = [slope(t) for t in knots]
    low = reduce(ca.fmax, [ca.if_else(g <= 0, t, 0) for t, g in zip(knots, slopes, strict=True)])
    high = reduce(ca.fmin, [ca.if_else(g >= 0, t, 1) for t, g in zip(knots, slopes, strict=True)])
    falling, rising = slope(low), slope(high)
    between = ca.if_else(rising - falling > 0, clipped(-falling / ca.fmax(rising - falling, 1e-300), 0, 1), 0.5)
    nearest = low + (high - low) * between
    before = reduce(ca.fmax, [ca.if_else(t < nearest - SAME, t, 0) for t in knots])
    after = reduce(ca.fmin, [ca.if_else(t > nearest + SAME, t, 1) for t in knots])
    places = [
        (nearest, ca.SX(1)), (ca.SX(0), nearest > SAME), (ca.SX(1), nearest < 1 - SAME),
        (before, before > SAME), (after, after < 1 - SAME),
    ]  # fmt: skip
    told = [ca.SX(1), near.told[0], near.told[1], ca.SX(1), ca.SX(1)]
    ball = ca.sumsqr(along) <= TINY
    out, depth, deepest = _way_out(start, stop, half)
    least = ca.norm_2(beyond(nearest))
    within = least <= TINY
    contacts = []
    for k, ((t, valid), own) in enumerate(zip(places, told, strict=True)):
        local = beyond(t)
        size = ca.norm_2(local)
        direction, place = local / ca.fmax(size, TINY), start + t * along
        distance = size - radius
        there = ca.logic_and(valid, own)
        if k == 0:
            direction, place = ca.if_else(within, out, direction), ca.if_else(within, deepest, place)
            distance = ca.if_else(within, -depth - radius, distance)
        else:
            there = all_true(there, size > TINY, ca.logic_not(ball))
        normal, here = turn @ direction, centre + turn @ place
        moment = ca.cross(here, normal)
        room = near.room(distance, normal, moment, 0)
        contacts.append(_where(there, ca.vertcat(distance, normal, moment, 0, room)))
    size = ca.norm_2(along)
    _behind_those_beside(contacts, [size * t for t, _ in places], [ca.SX(k) for k in range(CONTACTS)], told)
    return ca.if_else(within, -depth, least) - radius, contacts[0][-1], ca.horzcat(*contacts)


def _way_out(start: ca.SX, stop: ca.SX, half: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Three results: direction (3,) to the box's nearest face; length [m] of the way out; end (3,) that leaves last."""
    middle, along = (start + stop) / 2, stop - start
    faces = half + ca.fabs(along) / 2 - ca.fabs(middle)
    depth, direction, place = faces[0], ca.SX.zeros(3), ca.SX.zeros(3)
    for i in range(3):
        shortest = faces[i] <= reduce(ca.fmin, [faces[j] for j in range(3)])
        side = ca.if_else(middle[i] < 0, -1, 1)
        axis = ca.SX.zeros(3)
        axis[i] = side
        direction = ca.if_else(shortest, axis, direction)
        place = ca.if_else(shortest, ca.if_else(side * along[i] > 0, start, stop), place)
    depth = reduce(ca.fmin, [faces[i] for i in range(3)])
    for i in range(3):
        across = ca.cross(ca.SX(ca.DM.eye(3)[:, i]), along)
        size = ca.norm_2(across)
        overlap = (ca.dot(half, ca.fabs(across)) - ca.fabs(ca.dot(middle, across))) / ca.fmax(size, TINY)
        depth = ca.if_else(ca.logic_and(size > 1e-6, overlap < depth), overlap, depth)
    return direction, depth, place
