"""Colours of forces: light where they are small, darker where they are large, with black arrows readable on all."""

from __future__ import annotations

from matplotlib import colormaps
from matplotlib.colors import Colormap, ListedColormap

__all__ = ["force_colours"]

DARKEST = 0.75
"""Share of the map that is used."""


def force_colours() -> Colormap:
    """One hue from white on, so that it is read the same with every kind of colour vision, and in print."""
    whole = colormaps["Blues"]
    return ListedColormap([whole(DARKEST * i / 255) for i in range(256)])
