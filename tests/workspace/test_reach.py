"""Reachable slices: the boundary where it is known in closed form, and where only another solver can tell."""

import itertools
import math
from functools import partial

import casadi as ca
import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from rehab_opt import DH, ArmIK, SerialChain, Status, human_arm
from rehab_opt.kinematics.human_arm import ARM_JOINTS
from rehab_opt.workspace.reach import planar_workspace
from rehab_opt.workspace.region import Workspace
from tests.refusals import refuses

Array = NDArray[np.float64]
TILT = math.radians(2.0)
TWO_LINKS = (DH(0.3, 0.0), DH(0.2, 0.0))


def chain(rows: tuple[DH, ...], lower: list[float], upper: list[float]) -> SerialChain:
    return SerialChain(rows, lower=lower, upper=upper, velocity=1.0, acceleration=1.0)  # type: ignore[arg-type]


def ring(radius: float, start: float, stop: float, count: int = 2000) -> list[tuple[float, float]]:
    return [(radius * math.cos(a), radius * math.sin(a)) for a in np.linspace(start, stop, count)]


def sector(inner: float, outer: float, start: float, stop: float) -> shapely.Polygon:
    return shapely.Polygon(ring(outer, start, stop) + ring(inner, stop, start))


def boundary_gap(one: shapely.Geometry, other: shapely.Geometry) -> float:
    """[m] largest distance between the boundaries, either way."""
    fine = [shapely.segmentize(each.boundary, 1e-3) for each in (one, other)]
    return float(shapely.hausdorff_distance(*fine))


def probes(workspace: Workspace, distance: float, count: int, seed: int = 0) -> Array:
    """Points at `distance` from the boundary, outside where positive."""
    line = workspace.polygon.buffer(distance).boundary
    at = np.random.default_rng(seed).uniform(0, line.length, count)
    points: Array = shapely.get_coordinates(shapely.line_interpolate_point(line, at))
    return points


class TestClosedForms:
    def test_two_links_without_limits_reach_an_annulus(self) -> None:
        arm = chain(TWO_LINKS, [-math.inf] * 2, [math.inf] * 2)
        workspace = planar_workspace(arm, height=0.0, handle_tilt=None, accuracy=4e-3, resolution=0.04)
        annulus = shapely.Polygon(ring(0.5, 0, 2 * math.pi), [ring(0.1, 0, 2 * math.pi)])
        assert workspace.holes == 1
        assert workspace.components == 1
        assert workspace.accuracy == 4e-3
        assert boundary_gap(workspace.polygon, annulus) <= 4e-3

    @pytest.mark.parametrize(
        ("lengths", "turn", "bend"),
        [
            pytest.param((0.17, 0.22), (-0.4, 0.9), (-2.4, 1.1), id="notches"),
            pytest.param((0.12, 0.1), (-3.1, 2.9), (-0.7, 2.6), id="a hole and a gap", marks=pytest.mark.nightly),
        ],
    )
    def test_an_elbow_that_bends_both_ways_reaches_the_union(
        self, lengths: tuple[float, float], turn: tuple[float, float], bend: tuple[float, float]
    ) -> None:
        arm = chain((DH(lengths[0], 0.0), DH(lengths[1], 0.0)), [turn[0], bend[0]], [turn[1], bend[1]])
        strips = []
        turns = np.linspace(*turn, 60)
        for first, last in itertools.pairwise(turns):
            for ends in ((bend[0], 0.0), (0.0, bend[1])):
                e, v = np.linspace(first, last, 40), np.linspace(*ends, 800)
                corners = [
                    (e, 0 * e + ends[0]),
                    (0 * v + last, v),
                    (e[::-1], 0 * e + ends[1]),
                    (0 * v + first, v[::-1]),
                ]
                hands = np.concatenate(
                    [lengths[0] * np.exp(1j * one) + lengths[1] * np.exp(1j * (one + two)) for one, two in corners]
                )
                strips.append(shapely.make_valid(shapely.Polygon(np.stack([hands.real, hands.imag], axis=1))))
        true = shapely.union_all(strips).buffer(1e-7)
        workspace = planar_workspace(arm, height=0.0, handle_tilt=None, accuracy=2e-3, resolution=0.012)
        assert workspace.accuracy == 2e-3
        assert workspace.holes == len(true.interiors)
        assert boundary_gap(workspace.polygon, true) <= 1e-3

    def test_the_two_ways_to_bend_an_elbow_reach_separate_parts_of_a_plane(self) -> None:
        # Height 0 asks 0.3 sin q2 = -0.2 sin(q2 + q3): two branches, each an annular sector about the first axis.
        arm = chain((DH(0.0, math.pi / 2), DH(0.3, 0.0), DH(0.2, 0.0)), [0.0, 0.5, -3.0], [1.5, 0.65, -1.0])
        pitch = np.linspace(0.5, 0.65, 100)
        fore = np.sqrt(1 - (1.5 * np.sin(pitch)) ** 2)
        parts = [0.3 * np.cos(pitch) + sign * 0.2 * fore for sign in (1, -1)]
        true = shapely.union_all([sector(radii.min(), radii.max(), 0.0, 1.5) for radii in parts])
        workspace = planar_workspace(arm, height=0.0, handle_tilt=None)
        assert workspace.components == 2
        assert boundary_gap(workspace.polygon, true) <= 2e-4

    def test_slides_reach_a_rectangle(self) -> None:
        rows = [DH(0.0, math.pi / 2, theta=theta, prismatic=True) for theta in (0.0, math.pi / 2, math.pi / 2)]
        workspace = planar_workspace(chain(tuple(rows), [0.0] * 3, [0.4, 0.3, 0.2]), height=0.1, handle_tilt=None)
        x, y, right, top = workspace.polygon.bounds
        assert sorted((right - x, top - y)) == pytest.approx([0.2, 0.3], abs=1e-4)
        assert workspace.area == pytest.approx(0.06, rel=1e-3)


