"""Whole arms keep clear of what is around them, judged by kinematics and distances of their own."""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from rehab_opt import (
    DH,
    Box,
    Capsule,
    Clearance,
    ConfigurationError,
    KeepOut,
    Limit,
    LinkCapsule,
    MirrorTracker,
    MovingCapsule,
    PoseTracker,
    RedundancyResolver,
    Relaxed,
    SerialChain,
    Status,
    arm_on_chair,
    ur5,
)
from rehab_opt.kinematics.room import MOVING, moving_numbers
from tests.control.clearance_world import MARGIN, Swinging, least_distance, link_ends, robot, room, segments_apart
from tests.control.mirror_campaign import LARGEST
from tests.refusals import refuses

START = np.array([0.3, -1.4, 1.9, -1.9, -1.2, 0.4])
BALL = MovingCapsule((0.6, 0.0, 0.9), (0.6, 0.0, 0.9), 0.05)


def ends(chain: SerialChain, q: np.ndarray) -> np.ndarray:
    return link_ends(chain, q[None])[0]


@pytest.mark.parametrize(("kind", "seed"), [("panda", 1)])
def test_rows_say_how_the_nearest_distances_change(kind: str, seed: int) -> None:
    rng, step = np.random.default_rng(seed), 1e-6
    chain = robot(kind, rng)
    tracker = PoseTracker(chain, limits=[room(chain, rng, moving=2)], compile=False)
    pairs = tracker.limits.clearance
    assert pairs is not None
    found = 0
    for _ in range(30):
        bodies = Swinging.drawn(rng, 2, 0.1).at(np.zeros(2), np.ones(2))
        q, velocity, told = (
            rng.uniform(0.7 * np.maximum(chain.lower, -3), 0.7 * np.minimum(chain.upper, 3)),
            rng.normal(size=chain.n),
            moving_numbers(bodies, 2).ravel(),
        )
        here, ahead = (np.array(pairs.distances(q + t * velocity, told, t)).ravel() for t in (-step, step))
        column = ca.SX(pairs.nearest(q, np.zeros(chain.n), told, 0.0))
        distances, slopes, changes = (np.array(ca.DM(each)) for each in pairs.read(column))
        expected = (ahead - here) / (2 * step)
        for distance, slope, change in zip(distances.ravel(), slopes, changes.ravel(), strict=True):
            same = np.flatnonzero(np.abs((here + ahead) / 2 - distance) < 1e-9)
            if len(same) == 1 and distance > -MARGIN:  # the nearest contact of one pair
                assert slope @ velocity + change == pytest.approx(expected[same[0]], abs=1e-5)
                found += 1
    assert found > 20


def test_link_that_is_pressed_towards_its_axis_gives_way_by_more_than_its_tangents_say() -> None:
    """A link at speed, of which the body is at the margin: where it turns, rows of the last way lack 30 um."""
    dt, q = 0.02, np.array([-2.194743, -1.123427, 1.442757, -2.25151, 2.030365, -0.392498])
    upper_arm = LinkCapsule("upper_arm", 2, (0.438, -0.012, 0.111), (0.013, -0.012, 0.111), 0.0387)
    chain = ur5(velocity=2.588, acceleration=25.96, capsules=(upper_arm,))
    start, end = np.array([-0.171351, 0.148799, -0.099293]), np.array([-0.113189, 0.238142, 0.738903])
    ways = np.array([0.042014, -0.01993, -0.017389]), np.array([0.03889, -0.018126, -0.01638])
    apart = segments_apart(*ends(chain, q)[0], start, end)
    body = MovingCapsule(start, end, apart - upper_arm.radius - MARGIN, *ways)
    tracker = PoseTracker(chain, dt=dt, gain=20.0, limits=[Clearance(margin=MARGIN, moving=1)], compile=False)
    last = np.array([-0.577414, -0.197829, 0.392097, 0.061937, 0.176073, 0.597945])
    for fraction in (0.0, 0.5, 1.0, 2.0):
        tracker.reset(fraction * last)
        command = tracker.step(q, chain.pose(q), np.zeros(6), obstacles=[body])
        there = ends(chain, q + dt * command.value)[0]
        assert segments_apart(*there, start + dt * ways[0], end + dt * ways[1]) >= apart - 1e-9


