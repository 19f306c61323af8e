"""What robots, from tables and files, and frames of recordings give on seeded postures is what is kept."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rehab_opt import CapsuleOnLink, RehabOptError, SerialChain, ardis, arm_capsules, arm_on_chair, human_arm, ur5
from rehab_opt.kinematics.arm_links import arm_links, arm_reach, hand_volume, links_as_capsules, maximise_hand_volume
from rehab_opt.kinematics.body import of_a_body
from rehab_opt.kinematics.drive import Differential, Fixed, Mecanum, Omnidirectional
from rehab_opt.kinematics.goniometer import (
    GONIOMETER, arm_posture, arm_range_of_motion, goniometer_angles, goniometer_range, range_in_words,
)  # fmt: skip
from rehab_opt.kinematics.human_arm import ARM_JOINTS, RANGES_OF_MOTION_DEG
from rehab_opt.kinematics.inertia import rod
from rehab_opt.kinematics.rigid import is_rigid, is_rotation, nearest_rigid, rotation_vector
from rehab_opt.kinematics.room import Box, KeepOut, MovingCapsule, moving_numbers
from rehab_opt.kinematics.vr import (
    Mirror, continuous_quaternions, fit_frame, poses_of, quaternions_of, robot_from_unity, rotations_of,
)  # fmt: skip
from tests.golden import assert_kept
from tests.golden.functions import digest
from tests.kinematics.robot_files.random_arms import random_arm, urdf
from tests.kinematics.robot_files.test_mjcf import random_mjcf

ROBOTS = Path(__file__).parents[2] / "problems" / "robots"
PANDA, GEN3 = ROBOTS / "franka_panda" / "panda.urdf", ROBOTS / "kinova_gen3" / "gen3.urdf"
MOUNT = np.eye(4)
MOUNT[:3, :3], MOUNT[:3, 3] = Rotation.from_rotvec([0.3, -0.2, 0.9]).as_matrix(), (0.2, -0.3, 0.7)
exactly = partial(digest, finest=1e-6, width=3)


def chain_numbers(chain: SerialChain) -> Any:
    rng, q = np.random.RandomState(1), ca.SX.sym("q", chain.n)
    low, high = (np.clip(each, -2.5, 2.5) for each in (chain.lower, chain.upper))
    expressions = [*chain.frames_expression(q), chain.jacobian_about(chain.frames_expression(q), ca.SX([0.1, 0.2, 0.3]))]
    every = ca.Function("every", [q], [ca.densify(ca.veccat(*expressions))])
    told = []
    for _ in range(3):
        x = rng.uniform(low, high)
        told += [every(x), chain.pose(x), chain.jacobian(x), chain.manipulability(x), chain.manipulability_gradient(x)]
    limits = [chain.lower, chain.upper, chain.velocity, chain.acceleration, chain.effort, chain.base, chain.tool]
    rows = [[*np.ravel(row.lengths), row.along, row.across, row.prismatic, *np.array(ca.DM(row.after)).ravel()] for row in chain.rows]
    capsules = [[each.frame, *each.start, *each.end, each.radius] for each in chain.capsules]
    bodies = [[each.link, each.mass, *each.centre, *each.inertia.ravel()] for each in chain.bodies]
    return {"moves": digest(*told, width=12, finest=1e-6), "is": exactly(*limits, *rows, *capsules, *bodies, width=12),
            "said": [*chain.names, *(each.name for each in (*chain.capsules, *chain.bodies)), *chain.notes]}  # fmt: skip


def tables() -> Any:
    arms = {f"{name} {side}": human_arm(range_of_motion=name, side=side) for name in RANGES_OF_MOTION_DEG for side in ("left", "right")}
    arms["segments"] = human_arm(segments=(0.1, 0.31, 0.27, 0.02), velocity=2.0)
    arms["ur5"], arms["bare"] = ur5(), ur5(capsules=(), velocity=1.0).with_limits(lower=-1.0, acceleration=3.0)
    return {name: chain_numbers(arm) for name, arm in arms.items()}


def mobile_arms() -> Any:
    found = {}
    gen3 = SerialChain.from_urdf(GEN3, acceleration=4.0)
    for name, robot in {
        "ardis": ardis(), "longer": ardis(a3=0.2, d5=0.5, payload=1.5, limit_cost=0.3, singular_cost=2.0, mount_height=0.9),
        "ur5": arm_on_chair(ur5(), mount=MOUNT, chair_mass=90.0, rotors=0.1), "gen3": arm_on_chair(gen3, mount=MOUNT, velocity=(0.5, 0.7), arm_radius=0.04),
    }.items():  # fmt: skip
        rng, n = np.random.RandomState(2), robot.chain.n
        told: list[Any] = [robot.mass, robot.reach, robot.hand_volume, robot.outline.corners, robot.rotors]
        for _ in range(4):
            q, v = rng.uniform(-2, 2, n), rng.normal(size=n)
            told += [robot.inertia(q), robot.posture_cost(2 * q), robot.posture_gradient(q), robot.chassis_velocity(q, v), robot.world_velocity(q, v)]
        for moved in (True, False):
            links = arm_links(robot.chain, first=3, radius=0.05, moved=moved)
            told += [[*link.begin.offset, link.begin.frame, link.begin.moves, *link.end.offset, link.end.frame, link.radius] for link in links]
            told += [[each.frame, *each.start, *each.end] for each in links_as_capsules(robot.chain, links, "link")]
        told += [arm_reach(robot.chain, robot.links, first=3), maximise_hand_volume(robot.chain, first=3)]
        told += [float(ca.DM(hand_volume(robot.chain, ca.SX(q), first=3)))]
        told += [[each.frame, *each.start, *each.end, each.radius] for each in robot.bodied_chain.capsules]
        found[name] = [*digest(*told, width=12, finest=1e-4), *chain_numbers(robot.chain)["moves"]]
    rng = np.random.RandomState(3)
    for drive in (Omnidirectional(), Fixed(), Mecanum(0.1, 0.3, 0.2, 9.0), Differential(0.15, 0.3, 7.0)):
        wheels = rng.normal(size=len(drive.rolling))
        slip = [drive.slip([0.1, 0.2, 0.3])] if isinstance(drive, Differential) else []
        found[type(drive).__name__] = exactly(drive.rolling, *drive.motion(wheels), *drive.rims, drive.wheel_speeds([0.3, -0.2, 0.4]), drive.constraints(rng.normal(size=5)), drive.still(), drive.holonomic, slip)
    return found | {"rods": exactly(rod(2.0, (0.1, 0.2, -0.3), 0.05), rod(1.0, (0.0, 0.0, 0.0), 0.1))}


def goniometry() -> Any:
    ranges = arm_range_of_motion({name: tuple(np.radians([0.3 * m.range_deg[0], 0.5 * m.range_deg[1]])) for name, m in GONIOMETER.items()})
    back = goniometer_range(ranges)
    q = arm_posture({name: 0.1 * (i + 1) for i, name in enumerate(GONIOMETER)})
    words = [range_in_words(name, *pair) for name in GONIOMETER for pair in ((-0.3, 0.5), (0.2, 0.4), (-0.5, -0.1), (0.3, 0.3), (-0.2, -0.2))]
    strange = []
    for name, movement in GONIOMETER.items():
        for pair in ((-2000.0, 0.0), (0.0, 190.0), (movement.range_deg[0] - 5, 0.0), (0.0, movement.range_deg[1] + 5), (0.0, movement.range_deg[1])):
            given = {each: (0.0, 0.1) for each in GONIOMETER} | {name: tuple(np.radians(pair))}
            strange.append(refusal(lambda given=given: arm_range_of_motion(given)))
    return {"ranges": exactly(*ranges.values(), *back.values(), q, *goniometer_angles(q).values(), arm_posture({})), "order": [*ranges, *back], "words": words, "strange": strange}


def refusal(call: Callable[[], Any]) -> str:
    try:
        call()
    except RehabOptError as refused:
        return str(refused)
    return ""


def frames() -> Any:
    rng = np.random.RandomState(4)
    points, turns = rng.normal(size=(9, 3)), Rotation.from_rotvec(rng.normal(size=(9, 3)) * np.linspace(0.1, 2.0, 9)[:, None])
    quaternions = turns.as_quat() * rng.choice([-2.0, 1.0], (9, 1))
    quaternions[4] = 0.0
    unit = np.delete(quaternions, 4, axis=0)
    noisy = 1.3 * points @ turns[3].as_matrix().T + (0.1, 2.0, -0.3) + 0.01 * rng.normal(size=(9, 3))
    told: list[Any] = [*robot_from_unity(points, quaternions), continuous_quaternions(quaternions), continuous_quaternions(quaternions, unit[2]), rotations_of(unit), quaternions_of(turns.as_matrix()), poses_of(points[:8], unit)]
    for scale in (True, False):
        fit = fit_frame(points, noisy, scale=scale)
        told += [fit.pose, fit.scale, fit.residuals, fit.rms, fit.points(points), fit.poses(poses_of(points[:8], unit))]
    fit = fit_frame(points * [1, 1, 0], (points * [1, 1, 0]) @ np.diag([1.0, 1.0, -1.0]) + 0.01 * rng.normal(size=(9, 3)))
    told += [fit.pose, fit.residuals]
    for axis in ("x", "y", "z"):
        mirror = Mirror((0.1, 0.2, 0.3), (0.5, -1.0, 0.2), axis)  # type: ignore[arg-type]
        told += [mirror.positions(points), mirror.poses(poses_of(points[:8], unit)), mirror.twists(rng.normal(size=(3, 6)))]
    r, p = ca.SX.sym("r", 3, 3), ca.SX.sym("p", 4, 4)
    of = ca.Function("of", [r, p], [rotation_vector(r), is_rotation(r), is_rigid(p)])
    for size in (0.0, 1e-9, 0.3, 1.5, 2.0, 2.2, 2.9, math.pi - 1e-9, 3.1):
        for axis in np.vstack([np.eye(3), rng.normal(size=(3, 3))]):
            turn = Rotation.from_rotvec(size * axis / np.linalg.norm(axis)).as_matrix()
            for off in (0.0, 2e-4, 3e-3):
                pose = poses_of([[1.0, 2.0, 3.0]], [[0.0, 0.0, 0.0, 1.0]])[0]
                pose[:3, :3], pose[3, 0] = turn + off * rng.normal(size=(3, 3)), off * (size > 2)
                told += [*of(pose[:3, :3], pose), *of(-pose[:3, :3], pose)][1:3] + [of(turn, pose)[0]]
    near, note = nearest_rigid("pose", np.block([[np.round(turns[2].as_matrix(), 4), np.ones((3, 1))], [np.zeros((1, 3)), 1]]))
    bodies = [MovingCapsule(*rng.normal(size=(2, 3)), 0.1, *rng.normal(size=(2, 3))), MovingCapsule(*rng.normal(size=(2, 3)), 0.2)]
    person, box, plane = human_arm(), Box.at("box", MOUNT, [0.1, 0.2, 0.3]), KeepOut.through([1.0, 2.0, 3.0], [0.0, 3.0, 4.0])
    for arm in (person, human_arm(side="right")):
        told += [np.hstack(each) for each in arm_capsules(arm, 0.5 * (arm.lower + arm.upper), np.arange(8.0), placement=MOUNT)]
    inertias = [np.diag(each) for each in ((1, 1, 1), (1, 2, 3), (1, 2, 3.1), (-0.1, 1, 1), (1, 2, 3 + 1e-7), (0, 0, 0), (math.nan, 1, 1))]
    return {"numbers": exactly(*told, near, moving_numbers(bodies, 3), box.centre, box.turn, box.size, plane.normal, plane.offset, width=9), "note": note, "bodies": [of_a_body(each) for each in inertias]}


EDITS = (
    ('lower="', 'lower="9'), ('lower="', 'low="'), ('upper="', 'upp="'), ('velocity="', 'speed="'), ('velocity="', 'velocity="99'), ('velocity="', 'velocity="-'),
    ('type="revolute"', 'type="continuous"'), ('type="revolute"', 'type="Revolut"'), ('type="revolute"', 'type="planar"'), ('type="revolute"', 'type="prismatic"'), ('type="fixed"', 'type="floating"'),
    ("<axis", '<mimic joint="other"/><axis'), ('axis xyz="', 'axis xyz="2 0 0" old="'), ('axis xyz="', 'axis xyz="0 0 1e-12" old="'), ("<axis", "<dynamics damping='1'/><safety_controller/><axis"),
    ('xyz="', 'xyz="1 2" old="'), ('xyz="', 'xyz="1 2 300" old="'), ('rpy="', 'rpy="9 19 0" old="'), ('mass value="', 'mass value="-'), ('ixx="', 'ixx="9'), ('rpy="', 'quat_xyzw="0 0 0.7071 0.7071" old="'),
    ('<parent link="', '<parent link="nobody" old="'), ("</robot>", '<link name="beside"/></robot>'), ("<robot", "<!DOCTYPE a><robot"), ("</robot>", ""), ("limit ", "limit effort='7' "),
)  # fmt: skip
"""Of a robot's file: what its first place becomes."""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path


