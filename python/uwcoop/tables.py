"""Tables for the terminal about what goes in: charts, schedules, packaged scenarios. Results are in `report`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from rich.box import SIMPLE_HEAD
from rich.console import Group
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from uwcoop.budget import Budget, Cost

__all__ = ["budget_table", "chart_table", "packaged_tables"]


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
    table = _table(
        f"{budget.scenario}: {budget.modem}, {limit}",
        f"Slot {budget.slot_s:g} s, of which guard {budget.guard_s:.2f} s; cycle {budget.cycle_s:g} s. "
        f"Air time = preamble {budget.preamble_s:g} s + frames × {budget.frame_s:.3g} s. "
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
