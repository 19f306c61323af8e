"""Millimetres for metres and degrees for radians are refused or asked about, by every controller and robot alike."""

from functools import partial

import numpy as np
import pytest

from rehab_opt import (
    ArmIK,
    Assistance,
    Box,
    Capsule,
    Clearance,
    ConfigurationError,
    Interaction,
    KeepOut,
    MirrorTracker,
    MovingCapsule,
    PathAssistance,
    PoseTracker,
    PotentialField,
    RedundancyResolver,
    SerialChain,
    Status,
    Workspace,
    ardis,
    arm_capsules,
    arm_on_chair,
    human_arm,
    ur5,
)
from rehab_opt.kinematics.link import Link
from rehab_opt.kinematics.link_capsules import LinkCapsule
from rehab_opt.kinematics.mobile_arm import Outline
from tests.refusals import refuses

METRES = "metres"
TRACKERS = (PoseTracker, MirrorTracker)


def arm_of_size(length, *, slides=0.0, velocity=1.0):
    """Six joints on links of this length [m]; the first one slides, where it does."""
    links, turns = [], ((1, 0, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0), (1, 0, 0), (0, 0, 1))
    for i, axis in enumerate(turns):
        after = np.eye(4)
        if axis[0]:
            after[1:3, 1:3] = [[0, -1], [1, 0]]
        elif axis[1]:
            after[:3, :3] = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]
        after[:3, 3] = [length * (0.3 + 0.1 * i), 0.1 * length, 0.2 * length]
        links.append(Link(after, prismatic=bool(slides and not i)))
    limit = np.full(6, 2.8)
    limit[0] = slides or 2.8
    return SerialChain(tuple(links), lower=-limit, upper=limit, velocity=velocity, acceleration=5.0)


ROBOTS = {"finger": arm_of_size(0.01), "arm": ur5(velocity=1.0), "gantry": arm_of_size(0.5, slides=6.0)}


def made(tracker, chain, **more):
    known = {"max_manipulability": 0.1} if tracker is MirrorTracker else {}
    return tracker(chain, dt=0.004, compile=False, **known, **more)


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("tracker", TRACKERS)
def test_a_pose_in_millimetres_is_braked_for_and_one_in_metres_followed(tracker, robot):
    chain = ROBOTS[robot]
    q = np.full(chain.n, 0.4)
    controller, pose, twist = made(tracker, chain), chain.pose(q), np.zeros(6)
    assert controller.step(q, pose, twist).status is Status.OK
    wrong = pose.copy()
    wrong[:3, 3] *= 1e3
    command = controller.step(q, wrong, twist)
    assert METRES in command.reason
    assert command.status in {Status.BRAKING, Status.HOLDING}
    controller.reset()
    for speed in (50.0, 250.0 * (1 + chain.reach)):
        command = controller.step(q, pose, np.r_[speed, np.zeros(5)])
        if chain is not ROBOTS["gantry"] or speed > 50.0:
            assert not command.value.any()
            assert "too large" in command.reason


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("tracker", TRACKERS)
def test_settings_in_other_units_are_refused_by_name_and_none_of_the_robots_own(tracker, robot):
    chain = ROBOTS[robot]
    refuses(
        lambda **more: made(tracker, chain, **more),
        ({"linear_speed": 250.0}, "linear_speed", "m/s"),
        ({"angular_speed": 90.0}, "angular_speed", "rad/s"),
        ({"posture": np.full(6, 45.0)}, "posture", "radians"),
    )
    made(tracker, chain, linear_speed=2.0, angular_speed=6.0, posture=np.full(6, 0.5))


def test_a_tool_in_millimetres_is_refused_on_every_robot():
    for name, chain in ROBOTS.items():
        tool = np.eye(4)
        for length, meant in ((0.02, True), (0.9, True), (20.0 if name != "gantry" else 120.0, False)):
            tool[2, 3] = length
            if meant:
                made(PoseTracker, SerialChain(**taken(chain), tool=tool))
            else:
                with pytest.raises(ConfigurationError, match=r"tool = .* in metres"):
                    SerialChain(**taken(chain), tool=tool)


def taken(chain):
    return {name: getattr(chain, name) for name in ("rows", "lower", "upper", "velocity", "acceleration")}


