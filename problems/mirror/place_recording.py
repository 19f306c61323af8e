"""Look for the seat and the grip of vr_hand.toml: `python problems/mirror/place_recording.py [--candidates 1000]`.

The recording tells neither. A posture of the robot, drawn at random and far above the floor, and a direction that the
patient looks in fix the seat and the grip: the robot's tool is at the led hand where the motion begins. Each candidate
is planned on what the patient's arm can do of the recording; of those whose patient sits beside the robot, the one
whose path passes near most of it is printed as lines of vr_hand.toml.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rehab_opt import MirrorTracker, ur5
from rehab_opt.control.conditioning import Conditioned, conditioned
from rehab_opt.control.hand_bounds import KeepOut
from rehab_opt.control.manipulability import largest_manipulability
from rehab_opt.control.person_limit import PersonLimit
from rehab_opt.kinematics.vr import quaternions_of
from rehab_opt.session.files import load_problem
from rehab_opt.session.mirror.scene import laid_out

Array = NDArray[np.float64]

DT, RATE = 0.02, 50.0
SLOWLY = 8
"""Ticks that the model of the patient's arm has for each sample: as much as the clock will slow it down."""
SHOULDERS = 0.36
"""[m] from one shoulder to the other; the model of the led arm begins at its own."""
HEIGHT, AWAY, CLEAR = (0.1, 0.5), 0.45, 0.3
"""[m] of the patient's shoulders over the robot's base; least distance of both from its axis, and of the robot's elbow
from the upright through the patient's middle."""
ANYWHERE = 0.7
"""Share of the candidates that are drawn anywhere; the others are drawn near the best so far."""
NEAR, TURNED = 5e-3, math.radians(5.0)
"""[m, rad] within which a path passes a pose."""


class Place(NamedTuple):
    """A candidate, by what the problem file says of it."""

    start_deg: list[float]
    facing_deg: float
    origin_m: list[float]
    grip_deg: list[float]


def axes(facing_deg: float) -> Array:
    """(3, 3) forward, left and up of a patient who looks this way."""
    c, s = math.cos(math.radians(facing_deg)), math.sin(math.radians(facing_deg))
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def hand_path() -> Array:
    """(N, 4, 4) of the led hand as far as the patient's arm goes; patient's axes, from the recorded shoulder."""
    loaded = load_problem("mirror/vr_hand")
    given = loaded.problem
    arm = given.patient.arm.model_copy(update={"shoulder_m": [0.0, SHOULDERS, 0.0]})
    middle = {"facing_deg": 0.0, "sagittal_point_m": [0.0, SHOULDERS / 2, 0.0], "arm": arm}
    problem = given.model_copy(
        update={
            "placement": given.placement.model_copy(update={"origin_m": [0.0, 0.0, 0.0], "turn_deg": 0.0}),
            "patient": given.patient.model_copy(update=middle),
            "robot": given.robot.model_copy(update={"grip_deg": [0.0, 0.0, 0.0]}),
            "tracker": given.tracker.model_copy(update={"rate_hz": RATE}),
        }
    )
    scene = laid_out(dataclasses.replace(loaded, problem=problem))
    assert scene.person is not None
    limit = PersonLimit(scene.person[0], grip=scene.person[1], dt=DT, compile=False)
    return np.array(
        [[limit.limited(pose, np.zeros(6)) for _ in range(SLOWLY)][-1][0] for pose in scene.reference.poses]
    )


def drawn(rng: np.random.Generator, hand: Array, largest: float, near: Place | None) -> Place:
    """A posture above half the largest manipulability, a direction, and what follows, in round numbers.

    Anywhere, or near another place.
    """
    robot = ur5()
    while True:
        q_deg = np.round(rng.uniform([-180, -140, 30, -200, -150, -90], [180, -40, 140, -20, 150, 90]))
        facing = float(rng.integers(-12, 12)) * 15.0
        if near is not None:
            q_deg = np.round(near.start_deg + 6.0 * rng.standard_normal(6))
            facing = near.facing_deg + 5.0 * float(rng.integers(-2, 3))
        q = np.deg2rad(q_deg)
        if robot.manipulability(q) < 0.5 * largest:
            continue
        seat, tool = axes(facing), robot.pose(q)
        origin = np.round(tool[:3, 3] - seat @ hand[:3, 3], 2)
        led = origin + seat @ [0.0, SHOULDERS, 0.0]
        nearest = min(math.hypot(*side[:2]) for side in (origin, (origin + led) / 2, led))
        if not HEIGHT[0] <= origin[2] <= HEIGHT[1] or nearest < AWAY:
            continue
        grip = np.round(euler_deg((seat @ hand[:3, :3]).T @ tool[:3, :3]) / 5.0) * 5.0
        return Place(q_deg.tolist(), facing, (origin + 0.0).tolist(), (grip + 0.0).tolist())


