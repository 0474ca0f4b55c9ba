"""Errors of a chart made of soundings: each survey's soundings against the chart made from the others.

The error of such a chart is one field: it keeps its value over some metres, because a survey's position error
and datum hold for a while, and it grows with the slope, because a horizontal error e changes the depth by
slope · e. Both are measured here, and from them follow the two numbers that navigators go by: `sigma_map_m`
(between the robust and the plain standard deviation) and `correlation_length_m`.

Soundings s metres apart whose errors have the autocorrelation ρ count as s / 2∫ρ independent ones, and
navigators count n_c = 2 L / s soundings as one: so L is the integral ∫ρ from 0 on, each survey's own datum
aside, which a navigator estimates anyway. It is somewhat longer than the distance at which ρ falls to one half.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.charts.raster import CORRELATION_LENGTH_M
from uwcoop.charts.surface import blocks, linear_near, medians, robust_sd, spatial
from uwcoop.errors import ChartError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from uwcoop.charts.surface import Triples, Values

LEAST_RESIDUALS = 20
"""Fewer do not judge a chart."""
_FOLDS = 5
_LAG_STEP_M = 2.0
_LONGEST_LAG_M = 100.0
_LEAST_PAIRS = 50
_MOST_PAIRED = 4000
_SLOPE_BINS = 8
_LEAST_IN_BIN = 30
_CLIP_SDS = 4.0
_NOTHING = 0.05
"""An autocorrelation below this is noise."""


@dataclass(frozen=True)
class Residuals:
    """Soundings minus the chart of the others, (M,) each, where that chart has no hole."""

    east_m: Values
    north_m: Values
    residual_m: Values
    fold: NDArray[np.intp]
    """Which survey (or block) was left out."""
    surveys: int
    """How many surveys were left out in turn; 0 for blocks without labels."""
    how: str
    """What was left out, in words."""


@dataclass(frozen=True)
class ResidualReport:
    """A chart's error estimated from residuals, and the quality that follows; lengths in metres.

    `autocorrelation` is pairs of (distance, correlation); `by_slope` pairs of (slope, robust standard
    deviation). Both, the lags, `flat_sd_m` and `horizontal_error_m` are of residuals less their survey's
    median, and None or empty where there is too little to tell.
    """

    how: str
    surveys: int
    count: int
    robust_sd_m: float
    sd_m: float
    datum_sd_m: float | None
    """Spread of the surveys' medians."""
    own_datum_robust_sd_m: float
    """Robust standard deviation less each survey's median."""
    autocorrelation: tuple[tuple[float, float], ...]
    half_lag_m: float | None
    """Where the autocorrelation falls to one half."""
    integral_lag_m: float | None
    """Its integral from 0 to where it first falls to nothing."""
    by_slope: tuple[tuple[float, float], ...]
    flat_sd_m: float | None
    """Where the seabed is level."""
    horizontal_error_m: float | None
    """Effective, on each axis, between a survey and the others: the growth with slope."""
    sigma_map_m: float
    """Proposed."""
    correlation_length_m: float
    """Proposed."""

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        return asdict(self)

    def of_aligned(self) -> ResidualReport:
        """The same of surveys that were shifted until they agreed: their residuals no longer hold what all of
        them share, so the correlation length is not taken as shorter than is usual."""
        return replace(self, correlation_length_m=max(self.correlation_length_m, CORRELATION_LENGTH_M))

    @property
    def new_day_note(self) -> str:
        """One sentence about a day that was not aligned; its datum is a state of navigators."""
        return (
            f"a new day, whose track is not aligned: soundings about its own datum {self.own_datum_robust_sd_m:.2g} m "
            f"(robust), datum {self.datum_sd_m or 0.0:.2g} m, correlation length {self.correlation_length_m:g} m, "
            f"from {self.count:,} residuals {self.how}"
        )

    def notes(self) -> tuple[str, ...]:
        """One sentence for each of the two proposals."""
        length = (
            f"correlation length of the chart's error: {self.correlation_length_m:g} m; the residuals' "
            f"autocorrelation has the integral {self.integral_lag_m:.2g} m and falls to one half at "
            f"{self.half_lag_m:.2g} m"
            if self.half_lag_m is not None
            else f"correlation length of the chart's error: {self.correlation_length_m:g} m, usual for soundings"
        )
        return (
            f"chart error: sigma_map {self.sigma_map_m:g} m from {self.count:,} residuals {self.how} "
            f"(robust {self.robust_sd_m:.2g} m, plain {self.sd_m:.2g} m)",
            length,
        )


