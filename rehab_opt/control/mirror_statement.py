"""The QP of a mirrored hand, and its bounds checked on the true state at the end of the tick."""

from __future__ import annotations

import math
from collections import Counter
from functools import cached_property, reduce
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.command import Relaxed
from rehab_opt.control.hand_bounds import HandBounds
from rehab_opt.control.scaled_task import Inputs, Rows, ScaledTask, TickSolution
from rehab_opt.control.stopping import APPROACH, VelocityBounds
from rehab_opt.control.tool_speed import speed_ahead
from rehab_opt.kinematics.rigid import rotation_vector
from rehab_opt.optim.certificate import all_true, clipped
from rehab_opt.optim.rows import MAX_MAGNITUDE, Instance, parameter
from rehab_opt.symbolic.record import Record
from rehab_opt.symbolic.tick import Stages

__all__ = ["CALM", "HELD", "SPARE", "WHOLE", "MirrorStatement"]

Array = NDArray[np.float64]

FLAT = 2e-3
"""[1/rad] Slope of w / w_max below which the gradient shows no way up."""
WHOLE = 0.999
"""Fraction of the desired motion from which nothing was slowed."""
CALM = 0.45
"""Fraction of the largest deviation up to which the clock keeps its pace."""
SPARE = 0.95
"""Fraction of the hand speeds that the reference may take: the rest is for catching up with it."""
HASTE = 4.0
"""[1] Feedback on the error asks for at most this many times the largest hand speed."""
AT_MOST = 0.4
"""Fraction of an error that feedback removes in a tick. A floor is curved, of which the QP knows nothing: beyond two
over what that adds to its own curvature a hand at rest goes to and fro (0.26 rad/s at 20 ms and a fraction of 0.63)."""
HALVINGS = 12
ROUNDING, TINY = 1e-12, 1e-12
"""[m/s] A speed that is no motion."""
HELD = Record(centre=3, target=16, turn=1)
"""What the hand is held near: the centre [m] of the places that it may have, and the pose, by rows, whose orientation
it may be turned from by so much [rad]; NaN where nothing is known."""


class Posture(NamedTuple):
    """Quantities of the posture at the beginning of a tick, as expressions."""

    w: ca.SX
    """W / w_max."""
    gradient: ca.SX
    """(n,) of it."""
    place: ca.SX
    """(3,) [m] of the tool's origin."""
    turned: ca.SX
    """[rad^2] square of the tool's turn from the target."""


