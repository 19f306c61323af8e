"""The paper's path planning: A* over hand positions with three lists and a pull to the reference path.

Xu, Guo, Zhang 2021. Our copy of the paper lacks the equations and numbers, so this is a reconstruction from its
description: open, closed and result lists; f = g + h plus a pull to the nearest reference position; positions with a
manipulability below the threshold are blocked. Our choices are the lattice, the weight of the pull, and the hand's
orientation, which is that of the nearest reference pose. The search runs in stretches between reference poses that are
not blocked: otherwise the path of a motion that returns to its start would be empty.
"""

from __future__ import annotations

import heapq
import itertools
import math
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics.chain import SerialChain

__all__ = ["AStarPath", "astar_path"]

Array = NDArray[np.float64]
Cell = tuple[int, int, int]

STEPS = [step for step in itertools.product((-1, 0, 1), repeat=3) if any(step)]
NEWTON, ACCURATE, REACH = 12, 1e-6, 0.3
"""Inverse kinematics: number of Newton steps, largest final error [m, rad], largest joint step [rad]."""


@dataclass(frozen=True)
class AStarPath:
    """Result of the search."""

    q: Array
    """(M, n) joint positions along the path."""
    positions: Array
    """(M, 3) [m] hand positions."""
    nearest: NDArray[np.int64]
    """(M,) reference sample nearest to each position."""
    complete: bool
    """Whether a path was found for every stretch."""
    expanded: int
    """Number of positions that were taken from the open list."""
    blocked: int
    """Number of blocked positions."""
    seconds: float
    """Computing time."""

    def deviations(self, reference: ArrayLike) -> Array:
        """(N,) [m] distance of each reference position (N, 3) from the nearest point of the path."""
        points = np.array(reference, dtype=np.float64)
        if len(self.positions) < 2:
            return np.asarray(np.linalg.norm(points - self.positions[:1], axis=1))
        a, b = self.positions[:-1], self.positions[1:]
        way = b - a
        length = np.maximum(np.sum(way**2, axis=1), 1e-18)
        found = np.empty(len(points))
        for i, point in enumerate(points):
            fraction = np.clip(np.sum((point - a) * way, axis=1) / length, 0.0, 1.0)
            found[i] = np.linalg.norm(a + fraction[:, None] * way - point, axis=1).min()
        return found


def astar_path(
    chain: SerialChain,
    poses: ArrayLike,
    start: ArrayLike,
    *,
    floor: float,
    max_manipulability: float,
    resolution: float = 0.002,
    stretch: float = 0.03,
    pull: float = 4.0,
    max_expansions: int = 200_000,
) -> AStarPath:
    """Plan hand positions along a reference, with the manipulability above a threshold.

    Parameters
    ----------
    chain : the arm.
    poses : (N, 4, 4) reference.
    start : (n,) joint positions at the first pose; the search stays in this branch.
    floor : manipulability floor, as a fraction of `max_manipulability`.
    resolution : [m] of the lattice; our choice.
    stretch : [m] of reference path per search; our choice. A stretch ends at a reference pose that is not blocked.
    pull : weight in f of the distance to the nearest reference position; our choice.
    max_expansions : largest number of expanded positions per stretch.
    """
    reference = np.array(poses, dtype=np.float64)
    q = np.array(start, dtype=np.float64)
    if reference.ndim != 3 or reference.shape[1:] != (4, 4) or q.shape != (chain.n,):
        raise ConfigurationError("poses, start", (reference.shape, q.shape), f"(N, 4, 4) and ({chain.n},)")
    begun = time.perf_counter()
    search = _Search(
        chain, reference, floor * max_manipulability, resolution=resolution, pull=pull, max_expansions=max_expansions
    )
    result_q, result_at, first, complete = [q], [0], 0, True
    for last in _ends(reference, stretch):
        goal = search.free_from(last, result_q[-1])
        if goal is None or goal <= first:
            continue
        found = search.path(result_q[-1], first, goal)
        if found is None:
            complete = False
            break
        result_q += found[0]
        result_at += found[1]
        first = goal
    positions = np.array([chain.pose(each)[:3, 3] for each in result_q])
    seconds = time.perf_counter() - begun
    return AStarPath(
        np.array(result_q), positions, np.array(result_at), complete, search.expanded, search.blocked, seconds
    )


def _ends(reference: Array, stretch: float) -> list[int]:
    """Indices of the samples where stretches of length `stretch` [m] end; the last sample is one of them."""
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(reference[:, :3, 3], axis=0), axis=1))])
    marks = np.arange(stretch, way[-1], stretch)
    return [*np.searchsorted(way, marks).tolist(), len(reference) - 1]


