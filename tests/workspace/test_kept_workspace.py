"""Numbers of the workspace's parts, kept: sets, splines, maps and searches on seeded inputs, ties included."""

from __future__ import annotations

import math
from collections.abc import Sequence

import casadi as ca
import numpy as np
import shapely

from rehab_opt import DH, SerialChain, human_arm
from rehab_opt.kinematics.human_arm import ARM_JOINTS
from rehab_opt.workspace import clinical_angles, edge_distance
from rehab_opt.workspace.cp_reach import grasp_zero, group_range, reach_groups
from rehab_opt.workspace.layered_mesh import closed_mesh, enclosed_volume
from rehab_opt.workspace.mapping import WorkspaceMap
from rehab_opt.workspace.placement import ShoulderPlacement
from rehab_opt.workspace.polar import polar_landmarks
from rehab_opt.workspace.reach import planar_workspace
from rehab_opt.workspace.reach_rows import read_cp_reach
from rehab_opt.workspace.region import Workspace
from rehab_opt.workspace.used_range import range_of_motion
from rehab_opt.workspace.variation import reachability_map, varied_ranges
from rehab_opt.workspace.volume import reachable_volume
from tests.golden import assert_kept
from tests.golden.returns import Returns, sums
from tests.workspace.mapped import blob, crescent, ell, sliver
from tests.workspace.polygons import around

SQUARE = shapely.box(0.0, 0.0, 2.0, 1.0)
HOLED = shapely.union_all([SQUARE.difference(shapely.box(0.5, 0.25, 1.0, 0.75)), shapely.box(2.5, 0, 3, 0.5)])
TOUCHING = shapely.MultiPolygon([shapely.box(0, 0, 1, 1), shapely.box(1, 1, 2, 2)])


def grid(steps: int, low: float = -0.5, high: float = 2.5) -> np.ndarray:
    side = np.linspace(low, high, steps)
    return np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)


def kept(name: str, seen: Returns, more: Sequence[object] = ()) -> None:
    assert_kept(
        f"workspace.{name}",
        [seen.numbers(with_constants=name == "sets"), [sums(each) for each in more]],
        relative=1e-5,
        absolute=1e-7,
    )


def test_sets() -> None:
    more = []
    with Returns("rehab_opt/workspace/") as seen:
        for polygon in (SQUARE, HOLED, TOUCHING, crescent(), ell(), sliver(), blob()):
            asked = Workspace(polygon, accuracy=1e-3, height=-0.2, handle_tilt=0.1)
            points = np.vstack(
                (grid(9), around(polygon, 40, 3.0, 1), [[math.nan, 0], [math.inf, 0], [60, 7], [1e200, 0]])
            )
            asked.distance(points), asked.contains(points)
            for point in points:
                asked.contains(point), asked.nearest(point), asked.signed_distance_and_closest_point(point)
                asked.distance(point)
            asked.placed(ShoulderPlacement((0.1, -0.2, 0.3), 0.4)).contains(points)
            columns = edge_distance.edge_columns(polygon)
            for made in (
                edge_distance.distance_function(len(columns)),
                edge_distance.nearest_point_function(len(columns)),
            ):
                more += [ca.vertcat(*made.call([ca.DM(p), ca.DM(columns)])).full() for p in points[::7]]
            more.append([asked.area, asked.components, asked.holes, repr(asked)])
        Workspace(shapely.Polygon(), accuracy=1e-3, reason="out").distance(grid(2))
    kept("sets", seen, more)


def test_published_maps() -> None:
    more: list[object] = []
    for source, target, given in (
        (crescent(), ell(), {"rotation": 0.2}),
        (blob(), sliver(), {"landmarks": 12, "rotation": -0.2}),
    ):
        polygons = (Workspace(each, accuracy=1e-4) for each in (source, target))
        made = WorkspaceMap.between(*polygons, rule="polar", **given)
        points, audit = around(source, 12, 2.0, 3), made.audit(400, 1)
        more += [made.rotation, made(points), made.inverse(made(points)), made.jacobian(points), repr(made), str(audit)]
        held = made.for_controller(unsafe=True)
        more += [[held.image(each), held.jacobian(each).ravel(), held.preimage(each)] for each in points]
    more += [np.hstack(polar_landmarks(*each, landmarks=9)) for each in ((crescent(), SQUARE), (SQUARE, sliver()))]
    assert_kept("workspace.maps", [sums(each) for each in more], relative=1e-5, absolute=1e-7)


