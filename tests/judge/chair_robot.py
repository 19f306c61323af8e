"""The chair with its arm, written down once more: lengths, limits, kinematics, wheels, keep-outs and obstacles.

Chassis frame: x forward, y left, z up, floor at 0. u (7,) are forward, left [m/s], turn [rad/s] in that frame, and the
speeds of the arm's four joints; q (7,) are place and heading in the world, and the arm's angles. Arrays
have ticks first.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from rehab_opt import ardis
from rehab_opt.control.obstacles import Disc, HalfPlane

Array = NDArray[np.float64]
ROWS = ("x", "y", "z", "rx", "ry", "rz", "roll7")
KEEP_OUT = (
    ((-0.15, 0.0, 0.55), (-0.15, 0.0, 1.25), 0.18),
    ((-0.10, 0.0, 0.55), (0.40, 0.0, 0.50), 0.18),
    ((-0.25, 0.0, 0.25), (0.30, 0.0, 0.25), 0.24),
)
"""Trunk and head, legs, chair: both ends and radius of each capsule [m]."""
ARM_RADIUS = 0.05
RADII = np.repeat([radius + ARM_RADIUS for *_, radius in KEEP_OUT], 2)
"""[m] of a link and a keep-out together, in the order of `Chair.arm_gaps`."""
REAR, FRONT, SIDE = -0.45, 0.55, 0.33
"""[m] Outline of the chair."""
CORNERS = np.array([(x, y) for x in (FRONT, REAR) for y in (SIDE, -SIDE)])
MECANUM = np.array([[1, 1, 0.53], [1, -1, -0.53], [1, 1, -0.53], [1, -1, 0.53]]) / 0.10
"""(4, 3) wheels in front right, front left, rear left, rear right, of half gauge 0.28 m and half base 0.25 m."""
DIFFERENTIAL = np.array([[1, 0, 0.28], [1, 0, -0.28]]) / 0.15
WHEELS = {"mecanum": MECANUM, "differential": DIFFERENTIAL, "omnidirectional": np.eye(3), "fixed": np.zeros((0, 3))}
"""Wheel speeds by the chassis' speeds forward, to the left and turning, of each drive."""
WHEEL_LIMIT = {"mecanum": 10.0, "differential": 7.0, "omnidirectional": math.inf, "fixed": math.inf}
"""[rad/s]"""
LACKING = {"mecanum": [], "differential": [1], "omnidirectional": [], "fixed": [0, 1, 2]}
"""Of those speeds, the ones that a drive does not have."""
STAND_OFF = 0.002
"""[m] So near a keep-out or an obstacle a robot may stop; of a keep-out with long ticks see `Chair.stand_off`."""
BARELY = 2e-4
"""[m] What a distance may lose on a way along an obstacle."""
TURNED = 0.15
"""Fraction of the commanded speed that a hand may move against the command, or across it, while it brakes."""
PARTS = (1.0, 0.5, 0.25, 0.12, 0.06, 0.03)
BOWED, EXACT = 5, 0.05
"""Programmes that lead the hand along the command in the mean of a tick, and how exactly, as a part of its speed."""
Obstacles = Sequence[Disc | HalfPlane]