def files(folder: Path) -> Any:
    found: dict[str, Any] = {}
    panda = partial(SerialChain.from_urdf, PANDA, acceleration=7.5)
    hand = CapsuleOnLink("panda_link5", (0.0, 0.0, 0.0), (0.0, 0.1, -0.2), 0.06)
    given = {
        "panda": partial(panda, tip="panda_link8"), "hand": partial(panda, base="panda_link2", tip="panda_link8", mount=MOUNT, tool=MOUNT, capsules=[hand], locked={"panda_joint4": -1.0}),
        "said": partial(panda, tip="panda_link8", velocity=9.0, lower={"panda_joint1": -5.0, "panda_joint2": -1.0}, upper=[3.0, 2.0, 3.0, 0.5, 3.0, 4.0, 3.0]), "gen3": partial(SerialChain.from_urdf, GEN3, acceleration=200.0),
        "soft": partial(SerialChain.from_urdf, GEN3, acceleration=0.05), "bodies": partial(panda, tip="panda_link8", capsules="collision"), "nobody": partial(panda, tip="nobody"),
    }  # fmt: skip
    limits: dict[str, Any] = {"acceleration": 3.0, "velocity": 2.0, "lower": -1.5, "upper": 1.5}
    for seed in range(6):
        rng = np.random.default_rng(seed)
        edges = random_arm(rng, 2 + seed % 4)
        (folder / f"{seed}.urdf").write_text(text := urdf(edges))
        (folder / f"{seed}.xml").write_text(random_mjcf(rng, 2 + seed, degrees=seed % 2 == 0))
        given[f"urdf {seed}"] = partial(SerialChain.from_urdf, folder / f"{seed}.urdf", tip=edges[-1].child, **({} if seed else limits), **({"acceleration": 3.0} if seed else {}))
        given[f"mjcf {seed}"] = partial(SerialChain.from_mjcf, folder / f"{seed}.xml", tip="tool", **limits)
        for k, (before, after) in enumerate(EDITS[seed % 2 :: 2] if seed < 4 else ()):
            file = folder / f"{seed}_{k}.urdf"
            file.write_text(text.replace(before, after, 1 + seed))
            given[f"edit {seed} {k}"] = partial(SerialChain.from_urdf, file, tip=edges[-1].child, acceleration=3.0, velocity=None)
    for name, make in given.items():
        made: list[SerialChain] = []
        words = refusal(lambda make=make, made=made: made.append(make()))
        found[name] = chain_numbers(made[0]) if made else words.replace(str(folder), "").replace(str(ROBOTS), "")
    return found


def test_tables_give_what_was_kept() -> None:
    assert_kept("kinematics", {each.__name__: each() for each in (tables, mobile_arms, goniometry, frames)}, absolute=1e-4)


def test_files_give_what_was_kept(folder: Path) -> None:
    assert_kept("kinematics_files", files(folder), absolute=1e-4)
