"""What robots, from tables and files give on seeded postures is what is kept."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import rehab_opt as lib
from rehab_opt.kinematics.arm_links import arm_links, arm_reach, hand_volume, links_as_capsules, maximise_hand_volume
from rehab_opt.kinematics.drive import Differential, Fixed, Mecanum, Omnidirectional
from rehab_opt.kinematics.goniometer import GONIOMETER, range_in_words
from rehab_opt.kinematics.human_arm import RANGES_OF_MOTION_DEG
from rehab_opt.kinematics.inertia import rod
from tests.golden import assert_kept
from tests.golden.functions import digest
from tests.kinematics.robot_files.random_arms import random_arm, urdf
from tests.kinematics.robot_files.test_mjcf import random_mjcf

ROBOTS = Path(__file__).parents[2] / "problems" / "robots"
PANDA, GEN3 = ROBOTS / "franka_panda" / "panda.urdf", ROBOTS / "kinova_gen3" / "gen3.urdf"
MOUNT = np.eye(4)
MOUNT[:3, :3], MOUNT[:3, 3] = Rotation.from_rotvec([0.3, -0.2, 0.9]).as_matrix(), (0.2, -0.3, 0.7)


def moves(chain: lib.SerialChain) -> Iterator[Any]:
    """What a chain is, and does at postures."""
    rng, q = np.random.RandomState(1), ca.SX.sym("q", chain.n)
    frames = chain.frames_expression(q)
    every = ca.Function("every", [q], [ca.densify(ca.veccat(*frames, chain.jacobian_about(frames, ca.SX([1, 2, 3]))))])
    for _ in range(3):
        x = rng.uniform(np.clip(chain.lower, -2.5, 2.5), np.clip(chain.upper, -2.5, 2.5))
        yield every(x), chain.pose(x), chain.jacobian(x), chain.manipulability(x), chain.manipulability_gradient(x)
    yield chain, [(row.lengths, row.along, row.across, ca.DM(row.after)) for row in chain.rows]


def tables() -> Iterator[Any]:
    for name in RANGES_OF_MOTION_DEG:
        for side in ("left", "right"):
            yield from moves(arm := lib.human_arm(range_of_motion=name, side=side))  # type: ignore[arg-type]
            posture = 0.5 * (arm.lower + arm.upper)
            yield lib.arm_capsules(arm, posture, np.arange(8.0), placement=MOUNT)
    yield from moves(lib.human_arm(segments=(0.1, 0.31, 0.27, 0.02), velocity=2.0))
    yield from (*moves(lib.ur5()), *moves(lib.ur5(capsules=()).with_limits(lower=-1.0, acceleration=3.0)))
    for name, of in GONIOMETER.items():
        least, most = of.range_deg
        for pair in ((0.3 * least, 0.5 * most), (10.0, 20.0), (-20.0, -5.0), (9.0, 9.0), (-9.0, -9.0), (0.0, most + 5),
                     (least - 5, 0.0), (-2000.0, 0.0), (0.0, 190.0), (110.0, 250.0)):  # fmt: skip
            yield range_in_words(name, *np.radians(pair))
            given = {**dict.fromkeys(GONIOMETER, (0.0, 0.1)), name: np.radians(pair)}
            yield told(partial(lib.arm_range_of_motion, given))
        yield lib.goniometer_angles(lib.arm_posture({name: 0.3}))


def told(call: Callable[[], Any]) -> Any:
    """What a call gives, or why it refuses."""
    try:
        return call()
    except lib.RehabOptError as refused:
        return str(refused).replace(str(ROBOTS), "")


def mobile_arms() -> Iterator[Any]:
    gen3, rng = lib.SerialChain.from_urdf(GEN3, acceleration=4.0), np.random.RandomState(2)
    for robot in (
        lib.ardis(), lib.ardis(a3=0.2, d5=0.5, payload=1.5, limit_cost=0.3, singular_cost=2.0, mount_height=0.9),
        lib.arm_on_chair(lib.ur5(), mount=MOUNT, chair_mass=90.0, rotors=0.1),
        lib.arm_on_chair(gen3, mount=MOUNT, velocity=(0.5, 0.7), arm_radius=0.04),
    ):  # fmt: skip
        yield robot, robot.mass, robot.reach, robot.outline.corners, robot.bodied_chain.capsules
        for _ in range(4):
            q, v = rng.uniform(-2, 2, robot.chain.n), rng.normal(size=robot.chain.n)
            yield robot.inertia(q), robot.posture_cost(2 * q), robot.posture_gradient(q)
            yield robot.chassis_velocity(q, v), robot.world_velocity(q, v)
        links = [arm_links(robot.chain, first=3, radius=0.05, moved=moved) for moved in (True, False)]
        yield links, [links_as_capsules(robot.chain, each, "link") for each in links]
        yield arm_reach(robot.chain, robot.links, first=3), maximise_hand_volume(robot.chain, first=3)
        yield hand_volume(robot.chain, ca.SX(q), first=3)
        yield from moves(robot.chain)
    for drive in (Omnidirectional(), Fixed(), Mecanum(0.1, 0.3, 0.2, 9.0), Differential(0.15, 0.3, 7.0)):
        yield drive.rolling, drive.motion(rng.normal(size=len(drive.rolling))), drive.rims, drive.still()
        yield drive.wheel_speeds([0.3, -0.2, 0.4]), drive.constraints(rng.normal(size=5)), drive.holonomic
    yield drive.slip([0.1, 0.2, 0.3]), rod(2.0, (0.1, 0.2, -0.3), 0.05), rod(1.0, (0.0, 0.0, 0.0), 0.1)


def files(folder: Path) -> Iterator[Any]:
    panda, gen3 = (partial(lib.SerialChain.from_urdf, each) for each in (PANDA, GEN3))
    hand = lib.CapsuleOnLink("panda_link5", (0.0, 0.0, 0.0), (0.0, 0.1, -0.2), 0.06)
    held = {"mount": MOUNT, "tool": MOUNT, "capsules": [hand], "locked": {"panda_joint4": -1.0}}
    lower, upper = {"panda_joint1": -5.0, "panda_joint2": -1.0}, [3.0, 2.0, 3.0, 0.5, 3.0, 4.0, 3.0]
    yield from moves(panda(base="panda_link2", tip="panda_link8", acceleration=7.5, **held))
    yield from moves(panda(tip="panda_link8", acceleration=7.5, velocity=9.0, lower=lower, upper=upper))
    yield from (*moves(gen3(acceleration=200.0)), *moves(gen3(acceleration=0.05)))
    shape = '<collision><origin xyz="0 0.1 0" rpy="0.3 0 1"/><geometry><{}/></geometry></collision></link>'
    shapes = 'box size="0.1 0.3 0.2"', 'cylinder radius="0.05" length="0.4"', 'sphere radius="0.1"', 'mesh filename="a"'
    for seed in range(8):
        rng = np.random.default_rng(seed)
        edges, file = random_arm(rng, 2 + seed % 4), folder / f"{seed}.urdf"
        text = urdf(edges)
        for each in shapes[: seed % 5]:
            text = text.replace("</link>", shape.format(each), 1)
        file.write_text(text)
        limits = {"acceleration": 3.0, "velocity": 2.0, "lower": -1.9, "upper": 1.5}
        given = {**(limits if seed % 2 else {"acceleration": 3.0}), **({"capsules": "collision"} if seed % 5 else {})}
        made = told(partial(lib.SerialChain.from_urdf, file, tip=edges[-1].child, **given))  # type: ignore[arg-type]
        yield from moves(made) if isinstance(made, lib.SerialChain) else [made.replace(str(folder), "")]
        file.write_text(random_mjcf(rng, 2 + seed, degrees=seed % 2 == 0))
        yield from moves(lib.SerialChain.from_mjcf(file, tip="tool", **limits))


@pytest.mark.parametrize("part", [tables, mobile_arms, files])
def test_robots_are_those_kept(part: Callable[..., Iterator[Any]], tmp_path: Path) -> None:
    found = part(tmp_path) if part is files else part()
    assert_kept(f"kinematics_{part.__name__}", digest(*found, width=16, finest=1e-4), absolute=1e-4)
