"""What does not fit in a run, in a line each: which sensor or belief to look at."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from uwcoop.experiment.run import RunResult
    from uwcoop.missionlog.labelled import Arrays

__all__ = ["misfit_lines"]

NOISE_FACTOR = 1.5
"""Soundings that are noisier than stated by this factor are told of."""
RANGE_NIS = 3.0
"""Mean squared innovation of ranges over their stated variance, 1 where they are as believed; above this it is told."""
GATED_SHARE = 0.05
"""Share of gated measurements of one kind that is told of."""
ALARMS = 3
"""Alarms of the health monitor in one run that are told of."""
PRIOR_SIGMAS = 4.0
"""A state that ends so many sigmas of its prior from its expected value is told of."""
_FEWEST = 20
"""Ranges below which their statistic says nothing."""


def misfit_lines(result: RunResult) -> list[str]:
    """Lines such as "team: the soundings of V1 (3.0 x) are noisier than their sensor states: …".

    They follow from innovations and counts, which a vehicle has at sea too; truth is not used, but for the length of the
    mission, without which there are no errors.
    """
    lines: list[str] = []
    tracks = result.recorded
    settle_s = float(tracks.attrs["settle_s"])
    end_s = float(tracks["time"].values[-1])
    if end_s <= settle_s:
        lines.append(
            f"the mission lasts {end_s:g} s, not longer than metrics.settle_s, {settle_s:g} s: no "
            "errors are counted; --set metrics.settle_s=0 counts all"
        )
    for k, name in enumerate(tracks["navigator"].values):
        own = tracks.isel(navigator=k)
        for check in (_noisy_soundings, _ranges_that_do_not_fit, _gated, _alarms, _current_beyond_its_prior):
            lines.extend(f"{name}: {line}" for line in check(own, result))
    return lines


def _told(own: Arrays, values: np.ndarray[Any, Any], above: float, form: str) -> str:
    """The vehicles whose value exceeds a bound, with it; empty where there is none."""
    return ", ".join(
        f"{vehicle} ({form.format(value)})"
        for vehicle, value in zip(own["vehicle"].values, values, strict=True)
        if np.isfinite(value) and value > above
    )


def _noisy_soundings(own: Arrays, _: RunResult) -> Iterator[str]:
    if "depth_noise_factor" in own:
        factor = _finite(own["depth_noise_factor"])
        later = factor[:, factor.shape[1] // 2 :]  # at first nothing is learned
        found = _told(own, np.median(later, axis=-1), NOISE_FACTOR, "{:.1f} x")
        if found:
            yield (
                f"the soundings of {found} are noisier than their sensor states: look at the echo sounder, "
                "sensors.water_depth.sigma_m, and the chart's own error"
            )


def _ranges_that_do_not_fit(own: Arrays, _: RunResult) -> Iterator[str]:
    if "range_innovation_m" not in own:
        return
    squares = (_finite(own["range_innovation_m"]) / _finite(own["range_innovation_sigma_m"])) ** 2
    # A range's innovation stands until the next one comes.
    fresh = np.diff(squares, axis=-1, prepend=np.nan) != 0
    squares = np.where(fresh & np.isfinite(squares), squares, np.nan)
    count = np.isfinite(squares).sum(axis=-1)
    mean = np.where(count >= _FEWEST, np.nansum(squares, axis=-1) / np.maximum(count, 1), np.nan)
    found = _told(own, mean, RANGE_NIS, "NIS {:.1f}, 1 expected")
    if found:
        yield (
            f"ranges to {found} do not fit: look at acoustics.clock, the sound speed, late arrivals and "
            "sigma_range_m"
        )


def _gated(own: Arrays, result: RunResult) -> Iterator[str]:
    sounded = result.log.events.get("water_depth")
    vehicles = np.zeros(0, np.int64) if sounded is None else sounded["vehicle"]
    soundings = np.array([np.count_nonzero(np.equal(vehicles, v)) for v in range(len(own["vehicle"].values))])
    for kind, counts, all_of in (
        ("soundings", own.get("gated_soundings"), soundings),
        ("ranges", own.get("gated_ranges"), own["heard"].values.sum(axis=-1)),
    ):
        if counts is None:
            continue
        share = _finite(counts)[:, -1] / np.maximum(all_of, 1)
        found = _told(own, share, GATED_SHARE, "{:.0%}")
        if found:
            yield f"{kind} of {found} contradicted the estimate and were gated: sensor, chart or start differ from belief"


def _alarms(own: Arrays, _: RunResult) -> Iterator[str]:
    if "alarms" in own:
        found = _told(own, _finite(own["alarms"])[:, -1], ALARMS - 0.5, "{:.0f} alarms")
        if found:
            yield f"the health monitor spread the cloud of {found}: look at the chart, its datum and the start"


def _current_beyond_its_prior(own: Arrays, _: RunResult) -> Iterator[str]:
    names = ("current_east_mps", "current_north_mps", "sigma_current_east_mps", "sigma_current_north_mps")
    if not all(name in own for name in names):
        return
    values = [_finite(own[name]) for name in names]
    prior = np.nanmax(np.hypot(values[2], values[3]), axis=-1) / np.sqrt(2)
    sigmas = np.hypot(values[0][:, -1], values[1][:, -1]) / np.where(prior > 0, prior, np.nan)
    found = _told(own, sigmas, PRIOR_SIGMAS, "{:.1f} sigma of its prior")
    if found:
        yield f"the current of {found} is stronger than expected: look at the current, the compass and the thrust"


def _finite(values: Any) -> np.ndarray[Any, Any]:
    return np.asarray(values.values, dtype=np.float64)
