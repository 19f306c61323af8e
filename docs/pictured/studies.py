"""The first screen of a simulated person's report over five weeks, in a browser."""

from __future__ import annotations

import datetime
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

from rehab_opt.session.files import load_problem, shipped_problems
from rehab_opt.session.run import run_problem
from rehab_opt.study.record import run_trials
from rehab_opt.study.report import BROWSERS, report_html
from rehab_opt.study.store import Study
from rehab_opt.study.trial import Session

PROBLEM = "upper_limb/scenario_2_assist"
FIRST = datetime.date(2026, 10, 5)
STRENGTHS_N = (2.0, 4.0, 6.0, 8.0, 10.0)
"""Assumed strength of the person outside the comfortable workspace, week after week."""
TRIALS = 6
SIZE = (1000, 1000)
"""[pixels] of the browser's window."""


def report_page() -> Image.Image:
    """Picture of the report of a study."""
    text = shipped_problems()[PROBLEM].read_text(encoding="utf-8")
    assert text.count("\ntrials = 4\n") == 1
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        with Study(folder / "arm") as study:
            for week, strength in enumerate(STRENGTHS_N):
                problem = folder / f"week_{week + 1}.toml"
                changed = text.replace("\ntrials = 4\n", f"\ntrials = {TRIALS}\nseed = {TRIALS * week}\n")
                changed += f'\n[person]\nweak_strength_N = {strength}\n\n[run]\nlaws = ["unassisted", "assisted"]\n'
                problem.write_text(changed, encoding="utf-8")
                config = load_problem(str(problem))
                trials = run_trials(config, run_problem(config), {}, files=(), seconds=0.0)
                day = FIRST + datetime.timedelta(weeks=week)
                study.add(Session("P01", f"week {week + 1}", visit=week + 1, date=day.isoformat()), trials)
            page = folder / "P01.html"
            page.write_text(report_html(study, "P01", today=day), encoding="utf-8")
        return _seen(page)


def _seen(page: Path) -> Image.Image:
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        sys.exit(f"study_report: one of {', '.join(BROWSERS)} is needed")
    shot, (width, height) = page.with_suffix(".png"), SIZE
    options = ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []
    options += ["--headless=new", "--disable-gpu", "--hide-scrollbars", "--force-device-scale-factor=2"]
    options += [f"--user-data-dir={page.with_suffix('')}", f"--window-size={width},{height}", f"--screenshot={shot}"]
    subprocess.run([browser, *options, page.as_uri()], check=True, capture_output=True, timeout=120)
    with Image.open(shot) as seen:
        return seen.convert("RGB")