def test_the_mirror_refuses_deviations_in_millimetres():
    refuses(
        lambda **more: made(MirrorTracker, ROBOTS["arm"], **more),
        ({"max_deviation": 50.0}, "max_deviation", METRES),
        ({"turn_length": 100.0}, "turn_length", METRES),
    )


def test_bodies_in_millimetres_are_refused_and_those_of_a_room_are_not():
    def clear(**bodies):
        made(PoseTracker, ROBOTS["arm"], limits=[Clearance(0.02, **bodies)])

    refuses(
        clear,
        ({"planes": [KeepOut((0.0, 0.0, 1.0), -100.0)]}, "planes[0]", METRES),
        ({"capsules": [Capsule("bar", (5.0, 0, 0), (5.0, 0, 3.0), 50.0)]}, "capsules[0]", METRES),
        ({"capsules": [Capsule("bar", (0.5, 0, 0), (0.5, 0, 300.0), 0.05)]}, "capsules[0]", METRES),
        ({"boxes": [Box.at("table", np.eye(4), (600.0, 1.0, 1.0))]}, "boxes[0]", METRES),
    )
    refuses(
        lambda **more: made(MirrorTracker, ROBOTS["arm"], **more),
        ({"keep_out": [KeepOut((0.0, 0.0, 1.0), -500.0)]}, "keep_out[0]", METRES),
    )
    room = np.eye(4)
    for length, meant in ((2.0, True), (700.0, False)):
        room[:3, 3] = length
        if meant:
            ur5(velocity=1.0, base=room)
        else:
            with pytest.raises(ConfigurationError, match=r"base = .* in metres"):
                ur5(velocity=1.0, base=room)
    clear(
        planes=[KeepOut((0.0, 0.0, 1.0), -2.0)], capsules=[Capsule("bar", (3.0, 0, 0), (3.0, 0, 3.0), 0.05)],
        boxes=[Box.at("wall", np.eye(4) + np.pad([[4.0]], ((0, 3), (3, 0))), (0.2, 8.0, 3.0))],
    )  # fmt: skip


def test_shapes_of_links_and_joint_speeds_in_other_units_are_refused():
    refuses(
        lambda *shape: ur5(velocity=1.0, capsules=[LinkCapsule("forearm", 3, *shape)]),
        (((0.0, 0.0, 0.0), (392.25, 0.0, 0.0), 0.066), "capsules, forearm", METRES),
        (((0.0, 0.0, 0.0), (0.392, 0.0, 0.0), 66.0), "capsules, forearm", METRES),
    )
    person = {"make": arm_capsules, "arm": human_arm(), "q": 0.0, "placement": np.eye(4)}
    refuses(
        lambda make, **given: make(**given),
        ({"make": ardis, "a3": 100.0}, "rows, ", METRES),
        ({"make": ardis, "mount_height": 700.0}, "base", METRES),
        (person | {"radii": (60, 50, 45)}, "radii", METRES),
        (person | {"placement": np.eye(4) + 500.0 * np.eye(4, k=3)}, "placement", METRES),
    )


def test_joint_speeds_in_other_units_are_refused_wherever_a_chain_gets_them():
    makers = (
        ur5,
        human_arm,
        ur5().with_limits,
        partial(arm_of_size, 0.3),
        *(partial(made, each, ur5()) for each in TRACKERS),
    )
    refuses(lambda make: make(velocity=172.0), *(((make,), "velocity of ", "= 172", "rad/s") for make in makers))
    refuses(
        ardis,
        ({"velocity": (800.0, 800.0, 1, 1, 1, 1, 1)}, "velocity of forward", "m/s"),
        ({"velocity": (0.8, 0.8, 1, 57, 1, 1, 1)}, "velocity of shoulder_flexion", "rad/s"),
    )
    ur5(velocity=30.0)


