"""How a day that no chart has seen will fit: each survey left out of the alignment too, its soundings as they are.

A chart of aligned surveys fits its own surveys well, since each was moved until it did. A mission's track is not
moved: its positions and its datum are off as a survey's were before. So each survey in turn is left out of the
soundings *and* of the alignment, which begins from the one of all and takes one sweep, and its raw soundings are
compared with the chart of the others.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from uwcoop.charts.alignment import Alignment, align_segments
from uwcoop.charts.residuals import LEAST_RESIDUALS, Residuals
from uwcoop.charts.surface import linear_near, medians
from uwcoop.errors import ChartError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from uwcoop.charts.surface import Triples

_LEAST_TRAINED = 4


def new_day_residuals(
    soundings: Triples, survey: ArrayLike, alignment: Alignment, *, cell_m: float, max_gap_m: float
) -> Residuals:
    """Raw soundings of each survey minus the chart of the others, aligned without it.

    Args:
        soundings: eastings, northings and depths before alignment, (N,) metres.
        survey: (N,) labels; two at least.
        alignment: of all of them.
        cell_m, max_gap_m: of the chart.

    Raises:
        ChartError: too few soundings lie close to others.
    """
    labels = np.unique(np.asarray(survey).astype(str), return_inverse=True)[1]
    parts, folds = [], []
    for k in range(int(labels.max()) + 1):
        others, own = labels != k, labels == k
        if np.count_nonzero(others) < _LEAST_TRAINED:
            continue
        rest = tuple(values[others] for values in soundings)
        kept, segment = np.unique(alignment.segment[others], return_inverse=True)
        start = Alignment(segment, alignment.shift_m[kept], np.nan, np.nan, alignment.limit_m)
        aligned = align_segments(
            (rest[0], rest[1], rest[2]), segment, cell_m=cell_m, max_gap_m=max_gap_m, start=start, sweeps=1
        )
        chart = medians(*aligned.applied((rest[0], rest[1], rest[2])), cell_m)
        east, north, depth = (values[own] for values in soundings)
        residual = depth - linear_near(chart, (east, north), max_gap_m)
        known = np.isfinite(residual)
        parts.append(np.stack([east[known], north[known], residual[known]]))
        folds.append(np.full(int(known.sum()), k, dtype=np.intp))
    count = sum(part.shape[1] for part in parts)
    if count < LEAST_RESIDUALS:
        raise ChartError(
            f"{count} raw soundings lie close enough to other surveys to judge a new day, below {LEAST_RESIDUALS}: "
            "give sigma_map_m"
        )
    east, north, residual = np.concatenate(parts, axis=1)
    return Residuals(
        east,
        north,
        residual,
        np.concatenate(folds),
        int(labels.max()) + 1,
        "of surveys left out of the alignment too",
    )
