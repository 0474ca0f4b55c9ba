"""Style of all pictures: palette, markers, resolution, and how a matplotlib figure is made."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from uwcoop.errors import MissingDependencyError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Olive in place of yellow, which fades in print; pictures are white and replays are dark.
OKABE_ITO = ("#D55E00", "#0072B2", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#999933", "#000000")
"""Colour-blind-safe palette (after Okabe and Ito 2008), strongest on white first; used by every picture."""

MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")
"""One for each vehicle, so that paths can be distinguished in greyscale."""

DEPTH_COLOURS = ("#f7f6ec", "#d6e6e4", "#a9c9d6", "#7fa6c4")
"""Shallow to deep."""

DPI = 150

LINE_STYLES: tuple[Any, ...] = ("-", (0, (6, 1.5)), (0, (3, 1, 1, 1)), (0, (1, 1)), (0, (8, 2, 1, 2, 1, 2)))
"""One for each navigator, so that lines can be distinguished in greyscale."""

RECEIVED_COLOUR, LOST_COLOUR, REJECTED_COLOUR = "#8A8A8A", "#000000", "#882255"
"""Of a packet at its receiver: no vehicle has these."""

INK = "#111111"
"""Of the truth, and of what belongs to no vehicle."""


def matplotlib_figure() -> type[Figure]:
    """The class of all pictures, which needs no display.

    Raises:
        MissingDependencyError: matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError as missing:
        raise MissingDependencyError("matplotlib", "figures") from missing
    return Figure
