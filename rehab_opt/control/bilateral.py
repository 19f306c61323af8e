"""A helper and a participant share one task, each in their own workspace (Rossa et al., sections V and VII-C).

A map g takes the helper's hand position x_h to the participant's workspace, and a spring pulls the participant's hand
to g(x_h). The participant's force F returns to the helper as J(x_h)' F with the map's Jacobian J, so the power is the
same on both sides.

Each side has its own force bounds and energy tank. The sides exchange messages, which may be delayed or lost. Every
message transfers a fraction of the energy in the sender's tank. In total, the forces deliver at most the initial energy
of both tanks plus the work of the hands. A duplicate message, or one older than the last message, is ignored.
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
    """Forces of both sides."""

    helper: Command
    participant: Command


class Bilateral(OneThread):
    """Both sides in one process with a delay between them, for simulation or for two robots on one computer.

    A wrong type of side, different ticks and an invalid delay raise `ConfigurationError`.

    Parameters
    ----------
    helper, participant : the sides, with equal `dt`.
    delay : [s] delay of a message in one direction; the attribute `delay` is this value rounded to whole ticks.
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
        """Reset both sides and discard the messages in transit."""
        self._claim()
        self.helper.reset()
        self.participant.reset()
        self._there: deque[FromHelper | None] = deque([None] * (self._ticks + 1))
        self._back: deque[FromParticipant | None] = deque([None] * (self._ticks + 1))
        self._give_away()

    @property
    def under_way(self) -> tuple[FromParticipant | None, FromHelper | None]:
        """Messages that the helper's side and the participant's side receive in the next tick."""
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
        """Forces for the helper's hand (2,) [m] and the participant's hand (2,) [m], each in their own workspace."""
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
