"""Pace and pose of a mirrored hand's reference in one tick, and the deviation that remains if the pose is out of reach.

The functions serve Python and C.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca

from rehab_opt.control.between_poses import angle_of, distance_of
from rehab_opt.control.interaction import FELT
from rehab_opt.control.mirror_statement import CALM, SPARE, WHOLE
from rehab_opt.control.reference_clock import CLOCK, LONGEST, SAMPLE, ClockStatement
from rehab_opt.optim.certificate import all_true, clipped
from rehab_opt.symbolic.record import Record, Values

__all__ = [
    "AIMED", "COUNTED", "FOLLOWED", "PACE", "QUICKENING", "REMEMBERED", "SAID", "TRIED", "MirrorPace", "counted",
]  # fmt: skip

WAITS = 0.9
"""At this fraction of the largest deviation the clock waits."""
QUICKENING, CATCHING_UP = 0.1, 0.3
"""[s] Time in which the pace rises by 1, and time constant with which the clock makes up for its lag."""
RUSH = 4.0
"""Pace added to the clock while the reference rests."""
AT_LEAST = 0.02
"""Least pace added to a late clock, so that it does catch up."""
STILL = 0.01, 0.1
"""[m/s, rad/s] A slower reference counts as at rest."""
STANDS = 0.005, 0.05
"""[m/s, rad/s] A slower hand counts as at rest."""
SHORT = 0.001, 0.01
"""[m, rad] A hand further from its reference counts as short of it."""
STUCK = 0.1
"""[s] A hand that has rested this long, with a slowed clock, counts as at the nearest pose within reach."""
PATIENCE = 1.0
"""[s] A moving hand counts as at its nearest pose once the clock has waited this much longer than it ran."""
WAITED = 0.02
"""Pace below which the clock counts as waiting."""

PACE = Record(rate=1, waited=1, stood=1, apart=1, aside=1)
"""Seconds of the reference per second; [s] time that the clock waited; [s] time that the hand stood still; [m, rad]
remaining deviation, at which the hand stopped. Only the excess over the remaining deviation slows the clock, so that
the hand moves along the edge of its reach. The remaining deviation shrinks as the hand comes nearer.
"""
TRIED = Record(pose=16, twist=6, seconds=1, goal=12, target=16, motion=6)
"""Reference in this tick: pose, twist at the clock's pace, advance of the clock [s]; `goal`, the last target of the
hand; `target` and `motion`, the new pose and twist for the hand, which a model of the person's arm may change.
"""
SAID = Record(passed=1, ahead=1, bridging=1, short=1, beyond=2)
"""Number of samples passed and ahead, whether a jump is bridged, whether the hand falls short; [m, rad] deviation of
the person's arm from the reference.
"""
AIMED = Record(pose=16, twist=6)
"""Pose and twist that the QP tracks."""
COUNTED = Record(acceleration=1, slowed=1, waited=1, braked=1, cut=1)
"""Numbers of ticks (acceleration relaxed, reference slowed, clock waited, arm braked) and of stretches out of reach."""
REMEMBERED = Record(pace=PACE.size, held=3, felt=FELT.size, aim=16, then=1, live=1, counted=COUNTED.size)
"""Memory of a tracker besides the state of its QP and its clock: `PACE`; held position of the hand [m]; state of the
force response, `FELT`; last target within reach of the person's arm; w / w_max at the end of the last command; whether
the next tick needs no clock; `COUNTED`. An unknown position or target is NaN.
"""
FOLLOWED = Record(reference=16, time_scale=1, lag=1, manipulability=1, counted=COUNTED.size)
"""Values of the properties of `MirrorTracker` with these names, and the counts."""


@dataclass(frozen=True, kw_only=True)
class MirrorPace:
    """Parameters that determine the pace of the reference; see `MirrorTracker`."""

    dt: float
    linear_speed: float
    angular_speed: float
    max_deviation: float
    max_turn: float
    catch_up: float

    @property
    def window(self) -> int:
        """Largest number of samples, from the current one on, that a tick may use, bridges included."""
        return 2 * math.ceil(1.0 + max(RUSH, self.catch_up)) + 2

    @property
    def clock(self) -> ClockStatement:
        """Functions of the clock."""
        return ClockStatement(self.dt, window=self.window)

    def followed_function(self) -> ca.Function:
        """Function: samples, `CLOCK`, whether no clock is needed, last pose and twist, `REMEMBERED` -> `FOLLOWED`."""
        sizes = {"clock": CLOCK.size, "live": 1, "accepted": 22, "memory": REMEMBERED.size}
        samples = ca.MX.sym("samples", SAMPLE.size, self.window)
        clock, live, accepted, memory = given = [ca.MX.sym(name, size) for name, size in sizes.items()]
        empty, at = clock[CLOCK["ahead"]] < 0, REMEMBERED.places
        read = ca.if_else(empty, math.nan, self.clock.read_function()(samples, clock, 0)[0])
        behind = self.clock.behind_function()(ca.vec(samples[:, :2]), clock)
        reference, lag = ca.if_else(live, accepted[:16], read), ca.if_else(live, 0, behind)
        rate = memory[at["pace"]][PACE["rate"]]
        followed = ca.vertcat(reference, rate, lag, memory[at["then"]], memory[at["counted"]])
        return ca.Function("followed", [samples, *given], [followed])

    def tried_function(self) -> ca.Function:
        """Function: samples, `CLOCK`, `REMEMBERED`, others, hand's pose (16,) -> `PACE`, `TRIED`.

        `others` (2,) holds whether the clock may catch up, and the largest pace that later samples allow.
        """
        sizes = {"clock": CLOCK.size, "memory": REMEMBERED.size, "others": 2, "here": 16}
        samples = ca.MX.sym("samples", SAMPLE.size, self.window)
        clock, memory, others, here = given = [ca.MX.sym(name, size) for name, size in sizes.items()]
        pace, felt, aim = (memory[REMEMBERED.places[name]] for name in ("pace", "felt", "aim"))
        others = ca.vertcat(felt[FELT["pace"]], others)
        near, rate, goal = self._rated()(samples[:, 0], samples[:, 1], clock, pace, others, here, aim)
        pose, twist = self.clock.read_function()(samples, clock, rate * self.dt)
        tried = ca.vertcat(pose, rate * twist, rate * self.dt, goal, pose, rate * twist)
        return ca.Function("tried", [samples, *given], [ca.vertcat(rate, near[1:]), tried])

    def concluded_function(self, *, person: bool) -> ca.Function:
        """Function: samples, `CLOCK`, `PACE`, pose and twist, `TRIED`, `REMEMBERED` -> `REMEMBERED`, `SAID`, `CLOCK`,
        `AIMED`.

        The pose in `AIMED` is the target, displaced by forces. The held position in `REMEMBERED` is the target, moved
        towards the hand by the remaining deviation. With `person`, `REMEMBERED` also stores the target.
        """
        samples, clock, near = ca.SX.sym("samples", SAMPLE.size, self.window), CLOCK.symbols("c"), PACE.symbols("p")
        here, hand = others = [ca.SX.sym("given", size) for size in (16, 6)]
        tried, old, lengths = TRIED.symbols("tried"), REMEMBERED.symbols("memory"), samples[SAMPLE["seconds"], :].T
        target, felt, origin = tried.target, FELT.parts(old.felt), [3, 7, 11]
        passed, then = self.clock.advanced(lengths, clock, tried.seconds, tried.seconds > 0)
        after, waits, cuts = self._waited(near, then.ahead <= 0, felt.pace, hand, here, tried.goal)
        bridging = ca.logic_and(clock.ahead > 0, lengths[1] > LONGEST * self.dt)
        beyond = ca.vertcat(distance_of(tried.pose, target), angle_of(tried.pose, target))
        said = SAID.of(
            passed=passed, ahead=then.ahead, bridging=bridging, short=_short(after),
            beyond=ca.if_else(all_true(target == tried.pose), 0, beyond),
        )  # fmt: skip
        part = ca.fmin(near.apart / ca.fmax(distance_of(here, target), 1e-12), 1)
        memory = REMEMBERED.changed(
            old, pace=after.column, held=target[origin] + part * (here[origin] - target[origin]),
            aim=target if person else old.aim, counted=counted(old, waited=waits, cut=cuts),
        )  # fmt: skip
        pose, motion = ca.SX(target), ca.SX(tried.motion)
        pose[origin] += felt.moved
        motion[:3] += felt.velocity
        inputs = [samples, clock.column, near.column, *others, tried.column, old.column]
        outputs = [memory.column, said, then.column, AIMED.of(pose=pose, twist=motion)]
        return ca.Function("concluded", inputs, outputs, {"cse": True})

    # ---------------------------------------------------------------------------------------------------- its parts
    def _rated(self) -> ca.Function:
        a, b, clock, pace = (each.symbols("s") for each in (SAMPLE, SAMPLE, CLOCK, PACE))
        others, here, aim = ca.SX.sym("others", 3), ca.SX.sym("here", 16), ca.SX.sym("aim", 16)
        pose, twist = self.clock.between(a, b, ca.if_else(clock.ahead <= 0, 0, clock.fraction))
        goal = ca.if_else(ca.fabs(aim[0]) < ca.inf, aim[:12], pose)
        still = ca.logic_or(clock.ahead <= 0, ca.logic_and(
            distance_of(a.pose, b.pose) <= STILL[0] * b.seconds, angle_of(a.pose, b.pose) <= STILL[1] * b.seconds
        ))  # fmt: skip
        apart, aside = ca.fmin(pace.apart, distance_of(here, goal)), ca.fmin(pace.aside, angle_of(here, goal))
        near = PACE.changed(pace, apart=apart, aside=aside)
        rate = self._rate(near, clock.lag, still, others, here, goal, twist)
        outputs = [near.column, rate, goal]
        inputs = [a.column, b.column, clock.column, pace.column, others, here, aim]
        return ca.Function("rated", inputs, [ca.densify(each) for each in outputs], {"cse": True})

    def _rate(  # noqa: PLR0917
        self, pace: Values, lag: ca.SX, still: ca.SX, others: ca.SX, here: ca.SX, goal: ca.SX, twist: ca.SX
    ) -> ca.SX:
        yielding, hurried, most = ca.vertsplit(others)
        late = lag - self.dt
        # The remaining deviation does not slow the clock, or the clock would wait for ever.
        away = (distance_of(here, goal) - pace.apart) / self.max_deviation
        turned = (angle_of(here, goal) - pace.aside) / self.max_turn
        eased = clipped((WAITS - ca.fmax(away, turned)) / (WAITS - CALM), 0, 1)
        # While the reference rests, the clock runs fast up to its last tick, since nothing moves.
        rush = ca.if_else(eased == 1, RUSH, 0)
        hurry = ca.if_else(still, rush, ca.fmin(self.catch_up, late / CATCHING_UP + AT_LEAST))
        hurried = all_true(hurried, yielding == 1, late > 0)  # no haste while the person pushes
        rate = (1 + ca.if_else(hurried, hurry, 0)) * eased * yielding
        for part, largest in ((twist[:3], self.linear_speed), (twist[3:], self.angular_speed)):
            rate = ca.fmin(rate, SPARE * largest / ca.fmax(ca.norm_2(part), 1e-9))
        return ca.fmin(ca.fmin(rate, most), pace.rate + self.dt / QUICKENING)

    def _waited(  # noqa: PLR0917
        self, pace: Values, current: ca.SX, yielding: ca.SX, hand: ca.SX, here: ca.SX, goal: ca.SX
    ) -> tuple[Values, ca.SX, ca.SX]:
        """Three results: `PACE` after a tick; whether the clock waits; whether the hand is now at its nearest pose."""
        usual = ca.logic_or(ca.logic_and(pace.rate >= WHOLE, current), yielding < 1)
        waits = ca.logic_and(ca.logic_not(usual), pace.rate <= WAITED)
        # While the clock runs, the waiting time falls again.
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
    return ca.logic_or(pace.apart > SHORT[0], pace.aside > SHORT[1])


def counted(memory: Values, **more: ca.SX) -> ca.SX:
    """Counts `COUNTED` of the memory `REMEMBERED`, increased by the counts `more` of this tick."""
    before = COUNTED.parts(memory.counted)
    return COUNTED.changed(before, **{name: getattr(before, name) + each for name, each in more.items()}).column
