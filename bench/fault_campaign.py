"""Random states, targets and faults against the tracker, judged by plain numpy that shares nothing with the controller.

    python -m bench.fault_campaign --cases 100000

One case is one tick of one of several controllers (chains, tick lengths, solvers), each in a state reached by random
earlier ticks. Prints what was checked, the largest excess over each bound and how often each rung answered.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rehab_opt import DH, Command, PoseTracker, Relaxed, SerialChain, Status, human_arm, ur5
from rehab_opt.symbolic import Compile
from tests.kinematics.robot_files.known_arms import gen3
from tests.kinematics.robot_files.random_arms import urdf

Array = NDArray[np.float64]
HOSTILE = (math.nan, math.inf, -math.inf, 1e300, -1e300, 1e7, 1e-320)
ROUNDING = 1e-9
"""[rad or m] What arithmetic on numbers of this size may miss a bound by."""


@dataclass
class Tally:
    """What was seen: ticks, their answers, the faults that were made, the worst of each number, and broken claims."""

    cases: int = 0
    statuses: Counter[Status] = field(default_factory=Counter)
    solvers: Counter[str] = field(default_factory=Counter)
    relaxed: Counter[Relaxed] = field(default_factory=Counter)
    faults: Counter[str] = field(default_factory=Counter)
    seen: Counter[str] = field(default_factory=Counter)
    largest: dict[str, float] = field(default_factory=dict)
    broken: list[str] = field(default_factory=list)

    def count(self, command: Command) -> None:
        """One more tick, and who answered."""
        self.cases += 1
        self.statuses[command.status] += 1
        self.solvers[command.solver] += 1
        self.relaxed[command.relaxed] += 1

    def worst(self, name: str, value: float) -> float:
        """`value`, kept where it is the largest of this name; one that is no number stays the largest."""
        known = self.largest.get(name, -math.inf)
        self.largest[name] = known if value <= known or math.isnan(known) else value
        return value

    def show(self) -> None:
        """Print it all, with the first broken claims."""
        print(f"{self.cases} ticks; faults {dict(self.faults)}")
        print("answers", {status.value: count for status, count in self.statuses.items()}, dict(self.solvers))
        print("relaxed", {str(bound): count for bound, count in self.relaxed.items()}, dict(self.seen))
        print("largest", {name: f"{value:.3g}" for name, value in self.largest.items()})
        print(f"broken claims: {len(self.broken)}", dict(Counter(line.partition(":")[0] for line in self.broken)))
        for line in self.broken[:10]:
            print(" ", line)


def must_exceed(chain: SerialChain, q: Array, last: Array, dt: float, back: Array) -> NDArray[np.bool_]:
    """Joints that, with the largest change, would be beyond a limit, further beyond, or back faster than `back`."""
    gentlest_up, gentlest_down = last - chain.acceleration * dt, last + chain.acceleration * dt
    above, below = q > chain.upper, q < chain.lower
    return (
        (q + gentlest_up * dt > np.maximum(chain.upper, q))
        | (q + gentlest_down * dt < np.minimum(chain.lower, q))
        | (above & (gentlest_down < -back))
        | (below & (gentlest_up > back))
    )


TICKS = (1e-4, 1e-3, 4e-3, 2e-2, 1e-1)


def slide_arm() -> SerialChain:
    """A prismatic base with a short arm, one joint locked, one of +-3 degrees, one without limits."""
    rows = [DH(0, -math.pi / 2, prismatic=True), DH(0.3, 0.0), DH(0.25, math.pi / 2), DH(0.2, 0.0), DH(0.05, 1.0, 0.1)]
    narrow = math.radians(3)
    return SerialChain(
        rows,
        lower=[-0.4, -2.0, 0.3, -narrow, -math.inf],
        upper=[0.4, 2.0, 0.3, narrow, math.inf],
        velocity=[0.5, 2.0, 1.0, 1.5, 4.0],
        acceleration=[2.0, 20.0, 5.0, 8.0, math.inf],
    )


def imported_arm() -> SerialChain:
    """Kinova's Gen3 from a file: rounded right angles, four joints without ends."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "gen3.urdf"
        file.write_text(urdf(gen3()))
        return SerialChain.from_urdf(file, acceleration=5.0)


CHAINS = {
    "ur5": ur5,
    "ur5_slow": lambda: ur5(velocity=0.2, acceleration=1.0),
    "arm": lambda: human_arm(range_of_motion="regular"),
    "restricted": lambda: human_arm(range_of_motion="restricted", side="right"),
    "slide": slide_arm,
    "imported": imported_arm,
}