def test_searches() -> None:
    rows = (DH(0.3, 0.0), DH(0.2, 0.0))
    two = SerialChain(rows, lower=[-1.0, 0.2], upper=[1.5, 2.2], velocity=1.0, acceleration=1.0)
    arm, more = human_arm(range_of_motion="restricted"), []
    with Returns("rehab_opt/workspace/", but="edge_table|__hash__", last=5) as seen:
        found = [planar_workspace(two, height=height, handle_tilt=None, accuracy=2e-2) for height in (0.0, 0.3)]
        found.append(planar_workspace(arm, height=-0.24, accuracy=1.2e-2))
        volume = reachable_volume(two, heights=[-0.1, 0.0, 0.2], handle_tilt=None, accuracy=2e-2)
    more = [[round(each.area, 3), each.reason[:20], each.components, each.holes] for each in found]
    kept("searches", seen, [more, volume.volume_bound])


def test_meshes_and_shares() -> None:
    random = np.random.default_rng(3)
    with Returns("rehab_opt/workspace/", but="edge_table") as seen:
        layers = [shapely.union_all(shapely.buffer(shapely.points(random.uniform(0, 0.4, (4, 2))), 0.09))
                  for _ in range(4)]  # fmt: skip
        layers[2] = shapely.Polygon()
        mesh = closed_mesh(layers, np.array([0.0, 0.1, 0.15, 0.3]), spacing=0.03)
        enclosed_volume(mesh)
        drawn = varied_ranges("restricted", spread=0.3, count=4, seed=2)
        more = [list(each.values()) for each in drawn]
        sets = [Workspace(shapely.box(*b), accuracy=1e-3, height=-0.2)
                for b in ((0, 0, 0.2, 0.2), (0.1, 0, 0.3, 0.2), (0.1, 0.1, 0.3, 0.3))]  # fmt: skip
        sets.append(Workspace(shapely.Polygon(), accuracy=1e-3, height=-0.2, reason="none"))
        for weights in (None, [2, 1, 1, 3]):
            shares = reachability_map(sets, weights=weights, spacing=0.07)
            points = np.vstack((grid(5) / 8, [[math.nan, 0.1], [0.1, 0.1], [0.2, 0.2]]))
            shares.probability(points)
            for at_least in (0.25, 0.5, 0.75, 1.0):
                shares.region(at_least).contains(points)
            more.append(shares.empty)
    kept("shares", seen, more)


def test_ranges_of_people(recorded) -> None:
    random = np.random.default_rng(4)
    angles = random.uniform(-3.5, 3.5, (3, 40))
    swing = np.cumsum(random.normal(0, 0.1, (3, 60, 8)), axis=1)
    swing[0, 3:6, 2] = np.nan
    with Returns("rehab_opt/workspace/") as seen:
        shoulder = clinical_angles.isb_shoulder(*clinical_angles.model_shoulder(*angles))
        wrist = clinical_angles.isb_wrist(*clinical_angles.model_wrist(*angles))
        (
            clinical_angles.isb_shoulder(*angles),
            clinical_angles.isb_wrist(*angles),
            clinical_angles.model_scapula(angles[0]),
        )
        for given in (
            {},
            {"margin": 0.1, "within": dict.fromkeys(ARM_JOINTS, (-0.9, 1.2))},
            {"lower_percentile": 20.0},
        ):
            range_of_motion(swing, **given)
        range_of_motion({"elbow_flexion": 9.0 + swing[0, :, 0], "forearm_extension": swing[1, :, 1]},
                        within={"elbow_flexion": (-3.2, 3.2)})  # fmt: skip
        folder = recorded("cp_dyskinetic_reach")
        reach_groups(folder, pronation_zero="grasp", tasks=("RGV",))
        for each in read_cp_reach(folder, "RF"):
            group_range(each, cover=0.8, pronation_zero=0.2)
            grasp_zero(each)
    kept("ranges", seen, [np.array(shoulder), np.array(wrist), list(map(list, clinical_angles.CLINICAL_ANGLES))])
