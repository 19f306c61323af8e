"""Progress of a hand along a path: a state that one numerical function updates, for Python and C.

A spring of stiffness S pulls the hand at x to the path point p(s). The arc length s [m] follows the hand in both
directions:

    s' = argmin |x - p(sigma)|^2,    |sigma - s| <= 2 widths,    |s' - s| <= speed cap dt

With the force limit F, the arc length s stays constant while the hand is further than F/S plus a width from p(s). A
hand that stands still under more than 0.1 F for 0.3 s is released. The spring pulls again once the hand is within a
width of a path point that is 1 to 20 widths away along the path. If the hand is far from p(s) after a gap without valid
samples, it is released at once.
"""

from __future__ import annotations

import math
from functools import cache

import casadi as ca

from rehab_opt.field.potential import SAMPLES_PER_WIDTH
from rehab_opt.optim.certificate import all_true, clipped
from rehab_opt.symbolic.record import Record

__all__ = ["BEFORE", "BESIDE", "PATH_MODEL", "PROGRESS", "progress_function"]

PATH_MODEL = Record(stiffness=1, spacing=1, last=1, force_limit=1, speed_cap=1, dt=1)
"""S [N/m]; sample spacing [m]; index of the last sample; force limit [N]; speed cap [m/s]; tick [s]."""
PROGRESS = Record(at=1, furthest=1, stood=1, mark=1, grip=1, away=1, gap=1, place=2, along=2)
"""s, and the largest s so far, both in samples; time [s] that the hand has stood still under force; `mark`, the value
of s when the hand last moved by a width; fraction of the force that acts; whether the hand is released; whether there
was a gap without valid samples; p(s) [m], and the path's direction there.
"""
WINDOW = 2.0
"""Range of the search for the nearest point, in widths either way."""
STANDING = 0.1
"""If the force on a hand that stands still exceeds this fraction of its limit, the hand counts as held."""
PATIENCE, FADE = 0.3, 0.3
"""[s] Longest time for which a hand is held, and time in which the force then fades."""
HORIZON = 20.0
"""Range, in widths either way, within which a released hand is held again; less than one round of a repeated path."""
TIE = 1e-12
"""[m^2] Squared distances that differ by less are equal."""
NEAR, BEFORE = math.ceil(WINDOW * SAMPLES_PER_WIDTH), math.ceil(HORIZON * SAMPLES_PER_WIDTH)
BESIDE = 2 * BEFORE + 2
"""Numbers of samples that a tick uses: on either side of s in the search window; before s; in all."""


