"""What a panel of the map holds beside the chart: paths, ellipses, ends, fixes, the scale."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.evaluation.nees import CHI2_95_2D
from uwcoop.figures.style import INK, MARKERS, OKABE_ITO

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from uwcoop.missionlog import Columns

    Floats = NDArray[np.float64]

__all__ = ["draw_paths", "draw_scale", "ellipse", "finite_points", "spread_evenly"]

_ELLIPSES, _MARKERS = 9, 5
_LEAST_SHARE = 0.014
"""A typical ellipse's longer half axis is drawn at least so long, as a share of the frame's width."""
_FACTORS = (1, 2, 5, 10, 20, 50, 100)


def draw_paths(
    axes: Axes, tracks: xr.Dataset, navigator: int, view: tuple[float, ...], fixes: Columns | None
) -> None:
    """True and estimated paths of all vehicles, ellipses, and notes on what does not fit the frame.

    Where ellipses would be too small to be seen they are enlarged by a factor common to the panel, which a note states.
    """
    from matplotlib.patheffects import Normal, Stroke

    halo = [Stroke(linewidth=2.6, foreground="white", alpha=0.8), Normal()]
    notes = []
    factor = _enlarged(tracks["covariance_m2"].values[navigator], view)
    if factor > 1:
        notes.append(f"95 % ellipses × {factor}")
    for j, vehicle in enumerate(tracks["vehicle"].values):
        colour, marker = OKABE_ITO[j % 8], MARKERS[j % 8]
        truth = tracks["truth_position_m"].values[j]
        estimate = tracks["position_m"].values[navigator, j]
        covariance = tracks["covariance_m2"].values[navigator, j]
        axes.plot(*estimate.T, color=colour, lw=1.4, path_effects=halo, zorder=3)
        axes.plot(*truth.T, color=INK, lw=0.8, ls=(0, (4, 2.5)), zorder=3.2)
        # The first is that of the start, which nobody navigates by.
        for k in spread_evenly(estimate, _ELLIPSES + 1)[1:]:
            ring = ellipse(estimate[k], covariance[k] * factor**2)
            axes.fill(*ring.T, facecolor=colour, alpha=0.12, lw=0, zorder=3.4)
            axes.plot(*ring.T, color=colour, lw=1.1, zorder=3.5)
        between = spread_evenly(estimate, 2 * _MARKERS + 1)[1::2]
        axes.plot(
            *estimate[between].T, ls="", marker=marker, ms=4, mfc="white", mec=colour, mew=1.0, zorder=4
        )
        if fixes is not None:
            own = fixes["vehicle"] == j
            axes.plot(
                fixes["e_m"][own], fixes["n_m"][own], ls="", marker="+", ms=5, mec=INK, mew=0.8, zorder=4.5
            )
        _ends(axes, truth, estimate, colour, marker)
        beyond = _beyond(estimate, view)
        if beyond > 0:
            notes.append(f"{vehicle} leaves the frame by {beyond:.0f} m")
    if notes:
        axes.text(
            0.02, 0.02, "\n".join(notes), transform=axes.transAxes, fontsize=7, va="bottom", zorder=6,
            bbox={"facecolor": "white", "alpha": 0.85, "edgecolor": "none", "pad": 2},
        )  # fmt: skip


def draw_scale(axes: Axes, view: tuple[float, float, float, float]) -> None:
    """A bar of a round length in the lower right corner."""
    wanted = 0.22 * (view[1] - view[0])
    decade = 10.0 ** math.floor(math.log10(wanted))
    length = max(step * decade for step in (1, 2, 5) if step * decade <= wanted)
    right = view[1] - 0.03 * (view[1] - view[0])
    bottom = view[2] + 0.045 * (view[3] - view[2])
    axes.plot(
        [right - length, right], [bottom, bottom], color="white", lw=5, solid_capstyle="butt", zorder=5.8
    )
    axes.plot([right - length, right], [bottom, bottom], color=INK, lw=2, solid_capstyle="butt", zorder=5.9)
    text = f"{length / 1000:g} km" if length >= 1000 else f"{length:g} m"
    axes.annotate(
        text, (right - length / 2, bottom), xytext=(0, 3), textcoords="offset points", ha="center", fontsize=7,
        zorder=6, bbox={"facecolor": "white", "alpha": 0.7, "edgecolor": "none", "pad": 0.8},
    )  # fmt: skip


def _enlarged(covariance: Floats, view: tuple[float, ...]) -> int:
    """The least factor by which a typical ellipse can be seen."""
    trace = covariance[..., 0, 0] + covariance[..., 1, 1]
    known = trace[np.isfinite(trace) & (trace > 0)]
    if not known.size:
        return 1
    typical = float(np.sqrt(CHI2_95_2D * np.median(known) / 2))
    wanted = _LEAST_SHARE * (view[1] - view[0]) / typical
    return next((factor for factor in _FACTORS if factor >= wanted), _FACTORS[-1])


def _ends(axes: Axes, truth: Floats, estimate: Floats, colour: str, marker: str) -> None:
    """Start: large open marker. End: a cross on the truth, joined to the filled end of the estimate."""
    known = truth[np.isfinite(truth).all(1)]
    believed = estimate[np.isfinite(estimate).all(1)]
    start = known[:1] if len(known) else believed[:1]
    axes.plot(*start.T, ls="", marker=marker, ms=8, mfc="white", mec=INK, mew=1.4, zorder=5)
    if len(believed):
        axes.plot(*believed[-1:].T, ls="", marker=marker, ms=6.5, mfc=colour, mec=INK, mew=0.8, zorder=5.2)
    if len(known):
        axes.plot(*known[-1:].T, ls="", marker="x", ms=7, mec=INK, mew=1.8, zorder=5.4)
    if len(known) and len(believed):
        axes.plot(*np.stack([known[-1], believed[-1]]).T, color=INK, lw=0.8, ls=":", zorder=5)


def ellipse(mean: Floats, covariance: Floats) -> Floats:
    """Closed outline (41, 2) of the 95 % region of a 2-D Gaussian; NaN where the covariance is not one."""
    if not (np.isfinite(covariance).all() and np.isfinite(mean).all()):
        return np.full((41, 2), np.nan)
    eigenvalues, vectors = np.linalg.eigh((covariance + covariance.T) / 2)
    if eigenvalues[0] < -1e-9 * max(float(eigenvalues[1]), 1e-300):
        return np.full((41, 2), np.nan)
    angle = np.linspace(0, 2 * np.pi, 41)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    axes = vectors * np.sqrt(CHI2_95_2D * np.maximum(eigenvalues, 0))
    return np.asarray(mean + (axes @ circle).T)


def spread_evenly(path: Floats, count: int) -> NDArray[np.intp]:
    """`count` indices evenly spread over the path's finite part, ends included."""
    finite = np.flatnonzero(np.isfinite(path).all(1))
    if not len(finite):
        return finite
    return finite[np.unique(np.linspace(0, len(finite) - 1, count).astype(np.intp))]


def _beyond(path: Floats, view: tuple[float, ...]) -> float:
    finite = finite_points(path)
    if not len(finite):
        return 0.0
    outside = np.maximum(
        np.array([view[0], view[2]]) - finite.min(0), finite.max(0) - np.array([view[1], view[3]])
    )
    return float(max(outside.max(), 0.0))


def finite_points(points: NDArray[Any]) -> Floats:
    """Those of the points (..., 2) that are known, (N, 2)."""
    flat = points.reshape(-1, 2)
    return np.asarray(flat[np.isfinite(flat).all(1)])
