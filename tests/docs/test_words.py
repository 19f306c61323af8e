"""Texts use the field's words: those that `WORDS` replaces are found in no page, docstring or message any more."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.docs.pages import FENCE, ROOT, name, pages

WORDS = {
    "asked(?! for)": "target of a number, commanded, reference",
    "carried|carries": "shift, offset",
    "easing": "acceleration limiting",
    "entrants?": "solver",
    "foreseen": "preview",
    "guess(es)?": "analytic solution, start",
    "heard": "read",
    "hopeless|strange": "the condition",
    "ladders?|rungs?": "fallback chain, stage",
    "laws?": "controller",
    "lesser": "fallback",
    "plausible": "finite and within range",
    "programmes?": "NLP",
    "said": "printed, reported",
    "seldom": "rarely; lazy rows",
    "settles?|settled": "postprocess, come to rest",
    "shares? of|(a|the|its|this) share": "fraction, ratio",
    "tells?|told": "pass, set, report",
    "usable|unusable": "finite and within range, valid",
    "wanted": "desired, unconstrained",
    "witness(es)?": "recorder",
    "yielded": "relaxed",
}
"""Each word of ours that is gone, as a pattern, and what is written in its place.

Words that engineers use, too, in an ordinary sense are not here: given, kept, largest, least, many, most, moved, pace,
prepared, room, rounds, shown, sound, where.
"""
PATTERN = re.compile(rf"\b({'|'.join(WORDS)})\b", re.IGNORECASE)
CODE = re.compile(r"`[^`]*`|\]\([^)]*\)|\$[^$]*\$|^ +python .*$|^ *[\w*, ]+ : ", re.MULTILINE)
TEXTS = [
    *pages(),
    *(ROOT / file for file in ("CHANGELOG.md", "CONTRIBUTING.md", "INTENDED_USE.md", "problems/README.md")),
    *sorted((ROOT / "bench").rglob("*.md")),
]
MODULES = sorted((ROOT / "rehab_opt").rglob("*.py"))
LEFT: dict[str, int] = {
    "rehab_opt/export/controllers/bilateral_sides.py": 11,
}
"""Files with names in C that stay, and how many such words they have.
These numbers only fall.
"""


def found_in(text: str) -> list[str]:
    """The words of a text that are gone, code and links left out."""
    return [each[0].lower() for each in PATTERN.finditer(CODE.sub("", FENCE.sub("", text)))]


def texts_of(module: Path) -> Iterator[str]:
    """Docstrings and messages of a module: texts of more than one word."""
    for node in ast.walk(ast.parse(module.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value.strip():
            yield node.value


@pytest.mark.parametrize("text", TEXTS, ids=name)
def test_a_page_has_none_of_the_words_that_are_gone(text: Path) -> None:
    found = found_in(text.read_text(encoding="utf-8"))
    assert len(found) <= LEFT.get(name(text), 0), found


def test_docstrings_and_messages_have_none_either() -> None:
    found = {name(module): [word for text in texts_of(module) for word in found_in(text)] for module in MODULES}
    more = {module: words for module, words in found.items() if len(words) > LEFT.get(module, 0)}
    assert not more


def test_a_word_that_is_gone_is_found_in_prose_and_not_in_code() -> None:
    assert found_in("The asked twist, a share of what?") == ["asked", "a share"]
    assert found_in("`law=`, [a page](the_law.md) and\n\n```python\nlaw = told\n```\n") == []
