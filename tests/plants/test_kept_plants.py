"""Numbers of plants and people, kept: short open-loop runs from seeded states."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import shapely

from rehab_opt import SerialChain, ardis
from rehab_opt.kinematics.ardis import ARDIS_READY
from rehab_opt.plants.arm_model import own_arm_model, point_mass_model, ur5_model
from rehab_opt.plants.channel import Channel
from rehab_opt.plants.contacts import Wall
from rehab_opt.plants.drives import ForceLoop, HandForce, HandForceLoop, PositionServo, VelocityServo
from rehab_opt.plants.force_robot import RobotModel
from rehab_opt.plants.hand_robot import OnMujoco, WithoutDelay
from rehab_opt.plants.ideal import IdealJoints
from rehab_opt.plants.intention import Pace, held, nearest_next, reached, traced
from rehab_opt.plants.mujoco_arm import MujocoArm
from rehab_opt.plants.plant import PositionStream
from rehab_opt.plants.simulated_person import Person, PersonAtRobot, SimulatedPerson
from rehab_opt.plants.touched import TouchedPlant
from rehab_opt.plants.wheelchair import Wheelchair
from rehab_opt.session.files import shipped_folder
from rehab_opt.workspace.region import Workspace
from tests.golden import assert_kept
from tests.golden.returns import Returns, sums

pytest.importorskip("mujoco")
PANDA = SerialChain.from_urdf(shipped_folder() / "robots/franka_panda/panda.urdf", tip="panda_link8", acceleration=5.0)
READY = np.array([0.0, -1.2, 1.5, -1.8, -1.57, 0.0])
LATE = Channel(command_delay=0.004, measurement_delay=0.003, command_jitter=0.002, measurement_jitter=0.001,
               position_noise=1e-4, position_resolution=1e-4, velocity_noise=1e-3, force_noise=0.1)  # fmt: skip
WAY = np.column_stack([np.linspace(-0.05, 0.1, 40), 0.45 + 0.03 * np.sin(np.linspace(0, 3, 40))])
WITHIN = Workspace(shapely.box(-0.05, 0.40, 0.05, 0.50), accuracy=1e-6)


def moved(plant: object, start: np.ndarray, command: np.ndarray, ticks: int = 25) -> list[object]:
    """What is measured and true, pushed from half of the time on."""
    plant.reset(start)
    found, push = [], np.array([3.0, -2.0, 1.0])
    for k in range(ticks):
        pushed = push if k > ticks / 2 else None
        found.append([plant.step(command * math.cos(0.2 * k), pushed), plant.truth])
    return found


def test_plants() -> None:
    more = []
    with Returns("rehab_opt/plants/") as seen:
        models = (ur5_model(payload=1.5), own_arm_model(PANDA, payload=0.5))
        for (model, drive), channel in zip(  # noqa: B905  (four)
            itertools.product(models, (VelocityServo(), PositionServo(16.0))), (LATE, None) * 2
        ):
            given = {"channel": channel} if channel else {}
            plant = MujocoArm(
                model, dt=0.002, drive=drive, seed=3, contacts=[Wall([0.2, 0, 0.3], [0, 0, 1.0])], **given
            )
            start = READY if model.chain.n == 6 else np.deg2rad([0, -45, 0, -135, 0, 90, 45])
            command = start + 0.1 if isinstance(drive, PositionServo) else np.full(len(start), 0.3)
            more += [moved(plant, start, command), plant.energy, plant.hand_pose, plant.inertia(start)]
        for drive in (
            HandForce(0.01),
            HandForce(),
            HandForceLoop(0.8, 60.0, 80.0, held_mass=1.0, lag=0.004, noise=0.05, rng=np.random.default_rng(6)),
        ):
            mass = MujocoArm(
                point_mass_model(2.0, viscous=3.0, coulomb=1.0), dt=0.001, drive=drive, channel=LATE, seed=1
            )
            more.append(moved(mass, np.array([0.3, -0.2]), np.array([4.0, -3.0])))
        robot = ardis()
        for lag, wheels in ((0.08, robot.mecanum), (0.0, robot.differential)):
            chair = Wheelchair(robot, wheels, dt=0.01, wheel_lag=lag, channel=LATE, seed=2)
            told = np.full(len(wheels.rolling) + chair.n - 3, 0.2)
            more += [moved(chair, np.array([0.2, 0.1, 0.7, *ARDIS_READY[3:]]), told, 12), chair.wheels]
        for plant in (IdealJoints(0.01), PositionStream(IdealJoints(0.01)), TouchedPlant(IdealJoints(0.01), seed=4)):
            if isinstance(plant, TouchedPlant):
                plant.noise, plant.delay = 0.01, 0.03
            more.append(moved(plant, READY, np.full(6, 0.2)))
            if isinstance(plant, TouchedPlant):
                plant.frozen = True
                more += [plant.step(np.full(6, 0.2)) for _ in range(3)]
        loop = ForceLoop(2.0, 30.0, 40.0, step=1e-3)
        more += [[loop.motor(axis, error, 1.0) for axis in (0, 1)] for error in (5.0, -60.0, 0.0, 80.0)]
    assert_kept("plants.arms", [seen.numbers(), [sums(each) for each in more]], relative=1e-4, absolute=1e-7)


def test_people() -> None:
    more, rng = [], np.random.default_rng(5)
    with Returns("rehab_opt/plants/") as seen:
        for person in (Person(), Person(aims="path", spasm_rate=4.0, tremor=2.0, wander=0.02, strength=6.0)):
            one = SimulatedPerson(person, WITHIN, dt=0.005, ticks=400, seed=(1, 2))
            for state in rng.uniform(-0.1, 0.1, (60, 8)) + (0, 0.45, 0, 0, 0, 0.45, 0, 0):
                more += [one.force(*state), one.beyond]
        for made in (reached(WAY, seconds=0.3, rest=0.1, dt=0.01), traced(WAY, seconds=0.25, rest=0.1, dt=0.01),
                     held(WAY[::13], move=0.1, dwell=0.05, dt=0.01)):  # fmt: skip
            for aims in ("clock", "path"):
                pace = Pace(made, aims, ahead=0.01)
                hand = np.vstack((made.places[::2] + 0.004, made.places[::3]))
                more.append([pace.meant(*at) for at in hand] + [pace.ticks, pace.over])
        more.append(nearest_next(rng.uniform(0, 1, (12, 2))))
        for model in (
            RobotModel(),
            RobotModel(gain=0.0, coulomb=0.0, motor_limit=5.0, lower=(-0.02, 0.44), upper=(0.03, 0.46)),
        ):
            for makes in (WithoutDelay(model), OnMujoco(model, LATE, 0.01, 5e-4, 7)):
                robot = makes.robot(hand_mass=1.0, start=(0.0, 0.45), dt=0.002, rng=np.random.default_rng(2), ticks=80)
                for k in range(60):
                    robot.step(6 * math.sin(0.3 * k), 4.0, 2.0, -9.0 * math.cos(0.1 * k))
                    more.append([robot.seen, robot.acting if hasattr(robot, "acting") else 0])
            more.append(
                [model.growth(1.0, stiffness=s, damping=d, dt=0.002) for s, d in ((0, 0), (2000, 10), (9000, 900))]
            )
            at_robot = PersonAtRobot(Person(), WITHIN, WithoutDelay(model), dt=0.005, seed=3, ticks=25)
            at_robot.reset((0.0, 0.45))
            for k in range(40):
                at_robot.target = (0.05, 0.46, 0.1, 0.0) if k > 10 else None
                more += [at_robot.step([3.0, -1.0], [0.5, 0.2] if k > 20 else None), at_robot.truth, at_robot.hand]
    assert_kept(
        "plants.people",
        [seen.numbers(with_constants=False), [sums(each) for each in more]],
        relative=1e-4,
        absolute=1e-7,
    )
