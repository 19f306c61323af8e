"""Mirror trackers in C beside their twins in Python, told the same."""

from __future__ import annotations

import ctypes
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rehab_opt import DH, Command, Interaction, KeepOut, MirrorTracker, SerialChain, human_arm, ur5
from rehab_opt.export.controllers.mirror import NAME, exported_mirror
from rehab_opt.export.export_c import written_files
from tests.export.calling_c import BESIDE, CController, assert_same

Array = NDArray[np.float64]


class Following(ctypes.Structure):
    """`rehab_mirror_tracker_following`."""

    _fields_ = [
        ("reference", ctypes.c_double * 16),
        *((name, ctypes.c_double) for name in ("time_scale", "lag", "manipulability")),
        *((name, ctypes.c_double) for name in ("acceleration", "slowed", "waited", "braked", "cut")),
    ]


class CMirror(CController):
    """The tracker, which says besides how it follows."""

    def following(self) -> Following:
        out = Following()
        self.call("get_following", ctypes.byref(out))
        return out


class Twins:
    """One tracker in both languages, stamped as it goes."""

    def __init__(self, library: ctypes.CDLL, tracker: MirrorTracker) -> None:
        self.c, self.python, self.stamp = CMirror(library, NAME), tracker, 0.0
        tracker.reset()

    def step(
        self, q: Array, pose: Array, twist: Array, force: Array | None = None, *, enable: int = 1, later: float = 1.0
    ) -> Command:
        """What both answer, `later` ticks after the last stamp."""
        self.stamp += later * self.python.dt
        stamp, self.stamp = self.stamp, 0.0 if np.isnan(self.stamp) else self.stamp
        command = self.python.step(q, pose, twist, force=force, enable=enable, stamp=stamp)
        answer = self.c.step(q, pose, twist, force, enable=enable, stamp=stamp)
        assert_same(answer, command)
        told, python = self.c.following(), self.python
        np.testing.assert_allclose(told.reference, python.reference.ravel(), rtol=0, atol=BESIDE)
        one = (told.time_scale, told.lag, told.manipulability)
        np.testing.assert_allclose(one, (python.time_scale, python.lag, python.manipulability), rtol=0, atol=BESIDE)
        names = ("acceleration", "slowed", "waited", "braked", "cut")
        assert [getattr(told, name) for name in names] == [python.counts[name.replace("_", " ")] for name in names]
        return command


# --------------------------------------------------------------------------------------------------------- trackers
def seven_joints() -> SerialChain:
    """A redundant arm of the usual light-weight kind."""
    right = np.pi / 2
    rows = [
        DH(0, -right, 0.34), DH(0, right), DH(0, right, 0.4), DH(0, -right), DH(0, -right, 0.4), DH(0, right),
        DH(0, 0, 0.126),
    ]  # fmt: skip
    widest = np.deg2rad([170, 120, 170, 120, 170, 120, 175])
    return SerialChain(rows, lower=-widest, upper=widest, velocity=1.7, acceleration=[10.0] * 6 + [np.inf])


def redundant() -> MirrorTracker:
    """Seven joints with a table, and a floor that is often in the way."""
    table = KeepOut.through([0, 0, 0.1], [0, 0, 1])
    return MirrorTracker(
        seven_joints(), floor=0.4, keep_out=[table], dt=0.01, backup="qrqp", max_deviation=0.03,
        interaction=Interaction(slow_from=4.0, limit=20.0, stop_at=40.0),
    )  # fmt: skip


def led() -> MirrorTracker:
    """A UR5 that leads an arm of restricted motion."""
    arm, robot = human_arm(range_of_motion="restricted"), ur5()
    middle = 0.5 * (arm.lower + arm.upper)
    base = robot.pose(START["led"]) @ np.linalg.inv(arm.pose(middle))  # in the middle of its range the hand is held
    return MirrorTracker(robot, dt=0.005, backup="qrqp", person=replace(arm, base=base @ arm.base))


START = {
    "redundant": np.array([0.3, 0.6, 0.2, -1.4, 0.3, 1.1, 0.2]),
    "led": np.deg2rad([183.3, -85.9, 108.9, -114.6, -80.2, 11.5]),
}
MADE = {"redundant": redundant, "led": led}


def written(folder: Path, name: str, tracker: MirrorTracker, *, ticks: int = 900) -> Path:
    """Folder of the C files of a tracker."""
    start = START[name]
    poses, twists = wave(tracker, start, np.random.default_rng(5), ticks)
    controller = exported_mirror(tracker, start, poses, twists, title=name, source="a wave of the hand")
    written_files({folder: controller}, folder, problem="a library call")
    return folder


def wave(tracker: MirrorTracker, q: Array, rng: np.random.Generator, ticks: int) -> tuple[Array, Array]:
    """Poses and twists of a hand that waves about the tool at q, as fast as it likes."""
    first = tracker.chain.pose(q)
    t = tracker.dt * np.arange(ticks)[:, None]
    rates, phases = rng.uniform(0.3, 5.0, (2, 3)), rng.uniform(0, 2 * np.pi, (2, 3))
    sizes = rng.choice([0.0, 0.02, 0.1, 0.4]), rng.choice([0.0, 0.1, 0.8, 2.5])
    (shift, turn), (speed, spin) = (
        [
            size * f(rate * t + phase) * factor
            for size, rate, phase, factor in zip(sizes, rates, phases, factors, strict=True)
        ]
        for f, factors in ((np.sin, (1.0, 1.0)), (np.cos, rates))
    )
    poses = np.tile(first, (ticks, 1, 1))
    poses[:, :3, 3] += shift - shift[0]
    poses[:, :3, :3] = Rotation.from_rotvec(turn - turn[0]).as_matrix() @ first[:3, :3]
    return poses, np.hstack([speed, spin])
