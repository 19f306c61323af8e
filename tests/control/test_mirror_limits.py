"""Planes and hand speed of MirrorTracker, judged by kinematics and geometry of their own (`ur5_body`)."""

import math
from collections.abc import Iterator

import casadi as ca
import numpy as np
import pytest

from rehab_opt import KeepOut, Limit, MirrorTracker, Relaxed, Status, ur5
from tests.control.mirror_campaign import LARGEST
from tests.control.ur5_body import Array, clearances, heights, tool_motion

TICKS = (1e-3, 5e-3, 2e-2)
SPEED = 0.25
ONES, Z = np.ones(6), np.array([0.0, 0.0, 1.0])
STRETCHED_BESIDE = np.array([0, -1.2, 1.5, -1.8, -1.57, 0])


def offset_tool(place: Array) -> Array:
    tool = np.eye(4)
    tool[:3, 3] = place
    return tool


def made(dt: float, *, tool: Array, planes: tuple[KeepOut, ...] = ()) -> MirrorTracker:
    """A tracker that little else than speeds and planes holds back."""
    return MirrorTracker(
        ur5(tool=offset_tool(tool)), dt=dt, floor=0.02, max_deviation=2.0, max_turn=3.0, linear_speed=SPEED,
        angular_speed=6.0, keep_out=planes, max_manipulability=LARGEST, compile=False,
    )  # fmt: skip


def random_posture(rng: np.random.Generator) -> Array:
    return rng.uniform(-1, 1, 6) * [3.0, 1.0, 2.4, 2.0, 2.6, 2.0] + [0, -1.3, 0, -1.5, 0, 0]


def driven(
    robot: MirrorTracker, rng: np.random.Generator, start: Array, ticks: int, *, nudge: float = 0.0, way: Array = ONES
) -> Iterator[tuple[Array, Array]]:
    """Each tick's q and command, the robot moving as commanded and nudged [rad] now and then.

    The reference swings along `way` (6,), up to several times faster than the hand may be; the enable input is released
    at times.
    """
    chain, dt, q = robot.chain, robot.dt, start
    robot.reset(rng.uniform(-0.3, 0.3, 6) * rng.choice([0.0, 1.0]))
    wide, fast = way * rng.uniform(0.1, 0.6, 6), rng.uniform(0.5, 4.0, 6)
    for k in range(ticks):
        at, speeds = start + wide * (1 - np.cos(fast * k * dt)), wide * fast * np.sin(fast * k * dt)
        value = robot.step(q, chain.pose(at), chain.jacobian(at) @ speeds, enable=k % 90 < 80).value
        yield q, value
        q = q + dt * value
        if k % 40 == 20:
            q = q + nudge * rng.normal(size=6)


def test_the_judge_knows_where_the_vendors_robot_is() -> None:
    rng, tool = np.random.default_rng(0), np.array([0.02, -0.05, 0.15])
    still = np.zeros(6)
    np.testing.assert_allclose(tool_motion(still, still, np.zeros(3))[0], [-0.81725, -0.19145, -0.005491], atol=1e-12)
    for _ in range(20):
        q, v = rng.uniform(-3, 3, 6), rng.uniform(-1, 1, 6)
        place, speed = tool_motion(q, v, tool)
        np.testing.assert_allclose(place, ur5(tool=offset_tool(tool)).pose(q)[:3, 3], atol=1e-12)
        ahead, behind = (tool_motion(q + t * v, still, tool)[0] for t in (1e-6, -1e-6))
        np.testing.assert_allclose(speed, (ahead - behind) / 2e-6, atol=1e-8)


# ----------------------------------------------------------------------------------------------------- hand speed
@pytest.mark.parametrize("dt", TICKS)
@pytest.mark.parametrize("tool", [np.zeros(3), np.array([0.05, 0.0, 0.2])])
def test_the_tool_is_within_its_speed_at_every_instant_of_every_tick(dt: float, tool: Array) -> None:
    robot, rng = made(dt, tool=tool), np.random.default_rng(7)
    worst, fast, shortened = 0.0, 0, 0
    for _ in range(10):
        q, value = (
            np.array(each) for each in zip(*driven(robot, rng, random_posture(rng), 250, nudge=0.02), strict=True)
        )
        speeds = [np.linalg.norm(tool_motion(q + t * value, value, tool)[1], axis=1) for t in np.linspace(0, dt, 11)]
        worst = max(worst, float(np.max(speeds)))
        fast += int((np.max(speeds, axis=0) > 0.98 * SPEED).sum())
        shortened += robot.counts["shortened"]
    assert worst <= SPEED * (1 + 1e-6)
    assert fast > 200  # else this says nothing, or the bound costs too much
    assert shortened <= 50  # of 2500: the wanted motion is slowed beforehand


