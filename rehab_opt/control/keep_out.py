"""Where the arm must not be: capsules of chair and user, as rows on the arm's joint velocities."""

from __future__ import annotations

import casadi as ca

from rehab_opt.kinematics.arm_links import LinkEnd
from rehab_opt.kinematics.mobile_arm import CHAIR, Capsule, MobileArm
from rehab_opt.optim.certificate import clipped

__all__ = ["arm_gaps", "closing_rows"]

TINY = 1e-9
"""[m] A distance that gives no direction."""


def arm_gaps(robot: MobileArm, arm: ca.SX) -> ca.SX:
    """(k l,) distances [m] of the arm's l links from the k keep-outs at arm joints; negative inside."""
    return ca.vertcat(*(distance for distance, _ in _pairs(robot, arm)))


def closing_rows(robot: MobileArm, arm: ca.SX) -> tuple[ca.SX, ca.SX]:
    """(k l, joints) change of each distance with the arm's joints [m/rad], and the distances (k l,) [m].

    The points nearest to each other move with their links; that they change does not matter to first order.
    """
    pairs = _pairs(robot, arm)
    return ca.vertcat(*(row for _, row in pairs)), ca.vertcat(*(distance for distance, _ in pairs))


def _pairs(robot: MobileArm, arm: ca.SX) -> list[tuple[ca.SX, ca.SX]]:
    chain = robot.chain
    frames = chain.frames_expression(ca.vertcat(ca.SX.zeros(CHAIR), arm))
    count = chain.n - CHAIR

    def ends(of: LinkEnd) -> tuple[ca.SX, ca.SX]:
        """(3,) [m] where it is, and (3, k) how the arm's joints move it."""
        point = of.place(frames)
        if not of.moves:
            return point, ca.SX(3, count)
        joints = min(of.frame, chain.n) - CHAIR
        columns = [ca.cross(frames[i][:3, 2], point - frames[i][:3, 3]) for i in range(CHAIR, CHAIR + joints)]
        return point, ca.horzcat(*columns, *[ca.SX.zeros(3)] * (count - joints))

    links = [(ends(link.begin), ends(link.end), link.radius) for link in robot.links]
    pairs = []
    for capsule in robot.keep_out:
        for (begin, begin_moves), (end, end_moves), radius in links:
            share, apart = _nearest(begin, end, capsule)
            size = ca.norm_2(apart)
            moves = begin_moves + share * (end_moves - begin_moves)
            pairs.append((size - capsule.radius - radius, (apart / ca.fmax(size, TINY)).T @ moves))
    return pairs


def _nearest(begin: ca.SX, end: ca.SX, capsule: Capsule) -> tuple[ca.SX, ca.SX]:
    """Where on the segment from `begin` to `end` it is nearest to the capsule's, 0 to 1; and the way there (3,)."""
    start, other = ca.DM(capsule.start), ca.DM(capsule.end) - ca.DM(capsule.start)
    along, gap = end - begin, begin - start
    a, e = ca.fmax(ca.sumsqr(along), TINY**2), float(ca.sumsqr(other))  # of a link that is a ball any share will do
    c, f = ca.dot(along, gap), ca.dot(other, gap)
    if e < TINY**2:  # the capsule is a ball
        share = clipped(-c / a, 0, 1)
        return share, gap + share * along
    b = ca.dot(along, other)
    across = a * e - b * b  # zero where they are parallel: then any point will do to begin with
    first = ca.if_else(across > TINY, clipped((b * f - c * e) / ca.fmax(across, TINY), 0, 1), 0)
    place = clipped((b * first + f) / e, 0, 1)
    share = clipped((b * place - c) / a, 0, 1)
    return share, gap + share * along - place * other
