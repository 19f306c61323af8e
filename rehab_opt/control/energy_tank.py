"""Bound on the energy that a force may still deliver to a hand, whatever the hand's motion."""

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
"""Number of time constants of a lag that the window covers; the rest of the response is the tail, see `EnergyTank`."""
LAGS = 1.5 * math.exp(-TAIL)
"""Weight of the tail; the factor 1.5 covers the fading of older forces, see `FADES`."""
SLOTS = 10
"""Number of time slots of past commands."""
FADES = 3.0
"""Time constant with which older forces fade, as a multiple of the window."""


@cache
def tank_record(slots: int) -> Record:
    """Record of a tank's state. At first `level` is the budget and all other values are zero.

    level : [J] energy left at the last valid position. pending : [J] energy reserved since then.
    coming : [J] energy, in addition to `pending`, that past commands may still deliver.
    disputed : [J] reserve that was given back after a gap in the positions; it is lost if a jump follows at once.
    unseen : [s] time since the last valid position. gap : whether there were several ticks since then.
    varied : [J] largest work, since then, by the differences between the forces and `along`.
    peak : [N] largest force since then. along : (2,) [N] first force since then.
    lately, swing : [N] largest force so far, and accumulated change of the force; both fade with time.
    x, y, around, impulse, seconds : (slots,) values of each time slot, newest first. A disc with the centre (x, y) and
        the radius `around` [N] contains all forces of the slot. `impulse` [N s] is the integral of their size, and
        `seconds` [s] is the slot's duration.
    """
    sent = dict.fromkeys(("x", "y", "around", "impulse", "seconds"), slots)
    return Record(
        level=1, pending=1, coming=1, disputed=1, unseen=1, varied=1, peak=1, along=2, gap=1, lately=1, swing=1, **sent
    )


