"""A mirrored hand's reference, tick by tick: how fast it is followed, where, and what the hand stays short of.

One function of the samples that wait, of what is remembered and of the hand, which Python evaluates and C has, too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca

from rehab_opt.control.between_poses import angle_of, distance_of
from rehab_opt.control.mirror_statement import CALM, SPARE, WHOLE
from rehab_opt.control.reference_clock import CLOCK, ClockStatement, Read
from rehab_opt.optim.certificate import all_true, clipped
from rehab_opt.symbolic.record import Record, Values

__all__ = ["PACE", "QUICKENING", "SAID", "MirrorPace"]

WAITS = 0.9
"""Share of the largest deviation from which the clock waits."""
QUICKENING, CATCHING_UP = 0.1, 0.3
"""[s] in which the clock regains its pace, and in which it makes up for its lag."""
RUSH = 4.0
"""Share by which the clock may run fast while the reference rests: to let that time pass leads no further away."""
AT_LEAST = 0.02
"""Share by which the clock runs fast while it is late at all: so that it does catch up."""
STILL = 0.01, 0.1
"""[m/s, rad/s] A reference up to these rests."""
STANDS = 0.005, 0.05
"""[m/s, rad/s] A hand up to these stands."""
SHORT = 0.001, 0.01
"""[m, rad] from which a hand counts as short of its reference."""
STUCK = 0.1
"""[s] for which it must have stood while the clock is slowed, before it counts as nearest."""
PATIENCE = 1.0
"""[s] for which the clock waits longer than it goes on, at most, for a hand that does not come to rest either."""
WAITED = 0.02
"""Pace up to which the clock stands."""
HALVED = 3
"""Steps of the clock that are tried, each half as long as the one before, until the deviation allows one."""

PACE = Record(rate=1, share=1, waited=1, stood=1, apart=1, aside=1)
"""Seconds of the reference in one, the share of the wanted motion that was delivered, [s] that the clock waited and
that the hand stood, and [m, rad] that it then was apart from the reference: the nearest that it comes, seen from where
it is. Deviations count from there on, so that a stretch out of reach is followed along its edge and none of it is left
out. They shrink as the hand comes nearer."""
SAID = Record(passed=1, fraction=1, lag=1, bridging=1, waits=1, cuts=1, short=1)
"""Samples passed, where the clock then is, and whether it bridges a jump, stood, a hand was cut short, and is short."""


@dataclass(frozen=True, kw_only=True)
class MirrorPace:
    """Numbers of a tracker: see `MirrorTracker`."""

    dt: float
    linear_speed: float
    angular_speed: float
    max_deviation: float
    max_turn: float
    catch_up: float

    @property
    def window(self) -> int:
        """Samples from the one at hand on that a tick may come to: of a tick each, or a bridge and one of no time."""
        return 2 * math.ceil(1.0 + max(RUSH, self.catch_up)) + 2

    def function(self) -> ca.Function:
        """Samples, `CLOCK`, `PACE`, others, hand's pose (16,) and twist, aim (16,) -> pose, twist, `PACE`, `SAID`.

        Pose and twist are what is followed now: the clock goes on as far as the deviation allows, and the twist is at
        its pace. The others are the share of its pace that forces leave the reference, whether it makes up for a lag,
        and the most that what follows allows. The aim is what the person's arm can do of the reference; NaN where
        nothing is known of one.
        """
        clocked = ClockStatement(self.dt, window=self.window)
        symbols, each = clocked.samples()
        clock, pace, others = CLOCK.symbols("clock"), PACE.symbols("pace"), ca.SX.sym("others", 3)
        here, hand, aim = ca.SX.sym("here", 16), ca.SX.sym("hand", 6), ca.SX.sym("aim", 16)
        now = clocked.read(each, clock, ca.SX(0))
        goal = ca.if_else(ca.fabs(aim[0]) < ca.inf, aim[:12], now.pose)
        still = ca.logic_or(clock.ahead <= 0, ca.logic_and(
            distance_of(each[0].pose, each[1].pose) <= STILL[0] * each[1].seconds,
            angle_of(each[0].pose, each[1].pose) <= STILL[1] * each[1].seconds,
        ))  # fmt: skip
        near = PACE.changed(
            pace,
            apart=ca.fmin(pace.apart, distance_of(here, goal)),
            aside=ca.fmin(pace.aside, angle_of(here, goal)),
        )
        rate = self._rate(near, clock.lag, still, others, here, goal, now)

        allowed = WAITS * self.max_deviation + near.apart + distance_of(now.pose, goal)
        allowed = ca.fmax(allowed, distance_of(now.pose, here))
        reached, seconds, goes = now, ca.SX(0), ca.SX(0)
        for k in reversed(range(HALVED)):
            ahead = rate * self.dt * 0.5**k
            tried = clocked.read(each, clock, ahead)
            fits = distance_of(tried.pose, here) <= allowed
            reached = Read(*(ca.if_else(fits, new, old) for new, old in zip(tried, reached, strict=True)))
            seconds, goes = ca.if_else(fits, ahead, seconds), ca.logic_or(fits, goes)
        passed, then = clocked.advanced(each, clock, seconds, goes)
        going = PACE.changed(near, rate=seconds / self.dt)
        after, waits, cuts = self._waited(going, then.ahead <= 0, others[0], hand, here, goal)
        said = SAID.of(
            passed=passed, fraction=then.fraction, lag=then.lag, bridging=clocked.is_bridging(each, clock),
            waits=waits, cuts=cuts, short=_short(after),
        )  # fmt: skip
        outputs = [ca.vertcat(reached.pose, 0, 0, 0, 1), reached.twist * going.rate, after.column, said]
        inputs = [symbols, clock.column, pace.column, others, here, hand, aim]
        return ca.Function("pace", inputs, [ca.densify(each) for each in outputs], {"cse": True})

    def aimed_function(self) -> ca.Function:
        """Hand's pose (16,), target's, twist, [m] apart, displacement by forces (6,) -> pose, twist, offset, centre.

        The centre (3,) is what deviations are bounded around: from the target towards the hand by what it stays short
        of at best. Forces displace target and twist; the offset (3,) leads from there to the centre.
        """
        here, target, twist = ca.SX.sym("here", 16), ca.SX.sym("target", 16), ca.SX.sym("twist", 6)
        apart, felt, origin = ca.SX.sym("apart"), ca.SX.sym("felt", 6), [3, 7, 11]
        part = ca.fmin(apart / ca.fmax(distance_of(here, target), 1e-12), 1)
        centre = target[origin] + part * (here[origin] - target[origin])
        pose, motion = ca.SX(target), ca.SX(twist)
        pose[origin] += felt[:3]
        motion[:3] += felt[3:]
        outputs = [pose, motion, centre - pose[origin], centre]
        return ca.Function("aimed", [here, target, twist, apart, felt], outputs, {"cse": True})

    # ---------------------------------------------------------------------------------------------------- its parts
    def _rate(  # noqa: PLR0917
        self, pace: Values, lag: ca.SX, still: ca.SX, others: ca.SX, here: ca.SX, goal: ca.SX, now: Read
    ) -> ca.SX:
        """Seconds of the reference to follow in a second."""
        yielding, hurried, most = ca.vertsplit(others)
        late = lag - self.dt
        # What rests is passed at full haste to the last tick: nothing moves that would have to be slowed down.
        hurry = ca.if_else(still, RUSH, ca.fmin(self.catch_up, late / CATCHING_UP + AT_LEAST))
        hurried = all_true(hurried, yielding == 1, late > 0)  # nobody is hurried who pushes
        # What the person's arm cannot do of the reference is no reason to dwell there: it would not come to an end.
        away = (distance_of(here, goal) - pace.apart) / self.max_deviation
        turned = (angle_of(here, goal) - pace.aside) / self.max_turn
        eased = clipped((WAITS - ca.fmax(away, turned)) / (WAITS - CALM), 0, 1)
        rate = (1 + ca.if_else(hurried, hurry, 0)) * (eased * yielding)
        for part, largest in ((now.twist[:3], self.linear_speed), (now.twist[3:], self.angular_speed)):
            rate = ca.fmin(rate, SPARE * largest / ca.fmax(ca.norm_2(part), 1e-9))
        # A hand that stands short of the reference has no share of the motion towards it: that is no reason to wait.
        slowed = ca.logic_and(pace.share < WHOLE, ca.logic_not(_short(pace)))
        before = pace.rate * ca.if_else(slowed, pace.share, 1)
        return ca.fmin(ca.fmin(rate, most), ca.fmax(before, 0) + self.dt / QUICKENING)

    def _waited(  # noqa: PLR0917
        self, pace: Values, current: ca.SX, yielding: ca.SX, hand: ca.SX, here: ca.SX, goal: ca.SX
    ) -> tuple[Values, ca.SX, ca.SX]:
        """A hand that stands while the clock is slowed or late is as near as it comes; whether it waits, and cuts."""
        usual = ca.logic_or(ca.logic_and(pace.rate >= WHOLE, current), yielding < 1)
        waits = ca.logic_and(ca.logic_not(usual), pace.rate <= WAITED)
        # What was waited for before it went on is no reason to cut the hand short now.
        waited = ca.if_else(waits, pace.waited + self.dt, ca.fmax(pace.waited - self.dt, 0))
        stands = ca.logic_and(ca.norm_2(hand[:3]) <= STANDS[0], ca.norm_2(hand[3:]) <= STANDS[1])
        stood = ca.if_else(stands, pace.stood + self.dt, 0)
        cut = ca.logic_and(ca.logic_not(usual), ca.logic_or(stood >= STUCK, waited >= PATIENCE))
        over = ca.logic_or(usual, cut)
        after = PACE.changed(
            pace,
            waited=ca.if_else(over, 0, waited),
            stood=ca.if_else(over, 0, stood),
            apart=ca.if_else(cut, distance_of(here, goal), pace.apart),
            aside=ca.if_else(cut, angle_of(here, goal), pace.aside),
        )
        return after, waits, ca.logic_and(cut, _short(after))


def _short(pace: Values) -> ca.SX:
    """Whether the hand follows at a distance, because it stood there."""
    return ca.logic_or(pace.apart > SHORT[0], pace.aside > SHORT[1])
