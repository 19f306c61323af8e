"""Arms from files on wheelchairs: the campaign of `redundancy_campaign`, links by the files' own origins and axes.

    python -m tests.control.chair_arms_campaign --cases 100000
    python -m tests.control.chair_arms_campaign fixed --cases 100000

Every drive, or the one that is named: mecanum, differential, omnidirectional, fixed.

A UR5, and Kinova's Gen3 with seven joints of which four have no ends; both with capsules for their links.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Sequence
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from rehab_opt import CapsuleOnLink, RedundancyResolver, SerialChain
from rehab_opt.control.obstacles import Disc, HalfPlane
from rehab_opt.kinematics.arm_on_chair import arm_on_chair
from rehab_opt.kinematics.mobile_arm import MobileArm
from rehab_opt.symbolic import Compile
from tests.control.campaign import Array, Tally, main
from tests.control.redundancy_campaign import Links, Plant, judged, teleport
from tests.kinematics.robot_files.known_arms import gen3, vendors_ur5
from tests.kinematics.robot_files.random_arms import Edge, pose_of, urdf

ARMS = {
    "gen3": (gen3, {1: (0.0, -0.21, 0.0), 3: (0.0, -0.21, 0.0), 5: (0.0, -0.1, 0.0)}, 0.05),
    "ur5": (vendors_ur5, {1: (0.0, 0.0, 0.425), 2: (0.0, 0.0, 0.39), 4: (0.0, 0.0, 0.09)}, 0.06),
}
"""Edges, the ends of capsules that begin at the origin of a link by its number, and their radius [m]."""
DRIVES = {"mecanum": 0.01, "differential": 0.002, "omnidirectional": 0.01, "fixed": 0.005}
"""Drives, and the ticks [s] at which they are run."""
SETS = (("x", "y", "z"),)
MOUNT = np.eye(4)
MOUNT[:3, :3], MOUNT[:3, 3] = Rotation.from_euler("z", -0.4).as_matrix(), (0.25, -0.35, 0.62)


def run(
    cases: int, seed: int, *, compile: Compile = False, pairs: Sequence[tuple[str, str]] = tuple(product(ARMS, DRIVES))
) -> Tally:
    """Judge `cases` ticks of these arms on these drives."""
    rng = np.random.default_rng(seed)
    plants = [_plant(name, drive, DRIVES[drive], rng, compile) for name, drive in pairs]
    return judged(cases, plants, rng)


def run_of_drive(drive: str) -> Callable[..., Tally]:
    """The campaign of one drive."""
    return partial(run, pairs=[(name, drive) for name in ARMS])


def _plant(name: str, drive: str, dt: float, rng: np.random.Generator, compile: Compile) -> Plant:
    make, ends, radius = ARMS[name]
    edges = make()
    capsules = [CapsuleOnLink(edges[i].child, (0.0, 0.0, 0.0), end, radius) for i, end in ends.items()]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "arm.urdf"
        file.write_text(urdf(edges))
        arm = SerialChain.from_urdf(file, acceleration=4.0, capsules=capsules)
    robot = arm_on_chair(arm, mount=MOUNT)
    room = [HalfPlane((1, 0.1), 2.5), HalfPlane((-1, 0), 2.0), Disc((0.5, 1.5), 0.3)]
    resolver = RedundancyResolver(
        robot,
        drive=drive,
        row_sets=SETS,
        dt=dt,
        obstacles=room,
        recovery_speed=0.1,
        compile=compile,  # type: ignore[arg-type]
    )
    n = robot.chain.n
    plant = Plant(
        f"{name} {drive}", resolver, SETS, np.zeros(n), np.zeros(n), SETS[0], 0.1, links=_links(edges, ends, radius)
    )
    teleport(plant, rng)
    return plant


def _links(edges: list[Edge], ends: dict[int, tuple[float, float, float]], radius: float) -> Links:
    def found(_: MobileArm, q: Array) -> list[tuple[Array, Array, float]]:
        poses = {i: MOUNT @ pose_of(edges[: i + 1], q[3 : 4 + i]) for i in ends}
        return [(poses[i][:3, 3], (poses[i] @ [*end, 1.0])[:3], radius) for i, end in ends.items()]

    return found


if __name__ == "__main__":
    chosen = next((name for name in DRIVES if name in sys.argv[1:]), None)
    if chosen is not None:
        sys.argv.remove(chosen)
    main(run if chosen is None else run_of_drive(chosen), __doc__)
