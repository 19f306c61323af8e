"""Random robots, states, twists, rooms and faults against the resolver, judged by plain numpy and shapely.

    python -m tests.control.redundancy_campaign --cases 100000

One case is one tick of one of several resolvers (robots, drives, tick lengths, rooms), each in a state reached by
random earlier ticks or set anew. Nothing of the controller's arithmetic is used: limits, wheels, rolling, gaps to
obstacles and keep-outs and accelerations are worked out again from the numbers sent. What the hand does of the command
is for `tests.judge`, which follows commands for as long as people hold them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely

from rehab_opt import Command, RedundancyResolver, Relaxed, ardis
from rehab_opt.control.obstacles import Disc, HalfPlane, Obstacle
from rehab_opt.kinematics.mobile_arm import Capsule, MobileArm
from rehab_opt.symbolic import Compile
from tests.control.campaign import HOSTILE, ROUNDING, Array, Tally, main, must_exceed

TICKS = (1e-3, 2e-3, 5e-3, 1e-2, 2e-2)
SETS = (("x", "y", "z"), ("x", "y"), ("z", "roll7"), ("x", "y", "z", "rz"), ("rx", "y"), ("x", "y", "z", "rx", "ry"))


STILL = {"mecanum": (), "differential": (1,), "omnidirectional": (), "fixed": (0, 1, 2)}
"""Of a chassis' speeds forward, to the left and turning, those that a drive does not have."""
Links = Callable[[MobileArm, Array], list[tuple[Array, Array, float]]]
"""Robot and joint values -> its links in the chassis frame: both ends (3,) and the radius [m]."""


def ardis_links(robot: MobileArm, q: Array) -> list[tuple[Array, Array, float]]:
    """Upper arm and forearm."""
    posture = np.array([0, 0, 0, *q[3:]])
    shoulder = robot.chain.base[:3, 3] + [robot.chain.rows[2].a, -robot.chain.rows[3].d, 0]
    hand = robot.chain.pose(posture)
    elbow = hand[:3, 3] - robot.chain.rows[6].d * hand[:3, 2]
    return [(shoulder, elbow, robot.arm_radius), (elbow, hand[:3, 3], robot.arm_radius)]


@dataclass
class Plant:
    """What an honest integrator knows about one resolver: where it is and what it was told."""

    name: str
    resolver: RedundancyResolver
    sets: tuple[tuple[str, ...], ...]
    q: Array
    last: Array
    """Last command with the chair's share in the chassis frame."""
    rows: tuple[str, ...]
    recovery_speed: float
    stamp: float = 0.0
    fresh: bool = True
    unseen: bool = True
    """No position was read since the state last jumped."""
    jumped: bool = True
    """The velocity was set from outside and may not be one that can stop in time; until the robot is at rest."""
    intended: Array | None = None
    links: Links = ardis_links


def run(cases: int, seed: int, *, plants: int = 24, compile: Compile = False) -> Tally:
    """Judge `cases` ticks."""
    rng = np.random.default_rng(seed)
    return judged(cases, [_plant(i, rng, compile) for i in range(plants)], rng)


def judged(cases: int, everyone: list[Plant], rng: np.random.Generator) -> Tally:
    """Judge `cases` ticks of these plants."""
    tally = Tally()
    for _ in range(cases):
        plant = everyone[rng.integers(len(everyone))]
        if rng.random() < 0.03:
            teleport(plant, rng)
        _one_tick(plant, rng, tally)
    return tally