class EnergyTank:
    """Remaining energy of a budget, computed from commanded forces and the displacements measured while they acted.

    The work F.dx of a force F is known only after the displacement dx. While positions are missing or repeat exactly,
    the largest energy that a hand within `speed_cap` could have drawn is reserved. When the next
    position arrives, the measured work is booked in place of this reserve; if a jump follows at once, the reserve is
    lost. Energy that the hand puts in is added, up to the budget.

    A force acts with a delay of up to `window`, except for a small fraction that lags longer. So a displacement dx
    costs the largest F.dx over the forces of the window, plus a tail. `ceiling` is the largest force F that leaves
    enough energy for a release within the slew limit after a tick of length `late`. With the forces F_j that have been
    commanded and may still act ("under way"), the ceiling F satisfies

        speed_cap (sum of |F_j| dt_j under way + F late + F^2 / (2 slew)) <= energy left

    So a hand below the speed cap, moving straight between samples, never draws more than the budget. Methods that
    account for an event return a new tank. In each tick call `elapsed` with the last command, then `seen` or `jumped`,
    or neither of them.

    Parameters
    ----------
    numbers : values of `tank_record(slots)`. slots : 1 if forces act at once (window zero), else `SLOTS`.
    budget : [J] net energy that may be delivered until `reset`. slew : [N/s] guaranteed release rate of the force.
    speed_cap : [m/s] hand speed up to which the budget holds. late : [s] longest tick that the reserve covers.
    window : [s] see above. tail : weight of the change of older forces, `LAGS`. dt : [s] of a tick.
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
        """`other` if the condition `when` holds, else this tank."""
        mine, theirs = self.numbers, other.numbers
        names = tank_record(self._slots).places
        return self._with(**{name: ca.if_else(when, getattr(theirs, name), getattr(mine, name)) for name in names})

    @property
    def left(self) -> ca.SX:
        """Energy [J] that is certainly left."""
        return self.numbers.level - self.numbers.pending

    @property
    def ceiling(self) -> ca.SX:
        """Largest force [N] that may be commanded now; zero without energy."""
        slow, free = self._slew * self.late, ca.fmax(self.left - self._to_come, 0)
        return ca.sqrt(slow * slow + 2.0 * self._slew * free / self._speed) - slow

    @property
    def _to_come(self) -> ca.SX:
        """Energy [J] that a hand can still draw from past commands, beyond the reserve."""
        now, spare = self.numbers, ca.fmax(self._window / max(self._slots - 2, 1), self._of["dt"])  # stamps jitter
        lasts = ca.fmax(self._window + spare - self._ages(), 0)
        under_way = ca.sum1(ca.fmin(now.impulse, lasts * (ca.hypot(now.x, now.y) + now.around)))
        lags = self._of["tail"] * now.lately * self._window / TAIL
        return ca.if_else(now.unseen > 0, now.coming, (under_way + lags) * self._speed)

    def _ages(self) -> ca.SX:
        seconds = [ca.SX(0), *ca.vertsplit(self.numbers.seconds)[:-1]]
        return ca.vertcat(*itertools.accumulate(seconds))

    def _most(self, each: ca.SX) -> ca.SX:
        """Largest entry of `each` (slots,) among slots whose forces may have acted since the last valid position."""
        acts = self._ages() < self._window + self.numbers.unseen
        return ca.mmax(ca.vertcat(each[0], *(ca.if_else(acts[i], each[i], each[0]) for i in range(1, self._slots))))

    def _sent(self, force: ca.SX, seconds: ca.SX, at_most: ca.SX) -> EnergyTank:
        """Add a force (2,), commanded for `seconds` (at the longest, `at_most`), to the newest slot or a new one."""
        now, x, y = self.numbers, force[0], force[1]
        impulse = ca.norm_2(force) * ca.fmin(at_most, self._window)
        fits = now.seconds[0] < self._window / max(self._slots - 2, 1)  # so that all slots exceed the window
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
        """Account for a force (2,) commanded for at most `seconds`, whatever the hand's motion within the speed cap.

        The values of `surely` [s] sum up to the elapsed time, even if stamps jitter. This sum decides when past
        commands expire.
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
        """Account for a measured displacement (2,) [m] since the last valid position, within the speed cap."""
        now, way = self.numbers, ca.norm_2(moved)
        hidden = clipped(ca.dot(now.along, moved) + now.varied, 0, now.pending)
        work = self._most(now.x * moved[0] + now.y * moved[1] + now.around * way) + self._tail * way
        work = ca.if_else(now.gap, hidden, work)
        disputed = ca.if_else(now.gap, now.pending - work, 0)
        level = ca.fmax(now.level - work, ca.fmin(now.level, 0))  # more than the budget is counted but never drawn
        return self._with(level=ca.fmin(level, self._budget), disputed=disputed)._settled()

    def jumped(self, distance: ca.SX) -> EnergyTank:
        """Account for a position jump beyond the speed cap: the energy that the hand could have drawn is lost."""
        now = self.numbers
        drawn = now.disputed + now.pending + now.peak * ca.fmin(distance, HAND_SPEED * now.unseen)
        return self._with(level=now.level - drawn, disputed=ca.SX(0))._settled()

    def left_alone(self, force: ca.SX, seconds: ca.SX, following: ca.SX) -> EnergyTank:
        """Account for a force (2,) commanded for `seconds` without a position; `following` (2,) acts from now on."""
        blind = self.elapsed(force, seconds, seconds).jumped(ca.SX(0))
        return blind._sent(following, ca.SX(0), self._window)

    def given(self, fraction: ca.SX, force: ca.SX) -> tuple[EnergyTank, ca.SX]:
        """Take a fraction of the free energy; return the tank without it, and the energy taken [J].

        Disputed energy and energy that `force` (2,) may still deliver are not free.
        """
        size = ca.norm_2(force)
        draws = self._to_come + self._speed * size * (self.late + size / (2.0 * self._slew))
        gone = ca.fmax(clipped(fraction, 0, 1) * (self.left - draws - self.numbers.disputed), 0)
        return self._with(level=self.numbers.level - gone), gone

    def filled(self, joules: ca.SX) -> EnergyTank:
        """Add energy [J] from another tank, up to the budget; NaN is ignored."""
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
