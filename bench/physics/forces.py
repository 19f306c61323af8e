"""Energy of a late force on a hand, and whether help comes to rest."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from bench.physics.setting import Cell, Numbers, Setting
from rehab_opt import Assistance, BoundedForce, PotentialField, Workspace
from rehab_opt.plants.arm_model import point_mass_model
from rehab_opt.plants.channel import Channel
from rehab_opt.plants.drives import HandForce
from rehab_opt.plants.mujoco_arm import MujocoArm

__all__ = ["Push", "SpringDamper", "delivered", "needed", "reached"]

Array = NDArray[np.float64]

LAG = 0.003
"""[s] of the acting force, besides the cell's delay; none where that is zero."""
SECONDS = 12.0
NONE = np.zeros(2)
BUDGET, CAP = 20.0, 1.0
"""[J], [m/s] `BoundedForce`'s defaults."""
WAY, ARRIVED = 0.2, 0.015
"""[m] of a reach, and from its target where it counts as arrived."""
UNAIDED, PATIENCE, STAYS = 4.0, 8.0, 1.0
"""[s] in which who needs no help arrives, who is helped may, and for which the hand stays there."""
START = np.array([-0.17, 0.50])
PATH = START + np.outer(np.linspace(0, 1, 50), [WAY, 0.0])


class SpringDamper:
    """A person who holds the hand: a spring to `anchor`, which may be moved, and a damper.

    Parameters
    ----------
    anchor : (k,) [m]. stiffness : [N/m]. damping : [N s/m]. strength : [N] the largest force of the spring.
    """

    def __init__(
        self, anchor: ArrayLike, *, stiffness: float = 300.0, damping: float = 20.0, strength: float = math.inf
    ) -> None:
        self.anchor: Array = np.array(anchor, dtype=np.float64)
        self._stiffness, self._damping, self._strength = stiffness, damping, strength

    def force(self, time: float, position: Array, velocity: Array) -> Array:
        """Towards the anchor, against the motion."""
        pull = self._stiffness * (self.anchor - position)
        size = float(np.linalg.norm(pull))
        if size > self._strength:
            pull = pull * (self._strength / size)
        given: Array = pull - self._damping * velocity
        return given


class Push:
    """A force that is given over time, whatever the hand does.

    Parameters
    ----------
    of : time [s] -> (k,) [N].
    """

    def __init__(self, of: Callable[[float], ArrayLike]) -> None:
        self._of = of

    def force(self, time: float, position: Array, velocity: Array) -> Array:
        """What is given now."""
        return np.asarray(self._of(time), dtype=np.float64)


def delivered(setting: Setting) -> Numbers:
    """A stiff, little damped field, late, on a person who moves as they like: the most work that it did."""
    rng = setting.rng
    stiffness, damping = rng.uniform(100, 1000), rng.uniform(0, 20)
    controller = BoundedForce(
        lambda x, y, vx, vy: (-stiffness * x - damping * vx, -stiffness * y - damping * vy),
        dt=setting.dt,
        trust_stillness=True,
        **setting.told(BoundedForce),
    )
    work, speed = _moved(setting, controller, 0.05 * rng.normal(size=2))
    slow = float(speed.max()) <= CAP
    return {"work": float(work.max()), "work below the cap": float(work.max()) if slow else -math.inf}


def reached(setting: Setting) -> Numbers:
    """A reach of 0.2 m with a field like the README's and `Assistance`'s default bounds."""
    rng = setting.rng
    work, speed, place = _reach(setting, _help(setting), START + 0.005 * rng.normal(size=2))
    near = np.linalg.norm(place - PATH[-1], axis=1) <= ARRIVED
    arrival = int(near.argmax()) if near.any() else len(near)
    rest = speed[arrival + round(1.0 / setting.dt) :]
    return {
        # Who never arrives is not at rest.
        "help: speed at rest": float(np.sqrt(np.mean(rest**2))) if rest.size else math.inf,
        "help: work of a reach": float(work.max()),
    }


