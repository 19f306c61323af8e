"""MuJoCo's arms are the library's chains: poses, inertias and gravity by pinocchio, written from the rows alone."""

import numpy as np
import pytest

from rehab_opt import ardis, ur5
from rehab_opt.kinematics.chain import SerialChain
from rehab_opt.kinematics.denavit_hartenberg import DH
from rehab_opt.kinematics.inertia import Body
from rehab_opt.plants.arm_model import ArmModel, point_mass_model, ur5_model
from rehab_opt.plants.mujoco_arm import MujocoArm
from rehab_opt.plants.wheelchair import chair_arm_model
from tests.kinematics.dh_oracle import moved, turned

pytest.importorskip("mujoco")


def any_chain(seed: int) -> ArmModel:
    """Random rows, prismatic ones among them, with random bodies."""
    rng = np.random.default_rng(seed)
    rows = tuple(DH(*rng.uniform(-0.5, 0.5, 4), prismatic=bool(rng.random() < 0.3)) for _ in range(5))
    base, tool = (turned("z", a) @ turned("x", b) @ moved(x, y, z) for a, b, x, y, z in rng.uniform(-1, 1, (2, 5)))
    chain = SerialChain(rows, lower=-2.0, upper=2.0, velocity=1.0, acceleration=9.0, base=base, tool=tool)
    bodies = []
    for link in (1, 2, 2, 3, 4, 5):
        half = rng.normal(size=(3, 3))
        spin = half @ half.T
        bodies.append(
            Body("b", link, rng.uniform(0.5, 3), rng.uniform(-0.2, 0.2, 3), np.trace(spin) * np.eye(3) - spin)
        )
    numbers = np.full(5, 0.1)
    return ArmModel(chain, tuple(bodies), numbers, numbers, numbers, numbers, (1.0, -2.0, -9.0))


MODELS = {
    "ur5": lambda: ur5_model(
        ur5(tool=moved(z=0.1) @ turned("x", 0.3), base=turned("z", 1.0) @ moved(y=0.4)), payload=2
    ),
    "ardis": lambda: chair_arm_model(ardis(payload=0.5)),
    "point": lambda: point_mass_model(2.0),
    "any": lambda: any_chain(1),
    "another": lambda: any_chain(7),
}


@pytest.mark.parametrize("name", MODELS)
def test_the_hand_is_where_the_chain_says(name: str) -> None:
    model = MODELS[name]()
    plant, rng = MujocoArm(model, dt=0.001), np.random.default_rng(3)
    for q in rng.uniform(-2, 2, (20, model.chain.n)):
        plant.reset(q)
        np.testing.assert_allclose(plant.hand_pose, model.chain.pose(q), atol=1e-9)


@pytest.mark.parametrize("name", MODELS)
def test_pose_inertia_and_gravity_are_pinocchios(name: str) -> None:
    pin = pytest.importorskip("pinocchio")
    model = MODELS[name]()
    chain, n = model.chain, model.chain.n
    arm, parent, place = pin.Model(), 0, pin.SE3(np.array(chain.base))
    fixed = [moved(x=row.a) @ turned("x", row.alpha) for row in chain.rows]
    for i, row in enumerate(chain.rows):
        kind = pin.JointModelPZ() if row.prismatic else pin.JointModelRZ()
        begin = pin.SE3(turned("z", row.theta) @ moved(z=row.d))  # about and along one axis, in whatever order
        parent = arm.addJoint(parent, kind, place * begin, f"j{i}")
        place = pin.SE3(fixed[i])
        for body in (each for each in model.bodies if each.link == i + 1):
            solid = pin.Inertia(body.mass, np.array(body.centre), np.array(body.inertia))
            arm.appendBodyToJoint(parent, solid, place)
    arm.gravity.linear = np.array(model.gravity)
    tool = arm.addFrame(pin.Frame("tool", parent, 0, place * pin.SE3(np.array(chain.tool)), pin.FrameType.OP_FRAME))
    data, plant, rng = arm.createData(), MujocoArm(model, dt=0.001), np.random.default_rng(5)
    for q, v in rng.uniform(-2, 2, (10, 2, n)):
        pin.framesForwardKinematics(arm, data, q)
        plant.reset(q, v)
        np.testing.assert_allclose(plant.hand_pose, data.oMf[tool].homogeneous, atol=1e-9)
        upper = np.triu(pin.crba(arm, data, q))
        inertia = upper + np.triu(upper, 1).T + np.diag(model.rotors)
        np.testing.assert_allclose(plant.inertia(q), inertia, atol=2e-7)  # links of no mass weigh 1e-9 kg in MuJoCo
        felt = pin.rnea(arm, data, q, v, np.zeros(n))
        np.testing.assert_allclose(plant.feedforward(), felt, atol=2e-7)
