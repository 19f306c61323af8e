"""A slice of every judge, and which guarantees they judge; the campaign is `python -m tests.judge`."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.judge.__main__ import parts
from tests.judge.numbering import FIXED_SEED, seed_of_the_code
from tests.judge.verdict import ROOT, Verdict, judges

JUDGES = judges()
FEWEST_RUNS = 76
"""Of a judge in 10^7 ticks of all."""


def test_every_guarantee_has_a_judge_and_every_judge_names_guarantees_of_the_page() -> None:
    page = (ROOT / "docs" / "guarantees.md").read_text(encoding="utf-8")
    rows = [line.strip("|").split("|") for line in page.splitlines() if line.startswith("| G")]
    listed = {(row[0].strip(), judge) for row in rows for judge in re.findall(r"`(\w+)`", row[3])}
    assert len({guarantee for guarantee, _ in listed}) == len(rows)
    assert listed == {(each, name) for name, module in JUDGES.items() for each in module.GUARANTEES}


def slice_of(judge: str, seed: int, ticks: int) -> None:
    for longer in (1, 4):  # a short slice may miss by chance what is seldom
        verdict: Verdict = JUDGES[judge].run(longer * ticks, seed)
        assert verdict.ticks > 0
        assert not verdict.kinds, "\n".join(f"{each.claim}: {each.numbers}\n  {each.again}" for each in verdict.broken)
        if not verdict.missed:
            return
    pytest.fail(f"seed {seed}, too seldom (seen, asked): {verdict.missed}")


@pytest.mark.parametrize("judge", JUDGES)
def test_slice_of_the_campaign_breaks_nothing(judge: str) -> None:
    slice_of(judge, FIXED_SEED, JUDGES[judge].CI_TICKS // 8)


@pytest.mark.nightly
@pytest.mark.parametrize("seed", [FIXED_SEED, seed_of_the_code()], ids=["fixed seed", "seed of the code"])
@pytest.mark.parametrize("judge", JUDGES)
def test_longer_slice_of_the_campaign_breaks_nothing(judge: str, seed: int) -> None:
    slice_of(judge, seed, JUDGES[judge].CI_TICKS // 2)


BROKEN_ONCE = {
    "chair_limits": [
        (20, 4), (20, 10), (502, 11), (34112419, 17), (35112507, 10), (26112019, 44), (42128004, 11), (42128004, 19),
        (51128010, 4), (51128011, 159), (261130011, 21), (261130031, 28), (27110954, 39), (26118900, 16),
        (27119603, 38),
    ],
    "path_progress": [(26119600, 38), (77123, 14), (21311126, 9)],
    "pose_tracker_bounds": [(27118903, 4_000_057)],
    "pair_messages": [(27112758, 73), (25112016, 31), (41126001, 151)],
    "limits_rest": [
        (42128004, 111), (20281231, 82), (20281231, 66), (505, 92), (61001, 6), (194004, 66), (95005, 72),
        (21320704, 24), (21320704, 70), (21320704, 110), (1301134, 1),
    ],
    "chair_walls": [(42127780, 158), (42127780, 243), (421, 263), (26115600, 18)],
    "mirror_hand": [(2043862918, 1_000_002)],
    "mirror_floor": [(63532841, 2_000_005), (62160024, 3_000_019)],
    "mirror_plan": [(42223020, 56)],
    "chair_calm": [(34112419, 227), (35112422, 101), (62139034, 53)],
    "chair_held": [(26118100, 493)],
    "clearance_bodies": [(61139031, 71), (26118000, 76)],
    "paths_beforehand": [(26112019, 3)],
    "force_bounds": [(26112019, 1000079)],
}  # fmt: skip
"""Judge -> seeds and numbers of runs in which a claim broke once."""


@pytest.mark.nightly
@pytest.mark.parametrize("judge", BROKEN_ONCE)
def test_runs_that_were_broken_once_are_not_any_more(judge: str) -> None:
    for seed, number in BROKEN_ONCE[judge]:
        verdict: Verdict = JUDGES[judge].run(1, seed, only=number)
        assert verdict.ticks > 0
        assert not verdict.broken, verdict.broken


def test_least_counts_scale_with_what_was_run_and_find_that_nothing_happened() -> None:
    asked = [Verdict("any", 0, {"often": 1e5, "seldom": 50.0}, ticks=1000 * runs, runs=runs).missed
             for runs in (1, 36, 144, 3600, 14_400)]  # fmt: skip
    assert [each.get("often", (0, 0))[1] for each in asked] == [0, 1, 7200, 324_000, 1_368_000]
    assert [each.get("seldom", (0, 0))[1] for each in asked] == [0, 0, 3, 162, 684]


def test_every_situation_is_asked_for_in_the_documented_campaign() -> None:
    for judge, ticks, _ in parts(list(JUDGES), 10_000_000, 0, 1):
        asked = Verdict(judge, 0, JUDGES[judge].LEAST, ticks=ticks, runs=FEWEST_RUNS).asked
        assert min(asked.values()) >= 1, (judge, asked)


def test_judge_imports_only_public_controllers_and_value_types() -> None:
    allowed = (
        "rehab_opt import ",
        "rehab_opt.kinematics.ardis import ARDIS_READY",
        "rehab_opt.control.obstacles import ",
        "rehab_opt.control.conditioning import ",
        "rehab_opt.control.scanning import ",
        "rehab_opt.control.bilateral_sides import FromHelper, FromParticipant",
        "rehab_opt.control.arm_path import arm_path",
    )
    for path in Path(__file__).parent.glob("*.py"):
        for line in path.read_text(encoding="utf-8").splitlines():
            named = line.partition("from ")[2] if line.startswith(("from rehab_opt", "    from rehab_opt")) else ""
            assert not line.startswith("import rehab_opt"), f"{path.name}: {line}"
            assert not named or named.startswith(allowed), f"{path.name}: {line}"


@pytest.mark.nightly
def test_commands_of_another_version_are_compared_tick_by_tick(tmp_path: Path) -> None:
    file, name = str(tmp_path / "commands.npz"), "smoother_bounds"
    command = [sys.executable, "-m", "tests.same_commands", file, "--ticks", "100", "--only", name]
    written, same = (subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False) for _ in range(2))
    assert (written.returncode, same.returncode) == (0, 0), written.stderr + same.stderr
    assert re.match(rf"same {name}: \d\d+ commands alike, at most 0 apart", same.stdout)
    with np.load(file) as kept:
        content = dict(kept)
    content[f"{name} values"][37] += 1e-9
    np.savez(file, **content)
    other = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert other.returncode == 1
    assert re.match(rf"OTHER {name}: tick \d+ of \d+: \S+ apart", other.stdout)