# --------------------------------------------------------------------------------------------------------- planes
def start_before(link: str, gap: float, tool: Array, rng: np.random.Generator) -> tuple[Array, KeepOut]:
    """A posture, and a plane so far [m] from the link of it that is nearest to it."""
    while True:
        start, normal = random_posture(rng), rng.normal(size=3)
        normal /= np.linalg.norm(normal)
        found = clearances(start, normal, 0.0, tool)
        nearest = min(found, key=lambda name: round(float(found[name]), 12))  # links share ends
        if nearest == link:
            return start, KeepOut.through((found[link] - gap) * normal, normal)


@pytest.mark.parametrize("dt", TICKS)
def test_no_point_of_any_link_crosses_a_plane(dt: float) -> None:
    rng, ticks = np.random.default_rng(11), 0
    closest: dict[str, float] = {}
    links = ("upper_arm", "forearm", "elbow", "wrist_3", "wrist_2", "tool")
    for number, link in enumerate(links):
        tool = np.array([0.03, 0.0, 0.12]) if link == "tool" else np.zeros(3)
        start, plane = start_before(link, 0.003, tool, rng)
        beyond = clearances(start, Z, 0.0, tool)["elbow"] + 0.05  # the elbow stands in a table, and goes no deeper
        table = KeepOut.through(beyond * Z, Z)
        robot = made(dt, tool=tool, planes=(plane, table) if number > 2 else (plane,))
        faces = [(np.array(plane.normal), plane.offset) for plane in robot.hand_bounds.planes]
        before = [clearances(start, *face, tool) for face in faces]
        near = [clearances(start + each, *faces[0], tool)[link] for each in 1e-4 * np.eye(6)]
        way = np.sign(np.round(before[0][link] - np.array(near), 13))  # towards the first plane
        for _ in range(2):
            ahead = np.array(
                [q + dt * value for q, value in driven(robot, rng, start, max(300, round(0.6 / dt)), way=way)]
            )
            ticks += len(ahead)
            for face, was in zip(faces, before, strict=True):
                low = {name: float(each.min()) for name, each in clearances(ahead, *face, tool).items()}
                whole = {name for name, height in was.items() if height >= 0.0}
                closest |= {name: min(closest.get(name, math.inf), low[name]) for name in whole}
                assert all(low[name] >= -1e-9 for name in whole)
                for name, points in heights(ahead, *face, tool).items():
                    assert name.removeprefix("tube of ") not in whole or points.min() >= -1e-9, name
    assert ticks >= 3600
    assert {name for name, height in closest.items() if height < 2e-3} >= {*links}  # else this says little


def test_the_upper_arm_beside_the_line_of_its_frames_stays_out_of_a_plane() -> None:
    """Its frames' origins are 2 mm clear of y = -0.112 when its tube is 78 mm beyond."""
    tool, q = np.zeros(3), STRETCHED_BESIDE
    beside = KeepOut.through([0, -0.112, 0], [0, 1, 0])
    bare = MirrorTracker(ur5(capsules=()), dt=5e-3, max_manipulability=LARGEST, keep_out=[beside], compile=False)
    assert bare.hand_bounds.min_heights(q, beside) == pytest.approx(0.112 - 0.10915, abs=1e-4)
    assert heights(q, np.array([0, 1.0, 0]), -0.112, tool)["tube of upper_arm"].min() < -0.0778
    arm = MirrorTracker(ur5(), dt=5e-3, max_manipulability=LARGEST, keep_out=[beside], compile=False)
    assert arm.hand_bounds.min_heights(q, beside) == pytest.approx(0.112 - 0.149 - 0.073, abs=1e-9)
    for enable in (True, False):  # beyond it, which is said
        assert arm.step(q, ur5().pose(q), np.zeros(6), enable=enable).relaxed & Relaxed.POSITION
    # A plane that the whole arm is clear of by 5 mm: turning the base towards it stops there.
    plane = KeepOut.through([0, -0.227, 0], [0, 1, 0])
    robot = MirrorTracker(
        ur5(), dt=5e-3, max_manipulability=LARGEST, max_deviation=1.0, keep_out=[plane], compile=False
    )
    lowest = math.inf
    for k in range(400):
        pose = ur5().pose(q + [0.3 * min(k / 200, 1), 0, 0, 0, 0, 0])
        q = q + 5e-3 * robot.step(q, pose, np.zeros(6)).value
        lowest = min(lowest, *(each.min() for each in heights(q, np.array([0, 1.0, 0]), -0.227, tool).values()))
    assert -1e-9 <= lowest < 3e-3


