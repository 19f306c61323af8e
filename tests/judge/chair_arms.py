"""Arms from robot files on the chair: bodies stay out of keep-outs, joints within bounds, the hand on its stick's way.

An arm of four to seven joints is drawn and written as a URDF, with the judge's own kinematics of it. Its links are
capsules of the file's frames, or segments from joint to joint. Now and again a stick held still leads one of these
straight at a body of the chair's; judged in each tick are keep-outs, joints and wheels, and later the hand's velocity.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rehab_opt import Capsule, CapsuleOnLink, RedundancyResolver, Relaxed, SerialChain, arm_on_chair
from tests.judge.chair_held import BRAKING, SIZE
from tests.judge.chair_robot import STAND_OFF, segments_apart
from tests.judge.numbering import numbered
from tests.judge.verdict import Verdict

Array = NDArray[np.float64]

GUARANTEES = ("G02", "G12", "G13")
LEAST = {"a keep-out near": 30_000, "stopped before a keep-out": 5000, "capsules of the file": 200_000,
         "segments from joint to joint": 100_000, "the hand as asked": 20_000, "law judged": 50_000}  # fmt: skip
CI_TICKS = 3600
SHARE = 0.2
EPISODES, SECONDS = 6, 3.0
ROWS = ("x", "y", "z"), ("x", "y", "z"), ("z", "roll7"), ("x", "y")
KEEP_OUT = (
    Capsule("trunk and head", (-0.15, 0.0, 0.55), (-0.15, 0.0, 1.25), 0.18),
    Capsule("legs", (-0.10, 0.0, 0.55), (0.40, 0.0, 0.50), 0.18),
)
SPEED, TURN = 0.8, 1.0
"""[m/s, rad/s] Of the chair, whose accelerations are 1 m/s^2 and 1.5 rad/s^2."""
RADIUS = 0.05
"""[m] Of a link that has no capsule of its own."""
NEAR, ROUNDING = 0.005, 1e-9
AXES = np.eye(3)
STILL: dict[str, list[int]] = {"fixed": [0, 1, 2], "differential": [1], "mecanum": []}
SINGULAR = 1e-3
"""[m, rad] Of the hand for a rad: rows in which it moves less at every posture drawn are not independent."""


@dataclass(frozen=True)
class Arm:
    """Numbers of an arm of n joints: what its file says."""

    mount: Array
    """(4, 4) of its first link in the chassis frame."""
    origins: Array
    """(n + 1, 3) of each joint, and of the tool, in the link before [m]."""
    turns: Array
    """(n, 3) roll, pitch and yaw of each joint in the link before [rad]."""
    axes: Array
    """(n, 3) unit vectors."""
    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    capsules: tuple[tuple[int, Array, float], ...]
    """Joint whose link it is (from 1), both ends (2, 3) [m] in that link, radius [m]."""

    @property
    def n(self) -> int:
        """How many joints."""
        return len(self.axes)

    def urdf(self) -> str:
        """The file."""
        text = ['<robot name="drawn"><link name="link0"/>']
        for i in range(self.n):
            xyz, rpy, axis = (" ".join(map(repr, each[i].tolist())) for each in (self.origins, self.turns, self.axes))
            text.append(
                f'<link name="link{i + 1}"><inertial><origin xyz="0 0 0.05"/><mass value="1.0"/><inertia ixx="0.01" '
                f'ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link><joint name="joint{i + 1}" '
                f'type="revolute"><parent link="link{i}"/><child link="link{i + 1}"/><origin xyz="{xyz}" rpy="{rpy}"/>'
                f'<axis xyz="{axis}"/><limit lower="{self.lower[i]}" upper="{self.upper[i]}" effort="50" '
                f'velocity="{self.velocity[i]}"/></joint>'
            )
        xyz = " ".join(map(repr, self.origins[-1].tolist()))
        text.append(
            f'<link name="tool"/><joint name="mounted" type="fixed"><parent link="link{self.n}"/><child link="tool"/>'
            f'<origin xyz="{xyz}"/></joint></robot>'
        )
        return "".join(text)

    def robot(self) -> Any:
        """What the public constructors make of the same numbers."""
        capsules = [CapsuleOnLink(f"link{i}", tuple(ends[0].tolist()), tuple(ends[1].tolist()), radius)  # type: ignore[arg-type]
                    for i, ends, radius in self.capsules]  # fmt: skip
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "drawn.urdf"
            file.write_text(self.urdf(), encoding="utf-8")
            chain = SerialChain.from_urdf(file, tip="tool", acceleration=self.acceleration, capsules=capsules)
        return arm_on_chair(chain, mount=self.mount, keep_out=KEEP_OUT)

    def links(self, q: Array) -> list[Array]:
        """(n + 2) poses (..., 4, 4) in the chassis frame at arm joints (..., n): first link, the others, the tool."""
        pose = np.broadcast_to(self.mount, (*q.shape[:-1], 4, 4))
        found = [pose]
        for i in range(self.n):
            fixed = np.eye(4)
            fixed[:3, :3], fixed[:3, 3] = rolled_pitched_yawed(self.turns[i]), self.origins[i]
            pose = pose @ fixed @ turned_about(self.axes[i], q[..., i])
            found.append(pose)
        tool = np.eye(4)
        tool[:3, 3] = self.origins[-1]
        return [*found, pose @ tool]

    def bodies(self, q: Array) -> list[tuple[Array, Array, float]]:
        """Both ends (..., 3) in the chassis frame and radius [m] of each link at arm joints (..., n)."""
        poses = self.links(q)
        if self.capsules:
            return [
                (*(poses[i][..., :3, :3] @ end + poses[i][..., :3, 3] for end in ends), radius)
                for i, ends, radius in self.capsules
            ]
        places = [pose[..., :3, 3] for pose in poses[1:]]
        return [(one, other, RADIUS) for one, other in pairwise(places) if np.abs(one - other).max() > ROUNDING]

    def gaps(self, q: Array) -> Array:
        """(..., k) [m] of links and keep-outs at arm joints (..., n); negative inside."""
        return np.stack(
            [
                segments_apart(one, other, np.array(body.start), np.array(body.end)) - body.radius - radius
                for one, other, radius in self.bodies(q)
                for body in KEEP_OUT
            ],
            -1,
        )

    def hand(self, q: Array) -> tuple[Array, Array]:
        """Place (..., 3) [m] and rotation (..., 3, 3) of the tool in the world, at joints of chair and arm."""
        pose = self.links(q[..., 3:])[-1]
        heading = turned_about(AXES[2], q[..., 2])[..., :3, :3]
        place = np.einsum("...ij,...j->...i", heading, pose[..., :3, 3])
        place[..., :2] += q[..., :2]
        return place, heading @ pose[..., :3, :3]


def rolled_pitched_yawed(angles: Array) -> Array:
    """(3, 3) yaw @ pitch @ roll [rad]."""
    roll, pitch, yaw = (turned_about(axis, np.array(angle))[:3, :3] for axis, angle in zip(AXES, angles, strict=True))
    return np.asarray(yaw @ pitch @ roll)


def turned_about(axis: Array, angle: Array) -> Array:
    """(..., 4, 4) by angles (...) [rad] about a unit vector: Rodrigues."""
    across = np.cross(axis, AXES).T
    sine, cosine = np.sin(angle)[..., None, None], np.cos(angle)[..., None, None]
    found = np.zeros((*np.shape(angle), 4, 4))
    found[..., :3, :3] = AXES + sine * across + (1 - cosine) * across @ across
    found[..., 3, 3] = 1.0
    return found


def drawn(rng: np.random.Generator, *, bodies: bool) -> Arm:
    """An arm beside the seat, with capsules of its own or without."""
    n = int(rng.choice([4, 5, 6, 7]))
    lengths = rng.dirichlet(np.full(n + 1, 2.0)) * rng.uniform(0.7, 1.1)
    lengths[1:-1][rng.random(n - 1) < 0.3] = 0.0
    origins = np.zeros((n + 1, 3))
    origins[1:, 2], origins[-1, 2] = lengths[1:], max(lengths[-1], 0.1)
    origins[1:, 0] = rng.choice([0.0, 0.0, 0.04], n)
    axes, last = np.zeros((n, 3)), -1
    for i in range(n):
        last = int(rng.choice([each for each in range(3) if each != last]))
        axes[i] = AXES[last] * rng.choice([-1.0, 1.0]) + (0.1 * rng.standard_normal(3) if rng.random() < 0.3 else 0.0)
    mount = np.eye(4)
    mount[:3, :3] = rolled_pitched_yawed(rng.choice([0.0, 0.0, math.pi / 2, -0.4], 3))
    mount[:3, 3] = rng.uniform([0.0, -0.5, 0.5], [0.35, -0.38, 0.8])
    velocity = rng.uniform(0.5, 2.0, n)
    capsules = [
        (i, np.array([np.zeros(3), origins[i]]) + rng.uniform(-0.03, 0.03, 3), float(rng.uniform(0.03, 0.07)))
        for i in range(1, n + 1)
        if i == n or np.linalg.norm(origins[i]) > 0.1
    ]
    return Arm(
        mount, origins, rng.choice([0.0, 0.0, 0.0, math.pi / 2, 0.3], (n, 3)),
        axes / np.linalg.norm(axes, axis=1)[:, None], -rng.uniform(1.0, 3.0, n), rng.uniform(1.0, 3.0, n), velocity,
        velocity / rng.uniform(0.15, 0.8, n), tuple(capsules) if bodies else (),
    )  # fmt: skip


# ------------------------------------------------------------------------------------------------------------ runs
def run(ticks: int, seed: int, *, only: int | None = None) -> Verdict:
    """Arms in turn."""
    verdict = Verdict("chair_arms", seed, LEAST)
    for number, rng in numbered(verdict, ticks, only):
        one_arm(verdict, number, rng)
    return verdict


def one_arm(verdict: Verdict, number: int, rng: np.random.Generator) -> None:
    """One robot, and sticks that are held."""
    rows, drive = ROWS[int(rng.integers(len(ROWS)))], ("fixed", "fixed", "differential", "mecanum")[number % 4]
    arm = drawn(rng, bodies=number % 3 > 0)
    while (start := free_posture(arm, rng)) is None or not valid(arm, drive, rows):
        arm = drawn(rng, bodies=number % 3 > 0)
    dt = float(rng.choice([0.01, 0.01, 0.02]))
    made = RedundancyResolver(arm.robot(), drive=drive, row_sets=[rows], dt=dt, max_obstacles=0, compile=False)  # type: ignore[arg-type]
    verdict.begin(number, f"{arm.n} joints, {drive}, {rows}, dt {dt:g}, {len(arm.capsules)} capsules")
    for _ in range(EPISODES):
        place, other = rng.uniform(-0.3, 0.3, 3), free_posture(arm, rng) if rng.random() < 0.8 else start
        q = np.concatenate([place, start if other is None else other])
        twist = rng.uniform(0.1, 0.25) * stick(arm, q, rows, rng)
        episode(verdict, arm, made, q, twist, rows, drive, dt)


def valid(arm: Arm, drive: str, rows: tuple[str, ...]) -> bool:
    """Whether the rows are independent, and the arm alone moves its hand every way somewhere: else it is refused."""
    velocity = partial(hand_velocity, arm)
    return independent(velocity, arm, drive, rows) and independent(velocity, arm, "fixed", ("x", "y", "z"))


def independent(velocity: Callable[..., Array], arm: Arm, drive: str, rows: tuple[str, ...]) -> bool:
    """Whether the hand can be moved in all rows at once somewhere: an arm whose joints turn about one axis cannot.

    velocity : q (N, 3 + n), where they lead (N, 3 + n), rows, in which time [s] -> (N, k).
    """
    joints = np.random.default_rng(0).uniform(arm.lower, arm.upper, (8, arm.n))
    for each in np.hstack([np.zeros((8, 3)), joints]):
        moves = velocity(np.tile(each, (3 + arm.n, 1)), each + 1e-6 * np.eye(3 + arm.n), rows, 1e-6)
        moves[STILL[drive]] = 0.0
        if np.linalg.svd(moves, compute_uv=False).min() > SINGULAR:
            return True
    return False


def free_posture(arm: Arm, rng: np.random.Generator) -> Array | None:
    """(n,) joints within their limits, off keep-outs, near one if the drawn ones are; None where there are none."""
    joints = rng.uniform(arm.lower, arm.upper, (300, arm.n))
    nearest = arm.gaps(joints).min(axis=1)
    free = joints[nearest > NEAR / 2]
    if not len(free):
        return None
    return np.asarray(free[int(np.argmin(nearest[nearest > NEAR / 2][:8]))])


def stick(arm: Arm, q: Array, rows: tuple[str, ...], rng: np.random.Generator) -> Array:
    """(k,) a direction: of the hand, as the arm leads one of its links at a keep-out, often the last; or any."""
    direction = rng.standard_normal(len(rows))
    if rng.random() < 0.8:
        step = 1e-6 * np.eye(arm.n)
        slopes = arm.gaps(q[3:] + step) - arm.gaps(q[3:] - step)
        now = arm.gaps(q[3:])
        near = np.flatnonzero((now < 0.3) & (np.abs(slopes).max(axis=0) > 0))
        at = int(near[-1] if rng.random() < 0.5 else rng.choice(near)) if len(near) else int(np.argmin(now))
        if np.abs(slopes[:, at]).max() > 0:
            ahead = q + np.concatenate([np.zeros(3), -1e-4 * slopes[:, at] / np.linalg.norm(slopes[:, at])])
            found = hand_velocity(arm, np.array([q]), np.array([ahead]), rows, 1.0)[0]
            direction = found if np.linalg.norm(found) > 1e-6 else direction
    return np.asarray(direction / np.linalg.norm(direction))


def hand_velocity(arm: Arm, q: Array, ahead: Array, rows: tuple[str, ...], dt: float) -> Array:
    """(N, k) [m/s, rad/s] from q to `ahead` (N, 3 + n), in the chassis frame at the tick's begin."""
    (place, turn), (later, other) = arm.hand(q), arm.hand(ahead)
    back = turned_about(AXES[2], -q[:, 2])[:, :3, :3]
    linear = np.einsum("nij,nj->ni", back, later - place) / dt
    change = other @ np.swapaxes(turn, 1, 2)
    axis = np.stack([change[:, 2, 1] - change[:, 1, 2], change[:, 0, 2] - change[:, 2, 0],
                     change[:, 1, 0] - change[:, 0, 1]], -1) / 2  # fmt: skip
    sine = np.linalg.norm(axis, axis=1)
    scale = np.where(sine > 1e-12, np.arcsin(np.minimum(sine, 1)) / np.maximum(sine, 1e-12), 1.0)
    roll = np.sum(axis * turn[:, :, 2], axis=1) * scale / dt
    every = {"x": linear[:, 0], "y": linear[:, 1], "z": linear[:, 2], "roll7": roll}
    return np.stack([every[row] for row in rows], -1)


