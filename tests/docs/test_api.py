"""The API's page names every public name, and what it names is there."""

from __future__ import annotations

import importlib
import re
import sys

import pytest

import rehab_opt
from rehab_opt import measures
from tests.docs.pages import ROOT

sys.path.insert(0, str(ROOT / "docs" / "extensions"))
docstring_text = importlib.import_module("docstring_text")
PAGE = (ROOT / "docs" / "reference" / "api.md").read_text(encoding="utf-8")
FENCE = re.compile(r"^```\{api\} (\S+)\n(.*?)^```$", re.DOTALL | re.MULTILINE)


def names_of(module: str) -> list[str]:
    """What the page has of a module."""
    return [name for found in FENCE.finditer(PAGE) if found[1] == module for name in found[2].split()]


def test_every_public_name_is_on_the_page_once() -> None:
    modules = {"measures"}  # a module: a group of its own
    assert sorted(names_of("rehab_opt")) == sorted(set(rehab_opt.__all__) - modules)
    assert sorted(names_of("rehab_opt.measures")) == sorted(measures.__all__)


@pytest.mark.parametrize("module", sorted({found[1] for found in FENCE.finditer(PAGE)}))
def test_what_the_page_names_is_there(module: str) -> None:
    there = importlib.import_module(module)
    missing = [name for name in names_of(module) if not hasattr(there, name)]
    assert not missing
    assert names_of(module)