@pytest.mark.parametrize("dt", [1e-3, 2e-2])
def test_a_hand_slides_along_a_plane_that_both_ends_of_its_wrist_meet(dt: float) -> None:
    """It stood still there for good: two points met the plane at once, on a way that curves below the tangent."""
    tool, start, chain = np.zeros(3), np.array([0, -1.2, 1.5, -1.8, -1.57, 0]), ur5()
    here = chain.pose(start)
    into = here[:3, 3] * [1, 1, 0] / np.linalg.norm(here[:2, 3])
    nearest = min(clearances(start, -into, 0.0, tool).values())
    plane = KeepOut.through((nearest - 0.01) * -into, -into)
    robot = MirrorTracker(
        chain, dt=dt, floor=0.05, max_deviation=0.15, linear_speed=0.5, max_manipulability=LARGEST, keep_out=[plane],
        compile=False,
    )  # fmt: skip
    q, before, behind, path = start, here[:3, 3], list[float](), list[Array]()
    for k in range(round(3.0 / dt)):
        s = k * dt
        asked = here.copy()
        asked[:3, 3] += 0.1 * math.sin(1.2 * s) * np.cross(Z, into) + 0.12 * math.sin(0.9 * s) * Z
        asked[:3, 3] += 0.04 * min(s, 1.0) * into  # 30 mm beyond the plane in the end
        q = q + dt * robot.step(q, asked, np.r_[(asked[:3, 3] - before) / dt, np.zeros(3)]).value
        before = asked[:3, 3]
        path.append(q)
        beyond = (asked[:3, 3] - chain.pose(q)[:3, 3]) @ into
        behind.append(float(np.linalg.norm(asked[:3, 3] - chain.pose(q)[:3, 3] - beyond * into)))
    low = min(float(each.min()) for each in clearances(np.array(path), -into, plane.offset, tool).values())
    assert -1e-9 <= low < 1e-3
    assert max(behind[round(1.0 / dt) :]) < 0.01
    assert not robot.counts["shortened"]


def test_a_hand_whose_step_is_shortened_to_nothing_is_blocked_until_the_way_is_free() -> None:
    """Four distances of one limit at zero: three make rows, and the step is shortened before the fourth."""
    robot, q = ur5(velocity=1.0), STRETCHED_BESIDE
    pose, down = robot.pose(q), np.array([0.0, 0.0, -0.04, 0.0, 0.0, 0.0])
    table = float(pose[2, 3])
    corner = Limit(lambda arm, x: ca.vertcat(x[5], -x[5], x[5], arm.pose_expression(x)[2, 3] - table))
    tracker = MirrorTracker(robot, dt=5e-3, floor=0.05, limits=[corner], max_manipulability=LARGEST, compile=False)
    for twist, status, least, largest in ((down, Status.BLOCKED, 0.0, 0.0), (-down, Status.OK, 0.01, 1.0)):
        for _ in range(100 if status is Status.BLOCKED else 300):
            pose = pose.copy()
            pose[:3, 3] += twist[:3] * tracker.dt
            command = tracker.step(q, pose, twist)
            q = q + tracker.dt * command.value
        assert command.status is status, command.reason
        assert least <= np.abs(command.value).max() <= largest
        assert (command.scale == 0) == (status is Status.BLOCKED)