def episode(
    verdict: Verdict, arm: Arm, made: Any, q: Array, twist: Array, rows: tuple[str, ...], drive: str, dt: float
) -> None:
    """One stick, held still."""
    ticks = round(SECONDS / dt)
    path, commands = np.empty((ticks + 1, len(q))), []
    path[0] = q
    made.reset(heading=float(q[2]))
    for k in range(ticks):
        command = made.step(path[k], twist, rows)
        commands.append(command)
        path[k + 1] = path[k] + dt * command.value
    found = verdict.answers(commands, dt)
    c, s = np.cos(path[:-1, 2]), np.sin(path[:-1, 2])
    x, y, u = found.value[:, 0], found.value[:, 1], found.value.copy()
    u[:, 0], u[:, 1] = c * x + s * y, c * y - s * x
    top, quickest = np.append([SPEED, SPEED, TURN], arm.velocity), np.append([1.0, 1.0, 1.5], arm.acceleration)
    verdict.within("speeds", np.abs(u), top + ROUNDING)
    verdict.within("chassis speed", np.hypot(u[:, 0], u[:, 1]), SPEED + ROUNDING)
    still = STILL[drive]
    verdict.within("what the drive cannot do", np.abs(u[:, still]), ROUNDING)
    joints, before = path[:, 3:], np.vstack([np.zeros(len(q)), u[:-1]])
    verdict.within("joint limits", np.maximum(joints - arm.upper, arm.lower - joints), ROUNDING)
    gaps = arm.gaps(joints)
    nearest = gaps.min(axis=1)
    verdict.within("keep-outs", np.minimum(gaps[:-1], 0) - gaps[1:], ROUNDING)
    hurried = (np.abs(u - before) > quickest * dt * (1 + 1e-6) + ROUNDING).any(axis=1)
    flagged = found.relaxed & Relaxed.ACCELERATION.value != 0
    verdict.holds("a change beyond the acceleration is flagged", ~hurried | flagged)
    verdict.holds("accelerations yield within 2 mm of a keep-out alone", ~hurried | (nearest[:-1] < STAND_OFF))
    verdict.holds("all is acted on", np.isin(found.status, ("ok", "backup", "blocked")))
    verdict.holds("moving with scale 0 is not OK", (found.scale > 0) | (found.status != "ok"))

    hand = hand_velocity(arm, path[:-1], path[1:], rows, dt) / np.linalg.norm(twist)
    way = twist / np.linalg.norm(twist)
    along = hand @ way
    across = np.linalg.norm(hand - along[:, None] * way, axis=1)
    moves = np.setdiff1d(np.arange(len(q)), still)
    late = round((float((top / quickest)[moves].max()) + 1.0) / dt)
    chord = max(1.0, dt / 0.01)
    verdict.within("law: the hand is no faster than the command", along[late:], 1 + SIZE * chord)
    verdict.within("law: against the command", -along[late:], BRAKING)
    verdict.within("law: across the command", across[late:], BRAKING)
    verdict.during("law judged", np.arange(ticks) >= late, dt)
    verdict.during("the hand as asked", np.abs(along - 1) < 0.01, dt)
    verdict.during("a keep-out near", nearest[:-1] < NEAR, dt)
    verdict.during("stopped before a keep-out", (nearest[:-1] < NEAR) & (along < 0.02), dt)
    verdict.during("capsules of the file" if arm.capsules else "segments from joint to joint", along > -2, dt)
