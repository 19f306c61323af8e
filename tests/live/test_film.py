"""A live problem as a film."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageSequence

from rehab_opt.errors import ConfigurationError
from rehab_opt.live.film import write_film
from rehab_opt.session.files import load_problem
from rehab_opt.session.run import live_problem


def test_a_film_is_small_and_moves(tmp_path: Path) -> None:
    place = tmp_path / "circle.gif"
    problem = live_problem(load_problem("robot/ur5_circle"))
    assert write_film(problem, place, seconds=1.5, per_second=4.0) == 6
    with Image.open(place) as film:
        pictures = [np.asarray(each.convert("RGB"), dtype=int) for each in ImageSequence.Iterator(film)]
    assert len(pictures) >= 5  # two that are alike are stored as one
    assert np.abs(pictures[-1] - pictures[0]).max() > 50
    assert place.stat().st_size < 60_000
    with pytest.raises(ConfigurationError, match="seconds"):
        write_film(problem, place, seconds=float("nan"))
