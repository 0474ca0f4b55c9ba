"""Information gain at receptions against the error after them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from uwcoop.errors import TracksError
from uwcoop.evaluation import metrics
from uwcoop.figures.style import DPI, MARKERS, OKABE_ITO, matplotlib_figure

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

AFTER_S = 5.0
"""The error is the mean over so many seconds after the reception: the air time and a few soundings."""
BINS = 10
UPDATES = "updates_information_nat"
_LEAST_IN_BIN = 5
_MOST_POINTS = 3000
_LOG_ABOVE = 12.0


class Gain(NamedTuple):
    """Receptions of one navigator in one row: information gain, nat, and mean error afterwards, m."""

    navigator: int
    heard_by: int
    """The navigator whose receptions these are: its own, or another's for one that does not listen."""
    information_nat: NDArray[np.float64]
    error_m: NDArray[np.float64]


def information_figure(tracks: xr.Dataset, *, title: str) -> Figure:
    """Mean error in the seconds after a reception, or a measurement update, by how much information it gave.

    With `updates_information_nat` every navigator is drawn at its own updates, each with its own information (Fig. 8 of
    Tan, Chitre & Hover 2016); else at receptions.

    Points are receptions; large marks are their means in bins of equal counts, with the standard error of
    the mean. A navigator that never hears anything is drawn, dashed, at the receptions of the best that
    does: the same instants of the same missions without ranges.

    Args:
        tracks: dims (navigator, vehicle, time), or further ones before `navigator` for many runs, with
            `mutual_information` in nat, NaN where nothing was heard; the error is its `error_m`, or that of
            `metrics.errors`.
        title: mission or scenario.

    Raises:
        TracksError: no information gain in the tracks, or no truth.
    """
    figure_class = matplotlib_figure()
    gains = gains_of(tracks)
    figure = figure_class(figsize=(8.5, 5.8), dpi=DPI, layout="constrained")
    axes = figure.subplots()
    rng = np.random.default_rng(0)  # which points are drawn where there are too many
    for gain in gains:
        _draw(axes, gain, [str(name) for name in tracks["navigator"].values], rng)
    errors = [gain.error_m[np.isfinite(gain.error_m)] for gain in gains]
    typical = [float(np.median(e)) for e in errors if e.size]
    if max(typical) > _LOG_ABOVE * max(min(typical), 1e-3):
        every = np.concatenate(errors)
        axes.set_yscale("log")
        axes.set_ylim(max(float(np.quantile(every, 0.002)), 0.01), 1.3 * float(every.max()))
        axes.yaxis.set_major_formatter("{x:g}")
    else:
        axes.set_ylim(0, 1.1 * float(np.quantile(np.concatenate(errors), 0.995)))
    gained = np.concatenate([gain.information_nat for gain in gains])
    low, high = np.quantile(gained, [0.005, 0.99])
    pad = 0.04 * max(float(high - low), 1e-3)
    axes.set_xlim(float(low) - pad, float(high) + pad)
    axes.grid(alpha=0.3, lw=0.6)
    what = "a measurement update" if UPDATES in tracks else "a reception"
    axes.set(
        xlabel=f"information that {what} gave about the position (nat)",
        ylabel=f"mean error in the {AFTER_S:g} s after it (m)",
    )
    figure.legend(
        loc="outside lower center",
        ncols=3 if len(gains) < 4 else 2,
        fontsize=8,
        frameon=False,
        handlelength=3,
    )
    pooled = "" if tracks.sizes.get("variant", 1) == 1 else " (all variants)"
    figure.suptitle(f"{title}{pooled}: information of {what} against error", fontsize=12)
    return figure


