"""Charts as SVG within a page: text escaped, colours that colour-blind readers distinguish, nothing loaded."""

from __future__ import annotations

import html
import math
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

from rehab_opt.errors import printable
from rehab_opt.study.summary import Interval
from rehab_opt.text_file import shown

__all__ = [
    "COLOURS",
    "Series",
    "area",
    "bars",
    "escaped",
    "growth_chart",
    "hull",
    "number",
    "outline_chart",
    "progress_chart",
]

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#555555")
"""Okabe and Ito's; the last one for whatever is left."""
WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 460, 250, 66, 12, 12, 40
LONGEST_LABEL = 14


class Series(NamedTuple):
    """Points of one condition, and their means at the same x."""

    name: str
    points: Sequence[tuple[float, float]]
    means: Sequence[tuple[float, Interval]]


def escaped(text: object) -> str:
    """Text for a page; nothing in it is read as HTML."""
    return html.escape(printable(str(text)), quote=True)


def number(value: float, *, within: float = 0.0) -> str:
    """Three figures, or as many more as separate numbers `within`."""
    if not math.isfinite(value):
        return "-"
    figures = 3
    if 0 < within < abs(value):
        figures = min(max(3, 2 + math.ceil(math.log10(abs(value) / within))), 7)
    return f"{value:.{figures}g}" if not 1000 <= abs(value) < 1e6 else f"{value:.0f}"


def progress_chart(series: Sequence[Series], labels: Sequence[tuple[float, str]]) -> str:
    """Points, and means with their 95 % intervals over x, whose `labels` stand below."""
    values = [y for each in series for _, y in each.points]
    values += [end for each in series for _, of in each.means for end in of[:3] if math.isfinite(end)]
    if not values:
        return ""
    low, high = min(values), max(values)
    # One interval of few trials may be a hundred times as long as all values lie apart: it runs out of the chart.
    spread = [y for each in series for _, y in each.points] or values
    room = 1.0 * (max(spread) - min(spread)) or abs(high) * 0.1 or 1.0
    low, high = max(low, min(spread) - room), min(high, max(spread) + room)
    if not high > low:
        low, high = low - room / 2, high + room / 2
    ticks = _ticks(low, high)
    low, high = min(low, ticks[0]), max(high, ticks[-1])
    step = ticks[1] - ticks[0] if len(ticks) > 1 else 0.0
    xs = [x for x, _ in labels]
    first, last = min(xs), max(xs)

    def at_x(x: float) -> float:
        return LEFT + (WIDTH - LEFT - RIGHT) * ((x - first) / (last - first) * 0.92 + 0.04 if last > first else 0.5)

    def at_y(y: float) -> float:
        return HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * (min(max(y, low), high) - low) / (high - low)

    parts = []
    for tick in ticks:
        y = at_y(tick)
        parts.append(f'<line x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{y:.1f}" y2="{y:.1f}" class="grid"/>')
        parts.append(f'<text x="{LEFT - 6}" y="{y + 4:.1f}" class="end">{number(tick, within=step)}</text>')
    parts += _x_labels(labels, at_x, HEIGHT - BOTTOM)
    for i, each in enumerate(series):
        colour = COLOURS[min(i, len(COLOURS) - 1)]
        shift = 5.0 * (i - (len(series) - 1) / 2) if len(series) < len(COLOURS) else 0.0
        dots = dict.fromkeys((round(at_x(x) + shift), round(at_y(y))) for x, y in each.points)
        drawn = "".join(f"M{x} {y}h0" for x, y in dots)
        strength = 0.35 if len(dots) < 400 else 0.12
        parts.append(f'<path d="{drawn}" stroke="{colour}" stroke-opacity="{strength}" class="dots"/>')
        places = [(at_x(x) + shift, of) for x, of in each.means]
        line = " ".join(f"{x:.1f},{at_y(of.mean):.1f}" for x, of in places)
        parts.append(f'<polyline points="{line}" stroke="{colour}" class="line"/>')
        for x, of in places:
            if math.isfinite(of.lower):
                parts.append(
                    f'<path d="M{x:.1f} {at_y(of.lower):.1f}V{at_y(of.upper):.1f}" stroke="{colour}" class="bar"/>'
                )
            parts.append(f'<circle cx="{x:.1f}" cy="{at_y(of.mean):.1f}" r="3.2" fill="{colour}"/>')
    return _svg(parts, WIDTH, HEIGHT)


class Shape(NamedTuple):
    """A convex outline (N, 2) [m] to draw: its label, its colour by number, how strong its line is, 0 to 1."""

    label: str
    corners: Sequence[tuple[float, float]]
    colour: int
    strength: float


def outline_chart(shapes: Sequence[tuple[str, Sequence[tuple[float, float]]]]) -> str:
    """Convex hulls of one person's points [m] over one another, from light to dark, the first one on top."""
    last = len(shapes) - 1
    drawn = [
        Shape(label, hull(of), 1 if i == 0 < last else 0, 1.0 if i in (0, last) else 0.15 + 0.5 * i / len(shapes))
        for i, (label, of) in enumerate(shapes)
    ]
    return _outlines([*drawn[1:], *drawn[:1]])


