"""Access to the page of `rehab-opt live`: admitted requests, the commanding tab, its heartbeat and its inputs."""

from __future__ import annotations

import hmac
import math
import secrets
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from ipaddress import ip_address
from typing import Any
from urllib.parse import parse_qs

from rehab_opt.loop.loop import DEAD_MAN
from rehab_opt.session.live.problem import AT_REST, NOWHERE, LiveInputs

__all__ = ["Gate", "Seats", "inputs_of"]


class Gate:
    """Decides whether the server answers a request; the server checks every request first.

    A browser sends the page's origin (`Origin`) and the machine's name (`Host`) with each request. A page from another
    site cannot forge these headers, even under a name that resolves to 127.0.0.1.

    Parameters
    ----------
    names : names and addresses of this machine under which the page may be opened. port : port of the server.
    """

    def __init__(self, names: Iterable[str], port: int) -> None:
        self.token = secrets.token_urlsafe(24)
        called = frozenset(map(_as_called, names))
        self.hosts = frozenset(f"{name}:{port}" for name in called) | (called if port == 80 else frozenset())

    def refusal(self, target: str, hosts: Sequence[str], origins: Sequence[str], *, socket: bool) -> str:
        """Reason for refusing a request; empty if the request is admitted.

        Parameters
        ----------
        target : path and query of the request. hosts, origins : all values of the headers `Host` and `Origin`.
        socket : whether the request opens a websocket; then `Origin` is required.
        """
        if len(hosts) != 1 or hosts[0].lower() not in self.hosts:
            return "another host than this page's"
        if (
            len(origins) > 1
            or (socket and not origins)
            or any(each != f"http://{hosts[0].lower()}" for each in origins)
        ):
            return "another origin than this page's"
        given = parse_qs(target.partition("?")[2]).get("token", [])
        if len(given) != 1 or not hmac.compare_digest(given[0].encode(), self.token.encode()):
            return "no token, or a wrong one: use the printed address"
        return ""


def _as_called(name: str) -> str:
    """Name or address in the short form that browsers use."""
    with suppress(ValueError):
        name = str(ip_address(name))
    return f"[{name}]" if ":" in name else name.lower()


FARTHEST, STRONGEST, NOISIEST, LATEST = 20.0, 100.0, 0.05, 0.5
"""Largest accepted target [m], push [N], noise [rad, m], and delay [s]."""
OFTENEST, SPARE = 200.0, 50
"""Largest rate [1/s] and largest burst of a tab's messages; at a higher rate, messages would be old when read."""


def inputs_of(message: Mapping[str, Any], *, joints: int) -> LiveInputs | None:
    """Inputs in a page's message; None if the message lacks an input, or a number is not finite or is too large."""
    try:
        target = message["target"]
        (tx, ty, tz), (px, py, pz) = NOWHERE if target is None else target, message["push"]
        forward, left = message["stick"]
        inputs = LiveInputs(
            enable=message["enable"] is True,
            target=(float(tx), float(ty), float(tz)),
            push=(float(px), float(py), float(pz)),
            stick=(float(forward), float(left)),
            switch=message["switch"] is True,
            gripper=message["gripper"] is True,
            frozen=int(message["frozen"]),
            noise=float(message["noise"]),
            delay=float(message["delay"]),
        )
    except (KeyError, TypeError, ValueError, OverflowError):
        return None
    valid = (
        (target is None or all(abs(each) <= FARTHEST for each in inputs.target))
        and math.hypot(*inputs.push) <= STRONGEST
        and all(abs(each) <= 1.0 + 1e-9 for each in inputs.stick)
        and -1 <= inputs.frozen < joints
        and 0.0 <= inputs.noise <= NOISIEST
        and 0.0 <= inputs.delay <= LATEST
    )
    return inputs if valid else None


