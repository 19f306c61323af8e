"""Distances of capsules, boxes and half-spaces, beside bounded least squares and hulls; contacts beside differences."""

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rehab_opt import Box
from rehab_opt.control.clearance_pairs import Kind, _kinds
from tests.control.clearance_world import box_apart, segments_apart

CAPSULES, BOX = _kinds()
ALONE = np.r_[np.zeros(7), np.ones(4)]
"""Of a pair at rest that tells of all its ends."""


def segments(rng: np.random.Generator, nearly: int) -> np.ndarray:
    """(4, 3) ends of two segments: anywhere, parallel, nearly parallel, or one of them in line with the other."""
    a, c = rng.uniform(-0.4, 0.4, (2, 3))
    b, d = a + rng.uniform(-0.4, 0.4, 3), c + rng.uniform(-0.4, 0.4, 3)
    if nearly:
        d = c + (b - a) * rng.uniform(-1, 1)
    if nearly == 2:
        d += rng.normal(size=3) * 10.0 ** rng.uniform(-9, -2)
    if nearly == 3:
        c = a + rng.uniform(0, 1) * (b - a)
        d = c + (d - c) * rng.uniform(0, 1)
    return np.array([a, b, c, d])


@pytest.mark.parametrize("nearly", [0, 1, 2, 3])
def test_distance_of_capsules_is_that_of_bounded_least_squares(nearly: int) -> None:
    rng, below = np.random.default_rng(nearly), 0
    for _ in range(150):
        ends = segments(rng, nearly)
        found = float(CAPSULES.distance(np.r_[ends.ravel(), np.zeros(6), 0.15]))
        assert found == pytest.approx(segments_apart(*ends) - 0.15, abs=1e-9)
        below += found < 0
    assert below > 3


def test_distance_of_capsule_and_box_is_that_of_least_squares_or_the_shortest_way_out() -> None:
    rng, deep = np.random.default_rng(0), 0
    for k in range(400):
        a, c = rng.uniform(-0.3, 0.3, (2, 3))
        turn = Rotation.random(rng=rng).as_matrix()
        b = a + (turn[:, k % 3] * rng.uniform(-0.4, 0.4) if k % 2 else rng.uniform(-0.4, 0.4, 3))  # along an edge, too
        box = Box("box", tuple(c), tuple(rng.uniform(0.1, 0.8, 3)), tuple(map(tuple, turn)))
        column = np.r_[a, b, turn.T.ravel(), c, np.array(box.size) / 2, 0.05]
        expected = box_apart(a, b, box) - 0.05
        assert float(BOX.distance(column)) == pytest.approx(expected, abs=1e-9)
        deep += expected < -0.05
    assert deep > 50


def moved(ends: np.ndarray, twist: np.ndarray) -> np.ndarray:
    """Ends (2, 3) after a small turn and shift (6,) of the body, about the origin."""
    return ends @ Rotation.from_rotvec(twist[:3]).as_matrix().T + twist[3:]


@pytest.mark.parametrize("kind", ["capsules", "box"])
def test_nearest_contact_says_how_the_distance_changes_with_any_motion(kind: str) -> None:
    rng, step = np.random.default_rng(3), 1e-6
    for _ in range(200):
        ends = segments(rng, 0)
        turn, half = Rotation.random(rng=rng).as_matrix(), rng.uniform(0.02, 0.1, 3)
        speeds = rng.normal(size=6)

        def column(
            first: np.ndarray,
            after: float,
            ends: np.ndarray = ends,
            turn: np.ndarray = turn,
            half: np.ndarray = half,
            speeds: np.ndarray = speeds,
        ) -> np.ndarray:
            if kind == "capsules":
                return np.r_[first.ravel(), ends[2:].ravel() + after * speeds, speeds, 0.1]
            return np.r_[first.ravel(), turn.T.ravel(), ends[2], half, 0.05]

        functions = CAPSULES if kind == "capsules" else BOX
        contacts = np.array(functions.contacts(column(ends[:2], 0.0), ALONE))
        normal, moment, speed = contacts[1:4, 0], contacts[4:7, 0], 0.0
        nearest = contacts[:, np.argmin(contacts[0])]
        assert nearest[0] == pytest.approx(float(functions.distance(column(ends[:2], 0.0))), abs=1e-12)
        if kind == "box" and nearest[0] < -0.05:
            continue  # where the segment cuts the box, the contact leads out through a face
        normal, moment, speed = nearest[1:4], nearest[4:7], nearest[7]
        for twist in np.eye(6):
            ahead, behind = (
                float(functions.distance(column(moved(ends[:2], side * step * twist), 0.0))) for side in (1, -1)
            )
            assert (ahead - behind) / (2 * step) == pytest.approx(np.r_[moment, normal] @ twist, abs=1e-4)
        ahead, behind = (float(functions.distance(column(ends[:2], side * step))) for side in (1, -1))
        assert (ahead - behind) / (2 * step) == pytest.approx(-speed, abs=1e-4)


