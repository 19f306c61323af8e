"""QP rows that keep the chair's outline out of an obstacle, now and on the way to the stop posture."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, partial

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.linear_limit import LinearLimit
from rehab_opt.control.obstacles import NUMBERS, ObstacleRows, approach, outward_normal
from rehab_opt.control.stopping import FAR, BrakingTogether
from rehab_opt.kinematics.mobile_arm import CHAIR, MobileArm, Outline
from rehab_opt.optim.certificate import all_true, clipped, first_true
from rehab_opt.symbolic.tick import Stages

__all__ = ["ROWS", "ChairObstacles"]

Array = NDArray[np.float64]

ROWS = 4
"""Number of rows of one obstacle."""
ALONG = (0.5, 1.0)
"""Fractions of the way to the stop posture at which obstacles are checked, in addition to the current posture."""
CLEAR = 5e-4
"""[m] Margin to obstacles, doubled at the stop posture, since a row is only a tangent."""
NEARER = 5
"""Steps of the search for the nearest point of a post's path past the chair; too few steps err on the safe side."""
TOUCHING = 1e-6
"""[m] Distances below this are too small to define a direction."""
TINY = 1e-12
TIGHTER = 1e-7
"""Relative tightening of limits; it covers the certificate's tolerance."""


class ChairObstacles:
    """QP rows on the chair's velocity (3,), in the chassis frame, for one obstacle from `obstacle_numbers`.

    `column` holds `ROWS` rows. The upper bound [m/s] of a row is the closing speed that it allows beyond that
    of the braking chair. A wall has two rows for each of the chair's two corners nearest to it: one at the current
    posture, one on the way to the stop posture. A post has one row for the point of the outline that is now nearest to
    it. Two more rows cover the path of the post relative to the braking chair: half-way, and at the stop posture.

    Parameters
    ----------
    robot : has the outline and the chair's largest speeds. braking : see `BrakingTogether`. dt : tick [s].
    """

    def __init__(self, robot: MobileArm, braking: BrakingTogether, dt: float) -> None:
        self.outline, self.braking, self.dt = robot.outline, braking, dt
        self._turn = float(robot.chain.velocity[2])
        self._lever = float(np.linalg.norm(robot.outline.corners, axis=1).max())

    @cached_property
    def rows(self) -> ca.Function:
        """Function: obstacle (4,), chair position (3,), last command (3,) -> `column`; `far` if it is distant."""
        tick, one, place, last = (
            Stages(),
            ca.SX.sym("one", NUMBERS),
            ca.SX.sym("place", CHAIR),
            ca.SX.sym("last", CHAIR),
        )
        found = tick.when(self.near(one, place, last), self.column(one, place, last), self.far())
        return tick.function("obstacle", [one, place, last], [found])

    def near(self, one: ca.SX, place: ca.SX, last: ca.SX) -> ca.SX:
        """1 if the obstacle can matter to the chair at `place` (3,) after a command `last` (3,)."""
        each, change = self._approach(one, place, last, self.braking.time), self.braking.change
        turn, drive = ca.fabs(last[2]) + change[2], self._drive(last)
        margin = 2 * CLEAR + 2 * self._swept(each, last) + self._bent * self.braking.time**2
        return ca.logic_and(
            one[3] != 0, ca.mmin(self._gaps(each)) <= margin + self.braking.time * (drive + self._lever * turn)
        )

    def column(self, one: ca.SX, place: ca.SX, last: ca.SX) -> ca.SX:
        """Column (17,): `ROWS` rows, each with its upper bound, and the gap [m] between chair and obstacle."""
        each = self._approach(one, place, last, self.braking.time)
        rows = [ca.vertcat(*pair) for pair in self._towards(each, last)]
        return ca.densify(ca.vertcat(*rows, ca.mmin(self._gaps(each))))

    def far(self) -> ca.SX:
        """Column (17,) of a distant obstacle."""
        row = ca.vertcat(ca.SX.zeros(CHAIR), FAR)
        return ca.densify(ca.vertcat(*[row] * ROWS, FAR))

    def limits(self, tick: Stages, obstacles: ca.SX, q: ca.SX, last: ca.SX) -> tuple[LinearLimit, ca.SX]:
        """Two results at q (n,) after the command `last` (n,): limits [m/s] on the speed towards the obstacles (4 k,),
        and the smallest gap [m].
        """
        columns = [tick.call(self.rows, one, q[:CHAIR], last[:CHAIR])[0] for one in _each(obstacles)]
        cells = [ca.reshape(each[:-1], CHAIR + 1, ROWS).T for each in columns]
        found = ca.vertcat(ca.SX(0, CHAIR + 1), *cells)
        towards = LinearLimit.of_joints(0, q.numel(), found[:, :CHAIR], found[:, CHAIR])
        nearest = ca.mmin(ca.vertcat(FAR, *(each[-1] for each in columns)))
        return towards.beyond(self.braking.slower(last)), nearest

    def fastest(self, u: ca.SX) -> ca.SX:
        """Upper bound [m/s] of the speed of any corner at velocities u (n,)."""
        return ca.fabs(u[0]) + ca.fabs(u[1]) + self._lever * ca.fabs(u[2])

    def keeps_out(self, obstacles: ca.SX, place: ca.SX, u: ca.SX) -> ca.SX:
        """1 if `no_deeper` holds for all obstacles (4 k,), at the chair position `place` (3,) and velocity u (n,)."""
        return all_true(*(self.no_deeper(one, place, u[:CHAIR]) for one in _each(obstacles)))

    @cached_property
    def no_deeper(self) -> ca.Function:
        """Function: obstacle (4,), chair position (3,), velocity (3,) -> verdict for one tick.

        The verdict is 1 if the chair moves no deeper into the obstacle, neither on a straight line nor on an arc.
        """
        one, place, u = ca.SX.sym("one", NUMBERS), ca.SX.sym("place", CHAIR), ca.SX.sym("u", CHAIR)
        cos, sin, verdict = ca.cos(place[2]), ca.sin(place[2]), []

        def gap(there: ca.SX) -> ca.SX:
            return ca.mmin(self._gaps(approach(one, there, self.outline, dt=1, horizon=1, turn=1, drive=0)))

        first = self.dt / 1024  # the gap is convex in time on a line: its tangent is a lower bound
        for seconds in (first, self.dt / 2, self.dt):
            for x, y in (ca.vertsplit(each) for each in (u[:2], mean_velocity(np.zeros(2), u, seconds))):
                there = place + seconds * ca.vertcat(cos * x - sin * y, sin * x + cos * y, u[2])
                far, here = self.dt / seconds if seconds == first else 1.0, gap(place)
                verdict.append(here + far * (gap(there) - here) >= ca.fmin(here, 0))
        return ca.Function("no_deeper", [one, place, u], [ca.logic_or(one[3] == 0, all_true(*verdict))], {"cse": True})

    # -------------------------------------------------------------------------------------------------- plumbing
    @property
    def _bent(self) -> float:
        """[m/s^2] Error of a corner's tangents in a tick, divided by the square of the braking time."""
        return self._lever * min(float(self.braking.change[2]), self._turn) ** 2 / 2

    def _approach(self, one: ca.SX, place: ca.SX, last: ca.SX, horizon: float) -> ObstacleRows:
        turn = self._turning(last)  # chords to impossible turn rates would stop a chair that turns slowly
        drive = self._drive(last)
        return approach(one, place, self.outline, dt=self.dt, horizon=horizon, turn=turn, drive=drive)

    def _turning(self, last: ca.SX) -> ca.SX:
        """Largest turn rate [rad/s] in a tick after a command `last` (3,)."""
        return ca.fmin(ca.fabs(last[2]) + self.braking.change[2], self._turn)

    def _drive(self, last: ca.SX) -> ca.SX:
        """Upper bound of the speed [m/s] in a tick after a command `last` (3,)."""
        return ca.fabs(last[0]) + ca.fabs(last[1]) + 2 * self.braking.change[0]

    def _gaps(self, each: ObstacleRows) -> ca.SX:
        return each.wall[2] - ca.DM(self.outline.corners) @ each.wall[:2]

    def _swept(self, each: ObstacleRows, last: ca.SX) -> ca.SX:
        """Largest deviation [m] of the outline from straight motion in a tick after a command `last` (3,)."""
        turn, drive = self._turning(last), self._drive(last)
        lever = ca.if_else(each.is_post, ca.norm_2(each.post[:2]), self._lever)
        return turn * (lever * turn + 2 * drive) * self.dt**2 / 2

    def _apart(self, each: ObstacleRows, last: ca.SX) -> ca.SX:
        return ca.mmin(self._gaps(each)) > 2 * self._swept(each, last)

    def _towards(self, each: ObstacleRows, last: ca.SX) -> list[tuple[ca.SX, ca.SX]]:
        slower, margin = self.braking.slower(last), CLEAR + 2 * self._swept(each, last)
        corners = [self._approached(partial(_corner, each.wall, one), slower, margin) for one in self.outline.corners]
        keys, rows, apart = ca.vertcat(*(key for _, key in corners)), [], self._apart(each, last)
        for k, post in enumerate(self._past(each, slower, margin)):
            nearest = first_true(keys <= ca.mmin(keys))
            keys = ca.if_else(nearest, ca.inf, keys)
            found = ca.if_else(each.is_post, post, ca.horzcat(*(rows for rows, _ in corners)) @ nearest)
            # At contact use the rows of `approach`: corner rows allow a faster turn, which `kept` would then stop.
            touching = ca.vertcat(each.matrix[k, :].T, each.room[k] - each.matrix[k, :] @ slower)
            rows += [(row[:3], row[3]) for row in (ca.if_else(apart, found[:4], touching), found[4:])]
        return rows

    def _past(self, each: ObstacleRows, slower: ca.SX, margin: ca.SX) -> list[ca.SX]:
        """Rows for a post as columns (8,): now and half-way to rest; an empty row and the row at the stop posture."""
        centre, radius = each.post[:2], each.post[2]
        far, towards = _post(each.post, self.outline)
        now = ca.vertcat(towards, ca.fmax(far - margin, 0) / self.braking.time - ca.dot(towards, slower))
        normal, columns = self._beside(each, slower), []
        for part, first in zip(ALONG, (now, ca.SX([0, 0, 0, FAR])), strict=True):
            time, u = part * self.braking.time, ca.SX.sym("u", CHAIR)
            away = ca.dot(normal, _seen(centre, u, time))
            there, closing = ca.substitute([away, -ca.jacobian(away, u).T / time], [u], [slower])
            gap = there - ca.mmax(ca.DM(self.outline.corners) @ normal) - radius
            columns.append(ca.vertcat(first, closing, (gap - margin - part * CLEAR) / time - self._bent * time))
        return columns

    def _beside(self, each: ObstacleRows, slower: ca.SX) -> ca.SX:
        """Normal (2,) of the line that best separates the outline from a post's path (search of Gilbert et al.)."""
        centre, radius = each.post[:2], each.post[2]
        way = [_seen(centre, slower, part * self.braking.time) for part in (0.0, *ALONG)]
        points = ca.horzcat(*(ca.DM(corner) - place for place in way for corner in self.outline.corners))

        def nearest_of(begin: ca.SX, end: ca.SX) -> ca.SX:
            along = end - begin
            return begin - clipped(ca.dot(begin, along) / ca.fmax(ca.sumsqr(along), TINY), -1, 0) * along

        now = each.wall[:2]
        nearest = begin = end = -now * (_post(each.post, self.outline)[0] + radius)
        for _ in range(NEARER):
            ahead = -(nearest.T @ points).T
            corner = points @ first_true(ahead >= ca.mmax(ahead))
            before, after = nearest_of(begin, corner), nearest_of(corner, end)
            first = ca.sumsqr(before) <= ca.sumsqr(after)
            nearest = ca.if_else(first, before, after)
            begin, end = ca.if_else(first, begin, corner), ca.if_else(first, corner, end)
        distance = ca.norm_2(nearest)
        towards = -nearest / ca.fmax(distance, TOUCHING)
        better = ca.logic_and(distance > TOUCHING, ca.mmax(towards.T @ points) < ca.mmax(now.T @ points))
        return ca.if_else(better, towards, now)

    def _approached(
        self, gap_after: Callable[[ca.SX, float], tuple[ca.SX, ca.SX]], slower: ca.SX, margin: ca.SX
    ) -> tuple[ca.SX, ca.SX]:
        """Two results: a column (8,) of two rows with bounds [m/s], now and on the way to rest; the least gap [m]."""
        time = self.braking.time
        least, now = gap_after(slower, 0.0)
        first = ca.vertcat(now, ca.fmax(least - margin, 0) / time - ca.dot(now, slower))
        then, left = ca.SX.zeros(CHAIR), ca.SX(ca.inf)
        for part in ALONG:
            gap, closing = gap_after(slower, part * time)
            here = (gap - margin - part * CLEAR - self._bent * (part * time) ** 2) / (part * time)
            then, left = ca.if_else(here < left, closing, then), ca.fmin(here, left)
            least = ca.fmin(least, gap)
        return ca.vertcat(first, then, left), least


