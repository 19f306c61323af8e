"""What every test may use."""

import fcntl
import gc
import hashlib
import os
import pickle
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

# Before numpy is loaded: on busy cores its second thread costs as much again, in matrices of a few rows.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest
from hypothesis import settings

# The recordings' fixture lives beside the tests that read most of them.
from tests.session.conftest import recorded

__all__ = ["among_workers", "machine_code", "one_at_a_time", "recorded", "shipped", "workspaces_once"]

# A controller's code takes as long to compile as 50 000 of its ticks to run: see `machine_code`.
os.environ.setdefault("REHAB_OPT_COMPILE", "0")
# Compiled in a sixth of the time, with the same numbers; `shipped` is for claims about the code that users get.
os.environ.setdefault("REHAB_OPT_OPTIMISE", "0")

# A first call builds CasADi functions and says nothing about the time of the next: no deadline on one example.
settings.register_profile("rehab_opt", deadline=None, print_blob=True)
settings.load_profile("rehab_opt")


LONG = (
    "judge/test_judge.py", "export/test_recorded_runs.py", "session/test_scenarios.py", "session/test_ardis.py",
    "session/test_mirror.py", "test_cli.py", "export/test_own_controllers.py", "workspace/test_audit.py",
)  # fmt: skip
"""Files of half a minute and more, the longest first."""


def pytest_configure(config: pytest.Config) -> None:
    """Keep the order below: that of pytest-xdist is by the number of a file's tests, whatever they take."""
    config.option.loadscopereorder = False
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # so a job in the background is started
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Nothing is garbage while 7000 tests are collected, and looking for it takes a quarter of the time."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with what is long, or one worker ends with it alone; without workers the order is the command line's."""
    if "PYTEST_XDIST_WORKER" not in os.environ:
        return
    items.sort(key=lambda item: next((i for i, file in enumerate(LONG) if f"tests/{file}::" in item.nodeid), len(LONG)))


@pytest.fixture(scope="session")
def among_workers(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of this run for what its workers share."""
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "shared"
    folder.mkdir(exist_ok=True)
    return folder


@contextmanager
def one_at_a_time(lock: Path) -> Iterator[None]:
    """Other workers that come to the same place wait."""
    with lock.open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


@pytest.fixture(autouse=True, scope="session")
def workspaces_once(among_workers: Path) -> Iterator[None]:
    """The workspace of an arm that many tests' problem files have is searched once in a run, for 4 s each.

    Whether a search finds the same again is asked of `planar_workspace` itself, in tests/workspace.
    """
    from rehab_opt.session.workspaces import reached  # noqa: PLC0415  (after the environment is set)

    search, found = reached.planar_workspace, dict[str, Any]()

    def once(arm: Any, **asked: Any) -> Any:
        key = repr((arm.rows, *(each.tolist() for each in (arm.lower, arm.upper, arm.base, arm.tool)), asked))
        if key not in found:
            file = among_workers / f"workspace_{hashlib.sha256(key.encode()).hexdigest()}"
            with one_at_a_time(file.with_suffix(".lock")):
                if not file.exists():
                    file.write_bytes(pickle.dumps(search(arm, **asked)))
            found[key] = pickle.loads(file.read_bytes())
        return found[key]

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(reached, "planar_workspace", once)
        yield


@pytest.fixture(autouse=True, scope="session")
def slices_by_machine_code() -> Iterator[None]:
    """A slice takes two seconds less with it, and the compiler one, once for all arms of a kind."""
    from rehab_opt.workspace import plane_search  # noqa: PLC0415  (after the environment is set)

    approach = plane_search.PlaneApproach

    def compiled(statement: Any, **asked: Any) -> Any:
        with pytest.MonkeyPatch.context() as patched:
            patched.setenv("REHAB_OPT_COMPILE", "wait")
            patched.setenv("REHAB_OPT_OPTIMISE", "1")
            return approach(statement, **asked)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(plane_search, "PlaneApproach", compiled)
        yield


@pytest.fixture
def machine_code(monkeypatch: pytest.MonkeyPatch) -> None:
    """Functions are compiled, and that is waited for."""
    monkeypatch.setenv("REHAB_OPT_COMPILE", "wait")


@pytest.fixture
def shipped(machine_code: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Functions are compiled as a user's are."""
    monkeypatch.delenv("REHAB_OPT_OPTIMISE", raising=False)
