"""A map for a task keeps more of the look of what is drawn, and is proven like every other safe map."""

import numpy as np
import pytest
from shapely import get_coordinates, maximum_inscribed_circle

from rehab_opt.workspace.mapping import WorkspaceMap
from rehab_opt.workspace.similarity import largest_copy
from tests.refusals import refuses
from tests.workspace.mapped import mapped, shape, workspace


def shape_distance(one: np.ndarray, other: np.ndarray) -> tuple[float, float]:
    """Procrustes distance of two drawings, and the scale of the similarity nearest to the second."""
    z, w = ((each - each.mean(axis=0)) @ [1.0, 1.0j] for each in (one, other))
    fit = np.vdot(z, w)
    left = 1.0 - abs(fit) ** 2 / (np.vdot(z, z).real * np.vdot(w, w).real)
    return float(np.sqrt(max(left, 0.0))), float(abs(fit) / np.vdot(z, z).real)


def drawing(name: str, seed: int = 0) -> np.ndarray:
    """A figure of eight (seed 0), or another closed curve, in most of the largest disc of a set."""
    t, disc = np.linspace(0.0, 2.0 * np.pi, 300), maximum_inscribed_circle(shape(name).polygon)
    path = np.column_stack([np.sin(t), 0.5 * np.sin(2.0 * t)])
    if seed:
        random = np.random.default_rng(seed)
        waves = [random.normal(size=(2, 2)) / k @ [np.cos(k * t), np.sin(k * t)] for k in range(1, 5)]
        path = np.sum(waves, axis=0).T
    path = path - path.mean(axis=0)
    return get_coordinates(disc)[0] + 0.8 * disc.length * path / np.hypot(*path.T).max()


@pytest.mark.parametrize(
    ("source", "target", "seed", "fraction"),
    [
        ("regular", "restricted", 0, 1.0 / 3.0),
        *(pytest.param("regular", "restricted", seed, 1.0, marks=pytest.mark.nightly) for seed in range(1, 5)),
    ],
)
def test_a_drawing_is_less_distorted_and_larger_than_by_the_map_of_the_sets(source, target, seed, fraction):
    path, before = drawing(source, seed), mapped(source, target)
    made = WorkspaceMap.for_task(shape(source), shape(target), path)
    assert made.audit().reasons == ()
    (distance, scale), (usual, before_scale) = (shape_distance(path, each(path)) for each in (made, before))
    assert distance <= fraction * usual
    assert scale >= before_scale
    assert scale <= 1.2 * largest_copy(path, shape(target)).scale


def test_what_no_task_can_be_is_refused_by_name():
    inside = drawing("blob")
    refuses(
        lambda path=inside, **given: WorkspaceMap.for_task(shape("blob"), shape("ell"), path, **given),
        ({"path": inside + 1.0}, "path = "),
        ({"path": inside[:1]}, "path = "),
        ({"size": 1.1}, "size = "),
        ({"size": 0.0}, "size = "),
        ({"rotation": "left"}, "rotation = "),
    )
    empty = workspace(shape("blob").polygon.buffer(-1.0))
    refuses(WorkspaceMap.for_task, ((empty, shape("ell"), inside), "source = "))
