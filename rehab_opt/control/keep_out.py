"""Where the arm must not be: capsules of chair and user, as rows on the arm's joint velocities."""

from __future__ import annotations

import casadi as ca

from rehab_opt.kinematics.mobile_arm import CHAIR, Capsule, MobileArm
from rehab_opt.optim.certificate import clipped

__all__ = ["arm_gaps", "closing_rows"]

TINY = 1e-9
"""[m] A distance that gives no direction."""


def arm_gaps(robot: MobileArm, arm: ca.SX) -> ca.SX:
    """(2 k,) distances [m] of upper arm and forearm from the k keep-outs at arm joints (4,); negative inside."""
    return ca.vertcat(*(distance for distance, _ in _pairs(robot, arm)))


def closing_rows(robot: MobileArm, arm: ca.SX) -> tuple[ca.SX, ca.SX]:
    """(2 k, 4) change of each distance with the arm's joints [m/rad], and the distances (2 k,) [m].

    The points nearest to each other move with their links; that they change does not matter to first order.
    """
    pairs = _pairs(robot, arm)
    return ca.vertcat(*(row for _, row in pairs)), ca.vertcat(*(distance for distance, _ in pairs))


def _pairs(robot: MobileArm, arm: ca.SX) -> list[tuple[ca.SX, ca.SX]]:
    chain = robot.chain
    frames = chain.frames_expression(ca.vertcat(ca.SX.zeros(CHAIR), arm))
    shoulder, elbow, hand = (frames[i][:3, 3] for i in (4, 5, -1))

    def moved_by_arm(point: ca.SX, joints: int) -> ca.SX:
        columns = [ca.cross(frames[i][:3, 2], point - frames[i][:3, 3]) for i in range(CHAIR, CHAIR + joints)]
        return ca.horzcat(*columns, *[ca.SX.zeros(3)] * (chain.n - CHAIR - joints))

    ends = (shoulder, ca.SX(3, chain.n - CHAIR)), (elbow, moved_by_arm(elbow, 2)), (hand, moved_by_arm(hand, 4))
    links = (ends[0], ends[1]), (ends[1], ends[2])
    pairs = []
    for capsule in robot.keep_out:
        for (begin, begin_moves), (end, end_moves) in links:
            share, apart = _nearest(begin, end, capsule)
            size = ca.norm_2(apart)
            moves = begin_moves + share * (end_moves - begin_moves)
            pairs.append((size - capsule.radius - robot.arm_radius, (apart / ca.fmax(size, TINY)).T @ moves))
    return pairs


def _nearest(begin: ca.SX, end: ca.SX, capsule: Capsule) -> tuple[ca.SX, ca.SX]:
    """Where on the segment from `begin` to `end` it is nearest to the capsule's, 0 to 1; and the way there (3,)."""
    start, other = ca.DM(capsule.start), ca.DM(capsule.end) - ca.DM(capsule.start)
    along, gap = end - begin, begin - start
    a, e = ca.sumsqr(along), float(ca.sumsqr(other))
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