@cache
def progress_function() -> ca.Function:
    """Function: `PATH_MODEL`, `PROGRESS`, hand (2,) [m], force on it (2,) [N], samples (2, `BESIDE`) [m] -> `PROGRESS`.

    The samples begin `BEFORE` samples before floor(`at`); the path's first and last points repeat.
    """
    model, old = PATH_MODEL.symbols("model"), PROGRESS.symbols("old")
    hand, force, beside = ca.SX.sym("hand", 2), ca.SX.sym("force", 2), ca.SX.sym("beside", 2, BESIDE)
    width = SAMPLES_PER_WIDTH * model.spacing
    first = ca.floor(old.at) - BEFORE
    ended = all_true(old.at >= model.last, old.grip < 1)
    free = ca.logic_not(ca.logic_or(old.away > 0, ended))

    # s follows the hand.
    beside_it = ca.norm_2(hand - old.place) <= model.force_limit / model.stiffness + width
    near, lost = all_true(free, beside_it), all_true(free, old.gap > 0, ca.logic_not(beside_it))
    step = model.speed_cap * model.dt / model.spacing
    found = first + _nearest(hand, old.place, beside, old.at - first, first=first, last=model.last)
    at = ca.if_else(near, old.at + clipped(found - old.at, -step, step), old.at)

    # The path's end, and a hand that stands still.
    at_end = all_true(free, at >= model.last - 1, ca.sumsqr(hand - beside[:, BEFORE + 2]) <= width**2)
    at, ended = ca.if_else(at_end, model.last, at), ca.logic_or(ended, at_end)
    moved = ca.fabs(at - old.mark) >= SAMPLES_PER_WIDTH
    held = ca.norm_2(force) > STANDING * model.force_limit
    stood = ca.if_else(moved, 0, ca.fmax(old.stood + ca.if_else(held, model.dt, -model.dt), 0))
    away = ca.logic_or(old.away > 0, ca.logic_or(lost, ca.logic_and(free, stood > PATIENCE)))
    fades = ca.if_else(ca.logic_or(away, ended), -model.dt, model.dt) / FADE
    grip = ca.if_else(lost, 0, clipped(old.grip + fades, 0, 1))

    # The point at which the spring pulls a released hand again.
    again = _other_place(hand, old.place, beside, first=first, last=model.last, width=width)
    returns = all_true(old.away > 0, old.grip == 0, again >= 0)
    at, away = ca.if_else(returns, again, at), ca.if_else(returns, 0, away)
    mark, stood = ca.if_else(ca.logic_or(moved, returns), at, old.mark), ca.if_else(away, 0, stood)

    # Path point and direction at s; for a hand that is held again, they are right from the next tick on.
    begin, end = BEFORE - NEAR, BEFORE + NEAR + 1
    corner, way, past = beside[:, begin], beside[:, begin + 1] - beside[:, begin], at - first - begin
    for i in range(begin + 1, end + 1):
        inside = all_true(at - first >= i, first + i < model.last)
        corner, past = ca.if_else(inside, beside[:, i], corner), ca.if_else(inside, at - first - i, past)
        way = ca.if_else(inside, beside[:, i + 1] - beside[:, i], way)
    place, along = corner + clipped(past, 0, 1) * way, way / ca.fmax(ca.norm_2(way), 1e-300)
    after = PROGRESS.of(
        at=at, furthest=ca.fmax(old.furthest, at), stood=stood, mark=mark, grip=grip, away=away, gap=ca.SX(0),
        place=place, along=along,
    )  # fmt: skip
    return ca.Function("path_progress", [model.column, old.column, hand, force, beside], [after], {"cse": True})


def _nearest(hand: ca.SX, here: ca.SX, beside: ca.SX, begin: ca.SX, *, first: ca.SX, last: ca.SX) -> ca.SX:
    """Index in `beside`, with a fraction, of the path point in `WINDOW` nearest to the hand; the last one of equals."""
    best, found = ca.sumsqr(hand - here) + TIE, begin
    for i in reversed(range(BEFORE - NEAR, BEFORE + NEAR + 1)):
        way, off = beside[:, i + 1] - beside[:, i], hand - beside[:, i]
        fraction = clipped(ca.dot(off, way) / (ca.sumsqr(way) + 1e-300), 0, 1)
        away = ca.sumsqr(off - fraction * way)
        better = all_true(away < best - TIE, first + i >= 0, first + i < last)
        best, found = ca.if_else(better, away, best), ca.if_else(better, i + fraction, found)
    return found


def _other_place(hand: ca.SX, left: ca.SX, beside: ca.SX, *, first: ca.SX, last: ca.SX, width: ca.SX) -> ca.SX:
    """Path sample nearest to s among those within a width of the hand and at least a width from s; -1 if there is none.

    Also -1 if the hand is within a width of its old point `left`.
    """
    found = ca.SX(-1)
    for apart in reversed(range(SAMPLES_PER_WIDTH, BEFORE + 1)):
        for i in (BEFORE - apart, BEFORE + apart):
            near = all_true(ca.sumsqr(hand - beside[:, i]) <= width**2, first + i >= 0, first + i <= last)
            found = ca.if_else(near, first + i, found)
    return ca.if_else(ca.sumsqr(hand - left) <= width**2, -1, found)
