"""A square lattice whose nodes learn their distance to the slice from each other."""

from __future__ import annotations

from collections import deque
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
"""[m] An answer counts as better from here on."""
MOST_OFFERS = 3
"""Postures of neighbours that a node outside tries although they promise nothing."""
SAME = 0.02
"""[rad or m] Postures nearer to each other than this lead to the same answer."""
MOST_NODES = 2_000_000


class TooManyNodesError(Exception):
    """The lattice is too fine for the set; internal."""


@dataclass(slots=True)
class Node:
    """Best answer so far; distance 0 is inside, infinite where nothing was found."""

    distance: float
    x: float
    y: float
    posture: Array | None
    offers: int = 0


class Lattice:
    """Nodes at (i, j) * spacing, made as the search spreads; deterministic.

    A local minimum can call a reachable node unreachable. So a node's better answer is offered to its neighbours as a
    start until nothing improves (label correcting), and every new node also tries what `others` names.

    Parameters
    ----------
    search : answers.
    spacing : [m].
    others : from a point, further postures to start from where the first offer did not reach it.
    spreads : from a node, whether its neighbours are to be made.
    """

    def __init__(
        self,
        search: PlaneSearch,
        spacing: float,
        *,
        others: Callable[[float, float], Iterable[Array]],
        spreads: Callable[[Node], bool],
    ) -> None:
        self.search, self.spacing = search, spacing
        self._others, self._spreads = others, spreads
        self.nodes: dict[Key, Node] = {}
        self._queue: deque[Key] = deque()
        self._waiting: set[Key] = set()

    def key(self, x: float, y: float) -> Key:
        """The node nearest to a point."""
        return round(x / self.spacing), round(y / self.spacing)

    def keys_around(self, x: float, y: float) -> Iterator[Key]:
        """The four nodes of the cell that holds a point."""
        i, j = int(np.floor(x / self.spacing)), int(np.floor(y / self.spacing))
        yield from ((i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1))

    def offer(self, key: Key, posture: Array, *, promising: bool = True) -> Node:
        """Let a node try a start; made if it is new."""
        x, y = key[0] * self.spacing, key[1] * self.spacing
        node = self.nodes.get(key)
        if node is None:
            if len(self.nodes) >= MOST_NODES:
                raise TooManyNodesError
            node = self.nodes[key] = Node(np.inf, x, y, None)
            self._take(key, node, self.search.nearest(x, y, posture))
            if node.distance > 0.0:
                for other in self._others(x, y):
                    self._take(key, node, self.search.nearest(x, y, other))
                    if node.distance == 0.0:
                        break
            if node.posture is None:
                self._take(key, node, self.search.by_backup(x, y, posture))
            return node
        if node.distance == 0.0:
            return node
        if not promising:
            if node.offers >= MOST_OFFERS:
                return node
            if node.posture is not None and float(np.abs(node.posture - posture).max()) < SAME:
                return node
            node.offers += 1
        self._take(key, node, self.search.nearest(x, y, posture))
        return node

    def spread(self) -> None:
        """Go on until no node can improve another."""
        while self._queue:
            key = self._queue.popleft()
            self._waiting.discard(key)
            node = self.nodes[key]
            assert node.posture is not None
            makes = self._spreads(node)
            for di, dj in AROUND:
                other = (key[0] + di, key[1] + dj)
                known = self.nodes.get(other)
                if known is None:
                    if makes:
                        self.offer(other, node.posture)
                elif known.distance > 0.0:
                    # The slice's point that belongs to this node may be nearer than what the other one knows.
                    here = np.hypot(other[0] * self.spacing - node.x, other[1] * self.spacing - node.y)
                    self.offer(other, node.posture, promising=bool(here < known.distance - IMPROVED))

    def _take(self, key: Key, node: Node, answer: Nearest | None) -> None:
        if answer is None or not answer.distance < node.distance:
            return
        if answer.distance > 0.0 and not answer.distance < node.distance - IMPROVED:
            return
        node.distance, node.x, node.y, node.posture = answer
        if key not in self._waiting:
            self._waiting.add(key)
            self._queue.append(key)