def _each(obstacles: ca.SX) -> list[ca.SX]:
    return ca.vertsplit(obstacles, NUMBERS) if obstacles.numel() else []


def _corner(wall: ca.SX, corner: Array, velocity: ca.SX, time: float) -> tuple[ca.SX, ca.SX]:
    """Two results after `time` [s] on an arc: gap [m] of a corner to a wall; derivative (3,) of the closing speed."""
    u = ca.SX.sym("u", CHAIR)
    mean = ca.dot(wall[:2], mean_velocity(corner, u, time))
    speed, closing = ca.substitute([mean, ca.jacobian(mean, u).T], [u], [velocity])
    return wall[2] - ca.dot(wall[:2], ca.DM(corner)) - time * speed, closing


def mean_velocity(corner: Array, velocity: ca.SX, time: float) -> ca.SX:
    """Mean velocity (2,) of a corner (2,) of the chair that moves on an arc at `velocity` (3,) for `time` [s]."""
    x, y, half = float(corner[0]), float(corner[1]), velocity[2] * time / 2
    shrunk, cos, sin = 1 - half * half / 6, ca.cos(half), ca.sin(half)  # chord over arc, and the chord's direction
    drive = shrunk * ca.vertcat(cos * velocity[0] - sin * velocity[1], sin * velocity[0] + cos * velocity[1])
    return drive + velocity[2] * shrunk * ca.vertcat(-sin * x - cos * y, cos * x - sin * y)


def _seen(place: ca.SX, velocity: ca.SX, time: float) -> ca.SX:
    """Position (2,), in the chassis frame, of a fixed point (2,) after the chair moved on an arc for `time` [s]."""
    way = place - time * mean_velocity(np.zeros(2), velocity, time)
    x, y = way[0], way[1]
    cos, sin = ca.cos(velocity[2] * time), ca.sin(velocity[2] * time)
    return ca.vertcat(cos * x + sin * y, cos * y - sin * x)


def _post(post: ca.SX, outline: Outline) -> tuple[ca.SX, ca.SX]:
    """Two results: gap [m] between outline and post, negative inside; derivative (3,) of the closing speed."""
    x, y = post[0], post[1]
    normal = ca.vertcat(*outward_normal(outline, x, y))
    gap = ca.dot(normal, post[:2]) - ca.mmax(ca.DM(outline.corners) @ normal) - post[2]
    return gap, ca.vertcat(normal, normal[1] * x - normal[0] * y)
