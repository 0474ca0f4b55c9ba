"""Tables for the terminal about what goes in: charts, schedules, packaged scenarios. Results are in `report`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rich.box import SIMPLE_HEAD
from rich.console import Group
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from uwcoop.experiment.packet_budget import Budget, Cost
    from uwcoop.scenario.keys import Key

__all__ = ["budget_table", "chart_table", "keys_table", "packaged_tables", "residuals_table"]


def packaged_tables(scenarios: Iterable[tuple[str, str]], navigators: Mapping[str, str]) -> Group:
    """Names and descriptions of what can be flown, and by what."""
    tables = []
    for kind, entries in (("scenario", scenarios), ("navigator", navigators.items())):
        table = _table(None, None)
        table.add_column(kind, style="bold", no_wrap=True, min_width=16)
        table.add_column("what it is")
        for name, description in entries:
            table.add_row(name, description)
        tables.append(table)
    return Group(*tables)


def keys_table(keys: Iterable[Key]) -> Table:
    """Keys of a scenario: what each is, and what it may be."""
    table = _table(None, None)
    table.add_column("key", style="bold", overflow="fold")
    for heading in ("unit", "default"):
        table.add_column(heading, overflow="fold")
    table.add_column("bound, meaning")
    for key in keys:
        said = ". ".join(part for part in (key.case, key.bound, key.meaning) if part)
        table.add_row(key.name, key.unit, key.default, Text(said.replace("`", "")))
    return table


def chart_table(facts: Mapping[str, Any]) -> Table:
    """What `charts.describe` says, in words and with what was assumed while the chart was read."""
    extent, size, depth = facts["extent_m"], facts["size_m"], facts["depth_m"]
    slope, terrain, origin = facts["slope"], facts["terrain"], facts["origin"]
    table = _table(facts["name"], None, show_header=False)
    table.add_column(style="bold", no_wrap=True)
    table.add_column()
    table.add_row("size", f"{size['east']:,.0f} m east × {size['north']:,.0f} m north")
    table.add_row("grid", f"{facts['cols']} × {facts['rows']} nodes, {facts['cell_m']:g} m apart")
    table.add_row(
        "extent",
        f"east {extent['west']:,.1f} to {extent['east']:,.1f} m, "
        f"north {extent['south']:,.1f} to {extent['north']:,.1f} m",
    )
    if facts["corners_deg"] is not None:
        table.add_row("corners", _corners(facts["corners_deg"]))
    table.add_row("origin", _origin(origin))
    table.add_row(
        "depth", f"{depth['min']:.2f} to {depth['max']:.2f} m, median {depth['median']:.2f} m, positive down"
    )
    table.add_row("holes", f"{100 * facts['hole_share']:.1f} % of the nodes")
    table.add_row(
        "slope",
        ", ".join(f"{_or_dash(slope[f'q{q}'], '{:.3f}')} at {q} %" for q in (50, 90, 99)) + " of the nodes",
    )
    table.add_row("chart error", _chart_error(facts))
    table.add_row("terrain", _terrain(terrain))
    table.add_row("SHA-256", Text(facts["sha256"], overflow="fold"))
    for note in facts["notes"]:
        table.add_row("note", note)
    return table


_LAGS_SHOWN_M = (2, 5, 10, 20, 40)


def residuals_table(facts: Mapping[str, Any]) -> Table:
    """What soundings say of each other: `Gridded.as_dict()`, and the chart's quality that follows."""
    found, moved = facts["residuals"], facts["alignment"]
    table = _table("residuals of soundings", None, show_header=False)
    table.add_column(style="bold", no_wrap=True)
    table.add_column()
    table.add_row("judged by", f"{found['count']:,} residuals, {found['how']}")
    spread = f"robust sd {found['robust_sd_m']:.3g} m, sd {found['sd_m']:.3g} m"
    if found["datum_sd_m"] is not None:
        spread += (
            f"; surveys' datums differ by {found['datum_sd_m']:.2g} m (sd), without them robust sd "
            f"{found['own_datum_robust_sd_m']:.3g} m"
        )
    table.add_row("spread", spread)
    table.add_row("correlation", _correlation(found))
    table.add_row("slope", _slope_dependence(found))
    if moved is not None:
        gain = (
            ""
            if moved["after_m"] is None
            else f"; misfit {moved['before_m']:.2g} to {moved['after_m']:.2g} m"
        )
        table.add_row(
            "alignment",
            f"{moved['segments']} segments of {moved['segment_s']:g} s moved by {moved['median_shift_m']:.1f} m "
            f"(median), {moved['largest_shift_m']:.1f} m at most{gain}",
        )
    table.add_row(
        "proposed",
        f"sigma_map_m = {found['sigma_map_m']:g}, correlation_length_m = {found['correlation_length_m']:g}",
    )
    return table


