"""Reachable volumes: slabs, closed meshes, and what is known about them in closed form."""

import math

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from rehab_opt import DH, ConfigurationError, SerialChain, human_arm
from rehab_opt.workspace.layered_mesh import SurfaceMesh, closed_mesh, enclosed_volume
from rehab_opt.workspace.volume import ReachableVolume, reachable_volume

TILT = math.radians(2.0)


def edge_counts(triangles: NDArray[np.int64]) -> NDArray[np.int64]:
    """Of every directed edge, how often its reverse occurs: 1 everywhere in a closed, oriented surface."""
    directed = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    forward, times = np.unique(directed, axis=0, return_counts=True)
    backward = {(int(b), int(a)) for a, b in forward}
    assert backward == {(int(a), int(b)) for a, b in forward}
    return times


def spherical(turn: float, pitch: float, near: float, far: float) -> SerialChain:
    """Turns about the vertical, pitches, and slides along its own direction."""
    rows = (DH(0, math.pi / 2), DH(0, math.pi / 2, theta=math.pi / 2), DH(0, 0, prismatic=True))
    limits = np.array([(-turn, turn), (-pitch, pitch), (near, far)])
    return SerialChain(rows, lower=limits[:, 0], upper=limits[:, 1], velocity=1.0, acceleration=1.0)  # type: ignore[arg-type]


class TestClosedForms:
    def test_a_wedge_of_a_spherical_shell(self) -> None:
        turn, pitch, near, far = 1.0, 0.6, 0.2, 0.4
        found = reachable_volume(spherical(turn, pitch, near, far), handle_tilt=None, spacing=0.05, accuracy=8e-3)
        true = 2 * turn * 2 * math.sin(pitch) * (far**3 - near**3) / 3
        mesh = SurfaceMesh(found.vertices, found.triangles)
        assert found.volume == pytest.approx(true, rel=0.03)
        assert abs(enclosed_volume(mesh) - found.volume) <= found.volume_bound
        assert np.all(edge_counts(found.triangles) == 1)

    @pytest.mark.parametrize("seed", range(4))
    def test_any_stack_of_sets_closes(self, seed: int) -> None:
        random = np.random.default_rng(seed)
        layers = []
        for _ in range(6):
            discs = shapely.buffer(shapely.points(random.uniform(0, 0.4, (5, 2))), random.uniform(0.02, 0.12, 5))
            holes = shapely.buffer(shapely.points(random.uniform(0, 0.4, (3, 2))), 0.03)
            layers.append(shapely.union_all(discs).difference(shapely.union_all(holes)))
        layers[3] = shapely.Polygon()
        mesh = closed_mesh(layers, np.linspace(0, 0.5, 6), spacing=0.01)
        assert np.all(edge_counts(mesh.triangles) == 1)
        assert enclosed_volume(mesh) > 0


@pytest.fixture(scope="module")
def upright() -> ReachableVolume:
    return reachable_volume(human_arm(range_of_motion="restricted"), handle_tilt=TILT, spacing=0.07)


class TestTheParticipant:
    def test_the_mesh_is_closed_and_holds_the_volume(self, upright: ReachableVolume) -> None:
        assert np.all(edge_counts(upright.triangles) == 1)
        inside = enclosed_volume(SurfaceMesh(upright.vertices, upright.triangles))
        assert abs(inside - upright.volume) <= upright.volume_bound


def test_a_mesh_that_would_fill_the_memory_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="accuracy"):
        closed_mesh([shapely.box(0.0, 0.0, 1.0, 1.0)] * 2, np.array([0.0, 0.1]), spacing=1e-4)
