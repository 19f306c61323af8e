"""Reference of a mirrored hand in one tick: its pace, its pose, and the distance by which the hand stays short of it.

Functions of the queued samples, the memory and the hand, evaluated in Python and exported to C.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np

from rehab_opt.control.between_poses import angle_of, distance_of
from rehab_opt.control.interaction import FELT
from rehab_opt.control.mirror_statement import CALM, HELD, SPARE, WHOLE
from rehab_opt.control.reference_clock import CLOCK, LONGEST, SAMPLE, ClockStatement
from rehab_opt.optim.certificate import all_true, clipped
from rehab_opt.symbolic.record import Record, Values

__all__ = [
    "AIMED", "COUNTED", "FOLLOWED", "PACE", "PACES", "QUICKENING", "REMEMBERED", "SAID", "TRIED", "MirrorPace",
    "counted",
]  # fmt: skip

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
PACES = (1.0, 0.5, 0.25, 0.0)
"""Shares of the clock's pace that are tried."""

PACE = Record(rate=1, share=1, waited=1, stood=1, apart=1, aside=1)
"""Seconds of the reference in one, the share of the wanted motion that was delivered, [s] that the clock waited and
that the hand stood, and [m, rad] that it then was apart from the reference: the nearest that it comes, seen from where
it is. Deviations count from there on, so that a stretch out of reach is followed along its edge and none of it is left
out. They shrink as the hand comes nearer."""
TRIED = Record(pose=16, twist=6, seconds=1, fits=1, goal=12, target=16, motion=6, place=1, stays=1)
"""What may be followed: pose, twist at the clock's pace, [s] that it goes on by, whether the deviation allows it; pose
of what the hand is led to now, which may be what the person's arm can do of the reference; pose and twist for the hand,
which a model of that arm may change; the pace's place in `PACES`; whether the hand stays at what it was held near."""
SAID = Record(passed=1, ahead=1, bridging=1, short=1, beyond=2)
"""Samples passed and those still ahead, whether it bridges a jump, and the hand is short; [m, rad] by which the
person's arm stays short of what is followed."""
AIMED = Record(kept=1, pose=16, twist=6, offset=3)
"""Whether an arm that brakes stays near `HELD`, or nothing else is left; pose, twist and offset [m] for the QP."""
COUNTED = Record(acceleration=1, shortened=1, slowed=1, waited=1, braked=1, cut=1)
"""How many ticks relaxed acceleration, were shortened, slowed, waited, braked, and how often the hand was cut short."""
REMEMBERED = Record(
    pace=PACE.size, held=HELD.size, felt=FELT.size, aim=16, then=1, live=1, lead_w=1, lead_age=1, counted=COUNTED.size
)
"""What a tracker remembers besides its QP's state and clock. Behind pace, hand and forces: what the person's arm can do
of the reference, NaN where nothing is known of one; w / w_max where the last command leads; whether the next tick
needs no clock; the largest w of the way out at hand, and for how many ticks that did not grow; and counts."""
FOLLOWED = Record(reference=16, time_scale=1, lag=1, manipulability=1, counted=COUNTED.size)
"""How a reference is followed: see the properties of `MirrorTracker`; and counts."""


