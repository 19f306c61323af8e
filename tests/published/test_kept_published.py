"""Numbers of the published laws, kept."""

from __future__ import annotations

import numpy as np

from problems.mirror import motions
from rehab_opt import ur5
from rehab_opt.kinematics.ardis import ardis
from rehab_opt.kinematics.human_arm import human_arm
from rehab_opt.published.astar import astar_path
from rehab_opt.published.field_law import FieldLaw
from rehab_opt.published.pseudoinverse_law import PseudoinverseLaw
from rehab_opt.published.tangent_law import TangentLaw, damped_pseudoinverse
from tests.control.mirror_campaign import LARGEST
from tests.golden import assert_kept
from tests.golden.returns import Returns, sums

LINE = np.column_stack([np.linspace(-0.15, 0.15, 49), 0.4 + 0.03 * np.linspace(-1, 1, 49) ** 2])


def test_published_laws() -> None:
    rng, more, robot = np.random.default_rng(2), [], ardis()
    with Returns("rehab_opt/published/") as seen:
        law = FieldLaw(LINE, stiffness=900.0, drag=200.0, width=0.03, damping=7.0)
        for x in rng.uniform((-0.2, 0.3), (0.2, 0.5), (8, 2)):
            more += [law.force(x, x / 3), law.energy(x), law.force(x)]
        for drive in ("mecanum", "differential"):
            eq1 = PseudoinverseLaw(robot, drive=drive)
            for rows in (("x", "y"), ("z", "roll7"), ("x", "y", "z", "rx")):
                q = np.concatenate([rng.uniform(-3, 3, 3), rng.uniform(robot.chain.lower[3:], robot.chain.upper[3:])])
                more += [eq1.rate(q, 0.2 * rng.standard_normal(len(rows)), rows), eq1.task_jacobian(q, rows)]
        for arm in (human_arm(), human_arm(range_of_motion="restricted", side="right")):
            tangent, middle = TangentLaw(arm), 0.5 * (arm.lower + arm.upper)
            for q in (middle, rng.uniform(arm.lower, arm.upper)):
                more += [tangent.transformed(q), tangent.joints(tangent.transformed(q))]
            target = arm.pose(middle)[:3, 3] + np.linspace(0, 0.03, 25)[:, None] * (1, -1, 0.5)
            target[7] = np.nan
            found = tangent.follow(target) if hasattr(tangent, "follow") else None
            more += [found.q, found.position_error, found.handle_tilt] if found is not None else []
        more.append(damped_pseudoinverse(rng.normal(size=(3, 5)), 1e-3))
        chain, start = ur5(), motions.START
        poses = np.tile(chain.pose(start), (30, 1, 1))
        poses[:, 1, 3] += np.linspace(0, 0.06, 30)
        poses[:, 0, 3] -= np.linspace(0, 0.25, 30) ** 2
        for floor in (0.3, 0.75):
            path = astar_path(chain, poses, start, floor=floor, max_manipulability=LARGEST, resolution=0.02)
            more += [path.positions, path.q, path.nearest, path.complete, path.deviations(poses[:, :3, 3])]
    assert_kept("published", [seen.numbers(), [sums(each) for each in more]], relative=1e-5, absolute=1e-8)
