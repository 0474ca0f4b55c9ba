"""Segments of surveys shifted until crossing soundings agree.

A receiver's position error holds for minutes, and tide and draught for longer: soundings of one quarter of an
hour err together, by up to fifteen metres and some decimetres. Each such segment gets one shift (east, north,
down). One segment after the other is laid on the chart of all others: over a disc of shifts, the one with the
best agreement is

    min over s of  n Σ_i w ln(1 + (r_i(s) − m(s))² / (ν σ²)) (ν + 1)/2 + |s|²/(2 σ_s²),   r_i(s) = z_i − h(p_i + s),

with m the median (the shift down), n the number of places of ten metres that the segment touches (neighbouring
soundings say the same) and w = 1/(number of soundings). A segment moves only where that gains a nat, and sweeps over
all segments repeat until none moves. Shifts that do not make the soundings agree better by a twentieth are not kept, so
soundings that were aligned stay where they are. Where two in a hundred segments
end at the limit of the search, it is widened. What all segments share cannot be seen and stays: the robust mean of their
shifts is zero, which one segment more or less hardly moves.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.charts.chart import bilinear_depth
from uwcoop.charts.surface import distance, medians, robust_mean, robust_sd, spatial

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from uwcoop.charts.surface import Triples, Values

    Segments = NDArray[np.intp]

SEGMENT_S = 900.0
"""A survey's shift is taken as constant over so many seconds."""
FARTHEST_M, MOST_M = 15.0, 60.0
"""Shifts beyond the first are not looked for, unless segments end there; beyond the second never."""
AT_LIMIT_SHARE = 0.02
LEAST_AT_LIMIT = 2
"""With this share of segments at the limit, and as many, it is widened."""
SIGMA_SHIFT_M = 5.0
"""Standard deviation of a shift on each axis, before anything is known."""
_STEP_M = 3.0
_POLISH_M = (1.5, 0.75, 0.4)
_SWEEPS = 8
_NEAR_LIMIT_M = 3.0
_STILL_M = 0.1
_WIDER = 1.5
_GAIN_NAT = 1.0
"""A segment moves only to where it agrees better by this."""
_STEADY_SDS = 3.0
"""A level whose change is below so many of its standard errors stays."""
_BETTER = 0.95
"""Shifts are kept where the robust standard deviation falls to this share."""
_DOF = 4.0
_LEAST_SIGMA_M = 0.02
_LEAST_OVERLAP = 30
_OVERLAP_SHARE = 0.6
_MOST_SEARCHED = 500
_PLACE_M = 10.0
_NEIGHBOURS = 10
_PLANE_REACH_M = 4.0
_RIDGE_M2 = 2.0


