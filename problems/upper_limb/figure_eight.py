"""Write figure_eight.csv: `python problems/upper_limb/figure_eight.py`.

A figure of eight, 36 mm wide and 44 mm deep, drawn twice in 10 s from rest to rest: with the phase
a(t) = 4 pi m(t / 10 s), m(u) = 10 u^3 - 15 u^4 + 6 u^5 (minimum jerk), the hand is at

    x = 18 mm sin 2a,    y = 22 mm sin a.
"""

from __future__ import annotations

import math
from pathlib import Path

DURATION = 10.0  # [s]
RATE = 100  # [Hz]
LOOPS = 2
HALF_WIDTH, HALF_DEPTH = 0.018, 0.022  # [m]


def figure_eight_csv() -> str:
    """The text of figure_eight.csv."""
    lines = ["t_s,x_m,y_m"]
    for i in range(round(DURATION * RATE) + 1):
        u = i / (DURATION * RATE)
        phase = 2 * math.pi * LOOPS * (10 * u**3 - 15 * u**4 + 6 * u**5)
        x, y = HALF_WIDTH * math.sin(2 * phase), HALF_DEPTH * math.sin(phase)
        lines.append(f"{i / RATE:.2f},{x + 0.0:.7f},{y + 0.0:.7f}".replace("-0.0000000", "0.0000000"))
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    Path(__file__).with_name("figure_eight.csv").write_text(figure_eight_csv(), encoding="utf-8", newline="\n")
