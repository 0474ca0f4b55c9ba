"""Error over time averaged over a study's runs: mean, quantile band, and how often packets were heard."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.errors import TracksError
from uwcoop.figures.style import DPI, LINE_STYLES, OKABE_ITO, RECEIVED_COLOUR, matplotlib_figure

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

BAND = (0.1, 0.9)
"""Quantiles over the runs between which the band lies."""

MISSED_COLOUR = "#d0d0d0"
MOST_VARIANTS = 4
"""Columns of one picture."""

_LOG_ABOVE = 12.0
_ROW_INCH, _STRIP_INCH = 2.1, 0.16


def errors_over_time_figure(error_series: xr.Dataset, *, title: str) -> Figure:
    """Mean error over the runs and the band between their 10 % and 90 % quantiles, by navigator.

    One row for each vehicle, one column for each variant, all of one scale. Under each row a strip for each
    navigator that communicates: grey where a signal could arrive, dark as high as the share of such
    signals, over the runs, whose packet was used. With one run the line is that run's error.

    Args:
        error_series: dims (variant, run, navigator, vehicle, time) as `uwcoop.evaluation.error_series` describes; at most
            `MOST_VARIANTS` variants.
        title: scenario.

    Raises:
        TracksError: no errors, because the truth is unknown, or too many variants.
    """
    figure_class = matplotlib_figure()
    if error_series.sizes["variant"] > MOST_VARIANTS:
        raise TracksError(
            f"{error_series.sizes['variant']} variants: a picture holds at most {MOST_VARIANTS}"
        )
    mean, low, high = averages(error_series["error_m"].values)
    if np.isnan(mean).all():
        raise TracksError("no run has an error: the truth is unknown")
    talking = [
        i for i in range(error_series.sizes["navigator"]) if error_series["heard"].values[:, :, i].any()
    ]
    rows, columns = error_series.sizes["vehicle"], error_series.sizes["variant"]
    strip_inch = _STRIP_INCH * max(len(talking), 1) + 0.05
    figure = figure_class(
        figsize=(max(11.0, 1.5 + 5.0 * columns), (_ROW_INCH + strip_inch + 0.12) * rows + 1.7),
        dpi=DPI,
        layout="constrained",
    )
    panels = figure.subplots(
        2 * rows, columns, squeeze=False, sharex=True, height_ratios=[_ROW_INCH, strip_inch] * rows
    )
    log, limits = _scale(mean, low, high, error_series)
    for c in range(columns):
        for j, vehicle in enumerate(error_series["vehicle"].values):
            axes, strip = panels[2 * j, c], panels[2 * j + 1, c]
            _draw(axes, error_series, (mean[c, :, j], low[c, :, j], high[c, :, j]))
            axes.set(yscale="log" if log else "linear", ylim=limits)
            if log:
                axes.yaxis.set_major_formatter("{x:g}")
            axes.tick_params(labelbottom=False, labelleft=c == 0)
            axes.set_ylabel(f"{vehicle}\nerror (m)" if c == 0 else "")
            _draw_strip(strip, error_series, talking, c, j, named=c == 0)
        panels[0, c].set_title(_column_title(error_series, c), fontsize=10)
        panels[-1, c].set_xlabel("time (s)")
        panels[-1, c].tick_params(labelbottom=True)
    time = error_series["time"].values
    panels[0, 0].set_xlim(time[0], time[-1])
    _legend(figure, error_series, bool(talking))
    figure.suptitle(f"{title}: error over time, averaged over runs", fontsize=12)
    return figure


def averages(error_m: NDArray[Any]) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Mean and the `BAND` quantiles over the second axis (runs), of those runs that have a value.

    Infinite errors make the mean infinite; NaN where no run has a value.
    """
    values = np.moveaxis(error_m.astype(np.float64), 1, 0)
    known = ~np.isnan(values)
    total = np.where(known, values, 0.0).sum(0)
    mean = np.where(known.any(0), total / np.maximum(known.sum(0), 1), np.nan)
    low, high = quantiles(values, BAND)
    return mean, low, high


def quantiles(values: NDArray[np.float64], shares: Sequence[float]) -> NDArray[np.float64]:
    """Quantiles over the first axis, (shares, ...): linear between order statistics, infinite values at the top.

    NaN are left out; the result is NaN where nothing else is there.
    """
    ordered = np.sort(values, axis=0)  # NaN last
    last = (~np.isnan(values)).sum(0) - 1
    found = []
    for share in shares:
        at = share * np.maximum(last, 0)
        below, above = (
            np.take_along_axis(ordered, edge(at).astype(np.intp)[None], 0)[0] for edge in (np.floor, np.ceil)
        )
        # Between two equal values, infinite ones too, there is nothing to interpolate.
        gap = np.subtract(above, below, out=np.zeros_like(below), where=above != below)
        part = np.multiply(at - np.floor(at), gap, out=np.zeros_like(below), where=gap != 0)
        found.append(np.where(last >= 0, below + part, np.nan))
    return np.stack(found)


