"""Twelve arms from the files that ship with packages, beside pinocchio: `python -m bench.imported_arms`.

Pose and Jacobian of `SerialChain.from_urdf` at 10^4 random postures each. The files are read as they come; what they
lack is said here. Nothing of them is copied: they lie in packages, where each folder has its own licence.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
import pinocchio
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from bench.machine import machine
from bench.verdict import Verdict, all_met, print_verdicts
from rehab_opt import SerialChain
from tests.kinematics.robot_files.known_arms import gen3
from tests.kinematics.robot_files.random_arms import urdf

__all__ = ["main"]

Array = NDArray[np.float64]

ASKED = 1e-12
"""[m, 1] Largest difference of any entry of pose and Jacobian."""
READ = 2.0
"""[s] in which the first pose of a new arm is there."""
ROBOTS = "cmeel.prefix/share/example-robot-data/robots"
NO_LOCKS: Mapping[str, float] = MappingProxyType({})


class Arm(NamedTuple):
    """One arm of a package."""

    name: str
    file: str
    """Below the folder that packages are installed in."""
    base: str | None
    tip: str
    joints: int
    locked: Mapping[str, float] = NO_LOCKS


ARMS = (
    Arm("UR5", f"{ROBOTS}/ur_description/urdf/ur5_robot.urdf", "base_link", "tool0", 6),
    Arm("UR10", f"{ROBOTS}/ur_description/urdf/ur10_robot.urdf", "base_link", "tool0", 6),
    Arm("Panda", f"{ROBOTS}/panda_description/urdf/panda.urdf", "panda_link0", "panda_hand_tcp", 7),
    Arm("FR3", "franka_sim/models/fr3.urdf", "base", "link8", 7),
    Arm("Jaco j2s6s200", f"{ROBOTS}/kinova_description/robots/kinova.urdf", None, "j2s6s200_end_effector", 6),
    Arm("TIAGo with torso", f"{ROBOTS}/tiago_description/robots/tiago.urdf", "base_link", "arm_tool_link", 8),
    Arm(
        "TIAGo, torso locked", f"{ROBOTS}/tiago_description/robots/tiago.urdf", "base_link", "arm_tool_link", 7,
        {"torso_lift_joint": 0.15},
    ),
    Arm("Talos left arm", f"{ROBOTS}/talos_data/robots/talos_reduced.urdf", "torso_2_link", "wrist_left_ft_link", 7),
    Arm("xArm7", f"{ROBOTS}/xarm_description/urdf/xarm7.urdf", "link_base", "link_eef", 7),
    Arm("Baxter left arm", f"{ROBOTS}/baxter_description/urdf/baxter.urdf", "base", "left_gripper", 7),
    Arm("SO-101", f"{ROBOTS}/so_arm_description/urdf/so101.urdf", None, "gripper_frame_link", 5),
    Arm("iiwa 14", "rtbdata/xacro/kuka_description/kuka_lbr_iiwa/urdf/lbr_iiwa_14_r820.urdf", "base_link", "tool0", 7),
)  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table and the verdicts; 0 where every arm is met."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--states", type=int, default=10_000)
    parser.add_argument("--packages", type=Path, action="append", default=[], help="folder that wheels are unpacked in")
    options = parser.parse_args(arguments)
    console = Console()
    console.print(machine())
    table = Table("arm", "joints", "pose", "Jacobian", "first pose [ms]", "notes")
    verdicts = []
    with tempfile.TemporaryDirectory() as scratch:
        own = Path(scratch) / "gen3.urdf"
        own.write_text(urdf(gen3()))
        folders = [*options.packages, *map(Path, sys.path), Path(scratch)]
        for arm in (*ARMS, Arm("Gen3, own numbers", "gen3.urdf", "base", "l6", 7)):
            file = next((folder / arm.file for folder in folders if (folder / arm.file).exists()), None)
            if file is None:
                verdicts.append(Verdict(f"{arm.name}: file {arm.file}", float("nan"), "<=", ASKED))
                continue
            pose, jacobian, seconds, chain = differences(file, arm, options.states)
            table.add_row(
                arm.name, str(chain.n), f"{pose:.1e}", f"{jacobian:.1e}", f"{1e3 * seconds:.0f}", *chain.notes[:1]
            )
            verdicts += [
                Verdict(f"{arm.name}: pose and Jacobian", max(pose, jacobian), "<=", ASKED),
                Verdict(f"{arm.name}: joints less {arm.joints}", abs(chain.n - arm.joints), "<=", 0),
                Verdict(f"{arm.name}: first pose", seconds, "<=", READ, "s"),
            ]
    console.print(table)
    print_verdicts(console, verdicts)
    return 0 if all_met(verdicts) else 1


def differences(file: Path, arm: Arm, states: int) -> tuple[float, float, float, SerialChain]:
    """Largest difference of pose and of Jacobian from pinocchio's, seconds to the first pose, and the chain."""
    began = time.perf_counter()
    chain = SerialChain.from_urdf(file, base=arm.base, tip=arm.tip, acceleration=10.0, locked=arm.locked)
    chain.pose(np.zeros(chain.n))
    seconds = time.perf_counter() - began
    model = pinocchio.buildModelFromUrdf(str(file))
    data = model.createData()
    base, tip = (None if name is None else model.getFrameId(name) for name in (arm.base, arm.tip))
    joints = [model.joints[model.getJointId(name)] for name in chain.names]
    held = [(model.joints[model.getJointId(name)], value) for name, value in arm.locked.items()]
    columns = [joint.idx_v for joint in joints]
    low = np.where(np.isfinite(chain.lower), chain.lower, -np.pi)
    high = np.where(np.isfinite(chain.upper), chain.upper, np.pi)
    worst = np.zeros(2)
    for q in np.random.default_rng(0).uniform(low, high, (states, chain.n)):
        whole = pinocchio.neutral(model)
        for joint, value in [*zip(joints, q, strict=True), *held]:
            # Pinocchio has cosine and sine of a joint without ends.
            whole[joint.idx_q : joint.idx_q + joint.nq] = value if joint.nq == 1 else (np.cos(value), np.sin(value))
        pinocchio.computeJointJacobians(model, data, whole)
        pinocchio.updateFramePlacements(model, data)
        foot = pinocchio.SE3.Identity() if base is None else data.oMf[base]
        expected = foot.inverse() * data.oMf[tip]
        jacobian = pinocchio.getFrameJacobian(model, data, tip, pinocchio.LOCAL_WORLD_ALIGNED)[:, columns]
        turned = np.vstack([foot.rotation.T @ jacobian[:3], foot.rotation.T @ jacobian[3:]])
        found = np.abs(chain.pose(q) - expected.homogeneous).max(), np.abs(chain.jacobian(q) - turned).max()
        worst = np.maximum(worst, found)
    return float(worst[0]), float(worst[1]), seconds, chain


if __name__ == "__main__":
    raise SystemExit(main())
