"""Limits that keep the arm out of the capsules of chair and user, now and on the way to the stop posture."""

from __future__ import annotations

from functools import cached_property

import casadi as ca
import numpy as np

from rehab_opt.control.linear_limit import LinearLimit
from rehab_opt.control.stopping import FAR, BrakingTogether
from rehab_opt.kinematics.arm_links import LinkEnd
from rehab_opt.kinematics.mobile_arm import CHAIR, Capsule, MobileArm
from rehab_opt.optim.certificate import all_true, clipped
from rehab_opt.symbolic.tick import Stages

__all__ = ["ALONG", "ArmKeepOuts"]

ALONG = (0.25, 0.5, 0.75, 1.0)
"""Fractions of the way to the stop posture at which keep-outs are checked, in addition to the current posture."""
MARGIN = 12e-3
"""[m] Extra distance from a keep-out at the stop posture, since links turn and rows are tangents."""
FAST = 0.4
"""[m] Hand motion to the stop posture at which the full margin applies; the margin grows with its square."""
CLEAR = 5e-4
"""[m] Margin of the arm to keep-outs, doubled at the stop posture."""
TINY = 1e-12
TOUCHING = 1e-9
"""[m] Distances below this are too small to define a direction."""


class ArmKeepOuts:
    """Keep the distance h of every link from every keep-out at zero or more; a negative h must not decrease.

    At the posture q, h falls by at most h / T per second, with the braking time T. Within the margin an arm can slide
    along a keep-out. At that fraction of the way to rest (`ALONG`) where h is least, h stays above a margin that grows
    along the way. `no_deeper` checks h at the exact posture at the end of the tick.

    Parameters
    ----------
    robot : has the links and keep-outs. braking : see `BrakingTogether`. dt : tick [s].
    """

    def __init__(self, robot: MobileArm, braking: BrakingTogether, dt: float) -> None:
        self.robot, self.braking, self.dt = robot, braking, dt
        arm = ca.SX.sym("arm", robot.chain.n - CHAIR)
        opening, gaps = _opening(robot, arm)
        self._gaps = ca.Function("gaps", [arm], [gaps], {"cse": True})
        self._opening = ca.Function("opening", [arm], [opening, gaps], {"cse": True})
        self._swinging = [i for i, moves in enumerate(ca.which_depends(gaps, arm, 1, False)) if moves]
        """Indices of the arm joints that move the links; a last joint whose axis passes through the hand does not."""

    def limits(self, tick: Stages, q: ca.SX, last: ca.SX) -> tuple[LinearLimit, LinearLimit, ca.SX]:
        """Limits [m/s] at the posture q (n,), limits on the way to rest, and distance [m] from the nearest keep-out.

        The last command was `last` (n,).
        """
        n, count = q.numel(), len(self.robot.keep_out) * len(self.robot.links)
        if not count:
            none = LinearLimit(ca.SX(0, n), ca.SX(0, 1))
            return none, none, ca.SX(FAR)
        is_near, clearance = self.near(q[CHAIR:], ca.fabs(last)[CHAIR:])
        far = ca.horzcat(ca.SX.zeros(2 * count, n - CHAIR), FAR * ca.SX.ones(2 * count))
        arm = [each[CHAIR:] for each in (q, last)]
        found = tick.when(is_near, lambda: tick.call(self._rows, *arm)[0], far)
        now, then = (
            LinearLimit.of_joints(CHAIR, n, found[some, :-1], found[some, -1])
            for some in (slice(count), slice(count, None))
        )
        hard = ca.fmax(now.upper * self.braking.time + CLEAR, 0) / self.dt
        slides = ca.fmin(now.matrix @ self.braking.slowest(last), hard)
        now = now._replace(upper=ca.fmax(ca.fmax(now.upper, 0), slides))
        return now, then.beyond(self.braking.slower(last)), clearance

    def near(self, arm: ca.SX, fastest: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Whether a keep-out can matter, and the arm's distance [m] from the nearest keep-out.

        The arm has the joint positions `arm` (k,); its last joint speeds were at most `fastest` (k,).
        """
        clearance = ca.mmin(self._gaps(arm))
        speed = ca.sum1(fastest + self.braking.change[CHAIR:])
        return clearance <= self._margin(1.0, fastest) + self.robot.reach * self.braking.time * speed, clearance

    def clear(self, u: ca.SX, clearance: ca.SX) -> ca.SX:
        """1 if every keep-out is further away than a tick of u (n,) can move the arm."""
        return clearance > 1.01 * self.robot.reach * self.dt * ca.sum1(ca.fabs(u[CHAIR:])) + TINY

    def no_deeper(self, arm: ca.SX, u: ca.SX) -> ca.SX:
        """1 if a tick at velocities u (n,) moves the arm at `arm` (k,) neither into a keep-out nor deeper into one."""
        return all_true(self._gaps(arm + self.dt * u[CHAIR:]) >= ca.fmin(self._gaps(arm), 0))

    @cached_property
    def _rows(self) -> ca.Function:
        """Function: arm (k,), last (k,) -> slopes and bounds (2 c, k + 1): c rows now, c rows on the way to rest."""
        arm, last = inputs = [ca.SX.sym(name, self.robot.chain.n - CHAIR) for name in ("arm", "last")]
        slower, time = self.braking.slower(last), self.braking.time
        apart = time / len(ALONG)
        # Rows at mid-tick: a link that slides along a keep-out then comes no nearer.
        opening, gaps = self._opening(arm + last * (self.dt / 2))
        now, free = -opening, (gaps - self._margin(0.0, last)) / time
        then, left = 0 * opening, ca.SX.inf(now.size1())
        before, falls = opening, ca.fmin(opening @ slower, 0)
        for part in ALONG:
            margin = self._margin(part, last)
            opening, here = self._opening(arm + part * time * slower)
            changes = opening @ slower
            rises = ca.fmax(changes, 0)
            # If the distance falls and then rises from the previous point: minimum of a parabola. Else: this point.
            dips = ca.logic_and(falls < 0, rises > 0)
            fraction = ca.if_else(dips, -falls / ca.fmax(rises - falls, TINY), 1)
            least = ca.if_else(dips, gaps + falls * fraction * apart / 2, here)
            then_time = ca.fmax(part * time - (1 - fraction) * apart, apart / 4)
            nearest = before + fraction * (opening - before)
            less = (least - margin) / then_time
            then = ca.if_else(ca.repmat(less < left, 1, now.size2()), nearest, then)
            left = ca.fmin(less, left)
            before, gaps, falls = opening, here, ca.fmin(changes, 0)
        found = ca.horzcat(ca.vertcat(now, -then), ca.vertcat(free, left))
        return ca.Function("keep_out_rows", inputs, [ca.densify(found)])

    def _margin(self, part: float, velocity: ca.SX) -> ca.SX:
        """Margin [m] at the fraction `part` of the way to rest; it covers the tangents' error in a tick."""
        swinging, time = self._swinging, self.braking.time
        change = np.asarray(self.braking.change).ravel()[CHAIR:][swinging]
        speed = ca.sum1(ca.fabs(velocity[swinging]))
        within = self.robot.reach * (self.dt * (speed + np.sum(change))) ** 2 / 2
        step = part * time * float(np.max(change))
        fastest = part * time * float(np.max(self.robot.chain.velocity[CHAIR:][swinging]))
        return (
            within
            + (1 + part) * CLEAR
            + part * MARGIN * ca.fmin(1, (self.robot.reach * time * speed / FAST) ** 2)
            + self.robot.reach * min(step, fastest) ** 2 / 2
        )


def _opening(robot: MobileArm, arm: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Two results for c pairs of link and keep-out: slopes (c, k) of the distances by the joints; distances (c,)."""
    chain = robot.chain
    frames = chain.frames_expression(ca.vertcat(ca.SX.zeros(CHAIR), arm))
    count = chain.n - CHAIR

    def ends(of: LinkEnd) -> tuple[ca.SX, ca.SX]:
        """(3,) [m] position, and its derivative (3, k) by the arm's joints."""
        point = of.place(frames)
        if not of.moves:
            return point, ca.SX(3, count)
        joints = min(of.frame, chain.n) - CHAIR
        columns = [ca.cross(frames[i][:3, 2], point - frames[i][:3, 3]) for i in range(CHAIR, CHAIR + joints)]
        return point, ca.horzcat(*columns, *[ca.SX.zeros(3)] * (count - joints))

    links = [(ends(link.begin), ends(link.end), link.radius) for link in robot.links]
    opening, gaps = ca.SX(0, count), ca.SX(0, 1)
    for capsule in robot.keep_out:
        for (begin, begin_moves), (end, end_moves), radius in links:
            fraction, apart = _nearest(begin, end, capsule)
            size = ca.norm_2(apart)
            moves = begin_moves + fraction * (end_moves - begin_moves)
            opening = ca.vertcat(opening, (apart / ca.fmax(size, TOUCHING)).T @ moves)
            gaps = ca.vertcat(gaps, size - capsule.radius - radius)
    return opening, gaps


def _nearest(begin: ca.SX, end: ca.SX, capsule: Capsule) -> tuple[ca.SX, ca.SX]:
    """Two results: the fraction (0 to 1) of the segment from `begin` to `end` at which it is closest to the capsule's
    segment; and the vector (3,) from the capsule's segment to that point.
    """
    start, other = ca.DM(capsule.start), ca.DM(capsule.end) - ca.DM(capsule.start)
    along, gap = end - begin, begin - start
    a, e = ca.fmax(ca.sumsqr(along), TOUCHING**2), float(ca.sumsqr(other))  # any fraction is right for a ball
    c, f = ca.dot(along, gap), ca.dot(other, gap)
    if e < TOUCHING**2:  # the capsule is a ball
        fraction = clipped(-c / a, 0, 1)
        return fraction, gap + fraction * along
    b = ca.dot(along, other)
    across = a * e - b * b  # zero if parallel: then any point can be the start
    first = ca.if_else(across > TOUCHING, clipped((b * f - c * e) / ca.fmax(across, TOUCHING), 0, 1), 0)
    place = clipped((b * first + f) / e, 0, 1)
    fraction = clipped((b * place - c) / a, 0, 1)
    return fraction, gap + fraction * along - place * other
