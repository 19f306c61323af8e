"""Helper and participant at one task, each in their own workspace: sections V and VII-C, Rossa et al.

The map takes the helper's hand x_h to g(x_h), and a spring pulls the participant's hand there. The participant's force
returns as J(x_h)' F, with the map's Jacobian J, so that power is the same on both sides. Each side has its own force
bounds and energy tank; the sides exchange messages, which may be delayed. A tank sends a fraction of its energy with
every message and adds the received energy, so that the work of one hand can move the other. For any delay and any
motion of the hands, no more energy leaves than the tanks contained at first and the hands put in since. Messages are
numbered: a duplicate, or one after a later one, is ignored, so that no energy counts twice; the energy of a lost
message is lost. A message whose number leaps by more than 100 is ignored until its successor arrives. So a corrupted
number blocks nothing, and after a long interruption the second message counts again.
"""

from __future__ import annotations

from collections import deque
from threading import get_ident
from typing import NamedTuple

from numpy.typing import ArrayLike

from rehab_opt.control.bilateral_sides import FromHelper, FromParticipant, HelperSide, ParticipantSide
from rehab_opt.control.command import Command
from rehab_opt.control.thread_owner import OneThread
from rehab_opt.control.velocity_controller import checked_number, real_numbers
from rehab_opt.errors import ConfigurationError

__all__ = ["Bilateral", "BilateralCommand"]


class BilateralCommand(NamedTuple):
    """The forces of both sides."""

    helper: Command
    participant: Command


class Bilateral(OneThread):
    """Both sides in one process with a delay between them, for simulation, or for two robots on one computer.

    An object belongs to one thread, see `OneThread`, and so do its sides.

    Parameters
    ----------
    helper, participant : the sides, with equal `dt`.
    delay : [s] one way, rounded to whole ticks; the attribute `delay` is the rounded value.

    Raises
    ------
    ConfigurationError : a wrong type of side, different ticks, an invalid delay.
    """

    def __init__(self, helper: HelperSide, participant: ParticipantSide, *, delay: float = 0.0) -> None:
        for argument, side, kind in (("helper", helper, HelperSide), ("participant", participant, ParticipantSide)):
            if not isinstance(side, kind):
                raise ConfigurationError(argument, side, f"a {kind.__name__}")
        if helper.force.dt != participant.force.dt:
            raise ConfigurationError(
                "helper", helper.force.dt, f"a tick as the participant's, {participant.force.dt} s"
            )
        self.helper, self.participant, self.dt = helper, participant, helper.force.dt
        self._ticks = round(checked_number("delay", delay, above=-1e-12, below=10.0) / self.dt)
        self.delay = self._ticks * self.dt
        self.reset()

    def reset(self) -> None:
        """Reset both sides; no message is under way."""
        self._claim()
        self.helper.reset()
        self.participant.reset()
        self._there: deque[FromHelper | None] = deque([None] * (self._ticks + 1))
        self._back: deque[FromParticipant | None] = deque([None] * (self._ticks + 1))
        self._give_away()

    @property
    def under_way(self) -> tuple[FromParticipant | None, FromHelper | None]:
        """Messages that the helper's and the participant's side receive in the next tick."""
        return self._back[0], self._there[0]

    def step(
        self,
        helper: ArrayLike,
        participant: ArrayLike,
        helper_velocity: ArrayLike | None = None,
        participant_velocity: ArrayLike | None = None,
        *,
        enable: object = True,
    ) -> BilateralCommand:
        """Forces for the helper's hand (2,) [m] in their workspace and the participant's (2,) [m] in theirs.

        A message takes the delay and one tick. Invalid arguments raise an error before any state changes.
        """
        if self._owner != get_ident():
            self._claim()
        x, y = real_numbers("helper", helper, (2,)), real_numbers("participant", participant, (2,))
        v = None if helper_velocity is None else real_numbers("helper_velocity", helper_velocity, (2,))
        w = None if participant_velocity is None else real_numbers("participant_velocity", participant_velocity, (2,))
        felt, said = self.helper.step(x, self._back.popleft(), v, enable=enable)
        drawn, answer = self.participant.step(y, self._there.popleft(), w, enable=enable)
        self._there.append(said)
        self._back.append(answer)
        return BilateralCommand(felt, drawn)