@dataclass(frozen=True)
class Alignment:
    """What was added to each segment's positions and depths."""

    segment: Segments
    """(N,) segment of each sounding, from 0."""
    shift_m: Values
    """(K, 3) east, north and down."""
    before_m: float
    """Robust standard deviation of soundings against the other segments' chart as they were."""
    after_m: float
    """The same after the shifts."""
    limit_m: float = FARTHEST_M
    """Shifts were looked for up to here."""
    at_limit: int = 0
    """Segments whose shift ends there."""

    def applied(self, soundings: Triples) -> Triples:
        """Soundings with their segments' shifts."""
        e, n, z = (
            values + moved for values, moved in zip(soundings, self.shift_m[self.segment].T, strict=True)
        )
        return e, n, z

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON: sizes of the shifts, and the agreement before and after."""
        length = np.hypot(*self.shift_m[:, :2].T)
        return {
            "segments": len(self.shift_m),
            "segment_s": SEGMENT_S,
            "median_shift_m": float(np.median(length)),
            "largest_shift_m": float(length.max()),
            "down_sd_m": float(self.shift_m[:, 2].std()),
            "limit_m": self.limit_m,
            "at_limit": self.at_limit,
            "before_m": None if np.isnan(self.before_m) else self.before_m,
            "after_m": None if np.isnan(self.after_m) else self.after_m,
        }

    @property
    def note(self) -> str:
        """One sentence."""
        largest = float(np.hypot(*self.shift_m[:, :2].T).max())
        return (
            f"{len(self.shift_m)} segments of {SEGMENT_S:g} s shifted by up to {largest:.1f} m: soundings against "
            f"the other segments' chart from {self.before_m:.2g} to {self.after_m:.2g} m (robust); "
            f"{self.at_limit} of them end at the limit of {self.limit_m:g} m"
        )


def segments_of(survey: ArrayLike | None, time_s: ArrayLike | None, count: int) -> Segments:
    """Segment of each of `count` soundings, (N,): every 900 s of each survey is one, numbered from 0.

    Without times, a sounding a second in the order given.
    """
    labels = np.zeros(count, dtype=np.intp)
    if survey is not None:
        labels = np.unique(np.asarray(survey).astype(str), return_inverse=True)[1].astype(np.intp)
    quarter = np.zeros(count, dtype=np.int64)
    for k in range(int(labels.max()) + 1):
        members = np.flatnonzero(labels == k)
        seconds = (
            np.arange(members.size, dtype=np.float64)
            if time_s is None
            else np.asarray(time_s, dtype=np.float64)[members]
        )
        quarter[members] = (seconds - seconds.min()) // SEGMENT_S
    pairs = np.column_stack([labels, quarter])
    return np.asarray(np.unique(pairs, axis=0, return_inverse=True)[1]).ravel().astype(np.intp)


def align_segments(
    soundings: Triples,
    segment: Segments,
    *,
    cell_m: float,
    max_gap_m: float,
    start: Alignment | None = None,
    sweeps: int = _SWEEPS,
) -> Alignment:
    """One shift for each segment.

    Args:
        soundings: eastings, northings and depths, (N,) metres.
        segment: (N,) numbers from 0, as `segments_of` gives them.
        cell_m: medians of cells of this size make the surface of the other segments.
        max_gap_m: that surface reaches no farther from a sounding.
        start: shifts of these segments to begin from, near which they stay; None: none, and a limit that is widened until
            few segments end there.
        sweeps: over all segments, at most.
    """
    still = np.zeros(int(segment.max()) + 1, dtype=bool)
    if start is not None:
        return _aligned(soundings, segment, (cell_m, max_gap_m), start.shift_m, start.limit_m, still, sweeps)
    limit_m, shift_m, search = FARTHEST_M, np.zeros((still.size, 3)), ~still
    before_m: float | None = None
    while True:
        found = _aligned(soundings, segment, (cell_m, max_gap_m), shift_m, limit_m, search, sweeps)
        if before_m is None and not found.after_m <= _BETTER * found.before_m:
            return replace(found, shift_m=0 * found.shift_m, after_m=found.before_m, at_limit=0)
        few = found.at_limit < max(AT_LIMIT_SHARE * len(found.shift_m), LEAST_AT_LIMIT)
        before_m = found.before_m if before_m is None else before_m
        if few or limit_m >= MOST_M:
            return replace(found, before_m=before_m)
        search = np.hypot(*found.shift_m[:, :2].T) > limit_m - _NEAR_LIMIT_M
        limit_m, shift_m = min(_WIDER * limit_m, MOST_M), found.shift_m


def _aligned(
    soundings: Triples,
    segment: Segments,
    size_m: tuple[float, float],
    start_m: Values,
    limit_m: float,
    search: NDArray[np.bool_],
    sweeps: int,
) -> Alignment:
    """Sweeps over all segments, from some shifts on, none farther than the limit."""
    count = int(segment.max()) + 1
    members = [np.flatnonzero(segment == k) for k in range(count)]
    original = np.stack(soundings, axis=1)
    shift = start_m.copy()
    moved = original + shift[segment]
    before: list[Values] = []
    sigma, at_limit = np.inf, 0
    for sweep in range(sweeps):
        was, at_limit = shift.copy(), 0
        residuals, searched = [], []
        for k, own in enumerate(members):
            surface = _Surface.around(original[own], np.delete(moved, own, axis=0), *size_m, limit_m)
            if surface is None:
                continue
            start = surface.residual(original[own], shift[k])
            if np.isfinite(start).sum() < _LEAST_OVERLAP:
                continue
            if sweep == 0:
                before.append(start[np.isfinite(start)])
            scale = max(min(sigma, robust_sd(start[np.isfinite(start)])), _LEAST_SIGMA_M)
            shift[k] = _best_shift(surface, original[own], shift[k], scale, limit_m, bool(search[k]))
            at_limit += int(np.hypot(*shift[k, :2]) > limit_m - _POLISH_M[-1])
            moved[own] = original[own] + shift[k]
            searched.append(k)
            end = surface.residual(original[own], shift[k]) + shift[k, 2]
            residuals.append(end[np.isfinite(end)])
        if not residuals:
            return Alignment(segment, shift, np.nan, np.nan, limit_m)
        sigma = robust_sd(np.concatenate(residuals))
        weights = np.array([members[k].size for k in searched], dtype=np.float64)
        still = np.abs(shift - was)[:, :2].max() < _STILL_M
        if not still or sweep == 0:
            shift[searched] -= robust_mean(shift[searched], weights)
        moved = original + shift[segment]
        if still:
            break
    return Alignment(segment, shift, robust_sd(np.concatenate(before)), sigma, limit_m, at_limit)


@dataclass(frozen=True)
class _Surface:
    """The chart of the others around one segment, for lookups by the thousand."""

    grid: Values
    east0_m: float
    north0_m: float
    cell_m: float

    @classmethod
    def around(
        cls, own: Values, others: Values, cell_m: float, max_gap_m: float, limit_m: float
    ) -> _Surface | None:
        """None where no others are near."""
        low, high = own[:, :2].min(axis=0) - limit_m - cell_m, own[:, :2].max(axis=0) + limit_m + cell_m
        reach = max_gap_m + cell_m
        near = np.all((others[:, :2] > low - reach) & (others[:, :2] < high + reach), axis=1)
        if np.count_nonzero(near) < _LEAST_OVERLAP:
            return None
        e, n = np.meshgrid(*(np.arange(a, b + cell_m, cell_m) for a, b in zip(low, high, strict=True)))
        # Only nodes that the segment can reach: a long line's box is mostly empty.
        reachable = _within(own[:, :2], (e, n), limit_m + 2 * cell_m)
        grid = np.full(e.shape, np.nan)
        grid[reachable] = _planes(
            medians(others[near, 0], others[near, 1], others[near, 2], cell_m),
            np.column_stack([e[reachable], n[reachable]]),
            max_gap_m,
        )
        return cls(grid, float(low[0]), float(low[1]), cell_m) if np.isfinite(grid).any() else None

    def residual(self, own: Values, shift: Values) -> Values:
        """Depths less the surface at the shifted positions, (n,); NaN where there is none."""
        at = own[:, :2] + shift[:2]
        return np.asarray(own[:, 2] - bilinear_depth(self.grid, self.east0_m, self.north0_m, self.cell_m, at))


def _planes(known: Triples, at: Values, max_gap_m: float) -> Values:
    """Depth at places (M, 2) by a plane through the nearest soundings, (M,); NaN where none is near.

    Triangles would do, but finding them for thousands of places of a hundred segments takes minutes.
    """
    e, n, z = known
    apart, index = (
        spatial().cKDTree(np.column_stack([e, n])).query(at, k=_NEIGHBOURS, distance_upper_bound=max_gap_m)
    )
    found = np.isfinite(apart)
    index = np.where(found, index, 0)
    weight = np.where(found, np.exp(-0.5 * (np.where(found, apart, 0.0) / _PLANE_REACH_M) ** 2), 0.0)
    total = np.maximum(weight.sum(axis=1), 1e-12)
    x, y, depth = (
        np.where(found, a[index] - b[:, None], 0.0)
        for a, b in ((e, at[:, 0]), (n, at[:, 1]), (z, 0 * at[:, 0]))
    )
    mean = [(weight * a).sum(axis=1) / total for a in (x, y, depth)]
    dx, dy, dz = (a - m[:, None] for a, m in zip((x, y, depth), mean, strict=True))
    xx, yy, xy, xz, yz = (
        (weight * a * b).sum(axis=1) for a, b in ((dx, dx), (dy, dy), (dx, dy), (dx, dz), (dy, dz))
    )
    # Soundings on one line do not tell the slope across it: a little ridge leaves that level.
    xx, yy = xx + _RIDGE_M2, yy + _RIDGE_M2
    scale = xx * yy - xy**2
    slope = (yy * xz - xy * yz) / scale, (xx * yz - xy * xz) / scale
    plane = mean[2] - slope[0] * mean[0] - slope[1] * mean[1]
    return np.asarray(np.where(found[:, 0], plane, np.nan))


def _within(points: Values, at: tuple[Values, Values], reach_m: float) -> NDArray[np.bool_]:
    """Which places lie within `reach_m` of one of the points."""
    return np.asarray(np.isfinite(distance((points[:, 0], points[:, 1]), at, reach_m)))


def _best_shift(
    surface: _Surface, own: Values, start: Values, sigma_m: float, limit_m: float, search: bool
) -> Values:
    """The shift (east, north, down) at which one segment agrees best with the surface; `start` unless that gains."""
    thinned = own[:: -(-len(own) // _MOST_SEARCHED)]
    places = len(np.unique(np.floor(thinned[:, :2] / _PLACE_M), axis=0))
    offsets = np.arange(-limit_m, limit_m + _STEP_M / 2, _STEP_M)
    grid = np.stack(np.meshgrid(offsets, offsets), axis=-1).reshape(-1, 2)
    candidates = np.vstack([start[None, :2], grid[np.hypot(*grid.T) <= limit_m][: None if search else 0]])

    def tried(shifts: Values) -> list[tuple[float, int]]:
        return [_score(surface.residual(thinned, s), s, sigma_m, places) for s in shifts]

    first = tried(candidates)
    most = max(found for _, found in first)
    costs = [cost if found >= _OVERLAP_SHARE * most else np.inf for cost, found in first]
    best, cost, stays = candidates[int(np.argmin(costs))], min(costs), costs[0]
    ring = np.array([(a, b) for a in (-1, 0, 1) for b in (-1, 0, 1) if (a, b) != (0, 0)])
    for step in _POLISH_M:
        while True:
            around = best + step * ring
            costs = [
                c if found >= _OVERLAP_SHARE * most and np.hypot(*s) <= limit_m else np.inf
                for (c, found), s in zip(tried(around), around, strict=True)
            ]
            if min(costs) >= cost:
                break
            best, cost = around[int(np.argmin(costs))], min(costs)
    if cost > stays - _GAIN_NAT:
        best = start[:2]
    residual = surface.residual(own, best)
    down = -float(np.median(residual[np.isfinite(residual)]))
    if abs(down - start[2]) < _STEADY_SDS * sigma_m / np.sqrt(places):
        down = float(start[2])
    return np.array([*best, down])


def _score(residual: Values, shift: Values, sigma_m: float, places: int) -> tuple[float, int]:
    """Negative log-posterior of a shift, and how many soundings it rests on."""
    known = residual[np.isfinite(residual)]
    if not known.size:
        return np.inf, 0
    misfit = (known - np.median(known)) / sigma_m
    fit = (_DOF + 1) / 2 * float(np.mean(np.log1p(misfit**2 / _DOF)))
    prior = float(shift[0] ** 2 + shift[1] ** 2) / (2 * SIGMA_SHIFT_M**2)
    return places * fit + prior, known.size
