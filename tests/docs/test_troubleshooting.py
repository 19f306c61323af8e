"""The page on troubleshooting has every reason, note and status that a command can have."""

from __future__ import annotations

import re

from rehab_opt import Relaxed, Status
from rehab_opt.control.reasons import NOTES, REASONS
from tests.docs.pages import ROOT

PAGE = (ROOT / "docs" / "reference" / "troubleshooting.md").read_text(encoding="utf-8")
ROWS = [
    [cell.strip() for cell in line.strip("| ").split(" | ")]
    for line in PAGE.partition("## Reasons")[2].partition("## Flags")[0].splitlines()
    if line.startswith("| `")
]


def test_every_reason_stands_once_with_its_text_its_cause_and_what_to_change() -> None:
    assert sorted(row[0].strip("`") for row in ROWS) == sorted(reason.name for reason in REASONS)
    text = {row[0].strip("`"): row[1].strip("| ") for row in ROWS}
    for reason in REASONS[1:]:
        assert (reason.python or reason.text) in text[reason.name], reason.name
    assert all(len(row) == 4 and row[2] and row[3] for row in ROWS[1:])


def test_every_note_status_and_flag_is_explained() -> None:
    for note in NOTES:
        assert re.search(rf"`{note.name}` \(", PAGE), note.name
        assert note.python in PAGE or note.name in {"SLOWED", "THINNED"}
    statuses = PAGE.partition("## Reasons")[0]
    assert {each.name for each in Status} == set(re.findall(r"`([A-Z]+)`", statuses))
    flags = PAGE.partition("## Flags")[2].partition("## Tuning")[0]
    assert {each.name for each in Relaxed} == set(re.findall(r"^\| `([A-Z]+)`", flags, re.MULTILINE))
