"""Distances of the chair and the arm from obstacles and keep-outs, computed independently of the controller."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rehab_opt.control.obstacles import HalfPlane, Obstacle
from rehab_opt.kinematics.arm_links import LinkEnd, arm_links
from rehab_opt.kinematics.mobile_arm import CHAIR, Capsule, MobileArm, Outline
from rehab_opt.session.outcome import Array


def chair_corners(outline: Outline, q: Array) -> Array:
    """(N, 4, 2) [m] floor positions of the chair's corners, in order around it, at joint positions q (N, 7)."""
    corners = outline.corners[[0, 1, 3, 2]]
    cos, sin = np.cos(q[:, 2]), np.sin(q[:, 2])
    x = q[:, :1] + cos[:, None] * corners[:, 0] - sin[:, None] * corners[:, 1]
    y = q[:, 1:2] + sin[:, None] * corners[:, 0] + cos[:, None] * corners[:, 1]
    return np.stack([x, y], axis=2)


def chair_gaps(outline: Outline, room: Sequence[Obstacle], q: Array) -> Array:
    """(N, k) [m] distances between the chair's outline and the k obstacles, negative if they overlap."""
    corners, gaps = chair_corners(outline, q), []
    for obstacle in room:
        if isinstance(obstacle, HalfPlane):
            size = float(np.hypot(*obstacle.normal))
            gaps.append((obstacle.offset - (corners @ np.asarray(obstacle.normal)).max(axis=1)) / size)
            continue
        cos, sin = np.cos(q[:, 2]), np.sin(q[:, 2])
        dx, dy = obstacle.centre[0] - q[:, 0], obstacle.centre[1] - q[:, 1]
        x, y = cos * dx + sin * dy, cos * dy - sin * dx
        beyond_x = np.maximum(outline.rear - x, x - outline.front)
        beyond_y = np.maximum(outline.right - y, y - outline.left)
        outside = np.hypot(np.maximum(beyond_x, 0), np.maximum(beyond_y, 0))
        gaps.append(outside + np.minimum(np.maximum(beyond_x, beyond_y), 0) - obstacle.radius)
    return np.stack(gaps, axis=1) if gaps else np.empty((len(q), 0))


def point_gaps(room: Sequence[Obstacle], points: Array) -> Array:
    """(N, k) [m] distances between floor points (N, 2) and the k obstacles."""
    gaps = []
    for obstacle in room:
        if isinstance(obstacle, HalfPlane):
            normal = np.asarray(obstacle.normal)
            gaps.append((obstacle.offset - points @ normal) / float(np.hypot(*normal)))
        else:
            gaps.append(np.linalg.norm(points - obstacle.centre, axis=1) - obstacle.radius)
    return np.stack(gaps, axis=1) if gaps else np.empty((len(points), 0))


def arm_points(robot: MobileArm, q: Array) -> Array:
    """(N, m, 3) [m] points of the arm in the world frame at joint positions q (N, n), from shoulder to hand.

    They are the origins of the arm's moving joints; for ARDIS, these are shoulder, elbow and hand.
    """
    first, *others = arm_links(replace(robot.chain, capsules=()), first=CHAIR, radius=0.0)
    return np.stack(_places(robot, q, [first.begin, first.end, *(link.end for link in others)]), axis=1)


def arm_gaps(robot: MobileArm, q: Array) -> Array:
    """Distances (N, k l) [m] between each of the arm's l links and each of the k keep-outs; negative inside one."""
    still = q.copy()
    still[:, :CHAIR] = 0.0  # in the chassis frame, in which the keep-outs are defined
    places = _places(robot, still, [end for link in robot.links for end in (link.begin, link.end)])
    gaps = [
        _between_segments(begin, end, capsule) - capsule.radius - link.radius
        for capsule in robot.keep_out
        for begin, end, link in zip(places[::2], places[1::2], robot.links, strict=True)
    ]
    return np.stack(gaps, axis=1) if gaps else np.empty((len(q), 0))


def _places(robot: MobileArm, q: Array, ends: Sequence[LinkEnd]) -> list[Array]:
    """Positions (N, 3) [m] at joint positions q (N, n): one array for each link end."""
    chain = robot.chain
    frames = [np.broadcast_to(chain.base, (len(q), 4, 4))]
    for row, value in zip(chain.rows, q.T, strict=True):
        joint = np.tile(np.eye(4), (len(q), 1, 1))
        if row.prismatic:
            joint[:, 2, 3] = value
        else:
            cos, sin = np.cos(value), np.sin(value)
            joint[:, 0, 0], joint[:, 0, 1], joint[:, 1, 0], joint[:, 1, 1] = cos, -sin, sin, cos
        frames.append(frames[-1] @ joint @ np.array(row.after, dtype=np.float64))
    frames.append(frames[-1] @ chain.tool)
    return [frames[end.frame][:, :3, 3] + frames[end.frame][:, :3, :3] @ np.array(end.offset) for end in ends]


def _between_segments(begin: Array, end: Array, capsule: Capsule) -> Array:
    """Distances (N,) [m] between N segments and a capsule's axis."""
    start, stop = (np.broadcast_to(np.asarray(each), begin.shape) for each in (capsule.start, capsule.end))
    least = np.minimum.reduce(
        [
            _from_segment(begin, start, stop),
            _from_segment(end, start, stop),
            _from_segment(start, begin, end),
            _from_segment(stop, begin, end),
        ]
    )
    one, two, apart = end - begin, stop - start, begin - start
    a, b, c = (np.sum(u * v, axis=1) for u, v in ((one, one), (one, two), (two, two)))
    d, e = np.sum(one * apart, axis=1), np.sum(two * apart, axis=1)
    across = a * c - b * b
    safe = np.where(across > 1e-12, across, 1.0)
    s, t = (b * e - c * d) / safe, (a * e - b * d) / safe
    inside = (across > 1e-12) & (s >= 0) & (s <= 1) & (t >= 0) & (t <= 1)
    there = np.linalg.norm(apart + s[:, None] * one - t[:, None] * two, axis=1)
    return np.asarray(np.where(inside, np.minimum(there, least), least))


def _from_segment(point: Array, start: Array, stop: Array) -> Array:
    way = stop - start
    fraction = np.clip(np.sum((point - start) * way, axis=1) / np.maximum(np.sum(way * way, axis=1), 1e-12), 0, 1)
    return np.asarray(np.linalg.norm(point - start - fraction[:, None] * way, axis=1))
