"""Claims about help that comes to rest: on people of random mass and damping, with forces that are late."""

import math

import numpy as np
import pytest
import shapely

from rehab_opt import Assistance, BoundedForce, PotentialField, Status, Workspace
from rehab_opt.field.settling import crossover, fitting_damping, settling_notes

START = np.array([-0.17, 0.50])
PATH = START + np.outer(np.linspace(0, 1, 50), [0.2, 0.0])
FIELD = PotentialField(PATH, stiffness=1000.0, drag=200.0, width=0.025, compile=False)
COMFORTABLE = Workspace(shapely.box(-0.30, 0.45, -0.20, 0.55), accuracy=1e-3)
OPTIONS = {"comfortable": COMFORTABLE, "mode": "assist", "trust_stillness": True, "compile": False}


def reach(helper, seed, *, delay=0.0, lag=0.0, noise=0.0, seconds=4.0):
    """True speeds, distances from the target, work so far, statuses and forces of a random person who does nothing."""
    rng = np.random.default_rng(seed)
    dt, mass, damping = helper.dt, rng.uniform(1.5, 4.0), rng.uniform(4.0, 15.0)
    hertz, phase = rng.uniform(4, 8), rng.uniform(0, 2 * math.pi, 2)
    x, v, force, work, rows = START + 0.005 * rng.normal(size=2), np.zeros(2), np.zeros(2), 0.0, []
    late = round(delay / dt)
    sent, follows = [np.zeros(2)] * late, 1.0 if lag == 0.0 else 1.0 - math.exp(-dt / lag)
    for k in range(round(seconds / dt)):
        command = helper.step(x + noise * rng.normal(size=2))
        sent.append(command.value)
        force = force + follows * (sent[k] - force)
        tremor = 0.3 * np.sin(2 * math.pi * hertz * k * dt + phase)
        v = v + dt * (force - damping * v + tremor) / mass
        x = x + dt * v
        work += dt * float(force @ v)
        rows.append((np.hypot(*v), np.hypot(*(x - PATH[-1])), work, command.status, np.hypot(*command.value)))
    return [np.array(column) for column in zip(*rows, strict=True)]


@pytest.mark.parametrize(("delay", "lag", "dt"), [(0.008, 0.003, 1e-3)])
def test_help_with_default_numbers_arrives_and_stands_still(delay, lag, dt) -> None:
    """0.2 m: the hand is at rest a second after it came, and 3 J do it. With D = 5 N s/m and 200 N/s it never is."""
    for seed in range(2):
        speed, away, work, status, _ = reach(
            Assistance(FIELD, dt=dt, actuation_delay=delay, **OPTIONS), seed, delay=delay, lag=lag
        )
        assert away.min() < 0.015
        rest = speed[int((away < 0.015).argmax()) + round(1.0 / dt) :]
        assert np.sqrt(np.mean(rest**2)) <= 0.05
        assert work.max() <= 3.0
        assert (status == Status.OK).all()


def test_a_hand_that_runs_on_under_the_noise_is_let_go() -> None:
    """No single step of it is more than noise can be."""
    for told in (5e-4, 1e-3):
        helper = BoundedForce(lambda *_: (5.0, 0.0), position_noise=told, compile=False)
        for k in range(200):
            helper.step((1e-4 * k, 0.0))
        x = 0.02
        for _ in range(30):
            x += 1e-3 * (1.1 + 6 * told / 0.01)
            command = helper.step((x, 0.0))
            if command.status is not Status.OK:
                break
        assert "hand moves at" in command.reason
        assert not command.value.any()


@pytest.mark.parametrize("seed", range(1))
def test_a_force_not_felt_of_late_comes_gently_and_what_was_felt_as_fast_as_it_can(seed) -> None:
    rng = np.random.default_rng(seed)
    limit, slew, growth, dt = rng.uniform(5, 50), rng.uniform(500, 5000), rng.uniform(50, 400), 1e-3
    wanted = [0.0, 0.0]
    force = BoundedForce(
        lambda *_: tuple(wanted), force_limit=limit, slew_limit=slew, growth_limit=growth, energy_budget=1e3,
        trust_stillness=True, compile=False,
    )  # fmt: skip
    felt, last, fast = 0.0, np.zeros(2), 0
    for k in range(3000):
        if rng.random() < 0.02:
            wanted[:] = rng.uniform(-limit, limit, 2) * rng.choice([0.0, 0.2, 1.0])
        value = force.step((1e-5 * (k % 7), 0.0)).value
        size, change = np.hypot(*value), np.hypot(*(value - last))
        felt = max(np.hypot(*last), felt - 0.5 * limit * dt)
        assert size <= felt + growth * dt + 1e-9
        assert change <= slew * dt * (1 + 1e-9)
        fast += size > np.hypot(*last) + 1.5 * growth * dt
        last = value
    assert fast > 10


def test_the_margin_says_which_loops_are_stable() -> None:
    """Beside the eigenvalues of the same loop, its delay by a Pade approximation."""
    from scipy.interpolate import pade  # noqa: PLC0415

    p, q = pade([(-1.0) ** k / math.factorial(k) for k in range(9)], 4)
    rng, told = np.random.default_rng(1), []
    for _ in range(300):
        s, d, m = rng.uniform(50, 6000), rng.uniform(0, 150), rng.uniform(1.5, 4)
        delay, lag, slow = rng.uniform(1e-4, 0.03), rng.uniform(0, 0.01), rng.uniform(1e-3, 0.03)
        margin = crossover(s, d, mass=m, delay=delay, lag=lag, velocity_lag=slow).margin
        if abs(margin) < 0.01:
            continue
        filters = np.poly1d([slow / 2, 1]) ** 2
        up, down = (each(np.poly1d([delay, 0])) for each in (p, q))
        closed = np.poly1d([lag, 1]) * np.poly1d([m, 4.0, 0]) * filters * down + (s * filters + np.poly1d([d, 0])) * up
        told.append(margin > 0)
        assert (closed.roots.real.max() < 0) == told[-1]
    assert 0.2 < np.mean(told) < 0.8


def test_numbers_that_do_not_go_together_are_told_with_ones_that_do() -> None:
    assert Assistance(FIELD, **OPTIONS).notes == ()
    assert Assistance(FIELD, actuation_delay=0.008, **OPTIONS).notes == ()
    weak = PotentialField(PATH, stiffness=1000.0, drag=200.0, width=0.025, damping=5.0, compile=False)
    (damping,) = Assistance(weak, actuation_delay=0.008, **OPTIONS).notes
    assert "a damping of 49.5 N s/m does" in damping
    (slew,) = Assistance(FIELD, slew_limit=200.0, **OPTIONS).notes
    assert "slew_limit = 200 N/s" in slew
    stiff = PotentialField(PATH, stiffness=5000.0, width=0.025, compile=False)
    (late, _) = Assistance(stiff, actuation_delay=0.02, **OPTIONS).notes
    assert "oscillates with growing amplitude" in late
    # What is said to do does.
    limit = float(late.split("at most ")[1].split(" N/m")[0])
    times = {"delay": 0.021, "lag": 0.0, "velocity_lag": 0.01}
    assert not list(settling_notes(limit, fitting_damping(limit), force_limit=30.0, slew_limit=2500.0, **times))
