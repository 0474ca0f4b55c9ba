"""A simulated survey: the chart that navigators get, made from a true seabed as real charts are made.

A boat sails lawn mowers over the true seabed and sounds it. Where it believes to be errs in two ways: slowly
along the track (a Gauss-Markov process), and by a shift that holds for a segment of about 900 s. Every survey
has a datum of its own, every sounding its noise. The soundings are then gridded, and the chart's error judged
by leaving one survey out, by the same functions as real soundings. So the chart's error is what real ones have:
one field, correlated over some metres, growing with the slope, with holes between the lines.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.charts.gridding import Gridded, Soundings, grid_and_judge
from uwcoop.charts.raster import Quality
from uwcoop.errors import ChartError
from uwcoop.world.random_streams import Purpose, stream

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from uwcoop.charts.chart import Chart

    Values = NDArray[np.float64]

_TRACK, _SHIFT, _NOISE = range(3)  # parts of a survey's stream: more segments must not move the noise


@dataclass(frozen=True)
class SurveyPlan:
    """How a seabed is surveyed and charted; `scenario.chart.Survey` holds the defaults and the meanings."""

    surveys: int
    line_spacing_m: float
    heading_deg: float
    turn_deg: float
    speed_mps: float
    interval_s: float
    position_sigma_m: float
    position_time_s: float
    segment_s: float
    segment_sigma_m: float
    segment_max_m: float
    sounding_sigma_m: float
    datum_sigma_m: float
    cell_m: float | None
    max_gap_m: float | None
    align: bool
    error_by_slope: bool = False


@dataclass(frozen=True)
class Surveyed:
    """Soundings of a simulated survey, and the truth about them."""

    soundings: Soundings
    true_position_m: Values
    """(N, 2) where each sounding was taken; `soundings` says where it was believed to be."""
    segment: NDArray[np.intp]
    """(N,) segment of each sounding, from 0."""
    shift_m: Values
    """(K, 3) what each segment's believed position (east, north) and depth have too much."""


def sail(seabed: Chart, plan: SurveyPlan, seed: int, *more: int) -> Surveyed:
    """The soundings of all surveys of a plan.

    Args:
        seabed: the truth; soundings over its holes do not come back.
        plan: how to survey it.
        seed: 0 or above; `more` are further names of the draws, such as the mission's seed.

    Raises:
        ChartError: lines too far apart to cross the seabed.
    """
    parts = [_sail_one(seabed, plan, k, seed, more) for k in range(plan.surveys)]
    sizes = [len(part.true) for part in parts]
    if min(sizes) < 2:
        raise ChartError(
            f"survey lines {plan.line_spacing_m:g} m apart give {min(sizes)} soundings on the chart "
            f"{seabed.name!r}: too few, take a smaller chart.survey.line_spacing_m or interval_s"
        )
    counts = np.cumsum([0, *(len(part.shift) for part in parts)])
    east, north, depth = (np.concatenate([part.said[:, i] for part in parts]) for i in range(3))
    return Surveyed(
        Soundings(
            east,
            north,
            depth,
            np.repeat(np.arange(plan.surveys), sizes),
            np.concatenate([part.time_s for part in parts]),
            seabed.origin,
            f"{seabed.name}, surveyed",
            (_note(plan, seabed, sum(sizes)),),
        ),
        np.concatenate([part.true for part in parts]),
        np.concatenate([part.segment + first for part, first in zip(parts, counts, strict=False)]),
        np.concatenate([part.shift for part in parts]),
    )


def surveyed_chart(seabed: Chart, plan: SurveyPlan, seed: int, *more: int) -> Gridded:
    """The chart that a plan's soundings make, with its quality from their own residuals; see `sail`.

    Raises:
        ChartError: too few soundings to make a chart of.
    """
    surveyed = sail(seabed, plan, seed, *more)
    return grid_and_judge(
        surveyed.soundings,
        cell_m=plan.cell_m,
        max_gap_m=plan.max_gap_m,
        align=plan.align,
        quality=Quality(by_slope=plan.error_by_slope),
    )


