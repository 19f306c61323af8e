"""A limit of your own: the elbow stays above a table while the target of the hand moves down."""

import casadi as ca
import numpy as np

from rehab_opt import Limit, PoseTracker, ur5

DT, TABLE = 0.01, 0.3  # [s], [m]


def above_table(chain, q):
    """Height h(q) [m] of the elbow above the table as a CasADi expression; the controller keeps it >= 0."""
    return chain.frames_expression(q)[2][2, 3] - TABLE


robot = ur5(velocity=1.0)
for limits in ([], [Limit(above_table)]):
    tracker = PoseTracker(robot, dt=DT, limits=limits)
    q = np.array([0.0, -1.2, 1.5, -1.8, -1.57, 0.0])
    target, down = robot.pose(q), np.array([0.0, 0.0, -0.1, 0.0, 0.0, 0.0])
    lowest = np.inf
    for _ in range(500):
        q = q + DT * tracker.step(q, target, down).value
        target[:3, 3] += DT * down[:3]
        lowest = min(lowest, float(ca.evalf(above_table(robot, ca.SX(q)))))
    height = robot.pose(q)[2, 3]
    print(f"{len(limits)} limits: lowest elbow {1e3 * lowest:.1f} mm above the table, hand at {height:.2f} m")
