"""How much energy a force may still deliver to a hand, counted so that no motion of the hand can draw more."""

from __future__ import annotations

import math

__all__ = ["HAND_SPEED", "EnergyTank"]

HAND_SPEED = 10.0
"""[m/s] No hand is faster: a larger jump is the sensor's."""


class EnergyTank:
    """Energy left of a budget, from the forces that were applied and the displacements that were then seen.

    A force F that acts while the hand goes dx delivers F.dx, which is known only afterwards. While a position is
    missing, or repeats itself exactly as that of a frozen sensor does, the most that a hand no faster than
    `speed_cap` could have drawn is set aside; the next position settles it, and one that jumps right after it disputes
    that. Energy that the hand puts in is given back, up to the budget, where every step of it was seen.

    `ceiling` is the largest force F from which a release within the slew bound is still affordable, whatever the hand
    does below the speed cap, after one tick that lasts `late`:

        F v late + F^2 v / (2 slew) <= energy left

    The order of calls in a tick: `elapse` with the force that was applied, then `seen` or `jumped`, or neither.

    Parameters
    ----------
    budget : [J] what may be delivered until `reset`, net of what the hand put in since.
    slew : [N/s] rate at which the force can certainly be released.
    speed_cap : [m/s] hand speed up to which the budget holds.
    late : [s] longest time between two ticks that the reserve covers.
    """

    __slots__ = (
        "_along_x", "_along_y", "_disputed", "_gap", "_peak", "_per_newton", "_slew", "_speed", "_varied", "budget",
        "level", "pending", "unseen",
    )  # fmt: skip

    level: float
    """[J] left, as far as the hand was seen."""
    pending: float
    """[J] set aside since."""
    unseen: float
    """[s] since the hand was seen."""
    _varied: float
    _peak: float

    def __init__(self, *, budget: float, slew: float, speed_cap: float, late: float) -> None:
        self.budget, self._slew, self._speed = budget, slew, speed_cap
        self._per_newton = slew * late
        self.reset()

    def reset(self) -> None:
        """Full again, with nothing unseen."""
        self.level = self.budget
        self._disputed = 0.0
        self._settled()

    @property
    def left(self) -> float:
        """[J] what is certainly left."""
        return self.level - self.pending

    @property
    def ceiling(self) -> float:
        """[N] the largest force that may be applied now; zero where nothing is left."""
        left = self.level - self.pending
        if not left > 0.0:
            return 0.0
        slow = self._per_newton
        return math.sqrt(slow * slow + 2.0 * self._slew * left / self._speed) - slow

    def elapse(self, force_x: float, force_y: float, seconds: float) -> None:
        """The force acted for so long, and the hand may have gone anywhere within the speed cap."""
        size = math.hypot(force_x, force_y)
        reach = self._speed * seconds
        if self.unseen == 0.0:
            self._along_x, self._along_y, self._peak = force_x, force_y, size
        else:
            self._gap = True
            self._varied += math.hypot(force_x - self._along_x, force_y - self._along_y) * reach
            self._peak = max(self._peak, size)
        self.unseen += seconds
        self.pending += size * reach

    def seen(self, dx: float, dy: float) -> None:
        """The hand has moved by (dx, dy) [m] since it was last seen, within the speed cap."""
        work = self._along_x * dx + self._along_y * dy + self._varied
        if self._gap:
            work = min(max(work, 0.0), self.pending)
            self._disputed = self.pending - work
        else:
            self._disputed = 0.0
        level = self.level - work
        self.level = level if level < self.budget else self.budget
        self._settled()

    def jumped(self, distance: float) -> None:
        """The position has moved faster than the speed cap: what a hand could have drawn so is gone for good."""
        self.level -= self._disputed + self.pending + self._peak * min(distance, HAND_SPEED * self.unseen)
        self._disputed = 0.0
        self._settled()

    def give(self, share: float) -> float:
        """[J] taken out, a share of what is certainly left and nobody can dispute any more."""
        given = share * (self.level - self.pending - self._disputed)
        if not given > 0.0:
            return 0.0
        self.level -= given
        return given

    def take(self, joules: float) -> None:
        """Filled by what another tank gave [J], up to the budget; the rest is lost."""
        if 0.0 < joules < math.inf:
            self.level = min(self.level + min(joules, self.budget), self.budget)

    def _settled(self) -> None:
        self.pending = self.unseen = self._varied = self._peak = 0.0
        self._along_x = self._along_y = 0.0
        self._gap = False