@pytest.fixture(
    scope="module",
    params=["restricted", *(pytest.param(each, marks=pytest.mark.nightly) for each in ("regular", "figure_3"))],
)
def arm(request: pytest.FixtureRequest) -> SerialChain:
    return human_arm(range_of_motion=request.param)


@pytest.fixture(scope="module")
def workspace(arm: SerialChain) -> Workspace:
    return planar_workspace(arm)


class TestTheParticipant:
    def test_another_solver_reaches_every_probe_inside_and_none_outside(
        self, arm: SerialChain, workspace: Workspace
    ) -> None:
        arm_ik = ArmIK(arm, handle_tilt=TILT)
        assert workspace.accuracy == 1e-3
        for distance, reachable in ((1e-3, False), (-1e-3, True)):
            for x, y in probes(workspace, distance, 60):
                status = arm_ik.solve([x, y, -0.24]).status
                assert status.certified == reachable
                assert reachable or status is Status.UNREACHABLE

    def test_random_postures_lie_in_the_slice_of_their_height(self, arm: SerialChain) -> None:
        q = ca.SX.sym("q", arm.n)
        pose = arm.pose_expression(q)
        at = ca.Function("at", [q], [pose[:3, 3], pose[2, 0]])
        drawn = np.random.default_rng(2).uniform(arm.lower, arm.upper, (200_000, arm.n))
        hands, upright = at(drawn.T)
        hands = hands.full().T[upright.full()[0] >= math.cos(TILT)]
        assert len(hands) >= 2
        for x, y, z in hands[:2]:
            level = planar_workspace(arm, height=z, accuracy=3e-3, resolution=0.016)
            assert level.distance((x, y)) <= 3e-3

    def test_sides_mirror_each_other(self) -> None:
        left, right = (
            planar_workspace(human_arm(range_of_motion="restricted", side=side), accuracy=1e-3)
            for side in ("left", "right")
        )
        mirrored = shapely.transform(right.polygon, lambda points: points * (-1, 1))
        assert boundary_gap(left.polygon, mirrored) <= 2e-4

    def test_a_finer_accuracy_is_kept(self) -> None:
        restricted = human_arm(range_of_motion="restricted")
        coarse, fine = (planar_workspace(restricted, accuracy=accuracy) for accuracy in (2e-3, 2e-4))
        assert boundary_gap(coarse.polygon, fine.polygon) <= 2e-3
        arm_ik = ArmIK(restricted, handle_tilt=TILT)
        for x, y in probes(fine, 2e-4, 20):
            assert not arm_ik.solve([x, y, -0.24]).status.certified


class TestNothingReached:
    @pytest.mark.parametrize(
        ("height", "tilt", "reason"),
        [
            (0.9, TILT, "out of reach"),
            (-0.24, math.radians(0.5), "no posture holds the handle"),
            (-0.5, TILT, "height"),
        ],
    )
    def test_the_reason_says_which_constraint_fails(self, height: float, tilt: float, reason: str) -> None:
        workspace = planar_workspace(human_arm(range_of_motion="restricted"), height=height, handle_tilt=tilt)
        assert workspace.empty
        assert workspace.area == 0.0
        assert reason in workspace.reason
        assert workspace.contains((0.0, 0.4)) is False

    def test_an_arm_that_cannot_move_is_a_point(self) -> None:
        upper = dict.fromkeys(ARM_JOINTS, (0.5, 0.5))
        workspace = planar_workspace(human_arm(range_of_motion=upper))
        assert workspace.empty
        assert "every joint is locked" in workspace.reason

    @pytest.mark.parametrize("free", [1, 2])
    def test_a_curve_has_no_area(self, free: int) -> None:
        rows = (DH(0.0, math.pi / 2), DH(0.3, 0.0)) if free == 2 else (DH(0.3, 0.0),)
        workspace = planar_workspace(
            chain(rows, [0.0] * free, [1.0] * free), height=0.05 * (free - 1), handle_tilt=None
        )
        assert workspace.empty
        assert "thinner" in workspace.reason

    def test_a_planar_chain_stays_in_its_plane(self) -> None:
        arm = chain(TWO_LINKS, [0.0, 0.5], [1.0, 1.5])
        assert "stays at 0 m" in planar_workspace(arm, height=0.1, handle_tilt=None).reason
        assert "handle" in planar_workspace(arm, height=0.0, handle_tilt=0.1).reason


def test_what_cannot_be_used_is_refused_by_name() -> None:
    refuses(
        partial(planar_workspace, human_arm(range_of_motion="restricted")),
        ({"height": math.nan}, "height"),
        ({"handle_tilt": -0.1}, "handle_tilt"),
        ({"accuracy": 0.0}, "accuracy"),
        ({"resolution": 0.0}, "resolution"),
        ({"placement": (0.0, 0.0, 0.0)}, "placement"),
    )
    endless = chain((DH(0.0, 1.0, prismatic=True),), [0.0], [math.inf])
    refuses(planar_workspace, ((None,), "arm"), ({"arm": endless, "handle_tilt": None}, "slide"))
