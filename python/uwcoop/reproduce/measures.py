"""Numbers of flown missions by name, as the manifests ask for them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.errors import ScenarioError
from uwcoop.evaluation import metrics

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

__all__ = ["MEASURES", "measure"]

DRAWS = 2000
"""Of a bootstrap."""


def measure(name: str, flown: Any, arguments: dict[str, Any]) -> float:
    """The number of one check.

    Raises:
        ScenarioError: no such measure.
    """
    if name not in MEASURES:
        raise ScenarioError(f"measure {name!r} is unknown: there are {', '.join(sorted(MEASURES))}")
    return float(MEASURES[name](flown, **arguments))


def pooled(study: Any, navigator: str, column: str, where: dict[str, Any] | None = None) -> float:
    """A column of a study's summary: a navigator's, of the variant that has these settings."""
    wanted = where or {}
    for variant in study.summary["variants"]:
        if all(variant["set"].get(key) == value for key, value in wanted.items()):
            value = variant["navigators"][navigator][column]
            return float("nan") if value is None else float(value)
    raise ScenarioError(f"no variant of the study has {wanted}")


def ratio(study: Any, navigator: str, to: str, column: str, where: dict[str, Any] | None = None) -> float:
    """One navigator's column over another's."""
    return pooled(study, navigator, column, where) / pooled(study, to, column, where)


def variants_ratio(
    study: Any, navigator: str, column: str, where: dict[str, Any], to: dict[str, Any]
) -> float:
    """A column of one variant over that of another."""
    return pooled(study, navigator, column, where) / pooled(study, navigator, column, to)


def ratio_high(study: Any, navigator: str, to: str, column: str) -> float:
    """Upper end of the 95 % interval of one navigator's median over another's, by drawing the runs anew (bootstrap)."""
    by: dict[str, dict[int, list[float]]] = {navigator: {}, to: {}}
    for row in study.rows:
        if row["navigator"] in by:
            by[row["navigator"]].setdefault(row["seed"], []).append(row[column])
    own, other = (np.array([values for _, values in sorted(by[name].items())]) for name in (navigator, to))
    drawn = np.random.default_rng(0).integers(0, len(own), (DRAWS, len(own)))
    return float(np.quantile([np.median(own[at]) / np.median(other[at]) for at in drawn], 0.975))


def share_worse(study: Any, navigator: str, than: str, column: str = "final_error_m") -> float:
    """Share of runs and vehicles in which a navigator has the larger value."""
    by = {
        name: {(row["seed"], row["vehicle"]): row[column] for row in study.rows if row["navigator"] == name}
        for name in (navigator, than)
    }
    pairs = [(value, by[than][key]) for key, value in by[navigator].items() if key in by[than]]
    return float(np.mean([own > other for own, other in pairs]))


def vehicles_rmse(study: Any, navigator: str, vehicles: Sequence[str]) -> float:
    """Median over runs and these vehicles of the RMS error, m."""
    own = [row for row in study.rows if row["navigator"] == navigator and row["vehicle"] in vehicles]
    return float(np.median([row["rmse_m"] for row in own]))


def difference(run: Any, navigator: str, reference: str, window_s: Sequence[float]) -> float:
    """Largest difference of two navigators' positions at the times of arrival, m."""
    pair = run.tracks.sel(navigator=[navigator, reference])
    time = pair["time"].values
    at = pair["heard"].values.all(axis=0) & (time >= window_s[0]) & (time < window_s[1])
    off = pair["position_m"].values[0] - pair["position_m"].values[1]
    apart = np.hypot(off[..., 0], off[..., 1])[at]
    return float(apart.max()) if apart.size else float("nan")


def rms_error(run: Any, navigator: str, vehicle: str | None = None) -> float:
    """RMS distance of a run after settling, m."""
    error = metrics.errors(run.tracks).sel(navigator=navigator)
    if vehicle is not None:
        error = error.sel(vehicle=vehicle)
    settled = run.tracks["time"].values > float(run.tracks.attrs["settle_s"])
    return float(np.sqrt(np.nanmean(error.transpose(..., "time").values[..., settled] ** 2)))


def error_ratio(run: Any, navigator: str, to: str, vehicle: str | None = None) -> float:
    """RMS error of one navigator over another's."""
    return rms_error(run, navigator, vehicle) / rms_error(run, to, vehicle)


def largest_error(run: Any, navigator: str) -> float:
    """Largest distance of a run after settling, m."""
    error = metrics.errors(run.tracks).sel(navigator=navigator).transpose(..., "time").values
    return float(np.nanmax(error[..., run.tracks["time"].values > float(run.tracks.attrs["settle_s"])]))


def sigma(run: Any, navigator: str, vehicle: str) -> float:
    """Mean of the position sigma (root of the trace) that a navigator states for a vehicle, m."""
    covariance = run.tracks["covariance_m2"].sel(navigator=navigator, vehicle=vehicle).values
    trace = np.trace(covariance, axis1=-2, axis2=-1)
    return float(np.sqrt(trace[np.isfinite(trace)]).mean())


def sigma_apart(run: Any, navigator: str, reference: str, vehicle: str) -> float:
    """Largest relative difference of two stated sigmas at the times of arrival."""
    both = run.tracks.sel(navigator=[navigator, reference], vehicle=vehicle)
    at = both["heard"].values.all(axis=0)
    trace = np.trace(both["covariance_m2"].values, axis1=-2, axis2=-1)[:, at]
    return float(np.abs(np.sqrt(trace[0] / trace[1]) - 1).max())