def _draw(axes: Axes, error_series: xr.Dataset, lines: tuple[NDArray[np.float64], ...]) -> None:
    time, settle_s = error_series["time"].values, float(error_series.attrs["settle_s"])
    mean, low, high = lines
    axes.axvspan(time[0], settle_s, color="#000000", alpha=0.07, lw=0, zorder=0)
    axes.axvline(settle_s, color="#666666", lw=0.8, ls="--", zorder=1)
    axes.grid(alpha=0.3, lw=0.6)
    alpha = 0.16 if len(mean) < 4 else 0.10
    for i in range(len(mean)):
        colour = OKABE_ITO[i % 8]
        if error_series.sizes["run"] > 1:
            axes.fill_between(time, low[i], high[i], color=colour, alpha=alpha, lw=0, zorder=2)
        axes.plot(time, mean[i], color=colour, lw=1.4, ls=LINE_STYLES[i % 5], zorder=3)


def _draw_strip(
    axes: Axes, error_series: xr.Dataset, talking: list[int], variant: int, vehicle: int, *, named: bool
) -> None:
    """Where signals could arrive in any run, grey; dark from below, as high as the share that was used."""
    axes.set_ylim(0, len(talking) or 1)
    axes.set_yticks([])
    for side in axes.spines.values():
        side.set_visible(False)
    axes.tick_params(bottom=False, labelbottom=False)
    time = error_series["time"].values
    for line, i in enumerate(reversed(talking)):
        arrivals = error_series["arrivals"].values[variant, :, i, vehicle].sum(0, dtype=np.int64)
        heard = error_series["heard"].values[variant, :, i, vehicle].sum(0, dtype=np.int64)
        at = arrivals > 0
        share = heard[at] / arrivals[at]
        width = 1.0 if error_series.sizes["variant"] == 1 else 0.6
        axes.vlines(time[at], line + 0.08, line + 0.92, color=MISSED_COLOUR, lw=width)
        axes.vlines(time[at], line + 0.08, line + 0.08 + 0.84 * share, color=RECEIVED_COLOUR, lw=width)
        if named:
            axes.text(
                -0.006, line + 0.5, str(error_series["navigator"].values[i]), color=OKABE_ITO[i % 8], fontsize=6.5,
                ha="right", va="center", transform=axes.get_yaxis_transform(),
            )  # fmt: skip


def _scale(
    mean: NDArray[np.float64], low: NDArray[np.float64], high: NDArray[np.float64], error_series: xr.Dataset
) -> tuple[bool, tuple[float, float]]:
    """Logarithmic or not, and limits common to all panels."""
    after = error_series["time"].values > float(error_series.attrs["settle_s"])
    after = after if after.any() else np.ones_like(after)

    def finite(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return values[np.isfinite(values)]

    # One variant may be far worse than another, all navigators alike.
    settled = (finite(mean[c, i][..., after]) for c in range(mean.shape[0]) for i in range(mean.shape[1]))
    typical = [float(np.median(errors)) for errors in settled if errors.size] or [1.0]
    top = max([float(part.max()) for part in map(finite, (mean, high)) if part.size] or [1.0])
    if max(typical) > _LOG_ABOVE * max(min(typical), 1e-3):
        bottom = finite(low[..., after])
        bottom = bottom[bottom > 0]
        least = float(np.quantile(bottom, 0.02)) if bottom.size else min(typical) / 10
        return True, (max(least, min(typical) / 20, 0.01), 1.3 * top)
    return False, (0.0, 1.05 * max(top, 1e-3))


def _column_title(error_series: xr.Dataset, variant: int) -> str:
    """Settings of the variant and the number of its runs that are stored."""
    stored, runs = int(error_series["stored"].values[variant].sum()), error_series.sizes["run"]
    count = f"{stored} run{'s' if stored != 1 else ''}"
    if stored != runs:
        count = f"{stored} of {runs} runs"
    settings = str(error_series["variant"].values[variant])
    return f"{settings} ({count})" if settings else count


def _legend(figure: Figure, error_series: xr.Dataset, strips: bool) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = [
        Line2D([], [], color=OKABE_ITO[i % 8], ls=LINE_STYLES[i % 5], lw=1.5, label=str(name))
        for i, name in enumerate(error_series["navigator"].values)
    ]
    if error_series.sizes["run"] > 1:
        share = "–".join(f"{100 * q:g}" for q in BAND)
        handles.append(Patch(facecolor="#777777", alpha=0.3, label=f"{share} % of the runs"))
    handles.append(
        Patch(facecolor="#000000", alpha=0.1, label=f"settling, {error_series.attrs['settle_s']:g} s")
    )
    if strips:
        tick: dict[str, Any] = {"ls": "", "marker": "|", "ms": 8, "mew": 1.4}
        handles += [
            Line2D([], [], color=RECEIVED_COLOUR, label="share of packets used", **tick),
            Line2D([], [], color=MISSED_COLOUR, label="lost or refused", **tick),
        ]
    figure.legend(
        handles=handles, loc="outside lower center", ncols=min(len(handles), 7), fontsize=8, frameon=False,
        handlelength=3.2,
    )  # fmt: skip
