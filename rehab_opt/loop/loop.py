"""Real-time loop of a controller on a simulated robot (plant) or a device."""

from __future__ import annotations

import gc
import math
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from time import monotonic
from types import FrameType
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.command import Command, Status
from rehab_opt.control.watchdog import default_max_age
from rehab_opt.errors import ConfigurationError, DeviceLostError
from rehab_opt.loop.records import Decide, StateRecord, Tick
from rehab_opt.loop.report import LoopReport, Times
from rehab_opt.loop.scheduling import in_time, sleep_overshoot
from rehab_opt.loop.shared_ring import SharedRing
from rehab_opt.plants.plant import Plant, Truth

if TYPE_CHECKING:
    from rehab_opt.plants.plant import Device

__all__ = ["DEAD_MAN", "Loop"]

Array = NDArray[np.float64]

DEAD_MAN = 0.15
"""Default time [s] after the last report of a held dead man's switch at which the robot brakes."""
STOPPING = 3.0
"""Longest duration [s] of braking when the loop ends; then the loop stops the robot in any state."""
AT_REST = (Status.HOLDING, Status.RELEASED)
ASKED = {False: 1, True: 2}
"""Value of the field `asked_before` for two calls of the controller in a tick; the key is `enable` of the first."""
COLLECTED = 64
"""Number of ticks between two garbage collections of young objects, which take about 20 us."""


class Loop:
    """Runs a controller on a plant or device, one tick every `plant.dt`, with deadlines that do not drift.

    A tick reads the sensors, calls the controller and sends the command. The thread wakes slightly before the deadline
    and then busy-waits. If a tick starts more than one tick late, the loop skips and counts the missed ticks. All times
    are from `time.monotonic`, so changes of the wall clock have no effect.

    The controller gets `enabled=False`, and returns its fallback command, in three cases:

    - The dead man's switch was last reported as held more than `dead_man` ago, or `operator` has no record.
    - The measurement is older than `max_age`. If it becomes too old while the controller computes, the controller is
    called again with `enabled=False`.
    - One of `watches` returns a reason.

    The command's `reason` names the case. When the loop ends, the controller brakes the robot to rest; then the loop
    calls the device's `stop`. A lost device must brake by its own watchdog; the report marks the device as `lost`.

    Parameters
    ----------
    plant : simulated robot, already reset, or a device.
    decide : the controller as a function of a `Tick`.
    state : ring of `state_layout` records that the loop writes for viewers and loggers, or None.
    operator : ring of `operator_layout` records; if None, the controller is always enabled.
    max_age : largest age [s] of a measurement; by default 50 ms or three ticks, as for controllers.
    dead_man : longest time [s] since the last report of a held dead man's switch.
    watches : functions that return a reason to brake, such as a failed log, or an empty text.
    plant_command : function from a command to the plant's input; the command's `value` by default.
    fifo : SCHED_FIFO priority, 1 to 99; None for a normal thread. A FIFO thread blocks other threads on its core: a
        controller that takes longer than a tick occupies the core completely.

    Raises
    ------
    ConfigurationError : a time is out of range, or a ring has records of another layout.
    """

    def __init__(
        self,
        plant: Plant,
        decide: Decide,
        *,
        state: SharedRing | None = None,
        operator: SharedRing | None = None,
        max_age: float | None = None,
        dead_man: float = DEAD_MAN,
        watches: Sequence[Callable[[], str]] = (),
        plant_command: Callable[[Command], Array] = lambda command: command.value,
        fifo: int | None = None,
    ) -> None:
        self.dt = plant.dt
        self.max_age = default_max_age(self.dt) if max_age is None else max_age
        for name, value in (("max_age", self.max_age), ("dead_man", dead_man)):
            number = isinstance(value, (int, float, np.floating)) and not isinstance(value, bool)
            if not (number and self.dt < value < 10.0):
                raise ConfigurationError(name, value, f"seconds, more than a tick of {self.dt:g}, less than 10")
        if operator is not None and "heartbeat" not in (operator.layout.names or ()):
            raise ConfigurationError("operator", operator.name, "a ring of operator_layout records")
        self._plant, self._decide, self._operator = plant, decide, operator
        self._dead_man, self._watches, self._plant_command, self._fifo = dead_man, tuple(watches), plant_command, fifo
        layout = None if operator is None else operator.layout
        self._state = None if state is None else StateRecord(state, layout)

    def run(self, *, seconds: float = math.inf, until: Callable[[], bool | str] = lambda: False) -> LoopReport:
        """Run until `seconds` have passed, `until()` returns True or a text, or Ctrl-C or SIGTERM arrives; then brake.

        A lost device also ends the loop. If `until` returns a text, the text is the reason in the report.

        Raises
        ------
        ConfigurationError : the controller or the plant raises it, or a command has numbers that are not finite. Such a
            command is not sent, and a device is stopped before the error is raised.
        """
        run = _Run()
        with in_time(self._fifo) as scheduling, _between_ticks(run):
            run.early = sleep_overshoot(self.dt)
            run.start = monotonic() + self.dt
            try:
                reason = self._ticks(run, seconds, until)
            except DeviceLostError as gone:
                run.lost, reason = True, str(gone)
                self._tell_lost(run, reason)
            finally:
                if hasattr(type(self._plant), "stop"):
                    cast("Device", self._plant).stop()
        counts = run.ticks, run.missed, run.late, run.stale
        return LoopReport(*counts, run.lateness, run.tick_time, scheduling, reason, run.lost, run.scaling)

    def _ticks(self, run: _Run, seconds: float, until: Callable[[], bool | str]) -> str:
        """Run the ticks; return the reason why the loop ended."""
        reason = ""
        try:
            while not reason:
                self._tick(run, "")
                over = not (run.index + 1) * self.dt < seconds
                told: bool | str = f"{seconds:g} s have passed" if over else until()
                reason = (told if isinstance(told, str) else "on request" if told else "") or run.interrupted
        except KeyboardInterrupt:
            reason = "interrupted"
        begun = run.index
        while self._tick(run, reason).status not in AT_REST and (run.index - begun) * self.dt < STOPPING:
            pass
        return reason

    def _tick(self, run: _Run, fault: str) -> Command:
        begin = self._wait(run)
        plant, operator = self._plant, None if self._operator is None else self._operator.latest()
        seen, truth = plant.measured, plant.truth
        taken = monotonic()
        old = truth.time - seen.stamp  # age when it was read; both times are on the plant's clock
        held, unheld = self._held(None if operator is None else operator.record, taken)
        fault = fault or unheld or next(filter(None, (watch() for watch in self._watches)), "")
        if not -self.dt <= old <= self.max_age:
            run.stale, fault = run.stale + 1, self._too_old(old)
        tick = Tick(run.index, run.index * self.dt, seen, None if operator is None else operator.record, not fault)
        command = self._decide(tick)
        age, before = old + monotonic() - taken, 0
        if not age <= self.max_age and not fault:
            run.stale, fault = run.stale + 1, self._too_old(age)
            before, tick = ASKED[True], tick._replace(enabled=False)
            command = self._decide(tick)
        if fault:
            command = command._replace(reason=fault)
        plant_command = self._plant_command(command)
        if not np.isfinite(plant_command).all():
            raise ConfigurationError("command", plant_command, f"finite numbers, in tick {tick.number}")
        run.told = _Told(tick, truth, command)
        plant.step(plant_command, _push(tick.operator))
        run.scaling = min(run.scaling, getattr(plant, "scaling", 1.0))
        took = monotonic() - begin
        run.tick_time.add(took)
        run.ticks += 1
        if self._state is not None:
            self._state.write(
                *run.told, clock=begin, held=held, age=age, lateness=run.behind, tick_time=took, missed=run.missed,
                stale=run.stale, asked_before=before,
            )  # fmt: skip
        if run.ticks % COLLECTED == 0:
            gc.collect(1)
        return command

    def _wait(self, run: _Run) -> float:
        """Wait until the next deadline; return the time after waiting."""
        deadline = run.start + (run.index + 1) * self.dt
        left = deadline - monotonic()
        if left > run.early:
            time.sleep(left - run.early)
        now = monotonic()
        while now < deadline:
            now = monotonic()
        run.behind = now - deadline
        left_out = int(run.behind / self.dt)
        run.missed += left_out
        run.index += 1 + left_out
        run.late += run.behind > self.dt / 2
        run.lateness.add(run.behind)
        return now

    def _held(self, operator: np.void | None, now: float) -> tuple[bool, str]:
        """Whether the dead man's switch is held, and the reason if not."""
        if self._operator is None:
            return True, ""
        if operator is None:
            return False, "nobody operates the robot yet"
        ago = now - float(operator["heartbeat"])
        if -self.dt <= ago <= self._dead_man - self.dt:  # braking in the next tick would be too late
            return True, ""
        if not math.isfinite(ago) or ago < 0.0:
            return False, "the dead man's switch is not held"
        return False, f"the dead man's switch was last known to be held {ago:.2f} s ago, at most {self._dead_man:g} s"

    def _too_old(self, age: float) -> str:
        if age < 0.0:
            return f"the measured state's time stamp is {-1e3 * age:.0f} ms ahead: is it on another clock?"
        return f"the measured state is {1e3 * age:.0f} ms old, at most {1e3 * self.max_age:.0f} ms"

    def _tell_lost(self, run: _Run, reason: str) -> None:
        """Publish the command that a lost robot did not receive."""
        if self._state is None or run.told is None:
            return
        last = run.told.tick
        before = ASKED[last.enabled] if last.number == run.index else 0
        tick = last._replace(number=run.index, time=run.index * self.dt, enabled=False)
        command = self._decide(tick)._replace(reason=reason)
        self._state.write(
            tick, run.told.truth, command, clock=monotonic(), missed=run.missed, stale=run.stale, asked_before=before
        )