@dataclass
class Plant:
    """What an honest integrator knows about one controller: where it is and what it was told."""

    name: str
    tracker: PoseTracker
    q: Array
    last: Array
    stamp: float = 0.0
    fresh: bool = True
    """No stamp of this stream was accepted by the last tick."""
    unseen: bool = True
    """No position was read since the state last jumped."""


def run(
    cases: int, seed: int, *, compile: Compile = None, chains: Mapping[str, Callable[[], SerialChain]] = CHAINS
) -> Tally:
    """Judge `cases` ticks of these arms."""
    rng = np.random.default_rng(seed)
    tally = Tally()
    plants = [_plant(name, make(), dt, compile) for name, make in chains.items() for dt in TICKS]
    plants += [_plant("ur5", ur5(), 1e-3, compile, solver=solver) for solver in ("proxqp", "osqp", "daqp")]
    for _ in range(cases):
        plant = plants[rng.integers(len(plants))]
        if rng.random() < 0.03:
            _teleport(plant, rng)
        _one_tick(plant, rng, tally)
    return tally


def _plant(name: str, chain: SerialChain, dt: float, compile: Compile, solver: str = "qrqp") -> Plant:
    tracker = PoseTracker(chain, dt=dt, solver=solver, compile=compile)
    return Plant(f"{name} {solver} dt={dt:g}", tracker, _middle(chain), np.zeros(chain.n))


def _middle(chain: SerialChain) -> Array:
    return (np.clip(chain.lower, -3, 3) + np.clip(chain.upper, -3, 3)) / 2


def _teleport(plant: Plant, rng: np.random.Generator) -> None:
    """Another state: inside, at a limit, singular, or outside; at rest or at speed."""
    chain = plant.tracker.chain
    lower, upper = np.clip(chain.lower, -3, 3), np.clip(chain.upper, -3, 3)
    kind = rng.integers(5)
    q = rng.uniform(lower, upper)
    if kind == 1:
        q = np.where(rng.random(chain.n) < 0.5, lower, upper)
    elif kind == 2:
        q = np.zeros(chain.n)  # singular for the UR5
    elif kind == 3:
        q = q + rng.choice([1e-12, 1e-6, 1e-2, 1.0]) * rng.standard_normal(chain.n)
    elif kind == 4:
        q = np.where(rng.random(chain.n) < 0.5, lower, upper) + 1e-3 * rng.standard_normal(chain.n)
    plant.q = q
    plant.last = rng.uniform(-1, 1, chain.n) * chain.velocity * rng.choice([0.0, 0.1, 1.0])
    plant.tracker.reset(plant.last)
    plant.fresh = plant.unseen = True


def _one_tick(plant: Plant, rng: np.random.Generator, tally: Tally) -> None:
    tracker, chain = plant.tracker, plant.tracker.chain
    pose, twist = _target(plant, rng)
    q, enable, fault = plant.q.copy(), True, "none"
    previous, plant.stamp = plant.stamp, plant.stamp + tracker.dt
    stamp: float | None = plant.stamp
    if rng.random() < 0.25:
        fault = str(rng.choice(["q", "pose", "twist", "stamp", "repeated", "disabled", "mirrored", "far", "no stamp"]))
        bad = float(rng.choice(HOSTILE))
        if fault == "q":
            q[rng.integers(chain.n)] = bad
        elif fault == "pose":
            pose[rng.integers(4), rng.integers(4)] = bad
        elif fault == "twist":
            twist[rng.integers(6)] = bad
        elif fault == "stamp":
            stamp = bad
        elif fault == "repeated" and not plant.fresh:
            stamp = previous
        elif fault == "disabled":
            enable = False
        elif fault == "mirrored":
            pose[:3, :3] = -pose[:3, :3]
        elif fault == "far":
            pose[:3, 3] = 1e5 * rng.standard_normal(3)
        else:
            fault, stamp = "no stamp", None
    tally.faults[fault] += 1
    command = tracker.step(q, pose, twist, enable=enable, stamp=stamp)
    valid = bool(np.all(np.abs(q) <= 1e6))
    plant.unseen &= not valid
    plant.fresh = stamp != plant.stamp
    _judge(plant, q if valid else plant.q, command, valid, fault, tally)
    plant.last = command.value.copy()
    plant.q = plant.q + command.value * tracker.dt