def trace_ratio(run: Any, navigator: str, to: str) -> float:
    """Median trace of the stated covariance over another navigator's."""
    return _median_of(run, navigator, 1) / _median_of(run, to, 1)


def aspect(run: Any, navigator: str) -> float:
    """Median aspect ratio of the stated covariance's ellipse."""
    return _median_of(run, navigator, 0)


def _median_of(run: Any, navigator: str, which: int) -> float:
    from uwcoop.figures.geometry import aspect_and_trace

    settled = run.tracks["time"].values > float(run.tracks.attrs["settle_s"])
    covariance = run.tracks["covariance_m2"].sel(navigator=navigator).values[:, settled]
    values = aspect_and_trace(covariance)[which]
    return float(np.median(values[np.isfinite(values)]))


def received_share(run: Any, sender: str, receiver: str, navigator: str) -> float:
    """Share of one vehicle's packets that reached another."""
    names = [str(v) for v in run.tracks["vehicle"].values]
    place = [str(n) for n in run.tracks["navigator"].values].index(navigator)
    packets = run.packets
    own = packets["navigator"] == place
    own &= (packets["sender"] == names.index(sender)) & (packets["receiver"] == names.index(receiver))
    return float(packets["received"][own].mean())


def event_rate(run: Any, kind: str, vehicle: str) -> float:
    """Events of a kind per second, of one vehicle."""
    table = run.log.events[kind]
    index = list(run.log.vehicles).index(vehicle)
    return float((table["vehicle"] == index).sum() / (run.log.duration_ns / 1e9))


def silence(run: Any, vehicle: str, navigator: str) -> float:
    """Median time between two packets that a vehicle received, s."""
    names = [str(v) for v in run.tracks["vehicle"].values]
    place = [str(n) for n in run.tracks["navigator"].values].index(navigator)
    packets = run.packets
    own = (
        (packets["navigator"] == place) & (packets["receiver"] == names.index(vehicle)) & packets["received"]
    )
    return float(np.median(np.diff(np.sort(packets["toa_ns"][own]))) / 1e9)


def slot_s(run: Any) -> float:
    """Median time between two launches, whoever sends, s."""
    return float(np.median(np.diff(np.sort(run.log.slots["tol_ns"]))) / 1e9)


def counted(run: Any, navigator: str, counter: str) -> float:
    """What a navigator counted by the end, all vehicles together."""
    return float(np.nansum(run.tracks[counter].sel(navigator=navigator).values[:, -1]))


def information_ratio(run: Any, navigator: str, to: str) -> float:
    """Mean error after an update over another navigator's, at equal information: mean over the bins that both have."""
    from uwcoop.figures.information import binned, gains_of

    names = [str(name) for name in run.tracks["navigator"].values]
    curves = {
        names[gain.navigator]: binned(gain.information_nat, gain.error_m) for gain in gains_of(run.tracks)
    }
    (x, y, _), (other_x, other_y, _) = curves[navigator], curves[to]
    low, high = max(x.min(), other_x.min()), min(x.max(), other_x.max())
    shared = np.linspace(low, high, 20)
    return float(np.mean(np.interp(shared, x, y)) / np.mean(np.interp(shared, other_x, other_y)))


def offset(run: Any, navigator: str, channel: str, last_s: float = 60.0) -> float:
    """Median size of a channel's offset in the last seconds before each exchange of roles, m or degrees."""
    from uwcoop.figures.landmark import landmark_spans
    from uwcoop.figures.landmark_fixes import fix_offsets

    names = [str(name) for name in run.tracks["navigator"].values]
    values = np.abs(fix_offsets(run.log, run.tracks, names.index(navigator))[channel])
    t_s = run.log.events["acoustic_fix"]["t_ns"] / 1e9
    late = np.zeros(len(t_s), bool)
    for span in landmark_spans(run.log)[1:]:
        before = t_s[t_s < span.start_s]
        if before.size:
            late |= (t_s <= before[-1]) & (t_s > before[-1] - last_s)
    found = float(np.nanmedian(values[late]))
    return found if channel == "range_m" else float(np.degrees(found))


def offset_ratio(run: Any, navigator: str, to: str, channel: str, last_s: float = 60.0) -> float:
    """The same, over another navigator's."""
    return offset(run, navigator, channel, last_s) / offset(run, to, channel, last_s)


def exchanges(run: Any) -> float:
    """How often the landmark changed."""
    from uwcoop.figures.landmark import landmark_spans

    return float(len(landmark_spans(run.log)) - 1)


def yaw(study: Any, navigator: str) -> float:
    """Median over runs and vehicles of the RMS yaw error, degrees."""
    values = [row["yaw_rmse_deg"] for row in study.rows if row["navigator"] == navigator]
    return float(np.median([value for value in values if value is not None]))


def speed_rate(costs: Any, particles: int) -> float:
    """Times real time."""
    return float(next(row["rate"] for row in costs if row["particles"] == particles))


def compression(costs: Any, particles: int) -> float:
    """CPU time of the compression at an exchange, s."""
    return float(next(row["compression_s"] for row in costs if row["particles"] == particles))


MEASURES: dict[str, Callable[..., float]] = {
    each.__name__: each
    for each in (
        pooled, ratio, ratio_high, variants_ratio, share_worse, vehicles_rmse, difference, rms_error, error_ratio,
        largest_error, sigma, sigma_apart, trace_ratio, aspect, received_share, event_rate, silence, slot_s, counted,
        information_ratio, offset, offset_ratio, exchanges, yaw, speed_rate, compression,
    )
}  # fmt: skip
"""By name."""
