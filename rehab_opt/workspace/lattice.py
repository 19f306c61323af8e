"""A square lattice; each node's distance to the slice is searched from the postures of its neighbours."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rehab_opt.workspace.plane_search import Nearest, PlaneSearch

__all__ = ["Lattice", "Node", "TooManyNodesError"]

Array = NDArray[np.float64]
Key = tuple[int, int]

AROUND = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1))
IMPROVED = 1e-7
"""[m] Least decrease of the distance that counts as an improvement."""
SAME = 0.02
"""[rad or m] Postures nearer to each other count as equal starts."""
MAX_NODES = 2_000_000


class TooManyNodesError(Exception):
    """Internal error: the lattice is too fine for the set."""


@dataclass(slots=True)
class Node:
    """A node with its best answer so far; the distance is 0 inside the slice and infinite if nothing was found."""

    distance: float
    x: float
    y: float
    posture: Array | None
    offers: int = 0


class Lattice:
    """Nodes at (i, j) * spacing, created as the search spreads; every run gives the same nodes.

    A local minimum can make a reachable node look unreachable. Each improved answer is therefore offered to the
    neighbours as a start until nothing improves (label correcting), and every new node also tries the starts of
    `others`. Simultaneous offers are solved together; distances of outside nodes are accurate to a few per cent.

    Parameters
    ----------
    search : solver for one node.
    spacing : [m].
    others : function (x, y) -> further start postures, for points that the first offer did not reach.
    spreads : function (node) -> whether the node's neighbours are created.
    max_offers : number of unpromising postures of neighbours that an outside node tries.
    """

    def __init__(
        self,
        search: PlaneSearch,
        spacing: float,
        *,
        others: Callable[[float, float], Iterable[Array]],
        spreads: Callable[[Node], bool],
        max_offers: int,
    ) -> None:
        self.search, self.spacing, self.max_offers = search, spacing, max_offers
        self._others, self._spreads = others, spreads
        self.nodes: dict[Key, Node] = {}
        self._waiting: dict[Key, None] = {}
        """Nodes whose improvement is not yet offered to their neighbours, in order."""

    def key(self, x: float, y: float) -> Key:
        """Key of the node nearest to a point."""
        return round(x / self.spacing), round(y / self.spacing)

    def keys_around(self, x: float, y: float) -> Iterator[Key]:
        """Keys of the four nodes of the cell that contains a point."""
        i, j = int(np.floor(x / self.spacing)), int(np.floor(y / self.spacing))
        yield from ((i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1))

    def offer(self, offers: Iterable[tuple[Key, Array]]) -> None:
        """Try to improve nodes from offered start postures; all solves run together, and missing nodes are created."""
        asked: dict[Key, list[Array]] = {}
        for key, posture in offers:
            asked.setdefault(key, []).append(posture)
        new = [key for key in asked if key not in self.nodes]
        if len(self.nodes) + len(new) > MAX_NODES:
            raise TooManyNodesError
        known = [(key, posture) for key in asked if key in self.nodes for posture in asked[key]]
        for i, j in new:
            self.nodes[i, j] = Node(np.inf, i * self.spacing, j * self.spacing, None)
        self._try([*known, *((key, asked[key][0]) for key in new)])
        left = [key for key in new if self.nodes[key].distance > 0.0]
        self._try([(key, each) for key in left for each in (*asked[key][1:], *self._others(*self._at(key)))])
        for key in left:
            if self.nodes[key].posture is None:
                self._take(key, self.search.nearest(*self._at(key), asked[key][0]))
            if self.nodes[key].posture is None:
                self._take(key, self.search.by_backup(*self._at(key), asked[key][0]))

    def spread(self) -> None:
        """Offer improved postures to neighbours until no node improves any more."""
        while self._waiting:
            wave, self._waiting = self._waiting, {}
            offers: list[tuple[Key, Array]] = []
            others: list[tuple[Node, Key, Array]] = []
            for key in wave:
                self._to_neighbours(key, offers, others)
            self.offer([*offers, *self._worth_a_try(others)])

    def _to_neighbours(self, key: Key, offers: list[tuple[Key, Array]], others: list[tuple[Node, Key, Array]]) -> None:
        """Offer a node's posture to its neighbours: append it to `offers` if it is promising, else to `others`."""
        node, nodes, spacing = self.nodes[key], self.nodes, self.spacing
        posture = node.posture
        assert posture is not None
        makes = self._spreads(node)
        for di, dj in AROUND:
            i, j = other = (key[0] + di, key[1] + dj)
            known = nodes.get(other)
            if known is None:
                if makes:
                    offers.append((other, posture))
            elif known.distance > 0.0:
                # The point of the slice found for this node may be nearer to the other node than that node's own.
                if math.hypot(i * spacing - node.x, j * spacing - node.y) < known.distance - IMPROVED:
                    offers.append((other, posture))
                elif known.offers < self.max_offers:
                    others.append((known, other, posture))

    def _worth_a_try(self, others: list[tuple[Node, Key, Array]]) -> Iterator[tuple[Key, Array]]:
        """Select a few unpromising postures per node that differ from the node's own."""
        if not others:
            return
        own = np.array([posture if known.posture is None else known.posture for known, _, posture in others])
        unlike = np.abs(own - np.array([posture for _, _, posture in others])).max(axis=1) >= SAME
        for (known, key, posture), new in zip(others, unlike.tolist(), strict=True):
            if (new or known.posture is None) and known.offers < self.max_offers:
                known.offers += 1
                yield key, posture

    def _at(self, key: Key) -> tuple[float, float]:
        return key[0] * self.spacing, key[1] * self.spacing

    def _try(self, starts: list[tuple[Key, Array]]) -> None:
        if not starts:
            return
        probes = self.spacing * np.array([key for key, _ in starts], dtype=np.float64)
        below = np.array([self.nodes[key].distance for key, _ in starts])
        found = self.search.approached(probes, np.array([posture for _, posture in starts]), below)
        hands, distances = found.hands.tolist(), found.distances.tolist()
        for (key, _), distance, (x, y), posture in zip(starts, distances, hands, found.postures, strict=True):
            self._take(key, Nearest(distance, x, y, posture))

    def _take(self, key: Key, answer: Nearest | None) -> None:
        node = self.nodes[key]
        if answer is None or not answer.distance < node.distance:
            return
        if answer.distance > 0.0 and not answer.distance < node.distance - IMPROVED:
            return
        node.distance, node.x, node.y, node.posture = answer
        self._waiting[key] = None