@dataclass(frozen=True)
class _Sailed:
    true: Values
    said: Values
    """(N, 3) east, north, depth as noted down."""
    time_s: Values
    segment: NDArray[np.intp]
    shift: Values


def _sail_one(seabed: Chart, plan: SurveyPlan, survey: int, seed: int, more: tuple[int, ...]) -> _Sailed:
    track, shifts, noise = (
        stream(seed, survey, Purpose.SURVEY, part, *more) for part in (_TRACK, _SHIFT, _NOISE)
    )
    at, time_s = _lines(seabed, plan, survey, float(track.uniform()))
    error = _gauss_markov(track, time_s, plan.position_sigma_m, plan.position_time_s)
    segment = (time_s // plan.segment_s).astype(np.intp)
    shift = np.empty((int(segment.max(initial=0)) + 1, 3))
    shift[:, :2] = _limited(
        plan.segment_sigma_m * shifts.standard_normal((len(shift), 2)), plan.segment_max_m
    )
    shift[:, 2] = plan.datum_sigma_m * float(noise.standard_normal())
    depth = seabed.depth_at(at) + plan.sounding_sigma_m * noise.standard_normal(len(at))
    said = np.column_stack([at + error, depth]) + shift[segment]
    wet = np.isfinite(depth) & (said[:, 2] > 0)
    return _Sailed(at[wet], said[wet], time_s[wet], segment[wet], shift)


def _lines(seabed: Chart, plan: SurveyPlan, survey: int, phase: float) -> tuple[Values, Values]:
    """Places of the soundings on alternating lines across the seabed, (N, 2), and their times, seconds."""
    west, south, east, north = seabed.extent
    middle = np.array([west + east, south + north]) / 2
    heading = np.deg2rad(plan.heading_deg + survey * plan.turn_deg)
    along, across = (
        np.array([np.sin(heading), np.cos(heading)]),
        np.array([np.cos(heading), -np.sin(heading)]),
    )
    half = np.array([east - west, north - south]) / 2
    reach, width = (float(np.abs(axis) @ half) for axis in (along, across))
    offsets = np.arange(-width + phase * plan.line_spacing_m, width, plan.line_spacing_m)
    step = plan.speed_mps * plan.interval_s
    steps = np.arange(-reach, reach, step)
    places, times, clock = [], [], 0.0
    for k, offset in enumerate(offsets):
        line = middle + offset * across + np.outer(steps if k % 2 == 0 else -steps, along)
        inside = np.all((line >= (west, south)) & (line <= (east, north)), axis=1)
        count = int(inside.sum())
        places.append(line[inside])
        times.append(clock + plan.interval_s * np.arange(count))
        clock += plan.interval_s * count + plan.line_spacing_m / plan.speed_mps
    return np.concatenate([np.zeros((0, 2)), *places]), np.concatenate([np.zeros(0), *times])


def _gauss_markov(rng: np.random.Generator, time_s: Values, sigma_m: float, hold_s: float) -> Values:
    """Errors on two axes with a standard deviation and an exponential correlation in time, (N, 2)."""
    normals = rng.standard_normal((len(time_s), 2))
    keep = np.exp(-np.diff(time_s, prepend=time_s[:1]) / hold_s)
    fresh = np.sqrt(1 - keep**2)
    error = np.empty_like(normals)
    value = normals[0] if len(normals) else np.zeros(2)
    for k in range(len(normals)):
        value = value if k == 0 else keep[k] * value + fresh[k] * normals[k]
        error[k] = value
    return sigma_m * error


def _limited(shift: Values, longest_m: float) -> Values:
    """Shifts, those longer than allowed cut to that length."""
    length = np.hypot(*shift.T)[:, None]
    return np.asarray(shift * np.minimum(1.0, longest_m / np.maximum(length, 1e-12)))


def _note(plan: SurveyPlan, seabed: Chart, count: int) -> str:
    return (
        f"simulated survey of {seabed.name}: {count:,} soundings of {plan.surveys} surveys, lines "
        f"{plan.line_spacing_m:g} m apart; positions err by {plan.position_sigma_m:g} m along the track and "
        f"{plan.segment_sigma_m:g} m by segments of {plan.segment_s:g} s, datums by {plan.datum_sigma_m:g} m"
    )