def growth_chart(people: Sequence[tuple[str, Sequence[tuple[float, float]], Sequence[tuple[float, float]]]]) -> str:
    """Of each person two hulls [m], the first orange and the last blue, both moved by what centres the first one."""
    drawn = []
    for name, first, last in people:
        x, y = (sum(axis) / len(first) for axis in zip(*first, strict=True))
        for corners, colour in ((last, 0), (first, 1)):
            drawn.append(Shape(name, [(px - x, py - y) for px, py in corners], colour, 0.55))
    return _outlines(sorted(drawn, key=lambda each: each.colour))


def _outlines(shapes: Sequence[Shape]) -> str:
    """Shapes under one scale in both directions, later ones on top."""
    points = [point for shape in shapes for point in shape.corners]
    if not points:
        return ""
    size, edge = 320, 14
    low = [min(point[axis] for point in points) for axis in (0, 1)]
    extent = max(max(point[axis] for point in points) - low[axis] for axis in (0, 1)) or 1.0
    scale = (size - 2 * edge - 16) / extent
    parts = []
    for shape in shapes:
        look = f'stroke="{COLOURS[shape.colour]}" fill="none" stroke-width="{2.2 if shape.strength == 1 else 1}"'
        look += f' stroke-opacity="{shape.strength:.2f}"'
        at = [(edge + scale * (x - low[0]), size - edge - 16 - scale * (y - low[1])) for x, y in shape.corners]
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in at)
        parts.append(f'<polygon points="{path}" {look}><title>{escaped(shape.label)}</title></polygon>')
    step = _ticks(0.0, extent / 2)[-1] or extent
    parts.append(f'<path d="M{edge} {size - 8}h{scale * step:.1f}" class="scale"/>')
    parts.append(f'<text x="{edge + scale * step + 6:.1f}" y="{size - 4}">{number(1e3 * step)} mm</text>')
    return _svg(parts, size, size)


def hull(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Corners of the convex hull, counterclockwise (Andrew's monotone chain)."""
    corners: list[tuple[float, float]] = []
    for ordered in (sorted(points), sorted(points, reverse=True)):
        side: list[tuple[float, float]] = []
        for x, y in ordered:
            while len(side) > 1 and (side[-1][0] - side[-2][0]) * (y - side[-2][1]) <= (side[-1][1] - side[-2][1]) * (
                x - side[-2][0]
            ):
                side.pop()
            side.append((x, y))
        corners += side[:-1]
    return corners


def area(corners: Sequence[tuple[float, float]]) -> float:
    """Area of a polygon, whichever way round."""
    ends = zip(corners, [*corners[1:], *corners[:1]], strict=True)
    return abs(sum(x * v - u * y for (x, y), (u, v) in ends)) / 2


def bars(fractions: Iterable[tuple[str, float]]) -> str:
    """Fractions of a bound, each as a bar that ends red where it passes 100 %."""
    parts, y = [], 8
    for label, fraction in fractions:
        filled = 260 * min(fraction, 1.25) / 1.25
        colour = COLOURS[1] if fraction > 1 else COLOURS[2]
        parts.append(f'<text x="0" y="{y + 10}">{escaped(shown(label, 34))}<title>{escaped(label)}</title></text>')
        parts.append(f'<rect x="230" y="{y}" width="{filled:.1f}" height="12" fill="{colour}"/>')
        parts.append(f'<text x="{238 + filled:.1f}" y="{y + 10}">{100 * fraction:.0f} %</text>')
        y += 22
    x = 230 + 260 / 1.25
    parts.append(f'<path d="M{x:.1f} 2V{y}" class="scale"/><text x="{x:.1f}" y="{y + 12}" class="middle">bound</text>')
    return _svg(parts, 560, y + 18)


def _ticks(low: float, high: float) -> list[float]:
    """Four to seven round numbers within [low, high]."""
    span = high - low or abs(high) or 1.0
    step = 10.0 ** math.floor(math.log10(span / 4))
    step *= next(factor for factor in (1, 2, 2.5, 5, 10) if span / (step * factor) <= 6)
    first = math.ceil(low / step - 1e-9)
    return [step * i for i in range(first, math.floor(high / step + 1e-9) + 1)] or [low]


def _x_labels(labels: Sequence[tuple[float, str]], at_x: Callable[[float], float], y: float) -> list[str]:
    """The first label, the last, and those between that have room."""
    room = 8.0 * max(min(len(label), LONGEST_LABEL) for _, label in labels) + 8
    chosen = [labels[0]]
    for x, label in labels[1:-1]:
        if at_x(x) - at_x(chosen[-1][0]) >= room and at_x(labels[-1][0]) - at_x(x) >= room:
            chosen.append((x, label))
    chosen += [labels[-1]] if len(labels) > 1 else []
    parts = []
    for i, (x, label) in enumerate(chosen):
        kind = "end" if 0 < i == len(chosen) - 1 else "middle"
        said = f"{escaped(shown(label, LONGEST_LABEL))}<title>{escaped(label)}</title>"
        parts.append(
            f'<text x="{at_x(x) + (12 if kind == "end" else 0):.1f}" y="{y + 16:.1f}" class="{kind}">{said}</text>'
        )
    return parts


def _svg(parts: Sequence[str], width: float, height: float) -> str:
    return f'<svg viewBox="0 0 {width} {height}" width="{width}" height="{height}" role="img">{"".join(parts)}</svg>'
