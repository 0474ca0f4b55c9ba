"""The set-up of a mission: paths, sensors and transmission slots (Walls & Eustice 2012, Fig. 3)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.errors import TracksError
from uwcoop.figures.map import finite_points, frame_around
from uwcoop.figures.style import DPI, MARKERS, OKABE_ITO, matplotlib_figure

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from uwcoop.missionlog import MissionLog

SENSORS = {
    "fix": "fix", "ground_velocity": "DVL", "heading": "heading", "turn_rate": "turn rate", "odometry": "odometry",
    "depth": "depth", "water_depth": "water depth",
}  # fmt: skip


def setup_figure(log: MissionLog, tracks: xr.Dataset) -> Figure:
    """Left the true paths with the places of launches; right one cycle of slots and each vehicle's sensors.

    Raises:
        TracksError: no truth, or no slots.
    """
    truth = tracks["truth_position_m"].values
    if not np.isfinite(truth).any():
        raise TracksError("the true paths are unknown")
    if not log.slots or not len(log.slots["tol_ns"]):
        raise TracksError("there are no transmission slots")
    points = finite_points(truth)
    view = frame_around(points, 0.06 * float(np.ptp(points, axis=0).max()) + 1.0)
    figure = matplotlib_figure()(figsize=(12.5, 7.0), dpi=DPI, layout="constrained")
    parts: Any = figure.subfigures(1, 2, width_ratios=(1.25, 1))
    left, right = parts
    axes = left.subplots()
    _paths(axes, log, tracks, truth)
    axes.set(xlim=view[:2], ylim=view[2:], aspect="equal", xlabel="east (m)", ylabel="north (m)")
    axes.grid(alpha=0.3, lw=0.6)
    axes.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=2, frameon=False)
    cycle, share, text = right.subplots(3, 1, height_ratios=(0.9, 0.9, 1.2))
    _cycle(cycle, log)
    _shares(share, log)
    _sensors(text, log)
    figure.suptitle(f"{tracks.attrs['mission']}, seed {tracks.attrs['seed']}: set-up", fontsize=12)
    return figure


def _paths(axes: Axes, log: MissionLog, tracks: xr.Dataset, truth: Any) -> None:
    time = tracks["time"].values
    for j, vehicle in enumerate(log.vehicles):
        colour = OKABE_ITO[j % 8]
        axes.plot(*truth[j].T, color=colour, lw=1.1, label=f"{vehicle}: true path")
        launches = log.slots["tol_ns"][log.slots["sender"] == j] / 1e9
        if len(launches):
            at = np.column_stack([np.interp(launches, time, truth[j, :, axis]) for axis in range(2)])
            axes.plot(
                *at.T, ls="", marker=MARKERS[j % 8], ms=4, mec=colour, mfc="white", mew=0.9,
                label=f"{vehicle}: launches ({len(launches)})",
            )  # fmt: skip
        axes.plot(*truth[j, 0], ls="", marker="*", ms=13, mec="white", mfc=colour, mew=0.8)


def _cycle(axes: Axes, log: MissionLog) -> None:
    """The shortest sequence of slots that repeats, at most the first 24."""
    sender, start_s = log.slots["sender"], log.slots["tol_ns"] / 1e9
    length = next(
        (n for n in range(1, min(len(sender), 25)) if (sender[n:] == sender[:-n]).all()), min(len(sender), 24)
    )
    slot_s = float(np.median(np.diff(start_s))) if len(start_s) > 1 else 1.0
    for k in range(length):
        axes.barh(
            int(sender[k]), slot_s, left=start_s[k], height=0.7, color=OKABE_ITO[int(sender[k]) % 8],
            edgecolor="white",
        )  # fmt: skip
    axes.set(
        yticks=range(len(log.vehicles)), yticklabels=log.vehicles, xlabel="time (s)",
        ylim=(len(log.vehicles) - 0.4, -0.6),
    )  # fmt: skip
    axes.set_title(f"one cycle: {length} slots of {slot_s:g} s, {length * slot_s:g} s", fontsize=10)


def _shares(axes: Axes, log: MissionLog) -> None:
    """Share of the signals that survive, by direction, had each packet one frame."""
    table = log.opportunities
    pairs = sorted(set(zip(table["sender"].tolist(), table["receiver"].tolist(), strict=True)))
    alive = table["draws"][:, 0] < table["survive_probability"]
    for k, (sender, receiver) in enumerate(pairs):
        own = (table["sender"] == sender) & (table["receiver"] == receiver)
        axes.barh(k, 100 * alive[own].mean(), height=0.7, color=OKABE_ITO[sender % 8])
    labels = [f"{log.vehicles[s]} → {log.vehicles[r]}" for s, r in pairs]
    axes.set(yticks=range(len(pairs)), yticklabels=labels, xlim=(0, 100), xlabel="signals that arrive (%)")
    axes.tick_params(axis="y", labelsize=9 if len(pairs) < 8 else 6)
    axes.invert_yaxis()


def _sensors(axes: Axes, log: MissionLog) -> None:
    axes.set_axis_off()
    lines = []
    for j, vehicle in enumerate(log.vehicles):
        lines.append(f"{vehicle}")
        for kind, name in SENSORS.items():
            table = log.events.get(kind)
            count = 0 if table is None else int((table["vehicle"] == j).sum())
            if table is None or not count:
                continue
            rate = count / (log.duration_ns / 1e9)
            lines.append(f"   {name:<12}{_rate(count, rate):>12}   {_sigma(table, j)}")
        lines.extend(_modem(log, j))
    axes.text(
        0.0, 1.0, "\n".join(lines[:26]), va="top", ha="left", family="monospace", fontsize=8.5,
        transform=axes.transAxes,
    )  # fmt: skip
    axes.set_title("sensors: events per second, sigma", fontsize=10, loc="left")


def _modem(log: MissionLog, vehicle: int) -> list[str]:
    """The modem as a sensor: how often a signal can be heard, and the sigma of a range."""
    for table in (log.opportunities, log.receptions):
        if table is not None and len(table["receiver"]):
            at_s = np.unique(table["toa_ns"][table["receiver"] == vehicle]) / 1e9
            if at_s.size < 2:
                return []
            plan = log.setup.acoustics
            sigma = "" if plan is None else f"{plan.range_sigma_m:g} m"
            every = f"{float(np.median(np.diff(at_s))):.3g} s"
            return [f"   {'modem range':<12}{'each ' + every:>12}   {sigma}"]
    return []


def _rate(count: int, rate_hz: float) -> str:
    return "at the start" if count <= 2 else f"{rate_hz:.3g} Hz"


def _sigma(table: dict[str, Any], vehicle: int) -> str:
    own = table["vehicle"] == vehicle
    for column, unit, factor in (
        ("sigma_mps", "m/s", 1.0),
        ("sigma_rad", "°", 180 / np.pi),
        ("sigma_radps", "°/s", 180 / np.pi),
        ("sigma_m", "m", 1.0),
    ):
        if column in table:
            return f"{float(np.median(table[column][own])) * factor:.3g} {unit}"
    for column in ("cov_ee_m2", "cov_ff"):
        if column in table:
            return f"{float(np.sqrt(np.median(table[column][own]))):.3g} m"
    return ""
