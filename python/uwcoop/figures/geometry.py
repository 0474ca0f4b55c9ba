"""Where ranges come from and what they do to a covariance: bearings, aspect ratio and trace over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.figures.style import LINE_STYLES, MARKERS, OKABE_ITO
from uwcoop.frames import heading_from_yaw

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Packets = Mapping[str, NDArray[Any]]

SENDER_GREYS = ("#111111", "#ffffff", "#9a9a9a", "#555555")
"""Fill of a sender's mark, beside its shape: colours are the navigators'."""


def aspect_and_trace(covariance_m2: Floats) -> tuple[Floats, Floats]:
    """Ratio of the error ellipse's axes (major / minor, 1 or above) and trace, m², of (..., 2, 2).

    NaN where it is not a covariance; the ratio is infinite where the ellipse is a line.
    """
    ok = np.asarray(np.isfinite(covariance_m2).all((-1, -2)))
    P = np.where(ok[..., None, None], covariance_m2, np.eye(2))
    eigenvalues = np.linalg.eigvalsh((P + np.swapaxes(P, -1, -2)) / 2)
    small, large = eigenvalues[..., 0], eigenvalues[..., 1]
    ok &= (small >= -1e-9 * np.abs(large)) & (large > 0)
    small = np.maximum(small, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        aspect = np.sqrt(large / small)
    return np.where(ok, aspect, np.nan), np.where(ok, small + large, np.nan)


def bearings(tracks: xr.Dataset, packets: Packets, navigators: Sequence[int]) -> dict[str, NDArray[Any]]:
    """True bearing from receiver to sender of every packet that one of the navigators received.

    Returns:
        Columns `receiver`, `sender`, `toa_s` and `bearing_deg` (clockwise from north, 0 to 360), a row for
        each arrival, by time; those with unknown positions are left out.
    """
    taken = packets["received"].astype(bool) & np.isin(packets["navigator"], navigators)
    if "bytes" in packets:
        taken &= packets["bytes"] > 0
    columns = ("toa_ns", "tol_ns", "receiver", "sender")
    once = np.unique(np.stack([packets[name][taken] for name in columns]), axis=1)
    toa_ns, tol_ns, receiver, sender = once
    away = position_at(tracks, sender, tol_ns / 1e9) - position_at(tracks, receiver, toa_ns / 1e9)
    known = np.isfinite(away).all(1)
    bearing = heading_from_yaw(np.arctan2(away[known, 1], away[known, 0]))
    return {
        "receiver": receiver[known],
        "sender": sender[known],
        "toa_s": toa_ns[known] / 1e9,
        "bearing_deg": bearing,
    }


def position_at(tracks: xr.Dataset, vehicle: NDArray[np.int64], time_s: Floats) -> Floats:
    """True positions (N, 2), m, of vehicle k at time k; NaN where unknown."""
    time, truth = tracks["time"].values, tracks["truth_position_m"].values
    out = np.full((len(vehicle), 2), np.nan)
    for v in range(len(truth)):
        own = vehicle == v
        for axis in range(2):
            out[own, axis] = np.interp(time_s[own], time, truth[v, :, axis])
    return out


def draw_over_time(
    axes: Axes,
    time: Floats,
    values: Floats,
    navigators: Sequence[int],
    *,
    log: bool,
    limits: tuple[float, float],
) -> None:
    """A line over time for each navigator, in its colour; `values` (navigator of the tracks, time)."""
    for i in navigators:
        axes.plot(time, values[i], color=OKABE_ITO[i % 8], lw=1.2, ls=LINE_STYLES[i % 5])
    axes.set(yscale="log" if log else "linear", ylim=limits, xlim=(time[0], time[-1]))
    if log:
        axes.yaxis.set_major_formatter("{x:g}")
    axes.grid(alpha=0.3, lw=0.6)


def draw_bearings(axes: Axes, heard: Mapping[str, NDArray[Any]], receiver: int) -> None:
    """Bearing to the sender at each reception of one vehicle; the mark is the sender's."""
    own = heard["receiver"] == receiver
    for sender in np.unique(heard["sender"][own]):
        at = own & (heard["sender"] == sender)
        size = 4.5 if at.sum() < 50 else 3.2
        mark = {**sender_mark(int(sender)), "ms": size}
        axes.plot(heard["toa_s"][at], heard["bearing_deg"][at], ls="", zorder=3, **mark)
    axes.set(ylim=(-10, 370), yticks=(0, 90, 180, 270, 360), yticklabels=("N", "E", "S", "W", "N"))
    axes.grid(alpha=0.3, lw=0.6)


def sender_mark(sender: int) -> dict[str, Any]:
    """How a sender's receptions are marked: later ones smaller, so that two at one bearing are both seen."""
    return {
        "marker": MARKERS[sender % 8], "ms": 6.3 - 1.3 * (sender % 4), "mfc": SENDER_GREYS[sender % 4],
        "mec": "#111111", "mew": 0.6,
    }  # fmt: skip


def axis_of(values: Floats, least: float | None) -> tuple[bool, tuple[float, float]]:
    """Logarithmic or not, and limits, of values in all panels of a kind.

    From `least` on, logarithmic where the largest values are more than 12 times the typical one; None:
    logarithmic from the smallest values on.
    """
    finite = values[np.isfinite(values) & (values > 0)]
    bottom = float(np.quantile(finite, 0.002)) / 1.3 if finite.size else 1.0
    most = float(finite.max()) if finite.size else 2.0
    if least is None:
        return True, (bottom, 1.3 * most)
    if finite.size and float(np.quantile(finite, 0.998)) > 12 * float(np.median(finite)):
        return True, (least, 1.3 * most)
    return False, (least, least + 1.08 * max(most - least, 1e-3))
