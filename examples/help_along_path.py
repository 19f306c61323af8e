"""A hand reaches along a path; outside the person's comfortable workspace the robot helps with up to 30 N."""

import numpy as np

from rehab_opt import Assistance, PotentialField, human_arm, planar_workspace

DT = 0.001  # [s]

comfortable = planar_workspace(human_arm(range_of_motion="restricted"))
path = np.column_stack((np.linspace(-0.17, -0.35, 50), np.full(50, 0.50)))  # [m]
assistance = Assistance(
    PotentialField(path, stiffness=1000.0, drag=200.0, width=0.025), comfortable=comfortable, force_limit=30.0
)

hand, velocity, largest = np.array([-0.17, 0.51]), np.zeros(2), 0.0
mass, damping, push = 2.0, 10.0, np.array([-4.0, 0.0])  # [kg], [N s/m], [N]: a weak person's arm
for _ in range(2000):
    force = assistance.step(hand, velocity).value
    velocity = velocity + DT * (force + push - damping * velocity) / mass
    hand = hand + DT * velocity
    largest = max(largest, float(np.linalg.norm(force)))

print(f"hand at {hand[0]:.3f}, {hand[1]:.3f} m, largest force {largest:.1f} N")
