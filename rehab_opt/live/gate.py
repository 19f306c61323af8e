"""Who may open the page: a token, and neither a foreign page nor a foreign name for this machine."""

from __future__ import annotations

import hmac
import secrets
from collections.abc import Iterable, Sequence
from urllib.parse import parse_qs, urlsplit

__all__ = ["Gate"]


class Gate:
    """Answers whether a request may pass; everything that serves the page asks it first.

    A browser names the page that a request comes from (`Origin`) and the name under which it found this machine
    (`Host`): a page of elsewhere, or a foreign name that leads to 127.0.0.1, cannot change either.

    Parameters
    ----------
    names : of this machine, under which the page may be called. port : that it listens on.
    """

    def __init__(self, names: Iterable[str], port: int) -> None:
        self.token = secrets.token_urlsafe(24)
        self.hosts = frozenset(f"[{name}]:{port}" if ":" in name else f"{name}:{port}" for name in names)

    def refusal(self, target: str, hosts: Sequence[str], origins: Sequence[str], *, socket: bool) -> str:
        """Why a request is refused; empty where it may pass.

        Parameters
        ----------
        target : path and query of the request. hosts, origins : all values of these headers.
        socket : whether it asks for a websocket, which every browser does with an origin.
        """
        if len(hosts) != 1 or hosts[0].lower() not in self.hosts:
            return "another host than this page's"
        if (
            len(origins) > 1
            or (socket and not origins)
            or any(each != f"http://{hosts[0].lower()}" for each in origins)
        ):
            return "another origin than this page's"
        given = parse_qs(urlsplit(target).query).get("token", [])
        if len(given) != 1 or not hmac.compare_digest(given[0].encode(), self.token.encode()):
            return "no token, or a wrong one: use the printed address"
        return ""
