"""Write lead_1.csv to lead_5.csv: `python problems/upper_limb/demonstrations/lead.py`.

A simulated therapist guides a passive hand from right to left along the path of `scenario_2_assist`, five times with
small differences, until the hand has rested near the end for a moment. With the point p of the path nearest to the
hand x, the path's direction t at p, and the remaining length s of the path (L at the start),

    F = K (p + sway - x) + P s / L t - D x',        m x'' = F - d x' - k (x - x_0) left of x_0 + pushes,

where k is the stiffness of joints near their limits. The robot measures x and F with noise. All numbers are
assumptions.
"""

from __future__ import annotations

import itertools
import math
import random
from pathlib import Path

CORNERS = ((-0.16, 0.505), (-0.185, 0.498), (-0.21, 0.491), (-0.23, 0.490), (-0.25, 0.493))  # [m] of scenario_2_assist
COUNT, RATE, TICK = 5, 50, 1e-3  # files, [Hz] of the file, [s] of the simulation
STIFFNESS, DAMPING = 1200.0, 60.0  # K [N/m], D [N s/m] of the therapist
PULL = 28.0  # P [N]
MASS, FRICTION, PASSIVE, EDGE = 1.2, 150.0, 60.0, -0.19  # m [kg], d [N s/m], k [N/m], x_0 [m]
SWAY, PUSH = 0.0005, 1.5  # [m] of the therapist, [N] of the hand: root mean square of each coordinate
NEAR, REST, LONGEST = 0.010, 0.5, 10.0  # [m] from the end, [s] there, [s] a file at most
NOISE_M, NOISE_N = 1e-4, 0.2


def lead_csv(number: int) -> str:
    """The text of one file; `number` from 1."""
    chance = random.Random(number)
    pull = PULL * chance.uniform(0.9, 1.1)
    therapist = [_waves(chance, SWAY) for _ in range(2)]
    hand = [_waves(chance, PUSH) for _ in range(2)]
    whole = sum(map(math.dist, CORNERS, CORNERS[1:]))
    bend = [_along(i / 1000 * whole) for i in range(1001)]
    x, v, at, rested = list(CORNERS[0]), [0.0, 0.0], 0, 0.0
    lines, i = ["t_s,x_m,y_m,fx_N,fy_N"], 0
    while rested < REST and i * TICK <= LONGEST:
        t = i * TICK
        at = min(range(max(at - 20, 0), min(at + 21, 1001)), key=lambda j: math.dist(bend[j], x))
        left, before, after = whole * (1 - at / 1000), bend[max(at - 1, 0)], bend[min(at + 1, 1000)]
        fraction = pull * left / whole / math.dist(before, after)
        force = [
            STIFFNESS * (bend[at][k] + therapist[k](t) - x[k]) + fraction * (after[k] - before[k]) - DAMPING * v[k]
            for k in range(2)
        ]
        if i % round(1 / RATE / TICK) == 0:
            seen = [x[k] + chance.gauss(0, NOISE_M) for k in range(2)]
            felt = [force[k] + chance.gauss(0, NOISE_N) for k in range(2)]
            lines.append(f"{t:.2f},{seen[0]:.5f},{seen[1]:.5f},{felt[0]:.3f},{felt[1]:.3f}")
        back = PASSIVE * min(x[0] - EDGE, 0.0)
        for k in range(2):
            answer = force[k] - FRICTION * v[k] - (back if k == 0 else 0.0) + hand[k](t)
            v[k] += TICK * answer / MASS
            x[k] += TICK * v[k]
        rested = rested + TICK if math.dist(x, CORNERS[-1]) <= NEAR else 0.0
        i += 1
    return "\n".join(lines) + "\n"


def _along(left: float) -> tuple[float, float]:
    """The point at the length `left` [m] from the path's start."""
    for a, b in itertools.pairwise(CORNERS):
        length = math.dist(a, b)
        if left <= length:
            return a[0] + left / length * (b[0] - a[0]), a[1] + left / length * (b[1] - a[1])
        left -= length
    return CORNERS[-1]


def _waves(chance: random.Random, size: float):  # type: ignore[no-untyped-def]
    """A slow sway of root mean square `size`, as a function of time."""
    lines = [(chance.uniform(0.3, 1.5), chance.uniform(0, 2 * math.pi)) for _ in range(4)]
    return lambda t: size / math.sqrt(2) * sum(math.sin(2 * math.pi * hz * t + phase) for hz, phase in lines)


if __name__ == "__main__":
    for each in range(1, COUNT + 1):
        Path(__file__).with_name(f"lead_{each}.csv").write_text(lead_csv(each), encoding="utf-8", newline="\n")
