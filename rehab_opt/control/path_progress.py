"""How far along a path a hand has come, as a state: one function of numbers, for Python and C.

A spring S holds the hand x to the place p(s) of the path (s [m] of its length); S (x - p) is what the person's push f
makes of it. In every tick s becomes the place nearest to the hand, at no more than the speed cap,

    argmin  1/2 S |x - p(sigma)|^2 + f_0 max(s - sigma, 0),    low <= sigma <= s + 2 widths,

with a friction f_0 on the way back. Nothing moves s on but the hand: the help never leads a hand on. s goes on only
while the hand is within F/S and a width, F the force limit, of p(s) or of one of the next 40 places, which are a width
apart. The furthest s so far is the progress, which never goes back. low is 6 widths before the progress where a push
larger than f_0 has lasted for 0.5 s, longer than a spasm, and does more than 2.5 times as much work per length of the
path on the way back as to any of the places ahead; and s itself otherwise. s goes back by a sample a tick at most.

The help ends at the path's end: once s is within a sample of it and the hand within a width, the force fades within
0.3 s, s is the end, and both stay so.

A hand that has stood under force for 0.5 s is let go within 0.3 s, in whatever direction it is pushed, until it comes
within a width of one of the places from one to nine widths further on: the first of these along the path, and none
while the hand is within a width of the width of the path that follows on where it was let go.
"""

from __future__ import annotations

import math
from functools import cache

import casadi as ca

from rehab_opt.field.potential import SAMPLES_PER_WIDTH
from rehab_opt.optim.certificate import all_true, clipped
from rehab_opt.symbolic.record import Record, Values

__all__ = ["AHEAD", "PATH_MODEL", "PLACES", "PROGRESS", "SEARCHED", "progress_function"]

PATH_MODEL = Record(stiffness=1, spacing=1, last=1, force_limit=1, push=1, speed_cap=1, dt=1)
"""S [N/m]; length between samples [m]; number of the last one; [N]; f_0 [N]; [m/s]; tick [s]."""
PROGRESS = Record(at=1, pushed=1, stood=1, mark=1, grip=1, away=1, looked=1, place=2, along=2, furthest=1)
"""s in samples; how long [s] the hand was pushed, and has stood under force, since the progress that is
marked, in samples; share of the force that is applied; whether the hand is let go; the sample from which on it is
looked for; the place p(s) [m] and the path's direction there; the
largest s so far, in samples: the progress."""
WINDOW = 2.0
"""Widths ahead within which the progress is chosen: a detour shorter than that may be cut."""
BACK = 6.0
"""Widths by which s may be short of the progress."""
HORIZON = 40.0
"""Widths ahead within which a place may answer to a push."""
RATHER = 2.5
"""Times as much as any place ahead, per length of the path, that before s must answer to a push that moves s back."""
INSISTS = 0.5
"""[s] A shorter push does not move s back."""
STANDING = 0.15
"""Share of the force limit above which a hand that stands is held."""
PATIENCE, FADE = 0.5, 0.3
"""[s] for which a hand may be held, and in which the force then fades, so that it is gone within 0.8 s."""
PIECES, PLACES = 1 + math.ceil(WINDOW * SAMPLES_PER_WIDTH), math.ceil(HORIZON * SAMPLES_PER_WIDTH)
ANSWER = range(SAMPLES_PER_WIDTH + 1, PLACES + 2, SAMPLES_PER_WIDTH)
"""Columns of `ahead` that a push may be answered by."""
AHEAD, SEARCHED = PLACES + 2, 8 * SAMPLES_PER_WIDTH
"""Samples from the one before s on that a tick looks at, and those among which it looks for a hand that was let go."""