def test_a_plane_of_a_clearance_brakes_and_leads_as_a_limit_of_the_same_distances() -> None:
    """Beside the plane, along it and into it, with joints that brake unequally."""
    hand = LinkCapsule("hand", 6, (0.0, 0.0, 0.0), (0.0, 0.0, 0.1), 0.05)
    chain = ur5(velocity=2.0, acceleration=[20.0, 4.0, 20.0, 2.0, 20.0, 1.0], capsules=(hand,))

    def heights(chain: SerialChain, q: ca.SX) -> ca.SX:
        pose = chain.pose_expression(q)
        return ca.vertcat(pose[2, 3], pose[2, 3] + 0.1 * pose[2, 2]) - 0.2 - hand.radius - MARGIN

    floor = Clearance(margin=MARGIN, planes=[KeepOut.through([0, 0, 0.2], [0, 0, 1])], pairs=())
    given: tuple[list[Any], ...] = ([floor], [Limit(heights)], [])
    trackers = [PoseTracker(chain, dt=0.005, limits=each, compile=False) for each in given]
    rng, held_back = np.random.default_rng(0), 0
    for _ in range(1200):
        q, last = START + rng.uniform(-0.6, 0.6, 6), rng.uniform(-1.0, 1.0, 6)
        low = chain.pose(q)[2, 3] + min(0.0, 0.1 * chain.pose(q)[2, 2]) - 0.2 - hand.radius - MARGIN
        if not 0.0 < low < 0.02:
            continue
        down = chain.jacobian(q)[2]
        last -= rng.choice([0.9, 1.0]) * down * (down @ last) / (down @ down)
        for enable in (True, False):
            values = []
            for tracker in trackers:
                tracker.reset(np.clip(last, -1.9, 1.9))
                values.append(tracker.step(q, chain.pose(q), np.zeros(6), enable=enable).value)
            np.testing.assert_allclose(values[0], values[1], rtol=0, atol=2e-3)
            held_back += np.abs(values[0] - values[2]).max() > 0.01
    assert held_back > 10


def test_mirrored_hand_keeps_clear_of_what_stands_and_gives_way_to_what_comes() -> None:
    rng, dt, chain = np.random.default_rng(1), 0.005, ur5(velocity=2.0)
    given = room(chain, rng, moving=1)
    made = {"floor": 0.05, "max_deviation": 0.5, "max_turn": 3.0, "max_manipulability": LARGEST, "compile": False}
    mirror = MirrorTracker(chain, dt=dt, limits=[given], **made)  # type: ignore[arg-type]
    links, q, pose = np.arange(2, len(chain.capsules)), START.copy(), chain.pose(START)
    way, away = np.array([0.0, 0.1, 0.0]), pose[:3, 3] - [0.0, 0.25, 0.0]
    near = 0
    for k in range(450):
        body = MovingCapsule(away, away, 0.05, way, way)
        at, twist = pose.copy(), np.zeros(6)
        at[:3, 3] += np.array([0.1, 0.0, -0.5]) * np.sin(2 * k * dt)
        twist[:3] = np.array([0.1, 0.0, -0.5]) * 2 * np.cos(2 * k * dt)
        command = mirror.step(q, at, twist, obstacles=[body], enable=k % 150 < 140)
        before, q, away = q, q + dt * command.value, away + dt * way
        if k % 3:
            continue
        now = least_distance(chain, given, ends(chain, q), [still(body, dt)], links)
        if now < 0.0:  # by what comes, while it brakes
            assert not command.status.certified
            assert now >= least_distance(chain, given, ends(chain, before), [still(body, dt)], links) - 1e-9
        near += now < 2e-3
    assert near > 15
    with pytest.raises(ConfigurationError, match="obstacles"):
        mirror.step(q, pose, np.zeros(6))
    with pytest.raises(ConfigurationError, match="moving"):
        mirror.plan(np.tile(pose, (5, 1, 1)), np.zeros((5, 6)), q)