class MirrorStatement(ScaledTask):
    """`ScaledTask`'s QP with the rows of `HandBounds`, its true state at the end of the tick, and shortened steps."""

    memory_extra = 1  # what the last tick lost of w / w_max against its tangent
    floor: float
    max_deviation: float
    max_turn: float
    hand_bounds: HandBounds
    counts: Counter[str]

    def others(self) -> list[ca.SX]:
        """From the target to the deviation's centre (3,), and what stands for a gradient that vanishes (n,)."""
        return [parameter("offset", 3), parameter("lead", self.chain.n), *super().others()]

    @property
    def shapes(self) -> tuple[tuple[int, ...], ...]:  # type: ignore[override]
        """Shapes of the statement's parameters after q."""
        pose, twist, *moving = super().shapes
        return (pose, twist, (3,), (self.chain.n,), *moving)

    def rows(self, tick: Stages, inputs: Inputs, bounds: VelocityBounds) -> Rows:
        """See `HandBounds.rows`."""
        offset, lead, *_ = inputs.others
        contacts = self.contacts(tick, inputs.q, inputs.last, inputs.moving)
        matrix, upper, now = self.hand_bounds.rows(
            inputs.q,
            inputs.last,
            centre=inputs.target[:3, 3] + offset,
            lead=lead,
            loss=inputs.memory[-1],
            bounds=bounds,
            contacts=contacts,
        )
        turned = ca.sumsqr(rotation_vector(inputs.target[:3, :3] @ now.pose[:3, :3].T))
        bounds = bounds._replace(outside=ca.logic_or(bounds.outside, self.limits.inside(contacts)))
        return Rows(matrix, upper, bounds, Posture(now.w, now.gradient, now.pose[:3, 3], turned))

    def excess(self, inputs: Inputs, jacobian: ca.SX, velocity: ca.SX) -> ca.SX:
        """Hand speeds of `velocity`, not the reference, over their limits: what a floor takes must not slow the rest.

        The hand comes to its largest speed at the rate `APPROACH`: a servo overshoots the end of an acceleration.
        """
        q, most = inputs.q, self.linear_speed
        unweighted = self._unweighted(jacobian)
        turning = ca.norm_2(unweighted[3:, :] @ velocity)
        way = unweighted[:3, :] @ velocity
        before = clipped(ca.dot(way, unweighted[:3, :] @ inputs.last) / ca.fmax(ca.norm_2(way), TINY), 0, most)
        allowed = before - math.expm1(-APPROACH * self.dt) * (most - before)
        linear = speed_ahead(self.chain, q, unweighted, velocity, self.dt)
        return ca.fmax(linear / allowed, turning / self.angular_speed)

    @property
    def settling(self) -> float:
        """[1/s] as `ScaledTask`'s, and slower in long ticks."""
        return min(super().settling, AT_MOST / self.dt)

    def reference_twist(self, pose: ca.SX, target: ca.SX, twist: ca.SX) -> ca.SX:
        """See `ScaledTask`; feedback is no faster than `HASTE` times the hand speeds."""
        feedback = self.settling * ca.vertcat(
            target[:3, 3] - pose[:3, 3], rotation_vector(target[:3, :3] @ pose[:3, :3].T)
        )
        linear, angular = ca.norm_2(feedback[:3]), ca.norm_2(feedback[3:])
        excess = ca.fmax(linear / (HASTE * self.linear_speed), angular / (HASTE * self.angular_speed))
        return twist + feedback / ca.fmax(excess, 1)

    def outcome(self, tick: Stages, inputs: Inputs, motion: TickSolution) -> tuple[ca.SX, ca.SX]:
        """Yielded, fraction of the reference, nothing unusual, bounds truly kept, w before and after, w is flat.

        The memory ends with the loss of w against its tangent.
        """
        centre, now = inputs.target[:3, 3] + inputs.others[0], Posture(*motion.rows.posture)
        outside = motion.rows.bounds.outside
        relaxed, _ = ca.vertsplit(
            self.report(inputs.last, motion.velocity, motion.delivered, motion.commanded, outside)
        )
        part = ca.if_else(motion.speed > 1e-9, motion.scale, 1)
        kept, _, then, loss = self.hand_bounds.kept(
            inputs.q, motion.velocity, centre, w=now.w, gradient=now.gradient, here=now.place,
            hand=motion.delivered[:3],  # places weigh 1
        )  # fmt: skip
        clear = ca.SX(1)
        if self.among_bodies:
            clear = self._clear(tick, inputs.q, inputs.moving, motion.velocity, braked=False)
        kept = all_true(kept, clear > 0)
        flat = ca.logic_and(ca.sumsqr(now.gradient) < FLAT**2, now.w < self.floor)
        usual = [
            kept, part >= WHOLE, ca.logic_not(flat), outside < 0.5,
            ca.logic_or(relaxed == int(Relaxed.NOTHING), relaxed == int(Relaxed.TASK)),
            ca.sumsqr(now.place - centre) <= (CALM * self.max_deviation) ** 2,
            now.turned <= (CALM * self.max_turn) ** 2,
            ca.sumsqr(inputs.twist[:3]) <= (SPARE * self.linear_speed) ** 2,
            ca.sumsqr(inputs.twist[3:]) <= (SPARE * self.angular_speed) ** 2,
        ]  # fmt: skip
        report = ca.vertcat(relaxed, part, reduce(ca.logic_and, usual), kept, now.w, then, flat)
        return report, ca.vertcat(self.remember(inputs.q, motion.velocity), ca.fmin(loss, self.floor))

    def _clear(self, tick: Stages, q: ca.SX, moving: ca.SX, velocity: ca.SX, *, braked: bool) -> ca.SX:
        """Whether bodies are clear of each other where it leads, and on the way to rest unless it is `braked`."""
        ways = self.hand_bounds.ways(velocity)[: 1 if braked else None]
        return all_true(*(tick.call(self.limits.clear, q, moving, way * velocity)[0] for way in ways))

    @cached_property
    def audit(self) -> ca.Function:
        """q, velocity, `HELD` -> the first three of `HandBounds.kept`, and no further turned than held.

        Turns of the tool from the target are judged where places are, above the floor; beyond `turn` they may only
        fall. Moving capsules are the last input.
        """
        q, velocity, held = ca.SX.sym("q", self.chain.n), ca.SX.sym("v", self.chain.n), HELD.symbols("held")
        w, gradient = self.hand_bounds.manipulability(q)
        hand = self.chain.jacobian_expression(q)[:3, :] @ velocity
        here = self.chain.pose_expression(q)
        kept, braking, then, _ = self.hand_bounds.kept(
            q, velocity, held.centre, w=w, gradient=gradient, here=here[:3, 3], hand=hand
        )
        aimed = ca.reshape(held.target, 4, 4)[:3, :3]  # by rows: its transpose
        cosines = [
            (ca.trace(aimed @ pose[:3, :3]) - 1) / 2
            for pose in (here, *(self.chain.pose_expression(q + self.dt * way * velocity)
                                 for way in self.hand_bounds.ways(velocity)))
        ]  # fmt: skip
        least = ca.fmin(cosines[0], ca.cos(ca.fmin(held.turn, math.pi)))
        least = ca.if_else(w < self.floor, -2, least)  # the way back above the floor comes first
        turns = [each >= least - ROUNDING for each in cosines[1:]]
        outputs = ca.logic_and(kept, all_true(*turns)), braking
        verdicts, tick, moving = [outputs[0], outputs[1]], Stages(), ca.SX.sym("moving", self.limits.moving_size)
        if self.among_bodies:
            told = tick.once(ca.if_else(all_true(ca.fabs(moving) <= MAX_MAGNITUDE), moving, 0))  # or nothing is there
            for i, braked in enumerate((False, True)):
                verdicts[i] = ca.logic_and(verdicts[i], self._clear(tick, q, told, velocity, braked=braked))
        return tick.function("audit", [q, velocity, held.column, moving], [ca.vertcat(*verdicts, then)])

    @cached_property
    def braked(self) -> ca.Function:
        """q, velocity (n,) -> all joints slowed alike, as fast as their accelerations allow, and within their limits.

        A joint that is too fast to stop before its limit stops there: what accelerations are comes behind.
        """
        q, last = (ca.SX.sym(name, self.chain.n) for name in ("q", "last"))
        lower, upper = ((ca.DM(end) - q) / self.dt for end in (self.chain.lower, self.chain.upper))
        slowed = clipped(self.hand_bounds.braking(last), ca.fmin(lower, 0), ca.fmax(upper, 0))
        return ca.Function("braked", [q, last], [ca.densify(slowed)], {"cse": True})

    def keeping(self) -> ca.Function:
        """q, velocity, `HELD`, velocity before, broken, moving capsules -> the velocity that keeps every bound truly.

        Where that velocity does not, as is known with `broken`, it is the longest part of the way to it from braking;
        where not even braking does, because the arm was put there or moves by itself, the longest part of that. Where
        no part of an answer that is known to be `broken` does, it is the longest part of `ascent`. Three numbers
        besides: w / w_max where it leads, whether it is shorter, whether the acceleration yields.
        """
        n, audit = self.chain.n, self.audit
        sizes = {
            "q": n,
            "v": n,
            "held": HELD.size,
            "before": n,
            "broken": 1,
            "moving": self.limits.moving_size,
            "then": 1,
        }
        q, value, held, before, broken, moving, then = given = [ca.MX.sym(name, size) for name, size in sizes.items()]
        braked = self.braked(q, before)
        brakes = audit(q, braked, held, moving)[1]
        begin, end = ca.if_else(brakes, braked, 0), ca.if_else(brakes, value, braked)
        longest = self._longest_part
        part, some = longest(q, begin, end, held, moving, brakes)
        same = longest.mx_in()
        upwards = ca.Function.if_else("upwards", longest, ca.Function("stays", same, [same[1], 0]))
        stuck = ca.logic_and(ca.logic_and(broken, brakes), ca.logic_not(some))
        part = upwards(stuck, q, part, self.ascent(q, before), held, moving, brakes)[0]
        said = ca.vertcat(audit(q, part, held, moving)[2], 1, self.hurried(before, part))
        shortened = ca.Function("shortened", given, [part, said])
        whole = ca.Function("whole", given, [value, ca.vertcat(then, 0, 0)])
        ends = audit(q, value, held, moving)
        either = ca.Function.if_else("either", whole, shortened)
        fits = ca.logic_and(ends[0], ca.logic_not(broken))
        outputs = either.call([fits, *given[:-1], ends[2]])
        return ca.Function("keeping", given[:-1], outputs)

    @property
    def _longest_part(self) -> ca.Function:
        """q, two velocities, `HELD`, moving capsules, whether it brakes -> a velocity between them, whether it is new.

        By halving, the one furthest from the first towards the second that keeps every bound; new if not the first.
        """
        n, audit = self.chain.n, self.audit
        sizes = {"q": n, "begin": n, "end": n, "held": HELD.size, "moving": self.limits.moving_size, "brakes": 1}
        q, begin, end, held, moving, brakes = inputs = [ca.MX.sym(name, size) for name, size in sizes.items()]
        short, long = ca.MX(0), ca.MX(1)
        for _ in range(HALVINGS):
            middle = (short + long) / 2
            ends = audit(q, begin + middle * (end - begin), held, moving)
            good = ca.if_else(brakes, ends[0], ends[1])
            short, long = ca.if_else(good, middle, short), ca.if_else(good, long, middle)
        return ca.Function("longest_part", inputs, [begin + short * (end - begin), short > 0])

    @cached_property
    def ascent(self) -> ca.Function:
        """q, velocity before (n,) -> steepest ascent of w at recovery speeds, or braking above the floor.

        It is taken where no part of the QP's answer keeps w from falling. The QP has one row for w, its tangent or what
        stands for that; near a posture that is singular more than once, what the other joints do to hold the hand may
        cost more than that row gains.
        """
        q, last = (ca.SX.sym(name, self.chain.n) for name in ("q", "last"))
        w, gradient = self.hand_bounds.manipulability(q)
        change, slow = self.hand_bounds.change, ca.DM(self.recovery_speed * self.chain.velocity)
        up = gradient / ca.fmax(ca.mmax(ca.fabs(gradient) / slow), TINY)
        lower, upper = ((ca.DM(end) - q) / self.dt for end in (self.chain.lower, self.chain.upper))
        up = clipped(clipped(up, ca.fmin(lower, 0), ca.fmax(upper, 0)), last - change, last + change)
        chosen = ca.if_else(w < self.floor, up, self.hand_bounds.braking(last))
        return ca.Function("ascent", [q, last], [ca.densify(chosen)], {"cse": True})

    def instance(self, q: ArrayLike, *inputs: ArrayLike) -> Instance:
        """The QP of a tick at q, pose and twist, as numbers, for inspection; nothing moves where nothing is said."""
        return super().instance(q, *inputs, *(np.zeros(shape) for shape in self.shapes[len(inputs) :]))