class _Search:
    def __init__(
        self,
        chain: SerialChain,
        reference: Array,
        threshold: float,
        *,
        resolution: float,
        pull: float,
        max_expansions: int,
    ) -> None:
        self.chain, self.reference, self.threshold = chain, reference, threshold
        self.resolution, self.pull, self.max_expansions = resolution, pull, max_expansions
        self.expanded = self.blocked = 0
        self.places = reference[:, :3, 3]

    def free_from(self, sample: int, q: Array) -> int | None:
        """Try every fifth sample from `sample` on; return the first whose pose is not blocked, or None."""
        for i in range(sample, len(self.reference), 5):
            there = self.joints(self.reference[i], q, patient=True)
            if there is not None and self.chain.manipulability(there) >= self.threshold:
                return i
            q = q if there is None else there
        return None

    def path(self, q: Array, first: int, last: int) -> tuple[list[Array], list[int]] | None:
        """Two lists for the path from sample `first` to `last`: joint positions, nearest samples. None if none."""
        origin, goal = self.chain.pose(q)[:3, 3], self.places[last]
        window = slice(first, last + 1)
        open_list: list[tuple[float, int, Cell]] = []
        order = itertools.count()
        start: Cell = (0, 0, 0)
        costs, parents, joints, samples = {start: 0.0}, {start: start}, {start: q}, {start: first}
        closed: set[Cell] = set()
        heapq.heappush(open_list, (0.0, next(order), start))
        for _ in range(self.max_expansions):
            if not open_list:
                return None
            _, _, cell = heapq.heappop(open_list)
            if cell in closed:
                continue
            closed.add(cell)
            self.expanded += 1
            place = origin + self.resolution * np.array(cell)
            if math.dist(place, goal) < self.resolution:
                return self._result(cell, start=start, parents=parents, joints=joints, samples=samples, last=last)
            for step in STEPS:
                near = (cell[0] + step[0], cell[1] + step[1], cell[2] + step[2])
                if near in closed:
                    continue
                there = origin + self.resolution * np.array(near)
                cost = costs[cell] + self.resolution * math.hypot(*step)
                if near in costs and cost >= costs[near]:
                    continue
                away = np.linalg.norm(self.places[window] - there, axis=1)
                sample = first + int(np.argmin(away))
                pose = self.reference[sample].copy()
                pose[:3, 3] = there
                found = self.joints(pose, joints[cell])
                if found is None or self.chain.manipulability(found) < self.threshold:
                    self.blocked += 1
                    closed.add(near)  # blocked
                    continue
                costs[near], parents[near], joints[near], samples[near] = cost, cell, found, sample
                estimate = cost + math.dist(there, goal) + self.pull * float(away.min())
                heapq.heappush(open_list, (estimate, next(order), near))
        return None

    def _result(
        self, cell: Cell, *, start: Cell, parents: dict[Cell, Cell], joints: dict[Cell, Array],
        samples: dict[Cell, int], last: int,
    ) -> tuple[list[Array], list[int]]:  # fmt: skip
        """Joint positions and nearest samples of the result list, traced from the goal back through the parents."""
        q, at = [], []
        end = self.joints(self.reference[last], joints[cell], patient=True)
        if end is not None:
            q, at = [end], [last]
        while cell != start:
            q.append(joints[cell])
            at.append(samples[cell])
            cell = parents[cell]
        return q[::-1], at[::-1]

    def joints(self, pose: Array, near: Array, *, patient: bool = False) -> Array | None:
        """Joint positions for `pose` within the limits, by Newton's method from `near`; None if not found."""
        q = near.copy()
        for _ in range(4 * NEWTON if patient else NEWTON):
            here = self.chain.pose(q)
            error = np.append(pose[:3, 3] - here[:3, 3], _turn(pose[:3, :3] @ here[:3, :3].T))
            if float(np.abs(error).max()) < ACCURATE:
                inside = np.all((q >= self.chain.lower) & (q <= self.chain.upper))
                return q if inside else None
            jacobian = self.chain.jacobian(q)
            step = np.linalg.solve(jacobian.T @ jacobian + 1e-8 * np.eye(len(q)), jacobian.T @ error)
            size = float(np.abs(step).max())
            if not size < math.inf:
                return None
            q = q + step * min(1.0, REACH / max(size, 1e-12))
        return None


def _turn(rotation: Array) -> Array:
    """(3,) rotation vector of a rotation matrix (3, 3), for angles below 180 degrees."""
    skew = 0.5 * np.array(
        [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    )
    sine, cosine = float(np.linalg.norm(skew)), 0.5 * (float(np.trace(rotation)) - 1.0)
    return skew if sine < 1e-9 else np.asarray(skew * (math.atan2(sine, cosine) / sine))