def _correlation(found: Mapping[str, Any]) -> str:
    lags = found["autocorrelation"]
    if not lags:
        return "too few pairs to tell"
    nearest = [min(lags, key=lambda pair: abs(pair[0] - lag)) for lag in _LAGS_SHOWN_M]
    shown = ", ".join(f"{r:.2f} at {lag:.0f} m" for lag, r in dict.fromkeys(tuple(pair) for pair in nearest))
    half, integral = found["half_lag_m"], found["integral_lag_m"]
    falls = "" if half is None else f"; one half at {half:.1f} m, integral {integral:.1f} m"
    return shown + falls


def _slope_dependence(found: Mapping[str, Any]) -> str:
    bins = found["by_slope"]
    if not bins:
        return "too few to tell"
    shown = ", ".join(f"{sd:.2f} m at {slope:.2f}" for slope, sd in (bins[0], bins[len(bins) // 2], bins[-1]))
    return (
        f"robust sd {shown}: {found['flat_sd_m']:.2g} m on level ground and an effective horizontal error of "
        f"{found['horizontal_error_m']:.1f} m"
    )


def _corners(places: Iterable[Sequence[float]]) -> str:
    """Latitude and longitude of the four outermost nodes."""
    return ", ".join(
        f"{name} {latitude:.6f}° {longitude:.6f}°"
        for name, (latitude, longitude) in zip(("SW", "SE", "NE", "NW"), places, strict=True)
    )


def _origin(origin: Mapping[str, Any]) -> str:
    if origin["latitude_deg"] is None:
        return "local metres, no place on Earth"
    place = f"{origin['latitude_deg']:.6f}°, {origin['longitude_deg']:.6f}°"
    return place if origin["crs"] is None else f"{place} ({origin['crs']})"


def _chart_error(facts: Mapping[str, Any]) -> str:
    if not facts["sigma_map_m"]:
        return "none stated: taken as perfect"
    return f"sigma {facts['sigma_map_m']:.2f} m, correlated over {facts['correlation_length_m']:g} m"


def _terrain(terrain: Mapping[str, Any]) -> str:
    if terrain["helps_share"] is None:
        return "nowhere: holes everywhere within a window"
    median = _or_dash(terrain["median_sigma_m"], "{:.1f} m")
    return (
        f"on {100 * terrain['helps_share']:.0f} % of the nodes one crossing of {terrain['window_m']:g} m "
        f"({terrain['sounding_sigma_m']:g} m soundings, unknown tide) fixes both coordinates "
        f"to {terrain['helps_below_m']:g} m; median {median}"
    )


def budget_table(budget: Budget) -> Table:
    """Each navigator's packet, from bytes to updates."""
    heard = sorted(set(budget.heard_per_min.values()))
    rates = f"{heard[0]:.3g}" if len(heard) == 1 else f"{heard[0]:.3g} to {heard[-1]:.3g}"
    limit = (
        "no limit" if not budget.frame_s else f"up to {budget.max_frames} frames of {budget.frame_bytes} B"
    )
    poll = ""
    if budget.poll_bytes:
        poll = (
            f" + poll {budget.poll_air_s:.2f} s ({budget.poll_bytes} B); "
            f"a reply is {budget.reply_bytes} B longer than its packet"
        )
    table = _table(
        f"{budget.scenario}: {budget.modem}, {limit}",
        f"Slot {budget.slot_s:g} s, of which guard {budget.guard_s:.2f} s; cycle {budget.cycle_s:g} s. "
        f"Air time = preamble {budget.preamble_s:g} s + frames × {budget.frame_s:.3g} s{poll}. "
        f"A vehicle hears {rates} packets per minute if none is lost. Arrives: at the schedule's longest range, outside "
        "of shadows and blackouts.",
    )
    table.add_column("navigator", style="bold", no_wrap=True)
    for heading in (
        "packet\n(B)",
        "frames",
        "air time\n(s)",
        "+ guard\n(s)",
        "of slot\n(%)",
        "arrives\n(%)",
        "heard\n(1/min)",
    ):
        table.add_column(heading, justify="right", no_wrap=True)
    for name, cost in budget.costs.items():
        table.add_row(name, *(_cost(cost, budget, heard) if cost else ["–"] * 7))
    return table


def _cost(cost: Cost, budget: Budget, heard: list[float]) -> list[str]:
    rates = [f"{rate * cost.survive:.3g}" for rate in heard]
    return [
        str(cost.packet_bytes),
        str(cost.frames),
        f"{cost.air_time_s:.2f}",
        f"{cost.slot_needed_s:.2f}",
        f"{cost.slot_needed_s / budget.slot_s:.0%}".rstrip("%"),
        f"{cost.survive:.0%}".rstrip("%"),
        rates[0] if len(rates) == 1 else f"{rates[0]}–{rates[-1]}",
    ]


def _or_dash(value: float | None, form: str) -> str:
    return "–" if value is None else form.format(value)


def _table(title: str | None, caption: str | None, *, show_header: bool = True) -> Table:
    return Table(
        title=title, caption=caption, caption_justify="left", header_style="bold", box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0), pad_edge=False, show_header=show_header,
    )  # fmt: skip