def leave_one_out(
    soundings: Triples, survey: ArrayLike | None, *, cell_m: float, max_gap_m: float
) -> Residuals:
    """Soundings of each survey minus the chart of the others.

    Other surveys' soundings tell the most (tide, positioning). With fewer than two labels, blocks of the size
    of the largest gap are left out in turn, which misses what all soundings share.

    Raises:
        ChartError: too few soundings lie close to others.
    """
    folds: list[tuple[Triples, Triples]]
    labels = None if survey is None else np.unique(np.asarray(survey).astype(str), return_inverse=True)[1]
    if labels is not None and labels.max() > 0:
        surveys = int(labels.max()) + 1
        how = f"leaving out one of {surveys} surveys"
        folds = [_fold(soundings, labels == k, cell_m) for k in range(surveys)]
    else:
        surveys, how = 0, f"leaving out blocks of {max_gap_m:g} m"
        folds = _block_folds(medians(*soundings, cell_m), max_gap_m)
    found = [_residuals(test, train, max_gap_m) for test, train in folds if train[0].size >= 4]
    sizes = [part.shape[1] for part in found]
    if sum(sizes) < LEAST_RESIDUALS:
        raise ChartError(
            f"{sum(sizes)} soundings lie close enough to others to judge the chart's error, "
            f"below {LEAST_RESIDUALS}: give sigma_map_m"
        )
    east, north, residual = np.concatenate(found, axis=1)
    return Residuals(east, north, residual, np.repeat(np.arange(len(found)), sizes), surveys, how)


def report(residuals: Residuals, slope: Values | None = None) -> ResidualReport:
    """What residuals say.

    Args:
        residuals: of a chart, as `leave_one_out` gives them.
        slope: (M,) steepness of the seabed at each residual, NaN where unknown; None leaves slopes out.
    """
    value = residuals.residual_m
    robust, plain = robust_sd(value), float(value.std())
    centres = np.array([np.median(value[residuals.fold == k]) for k in np.unique(residuals.fold)])
    own = value - centres[np.unique(residuals.fold, return_inverse=True)[1]]
    lags = autocorrelation(residuals.east_m, residuals.north_m, own, residuals.fold)
    half, integral = _half_and_integral(lags) if residuals.surveys else (None, None)
    bins, flat, horizontal = _slope_growth(own, slope)
    length = CORRELATION_LENGTH_M if integral is None else max(integral, _LAG_STEP_M)
    return ResidualReport(
        how=residuals.how,
        surveys=residuals.surveys,
        count=value.size,
        robust_sd_m=robust,
        sd_m=plain,
        datum_sd_m=float(centres.std(ddof=1)) if residuals.surveys and centres.size > 1 else None,
        own_datum_robust_sd_m=robust_sd(own),
        autocorrelation=lags,
        half_lag_m=half,
        integral_lag_m=integral,
        by_slope=bins,
        flat_sd_m=flat,
        horizontal_error_m=horizontal,
        sigma_map_m=float(f"{np.sqrt(robust * plain):.2g}"),
        correlation_length_m=float(f"{length:.2g}"),
    )


def autocorrelation(
    east_m: Values, north_m: Values, value: Values, group: NDArray[np.intp]
) -> tuple[tuple[float, float], ...]:
    """Correlation of a field with itself over distance, between places of one group: (distance, correlation).

    Values beyond four robust standard deviations are clipped: one stray echo must not make a correlation.
    Large groups are thinned to places drawn from them with a fixed seed.
    """
    bound = _CLIP_SDS * robust_sd(value)
    clipped = np.clip(value, -bound, bound) if bound > 0 else value
    bins = round(_LONGEST_LAG_M / _LAG_STEP_M)
    product, square, count, lag = (np.zeros(bins) for _ in range(4))
    for k in np.unique(group):
        members = np.flatnonzero(group == k)
        if members.size > _MOST_PAIRED:
            members = np.random.default_rng(int(k)).choice(members, _MOST_PAIRED, replace=False)
        points, y = np.column_stack([east_m[members], north_m[members]]), clipped[members]
        pairs = spatial().cKDTree(points).query_pairs(_LONGEST_LAG_M * (1 - 1e-9), output_type="ndarray")
        apart = np.hypot(*(points[pairs[:, 0]] - points[pairs[:, 1]]).T)
        at = (apart / _LAG_STEP_M).astype(np.intp)
        a, b = y[pairs[:, 0]], y[pairs[:, 1]]
        for total, each in ((product, a * b), (square, (a * a + b * b) / 2), (count, None), (lag, apart)):
            total += np.bincount(at, each, bins)
    use = (count >= _LEAST_PAIRS) & (square > 0)
    return tuple(
        (float(x), float(r)) for x, r in zip(lag[use] / count[use], product[use] / square[use], strict=True)
    )