@dataclass(frozen=True)
class Chair:
    """Numbers of one robot, and what follows from them."""

    drive: str = "differential"
    a3: float = 0.10
    d4: float = 0.38
    d5: float = 0.45
    d7: float = 0.50
    lower: Array = field(default_factory=lambda: np.deg2rad([-165.0, -100.0, -75.0, -170.0]))
    upper: Array = field(default_factory=lambda: np.deg2rad([20.0, 100.0, 85.0, 170.0]))
    velocity: Array = field(default_factory=lambda: np.array([0.8, 0.8, 1.0, 1.0, 1.0, 1.2, 1.5]))
    acceleration: Array = field(default_factory=lambda: np.array([1.0, 1.0, 1.5, 4.0, 4.0, 4.0, 6.0]))
    chair_mass: float = 120.0
    payload: float = 0.0
    keep_out: bool = True
    mount: float = 0.70

    def robot(self) -> Any:
        """What the public constructor makes of the same numbers."""
        free = np.full(3, math.inf)
        return ardis(
            a3=self.a3, d4=self.d4, d5=self.d5, d7=self.d7, mount_height=self.mount, chair_mass=self.chair_mass,
            payload=self.payload, lower=[*-free, *self.lower], upper=[*free, *self.upper], velocity=self.velocity,
            acceleration=self.acceleration,
        )  # fmt: skip

    @property
    def braking_time(self) -> float:
        """[s] T = max v/a of what moves."""
        return float(np.max((self.velocity / self.acceleration)[self.moving]))

    @property
    def radii(self) -> Array:
        """[m] of link and keep-out together, in the order of `arm_gaps`."""
        return RADII if self.keep_out else RADII[:1]

    def stand_off(self, dt: float) -> float:
        """[m] So near a keep-out an arm may stop: 1 mm + reach (1.1 T a dt)^2 / 2, a of the joints that move links."""
        step = 1.1 * self.braking_time * float(np.max(self.acceleration[3:6])) * dt
        return max(STAND_OFF, 1e-3 + (self.d5 + self.d7) * step**2 / 2)

    @property
    def moving(self) -> Array:
        """(m,) numbers of the joints that the drive allows to move."""
        return np.delete(np.arange(len(self.velocity)), LACKING[self.drive])

    # ------------------------------------------------------------------------------------------------ kinematics
    def arm(self, q: Array) -> tuple[Array, ...]:
        """Upper arm's direction, elbow's and wrist's cross axes, forearm's direction; each (..., 3), chassis frame."""
        c4, s4, c5, s5 = np.cos(q[..., 3]), np.sin(q[..., 3]), np.cos(q[..., 4]), np.sin(q[..., 4])
        c6, s6, zero = np.cos(q[..., 5]), np.sin(q[..., 5]), np.zeros_like(c4)
        up = np.stack([-s4, zero, c4], -1)
        ahead, left = np.stack([c4, zero, s4], -1), np.stack([zero, zero + 1, zero], -1)
        turned = c5[..., None] * ahead + s5[..., None] * left
        side = c5[..., None] * left - s5[..., None] * ahead
        fore = c6[..., None] * turned + s6[..., None] * up
        return up, turned, side, fore

    def joints(self, q: Array) -> tuple[Array, Array, Array]:
        """Shoulder, elbow and hand (..., 3) in the chassis frame [m]."""
        up, _, _, fore = self.arm(q)
        shoulder = np.broadcast_to([self.a3, -self.d4, self.mount], up.shape)
        elbow = shoulder + self.d5 * up
        return shoulder, elbow, elbow + self.d7 * fore

    def bodies(self, q: Array) -> list[tuple[Array, Array, float]]:
        """Both ends (..., 3) in the chassis frame and radius [m] of each link; first what bears the shoulder."""
        shoulder, elbow, hand = self.joints(q)
        foot = np.broadcast_to([self.a3, 0.0, self.mount], shoulder.shape)
        return [(foot, shoulder, ARM_RADIUS), (shoulder, elbow, ARM_RADIUS), (elbow, hand, ARM_RADIUS)]

    def hand(self, q: Array) -> Array:
        """(..., 3) place of the hand in the world [m]."""
        return placed(self.joints(q)[2], q)

    def orientation(self, q: Array) -> Array:
        """(..., 3, 3) of the hand in the world: the forearm's direction is its third column."""
        _, _, side, fore = self.arm(q)
        other = np.cross(fore, side)
        c, s = np.cos(q[..., 6])[..., None], np.sin(q[..., 6])[..., None]
        columns = (c * side + s * other, c * other - s * side, fore)
        return np.stack([turned(each, q[..., 2]) for each in columns], -1)

    def jacobian(self, q: Array) -> Array:
        """(..., 7, 7) rows `ROWS` in the chassis frame, by u."""
        up, _, side, fore = self.arm(q)
        shoulder, elbow, hand = self.joints(q)
        cross = np.broadcast_to([0.0, -1.0, 0.0], up.shape)
        return jacobian_of(hand, fore, [(cross, shoulder), (up, shoulder), (-side, elbow), (fore, elbow)])

    def chassis(self, q: Array, value: Array) -> Array:
        """(..., 7) u of joint velocities with the chair's in the world frame."""
        u = np.array(value)
        c, s = np.cos(q[..., 2]), np.sin(q[..., 2])
        u[..., 0], u[..., 1] = c * value[..., 0] + s * value[..., 1], c * value[..., 1] - s * value[..., 0]
        return u

    def world(self, q: Array, u: Array) -> Array:
        """(..., 7) the way back."""
        value = np.array(u)
        c, s = np.cos(q[..., 2]), np.sin(q[..., 2])
        value[..., 0], value[..., 1] = c * u[..., 0] - s * u[..., 1], s * u[..., 0] + c * u[..., 1]
        return value

    def hand_velocity(self, q: Array, ahead: Array, dt: float, rows: Sequence[str], frame: str) -> Array:
        """(T, k) by finite differences from q to `ahead` (T, 7); the chassis frame is that of the tick's begin."""
        linear = (self.hand(ahead) - self.hand(q)) / dt
        begin = self.orientation(q)
        change = self.orientation(ahead) @ np.swapaxes(begin, -1, -2)
        skew = (change - np.swapaxes(change, -1, -2)) / 2
        axis = np.stack([skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]], -1)
        sine = np.linalg.norm(axis, axis=-1, keepdims=True)
        angular = axis * np.where(sine > 1e-9, np.arcsin(np.minimum(sine, 1)) / np.maximum(sine, 1e-9), 1.0) / dt
        roll = np.sum(angular * begin[..., 2], -1)
        if frame == "chassis":
            linear, angular = turned(linear, -q[..., 2]), turned(angular, -q[..., 2])
        every = np.concatenate([linear, angular, roll[..., None]], -1)
        return np.asarray(every[..., [ROWS.index(row) for row in rows]])

    def task(self, q: Array, rows: Sequence[str], frame: str) -> Array:
        """(..., k, 7) Jacobian of these rows by u."""
        j = self.jacobian(q)
        if frame == "world":
            heading = q[..., 2, None]
            for part in (slice(0, 3), slice(3, 6)):
                j[..., part, :] = np.swapaxes(turned(np.swapaxes(j[..., part, :], -1, -2), heading), -1, -2)
        return np.asarray(j[..., [ROWS.index(row) for row in rows], :])

    # ----------------------------------------------------------------------------------------------------- bounds
    def wheels(self, u: Array) -> Array:
        """(..., w) wheel speeds [rad/s]."""
        return np.asarray(u[..., :3] @ WHEELS[self.drive].T)

    def arm_gaps(self, q: Array) -> Array:
        """(..., 6) distances of upper arm and forearm, with their radius, from each keep-out [m]; none without."""
        if not self.keep_out:
            return np.full((*q.shape[:-1], 1), math.inf)
        shoulder, elbow, hand = self.joints(q)
        begin, end = (np.stack(each * len(KEEP_OUT), -2) for each in ([shoulder, elbow], [elbow, hand]))
        start, stop, radius = (np.repeat(each, 2, axis=0) for each in zip(*KEEP_OUT, strict=True))
        return segments_apart(begin, end, start, stop) - radius - ARM_RADIUS

    def obstacle_gaps(self, q: Array, obstacles: Obstacles) -> Array:
        """(..., m) distances of the outline from each obstacle [m], negative inside; how deep for discs, too."""
        found = [np.full(q.shape[:-1], math.inf)]
        c, s = np.cos(q[..., 2]), np.sin(q[..., 2])
        for each in obstacles:
            if isinstance(each, HalfPlane):
                size = math.hypot(*each.normal)
                nx, ny = each.normal[0] / size, each.normal[1] / size
                furthest = [(c * x - s * y) * nx + (s * x + c * y) * ny for x, y in CORNERS]
                found.append(each.offset / size - q[..., 0] * nx - q[..., 1] * ny - np.max(furthest, axis=0))
            else:
                dx, dy = each.centre[0] - q[..., 0], each.centre[1] - q[..., 1]
                x, y = c * dx + s * dy, c * dy - s * dx
                apart = np.maximum(x - FRONT, REAR - x), np.abs(y) - SIDE
                outside = np.hypot(np.maximum(apart[0], 0), np.maximum(apart[1], 0))
                found.append(outside + np.minimum(np.maximum(*apart), 0) - each.radius)
        return np.stack(found, -1)

    def corner_gaps(self, q: Array, wall: HalfPlane) -> Array:
        """(..., 4) distances of the outline's corners from a wall [m]: of two that are nearly as near, both count."""
        size = math.hypot(*wall.normal)
        nx, ny = wall.normal[0] / size, wall.normal[1] / size
        c, s = np.cos(q[..., 2]), np.sin(q[..., 2])
        out = [q[..., 0] * nx + q[..., 1] * ny + (c * x - s * y) * nx + (s * x + c * y) * ny for x, y in CORNERS]
        return wall.offset / size - np.stack(out, -1)

    def brakes_in_time(self, q: Array, u: Array, obstacles: Obstacles, dt: float) -> bool:
        """Whether u, scaled to zero in T after two more ticks of it, keeps every bound, obstacles by `STAND_OFF`."""
        path = self.braked(q, u, dt)
        arm = path[:, 3:]
        return bool(
            np.all(arm >= self.lower)
            and np.all(arm <= self.upper)
            and np.all(self.arm_gaps(path) > 0)
            and np.all(self.obstacle_gaps(path, obstacles) > STAND_OFF)
        )

    def braked(self, q: Array, u: Array, dt: float) -> Array:
        """(82, 7) the way from q while u, after two more ticks of it, is scaled to zero in T."""
        steps = np.linspace(0.0, 1.0, 81)
        length = 2 * dt + self.braking_time * (steps - steps**2 / 2)
        fraction = np.diff(length, prepend=0.0)
        middle = np.zeros((len(fraction), len(q)))
        middle[:, 2] = np.cumsum([q[2], *(fraction * u[2])])[:-1] + u[2] * fraction / 2
        value = self.world(middle, np.tile(u, (len(fraction), 1)))
        return np.cumsum([q, *(fraction[:, None] * value)], axis=0)

    def fastest(
        self, q: Array, twist: Array, rows: Sequence[str], frame: str, obstacles: Obstacles = (), dt: float = 0.01
    ) -> float:
        """Largest speed of the hand exactly along `twist`, as a fraction of it, by a linear programme.

        Of the velocities that could be scaled to zero in T with every bound kept, to first order: so a distance of
        room allows 2 room/T; the last `STAND_OFF` or `stand_off` before a thing is no room. Nearest points that jump
        are met by further rows where the answer leads into them. Then the part of it, of `PARTS`, whose way keeps them,
        and that leads the hand along the command in the mean of a tick.
        """
        half = self.braking_time / 2
        task = self.task(q, rows, frame)
        speed = np.where(np.isin(np.arange(7), self.moving), self.velocity, 0.0)
        upper = np.append(speed, 1.0)
        lower = np.append(-speed, 0.0)
        upper[3:7] = np.clip((self.upper - q[3:]) / half, 0, upper[3:7])
        lower[3:7] = np.clip((self.lower - q[3:]) / half, lower[3:7], 0)
        limited = math.isfinite(WHEEL_LIMIT[self.drive])
        rolling = self.wheels(np.eye(7)).T if limited else np.zeros((0, 7))
        angles = np.arange(32) * math.pi / 16
        circle = np.zeros((32, 7))
        circle[:, 0], circle[:, 1] = np.cos(angles), np.sin(angles)
        rows_a = [rolling, -rolling, circle]
        limits = [np.full(2 * len(rolling), WHEEL_LIMIT[self.drive] if limited else 0.0), np.full(32, self.velocity[0])]

        def gaps(at: Array) -> Array:
            every = [self.corner_gaps(at, each) for each in obstacles if isinstance(each, HalfPlane)]
            return np.concatenate([self.arm_gaps(at), self.obstacle_gaps(at, obstacles), *every], -1)

        now = gaps(q)
        off = np.full(len(now), STAND_OFF)
        off[: self.arm_gaps(q).size] = self.stand_off(dt)

        def closing(at: Array) -> None:
            step = 1e-6 * np.eye(7)
            value = self.world(np.broadcast_to(at, (7, 7)), step)
            near = np.isfinite(now)
            slope = (gaps(at + value)[:, near] - gaps(at - value)[:, near]) / 2e-6
            rows_a.append(-half * slope.T)
            limits.append(np.maximum(now[near] - off[near], 0.0))

        closing(q)
        best = 0.0
        for _ in range(8):
            a_ub = np.column_stack([np.vstack(rows_a), np.zeros(sum(map(len, rows_a)))])
            found = linprog(
                np.append(np.zeros(7), -1.0), a_ub, np.concatenate(limits),
                np.column_stack([task, -np.asarray(twist)]), np.zeros(len(task)),
                np.column_stack([lower, upper]), method="highs",
            )  # fmt: skip
            if found.status != 0:
                return math.nan
            best = -float(found.fun)
            ahead = q + 1e-3 * self.world(q, found.x[:7])
            known, room = np.isfinite(now), np.maximum(now - off, 0.0) * 1e-3 / half
            if best < 0.05 or np.all(gaps(ahead)[known] >= now[known] - room[known] - 1e-5 * best):
                break
            closing(ahead)
        # To first order a turning corner and a swinging link lose no room: on the way on which they brake they do.
        # And the hand, that the law would let go against its command or across it no further, may have to turn back.
        # Of the velocities that do a part of it, that whose fastest joint is slowest: corners of programmes are wild.
        fraction = np.vstack([np.eye(7), -np.eye(7)])
        each = np.vstack([np.column_stack([fraction, -np.tile(speed, 2)]), np.column_stack([np.vstack(rows_a), np.zeros(
            sum(map(len, rows_a)))])])  # fmt: skip
        # And a tick is no moment: turning, the hand leaves the direction that it has at its begin.
        for part in PARTS:
            wanted, bow = part * best * np.asarray(twist), np.zeros(len(task))
            for _ in range(BOWED):
                calm = linprog(
                    np.append(np.zeros(7), 1.0), each, np.concatenate([np.zeros(14), *limits]),
                    np.column_stack([task, np.zeros(len(task))]), wanted - bow,
                    np.column_stack([np.append(lower[:7], 0.0), np.append(upper[:7], np.inf)]), method="highs",
                )  # fmt: skip
                if calm.status != 0:
                    break
                u = calm.x[:7]
                exact = self.hand_velocity(q[None], (q + dt * self.world(q, u))[None], dt, rows, frame)[0]
                bow = exact - task @ u
            if calm.status != 0 or not np.linalg.norm(exact - wanted) <= EXACT * np.linalg.norm(wanted):
                continue
            way = self.braked(q, u, 0.0)
            there = gaps(way)[:, np.isfinite(now)]
            left = np.linspace(1.0, 0.0, len(way))[:, None] * u
            hand = np.einsum("nij,nj->ni", self.task(way, rows, frame), left) / np.linalg.norm(twist)
            along = hand @ np.asarray(twist) / np.linalg.norm(twist)
            across = np.sqrt(np.maximum(np.sum(hand**2, axis=1) - along**2, 0.0))
            kept = np.all(along >= -TURNED) and np.all(across <= TURNED)
            if kept and np.all(there >= np.minimum(now, off)[np.isfinite(now)] - BARELY):
                return part * best
        return 0.0