class _Told(NamedTuple):
    tick: Tick
    truth: Truth
    command: Command


class _Run:
    def __init__(self) -> None:
        self.index, self.ticks, self.missed, self.late, self.stale = -1, 0, 0, 0, 0
        self.early = self.start = self.behind = 0.0
        self.lateness, self.tick_time = Times(), Times()
        self.lost, self.interrupted, self.scaling = False, "", 1.0
        self.told: _Told | None = None


@contextmanager
def _between_ticks(run: _Run) -> Iterator[None]:
    """Delay Ctrl-C and SIGTERM to the end of a tick, so that the controller can brake and the log can be replayed."""
    asked = [each for each in (signal.SIGINT, signal.SIGTERM) if signal.getsignal(each) is not signal.SIG_IGN]
    if threading.current_thread() is not threading.main_thread():
        asked = []  # Python allows signal handlers in the main thread only

    def ask(number: int, frame: FrameType | None) -> None:
        if run.interrupted:  # a second signal: the controller may hang, so interrupt at once
            signal.default_int_handler(number, frame)
        run.interrupted = "interrupted" if number == signal.SIGINT else "ended by SIGTERM"

    before = {each: signal.signal(each, ask) for each in asked}
    try:
        yield
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)


def _push(operator: np.void | None) -> Any:
    """The operator's push (k,) [N] on a simulated robot's hand; None without a push."""
    if operator is None:
        return None
    push = operator["push"]
    return push if push.any() and np.isfinite(push).all() else None