@cache
def progress_function() -> ca.Function:
    """One tick of the progress.

    Returns
    -------
    `PATH_MODEL`, `PROGRESS`, hand (2,) [m], force on it (2,) [N], x and y of the samples from floor(`at`) - 1 on
    (2, `AHEAD`) [m] and of those from `looked` on (2, `SEARCHED`) [m] -> `PROGRESS`. Before the path's start its first
    point repeats, beyond its end its last.
    """
    model, old = PATH_MODEL.symbols("model"), PROGRESS.symbols("old")
    hand, force = ca.SX.sym("hand", 2), ca.SX.sym("force", 2)
    ahead, searched = ca.SX.sym("ahead", 2, AHEAD), ca.SX.sym("searched", 2, SEARCHED)
    over = all_true(old.at >= model.last, old.grip < 1)  # the help has ended at the path's end
    free, first = ca.logic_and(old.away == 0, ca.logic_not(over)), ca.floor(old.at) - 1
    begin = old.at - first
    here = ahead[:, 1] + (begin - 1) * (ahead[:, 2] - ahead[:, 1])

    # Whether s may go back.
    push = model.stiffness * (hand - here)
    size = ca.norm_2(push)
    pushed = ca.fmax(old.pushed + ca.if_else(size > model.push, model.dt, -model.dt), 0)
    answer = ca.mmax(ca.vertcat(*[ca.dot(push, ahead[:, i] - here) / (i - begin) for i in ANSWER]))
    back = RATHER * answer < ca.dot(push, ahead[:, 0] - here) / begin
    low = ca.fmin(begin, ca.fmax(begin - 1, ca.fmax(old.furthest - BACK * SAMPLES_PER_WIDTH, 0) - first))
    low = ca.if_else(back, low, begin)
    found = first + _chosen(hand, here, ahead, begin, low, last=model.last - first, model=model)
    goes_back = found < old.at - 1e-9

    # s.
    waits = ca.if_else(goes_back, pushed < INSISTS, _is_off(hand, here, ahead, model))
    found = ca.if_else(waits, old.at, found)
    at = ca.if_else(free, ca.fmin(found, old.at + model.speed_cap * model.dt / model.spacing), old.at)

    # Whether the hand stands, and the force must yield.
    went_on = ca.fmax(old.furthest, at) - old.mark >= SAMPLES_PER_WIDTH
    held = ca.norm_2(force) > STANDING * model.force_limit
    stood = ca.if_else(went_on, 0, ca.fmax(old.stood + ca.if_else(held, model.dt, -model.dt), 0))
    lets_go = ca.logic_and(free, stood > PATIENCE)
    away = ca.logic_or(old.away > 0, lets_go)
    to_end = ca.sumsqr(hand - ahead[:, PIECES + 2]) <= (SAMPLES_PER_WIDTH * model.spacing) ** 2
    over = ca.logic_or(over, all_true(free, at >= model.last - 1, to_end))
    at = ca.if_else(over, model.last, at)
    grip = clipped(old.grip + ca.if_else(ca.logic_or(away, over), -model.dt, model.dt) / FADE, 0, 1)

    # Where a hand that was let go has come back to.
    start = ca.floor(at) + SAMPLES_PER_WIDTH  # beyond the end where no width is left: nothing takes the hand in again
    taken_in = _first_place(hand, ahead[:, 1 : SAMPLES_PER_WIDTH + 2], searched, old.looked, start=start, model=model)
    returns = all_true(old.away > 0, old.grip == 0, taken_in >= 0)
    at, away = ca.if_else(returns, taken_in, at), ca.if_else(returns, 0, away)
    stood, pushed = ca.if_else(away, 0, stood), ca.if_else(ca.logic_or(went_on, away), 0, pushed)
    mark = ca.if_else(ca.logic_or(went_on, returns), ca.fmax(old.furthest, at), old.mark)

    # Place and direction there; of a hand that has come back from the next tick on, when it is first led again.
    way, corner, fraction = ahead[:, 1] - ahead[:, 0], ahead[:, 0], clipped(at - first, 0, 1)
    for i in range(1, PIECES + 1):
        inside = all_true(at - first >= i, first + i < model.last)
        way, corner = ca.if_else(inside, ahead[:, i + 1] - ahead[:, i], way), ca.if_else(inside, ahead[:, i], corner)
        fraction = ca.if_else(inside, clipped(at - first - i, 0, 1), fraction)
    place, along = corner + fraction * way, way / ca.fmax(ca.norm_2(way), 1e-300)
    after = PROGRESS.of(
        at=at,
        pushed=pushed,
        stood=stood,
        mark=mark,
        grip=grip,
        away=away,
        looked=start,
        place=place,
        along=along,
        furthest=ca.fmax(old.furthest, at),
    )
    inputs = [model.column, old.column, hand, force, ahead, searched]
    return ca.Function("path_progress", inputs, [after], {"cse": True})


def _is_off(hand: ca.SX, here: ca.SX, ahead: ca.SX, model: Values) -> ca.SX:
    """Whether the hand is further than F/S and a width from p(s) and from all places that may answer."""
    near = ca.mmin(ca.vertcat(*[ca.sumsqr(hand - each) for each in (here, *(ahead[:, i] for i in ANSWER))]))
    return near > (model.force_limit / model.stiffness + SAMPLES_PER_WIDTH * model.spacing) ** 2


def _chosen(hand: ca.SX, here: ca.SX, ahead: ca.SX, begin: ca.SX, low: ca.SX, *, last: ca.SX, model: Values) -> ca.SX:
    """Samples from the first of `ahead` to s, `begin` before: exact on each piece of the path between two samples."""
    unit = model.spacing / model.stiffness  # energies are over S
    best, found, friction = ca.sumsqr(hand - here) / 2, begin, model.push * unit
    for i in range(PIECES):
        way, off = ahead[:, i + 1] - ahead[:, i], hand - ahead[:, i]
        on, square = ca.dot(off, way), ca.sumsqr(way) + 1e-300
        fraction = clipped(clipped(begin - i, on / square, (on + friction) / square), clipped(low - i, 0, 1), 1)
        further = i + fraction - begin
        energy = ca.sumsqr(off - fraction * way) / 2 + friction * ca.fmax(-further, 0)
        better = all_true(energy < best, i < last, low <= i + 1)
        best, found = ca.if_else(better, energy, best), ca.if_else(better, i + fraction, found)
    return found


def _first_place(hand: ca.SX, left: ca.SX, searched: ca.SX, looked: ca.SX, *, start: ca.SX, model: Values) -> ca.SX:
    """Number of the first sample in order that is within a width of the hand, from `start` on; -1 for none.

    None for a hand within a width of `left`, too, where it was let go: it passes a crossing there on its own branch.
    """
    within, back = (SAMPLES_PER_WIDTH * model.spacing) ** 2, ca.SX(-1)
    for i in reversed(range(SEARCHED)):
        number = looked + i
        near = all_true(ca.sumsqr(hand - searched[:, i]) <= within, number >= start, number <= model.last)
        back = ca.if_else(near, number, back)
    nearest = ca.mmin(ca.vertcat(*[ca.sumsqr(hand - left[:, i]) for i in range(left.columns())]))
    return ca.if_else(nearest <= within, -1, back)