def needed(setting: Setting) -> Numbers:
    """Whether people arrive who pull towards the target as they can, their arms back to where they rest.

    Without help, with help that is not late, and with help that is.
    """
    rng = setting.rng
    strength, back, damping, seed = rng.uniform(0.2, 3.0), rng.uniform(10, 40), rng.uniform(4, 15), rng.integers(2**31)
    start = START + 0.005 * rng.normal(size=2)
    at_once = setting.cell._replace(delay=0.0)

    def arrived(cell: Cell, helped: bool, seconds: float, mistold: float = 0.0) -> float:
        here = replace(setting, cell=cell, mistold=mistold, rng=np.random.default_rng(seed))
        will = SpringDamper([*PATH[-1], 0.0], stiffness=300.0, damping=damping, strength=strength)
        arm = SpringDamper([*start, 0.0], stiffness=back, damping=0.0)
        mass = _mass(here, (will, arm, _tremor(here)))
        place = _run(here, mass, _help(here) if helped else None, start, seconds)[2]
        near = np.linalg.norm(place - PATH[-1], axis=1) <= ARRIVED
        long = round(STAYS / here.dt)
        inside = np.cumsum(np.r_[0, near])
        return float((inside[long:] - inside[:-long] == long).any())

    return {
        "unaided": arrived(at_once, helped=False, seconds=UNAIDED),
        "helped at once": arrived(at_once, helped=True, seconds=PATIENCE),
        "helped": arrived(setting.cell, helped=True, seconds=PATIENCE, mistold=setting.mistold),
    }


def _help(setting: Setting) -> Assistance:
    """A field like the README's, outside a workspace that the hand starts beside."""
    field = setting.kept.get("field")
    if field is None:
        field = setting.kept["field"] = PotentialField(PATH, stiffness=1000.0, drag=200.0, width=0.025)
    comfortable = Workspace(shapely.box(-0.30, 0.45, -0.20, 0.55), accuracy=1e-3)
    return Assistance(
        field, comfortable=comfortable, mode="assist", dt=setting.dt, trust_stillness=True, **setting.told(Assistance)
    )


def _moved(setting: Setting, controller: BoundedForce, start: Array) -> tuple[Array, Array]:
    rng = setting.rng
    person = SpringDamper([0.0, 0.0, 0.0], stiffness=rng.uniform(0, 200), damping=rng.uniform(3, 20), strength=25.0)
    waves = rng.uniform(0.3, 4.0, (2, 3)), rng.uniform(0, 2 * math.pi, (2, 3)), rng.uniform(0, 3.0, (2, 3))

    def will(time: float) -> Array:
        hertz, phase, size = waves
        x, y = (size * np.sin(2 * math.pi * hertz * time + phase)).sum(axis=1).tolist()
        return np.array([x, y, 0.0])

    plant = _mass(setting, (person, Push(will)))
    return _run(setting, plant, controller, start)[:2]


def _reach(setting: Setting, controller: Assistance, start: Array) -> tuple[Array, Array, Array]:
    """A person who does nothing: a damped hand, and a little tremor."""
    tremor = _tremor(setting)
    arm = SpringDamper([0.0, 0.0, 0.0], stiffness=0.0, damping=setting.rng.uniform(4.0, 15.0))
    return _run(setting, _mass(setting, (arm, tremor)), controller, start)


def _tremor(setting: Setting) -> Push:
    rng = setting.rng
    hertz, phase = rng.uniform(4, 8), rng.uniform(0, 2 * math.pi, 2)

    def tremor(time: float) -> Array:
        x, y = (0.3 * np.sin(2 * math.pi * hertz * time + phase)).tolist()
        return np.array([x, y, 0.0])

    return Push(tremor)


def _mass(setting: Setting, contacts: tuple[SpringDamper | Push, ...]) -> MujocoArm:
    half = setting.cell.delay / 2
    channel = Channel(command_delay=half, measurement_delay=half, position_noise=0.1 * setting.cell.noise)
    mass = setting.rng.uniform(1.5, 4.0)
    lag = LAG if setting.cell.delay else 0.0
    return MujocoArm(
        point_mass_model(mass),
        dt=setting.dt,
        drive=HandForce(lag),
        channel=channel,
        contacts=contacts,
        seed=setting.rng,
    )


def _run(
    setting: Setting, plant: MujocoArm, controller: BoundedForce | None, start: Array, seconds: float = SECONDS
) -> tuple[Array, Array, Array]:
    """(N,) [J] work of the acting force so far, (N,) [m/s] speed, (N, 2) [m] place, all true; no force without help."""
    drive = plant.drive
    assert isinstance(drive, HandForce)
    seen = plant.reset(start)
    ticks = round(seconds * setting.cell.rate)
    work, speed, place, done = np.empty(ticks), np.empty(ticks), np.empty((ticks, 2)), 0.0
    for k in range(ticks):
        before, force = plant.truth, drive.acting
        seen = plant.step(NONE if controller is None else controller.step(seen.position).value)
        after = plant.truth
        done += float((force + drive.acting) @ (after.position - before.position)) / 2
        work[k], speed[k], place[k] = done, np.linalg.norm(after.velocity), after.position
    return work, speed, place