@pytest.mark.parametrize("acceleration", [15.0, pytest.param(1.0, marks=pytest.mark.nightly)])
@pytest.mark.parametrize("inside", [pytest.param(0.0005, marks=pytest.mark.nightly), 0.005, 0.018])
def test_a_body_that_stands_within_the_margin_is_left_slowly(inside: float, acceleration: float) -> None:
    """When `enable` is pressed; the hand's speed is that of differences of its places."""
    dt, chain = 0.002, ur5(velocity=1.0, acceleration=acceleration)
    given, links = Clearance(margin=MARGIN, moving=1, pairs=()), np.arange(2, len(chain.capsules))
    tracker = PoseTracker(chain, dt=dt, linear_speed=0.25, limits=[given], compile=False)
    q, pose = START.copy(), chain.pose(START)

    def room_left(q: np.ndarray, body: MovingCapsule) -> float:
        return float(least_distance(chain, given, ends(chain, q), [body], links))

    away = [np.array([0.0, -x, 0.0]) + pose[:3, 3] for x in np.linspace(0.0, 0.4, 4001)]
    body = next(each for each in (MovingCapsule(at, at, 0.05) for at in away) if room_left(q, each) >= -inside)
    places, fastest = [pose[:3, 3]], 0.0
    for k in range(700):
        u = tracker.step(q, pose, np.zeros(6), obstacles=[body], enable=k >= 20).value
        fastest = max(fastest, float(np.abs(u).max()) if k < 40 else 0.0)
        q = q + dt * u
        places.append(chain.pose(q)[:3, 3])
    speeds = np.linalg.norm(np.diff(places, axis=0), axis=1) / dt
    assert speeds.max() <= 1.02 * 0.25
    assert fastest <= 20 * dt * acceleration + 0.05
    assert room_left(q, body) > -inside / 2


def still(body: MovingCapsule, dt: float) -> MovingCapsule:
    """Where it is a tick later."""
    return body._replace(start=body.start + dt * body.start_velocity, end=body.end + dt * body.end_velocity)


@pytest.mark.parametrize("drive", ["mecanum"])
def test_column_that_turns_about_its_own_axis_is_kept_clear_of_what_the_chair_drives_at(drive: Any) -> None:
    """A column of 0.4 m before the chair, its arm above a rail, and a stick straight at the rail."""
    rows = [DH(0.0, np.pi / 2, 0.4), DH(0.3, 0.0), DH(0.0, np.pi / 2), DH(0.0, 0.0, 0.3)]
    arm = SerialChain(rows, lower=-2.5, upper=2.5, velocity=1.0, acceleration=4.0)
    mount, dt, names = np.eye(4), 0.01, ("x", "y", "z")
    mount[:3, 3] = 0.6, 0.1, 0.3
    robot_on_chair = arm_on_chair(arm, mount=mount, keep_out=())
    assert [each.name for each in robot_on_chair.bodied_chain.capsules] == ["link 0", "link 1", "column 0"]
    assert len(robot_on_chair.links) == 2
    rail = Capsule("rail", (1.1, -2.0, 0.4), (1.1, 2.0, 0.4), 0.04)
    given = Clearance(margin=MARGIN, capsules=[rail], pairs=())
    resolver = RedundancyResolver(robot_on_chair, drive=drive, row_sets=[names], dt=dt, limits=[given], compile=False)
    q, found = np.array([0.0, 0.0, 0.0, 0.3, 0.9, 0.3, 0.0]), []
    for _ in range(600):
        q = q + dt * resolver.step(q, np.array([0.2, 0.0, 0.0]), names, "world").value
        foot = q[0] + np.cos(q[2]) * 0.6 - np.sin(q[2]) * 0.1  # upright, across the rail
        found.append(1.1 - foot - 0.05 - 0.04 - MARGIN)
    assert -1e-9 <= min(found) < 5e-3


@pytest.mark.parametrize(("at", "number"), [(12, -0.5), (13, 0.5), (13, -1.0)])
def test_spoilt_numbers_take_no_body_away(at: int, number: float) -> None:
    chain, pose = ur5(), ur5().pose(START)
    through = MovingCapsule(pose[:3, 3] - 0.1, pose[:3, 3] + 0.1, 0.001)
    spoilt = moving_numbers([through], 1).copy()
    spoilt[0, at] = number
    tracker = PoseTracker(chain, limits=[Clearance(margin=MARGIN, moving=1)], compile=False)
    asked = pose.copy()
    asked[2, 3] += 0.05
    seen = [tracker.step(START, asked, np.zeros(6), obstacles=each) for each in (np.zeros((1, MOVING)), spoilt)]
    assert Relaxed.POSITION not in seen[0].relaxed
    assert Relaxed.POSITION in seen[1].relaxed


