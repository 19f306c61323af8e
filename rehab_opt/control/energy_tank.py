"""How much energy a force may still deliver to a hand, counted so that no motion of the hand can draw more."""

from __future__ import annotations

import math

import casadi as ca

from rehab_opt.optim.certificate import clipped
from rehab_opt.symbolic.record import Record, Values

__all__ = ["HAND_SPEED", "TANK", "EnergyTank"]

HAND_SPEED = 10.0
"""[m/s] No hand is faster: a larger jump is the sensor's."""
TANK = Record(level=1, pending=1, disputed=1, unseen=1, varied=1, peak=1, along=2, gap=1)
"""What is remembered of a tank; at first `level` is the budget, and the others are zero.

level : [J] left, as far as the hand was seen. pending : [J] set aside since. disputed : [J] that was given back after
hidden motion, and that a jump right behind it takes again. unseen : [s] since the hand was seen. varied : [J] most that
forces other than the first one since then could have added. peak : [N] the largest of them. along : (2,) [N] the first.
gap : whether there were several.
"""


class EnergyTank:
    """Energy left of a budget, from the forces that were applied and the displacements that were then seen.

    A force F that acts while the hand goes dx delivers F.dx, which is known only afterwards. While a position is
    missing, or repeats itself exactly as that of a frozen sensor does, the most that a hand no faster than
    `speed_cap` could have drawn is set aside; the next position settles it, and one that jumps right after it disputes
    that. Energy that the hand puts in is given back, up to the budget, where every step of it was seen.

    `ceiling` is the largest force F from which a release within the slew bound is still affordable, whatever the hand
    does below the speed cap, after one tick that lasts `late`:

        F v late + F^2 v / (2 slew) <= energy left

    Numbers are expressions, and each method gives the tank that is left behind by it. The order in a tick: `elapsed`
    with the force that was applied, then `seen` or `jumped`, or neither.

    Parameters
    ----------
    numbers : of `TANK`.
    budget : [J] what may be delivered until `reset`, net of what the hand put in since.
    slew : [N/s] rate at which the force can certainly be released.
    speed_cap : [m/s] hand speed up to which the budget holds.
    late : [s] longest time between two ticks that the reserve covers.
    """

    def __init__(self, numbers: Values, *, budget: ca.SX, slew: ca.SX, speed_cap: ca.SX, late: ca.SX) -> None:
        self.numbers, self._budget, self._slew, self._speed, self._late = numbers, budget, slew, speed_cap, late

    def _with(self, **others: ca.SX) -> EnergyTank:
        return EnergyTank(
            TANK.changed(self.numbers, **others),
            budget=self._budget, slew=self._slew, speed_cap=self._speed, late=self._late,
        )  # fmt: skip

    def or_else(self, when: ca.SX, other: EnergyTank) -> EnergyTank:
        """The other tank where that is so, else the tank itself."""
        mine, theirs = self.numbers, other.numbers
        return self._with(**{
            name: ca.if_else(when, getattr(theirs, name), getattr(mine, name)) for name in TANK.places
        })  # fmt: skip

    @property
    def left(self) -> ca.SX:
        """[J] what is certainly left."""
        return self.numbers.level - self.numbers.pending

    @property
    def ceiling(self) -> ca.SX:
        """[N] the largest force that may be applied now; zero where nothing is left."""
        slow = self._slew * self._late
        return ca.sqrt(slow * slow + 2.0 * self._slew * ca.fmax(self.left, 0) / self._speed) - slow

    def elapsed(self, force: ca.SX, seconds: ca.SX) -> EnergyTank:
        """The force (2,) acted for so long, and the hand may have gone anywhere within the speed cap."""
        now = self.numbers
        size, reach, first = ca.norm_2(force), self._speed * seconds, now.unseen == 0
        return self._with(
            along=ca.if_else(first, force, now.along),
            peak=ca.if_else(first, size, ca.fmax(now.peak, size)),
            gap=ca.if_else(first, now.gap, 1),
            varied=now.varied + ca.if_else(first, 0, ca.norm_2(force - now.along) * reach),
            unseen=now.unseen + seconds,
            pending=now.pending + size * reach,
        )

    def seen(self, moved: ca.SX) -> EnergyTank:
        """The hand has moved by so much (2,) [m] since it was last seen, within the speed cap."""
        now = self.numbers
        work = ca.dot(now.along, moved) + now.varied
        work = ca.if_else(now.gap, clipped(work, 0, now.pending), work)
        disputed = ca.if_else(now.gap, now.pending - work, 0)
        return self._with(level=ca.fmin(now.level - work, self._budget), disputed=disputed)._settled()

    def jumped(self, distance: ca.SX) -> EnergyTank:
        """The position has moved faster than the speed cap: what a hand could have drawn so is gone for good."""
        now = self.numbers
        drawn = now.disputed + now.pending + now.peak * ca.fmin(distance, HAND_SPEED * now.unseen)
        return self._with(level=now.level - drawn, disputed=ca.SX(0))._settled()

    def given(self, share: ca.SX) -> tuple[EnergyTank, ca.SX]:
        """What is left when a share of what is certainly left and nobody can dispute goes; and that share [J]."""
        gone = ca.fmax(share * (self.left - self.numbers.disputed), 0)
        return self._with(level=self.numbers.level - gone), gone

    def filled(self, joules: ca.SX) -> EnergyTank:
        """With what another tank gave [J], up to the budget; the rest is lost, and so is what is no number."""
        level, usable = self.numbers.level, ca.logic_and(joules > 0, joules < math.inf)
        full = ca.fmin(level + ca.fmin(joules, self._budget), self._budget)
        return self._with(level=ca.if_else(usable, full, level))

    def _settled(self) -> EnergyTank:
        nothing = ca.SX(0)
        return self._with(
            pending=nothing, unseen=nothing, varied=nothing, peak=nothing, gap=nothing, along=ca.SX.zeros(2)
        )
