"""Nobody gets in without the token, from another page, or by another name for this machine: asked with raw sockets."""

from __future__ import annotations

import socket

import pytest

from rehab_opt import ConfigurationError
from rehab_opt.cli import main
from rehab_opt.live.seats import Gate
from rehab_opt.live.session import show_live

from .conftest import Address

SOCKET = (
    "Upgrade: websocket",
    "Connection: Upgrade",
    "Sec-WebSocket-Version: 13",
    "Sec-WebSocket-Key: " + "A" * 22 + "==",
)


def answer(port: int, target: str, *headers: str) -> str:
    """Status and body of one request, byte by byte as written here."""
    with socket.create_connection(("127.0.0.1", port), timeout=20) as line:
        line.sendall("\r\n".join((f"GET {target} HTTP/1.1", *headers, "", "")).encode())
        text = b""
        while b"\r\n\r\n" not in text and (part := line.recv(65536)):
            text += part
        return text.decode(errors="replace")


def test_the_page_is_given_to_whoever_has_the_token(address: Address) -> None:
    text = answer(address.port, f"/?token={address.token}", f"Host: 127.0.0.1:{address.port}")
    assert text.startswith("HTTP/1.1 200 ")
    assert "default-src 'none'" in text
    assert f"connect-src 'self' ws://127.0.0.1:{address.port};" in text  # of [::1] browsers understand the first alone
    assert "Referrer-Policy: no-referrer" in text


@pytest.mark.parametrize("path", ["/", "/participant", "/ws", "/nothing"])
@pytest.mark.parametrize("query", ["", "?token=", "?token=wrong", "?token={token}x", "?token={token}&token={token}"])
def test_without_the_token_everything_is_refused(address: Address, path: str, query: str) -> None:
    own = f"127.0.0.1:{address.port}"
    target = path + query.format(token=address.token)
    text = answer(address.port, target, f"Host: {own}", f"Origin: http://{own}", *(SOCKET if path == "/ws" else ()))
    assert text.startswith("HTTP/1.1 403 ")
    assert address.token not in text


def test_a_foreign_name_of_this_machine_none_or_two_and_a_target_that_is_no_path_are_refused(address: Address) -> None:
    own, page = f"127.0.0.1:{address.port}", f"/?token={address.token}"
    for host in (f"evil.example:{address.port}", "127.0.0.1", "127.0.0.1:1", f"127.0.0.1.evil.example:{address.port}"):
        assert answer(address.port, page, f"Host: {host}").startswith("HTTP/1.1 403 ")
    for hosts in ((), (own, own), (own, "evil.example")):
        assert not answer(address.port, page, *(f"Host: {host}" for host in hosts)).startswith("HTTP/1.1 200 ")
    assert answer(address.port, "//[", f"Host: {own}").startswith("HTTP/1.1 403 ")


@pytest.mark.parametrize(
    "origin", [None, "null", "http://evil.example", "https://127.0.0.1:{port}", "http://127.0.0.1:1"]
)
def test_a_socket_from_another_page_is_refused_even_with_the_token(address: Address, origin: str | None) -> None:
    said = () if origin is None else ("Origin: " + origin.format(port=address.port),)
    target = f"/ws?token={address.token}"
    text = answer(address.port, target, f"Host: 127.0.0.1:{address.port}", *SOCKET, *said)
    assert text.startswith("HTTP/1.1 403 ")


def test_a_socket_of_the_page_itself_is_opened(address: Address) -> None:
    own = f"127.0.0.1:{address.port}"
    text = answer(address.port, f"/ws?token={address.token}", f"Host: {own}", f"Origin: http://{own}", *SOCKET)
    assert text.startswith("HTTP/1.1 101 ")


def test_every_page_has_a_token_of_its_own() -> None:
    assert len({Gate(["127.0.0.1"], 80).token for _ in range(100)}) == 100
    assert len(Gate(["127.0.0.1"], 80).token) >= 32


@pytest.mark.parametrize("host", ["0.0.0.0", "::", ""])
def test_all_addresses_at_once_are_refused(host: str) -> None:
    with pytest.raises(ConfigurationError, match="--host"):
        show_live("robot/ur5_circle", host=host, ready=lambda *_: None)


def test_a_problem_that_does_not_run_live_is_refused_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    for command, name in (("live", "workspace"), ("live", "figure_eight"), ("loop", "figure_eight")):
        with pytest.raises(SystemExit) as ended:
            main([command, f"upper_limb/{name}"])
        assert ended.value.code == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert f"FILE = 'upper_limb/{name}': expected a problem with a controller in a loop, as those of system" in line
        assert line.endswith("has none: rehab-opt run")
