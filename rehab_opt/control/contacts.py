"""Where two bodies come nearest, as expressions: capsule and capsule, capsule and box, ball and half-space.

The distance of two capsules is that of their segments less their radii. It is smooth but where the nearest points
jump: segments that lie side by side touch along a line, and the least tilt moves the nearest point from one end of it
to the other. So each function gives several contacts: the nearest points, and the points at which two bodies that lie
along each other would touch first if they tilted. Each contact is one of material points, whose distance is smooth
and no less than that of the bodies; rows on all of them do not chatter where a row on the nearest alone would.

A contact is a column of `CONTACT` numbers: distance [m]; unit normal (3,), from the other body towards the first;
moment p x normal (3,) [m] of the place p of contact; and the velocity of the other body's point along the normal
[m/s]. A contact that is none has the distance `FAR`.
"""

from __future__ import annotations

from functools import reduce

import casadi as ca

from rehab_opt.optim.certificate import all_true, clipped

__all__ = ["CONTACT", "CONTACTS", "FAR", "ball_above", "capsule_and_box", "capsule_and_capsule"]

CONTACT = 8
"""Numbers of a contact."""
CONTACTS = 5
"""Contacts of two capsules, and of a capsule and a box."""
FAR = 1e3
"""[m] Distance of what is not there."""
TINY = 1e-12
"""[m] A distance that gives no direction, or [m^2] the square of a segment that is a point."""
PARALLEL = 1e-14
"""Square of the sine of the angle below which segments count as parallel: their ends come as near as their insides."""
SAME = 1e-9
"""Share of a segment by which two places on it differ."""


def ball_above(centre: ca.SX, normal: ca.DM, offset: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Height [m] of a ball's centre (3,) less `offset` along a half-space's normal, and the contact."""
    height = ca.dot(normal, centre) - offset
    return height, ca.vertcat(height, normal, ca.cross(centre, normal), 0)


def capsule_and_capsule(
    first: tuple[ca.SX, ca.SX], other: tuple[ca.SX, ca.SX], radii: ca.SX, speeds: tuple[ca.SX, ca.SX]
) -> tuple[ca.SX, ca.SX]:
    """Distance [m] of two capsules, and contacts (8, 5).

    Parameters
    ----------
    first, other : (3,), (3,) [m] ends of their segments; equal ones make a ball.
    radii : [m] their sum. speeds : (3,), (3,) [m/s] how the ends of the other one move.

    The distance is that of the segments less `radii`, negative by as much as the bodies overlap where one of the
    segments' nearest points is an end or a crossing: at least minus `radii`, at segments that meet.
    """
    (a, a_end), (b, b_end) = first, other
    along, across = a_end - a, b_end - b
    aa, bb, ab = ca.sumsqr(along), ca.sumsqr(across), ca.dot(along, across)
    gap = a - b
    c, f = ca.dot(along, gap), ca.dot(across, gap)
    # Of each end of the first the nearest point of the other; t is where on the other, s where on the first.
    places = [
        (
            ca.SX(end),
            clipped((f + end * ab) / ca.fmax(bb, TINY), 0, 1),
            aa > TINY if end else ca.SX(1),
        )  # a ball has one
        for end in (0, 1)
    ]
    for end in (0, 1):
        s = (end * ab - c) / ca.fmax(aa, TINY)
        inside = all_true(s > 0, s < 1, bb > TINY if end else ca.SX(1))  # otherwise the first's ends tell
        places.append((clipped(s, 0, 1), ca.SX(end), inside))
    sine = aa * bb - ab * ab
    s = (ab * f - bb * c) / ca.fmax(sine, TINY * PARALLEL)
    t = (ab * s + f) / ca.fmax(bb, TINY)
    crossing = all_true(sine > PARALLEL * aa * bb, s > 0, s < 1, t > 0, t < 1)
    places.append((clipped(s, 0, 1), clipped(t, 0, 1), crossing))
    contacts, squares = [], []
    for s, t, valid in places:
        here, there = a + s * along, b + t * across
        apart = here - there
        square = ca.sumsqr(apart)
        squares.append(ca.if_else(valid, square, FAR**2))
        size = ca.sqrt(square)
        normal = apart / ca.fmax(size, TINY)
        speed = ca.dot(normal, speeds[0] + t * (speeds[1] - speeds[0]))
        distance = ca.if_else(valid, size - radii, FAR)
        contacts.append(ca.vertcat(distance, normal, ca.cross(here, normal), speed))
    return ca.sqrt(reduce(ca.fmin, squares)) - radii, ca.horzcat(*contacts)


def capsule_and_box(
    ends: tuple[ca.SX, ca.SX], turn: ca.SX, centre: ca.SX, half: ca.SX, radius: ca.SX
) -> tuple[ca.SX, ca.SX]:
    """Distance [m] of a capsule and a box, and contacts (8, 5).

    Parameters
    ----------
    ends : (3,), (3,) [m] of the capsule's segment. turn : (3, 3) axes of the box, by columns. centre : (3,) [m] of it.
    half : (3,) [m] half its sizes. radius : [m] of the capsule.

    Outside, the distance of the segment from the box less `radius`. Where the segment cuts the box, minus the shortest
    way out by translation less `radius`, exactly: box and segment added up are a body of twelve faces. There the
    contact leads out through the nearest face of the box, of what it cuts deepest.
    """
    start, stop = (turn.T @ (end - centre) for end in ends)
    along = stop - start

    def beyond(t: ca.SX | float) -> ca.SX:
        place = start + t * along
        return place - clipped(place, -half, half)

    def slope(t: ca.SX | float) -> ca.SX:
        return ca.dot(beyond(t), along)

    # The square of the distance is convex along the segment, and quadratic between the places where the segment
    # crosses a plane of a face: its slope there is looked at, and zero where two of them say.
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
    ball = ca.sumsqr(along) <= TINY
    out, depth, deepest = _way_out(start, stop, half)
    least = ca.norm_2(beyond(nearest))
    within = least <= TINY
    contacts = []
    for k, (t, valid) in enumerate(places):
        local = beyond(t)
        size = ca.norm_2(local)
        direction, place = local / ca.fmax(size, TINY), start + t * along
        distance = size - radius
        if k == 0:
            direction, place = ca.if_else(within, out, direction), ca.if_else(within, deepest, place)
            distance = ca.if_else(within, -depth - radius, distance)
        else:
            distance = ca.if_else(all_true(valid, size > TINY, ca.logic_not(ball)), distance, FAR)
        normal, here = turn @ direction, centre + turn @ place
        contacts.append(ca.vertcat(distance, normal, ca.cross(here, normal), 0))
    return ca.if_else(within, -depth, least) - radius, ca.horzcat(*contacts)


def _way_out(start: ca.SX, stop: ca.SX, half: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Direction (3,) and length [m] of a segment's shortest way out of a box, in its axes; and the place that is last.

    The length is over the axes of the box and across them and the segment, the direction of a face.
    """
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
