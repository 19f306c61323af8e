"""Energy that a force may still deliver to a hand: a bound that no motion of the hand can exceed."""

from __future__ import annotations

import itertools
import math
from functools import cache

import casadi as ca

from rehab_opt.field.samples import HAND_SPEED
from rehab_opt.optim.certificate import clipped
from rehab_opt.symbolic.record import Record, Values

__all__ = ["LAGS", "SLOTS", "TAIL", "EnergyTank", "tank_record"]

TAIL = 5.0
"""Time constants after which what a first-order lag still holds back is counted as a rest, see `EnergyTank`."""
LAGS = 1.5 * math.exp(-TAIL)
"""exp(-TAIL), and half as much again: the older forces that it is a fraction of have faded meanwhile, see `FADES`."""
SLOTS = 10
"""Into how many pieces the forces that are under way are put."""
FADES = 3.0
"""[windows] in which older forces are forgotten, all but 1/e."""


@cache
def tank_record(slots: int) -> Record:
    """What is remembered of a tank; at first `level` is the budget, and the others are zero.

    level : [J] left, as far as the hand was seen. pending : [J] set aside since. coming : [J] what the forces that were
    sent may still deliver beyond that. disputed : [J] that was given back after hidden motion, and that a jump right
    behind it takes again. unseen : [s] since the hand was seen. varied : [J]
    most that forces other than `along` could have added since then. peak : [N] the largest force since then. along :
    (2,) [N] the first. gap : whether there were several.

    lately, swing : [N] the largest force so far, and how far forces went to and fro, both fading.

    x, y, around, impulse, seconds : of the forces sent last, the newest first, pieces of time with the discs that their
    forces are in, centre and radius [N], the integral of their size [N s], and how long they lasted [s].
    """
    sent = dict.fromkeys(("x", "y", "around", "impulse", "seconds"), slots)
    return Record(
        level=1, pending=1, coming=1, disputed=1, unseen=1, varied=1, peak=1, along=2, gap=1, lately=1, swing=1, **sent
    )


