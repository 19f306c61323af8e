"""Mass, friction, servos and contact, each against a closed form."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from bench.physics.arms import rods_along
from bench.physics.forces import SpringDamper
from rehab_opt import SerialChain, ardis, ur5
from rehab_opt.kinematics.ardis import ARDIS_READY
from rehab_opt.kinematics.body import Body
from rehab_opt.kinematics.denavit_hartenberg import DH
from rehab_opt.plants.arm_model import ArmModel, point_mass_model, ur5_model
from rehab_opt.plants.contacts import Wall
from rehab_opt.plants.drives import DriveState, HandForce, PositionServo, VelocityServo
from rehab_opt.plants.ideal import IdealJoints
from rehab_opt.plants.mujoco_arm import MujocoArm
from rehab_opt.plants.wheelchair import Wheelchair

pytest.importorskip("mujoco")
READY = np.array([0.0, -1.2, 1.5, -1.8, -1.57, 0.0])


class Limp:
    """No torque at all, not even against gravity."""

    def start(self, position: np.ndarray, *_: object) -> np.ndarray:
        return np.zeros(len(position))

    def torque(self, command: np.ndarray, state: DriveState, feedforward: np.ndarray) -> np.ndarray:
        return np.zeros(len(command))


def energies(coulomb: float, viscous: float, ticks: int = 400) -> np.ndarray:
    model = ur5_model(coulomb=coulomb)
    model = type(model)(model.chain, model.bodies, model.rotors, model.torque_limit, model.coulomb, np.full(6, viscous))
    plant = MujocoArm(model, dt=0.001, drive=Limp(), physics_step=2.5e-4)
    plant.reset(READY, np.array([1.0, -0.5, 0.8, 1.0, -2.0, 1.0]))
    found = [plant.energy]
    for _ in range(ticks):
        plant.step(np.zeros(6))
        found.append(plant.energy)
    return np.array(found)


def test_a_passive_arm_never_gains_energy() -> None:
    lost = energies(coulomb=3.0, viscous=1.0)
    assert np.diff(lost).max() <= 1e-6 * np.ptp(lost)
    assert np.ptp(lost) > 1.0
    free = energies(coulomb=0.0, viscous=0.0)
    assert np.abs(free - free[0]).max() < 0.01 * np.ptp(lost)  # the integrator's own error: nothing is lost


def test_friction_takes_what_leaves_the_arm() -> None:
    # A mass on dry friction F and drag b: m v' = -F - b v, to rest at t = (m / b) ln(1 + b v0 / F).
    m, b, force, v0 = 2.0, 3.0, 4.0, 0.8
    plant = MujocoArm(point_mass_model(m, viscous=b, coulomb=force), dt=0.001, drive=HandForce(), physics_step=1e-4)
    plant.reset([0.0, 0.0], [v0, 0.0])
    end = m / b * math.log(1 + b * v0 / force)
    way = m / b * (v0 - force / b * math.log(1 + b * v0 / force))
    for _ in range(round((end + 0.05) / 0.001)):
        plant.step([0.0, 0.0])
    assert abs(plant.truth.velocity[0]) < 1e-3
    assert abs(plant.truth.position[0] - way) < 5e-3 * way


def test_no_drive_gives_more_than_its_torque_limit() -> None:
    for drive, command in ((VelocityServo(), np.full(6, 3.0)), (PositionServo(), READY + 1.0)):
        plant = MujocoArm(ur5_model(payload=10.0), dt=0.002, drive=drive)
        plant.reset(READY)
        efforts = []
        for k in range(300):
            plant.step(command * (-1) ** (k // 30))
            efforts.append(np.abs(plant.truth.effort))
        most = np.max(efforts, axis=0)
        assert np.all(most <= plant.model.torque_limit)
        assert np.any(most == plant.model.torque_limit)


def followed(servo: VelocityServo | PositionServo, hertz: float) -> float:
    """Size of the motion over that of the command, on one axis of 2 kg without friction."""
    plant = MujocoArm(point_mass_model(2.0), dt=1e-3, drive=servo, physics_step=5e-5)
    plant.reset([0.0, 0.0])
    told = 0.001 * np.sin(2 * np.pi * hertz * 1e-3 * np.arange(1000))
    seen = []
    for each in told:
        plant.step([each, 0.0])
        truth = plant.truth
        seen.append(truth.velocity[0] if isinstance(servo, VelocityServo) else truth.position[0])
    late = np.exp(-2j * np.pi * hertz * 1e-3 * np.arange(500, 1000))
    return abs(np.dot(late, seen[500:])) / abs(np.dot(late, told[500:]))


@pytest.mark.parametrize("servo", [VelocityServo, PositionServo])
def test_servos_have_the_bandwidth_they_are_made_for(servo: type[VelocityServo]) -> None:
    assert followed(servo(24.0), 24.0) == pytest.approx(math.sqrt(0.5), rel=0.02)
    assert followed(servo(24.0), 2.0) == pytest.approx(1.0, rel=0.05)


def test_wall_gives_way_by_force_over_stiffness_and_never_pulls() -> None:
    wall = Wall([0.1, 0.0, 0.0], [-1.0, 0.0, 0.0], stiffness=5e3, damping=100.0)
    plant = MujocoArm(point_mass_model(2.0, viscous=40.0), dt=0.001, drive=HandForce(), contacts=[wall])
    plant.reset([0.09, 0.0])
    for _ in range(3000):
        plant.step([20.0, 0.0])
    assert plant.truth.position[0] - 0.1 == pytest.approx(20.0 / 5e3, rel=1e-3)
    assert plant.measured.force[0] == pytest.approx(-20.0, rel=1e-3)
    for _ in range(1000):
        plant.step([-20.0, 0.0])
        assert plant.truth.force[0] <= 0.0
    assert plant.truth.position[0] < 0.05


def test_person_at_the_hand_is_a_spring_and_a_damper() -> None:
    # Underdamped, in closed form: x = A exp(-d t) cos(w t - phi).
    m, k, c = 2.0, 300.0, 8.0
    person = SpringDamper([0.0, 0.0, 0.0], stiffness=k, damping=c)
    plant = MujocoArm(point_mass_model(m), dt=0.001, drive=HandForce(), contacts=[person], physics_step=5e-5)
    plant.reset([0.1, 0.0])
    for _ in range(500):
        plant.step([0.0, 0.0])
    decay, rate = c / (2 * m), math.sqrt(k / m - (c / (2 * m)) ** 2)
    expected = 0.1 * math.exp(-decay * 0.5) * (math.cos(rate * 0.5) + decay / rate * math.sin(rate * 0.5))
    assert plant.truth.position[0] == pytest.approx(expected, abs=1e-4)


def test_force_at_the_hand_of_an_arm_is_the_transpose_jacobians() -> None:
    # Held by a spring on every side, the arm comes to rest where the spring balances the commanded force.
    turn, far, fast = np.full(2, math.pi), np.full(2, math.inf), np.full(2, 10.0)
    rows = (DH(0.35, 0.0), DH(0.35, 0.0))
    chain = SerialChain(rows, lower=-turn, upper=turn, velocity=fast, acceleration=far, names=("shoulder", "elbow"))
    held = Body("hand", 2, 1.2, np.zeros(3), np.zeros((3, 3)))
    bodies = (*rods_along(chain, (1.5, 1.0), radius=0.03), held)
    model = ArmModel(chain, bodies, *(np.full(2, each) for each in (0.02, 40.0, 0.0, 0.2)))
    q = np.array([0.4, 1.2])
    anchor = model.chain.pose(q)[:3, 3]
    person = SpringDamper(anchor, stiffness=500.0, damping=60.0)
    plant = MujocoArm(model, dt=0.001, drive=HandForce(), contacts=[person])
    plant.reset(q)
    for _ in range(4000):
        plant.step([6.0, -4.0])
    moved = plant.hand_pose[:3, 3] - anchor
    np.testing.assert_allclose(moved[:2], np.array([6.0, -4.0]) / 500.0, rtol=1e-3)


def test_ideal_joints_are_the_sum_of_what_was_commanded() -> None:
    plant, rng = IdealJoints(0.004), np.random.default_rng(0)
    now = READY.copy()
    plant.reset(now)
    for _ in range(50):
        command = rng.normal(size=6)
        seen = plant.step(command)
        now = now + command * 0.004
        assert np.array_equal(seen.position, now)
        assert np.array_equal(plant.truth.position, now)
    assert seen.stamp == 50 * 0.004


@pytest.mark.parametrize("drive", ["mecanum", "differential"])
def test_chair_goes_as_its_wheels_roll_after_their_lag(drive: str) -> None:
    robot = ardis()
    wheels = getattr(robot, drive)
    plant = Wheelchair(robot, wheels, dt=0.01, wheel_lag=0.1)
    plant.reset(ARDIS_READY)
    twist = np.array([0.4, 0.1 if drive == "mecanum" else 0.0, 0.0])
    told = np.concatenate([wheels.wheel_speeds(twist), np.zeros(4)])
    for _ in range(100):
        plant.step(told)
    gone = 1.0 - 0.1 * (1 - math.exp(-10.0))  # a first-order lag, summed
    np.testing.assert_allclose(plant.truth.position[:3], gone * twist, atol=1e-3)
    # Turning on an arc: a quarter of it brings the chair to (r, r).
    plant.reset(ARDIS_READY)
    told = np.concatenate([wheels.wheel_speeds([0.5, 0.0, 0.5]), np.zeros(4)])
    while plant.truth.position[2] < math.pi / 2:
        plant.step(told)
    np.testing.assert_allclose(plant.truth.position[:2], [1.0, 1.0], atol=0.01)
    np.testing.assert_allclose(plant.truth.position[3:], ARDIS_READY[3:], atol=2e-3)


def test_a_push_bends_the_arm_of_a_turned_chair_as_the_same_push_seen_from_the_chair() -> None:
    robot = ardis()
    plant = Wheelchair(robot, robot.mecanum, dt=0.01)

    def bent(heading: float, push: list[float]) -> NDArray[np.float64]:
        plant.reset([0.0, 0.0, heading, *ARDIS_READY[3:]])
        for _ in range(20):
            plant.step(np.zeros(8), push)
        return plant.truth.position[3:] - ARDIS_READY[3:]

    ahead = bent(0.0, [60.0, 20.0, 10.0])
    assert np.abs(ahead).max() > 1e-4
    np.testing.assert_allclose(bent(math.pi / 2, [-20.0, 60.0, 10.0]), ahead, rtol=1e-6, atol=1e-9)


def test_ur5_weighs_what_its_vendor_says_turns_like_solid_cylinders_and_can_hold_itself() -> None:
    model = ur5_model(ur5())
    assert sum(body.mass for body in model.bodies) == pytest.approx(17.05, abs=0.01)
    mass, length, radius = np.array([
        (3.7, 0.178, 0.075), (8.393, 0.425, 0.06), (2.33, 0.39225, 0.06),
        (1.219, 0.095, 0.06), (1.219, 0.085, 0.06), (0.1879, 0.0305, 0.0375),
    ]).T  # fmt: skip
    traces = [np.trace(body.inertia) for body in model.bodies if body.mass]
    np.testing.assert_allclose(traces, mass * (radius**2 + length**2 / 6))
    plant = MujocoArm(model, dt=0.001)
    plant.reset([0.0, 0.0, 0.0, 0.0, 0.0, 0.0])  # stretched out: the most gravity asks for
    assert np.all(np.abs(plant.feedforward()) < 0.6 * model.torque_limit)