def _half_and_integral(lags: tuple[tuple[float, float], ...]) -> tuple[float | None, float | None]:
    """Distance at which the autocorrelation first falls to one half, and its integral until it is nothing.

    Where it never falls so far, both are up to the longest lag.
    """
    if len(lags) < 2:
        return None, None
    x, r = np.array([(0.0, 1.0), *lags]).T
    below = np.flatnonzero(r < 0.5)
    half = float(x[-1])
    if below.size:
        k = int(below[0])
        half = float(x[k - 1] + (x[k] - x[k - 1]) * (r[k - 1] - 0.5) / (r[k - 1] - r[k]))
    nothing = np.flatnonzero(r < _NOTHING)
    end = int(nothing[0]) + 1 if nothing.size else x.size
    x, r = x[:end], np.maximum(r[:end], 0.0)
    return half, float(np.sum(np.diff(x) * (r[1:] + r[:-1]) / 2))


def _slope_growth(
    own: Values, slope: Values | None
) -> tuple[tuple[tuple[float, float], ...], float | None, float | None]:
    """Robust spread by slope, and the fit σ² = σ_flat² + (slope · e)², neither below zero."""
    if slope is None:
        return (), None, None
    known = np.isfinite(slope)
    own, slope = own[known], slope[known]
    bins = min(_SLOPE_BINS, own.size // _LEAST_IN_BIN)
    if bins < 2:
        return (), None, None
    edges = np.quantile(slope, np.linspace(0, 1, bins + 1))
    which = np.clip(np.searchsorted(edges, slope, side="right") - 1, 0, bins - 1)
    spread = [
        (float(np.sqrt(np.mean(slope[which == k] ** 2))), robust_sd(own[which == k]))
        for k in range(bins)
        if np.count_nonzero(which == k) >= _LEAST_IN_BIN
    ]
    x, y = np.array(spread).T ** 2
    # A variance is known to a share of itself: relative weights, so that steep bins do not rule alone.
    weight = 1 / np.maximum(y, 1e-12)
    growth, level = np.polyfit(x, y, 1, w=weight) if np.ptp(x) > 0 else (0.0, float(y.mean()))
    if growth < 0:
        growth, level = 0.0, float(y.mean())
    elif level < 0:
        growth, level = float(np.sum(weight**2 * x * y) / np.sum(weight**2 * x * x)), 0.0
    return tuple(spread), float(np.sqrt(level)), float(np.sqrt(growth))


def _fold(soundings: Triples, test: NDArray[np.bool_], cell_m: float) -> tuple[Triples, Triples]:
    e, n, z = soundings
    if np.count_nonzero(~test) < 4:
        return (e[test], n[test], z[test]), (e[:0], n[:0], z[:0])
    return (e[test], n[test], z[test]), medians(e[~test], n[~test], z[~test], cell_m)


def _block_folds(reduced: Triples, size_m: float) -> list[tuple[Triples, Triples]]:
    e, n, z = reduced
    block = np.unique(blocks(e, n, size_m), return_inverse=True)[1]
    count = np.bincount(block)
    if count.size < _FOLDS:
        return []
    # Blocks in a drawn order, cut into folds of about as many soundings each.
    order = np.random.default_rng(0).permutation(count.size)
    before = np.cumsum(count[order]) - count[order]
    fold_of = np.empty(count.size, dtype=np.intp)
    fold_of[order] = before * _FOLDS // e.size
    return [
        ((e[test], n[test], z[test]), (e[~test], n[~test], z[~test]))
        for k in range(_FOLDS)
        for test in (fold_of[block] == k,)
    ]


def _residuals(test: Triples, train: Triples, max_gap_m: float) -> Values:
    """Easting, northing and residual, (3, M), of the test soundings where the others' chart has no hole."""
    e, n, z = test
    residual = z - linear_near(train, (e, n), max_gap_m)
    known = np.isfinite(residual)
    return np.stack([e[known], n[known], residual[known]])
