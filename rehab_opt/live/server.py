"""Server of the page of `rehab-opt live`, which sends the robot's state to the open tabs and reads their inputs."""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import secrets
import time
from collections.abc import Callable, Mapping
from http import HTTPStatus
from importlib.resources import files
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qs

import numpy as np

from rehab_opt.control.command import Relaxed
from rehab_opt.errors import ConfigurationError, RehabOptError
from rehab_opt.live.control import Rings
from rehab_opt.live.seats import Gate, Seats, inputs_of
from rehab_opt.loop.of_problem import BUTTONS
from rehab_opt.loop.shared_ring import Newest
from rehab_opt.session.live.problem import LiveProblem, Seen, Watching

if TYPE_CHECKING:
    from websockets.asyncio.server import Server, ServerConnection
    from websockets.http11 import Request, Response

__all__ = ["LivePage"]

FRAMES_HZ = 30.0
SILENT = 0.5
"""Time [s] without data from the controller's process after which the page reports a loss."""
LARGEST = 4096
"""Largest size [byte] of a message from a page."""
PAGES = ("/", "/participant")


class LivePage:
    """Server of one problem's page.

    Parameters
    ----------
    problem : problem to draw; its controller runs in another process. rings : rings shared with that process.
    scene : connection on which `control_live` sends the scene.
    alive : function that returns whether the controller's process runs.
    watching : object that gets the plotted values, even without an open tab, or None.
    """

    def __init__(
        self,
        problem: LiveProblem,
        rings: Rings,
        scene: Connection,
        *,
        alive: Callable[[], bool],
        watching: Watching | None = None,
    ) -> None:
        self._watching = watching
        self._problem, self._sent, self._alive = problem, scene, alive
        self._given, self._state, self._shown = rings
        self._seats = Seats(hands=problem.hands)
        self._refused = ""
        self._tabs: dict[int, _Tab] = {}
        self._scene = ""

    async def serve(self, host: str, port: int, *, ready: Callable[[str, str], None]) -> None:
        """Serve until cancelled; `ready` gets the addresses of the page and of the participant's page.

        Raises
        ------
        ConfigurationError : the address is not available, or websockets is not installed.
        RehabOptError : the controller's process reports an invalid problem.
        """
        serve = _websockets()
        try:
            server: Server = await serve(
                self._hear, host, port, process_request=self._request, max_size=LARGEST, compression=None
            )
        except OSError as refused:
            raise ConfigurationError(
                "--host, --port", f"{host}:{port}", f"a free address ({refused.strerror})"
            ) from refused
        async with server:
            bound = next(iter(server.sockets)).getsockname()[1]
            self._gate = Gate(
                {host, *(("localhost", "127.0.0.1") if host in {"127.0.0.1", "localhost"} else ())}, bound
            )
            named = f"[{host}]" if ":" in host else host
            page, participant = (f"http://{named}:{bound}{path}?token={self._gate.token}" for path in PAGES)
            ready(page, participant)
            asyncio.get_running_loop().add_reader(self._sent.fileno(), self._begin)
            await self._tell()
            raise RehabOptError(self._refused)

    # ------------------------------------------------------------------------------------------------ requests
    def _request(self, connection: ServerConnection, request: Request) -> Response | None:
        path, headers = request.path.partition("?")[0], request.headers
        socket = path == "/ws"
        refusal = self._gate.refusal(request.path, headers.get_all("Host"), headers.get_all("Origin"), socket=socket)
        if refusal:
            return connection.respond(HTTPStatus.FORBIDDEN, f"{refusal}\n")
        if socket:
            return None
        if path not in PAGES:
            return connection.respond(HTTPStatus.NOT_FOUND, "not a page\n")
        nonce = secrets.token_urlsafe(12)
        response = connection.respond(HTTPStatus.OK, _page(nonce))
        del response.headers["Content-Type"]
        response.headers.update(
            {
                "Content-Type": "text/html; charset=utf-8",
                "Content-Security-Policy": (
                    f"default-src 'none'; script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'; "
                    f"connect-src 'self' ws://{headers['Host']}; img-src data:; base-uri 'none'; frame-ancestors 'none'"
                ),
                "Referrer-Policy": "no-referrer",
                "X-Content-Type-Options": "nosniff",
                "Cache-Control": "no-store",
            }
        )
        return response

    async def _hear(self, connection: ServerConnection) -> None:
        """Serve one tab until its connection closes."""
        from websockets.exceptions import ConnectionClosed  # noqa: PLC0415

        view = parse_qs(connection.request.path.partition("?")[2] if connection.request else "").get("view", [""])[0]
        tab = self._seats.join(participant=view == "participant" or self._problem.logged)
        told = self._tabs[tab] = _Tab(connection)
        telling = asyncio.create_task(told.tell())
        if self._scene:
            told.queue(self._scene)
        self._seat()
        try:
            async for text in connection:
                self._obey(tab, text)
        except ConnectionClosed:
            pass
        finally:
            telling.cancel()
            del self._tabs[tab]
            self._seats.leave(tab)
            self._pass_on()
            self._seat()

    def _obey(self, tab: int, text: str | bytes) -> None:
        try:
            message = json.loads(text, parse_int=float)
        except (ValueError, RecursionError):
            return
        if not isinstance(message, dict):
            return
        if message.get("take") is True:
            self._seats.take(tab)
            self._seat()
        elif isinstance(message.get("inputs"), dict):
            inputs = inputs_of(message["inputs"], joints=self._problem.encoders)
            if inputs is not None:
                sent = message.get("clock")
                sent = sent if isinstance(sent, float) else math.nan
                self._seats.hear(tab, inputs, now=time.monotonic(), sent=sent)
        elif "hand" in message:
            self._seats.point(tab, _place(message["hand"]))
        self._pass_on()

    def _pass_on(self) -> None:
        """Write the current inputs to the ring that the controller's process reads."""
        current, record = self._seats.current, self._given.record
        record["heartbeat"] = self._seats.heartbeat
        record["target"][...] = np.eye(4)
        for pose, place in zip(record["target"], (current.target, current.helper), strict=False):
            pose[:3, 3] = place
        record["push"][...], record["stick"][...] = current.push[: self._problem.force], current.stick
        record["buttons"] = sum(bit for name, bit in BUTTONS.items() if getattr(current, name))
        record["frozen"][...] = np.arange(self._problem.encoders) == current.frozen
        record["noise"], record["delay"] = current.noise, current.delay
        self._given.publish()

    def _seat(self) -> None:
        for number, tab in self._tabs.items():
            tab.queue(_told({"seat": self._seats.state(number)}))

    # -------------------------------------------------------------------------------------------------- frames
    def _begin(self) -> None:
        """Read the scene or an error message from the controller's process."""
        try:
            sent = self._sent.recv()
        except EOFError:
            asyncio.get_running_loop().remove_reader(self._sent.fileno())
            return
        if isinstance(sent, str):
            self._refused = sent
            return
        self._scene = _told({"scene": _scene(self._problem, sent)})
        if self._watching is not None:
            self._watching.begin(sent["plots"])
        for tab in self._tabs.values():
            tab.queue(self._scene)

    async def _tell(self) -> None:
        """Send the state to every tab until the controller's process reports an error."""
        last, absent = -1, False
        while not self._refused:
            await asyncio.sleep(1 / FRAMES_HZ)
            state, shown = self._state.latest(), self._shown.latest()  # in this order, the drawn data are never older
            text = self._absence(state)
            if absent and not text:
                self._seat()  # after a loss, tabs need to know again which of them commands
            absent = bool(text)
            if text:
                for tab in self._tabs.values():
                    tab.show(_told({"lost": text}))
            elif state is not None and shown is not None and state.number != last:
                last, text = state.number, self._frame(state.record, shown.record)
                for tab in self._tabs.values():
                    tab.show(text)

    def _absence(self, state: Newest | None) -> str:
        """Reason why no state can be shown; empty if there is a state or one is expected soon."""
        if not self._alive():
            return "the controller's process has ended: the robot gets no commands; start rehab-opt live again"
        silent = 0.0 if state is None else time.monotonic() - state.time
        return f"the controller's process is silent for {silent:.1f} s" if silent > SILENT else ""

    def _frame(self, state: np.void, shown: np.void) -> str:
        frame = self._problem.frame({name: np.atleast_1d(shown[name]) for name in self._problem.layout})
        if self._watching is not None:
            self._watching.see(_seen(state, frame))
        frame["numbers"] = [*frame["numbers"], 1e3 * float(state["tick_time"])]
        relaxed = (Relaxed(int(state["relaxed"])).name or "").lower().replace("|", ", ")
        words = {
            "status": _text(state["status"]),
            "reason": _text(state["reason"]),
            "relaxed": "" if relaxed == "nothing" else relaxed,
            "mode": _text(shown["mode"]),
        }
        late = f"{state['time']:.1f} s · {int(state['missed'])} ticks left out · {int(state['stale'])} stale"
        return _told(
            {
                "frame": frame, "words": words, "time": float(state["time"]), "late": late,
                "lapsed": self._seats.lapsed, "clock": time.monotonic(),
            }
        )  # fmt: skip


