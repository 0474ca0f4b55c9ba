"""The pictures of a study: which its data allow, and why the others are not drawn."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from uwcoop.errors import TracksError
from uwcoop.figures.averages import MOST_VARIANTS, errors_over_time_figure
from uwcoop.figures.boxes import boxes_figure
from uwcoop.figures.bytes import bytes_figure
from uwcoop.figures.information import information_figure

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

NO_TRACES = "no errors over time are stored: the missions were flown without --figures"


def study_figures(
    rows: Sequence[Mapping[str, Any]],
    keys: Sequence[str] = (),
    error_series: xr.Dataset | None = None,
    *,
    title: str,
    settle_s: float,
) -> Iterator[tuple[str, Figure | str]]:
    """File name and picture of each, or the reason why it is not drawn; made one by one as they are asked for.

    `boxes.png`, `bytes.png`, `errors_over_time.png` (and `errors_over_time-2.png` … for every further four variants) and
    `information.png`. Pictures of one mission (`covariance.png`, `traffic.png`) are a run's.

    Args:
        rows: `metrics.row_columns` and the varied keys.
        keys: dotted keys that are varied.
        error_series: what `uwcoop.evaluation.error_series.gather` gives.
        title: scenario.
        settle_s: errors count from here on, s.
    """
    yield "boxes.png", _or_reason(lambda: boxes_figure(rows, keys, title=title, settle_s=settle_s))
    yield "bytes.png", _or_reason(lambda: bytes_figure(rows, keys, title=title))
    if error_series is None:
        yield "errors_over_time.png", NO_TRACES
        yield "information.png", NO_TRACES
        return
    for first in range(0, error_series.sizes["variant"], MOST_VARIANTS):
        part = error_series.isel(variant=slice(first, first + MOST_VARIANTS))
        page = f"-{first // MOST_VARIANTS + 1}" if first else ""
        yield (
            f"errors_over_time{page}.png",
            _or_reason(lambda p=part: errors_over_time_figure(p, title=title)),
        )
    yield "information.png", _or_reason(lambda: information_figure(error_series, title=title))


def _or_reason(draw: Any) -> Figure | str:
    try:
        figure: Figure = draw()
    except TracksError as reason:
        return str(reason)
    return figure