class Seats:
    """The open tabs of the page, by number; one of them commands the robot.

    The first tab commands until it closes or another tab takes command.

    Parameters
    ----------
    hands : number of hands, as in `LiveProblem`.

    Attributes
    ----------
    commander : number of the commanding tab, or None.
    lapsed : reason why the server released the dead man's switch; empty once the tab itself has released the switch.
    heartbeat : time [s] at which the last message with a held switch was sent; NaN if the switch is released.
    """

    def __init__(self, *, hands: int = 1) -> None:
        self._of = hands
        self.commander: int | None = None
        self.lapsed, self.heartbeat, self.inputs = "", math.nan, AT_REST
        self._tabs: dict[int, bool] = {}
        self._hands: dict[int, tuple[float, float, float]] = {}
        self._next = 0
        self._spare, self._heard = float(SPARE), -math.inf

    def join(self, *, participant: bool) -> int:
        """Add a tab and return its number; the first tab that is not a participant's takes command."""
        tab, self._next = self._next, self._next + 1
        self._tabs[tab] = participant
        if self.commander is None and not participant:
            self.take(tab)
        return tab

    def leave(self, tab: int) -> None:
        """Remove a tab whose connection is closed; if the tab commanded, no tab commands afterwards."""
        del self._tabs[tab]
        self._hands.pop(tab, None)
        if tab == self.commander:
            self.commander = None
            self._release()

    def take(self, tab: int) -> None:
        """Let a tab command, with the dead man's switch released; a participant's tab cannot command."""
        if self._tabs[tab] or tab == self.commander:
            return
        self.commander, self.lapsed = tab, ""
        self._release()

    def hear(self, tab: int, inputs: LiveInputs, *, now: float, sent: float | None = None) -> None:
        """Receive a heartbeat with a tab's inputs; a late heartbeat releases the dead man's switch.

        A heartbeat's age counts from `sent` [s], on the clock of `now` [s], so that queued heartbeats count as old. If
        `sent` is NaN, the switch counts as released.
        """
        if tab != self.commander:
            return
        sent = now if sent is None else min(sent, now)
        held, waited, silent = self.inputs.enable, now - sent, now - self._heard
        spare = min(SPARE, self._spare + OFTENEST * (now - self._heard)) - 1
        self._spare, self._heard = max(spare, -1.0), now
        if self._spare < 0:
            self.lapsed = "released: the page sends too much, so its messages would be late; press to continue"
        elif not inputs.enable:
            self.lapsed = ""
        elif held and not silent <= DEAD_MAN:
            self.lapsed = f"released: the page was silent for {1e3 * silent:.0f} ms; press to continue"
        elif not waited <= DEAD_MAN or (held and not sent - self.heartbeat <= DEAD_MAN):
            self.lapsed = "released: the page's messages come too late; press to continue"
        self.inputs = inputs._replace(enable=inputs.enable and not self.lapsed)
        self.heartbeat = sent if self.inputs.enable else math.nan

    def point(self, tab: int, hand: tuple[float, float, float] | None) -> None:
        """Set the hand's target [m] from a participant's tab; None for no target."""
        if hand is None or not all(abs(each) <= FARTHEST for each in hand):
            self._hands.pop(tab, None)
        elif self._tabs[tab]:
            self._hands[tab] = hand

    @property
    def current(self) -> LiveInputs:
        """Inputs of the commanding tab; a participant's tab, if any, sets the target of the participant's hand."""
        inputs = self.inputs if self._of == 1 else self.inputs._replace(target=NOWHERE, helper=self.inputs.target)
        hands = list(self._hands.values())
        return inputs._replace(target=hands[0]) if hands else inputs

    def state(self, tab: int) -> dict[str, Any]:
        """Message to a tab: whether the tab commands, how many tabs are open, and how many are participants'."""
        participants = sum(self._tabs.values())
        return {"commands": tab == self.commander, "tabs": len(self._tabs), "participants": participants}

    def _release(self) -> None:
        self.inputs, self.heartbeat = AT_REST, math.nan
