"""Recordings of other people's projects are read where they lie; see ORIGINS.md there."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from rehab_opt.recordings.data_folder import ENVIRONMENT, data_folder

REQUIRE = "REHAB_OPT_REQUIRE_DATA"


@pytest.fixture
def recorded() -> Callable[[str], Path]:
    """Path of a recording by its place in the data folder; the test is skipped without it, and fails in CI."""

    def path(inside: str) -> Path:
        found = data_folder() / inside
        if not found.exists():
            message = f"recording {inside} is absent: set {ENVIRONMENT} to the folder that holds it"
            if os.environ.get(REQUIRE) == "1":
                pytest.fail(f"{message} ({REQUIRE}=1 demands it)")
            pytest.skip(message)
        return found

    return path


@pytest.fixture
def written(tmp_path: Path) -> Callable[[str, str | bytes], Path]:
    """Write a file into the test's own folder."""

    def write(name: str, content: str | bytes) -> Path:
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write
