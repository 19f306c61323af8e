"""What is immutable may be used by several threads at once: four give, to the last bit, what one alone gives.

Every case makes its object anew, so that four threads make at once what is made on first use. Nothing is claimed for
Python without its lock: CasADi's wheels are of the limited API, which free-threaded interpreters do not load.
"""

from __future__ import annotations

import gc
import pickle
import sys
import threading
import weakref
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

import numpy as np
import pytest
import shapely

from rehab_opt import PotentialField, ThinPlateSpline, Workspace, ardis, ur5
from rehab_opt.symbolic import PerThread
from rehab_opt.symbolic.compiled import _compiler
from rehab_opt.workspace.mapping import WorkspaceMap

THREADS = 4
FEW, MANY = 20, 400
"""Questions of a thread: where one takes a millisecond, and where microseconds, so that few would never meet."""
Ask = Callable[[np.random.Generator], Any]


@pytest.fixture(autouse=True)
def impatient() -> Iterator[None]:
    """Python goes from thread to thread 500 times as often as it does by itself."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    yield
    sys.setswitchinterval(before)


def field(*, compile: bool = False) -> PotentialField:
    path = np.array([[0.0, 0.0], [0.3, 0.0], [0.3, 0.2]])
    return PotentialField(path, stiffness=1000.0, drag=200.0, width=0.025, compile=compile)


def ell() -> Workspace:
    return Workspace(shapely.Polygon([(0, 0), (0.3, 0), (0.3, 0.1), (0.1, 0.1), (0.1, 0.3), (0, 0.3)]), accuracy=1e-3)


def near(rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(-0.1, 0.4, 2)


def of_a_field(compile: bool = False) -> Ask:
    asked = field(compile=compile)
    return lambda rng: (asked.energy(x := near(rng)), asked.force(x, x), asked.pull(*x), asked.stiffness(x))


def of_a_chain() -> Ask:
    chain = ur5()
    return lambda rng: (
        chain.pose(q := rng.normal(size=6)), chain.jacobian(q), chain.manipulability(q),
        chain.manipulability_gradient(q),
    )  # fmt: skip


def of_a_mobile_arm() -> Ask:
    robot = ardis()
    return lambda rng: (
        robot.inertia(q := rng.normal(size=7)), robot.posture_cost(q), robot.posture_gradient(q),
        robot.chassis_velocity(q, q), robot.chain.pose(q),
    )  # fmt: skip


def of_a_workspace() -> Ask:
    asked = ell()
    return lambda rng: (
        asked.contains(x := near(rng)), asked.distance(x), asked.nearest(x), asked.distance(rng.normal(size=(20, 2)))
    )  # fmt: skip


def of_a_ragged_workspace() -> Ask:
    angle = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    radius = 0.2 + 0.05 * np.sin(5 * angle) + 0.02 * np.random.default_rng(0).random(400)
    asked = Workspace(shapely.Polygon(np.column_stack((radius * np.cos(angle), radius * np.sin(angle)))), accuracy=1e-3)
    return lambda rng: (asked.distance(x := near(rng)), asked.contains(x), asked.nearest(x))


def of_a_spline(landmarks: int) -> Ask:
    rng = np.random.default_rng(0)
    source = rng.uniform(-0.2, 0.5, (landmarks, 2))
    spline = ThinPlateSpline(source, source + rng.normal(0, 0.005, source.shape))
    return lambda rng: (
        spline(x := near(rng)), spline.jacobian(x), spline.value_and_jacobian(x), spline.inverse(x), spline(x[None])
    )  # fmt: skip


@cache
def between() -> WorkspaceMap:
    return WorkspaceMap.between(ell(), Workspace(shapely.box(0, 0, 0.3, 0.3), accuracy=1e-3), rule="polar")


def of_a_map() -> Ask:
    asked = pickle.loads(pickle.dumps(between()))  # without what was made when it was first asked
    driven = between().for_controller(unsafe=True)
    return lambda rng: (
        asked(x := near(rng)), asked.jacobian(x), asked.inverse(x),
        driven.image(x), driven.jacobian(x), driven.preimage(x),
    )  # fmt: skip


SHAREABLE: dict[str, Callable[[], Ask]] = {
    "field": of_a_field,
    "chain": of_a_chain,
    "mobile arm": of_a_mobile_arm,
    "workspace": of_a_workspace,
    "ragged workspace": of_a_ragged_workspace,
    "large spline": lambda: of_a_spline(100),
    "map": of_a_map,
}
QUICK = ("field", "chain", "mobile arm")


def answers(ask: Ask, seed: int, rounds: int = MANY) -> list[Any]:
    rng = np.random.default_rng(seed)
    return [ask(rng) for _ in range(rounds)]


def at_once(tasks: list[Callable[[], Any]]) -> list[Any]:
    """What the tasks give, each in a thread of its own, all begun together."""
    results: list[Any] = [None] * len(tasks)
    begin = threading.Barrier(len(tasks))

    def run(k: int) -> None:
        begin.wait()
        results[k] = tasks[k]()

    threads = [threading.Thread(target=run, args=(k,)) for k in range(len(tasks))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return results


def assert_same_bits(one: Any, other: Any) -> None:
    assert type(one) is type(other)
    if isinstance(one, list | tuple):
        for a, b in zip(one, other, strict=True):
            assert_same_bits(a, b)
    else:
        np.testing.assert_array_equal(one, other, strict=True)


@pytest.mark.parametrize("kind", SHAREABLE)
def test_four_threads_get_what_one_gets(kind: str) -> None:
    rounds = MANY if kind in QUICK else FEW
    expected = [answers(SHAREABLE[kind](), seed, rounds) for seed in range(THREADS)]
    shared = SHAREABLE[kind]()
    found = at_once([lambda seed=seed: answers(shared, seed, rounds) for seed in range(THREADS)])  # type: ignore[misc]
    assert_same_bits(found, expected)


@pytest.mark.nightly
@pytest.mark.skipif(_compiler() is None, reason="no C compiler on this machine")
@pytest.mark.usefixtures("shipped")
def test_four_threads_get_what_one_gets_of_compiled_fields() -> None:
    expected = [answers(of_a_field(compile="wait"), seed) for seed in range(THREADS)]
    shared = of_a_field(compile="wait")
    found = at_once([lambda seed=seed: answers(shared, seed) for seed in range(THREADS)])  # type: ignore[misc]
    assert_same_bits(found, expected)


def test_a_thread_that_ends_leaves_nothing_behind() -> None:
    class Buffer: ...

    kept = PerThread(Buffer)
    (theirs,) = at_once([lambda: weakref.ref(kept.mine)])
    gc.collect()
    assert theirs() is None
    assert kept.mine is kept.mine
