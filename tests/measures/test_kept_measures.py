"""Numbers of every measure, kept, of seeded movements, with rests, ties and single samples among them."""

from __future__ import annotations

import itertools

import numpy as np

from rehab_opt import RehabOptError, measures
from rehab_opt.measures import along_path
from rehab_opt.measures.score import hand_motion, score
from tests.golden import assert_kept
from tests.golden.returns import Returns, sums


def test_measures() -> None:
    rng, more = np.random.default_rng(1), []
    time = np.arange(400) / 100
    reach = np.clip(time - 0.5, 0, 2) / 2
    path = np.column_stack([0.3 * reach**3 * (10 - 15 * reach + 6 * reach**2), 0.4 + 0.02 * np.sin(3 * time)])
    paths = [
        path,
        path[::3] + 0.003 * rng.normal(size=path[::3].shape),
        np.cumsum(rng.normal(size=(300, 3)), 0),
        path[:1],
    ]
    with Returns("rehab_opt/measures/") as seen:
        for points in paths:
            for name in measures.__all__:
                function, at = getattr(measures, name), np.arange(len(points)) / 100
                for given in ((points,), (at, points), (at, points, points), (points, points[::2]), (points, points[0]),
                              ([points, points[::2], points + 0.01],), (np.linalg.norm(points, axis=1), 0.01),
                              ):  # fmt: skip
                    try:
                        more.append([name, function(*given)])
                    except (TypeError, RehabOptError) as told:
                        more.append([name, type(told).__name__])
        for within, jump in ((0.01, 0.02), (0.05, 0.0), (0.002, 0.2)):
            more.append(along_path.covered_in_order(path[::2] + 0.004, path, within=within, jump=jump))
        more += [
            along_path.deviation_in_order(paths[1], path),
            along_path.projected(paths[1], path),
            along_path.projected(path, path[:1]),
        ]
        noisy = path + 1e-3 * rng.normal(size=path.shape)
        options = ({}, {"threshold": 0.2}, {"cutoff_hz": 5.0})
        for points, given in itertools.product((path, noisy, paths[2][:, :2]), options):
            try:
                more.append(hand_motion(time[: len(points)], points, **given))
                more.append(
                    score(time[: len(points)], points, target=points[-3], joints={"a": 3 * points[:, 0]}, **given)
                )
            except (TypeError, RehabOptError) as told:
                more.append(str(told))
    assert_kept("measures", [seen.numbers(), [sums(each) for each in more]], relative=1e-5, absolute=1e-8)