def jacobian_of(hand: Array, roll: Array, joints: Sequence[tuple[Array, Array]]) -> Array:
    """(..., 7, 3 + n) rows `ROWS` by u: of a hand and its z axis (..., 3), axis and origin of each joint of the arm."""
    j = np.zeros((*hand.shape[:-1], 7, 3 + len(joints)))
    j[..., 0, 0] = j[..., 1, 1] = j[..., 5, 2] = 1.0
    j[..., 0, 2], j[..., 1, 2] = -hand[..., 1], hand[..., 0]
    for i, (axis, origin) in enumerate(joints, 3):
        j[..., :3, i], j[..., 3:6, i] = np.cross(axis, hand - origin), axis
    j[..., 6, :] = np.einsum("...i,...ij->...j", roll, j[..., 3:6, :])
    return j


def placed(p: Array, q: Array) -> Array:
    """(..., 3) in the world, of a place in the chassis frame at q (..., n)."""
    there = turned(p, q[..., 2])
    there[..., :2] += q[..., :2]
    return there


def turned(p: Array, angle: Array) -> Array:
    """(..., 3) vectors turned about z."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * p[..., 0] - s * p[..., 1], s * p[..., 0] + c * p[..., 1], p[..., 2]], -1)


def segments_apart(begin: Array, end: Array, start: Array, stop: Array) -> Array:
    """(...,) distance of two segments: from an end of one to the other, or between the lines where both are met."""

    def from_point(point: Array, origin: Array, along: Array) -> Array:
        fraction = np.clip(np.sum((point - origin) * along, -1) / np.maximum(np.sum(along * along, -1), 1e-30), 0, 1)
        return np.linalg.norm(point - origin - fraction[..., None] * along, axis=-1)

    one, two, gap = end - begin, stop - start, start - begin
    ends = [from_point(begin, start, two), from_point(end, start, two)]
    ends += [from_point(start, begin, one), from_point(stop, begin, one)]
    normal = np.cross(one, two)
    size = np.sum(normal * normal, -1)
    safe = np.maximum(size, 1e-12)
    first = np.sum(np.cross(gap, two) * normal, -1) / safe
    second = np.sum(np.cross(gap, one) * normal, -1) / safe
    met = (size > 1e-12) & (first >= 0) & (first <= 1) & (second >= 0) & (second <= 1)
    between = np.where(met, np.abs(np.sum(gap * normal, -1)) / np.sqrt(safe), math.inf)
    return np.asarray(np.minimum(np.min(ends, axis=0), between))
