"""Links between the texts of the checkout lead somewhere, headings included."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.docs.pages import FENCE, ROOT, name, pages

LINK = re.compile(r"\]\(([^)\s]+)\)|^```\{figure\} (\S+)$", re.MULTILINE)
TEXTS = [
    *pages(),
    *(ROOT / file for file in ("CHANGELOG.md", "CONTRIBUTING.md", "INTENDED_USE.md", "problems/README.md")),
    *sorted((ROOT / "bench").rglob("*.md")),
]
MAX_README = 6000
"""[bytes]"""
MAX_PICTURE = 150_000
"""[bytes]"""


def targets(text: Path) -> list[str]:
    """What it links to within the checkout, code left out."""
    found = (link[1] or link[2] for link in LINK.finditer(FENCE.sub("", text.read_text(encoding="utf-8"))))
    return [target for target in found if "://" not in target and not target.startswith("mailto:")]


def anchors(text: str) -> set[str]:
    """Of its headings, as forges and the pages' generator make them."""
    heads = re.findall(r"^#+ +(.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).strip().replace(" ", "-") for head in heads}


@pytest.mark.parametrize("text", TEXTS, ids=name)
def test_links_lead_somewhere(text: Path) -> None:
    for target in targets(text):
        file, _, anchor = target.partition("#")
        there = (text.parent / file).resolve() if file else text
        assert there.exists(), target
        assert there.is_relative_to(ROOT), target
        if anchor:
            assert anchor in anchors(there.read_text(encoding="utf-8")), target


def test_the_readme_is_short_and_pictures_are_small() -> None:
    assert (ROOT / "README.md").stat().st_size <= MAX_README
    pictures = sorted((ROOT / "docs" / "pictures").iterdir())
    assert pictures
    assert {picture.name: picture.stat().st_size for picture in pictures if picture.stat().st_size > MAX_PICTURE} == {}
    shown = {Path(target).name for page in pages() for target in targets(page)}
    assert {picture.name for picture in pictures} <= shown