def euler_deg(rotation: Array) -> Array:
    """(3,) turns about x, then y, then z of the fixed frame."""
    x = math.atan2(rotation[2, 1], rotation[2, 2])
    y = math.atan2(-rotation[2, 0], math.hypot(rotation[2, 1], rotation[2, 2]))
    return np.rad2deg([x, y, math.atan2(rotation[1, 0], rotation[0, 0])])


def rotation_of(angles_deg: list[float]) -> Array:
    """(3, 3), the inverse of `euler_deg`."""
    found = np.eye(3)
    for angle, (i, j) in zip(np.deg2rad(angles_deg), ((1, 2), (2, 0), (0, 1)), strict=True):
        turn = np.eye(3)
        turn[i, i] = turn[j, j] = math.cos(angle)
        turn[i, j], turn[j, i] = -math.sin(angle), math.sin(angle)
        found = turn @ found
    return found


def tools(place: Place, hands: Array) -> Conditioned:
    """The reference of the tool."""
    poses, seat = hands.copy(), axes(place.facing_deg)
    poses[:, :3, :3] = seat @ hands[:, :3, :3] @ rotation_of(place.grip_deg)
    poses[:, :3, 3] = hands[:, :3, 3] @ seat.T + place.origin_m
    times = DT * np.arange(len(poses))
    return conditioned(times, poses[:, :3, 3], quaternions_of(poses[:, :3, :3]), dt=DT, cutoff_hz=math.inf)


def passed(tracker: MirrorTracker, place: Place, hands: Array) -> float:
    """Share of the poses that a plan passes near."""
    asked = tools(place, hands)
    path = tracker.plan(asked.poses, asked.twists, np.deg2rad(place.start_deg))
    if not path.complete or clearance(place, path.q) < CLEAR:
        return 0.0
    near = 0
    for pose in asked.poses:
        close = np.linalg.norm(path.poses[:, :3, 3] - pose[:3, 3], axis=1) < NEAR
        cosines = (np.einsum("nij,ij->n", path.poses[close, :3, :3], pose[:3, :3]) - 1.0) / 2.0
        near += bool(np.any(cosines > math.cos(TURNED)))
    return near / len(asked.poses)


def clearance(place: Place, q: Array) -> float:
    """[m] of the robot's elbow from the patient's middle, seen from above, along joint positions (N, 6)."""
    middle = (np.array(place.origin_m) + axes(place.facing_deg) @ [0.0, SHOULDERS / 2, 0.0])[:2]
    symbol = ca.SX.sym("q", 6)
    elbow = ca.Function("elbow", [symbol], [ur5().frames_expression(symbol)[2][:2, 3]])
    return min(math.dist(np.array(elbow(each)).ravel(), middle) for each in q[::10])


def main() -> None:
    """Print the best place."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--candidates", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    largest, rng, hands = largest_manipulability(ur5())[0], np.random.default_rng(options.seed), hand_path()
    table = KeepOut.through([0.0, 0.0, -0.3], [0.0, 0.0, 1.0])
    tracker = MirrorTracker(ur5(), dt=DT, max_manipulability=largest, keep_out=[table])
    best, kept = -1.0, None
    for number in range(options.candidates):
        place = drawn(rng, hands[0], largest, kept if number > ANYWHERE * options.candidates else None)
        share = passed(tracker, place, hands)
        if share > best:
            best, kept = share, place
            shoulder = np.array(place.origin_m) + axes(place.facing_deg) @ [0.0, SHOULDERS, 0.0]
            middle = np.array(place.origin_m) + axes(place.facing_deg) @ [0.0, SHOULDERS / 2, 0.0]
            print(f"candidate {number}: {share:.0%} of the poses")
            print(f"  origin_m = {place.origin_m}  turn_deg = facing_deg = {place.facing_deg}")
            print(f"  sagittal_point_m = {middle.round(3).tolist()}  shoulder_m = {shoulder.round(3).tolist()}")
            print(f"  start_deg = {place.start_deg}  grip_deg = {place.grip_deg}", flush=True)


if __name__ == "__main__":
    main()