def _plant(i: int, rng: np.random.Generator, compile: Compile) -> Plant:
    drive = ("mecanum", "differential")[i % 2]
    dt = TICKS[(i // 2) % len(TICKS)]
    slow, hurry = rng.choice([0.2, 1.0, 2.0], 2)
    robot = ardis(
        a3=rng.uniform(-0.1, 0.2),
        d4=rng.uniform(0.3, 0.45),
        d5=rng.uniform(0.3, 0.5),
        d7=rng.uniform(0.3, 0.6),
        chair_mass=rng.uniform(40, 200),
        payload=rng.choice([0.0, 2.0]),
        velocity=slow * np.array([0.8, 0.8, 1.0, 1.0, 1.0, 1.2, 1.5]),
        acceleration=math.inf if rng.random() < 0.1 else hurry * np.array([1.0, 1.0, 1.5, 4.0, 4.0, 4.0, 6.0]),
    )
    room: list[Obstacle] = []
    if rng.random() < 0.7:
        room = [HalfPlane((1, 0.1), 2.5), HalfPlane((-1, 0), 2.0), Disc((0.5, 1.5), 0.3), Disc((1.0, -1.4), 0.1)]
    sets = tuple(SETS[k] for k in rng.permutation(len(SETS))[:2])
    keep_out, motion = bool(rng.random() < 0.7), float(rng.choice([0.0, 1.0, 5.0]))
    recovery_speed = float(rng.choice([0.05, 0.3]))
    resolver = RedundancyResolver(
        robot, drive=drive, row_sets=sets, dt=dt, obstacles=room, keep_out=keep_out,
        self_motion=motion, recovery_speed=recovery_speed, compile=compile,
        solver=str(rng.choice(["qrqp", "qrqp", "qrqp", "qrqp", "proxqp"])),
    )  # fmt: skip
    plant = Plant(f"{drive} dt={dt:g}", resolver, sets, np.zeros(7), np.zeros(7), sets[0], recovery_speed)
    teleport(plant, rng)
    return plant


def teleport(plant: Plant, rng: np.random.Generator) -> None:
    """Another state: inside, at a limit, singular or outside; near a wall or in a post; at rest or at speed."""
    chain, resolver = plant.resolver.robot.chain, plant.resolver
    lower, upper = (np.clip(each[3:], -7.0, 7.0) for each in (chain.lower, chain.upper))  # some joints have no ends
    arm, kind = rng.uniform(lower, upper), rng.integers(5)
    if kind == 1:
        arm = np.where(rng.random(arm.size) < 0.5, lower, upper)
    elif kind == 2 and arm.size == 4:
        arm = np.array([-np.pi / 2, 0.0, np.pi / 2, 0.0])  # stretched: singular, and beyond the elbow's limit
    elif kind == 3:
        arm = arm + rng.choice([1e-12, 1e-6, 1e-2, 1.0]) * rng.standard_normal(arm.size)
    chair = np.array([*rng.uniform(-1.5, 2.0, 2), rng.uniform(-7, 7)])
    plant.q = np.concatenate([chair, arm])
    wanted = rng.uniform(-1, 1, chain.n) * chain.velocity * rng.choice([0.0, 0.1, 0.55])
    wanted[list(STILL[resolver.drive])] = 0.0
    wanted[:3] /= max(
        1.0, float(np.max(np.abs(wheel_speeds(resolver, wanted)), initial=0.0)) / (0.999 * limit_of(resolver))
    )
    resolver.reset(resolver.robot.world_velocity(plant.q, wanted), heading=plant.q[2])
    plant.last = wanted
    plant.fresh = plant.unseen = True
    plant.jumped = bool(np.any(wanted))


def wheel_speeds(resolver: RedundancyResolver, u: Array) -> Array:
    """Wheel speeds that joint velocities take, the chair's in its own frame; its twist where no wheels are known."""
    if resolver.drive == "fixed":
        return np.zeros(0)
    return u[:3] if resolver.drive == "omnidirectional" else getattr(resolver.robot, resolver.drive).rolling @ u[:3]


def limit_of(resolver: RedundancyResolver) -> float:
    """[rad/s] largest wheel speed."""
    return math.inf if resolver.drive in ("omnidirectional", "fixed") else getattr(resolver.robot, resolver.drive).limit


def _one_tick(plant: Plant, rng: np.random.Generator, tally: Tally) -> None:
    resolver = plant.resolver
    if rng.random() < 0.05:
        plant.rows = plant.sets[rng.integers(len(plant.sets))]
        plant.intended = None
    if plant.intended is None or rng.random() < 0.05:
        size = rng.choice([0.0, 0.0, 1e-6, 0.05, 0.3, 1.0, 100.0])
        plant.intended = size * rng.standard_normal(len(plant.rows))
    twist, frame = plant.intended.copy(), str(rng.choice(["chassis", "world"]))
    q, enable, fault = plant.q.copy(), True, "none"
    previous, plant.stamp = plant.stamp, plant.stamp + resolver.dt
    stamp: float | None = plant.stamp
    if rng.random() < 0.1:
        fault = str(rng.choice(["q", "twist", "stamp", "repeated", "disabled", "no stamp"]))
        bad = float(rng.choice(HOSTILE))
        if fault == "q":
            q[rng.integers(q.size)] = bad
        elif fault == "twist":
            twist[rng.integers(twist.size)] = bad
        elif fault == "stamp":
            stamp = bad
        elif fault == "repeated" and not plant.fresh:
            stamp = previous
        elif fault == "disabled":
            enable = False
        else:
            fault, stamp = "no stamp", None
    tally.faults[fault] += 1
    command = resolver.step(q, twist, plant.rows, frame, enable=enable, stamp=stamp)
    valid = bool(np.all(np.abs(q) <= 1e6))
    plant.unseen &= not valid
    plant.fresh = stamp != plant.stamp
    seen = q if valid else plant.q
    _judge(plant, seen, command, valid, fault, twist, frame, tally)
    plant.last = resolver.chassis_velocity if plant.unseen else resolver.robot.chassis_velocity(seen, command.value)
    plant.jumped &= plant.unseen or bool(np.any(plant.last))
    plant.q = plant.q + command.value * resolver.dt
    if not valid and np.any(np.abs(plant.q - q)[np.isfinite(q)] > 1e3):
        plant.jumped = True


def _judge(
    plant: Plant, q: Array, command: Command, valid: bool, fault: str, twist: Array, frame: str, tally: Tally
) -> None:
    """The order of bounds, written down once more."""
    resolver, robot = plant.resolver, plant.resolver.robot
    chain, dt, v = robot.chain, plant.resolver.dt, command.value
    tally.count(command)

    def check(holds: bool, claim: str) -> None:
        if not holds:
            where = f"{plant.name}, fault {fault}, {plant.rows} {frame} {twist}, {command}, q {q}, last {plant.last}"
            tally.broken.append(f"{claim}: {where}")

    check(v.shape == (chain.n,) and bool(np.all(np.isfinite(v))) and not v.flags.writeable, "finite and frozen")
    if command.status.certified:
        check(0.0 <= command.residual <= 1e-8 and 0.0 <= command.scale <= 1.0, "certified")
    else:
        check(command.reason != "", "reason given")
    if plant.unseen:
        return  # where the chair heads is not known, nor which way it was last sent
    u = robot.chassis_velocity(q, v)
    check(bool(np.all(np.abs(u[2:]) <= chain.velocity[2:] + 1e-12)), "joint speeds never yield")
    check(tally.worst("chassis speed", math.hypot(u[0], u[1]) - chain.velocity[0]) <= 1e-9, "chassis speed")
    wheels = wheel_speeds(resolver, u)
    assert command.wheels is not None
    same = wheels.shape == command.wheels.shape and np.allclose(command.wheels, wheels, atol=1e-9)
    check(bool(same), "wheels belong to the value")
    over = tally.worst("wheel speed", float(np.max(np.abs(wheels), initial=0.0)) - limit_of(resolver))
    check(over <= 1e-9, "wheel speeds never yield")
    if STILL[resolver.drive]:
        slip = float(np.max(np.abs(u[list(STILL[resolver.drive])])))
        check(tally.worst("motion that the drive has not", slip) <= 1e-9, "rolling")

    ahead = q + v * dt
    outside = (q > chain.upper + ROUNDING) | (q < chain.lower - ROUNDING)
    further = float(np.maximum(ahead - np.maximum(q, chain.upper), np.minimum(q, chain.lower) - ahead).max())
    check(tally.worst("position", further) <= ROUNDING, "never further outside")
    back = plant.recovery_speed * chain.velocity
    check(bool(np.all(np.abs(v[outside]) <= back[outside] + 1e-12)), "slow way back")

    now_arm = _judge_surroundings(plant, q, ahead, tally, check)
    allowed = np.minimum(chain.acceleration * dt, 2 * chain.velocity)
    change = np.abs(u - plant.last) - allowed
    hurried = bool(np.max(change) > 1e-9)
    tally.worst(
        "acceleration, unflagged", -math.inf if command.relaxed & Relaxed.ACCELERATION else float(np.max(change))
    )
    if hurried:
        check(bool(command.relaxed & Relaxed.ACCELERATION), "acceleration yields flagged")
        _judge_hurry(plant, q, change, allowed, now_arm, tally, check)
    # No harder than that the stop posture moves by 0.2 rad or m in a tick, or by a tick of the fastest: `FARTHEST`.
    stops = 1.1 * max(dt, float(np.max((chain.velocity / chain.acceleration)[3 * (plant.resolver.drive == "fixed") :])))
    hardest = np.minimum(allowed, np.maximum(0.2, 1.1 * chain.velocity * dt) / stops)
    slowing = np.max(np.abs(u) / hardest) <= max(np.max(np.abs(plant.last) / hardest) - 1.0, 0.0) + 1e-9
    if fault in ("q", "twist", "stamp", "repeated", "disabled"):
        if not (fault in ("q", "twist", "stamp") and command.status.certified):  # hostile, but a small number
            check(not command.status.certified, "a fault gives the safe command")
            check(bool(slowing), "the safe command decelerates")
    elif command.status.certified and not twist.any():
        check(bool(slowing), "no command decelerates")


def _judge_hurry(plant: Plant, q: Array, change: Array, allowed: Array, now_arm: Array, tally: Tally, check) -> None:  # type: ignore[no-untyped-def]
    """Accelerations yield to a bound above them only, and never after a start from which the chair could stop."""
    resolver = plant.resolver
    chain = resolver.robot.chain
    needed = must_exceed(chain, q, plant.last, resolver.dt, plant.recovery_speed * chain.velocity)
    arm, chair, now = change[3:] > 1e-9, change[:3] > 1e-9, gaps(resolver, q)
    check(bool(np.all(~arm | needed[3:])) or now_arm.size > 0, "joints hurry only where they must")
    check(not np.any(chair) or bool(resolver.obstacles), "the chair hurries only before obstacles")
    if not plant.jumped:
        if now_arm.size == 0 or now_arm.min() > 0:
            tally.seen["arm hurried"] += bool(np.any(arm & ~needed[3:]))
        if now.size and now.min() > 0:
            tally.seen["chair hurried"] += bool(np.any(chair))
            tally.worst("chair's hurry, share", float(np.max(change[:3] / allowed[:3])))


def _judge_surroundings(plant: Plant, q: Array, ahead: Array, tally: Tally, check) -> Array:  # type: ignore[no-untyped-def]
    resolver = plant.resolver
    now, then = gaps(resolver, q), gaps(resolver, ahead)
    if now.size:
        deeper = float(np.max(np.minimum(now, 0.0) - then))
        check(tally.worst("into obstacles", deeper) <= ROUNDING, "never further into an obstacle")
    now_arm, then_arm = arm_gaps(resolver.robot, q, plant.links), arm_gaps(resolver.robot, ahead, plant.links)
    if now_arm.size:
        deeper = float(np.max(np.minimum(now_arm, 0.0) - then_arm))
        check(tally.worst("into keep-outs", deeper) <= ROUNDING, "never further into a keep-out")
    return now_arm


def hand_twist(robot: MobileArm, q: Array, v: Array, rows: tuple[str, ...], frame: str) -> Array:
    """What the hand does in the given rows."""
    twist = robot.chain.jacobian(q) @ v
    roll = robot.chain.pose(q)[:3, 2] @ twist[3:]
    if frame == "chassis":
        cos, sin = math.cos(q[2]), math.sin(q[2])
        turn = np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
        twist = np.concatenate([turn @ twist[:3], turn @ twist[3:]])
    every = dict(zip(("x", "y", "z", "rx", "ry", "rz", "roll7"), [*twist, roll], strict=True))
    return np.array([every[row] for row in rows])


def gaps(resolver: RedundancyResolver, q: Array) -> Array:
    """Distance of the chair's outline from each obstacle, negative inside; none for a post under the chair's middle."""
    cos, sin = math.cos(q[2]), math.sin(q[2])
    corners = resolver.robot.outline.corners[[0, 1, 3, 2]] @ np.array([[cos, sin], [-sin, cos]]) + q[:2]
    chair, result = shapely.Polygon(corners), []
    for obstacle in resolver.obstacles:
        if isinstance(obstacle, HalfPlane):
            normal = np.asarray(obstacle.normal)
            result.append((obstacle.offset - np.max(corners @ normal)) / np.linalg.norm(normal))
        else:
            distance = chair.distance(shapely.Point(obstacle.centre))
            result.append(distance - obstacle.radius if distance > 1e-6 else math.nan)
    return np.array([each for each in result if not math.isnan(each)]) if _all_outside(result) else np.zeros(0)


def _all_outside(result: list[float]) -> bool:
    return not any(math.isnan(each) for each in result)


def arm_gaps(robot: MobileArm, q: Array, links: Links = ardis_links) -> Array:
    """Distance of each link from each keep-out."""
    return np.array(
        [
            segment_distance(begin, end, capsule) - capsule.radius - radius
            for capsule in robot.keep_out
            for begin, end, radius in links(robot, q)
        ]
    )


def segment_distance(begin: Array, end: Array, capsule: Capsule) -> float:
    """Between two segments: where the lines are nearest if that is on both, else from an end of one."""
    start, stop = np.asarray(capsule.start), np.asarray(capsule.end)
    one, two = end - begin, stop - start
    candidates = [_from_point(p, start, two) for p in (begin, end)] + [
        _from_point(p, begin, one) for p in (start, stop)
    ]
    system = np.stack([one, -two], axis=1)
    fraction, *_ = np.linalg.lstsq(system, start - begin, rcond=None)
    if np.all((fraction >= 0) & (fraction <= 1)):
        candidates.append(float(np.linalg.norm(begin + fraction[0] * one - start - fraction[1] * two)))
    return min(candidates)


def _from_point(point: Array, start: Array, along: Array) -> float:
    fraction = np.clip((point - start) @ along / (along @ along), 0, 1)
    return float(np.linalg.norm(point - start - fraction * along))


if __name__ == "__main__":
    main(run, __doc__)
