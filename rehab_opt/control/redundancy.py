"""One stick moves chair and arm: joint velocities of a redundant robot for a commanded hand twist."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from threading import get_ident
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rehab_opt.control.chair_and_arm import ChairAndArm
from rehab_opt.control.chair_limits import ChairLimits
from rehab_opt.control.clearance import Clearance
from rehab_opt.control.command import Command
from rehab_opt.control.hand_task import checked_rows, frame_number
from rehab_opt.control.limit import Limit, PostureLimits, all_limits
from rehab_opt.control.obstacles import Obstacle, obstacle_numbers
from rehab_opt.control.reaching import Reaching
from rehab_opt.control.thread_owner import OneThread, setting
from rehab_opt.control.velocity_controller import checked_number, real_numbers
from rehab_opt.errors import ConfigurationError
from rehab_opt.kinematics import DriveName
from rehab_opt.kinematics.chain import per_joint
from rehab_opt.kinematics.mobile_arm import CHAIR, MobileArm
from rehab_opt.kinematics.real_array import is_true
from rehab_opt.kinematics.room import MovingCapsule
from rehab_opt.optim.rows import Instance
from rehab_opt.symbolic import Compile

if TYPE_CHECKING:
    import qpsolvers

__all__ = ["RedundancyResolver"]

Array = NDArray[np.float64]

STICK_ROWS = (("x", "y", "z"), ("x", "y"), ("z", "roll7"))
"""Default sets of task rows with compiled functions: reaching, and the paper's two modes of the stick."""
CHASSIS = ("forward", "sideways", "turning")
LONGEST_TICK = 0.02
"""[s] Longest tick for which the guarantees hold."""
FASTER = 1e-9
"""A velocity passed to `reset` may exceed its limit by this fraction, for rounding."""