def test_shapes_of_a_chair_and_its_user_in_millimetres_are_refused():
    trunk = ((-0.15, 0.0, 0.55), (-0.15, 0.0, 1.25), 0.18)
    wide = ((-150.0, 0.0, 550.0), (-150.0, 0.0, 1250.0), 0.18)
    for make in (ardis, partial(arm_on_chair, ur5(), mount=np.eye(4))):
        refuses(
            lambda make=make, **more: make(**more),
            ({"keep_out": [Capsule("trunk", *trunk), Capsule("trunk", *wide)]}, "keep_out[1]", METRES),
            ({"keep_out": [Capsule("trunk", *trunk[:2], 180.0)]}, "keep_out[0]", METRES),
            ({"outline": Outline(-450.0, 550.0, -330.0, 330.0)}, "outline", METRES),
        )
        make(keep_out=[Capsule("trunk", *trunk), Capsule("tray", (1.5, 0.0, 0.0), (1.5, 0.0, 2.0), 0.5)])
    refuses(lambda r: arm_on_chair(ur5(), mount=np.eye(4), arm_radius=r), ((50.0,), "arm_radius", METRES))


def test_the_mirror_refuses_an_interaction_in_millimetres():
    refuses(
        lambda **more: made(MirrorTracker, ROBOTS["arm"], interaction=Interaction(**more)),
        ({"max_offset": 50.0}, "interaction.max_offset", METRES),
        ({"speed": 150.0}, "interaction.speed", "m/s"),
    )


@pytest.mark.parametrize("tracker", TRACKERS)
def test_moving_bodies_in_millimetres_are_braked_for_and_those_of_a_room_are_not(tracker):
    chain = ROBOTS["arm"]
    controller, q = made(tracker, chain, limits=[Clearance(0.02, moving=2)]), np.full(6, 0.4)
    far, near = MovingCapsule((9.0, 40.0, 1.0), (9.0, 40.0, 1.0), 0.3, (2.0, 0, 0), (2.0, 0, 0)), (0.0, 0.0, 0.0)
    wrong = (
        MovingCapsule((600.0, 400.0, 900.0), (600.0, 400.0, 1200.0), 0.06),
        MovingCapsule((0.9, 0.9, 0.9), (0.9, 0.9, 0.9), 60.0),
        MovingCapsule((0.9, 0.9, 0.9), (0.9, 0.9, 0.9), 0.06, (250.0, 0.0, 0.0), near),
    )
    assert controller.step(q, chain.pose(q), np.zeros(6), obstacles=[far]).status is Status.OK
    for body in wrong:
        command = controller.step(q, chain.pose(q), np.zeros(6), obstacles=[far, body])
        assert "too large" in command.reason
        assert not command.value.any()
    absent = np.zeros((2, 14))
    absent[:, :13] = 1e4
    assert controller.step(q, chain.pose(q), np.zeros(6), obstacles=absent).status is Status.OK


def test_the_chair_does_not_act_on_a_stick_in_millimetres():
    robot = ardis()
    resolver, q = RedundancyResolver(robot, dt=0.01), np.array([0, 0, 0, 0.3, 0.6, 0.4, 0.2])
    assert resolver.step(q, [0.1, 0.0, 0.0]).value.any()
    resolver.reset()
    command = resolver.step(q, [250.0, 0.0, 0.0])
    assert not command.value.any()
    assert "too large" in command.reason
    assert not resolver.reach(q, [1200.0, 300.0, 900.0]).value.any()


def test_inverse_kinematics_asks_about_a_target_in_millimetres():
    solver = ArmIK(human_arm(), compile=False, table_size=256, nearest_starts=2)
    assert METRES in solver.solve([300.0, 200.0, -100.0]).reason
    assert METRES not in solver.solve([1.5, 0.0, 0.0]).reason
    with pytest.raises(ConfigurationError, match=r"rest of .* radians"):
        ArmIK(human_arm(), rest=np.full(human_arm().n, 30.0), compile=False)


def test_forces_are_not_given_to_a_hand_in_millimetres():
    shapely = pytest.importorskip("shapely")
    field = PotentialField([(0.0, 0.4)], stiffness=300.0, width=0.04, compile=False)
    comfortable = Workspace(shapely.box(-0.2, 0.2, 0.2, 0.6), accuracy=1e-3)
    assistance = Assistance(field, comfortable=comfortable, compile=False)
    command = assistance.step((-172.0, 502.0))
    assert METRES in command.reason
    assert not command.value.any()
    with pytest.raises(ConfigurationError, match="millimetres"):
        Workspace(shapely.box(-200.0, 200.0, 200.0, 600.0), accuracy=1e-3)
    with pytest.raises(ConfigurationError, match="millimetres"):
        PathAssistance([[0.0, 0.0], [200.0, 0.0]], stiffness=1000.0, width=0.02, comfortable=comfortable)
