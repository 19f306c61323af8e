"""What a figure draws, as numbers and words to keep: for tests that a picture looks as it did."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import Collection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.text import Text

from tests.golden.returns import sums


def digest(figure: Figure) -> list[Any]:
    """Size, caption and texts; of each axes its limits, and its artists' kinds, labels, colours, widths and data."""
    parts = [each for each in figure.get_children() if isinstance(each, Text)]
    legends = [[text.get_text() for text in legend.get_texts()] for legend in figure.legends]
    return [
        rounded(figure.get_size_inches()),
        figure.get_label(),
        [told(each) for each in parts],
        legends,
        *map(_axes, figure.axes),
    ]


def _axes(axes: Axes) -> dict[str, Any]:
    bounds = {"x": axes.get_xlim(), "y": axes.get_ylim()} | (
        {"z": axes.get_zlim()} if hasattr(axes, "get_zlim") else {}
    )
    words = [
        axes.get_title(),
        axes.get_title("left"),
        axes.get_xlabel(),
        axes.get_ylabel(),
        axes.get_xscale(),
        axes.get_yscale(),
    ]
    legend = axes.get_legend()
    return {
        "words": words, "aspect": str(axes.get_aspect()),
        "ticks": [rounded(axes.get_xticks()), rounded(axes.get_yticks())],
        "bounds": {key: rounded(each) for key, each in bounds.items()},
        "legend": [text.get_text() for text in legend.get_texts()] if legend else None,
        "artists": [told(each) for each in axes.get_children() if isinstance(each, (Line2D, Collection, Patch, Text))
                    and not (isinstance(each, Text) and not each.get_text())],
    }  # fmt: skip


def told(artist: Artist) -> list[Any]:
    """One artist."""
    return [
        type(artist).__name__,
        str(artist.get_label()),
        round(artist.get_zorder(), 6),
        artist.get_alpha(),
        *_style(artist),
    ]


def _style(artist: Artist) -> Iterator[Any]:
    match artist:
        case Line2D():
            yield from (
                to_hex(artist.get_color(), True),
                artist.get_linestyle(),
                artist.get_linewidth(),
                artist.get_marker(),
            )
            yield from (artist.get_markersize(), coarse(artist.get_xydata()))
        case Text():
            yield from (
                artist.get_text(),
                to_hex(artist.get_color(), True),
                artist.get_fontsize(),
                rounded(artist.get_position()),
            )
        case Patch():
            yield from (
                to_hex(artist.get_facecolor(), True),
                artist.get_linewidth(),
                coarse(artist.get_path().vertices),
            )
            yield coarse(artist.get_transform().frozen().get_matrix() if artist.axes is None else [[artist.get_angle()]]
                         if hasattr(artist, "get_angle") else [])  # fmt: skip
        case Collection():
            array = artist.get_array()
            yield from (
                [rounded(artist.get_facecolor()[:3]), rounded(artist.get_edgecolor()[:3])],
                rounded(artist.get_linewidths()[:5]),
            )
            yield [coarse(each.vertices) for each in artist.get_paths()[:4]] + [coarse(artist.get_offsets())]
            yield coarse(np.ma.filled(np.ma.asarray(array, dtype=float), -1.0)) if array is not None else None


def rounded(values: Any) -> list[Any]:
    """To six digits."""
    return [float(f"{each:.6g}") for each in np.asarray(values, dtype=float).ravel()]


def coarse(values: Any) -> list[float]:
    """Length, and sums of six digits."""
    values = np.asarray(values, dtype=float)
    return [len(values), *(float(f"{each:.6g}") for each in sums(values))]