class _Tab:
    """Queue of messages to one tab; a slow tab misses frames."""

    def __init__(self, connection: ServerConnection) -> None:
        self._connection, self._waiting = connection, asyncio.Event()
        self._queue: list[str] = []
        self._frame: str | None = None

    def queue(self, text: str) -> None:
        self._queue.append(text)
        self._waiting.set()

    def show(self, frame: str) -> None:
        self._frame = frame
        self._waiting.set()

    async def tell(self) -> None:
        from websockets.exceptions import ConnectionClosed  # noqa: PLC0415

        with contextlib.suppress(ConnectionClosed):
            while True:
                await self._waiting.wait()
                self._waiting.clear()
                texts, self._queue = self._queue, []
                if self._frame is not None:
                    texts.append(self._frame)
                    self._frame = None
                for text in texts:
                    await self._connection.send(text)


def _seen(state: np.void, frame: Mapping[str, Any]) -> Seen:
    hand = frame.get("handles", {}).get("hand")
    return Seen(
        float(state["time"]), bool(state["enabled"]), _text(state["status"]), _text(state["reason"]),
        int(state["missed"]), int(state["stale"]), None if hand is None else tuple(hand), tuple(frame["numbers"]),
    )  # fmt: skip


def _text(field: bytes) -> str:
    return field.decode(errors="replace")


