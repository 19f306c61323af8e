"""A UR5 follows a pose that moves away, and slows down if its joints are too slow."""

import numpy as np

from rehab_opt import PoseTracker, ur5

DT, SPEED = 0.01, 0.4  # [s], [m/s]

robot = ur5(velocity=0.5)  # [rad/s] of each joint
tracker = PoseTracker(robot, dt=DT)
q = np.array([0.0, -1.2, 1.5, -1.8, -1.57, 0.0])
target, twist = robot.pose(q), np.array([0.0, SPEED, 0.0, 0.0, 0.0, 0.0])

for _ in range(100):
    command = tracker.step(q, target, twist)
    q = q + DT * command.value  # a robot whose joints move exactly as commanded
    target[:3, 3] += DT * twist[:3]

error = np.linalg.norm(robot.pose(q)[:3, 3] - target[:3, 3])
print(f"{command.status.name}: {100 * command.scale:.0f} % of the motion delivered, {1e3 * error:.2f} mm behind")