class EnergyTank:
    """Energy left of a budget, from commanded forces and the displacements measured while they acted.

    A force that acts while the hand goes dx delivers F.dx, which is known only afterwards. While a position is missing,
    or repeats itself exactly as that of a frozen sensor does, the most that a hand no faster than `speed_cap` could
    have drawn is set aside; the next position replaces it, and one that jumps right after it disputes that. Energy that
    the hand puts in is given back, up to the budget, where every step of it was seen. What it puts in and draws between
    two positions counts by its sum.

    A force acts late: up to `window` after it was sent, all of it but what lags. So a step dx is charged with the most
    that any force under way delivers, max F.dx over those of the window, and with a tail: exp(-TAIL) of a lagging force
    stems from forces before the window. What is sent is delivered once: no more than its impulse times the speed cap is
    still to come. `ceiling` is the largest force F from which a release within the slew bound is affordable beside
    that, after one tick that lasts `late`:

        speed_cap (sum of |F_j| dt_j under way + F late + F^2 / (2 slew)) <= energy left

    So no hand below the speed cap draws more than the budget: what was truly delivered plus speed_cap times the impulse
    under way is never above it. It grows by speed_cap F dt where F is sent, for which the ceiling asks; where the
    energy does not allow F, nothing is sent. Assumed: the hand goes straight from sample to sample, and a force acts at
    most `window` late.

    Numbers are expressions, and each method gives the tank that is left behind by it. The order in a tick: `elapsed`
    with the force that was sent, then `seen` or `jumped`, or neither.

    Parameters
    ----------
    numbers : of `tank_record(slots)`.
    slots : 1 where forces act at once (window zero), else `SLOTS`.
    budget : [J] what may be delivered until `reset`, net of what the hand put in since.
    slew : [N/s] rate at which the force can certainly be released.
    speed_cap : [m/s] hand speed up to which the budget holds.
    late : [s] longest time between two ticks that the reserve covers.
    window : [s] see above. tail : fraction of what older forces differ by, `LAGS`. dt : [s] of a tick.
    """

    def __init__(self, numbers: Values, slots: int, **of: ca.SX) -> None:
        self.numbers, self._slots, self._of = numbers, slots, of
        self._budget, self._slew, self._speed, self.late = (
            of[name] for name in ("budget", "slew", "speed_cap", "late")
        )
        self._window, self._tail = of["window"] * (1 - 1e-9), of["tail"] * numbers.swing  # rounding

    def _with(self, **others: ca.SX) -> EnergyTank:
        return EnergyTank(tank_record(self._slots).changed(self.numbers, **others), self._slots, **self._of)

    def or_else(self, when: ca.SX, other: EnergyTank) -> EnergyTank:
        """The other tank where that is so, else the tank itself."""
        mine, theirs = self.numbers, other.numbers
        names = tank_record(self._slots).places
        return self._with(**{name: ca.if_else(when, getattr(theirs, name), getattr(mine, name)) for name in names})

    @property
    def left(self) -> ca.SX:
        """[J] what is certainly left."""
        return self.numbers.level - self.numbers.pending

    @property
    def ceiling(self) -> ca.SX:
        """[N] the largest force that may be commanded now; zero where nothing is left."""
        slow, free = self._slew * self.late, ca.fmax(self.left - self._to_come, 0)
        return ca.sqrt(slow * slow + 2.0 * self._slew * free / self._speed) - slow

    @property
    def _to_come(self) -> ca.SX:
        """[J] what a hand can still draw from the forces that were sent, beyond what is set aside."""
        now, spare = self.numbers, ca.fmax(self._window / max(self._slots - 2, 1), self._of["dt"])  # stamps jitter
        lasts = ca.fmax(self._window + spare - self._ages(), 0)
        under_way = ca.sum1(ca.fmin(now.impulse, lasts * (ca.hypot(now.x, now.y) + now.around)))
        lags = self._of["tail"] * now.lately * self._window / TAIL
        return ca.if_else(now.unseen > 0, now.coming, (under_way + lags) * self._speed)

    def _ages(self) -> ca.SX:
        """(slots,) [s] since each piece ended."""
        seconds = [ca.SX(0), *ca.vertsplit(self.numbers.seconds)[:-1]]
        return ca.vertcat(*itertools.accumulate(seconds))

    def _most(self, each: ca.SX) -> ca.SX:
        """Largest value `each` (slots,) of those pieces that may have acted since the hand was seen."""
        acts = self._ages() < self._window + self.numbers.unseen
        return ca.mmax(ca.vertcat(each[0], *(ca.if_else(acts[i], each[i], each[0]) for i in range(1, self._slots))))

    def _sent(self, force: ca.SX, seconds: ca.SX, at_most: ca.SX) -> EnergyTank:
        """Add a force (2,), sent for `seconds` or at most `at_most`, to the newest piece; to a new one if full."""
        now, x, y = self.numbers, force[0], force[1]
        impulse = ca.norm_2(force) * ca.fmin(at_most, self._window)
        fits = now.seconds[0] < self._window / max(self._slots - 2, 1)  # so all pieces together are longer than that
        around = ca.fmax(now.around[0], ca.hypot(x - now.x[0], y - now.y[0]))
        after = {}
        for name, fresh, joined in (
            ("x", x, now.x[0]),
            ("y", y, now.y[0]),
            ("around", ca.SX(0), around),
            ("impulse", impulse, now.impulse[0] + impulse),
            ("seconds", seconds, now.seconds[0] + seconds),
        ):
            pieces = ca.vertsplit(getattr(now, name))
            after[name] = ca.if_else(fits, ca.vertcat(joined, *pieces[1:]), ca.vertcat(fresh, *pieces[:-1]))
        fades = 1 + seconds / (FADES * self._window + 1e-9)
        lately = ca.fmax(ca.norm_2(force), now.lately / fades)
        swing = ca.fmin(now.swing / fades + ca.hypot(x - now.x[0], y - now.y[0]), 2 * lately)
        return self._with(lately=lately, swing=swing, **after)

    def elapsed(self, force: ca.SX, seconds: ca.SX, surely: ca.SX) -> EnergyTank:
        """The force (2,) was sent for so long at most, and the hand may have gone anywhere within the speed cap.

        `surely` [s] is what adds up to the time that has gone: by it forces are no longer under way.
        """
        first, reach = self.numbers.unseen == 0, self._speed * seconds
        draws = self._to_come + ca.norm_2(force) * reach
        waiting = self._sent(force, surely, seconds)._with(unseen=self.numbers.unseen + seconds)
        now = waiting.numbers
        along = ca.if_else(first, force, now.along)
        size = waiting._most(ca.hypot(now.x, now.y) + now.around) + self._tail
        other = waiting._most(ca.hypot(now.x - along[0], now.y - along[1]) + now.around) + self._tail
        aside = ca.fmin(ca.fmin(size * reach, draws), ca.fmax(self.left, 0))
        return waiting._with(
            along=along,
            peak=ca.fmax(now.peak, size),
            gap=ca.if_else(first, now.gap, 1),
            varied=now.varied + other * reach,
            pending=now.pending + aside,
            coming=draws - aside,
        )

    def seen(self, moved: ca.SX) -> EnergyTank:
        """The hand has moved by so much (2,) [m] since it was last seen, within the speed cap."""
        now, way = self.numbers, ca.norm_2(moved)
        hidden = clipped(ca.dot(now.along, moved) + now.varied, 0, now.pending)
        work = self._most(now.x * moved[0] + now.y * moved[1] + now.around * way) + self._tail * way
        work = ca.if_else(now.gap, hidden, work)
        disputed = ca.if_else(now.gap, now.pending - work, 0)
        level = ca.fmax(now.level - work, ca.fmin(now.level, 0))  # more than the budget is only counted, never drawn
        return self._with(level=ca.fmin(level, self._budget), disputed=disputed)._settled()

    def jumped(self, distance: ca.SX) -> EnergyTank:
        """The position has moved faster than the speed cap: what a hand could have drawn so is gone for good."""
        now = self.numbers
        drawn = now.disputed + now.pending + now.peak * ca.fmin(distance, HAND_SPEED * now.unseen)
        return self._with(level=now.level - drawn, disputed=ca.SX(0))._settled()

    def left_alone(self, force: ca.SX, seconds: ca.SX, following: ca.SX) -> EnergyTank:
        """A force (2,) was sent for so long, and nobody saw what the hand did; another one (2,) acts from now on."""
        blind = self.elapsed(force, seconds, seconds).jumped(ca.SX(0))
        return blind._sent(following, ca.SX(0), self._window)

    def given(self, fraction: ca.SX, force: ca.SX) -> tuple[EnergyTank, ca.SX]:
        """The tank after a fraction of its free energy is taken, and that energy [J].

        Free is what neither a dispute nor `force` (2,) may still draw.
        """
        size = ca.norm_2(force)
        draws = self._to_come + self._speed * size * (self.late + size / (2.0 * self._slew))
        gone = ca.fmax(clipped(fraction, 0, 1) * (self.left - draws - self.numbers.disputed), 0)
        return self._with(level=self.numbers.level - gone), gone

    def filled(self, joules: ca.SX) -> EnergyTank:
        """With what another tank gave [J], up to the budget; the rest is lost, and so is what is no number."""
        level, valid = self.numbers.level, ca.logic_and(joules > 0, joules < math.inf)
        full = ca.fmin(level + ca.fmin(joules, self._budget), self._budget)
        return self._with(level=ca.if_else(valid, full, level))

    def _settled(self) -> EnergyTank:
        nothing = ca.SX(0)
        return self._with(
            pending=nothing,
            coming=nothing,
            unseen=nothing,
            varied=nothing,
            peak=nothing,
            gap=nothing,
            along=ca.SX.zeros(2),
        )