def _page(nonce: str) -> str:
    folder = files("rehab_opt.live")
    page, script = ((folder / name).read_text(encoding="utf-8") for name in ("page.html", "page.js"))
    return page.replace("NONCE", nonce).replace("SCRIPT", script)


def _scene(problem: LiveProblem, sent: dict[str, Any]) -> dict[str, Any]:
    return sent | {"plots": [*sent["plots"], {"name": "tick", "unit": "ms", "line": 1e3 * problem.dt}]}


def _place(hand: object) -> tuple[float, float, float] | None:
    try:
        x, y, z = map(float, hand)  # type: ignore[call-overload]
    except (TypeError, ValueError, OverflowError):
        return None
    return (x, y, z) if all(map(math.isfinite, (x, y, z))) else None


def _told(message: dict[str, Any]) -> str:
    """Message as JSON, with null for infinity and NaN."""
    return json.dumps(_finite(message), allow_nan=False)


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {name: _finite(each) for name, each in value.items()}
    return list(map(_finite, value)) if isinstance(value, (list, tuple)) else value


def _websockets() -> Callable[..., Any]:
    try:
        from websockets.asyncio.server import serve  # noqa: PLC0415
    except ImportError as absent:
        raise ConfigurationError("live", "websockets is not installed", "pip install 'rehab_opt[live]'") from absent
    return serve