@dataclass(frozen=True, kw_only=True)
class MirrorPace:
    """Parameters of a tracker's pace: see `MirrorTracker`."""

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

    @property
    def clock(self) -> ClockStatement:
        """What the clock does."""
        return ClockStatement(self.dt, window=self.window)

    def followed_function(self) -> ca.Function:
        """Samples, `CLOCK`, whether the tick needs no clock, pose and twist of the last such tick, `REMEMBERED` ->
        `FOLLOWED`.
        """
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
        """Samples, `CLOCK`, `REMEMBERED`, others, hand's pose (16,), a place in `PACES` -> `PACE`, `TRIED`.

        Of the first pace from that place on that fits; behind the last, where not even a standing reference is allowed
        since the model of the person's arm moves, the hand stays. The others are whether the clock makes up for a lag,
        and the most that what follows allows.
        """
        sizes = {"clock": CLOCK.size, "memory": REMEMBERED.size, "others": 2, "here": 16, "place": 1}
        samples = ca.MX.sym("samples", SAMPLE.size, self.window)
        clock, memory, others, here, first = given = [ca.MX.sym(name, size) for name, size in sizes.items()]
        pace, felt, aim, held = (memory[REMEMBERED.places[name]] for name in ("pace", "felt", "aim", "held"))
        others = ca.vertcat(felt[FELT["pace"]], others)
        rated = ca.vertcat(*self._rated()(samples[:, 0], samples[:, 1], clock, pace, others, here, aim))
        tries = self._at_pace(rated.numel())
        inputs = [ca.MX.sym("input", tries.sparsity_in(i)) for i in range(tries.n_in())]
        same = ca.Function("same", inputs, [inputs[0]])
        found, either = ca.MX.zeros(tries.numel_out(0)), ca.Function.if_else("tries", tries, same)
        for place, part in enumerate(PACES):
            missing = found[PACE.size + TRIED["fits"]] == 0
            looks = ca.logic_and(missing, first <= place) if place + 1 < len(PACES) else missing
            found = either(looks, found, samples, clock, rated, here, part, place)
        near, tried, which = ca.vertsplit(found, [0, PACE.size, found.numel() - 1, found.numel()])
        stays = first >= len(PACES)
        target = ca.if_else(stays, held[HELD.places["target"]], tried[TRIED.places["pose"]])
        tried = ca.vertcat(tried, target, tried[TRIED.places["twist"]], which, stays)
        return ca.Function("tried", [samples, *given], [near, tried])

    def _at_pace(self, size: int) -> ca.Function:
        """What was found, samples, `CLOCK`, `_rated` (size,), hand's pose, a pace, its place -> what is found with it.

        That is `PACE`, `TRIED` to its goal, and the place.
        """
        samples, (old, clock, rated, here, part, place) = ca.MX.sym("samples", SAMPLE.size, self.window), (
            ca.MX.sym("given", each) for each in (PACE.size + TRIED["target"] + 1, CLOCK.size, size, 16, 1, 1)
        )  # fmt: skip
        near, rate, goal, allowed = ca.vertsplit(rated, [0, *np.cumsum([PACE.size, 1, 12, 1])])
        rate = rate * part
        pose, twist = self.clock.read_function()(samples, clock, rate * self.dt)
        a, b = (ca.SX.sym("pose", 16) for _ in range(2))
        distance = ca.Function("distance", [a, b], [distance_of(a, b)])
        fits = ca.logic_or(distance(pose, here) <= allowed, rate <= 0)
        found = ca.vertcat(rate, near[1:], pose, rate * twist, rate * self.dt, fits, goal, place)
        return ca.Function("at_pace", [old, samples, clock, rated, here, part, place], [found])

    def concluded_function(self, *, person: bool) -> ca.Function:
        """Samples, `CLOCK`, `PACE`, hand's pose and twist, `TRIED`, `HELD`, `REMEMBERED` -> that, `SAID`, `CLOCK`.

        The clock goes on by the seconds of what was tried and taken. The target is what a `person`'s arm does of it.
        """
        samples, clock, near = ca.SX.sym("samples", SAMPLE.size, self.window), CLOCK.symbols("c"), PACE.symbols("p")
        here, hand, held = others = [ca.SX.sym("given", size) for size in (16, 6, HELD.size)]
        tried, old, lengths = TRIED.symbols("tried"), REMEMBERED.symbols("memory"), samples[SAMPLE["seconds"], :].T
        target = tried.target
        passed, then = self.clock.advanced(lengths, clock, tried.seconds, tried.seconds > 0)
        yielding = FELT.parts(old.felt).pace
        after, waits, cuts = self._waited(near, then.ahead <= 0, yielding, hand, here, tried.goal)
        bridging = ca.logic_and(clock.ahead > 0, lengths[1] > LONGEST * self.dt)
        beyond = ca.vertcat(distance_of(tried.pose, target), angle_of(tried.pose, target))
        said = SAID.of(
            passed=passed,
            ahead=then.ahead,
            bridging=bridging,
            short=_short(after),
            beyond=ca.if_else(all_true(target == tried.pose), 0, beyond),
        )
        memory = REMEMBERED.changed(
            old, pace=after.column, held=held, aim=target if person else old.aim,
            counted=counted(old, waited=waits, cut=cuts),
        )  # fmt: skip
        inputs = [samples, clock.column, near.column, *others[:2], tried.column, *others[2:], old.column]
        return ca.Function("concluded", inputs, [memory.column, said, then.column], {"cse": True})

    def aimed_function(self, audit: ca.Function, braked: ca.Function, *, person: bool) -> ca.Function:
        """q, last velocity, hand's pose, `TRIED`, `PACE`, `REMEMBERED`, moving -> `HELD`, `AIMED`.

        `HELD` is what the hand is then held near: the target, from there towards the hand by what it stays short of at
        best. Where it stays it is held as it was, and rests. Of `AIMED` pose and twist are displaced by forces, and the
        offset leads from there to the centre. Audit, braking and what moves are those of `MirrorStatement`. What a
        `person`'s arm does is kept to where it stays within the hand's bounds, or comes nearer to the hand.
        """
        here, tried = ca.SX.sym("here", 16), TRIED.symbols("tried")
        pace, memory, stays = PACE.symbols("pace"), REMEMBERED.symbols("memory"), tried.stays
        old, felt = HELD.parts(memory.held), FELT.parts(memory.felt)
        origin, target = [3, 7, 11], ca.if_else(stays, old.target, tried.target)
        part = ca.fmin(pace.apart / ca.fmax(distance_of(here, target), 1e-12), 1)
        cut = target[origin] + part * (here[origin] - target[origin])
        centre = ca.if_else(stays, old.centre, cut)
        turn = ca.if_else(stays, old.turn, self.max_turn + pace.aside)
        pose, motion = ca.SX(target), ca.if_else(stays, 0, tried.motion)
        pose[origin] += felt.moved
        motion[:3] += felt.velocity
        held = HELD.of(centre=centre, target=target, turn=turn)
        known, near = ca.fabs(old.turn) < ca.inf, ca.SX(1)
        if person:
            away = [ca.norm_2(here[origin] - each) for each in (centre, old.centre)]
            turned = [angle_of(here, each) for each in (target, old.target)]
            near = ca.logic_and(
                away[0] <= ca.fmax(WAITS * self.max_deviation, away[1]),
                turned[0] <= ca.fmax(WAITS * self.max_turn + pace.aside, turned[1]),
            )
        inputs = [here, tried.column, pace.column, memory.column]
        parts = ca.Function(
            "parts", inputs, [held, ca.vertcat(pose, motion, centre - pose[origin]), known, near], {"cse": True}
        )
        q, last, moving = (ca.MX.sym(name, audit.size1_in(i)) for name, i in (("q", 0), ("last", 1), ("moving", 3)))
        given = [ca.MX.sym("given", each.numel()) for each in inputs]
        column, told, begun, there = parts.call(given)
        kept = ca.logic_and(there, audit(q, braked(q, last), column, moving)[0])
        kept = ca.logic_or(ca.logic_or(ca.logic_not(begun), kept), given[1][TRIED["stays"]])
        return ca.Function("aimed", [q, last, *given, moving], [column, ca.vertcat(kept, told)])

    # ---------------------------------------------------------------------------------------------------- its parts
    def _rated(self) -> ca.Function:
        """Sample at hand, the next, and the inputs of `tried` -> `PACE`, rate, goal (12,), allowed deviation [m]."""
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
        allowed = WAITS * self.max_deviation + apart + distance_of(pose, goal)
        outputs = [near.column, rate, goal, ca.fmax(allowed, distance_of(pose, here))]
        inputs = [a.column, b.column, clock.column, pace.column, others, here, aim]
        return ca.Function("rated", inputs, [ca.densify(each) for each in outputs], {"cse": True})

    def _rate(  # noqa: PLR0917
        self, pace: Values, lag: ca.SX, still: ca.SX, others: ca.SX, here: ca.SX, goal: ca.SX, twist: ca.SX
    ) -> ca.SX:
        """Seconds of the reference to follow in a second."""
        yielding, hurried, most = ca.vertsplit(others)
        late = lag - self.dt
        # What the person's arm cannot do of the reference is no reason to dwell there: it would not come to an end.
        away = (distance_of(here, goal) - pace.apart) / self.max_deviation
        turned = (angle_of(here, goal) - pace.aside) / self.max_turn
        eased = clipped((WAITS - ca.fmax(away, turned)) / (WAITS - CALM), 0, 1)
        # What rests is passed at full haste to the last tick: nothing moves that would have to be slowed down.
        rush = ca.if_else(eased == 1, RUSH, 0)
        hurry = ca.if_else(still, rush, ca.fmin(self.catch_up, late / CATCHING_UP + AT_LEAST))
        hurried = all_true(hurried, yielding == 1, late > 0)  # nobody is hurried who pushes
        rate = (1 + ca.if_else(hurried, hurry, 0)) * eased * yielding
        for part, largest in ((twist[:3], self.linear_speed), (twist[3:], self.angular_speed)):
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


def counted(memory: Values, **more: ca.SX) -> ca.SX:
    """`COUNTED` of a `REMEMBERED`, with what this tick adds."""
    before = COUNTED.parts(memory.counted)
    return COUNTED.changed(before, **{name: getattr(before, name) + each for name, each in more.items()}).column