class RedundancyResolver(OneThread):
    """Chair and arm velocities for a hand twist: Honzik's Eq. 1 as a QP with bounds; stated in `ChairAndArm`.

    Bounds take precedence in this order: joint, chassis and wheel speeds, and rolling; joint limits, obstacles and
    keep-outs; accelerations; the task, which is slowed along its direction. The whole robot can brake together before
    every limit, keep-out and obstacle (`BrakingTogether`). G11 to G14 of `docs/guarantees.md` state speed and direction
    of the hand. Within a tick, a link that slides along a keep-out may enter it by 0.1 mm; G12 does not hold beside
    approaching bodies.

    If the bounds allow no part of the command, the status is `BLOCKED`; the chair may still move slowly. A joint
    outside its limits returns only if the task or the posture cost moves it. Collisions of the hand are not detected. A
    new resolver is at rest unless `reset` sets a velocity. An object belongs to one thread, see `OneThread`.

    Parameters
    ----------
    robot : from `ardis` or `arm_on_chair`.
    drive : "mecanum"; "differential", which cannot move sideways; "omnidirectional", whose wheel speeds are the chassis
        twist; or "fixed", where only the arm moves. See `Drive`.
    row_sets : sets of task rows (`ROWS`) with functions compiled at construction, up to half a minute per set. Other
        sets get uncompiled functions at first use; a moving robot brakes first.
    obstacles : walls and posts in the world frame.
    max_obstacles : largest number of obstacles at any time; default the number of `obstacles`.
    keep_out : whether the arm must stay out of the robot's keep-outs.
    limits : further limits of the posture in the world frame: `Limit`s, and a `Clearance` of the arm, also against the
        chair. Without a command the robot does not move away from bodies. Beside an approaching body, or beyond such a
        limit, accelerations are relaxed.
    self_motion : weight of the posture cost's gradient in Eq. 1: v(r') = self_motion |r'|.
    dt : nominal tick [s], at most 0.02.
    recovery_speed : largest speed of a joint's return into its limits, as a fraction of its speed limit.
    solver, backup : see `FallbackChain`. tolerance : largest accepted residual [m/s, rad/s].
    max_age : [s] see `Watchdog`. compile : see `BufferedFunction`.
    """

    robot: MobileArm = setting()
    drive: DriveName = setting()
    dt: float = setting()
    limits: PostureLimits = setting()

    def __init__(
        self,
        robot: MobileArm,
        *,
        drive: DriveName = "mecanum",
        row_sets: Sequence[Sequence[str]] = STICK_ROWS,
        obstacles: Sequence[Obstacle] = (),
        max_obstacles: int | None = None,
        keep_out: bool = True,
        limits: Sequence[Limit | Clearance] = (),
        self_motion: float = 1.0,
        dt: float = 0.01,
        recovery_speed: float = 0.1,
        solver: str = "qrqp",
        backup: str | None = None,
        tolerance: float = 1e-8,
        max_age: float | None = None,
        compile: Compile = None,
    ) -> None:
        if not isinstance(robot, MobileArm):
            raise ConfigurationError("robot", robot, "a MobileArm, from ardis() or arm_on_chair()")
        robot.drive(drive)
        if max_obstacles is None:
            max_obstacles = len(obstacles) if isinstance(obstacles, (list, tuple)) else 0
        whole = isinstance(max_obstacles, int | np.integer) and not isinstance(max_obstacles, bool)
        if not (whole and 0 <= max_obstacles <= 1000):
            raise ConfigurationError("max_obstacles", max_obstacles, "a whole number from 0 to 1000")
        if not (isinstance(row_sets, (list, tuple)) and row_sets):
            raise ConfigurationError("row_sets", row_sets, "a list or tuple of at least one set of rows")
        if not isinstance(keep_out, bool):
            raise ConfigurationError("keep_out", keep_out, "True or False")
        self.robot = robot if keep_out else replace(robot, keep_out=())
        self.drive, self.dt = drive, checked_number("dt", dt, above=0.0, most=LONGEST_TICK)
        if not (isinstance(self_motion, (int, float)) and self_motion == 0.0):
            checked_number("self_motion", self_motion, above=0.0)
        checked_number("recovery_speed", recovery_speed, above=0.0, below=1.0)
        self.limits = all_limits(limits, self.robot.bodied_chain, self.dt, recovery_speed)
        self._kept = ChairLimits(
            self.robot, robot.drive(drive), max_obstacles=int(max_obstacles), dt=self.dt, recovery_speed=recovery_speed,
            own=self.limits,
        )  # fmt: skip
        self._options = {
            "drive": drive, "self_motion": float(self_motion), "solver": solver, "backup": backup,
            "tolerance": tolerance, "max_age": max_age,
        }  # fmt: skip
        self._max_obstacles = int(max_obstacles)
        self._sets: dict[tuple[str, ...], ChairAndArm] = {}
        self.obstacles = obstacles
        self._compile = compile
        for rows in row_sets:
            self._add_rows(checked_rows(rows, "row_sets"), compile=compile)
        self._active = next(iter(self._sets.values()))
        self._reaching: Reaching | None = None
        self.reset()

    # -------------------------------------------------------------------------------------------------- the room
    @property
    def obstacles(self) -> Sequence[Obstacle]:
        """Walls and posts in the world frame, at most `max_obstacles`; may be set between ticks.

        A chair inside a new obstacle can move out, but not further in.
        """
        return self._obstacles

    @obstacles.setter
    def obstacles(self, obstacles: Sequence[Obstacle]) -> None:
        self._refuse_others()
        self._numbers = obstacle_numbers(obstacles, self._max_obstacles)
        self._obstacles = tuple(obstacles)
        for each in self._sets.values():
            each.set_obstacles(self._numbers)

    # ------------------------------------------------------------------------------------------------- the state
    @property
    def row_sets(self) -> tuple[tuple[str, ...], ...]:
        """Sets of task rows whose functions are built."""
        return tuple(self._sets)

    @property
    def chassis_velocity(self) -> Array:
        """(n,) last command, with the chair's velocity in its own frame: forward, left, turn, arm [m/s, rad/s]."""
        return self._active.velocity

    def reset(self, velocity: ArrayLike | None = None, *, heading: float = 0.0) -> None:
        """Reset the state; a velocity above a limit, or sideways on rolling wheels, raises `ConfigurationError`.

        Parameters
        ----------
        velocity : (n,) current joint velocities [m/s, rad/s], as in a `Command`; zero by default.
        heading : [rad] q3 at the start of that command's tick, which gives the chair's forward direction in the world.
        """
        n = self.robot.chain.n
        given = per_joint("velocity", 0.0 if velocity is None else velocity, n, finite=True)
        turned = np.zeros(n)
        turned[2] = checked_number("heading", heading, above=-1e6, below=1e6)
        chassis = self.robot.chassis_velocity(turned, given)
        wheels = self.robot.drive(self.drive)
        (rims, rim_speeds), still = wheels.rims, wheels.still()
        limits = np.concatenate([self.robot.chain.velocity, [self.robot.chain.velocity[0]]])
        speeds = np.append(np.abs(chassis), np.hypot(*chassis[:2]))
        if not np.all(speeds <= limits * (1 + FASTER)):
            raise ConfigurationError("velocity", velocity, "joint and chassis speeds within their limits")
        if not np.all(np.abs(rims @ chassis[:CHAIR]) <= rim_speeds * (1 + FASTER)):
            raise ConfigurationError("velocity", velocity, "wheel speeds within their limit")
        if not np.all(np.abs(chassis[still]) <= FASTER):
            expected = f"no speed {' or '.join(CHASSIS[i] for i in still)}: a {self.drive} drive has none"
            raise ConfigurationError("velocity", velocity, expected)
        chassis[still] = 0.0
        self._claim()
        for each in self._sets.values():
            each.reset()  # the inactive ones, too, since their solvers have memory
        self._active = next(iter(self._sets.values()))
        self._active.reset(np.clip(chassis, -self.robot.chain.velocity, self.robot.chain.velocity), turned[2])
        self._reaching = None  # its smoother belongs to the thread that calls `reach`
        self._give_away()

    # -------------------------------------------------------------------------------------------------- one tick
    def step(
        self,
        q: ArrayLike,
        twist: ArrayLike,
        rows: tuple[str, ...] = ("x", "y", "z"),
        frame: str = "chassis",
        *,
        moving: Sequence[MovingCapsule] | Array | None = None,
        enable: object = True,
        stamp: float | None = None,
    ) -> Command:
        """Joint velocities (n,) to hold until the next tick, and wheel speeds.

        Invalid numbers give a deceleration within the limits. Wrong shapes, unknown rows or frames, and more rows than
        moving joints raise `ConfigurationError`.

        Parameters
        ----------
        q : (n,) current joint positions [m, rad].
        twist : (k,) commanded hand velocity, one number per row [m/s, rad/s].
        rows : any of x, y, z, rx, ry, rz in `frame`, and roll7 about the tool's z axis; other components are free.
        frame : axes of "chassis", which turn with the chair, or of "world"; both at the hand.
        moving : current moving bodies in the world frame; see `obstacles` of `PoseTracker.step`.
        enable : dead man's switch; anything but True decelerates to rest.
        stamp : [s] time of the state; the watchdog checks it.
        """
        if self._owner != get_ident():
            self._claim()
        if self._reaching is not None:
            self._reaching.forget()
        return self._step(q, twist, rows, frame, moving, enable, stamp)

    def reach(
        self,
        q: ArrayLike,
        target: ArrayLike,
        *,
        moving: Sequence[MovingCapsule] | Array | None = None,
        enable: object = True,
        stamp: float | None = None,
    ) -> Command:
        """Joint velocities (n,) that move the hand to a target, through the same QP; call this in every tick.

        The hand moves straight at up to 0.25 m/s along each world axis, plus 0.12 m/s while it lags. The hand slows
        down so that chair and arm can stop at the target.

        Parameters
        ----------
        q : (n,) current joint positions [m, rad].
        target : (3,) target of the hand in the world frame [m], which may jump; a target more than 100 m away is
            refused.
        moving, enable, stamp : see `step`.
        """
        if self._owner != get_ident():
            self._claim()
        if self._reaching is None:
            self._reaching = Reaching(self.robot, dt=self.dt)
        place, joints = real_numbers("target", target, (3,)), real_numbers("q", q, (self.robot.chain.n,))
        twist = self._reaching.twist(joints, place, last=self._active.velocity, moving=is_true(enable))
        command = self._step(q, twist, ("x", "y", "z"), "world", moving, enable, stamp)
        if not command.status.certified:
            self._reaching.forget()
        if self._reaching.refused and command.reason.startswith("twist["):  # which is then NaN
            command = command._replace(reason=self._reaching.refused)
        return command

    def instance(
        self, q: ArrayLike, twist: ArrayLike, rows: Sequence[str] = ("x", "y", "z"), frame: str = "chassis"
    ) -> Instance:
        """QP that `step` would solve now, as numbers, for inspection by any thread.

        The variables are the joint velocities, with the chair's velocity in its own frame, and the hand's speeds along
        the command and off its direction.
        """
        names, world = checked_rows(rows), frame_number(frame)
        joints = real_numbers("q", q, (self.robot.chain.n,))
        commanded = real_numbers("twist", twist, (len(names),))
        chosen = self._sets.get(names)
        if chosen is None:
            self._refuse_others()
            chosen = self._add_rows(names, compile=False)
        around = np.append(self._numbers, np.zeros(self.limits.moving_size))
        inputs = (joints, commanded, np.array([world]), around)[: 4 if around.size else 3]
        return chosen.instance_after(self._active, *inputs)

    def to_qpsolvers(
        self, q: ArrayLike, twist: ArrayLike, rows: Sequence[str] = ("x", "y", "z"), frame: str = "chassis"
    ) -> qpsolvers.Problem:
        """`instance` as a `qpsolvers.Problem`."""
        from rehab_opt.optim.backends import to_qpsolvers  # noqa: PLC0415  (solvers load when used)

        return to_qpsolvers(self.instance(q, twist, rows, frame))

    # --------------------------------------------------------------------------------------------------- plumbing
    def _step(  # noqa: PLR0917  (in the hot path, keywords cost)
        self,
        q: ArrayLike,
        twist: ArrayLike,
        rows: tuple[str, ...],
        frame: str,
        moving: Sequence[MovingCapsule] | Array | None,
        enable: object,
        stamp: float | None,
    ) -> Command:
        active = self._active
        if type(q) is not np.ndarray:  # a masked array would lose its mask
            q = real_numbers("q", q, (self.robot.chain.n,))
        bodies = None if moving is None and not self.limits.moving else self.limits.capsule_numbers("moving", moving)
        if not isinstance(rows, tuple) or rows != active.rows:
            names = checked_rows(rows)
            other = self._sets.get(names)
            if other is None:
                if active.velocity.any():
                    active.set_inputs(q, np.zeros(len(active.rows)), 0.0, bodies)
                    return active.brake(f"rows {', '.join(names)} are not in row_sets: allowed once at rest")
                other = self._add_rows(names, compile=False)
            if other is not active:
                other.take_over(active)
                self._active = active = other
        if type(twist) is not np.ndarray:
            twist = real_numbers("twist", twist, (len(active.rows),))
        active.set_inputs(q, twist, 0.0 if frame == "chassis" else frame_number(frame), bodies)
        return active.tick(enable, stamp)

    def _add_rows(self, rows: tuple[str, ...], *, compile: Compile) -> ChairAndArm:
        chosen = ChairAndArm(self._kept, rows, compile=compile, **self._options)  # type: ignore[arg-type]
        chosen.set_obstacles(self._numbers)
        self._sets[rows] = chosen
        return chosen
