"""Search for the patient's seat in a mirrored recording, and for the robot's grip; then run the best candidates.

A candidate is a posture of the robot at one pose of the path, and a direction of the patient; seat and grip follow from
both. `Seats` computes the fraction of the path that the robot can follow, regardless of time. The best candidates that
differ enough are run like `rehab-opt run`, and the best run wins.
"""

from __future__ import annotations

import dataclasses
import math
import re
import tomllib
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rehab_opt.control.between_poses import turn_between, turned
from rehab_opt.control.mirror import MirrorTracker
from rehab_opt.control.seats import Seats, Walk
from rehab_opt.errors import ProblemFileError
from rehab_opt.plants.ideal import IdealJoints
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.mirror.laws import track_reference, tracker_of
from rehab_opt.session.mirror.metrics import passed_fraction
from rehab_opt.session.mirror.problem import MirrorProblem
from rehab_opt.session.mirror.scene import Setup, laid_out
from rehab_opt.session.outcome import Array, Progress
from rehab_opt.session.robot_file import pose_of
from rehab_opt.session.systems import NotMet

POSES, ALL_POSES = 60, 300
"""Number of checked poses of the path: in the search for seats, and for a single seat."""
CHANGING = 0.1
"""[s] Time between checked poses while the person's arm changes its posture."""
NEARLY = 4e-3, math.radians(4.0)
"""[m, rad] Within this deviation, the person's arm counts as reaching a pose."""
ANYWHERE, NEARER, BEST = 600, (0.35, 0.2, 0.12, 0.07, 0.04, 0.02), 20
"""Number of random seats; standard deviations [rad] of the further seats around the best ones; number of best seats."""
SEARCHES = 12
"""Number of searches, each with new random seats."""
TRIED, ENOUGH, SHORT, APART = 12, 3, 0.02, 0.5
"""At most `TRIED` seats are run; `ENOUGH` suffice if one passes all but `SHORT` of the path that the person's arm can
reach. Seats differ by `APART` [rad or m] at least, since similar ones may all end with the same joint at its limit."""
HEIGHT, AWAY = (-0.1, 0.5), 0.45
"""[m] Range of the led shoulder's height above the robot's base; least distance of the patient's middle and shoulders
from the vertical axis of the base."""
CLEAR = 0.3
"""[m] Least horizontal distance between the patient's middle and the robot's joints before its wrist."""
GOOD = 0.5
"""Least manipulability of a random posture, as a fraction of the largest."""


class Place(NamedTuple):
    """Values for keys of a problem file, by section, and the result of a run with them."""

    keys: dict[str, dict[str, Any]]
    """Values by section and key, such as `keys["placement"]["origin_m"]`; "patient.arm" is a section."""
    passed: float
    """Fraction of the reference poses that the controller `step` passes within 5 mm and 5 deg."""
    counted: float
    """Fraction of the reference poses that the search expected to be passed."""