def test_clearances_and_bodies_that_are_none_are_refused_by_name() -> None:
    chain, given = ur5(), Clearance(margin=0.02, moving=1)
    options: list[tuple[str, Any, str]] = [
        ("margin", -0.1, "margin"), ("margin", float("nan"), "margin"), ("moving", 1.5, "moving"),
        ("max_contacts", 0, "max_contacts"), ("rate", 0.0, "rate"), ("planes", [1.0], "planes[0]"),
        ("capsules", [Capsule("a", (0, 0, 0), (0, 0, float("inf")), 0.1)], "capsules[0]"),
        ("boxes", [Box("a", (0, 0, 0), (1, 1, 0))], "boxes[0]"),
        ("boxes", [Box("a", (0, 0, 0), (1, 1, 1), ((1, 0, 0), (0, 1, 0), (0, 1, 1)))], "boxes[0]"),
        ("pairs", [("forearm", "ceiling")], "pairs[0]"),
    ]  # fmt: skip
    refuses(
        lambda **option: PoseTracker(chain, limits=[Clearance(**{"margin": 0.02, **option})], compile=False),
        *(({name: value}, words) for name, value, words in options),
    )
    refuses(partial(PoseTracker, compile=False), ({"chain": ur5(capsules=()), "limits": [given]}, "capsules"))
    refuses(partial(PoseTracker, compile=False), ({"chain": chain, "limits": [given, given]}, "limits[1]"))
    tracker = PoseTracker(chain, limits=[Clearance(margin=MARGIN, moving=2)], compile=False)
    step = partial(tracker.step, START, chain.pose(START), np.zeros(6))
    wrong: list[Any] = [None, [BALL] * 3, [1.0], np.zeros((1, MOVING)), [BALL._replace(start=(1, 2))]]
    refuses(step, *(({"obstacles": bodies}, "obstacles") for bodies in wrong))
    plain = PoseTracker(chain, compile=False)
    refuses(partial(plain.step, START, chain.pose(START), np.zeros(6)), ({"obstacles": [BALL]}, "obstacles"))
    command = step(obstacles=[BALL._replace(end=(np.nan, 0.0, 0.0))])
    assert command.status is Status.HOLDING
    assert "obstacles[0, 3] is nan" in command.reason
    assert step(obstacles=[BALL]).status is Status.OK


def documented(name: str) -> Any:
    """A function of the page on clearance."""
    page = (Path(__file__).parents[2] / "docs/capabilities/clearance.md").read_text()
    (block,) = [each for each in re.findall(r"```python\n(.*?)```", page, re.DOTALL) if f"def {name}(" in each]
    known: dict[str, Any] = {}
    exec(block, known)
    return known[name]


def test_bodies_of_a_camera_without_velocities_are_not_touched() -> None:
    """A ball that swings into the forearm's place, seen at 30 Hz, 40 ms late and off by up to 3 mm."""
    rng, dt, radius, seen_now = np.random.default_rng(7), 0.008, 0.06, documented("seen_now")
    chain = ur5(velocity=2.0)
    tracker = PoseTracker(chain, dt=dt, limits=[Clearance(margin=MARGIN, moving=1)], compile=False)
    pose, q = chain.pose(START), START.copy()
    forearm = ends(chain, q)[1].mean(axis=0)
    way = np.array([0.1, -0.24, 0.05])

    def ball(time: float) -> np.ndarray:
        return forearm + way * (1.0 + np.cos(1.2 * time))

    frames, least, due = [(each, ball(each)) for each in (-2 / 30 - 0.04, -1 / 30 - 0.04)], np.inf, 0.0
    for tick in range(450):
        now = tick * dt
        if now >= due:
            taken, due = due - 0.04, due + 1 / 30
            frames = [frames[1], (taken, ball(taken) + rng.uniform(-1, 1, 3) * 0.003 / np.sqrt(3))]
        command = tracker.step(q, pose, np.zeros(6), obstacles=[seen_now(frames, now, radius)], stamp=now)
        q = q + command.value * dt
        here, segments = ball(now + dt), ends(chain, q)
        along = segments[:, 1] - segments[:, 0]
        part = np.clip(np.einsum("ij,ij->i", here - segments[:, 0], along) / np.sum(along**2, axis=1), 0, 1)
        apart = np.linalg.norm(segments[:, 0] + part[:, None] * along - here, axis=1)
        least = min(least, float((apart - [each.radius for each in chain.capsules]).min()) - radius)
    assert 0.0 < least < 3 * MARGIN