def _target(plant: Plant, rng: np.random.Generator) -> tuple[Array, Array]:
    chain = plant.tracker.chain
    near = plant.q + rng.choice([0.0, 1e-3, 0.1, 1.0]) * rng.standard_normal(chain.n)
    twist = rng.standard_normal(6) * rng.choice([0.0, 0.05, 1.0, 100.0])
    return chain.pose(near), twist


def _judge(  # noqa: PLR0917
    plant: Plant, q: Array, command: Command, valid: bool, fault: str, tally: Tally
) -> None:
    """The order of bounds, written down once more without the controller's arithmetic."""
    chain, dt = plant.tracker.chain, plant.tracker.dt
    v, last = command.value, plant.last
    tally.count(command)
    where = f"{plant.name}, fault {fault}, {command}, q {q}, last {last}"

    def check(holds: bool, claim: str) -> None:
        if not holds:
            tally.broken.append(f"{claim}: {where}")

    check(v.shape == (chain.n,) and bool(np.all(np.isfinite(v))), "finite")
    check(not v.flags.writeable, "frozen")
    check(tally.worst("velocity", float(np.max(np.abs(v) - chain.velocity))) <= 0.0, "velocity never yields")
    ahead = q + v * dt
    outside = (q > chain.upper + ROUNDING) | (q < chain.lower - ROUNDING)
    further = np.maximum(ahead - np.maximum(q, chain.upper), np.minimum(q, chain.lower) - ahead).max()
    check(plant.unseen or tally.worst("position", float(further)) <= ROUNDING, "never further outside")
    back = plant.tracker.recovery_speed * chain.velocity
    check(plant.unseen or bool(np.all(np.abs(v[outside]) <= back[outside] + 1e-12)), "slow way back")
    change = np.abs(v - last) - chain.acceleration * dt
    if command.relaxed & Relaxed.ACCELERATION:
        # It may only yield to a bound above it: with the largest change, a joint would be further outside.
        needed = must_exceed(chain, q, last, dt, back)
        check(plant.unseen or bool(np.all((change <= 1e-9) | needed)), "acceleration yields only where it must")
    else:
        check(tally.worst("acceleration", float(np.max(change))) <= 1e-9, "acceleration")
    if valid:
        check(bool(command.relaxed & Relaxed.POSITION) == bool(outside.any()), "outside is flagged")
    if command.status.certified:
        check(0.0 <= command.residual <= plant.tracker.tolerance, "certified")
        check(0.0 <= command.scale <= 1.0, "scale")
    else:
        check(command.reason != "", "reason given")
    if fault in ("q", "pose", "twist", "stamp", "repeated", "disabled", "mirrored"):
        hostile_but_small = fault in ("q", "pose", "twist", "stamp") and command.status.certified
        if not hostile_but_small:
            check(not command.status.certified, "a fault gives the safe command")
            whole = np.sign(last) * np.maximum(np.abs(last) - chain.acceleration * dt, 0.0)
            # Where the hand would be too fast so, joints may wait for the one that rests last.
            may = last if hand_over(plant, q, whole) > 1.0 - 1e-6 else whole
            slowest = int(np.argmax(np.abs(last) / chain.acceleration))
            may = np.where(np.arange(chain.n) == slowest, whole, may)
            check(bool(np.all(np.abs(v) <= np.abs(may) + 1e-9)), "the safe command decelerates")
            check(bool(np.all(v * last >= 0.0)), "the safe command turns no joint round")
            fast = tally.worst("hand", hand_over(plant, q, v, margin=0.0) / max(1.0, hand_over(plant, q, last)))
            check(plant.unseen or fast <= 1.0 + 1e-5, "the safe command has the hand no faster than its bounds")


def hand_over(plant: Plant, q: Array, v: Array, *, margin: float = 1.0) -> float:
    """Hand speeds over their bounds, with a `margin` for how the way bends in a tick."""
    tracker, chain = plant.tracker, plant.tracker.chain
    ends = [chain.jacobian(q + part * tracker.dt * v) @ v for part in (0.0, 1.0)]
    length = sum(row.across + abs(row.along) for row in chain.rows) + float(np.linalg.norm(chain.tool[:3, 3]))
    bend = margin * tracker.dt**2 * length * float(np.abs(v).sum()) ** 3
    linear = max(float(np.linalg.norm(each[:3])) for each in ends) + bend
    return max(linear / tracker.linear_speed, float(np.linalg.norm(ends[0][3:])) / tracker.angular_speed)


def main() -> None:
    """Run, print, and exit with 1 where a claim broke."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    tally = run(options.cases, options.seed)
    tally.show()
    raise SystemExit(bool(tally.broken))


if __name__ == "__main__":
    main()