def found_place(
    config: ProblemFile[MirrorProblem], *, seats: int = ANYWHERE, seed: int = 0, progress: Progress
) -> Place:
    """Seat, direction, grip and starting posture with which the robot passes the largest fraction of the poses.

    Parameters
    ----------
    seats : number of random seats in a search. Then, in each of six rounds, a quarter as many are drawn around the best
        ones. Searches repeat, up to `SEARCHES` times, until `ENOUGH` seats allow all that the person's arm can reach.
    """
    if config.problem.placement.origin_m is None:
        raise ProblemFileError(
            config.file, "placement.calibration_file", config.problem.placement.calibration_file,
            "origin_m: a calibrated frame is measured and cannot be chosen",
        )  # fmt: skip
    scene = laid_out(config)
    tracker = tracker_of(config.problem, scene, file=config.file)
    search = _Search(config.problem, scene, tracker, np.random.default_rng(seed))
    drawn, scores = np.empty((0, search.chain.n + 1)), np.empty(0)
    for number in range(SEARCHES):
        progress("seats", number, SEARCHES)
        own = search.anywhere(seats)
        found = search.scores(own)
        for spread in NEARER:
            more = search.near(own[np.argsort(-found, kind="stable")[:BEST]], spread, seats // 4)
            own, found = np.vstack([own, more]), np.concatenate([found, search.scores(more)])
        drawn, scores = np.vstack([drawn, own]), np.concatenate([scores, found])
        tried = _apart(drawn, scores)
        if len(tried) >= ENOUGH and search.counted(tried[ENOUGH - 1]) >= search.most:
            break
    progress("seats", 1, 1)
    if not tried:
        expected = "a recording that the robot, above its floor, and the person's arm can follow in part"
        raise ProblemFileError(config.file, "recording.file", config.problem.recording.file, expected)
    best = Place({}, -math.inf, 0.0)
    for number, seat in enumerate(tried):
        if number >= ENOUGH and best.passed >= search.most - SHORT:
            break
        progress("runs", number, TRIED)
        keys = search.keys(seat)
        place = Place(keys, achieved(placed(config, keys)), search.counted(seat))
        best = max(best, place, key=lambda each: each.passed)
    progress("runs", 1, 1)
    return best


def _apart(drawn: Array, scores: Array) -> list[Array]:
    """The best of the seats `drawn` (M, n + 1) that differ from each other by more than `APART`."""
    found: list[Array] = []
    left = drawn[np.argsort(-scores, kind="stable")][: (scores > 0.0).sum()]
    while len(left) and len(found) < TRIED:
        found.append(left[0])
        left = left[np.abs((left - left[0] + np.pi) % (2 * np.pi) - np.pi).max(axis=1) > APART]
    return found


def placed(config: ProblemFile[MirrorProblem], keys: dict[str, dict[str, Any]]) -> ProblemFile[MirrorProblem]:
    """The problem with other values of these keys."""
    content = config.problem.model_dump(mode="json", exclude_unset=True)
    for section, values in keys.items():
        where = content
        for name in section.split("."):
            where = where[name]
        where.update(values)
    return dataclasses.replace(config, problem=type(config.problem).model_validate(content))


def achieved(config: ProblemFile[MirrorProblem]) -> float:
    """Fraction of the reference poses that an ideal robot passes with the controller "step"."""
    scene = laid_out(config)
    tracker = tracker_of(config.problem, scene, file=config.file)
    led = track_reference(
        tracker, scene, IdealJoints(tracker.dt), patience=config.problem.tracker.patience,
        progress=lambda *_: None,
    )  # fmt: skip
    return passed_fraction(led["_tool"], scene.reference.poses[~scene.reference.lost])


COMES = 20
"""Number of poses on the straight line from the robot's start to the first pose of a reference."""


def reach_note(problem: MirrorProblem, scene: Setup, tracker: MirrorTracker) -> str:
    """Note on the fraction of the reference that robot and led arm can reach from the robot's start."""
    search = _Search(problem, scene, tracker, np.random.default_rng(0), poses=ALL_POSES)
    search.seats.floor, search.seats.near = tracker.floor, 3  # no reserve for a run
    hands, here = search.hands @ search.grip, scene.robot.pose(scene.start)
    way, turn = hands[0, :3, 3] - here[:3, 3], turn_between(here, hands[0])
    to_the_first = np.tile(here, (COMES, 1, 1))
    for pose, fraction in zip(to_the_first, np.arange(COMES) / COMES, strict=True):
        pose[:3, 3] += fraction * way
        pose[:3, :3] = turned(here[:3, :3], fraction * turn)
    walk = search.seats.walk(np.concatenate([to_the_first, hands])[:, None], scene.start[None], 0)
    fraction = float((walk.done[COMES:, 0] & search.wanted).sum() / search.counted_on.sum())
    said = f"in reach, above the floor, from this start: {100 * fraction:.3g} % of it; `rehab-opt place` may find more"
    return said if fraction == 1.0 else NotMet(said)


class _Search:
    """The search for seats for one recording.

    A seat (n + 1,) [rad] is the robot's posture (n,) at the path's middle pose, and the turn of the patient's frame.
    """

    def __init__(
        self, problem: MirrorProblem, scene: Setup, tracker: MirrorTracker, rng: np.random.Generator, poses: int = POSES
    ) -> None:
        self.problem, self.chain, self.rng = problem, scene.robot, rng
        self.seats, self.w_max = Seats(tracker), tracker.max_manipulability
        self.grip = pose_of(problem.robot.grip_deg, problem.robot.grip_m)
        # Samples at which the person's arm follows the reference, and at which it changes its posture.
        seen = np.flatnonzero(~scene.led.lost)
        goes_on = np.diff(scene.reference_index[seen], append=len(scene.reference.poses)) > 0
        own = seen[goes_on][np.unique(np.linspace(0, goes_on.sum() - 1, poses).astype(int))]
        every = math.ceil(CHANGING / float(scene.led.times[1] - scene.led.times[0]))
        where = np.union1d(own, seen[~goes_on][::every])
        self.counted_on = np.isin(where, own)
        self.wanted = self.counted_on & (scene.beyond[where] < NEARLY).all(axis=1)
        self.most = self.wanted.sum() / self.counted_on.sum()
        self.hands = scene.led.poses[where] @ np.linalg.inv(self.grip)
        places = self.hands[:, :3, 3]
        self.middle = int(np.argmin(np.linalg.norm(places - np.median(places, axis=0), axis=1)))

    def anywhere(self, count: int) -> Array:
        """Random seats (count, n + 1), with postures far above the manipulability floor."""
        chain, found = self.chain, np.empty((0, self.chain.n + 1))
        far = np.minimum(np.pi, np.abs(np.vstack([chain.lower, chain.upper])))
        while len(found) < count:
            q = self.rng.uniform(-far[0], far[1], (4 * count, chain.n))
            drawn = np.column_stack([q, self.rng.uniform(-np.pi, np.pi, len(q))])
            found = np.vstack([found, drawn[(self.seats.at(q)[2] > GOOD) & self.admitted(drawn)]])
        return found[:count]

    def near(self, best: Array, spread: float, count: int) -> Array:
        """Random seats (count, n + 1) around the seats `best` (M, n + 1), with standard deviation `spread` [rad]."""
        which, n = self.rng.integers(0, len(best), count), self.chain.n
        found = best[which]
        found[:, :n] += spread * self.rng.standard_normal((count, n))
        found[:, n] += 2 * spread * self.rng.standard_normal(count)
        found[:, :n] = np.clip(found[:, :n], self.chain.lower, self.chain.upper)
        return found

    def scores(self, drawn: Array) -> Array:
        """(M,) fraction of poses within reach, plus a small bonus for manipulability; zero unless `admitted`."""
        found = np.zeros(len(drawn))
        for begun in range(0, len(found), ANYWHERE):
            some = slice(begun, begun + ANYWHERE)
            walk = self._walk(drawn[some])
            done = (walk.done & self.wanted[:, None]).sum(axis=0)
            found[some] = (done + np.where(walk.done, walk.above, 0.0).mean(axis=0)) / self.counted_on.sum()
        return np.where(self.admitted(drawn), found, 0.0)

    def counted(self, one: Array) -> float:
        """Fraction of the poses that are within reach from the seat `one` (n + 1,)."""
        return float((self._walk(one[None]).done[:, 0] & self.wanted).sum() / self.counted_on.sum())

    def _walk(self, drawn: Array) -> Walk:
        seats, grips, points = self._seats(drawn)
        walk = self.seats.walk(seats @ self.hands[:, None] @ grips, drawn[:, :-1], self.middle)
        clear = np.linalg.norm(walk.elbows - points[:, None, 1, :2], axis=3).min(axis=2) >= CLEAR
        return dataclasses.replace(walk, done=walk.done & clear)

    def _seats(self, drawn: Array) -> tuple[Array, Array, Array]:
        """Three results: rigid motions (M, 4, 4) of the patient's frame, grips (M, 4, 4), and points (M, 3, 3) [m].

        The points are the recording's origin, a point of the sagittal plane, and the led shoulder or its substitute.
        """
        tools, turns = self.seats.at(drawn[:, :-1])[0], drawn[:, -1]
        seats, grips = np.tile(np.eye(4), (len(drawn), 1, 1)), np.tile(self.grip, (len(drawn), 1, 1))
        seats[:, 0, 0] = seats[:, 1, 1] = np.cos(turns)
        seats[:, 1, 0] = np.sin(turns)
        seats[:, 0, 1] = -seats[:, 1, 0]
        hands = seats @ self.hands[self.middle]
        grips[:, :3, :3] = hands[:, :3, :3].transpose(0, 2, 1) @ tools[:, :, :3]
        # The grip's position is in the hand's axes.
        seats[:, :3, 3] = tools[:, :, 3] - (hands @ grips)[:, :3, 3]
        origin, patient = np.array(self.problem.placement.origin_m), self.problem.patient
        middle = np.array(patient.sagittal_point_m)
        points = np.array([origin, middle, 2 * middle - origin if patient.arm is None else patient.arm.shoulder_m])
        return seats, grips, points @ seats[:, :3, :3].transpose(0, 2, 1) + seats[:, None, :3, 3]

    def admitted(self, drawn: Array) -> NDArray[np.bool_]:
        """(M,) whether a patient can sit at each of the seats `drawn` (M, n + 1)."""
        points, (low, high) = self._seats(drawn)[2], HEIGHT
        height, away = points[:, -1, 2], np.linalg.norm(points[:, :, :2], axis=2).min(axis=1)
        return np.asarray((low <= height) & (height <= high) & (away >= AWAY))

    def keys(self, one: Array) -> dict[str, dict[str, Any]]:
        """Keys of the problem file for a seat (n + 1,), rounded."""
        from scipy.spatial.transform import Rotation  # noqa: PLC0415  (loaded when used)

        _, (grip,), (points,) = self._seats(one[None])
        walk = self._walk(one[None])
        origin, middle, shoulder = points.round(3).tolist()
        problem, turn = self.problem, math.degrees(one[-1])
        found: dict[str, dict[str, Any]] = {
            "placement": {"origin_m": origin, "turn_deg": _round_turn(problem.placement.turn_deg + turn)},
            "patient": {"sagittal_point_m": middle, "facing_deg": _round_turn(problem.patient.facing_deg + turn)},
            "robot": {
                "start_deg": np.rad2deg(walk.q[0, 0]).round(1).tolist(),
                "grip_deg": (Rotation.from_matrix(grip[:3, :3]).as_euler("xyz", degrees=True).round(1) + 0.0).tolist(),
            },
        }
        if problem.patient.arm is not None:
            found["patient.arm"] = {"shoulder_m": shoulder}
        return found


def _round_turn(angle: float) -> float:
    """The angle [deg], shifted by whole turns to within -180 and 180, and rounded."""
    return round((angle + 180.0) % 360.0 - 180.0, 1)


def value_text(value: float | str | list[float]) -> str:
    """A number, text or list of numbers as TOML."""
    if isinstance(value, list):
        return "[" + ", ".join(value_text(each) for each in value) + "]"
    return f'"{value}"' if isinstance(value, str) else f"{value:g}" if value != int(value) else f"{value:.1f}"


def replaced_keys(text: str, keys: dict[str, dict[str, Any]], *, file: str) -> str:
    """The text of a TOML file with `keys[section][key]` replaced, or inserted at the start of its section."""
    lines = text.splitlines()
    for section, values in keys.items():
        headers = [
            i for i, line in enumerate(lines) if re.fullmatch(rf"\[{re.escape(section)}\]\s*(#.*)?", line.strip())
        ]
        if len(headers) != 1:
            raise ProblemFileError(file, section, len(headers), f"one line [{section}], with its keys below")
        begin = headers[0] + 1
        for key, value in values.items():
            end = next((i for i in range(begin, len(lines)) if lines[i].lstrip().startswith("[")), len(lines))
            new = f"{key} = {value_text(value)}"
            at = next((i for i in range(begin, end) if re.match(rf"\s*{re.escape(key)}\s*=", lines[i])), None)
            if at is None:
                lines.insert(begin, new)
                continue
            last = at
            while not _is_whole("\n".join(lines[at : last + 1])):
                last += 1
            comment = re.search(r"\s+#[^\"\]]*$", lines[last])
            lines[at : last + 1] = [new + (comment.group() if comment else "")]
    return "\n".join(lines) + "\n"


def _is_whole(text: str) -> bool:
    try:
        tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return False
    return True