def gains_of(tracks: xr.Dataset) -> list[Gain]:
    """Every navigator's receptions after settling, with their information gain and the error afterwards.

    Raises:
        TracksError: no information gain in the tracks, or no truth.
    """
    order = ("navigator", ..., "time")
    if UPDATES in tracks:
        gained = _of_updates(tracks[UPDATES].transpose(*order).values.astype(np.float64))
    elif "mutual_information" in tracks:
        gained = tracks["mutual_information"].transpose(*order).values.astype(np.float64)
    else:
        raise TracksError(
            "no information gain is recorded: set diagnostics.entropy = at_updates or at_reception"
        )
    error = tracks["error_m"] if "error_m" in tracks else metrics.errors(tracks)
    after = _mean_after(error.transpose(*order).values.astype(np.float64), tracks["time"].values)
    settled = tracks["time"].values > float(tracks.attrs["settle_s"])
    heard = np.isfinite(gained) & settled
    usual = [float(np.median(e)) if (e := after[i][heard[i] & ~np.isnan(after[i])]).size else np.inf
             for i in range(len(gained))]  # fmt: skip
    talking = [i for i in range(len(gained)) if heard[i].any()]
    gains = []
    for i in range(len(gained)):
        by = i if i in talking else min(talking, key=lambda k: usual[k], default=i)
        at = heard[by] & np.isfinite(after[i])
        if at.any():
            gains.append(Gain(i, by, gained[by][at], after[i][at]))
    if not gains:
        raise TracksError("no reception after settling has both an information gain and a known error")
    return gains


def _of_updates(total_nat: NDArray[np.float64]) -> NDArray[np.float64]:
    """What the updates since the instant before told; NaN where there were none."""
    gained = np.diff(total_nat, axis=-1, prepend=np.nan)
    return np.where(gained == 0, np.nan, gained)


def binned(
    information_nat: NDArray[np.float64], error_m: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Mean gain, mean error and the standard error of that mean in at most `BINS` bins of equal counts."""
    count = int(np.clip(len(error_m) // _LEAST_IN_BIN, 1, BINS))
    parts = np.array_split(np.argsort(information_nat, kind="stable"), count)
    spread = [error_m[p].std(ddof=1) / np.sqrt(len(p)) if len(p) > 1 else 0.0 for p in parts]
    return (
        np.array([information_nat[p].mean() for p in parts]),
        np.array([error_m[p].mean() for p in parts]),
        np.array(spread),
    )


def _mean_after(error_m: NDArray[np.float64], time: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean over the instants in (t, t + AFTER_S] for each instant t, (..., time).

    NaN at the end and where one of the errors is not known or infinite.
    """
    first = np.searchsorted(time, time, side="right")
    stop = np.searchsorted(time, time + AFTER_S, side="right")

    def summed(values: NDArray[Any]) -> NDArray[np.float64]:
        total = np.concatenate([np.zeros((*values.shape[:-1], 1)), np.cumsum(values, axis=-1)], axis=-1)
        return np.asarray(total[..., stop] - total[..., first])

    unknown = ~np.isfinite(error_m)
    whole = (summed(unknown) == 0) & (stop > first)
    return np.where(whole, summed(np.where(unknown, 0.0, error_m)) / np.maximum(stop - first, 1), np.nan)


def _draw(axes: Axes, gain: Gain, names: list[str], rng: np.random.Generator) -> None:
    colour, marker = OKABE_ITO[gain.navigator % 8], MARKERS[gain.navigator % 8]
    own = gain.navigator == gain.heard_by
    x, y = gain.information_nat, gain.error_m
    some = rng.permutation(len(x))[:_MOST_POINTS]
    size, alpha = (3, 0.3) if len(x) > 500 else (6, 0.5)
    axes.plot(x[some], y[some], ls="", marker=".", ms=size, mew=0, color=colour, alpha=alpha, zorder=2)
    label = f"{names[gain.navigator]} ({len(x)} times)" if own else (
        f"{names[gain.navigator]} at the receptions of {names[gain.heard_by]}"
    )  # fmt: skip
    mean_x, mean_y, spread = binned(x, y)
    style: dict[str, Any] = {"ls": "-" if own else (0, (5, 2)), "lw": 1.3, "marker": marker, "ms": 6.5}
    axes.errorbar(
        mean_x, mean_y, spread, color=colour, mfc=colour if own else "white", mec="#111111", mew=0.8,
        capsize=2.5, elinewidth=1.0, label=label, zorder=4, **style,
    )  # fmt: skip