def test_first_of_the_contacts_at_rest_is_the_nearest_also_of_bodies_that_are_nearly_balls() -> None:
    """However near each other two of them are: an arm gave way to the farther end of a bar 40 um long, and touched."""
    rng = np.random.default_rng(5)
    for _ in range(300):
        ends = segments(rng, 0)
        for k in (0, 2):
            ends[k + 1] = ends[k] + (ends[k + 1] - ends[k]) * rng.choice([1.0, 10.0 ** rng.uniform(-6, -2)])
        column = np.r_[ends.ravel(), np.zeros(6), 0.1]
        contacts = np.array(CAPSULES.contacts(column, ALONE))
        assert contacts[0, np.argmin(contacts[8])] == pytest.approx(float(CAPSULES.distance(column)), abs=1e-9)


@pytest.mark.parametrize("functions", [CAPSULES, BOX])
def test_contact_that_comes_faster_than_its_barrier_lets_it_is_ranked_by_its_room(functions: Kind) -> None:
    """However much nearer another one of its pair is: an elbow came to a box at 1.6 times what its barrier lets it."""
    rng, lead, far = np.random.default_rng(4), 0.8, 0
    for _ in range(200):
        ends, twist = segments(rng, 0), rng.normal(size=6)
        column = np.r_[ends.ravel(), np.zeros(6), 0.05]
        if functions is BOX:
            turn = Rotation.random(rng=rng).as_matrix()
            column = np.r_[ends[:2].ravel(), turn.T.ravel(), ends[2], rng.uniform(0.02, 0.1, 3), 0.05]
        contacts = np.array(functions.contacts(column, np.r_[twist, lead, np.ones(4)]))
        away, normal, moment, rank = contacts[0], contacts[1:4].T, contacts[4:7].T, contacts[8]
        room = away - lead * np.maximum(-np.hstack([moment, normal]) @ twist, 0.0)
        comes = room <= 0
        assert rank[comes] == pytest.approx(room[comes], abs=1e-9)
        assert np.all(rank[~comes] >= room[~comes] - 1e-9)
        far += np.sum(comes & (away > away.min() + 0.05))
    assert far > 30


def test_bodies_that_lie_along_each_other_touch_in_two_places_at_least() -> None:
    """The least tilt moves the nearest point from one to the other: rows hold both."""
    bar = np.array([[0.0, 0, 0], [0.5, 0, 0]])
    above = np.array([[-0.1, 0, 0.2], [0.3, 0, 0.2]])
    contacts = np.array(CAPSULES.contacts(np.r_[bar.ravel(), above.ravel(), np.zeros(6), 0.1], ALONE))
    places = np.cross(contacts[1:4].T, contacts[4:7].T)  # of the contact, without its part along the normal
    touching = np.abs(contacts[0] - 0.1) < 1e-12
    assert np.ptp(places[touching, 0]) == pytest.approx(0.3)
    box = np.r_[0.15, 0.0, 0.4, 0.2, 0.1, 0.1]
    contacts = np.array(BOX.contacts(np.r_[bar.ravel(), np.eye(3).ravel(), box, 0.1], ALONE))
    places = np.cross(contacts[1:4].T, contacts[4:7].T)
    touching = np.abs(contacts[0] - 0.2) < 1e-12
    assert np.ptp(places[touching, 0]) == pytest.approx(0.35)


def test_functions_give_numbers_for_bodies_in_any_place() -> None:
    rng = np.random.default_rng(5)
    for _ in range(300):
        points = rng.integers(-1, 2, (4, 3)) * 0.5  # ends that coincide, segments in one line, corners on edges
        column = np.r_[points.ravel(), np.zeros(6), 0.1]
        of_box = np.r_[points[:2].ravel(), np.eye(3).ravel(), points[2], 0.5, 0.5, 0.5, 0.1]
        near = np.r_[rng.normal(size=6), 0.1, rng.integers(0, 2, 4)]
        found = [
            each
            for kind, it in ((CAPSULES, column), (BOX, of_box))
            for each in (kind.contacts(it, near), kind.room(it, near), kind.distance(it))
        ]
        for each in found:
            assert np.all(np.isfinite(np.array(ca.DM(each))))
