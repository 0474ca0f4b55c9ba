"""Tables for the terminal: a run's and a study's summary, consistency beside accuracy in each."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Group
from rich.table import Table
from rich.text import Text

from uwcoop.evaluation import metrics

OVERCONFIDENT_ANEES = 4.0
CONSERVATIVE_ANEES = 1.0
"""Twice and half the ideal 2: beyond, the stated variance is off by a factor two, and the table says so."""


def summary_table(
    summary: Mapping[str, Any], *, settle_s: float, not_realisable: Collection[str] = ()
) -> Table:
    """A run's `summary.json`: one block per navigator, one line in it per vehicle; 80 columns wide.

    Columns without any value are left out. `not_realisable` names the navigators that use information which no
    vehicle has; they are marked.
    """
    navigators = summary["navigators"]
    vehicles = [values for navigator in navigators.values() for values in navigator["vehicles"].values()]
    undefined = any(values.get("nees_not_finite") for values in vehicles)
    caption = (
        f"Errors over the instants of the 1 Hz grid after {settle_s:g} s. {_ANEES_CAPTION}"
        + (" (n): infinite or undefined at n instants." if undefined else "")
        + " Instants of one run are correlated: judge consistency over many runs."
        + _bound_caption(vehicles)
        + counterfactual_caption(summary)
    )
    columns = _applicable({key: m.column for key, m in metrics.METRICS.items()}, vehicles)
    cells = {
        column.heading: {
            name: [_cell(key, values, column) for values in navigator["vehicles"].values()]
            for name, navigator in navigators.items()
        }
        for key, column in columns.items()
    }
    return block_table(run_title(summary), caption, navigators, cells, not_realisable)


def run_title(summary: Mapping[str, Any]) -> str:
    """Mission and seed, and whether it is as it happened."""
    changed = ", counterfactual" if summary.get("counterfactual") else ""
    return f"{summary['mission']}, seed {summary['seed']}{changed}"


def counterfactual_caption(summary: Mapping[str, Any]) -> str:
    """In what the mission is not as it happened; empty where it is."""
    changed = summary.get("counterfactual")
    return f" Counterfactual: {', '.join(changed)}." if changed else ""


def block_table(
    title: str,
    caption: str,
    navigators: Mapping[str, Any],
    columns: Mapping[str, Mapping[str, list[Text]]],
    not_realisable: Collection[str],
) -> Table:
    """One block per navigator, one line in it per vehicle; `columns`: cells by heading, navigator and vehicle."""
    table = _table(title, caption)
    names = {name: _navigator_cell(name, navigator, not_realisable) for name, navigator in navigators.items()}
    table.add_column("navigator\npacket mean / max\nrun time, × real", min_width=_width(names.values()))
    lines = [Text(vehicle) for navigator in navigators.values() for vehicle in navigator["vehicles"]]
    table.add_column("vehicle", no_wrap=True, min_width=_width([Text("vehicle"), *lines]))
    for heading, blocks in columns.items():
        _number_column(table, heading, [cell for block in blocks.values() for cell in block])
    for name, navigator in navigators.items():
        cells = [Text("\n").join(blocks[name]) for blocks in columns.values()]
        table.add_row(names[name], "\n".join(navigator["vehicles"]), *cells, end_section=True)
    return table


def unused_lines(summary: Mapping[str, Any]) -> list[str]:
    """A line for each navigator that has no use for some of the mission's events: their kinds, and how many there
    were."""
    return [
        f"not used by {name}: " + ", ".join(f"{kind} {count}" for kind, count in navigator["unused"].items())
        for name, navigator in summary["navigators"].items()
        if navigator.get("unused")
    ]


def study_table(
    summary: Mapping[str, Any],
    *,
    settle_s: float,
    vehicles: int | None = None,
    not_realisable: Collection[str] = (),
) -> Group:
    """A study's `summary.json`: a table for each variant, all of one layout, one row per navigator.

    Columns without any value are left out. With the number of `vehicles` the caption gives the interval in
    which the NEES of a consistent navigator, averaged over runs and vehicles at one instant, lies 95 % of the
    time.
    """
    bounds = ""
    if vehicles is not None:
        low, high = metrics.anees_bounds(2, summary["runs"] * vehicles)
        bounds = f" At one instant, 95 % of consistent teams average {low:.2f} to {high:.2f}."
    caption = (
        f"Errors over the instants of the 1 Hz grid after {settle_s:g} s, all runs and vehicles. "
        f"{_ANEES_CAPTION}{bounds} Lost: more than {metrics.LOST_BEYOND_M:g} m off at the end."
    )
    variants = summary["variants"]
    every = [values for variant in variants for values in variant["navigators"].values()]
    caption += _bound_caption(every)
    columns = _applicable({entry.key: entry.column for entry in metrics.pooled_metrics()}, every)
    names = [_name(name, not_realisable) for variant in variants for name in variant["navigators"]]
    runs = f"{summary['scenario']}, {summary['runs']} run{'s' if summary['runs'] != 1 else ''}"
    tables = []
    for variant in variants:
        settings = ", ".join(f"{key} = {value}" for key, value in variant["set"].items())
        last = variant is variants[-1]
        table = _table(f"{runs}: {settings}" if settings else runs, caption if last else None)
        table.add_column("navigator", min_width=_width([Text("navigator"), *names]))
        for key, column in columns.items():
            _number_column(table, column.heading, [_cell(key, values, column) for values in every])
        for name, values in variant["navigators"].items():
            cells = (_cell(key, values, column) for key, column in columns.items())
            table.add_row(_name(name, not_realisable), *cells)
        tables.append(table)
    return Group(*tables)


_ANEES_CAPTION = (
    f"ANEES: 2 is ideal; ▲ above {OVERCONFIDENT_ANEES:g} is overconfident, "
    f"▽ below {CONSERVATIVE_ANEES:g} conservative."
)


def _bound_caption(values: Iterable[Mapping[str, Any]]) -> str:
    """What a ratio to the bound below 1 means, where the table shows one."""
    ratios = [value for row in values for key in _TO_BOUND if (value := row.get(key)) is not None]
    if not any(ratio < 1 for ratio in ratios):
        return ""
    return (
        " RMSE / bound below 1: the bound holds for the mean over many missions; one mission may be luckier, "
        "and a bound of linearised soundings is no strict one."
    )


_TO_BOUND = ("rmse_over_bound", "rmse_over_linearised_bound")


def _table(title: str, caption: str | None) -> Table:
    return Table(
        title=title, caption=caption, caption_justify="left", header_style="bold", box=SIMPLE_HEAD,
        padding=0, pad_edge=False,
    )  # fmt: skip


def _applicable(
    columns: Mapping[str, metrics.Column | None], values: list[Mapping[str, Any]]
) -> dict[str, metrics.Column]:
    return {
        key: column
        for key, column in columns.items()
        if column is not None and (column.always or any(_counts(v.get(key), column) for v in values))
    }


def _counts(value: float | None, column: metrics.Column) -> bool:
    """Whether a value is a reason to show its column."""
    if value is None or (column.only_if_any and value == 0):
        return False
    return column.only_if_above is None or value > column.only_if_above


def _number_column(table: Table, heading: str, cells: list[Text]) -> None:
    """A column that never loses a digit, however narrow the terminal."""
    table.add_column(
        heading, justify="right", no_wrap=True, min_width=max(_width(cells), _width([Text(heading)]))
    )


def _width(cells: Iterable[Text]) -> int:
    return max(len(line) for cell in cells for line in cell.plain.split("\n"))


def _name(name: str, not_realisable: Collection[str]) -> Text:
    text = Text(name, style="bold")
    if name in not_realisable:
        text.append("\nnot realisable", style="not bold italic")
    return text


def _navigator_cell(name: str, navigator: Mapping[str, Any], not_realisable: Collection[str]) -> Text:
    sizes, speedup = navigator["packet_bytes"], navigator["speedup"]
    text = _name(name, not_realisable)
    sent = "no packets" if sizes["max"] is None else f"{sizes['mean']:.1f} / {sizes['max']:.0f} B"
    polls = navigator.get("sent", {}).get("polls")
    if polls:
        sent += f", {polls} polls"
    fast = "" if speedup is None else f", × {speedup:,.0f}"
    return text.append(f"\n{sent}\n{navigator['seconds']:.2f} s{fast}", style="not bold dim")


def _cell(key: str, values: Mapping[str, Any], column: metrics.Column) -> Text:
    value = values.get(key)
    text = _number(value, column.form)
    undefined = values.get("nees_not_finite") if key == "anees" else None
    if undefined:
        return Text(f"▲ {text} ({undefined})", style="bold red")
    if column.marks_consistency and value is not None:
        if value > OVERCONFIDENT_ANEES:
            return Text(f"▲ {text}", style="bold red")
        if value < CONSERVATIVE_ANEES:
            return Text(f"▽ {text}", style="yellow")
    return Text(text)


def number_text(value: float | None) -> str:
    """Three significant digits, none dropped before the point; – for None."""
    return _number(value, "three digits")


def _number(value: float | None, form: str) -> str:
    if value is None:
        return "–"
    if abs(value) >= 1e5:
        return f"{value:.0e}"
    if form == "three digits":
        return f"{value:.{0 if abs(value) >= 99.95 else 1 if abs(value) >= 9.995 else 2}f}"
    return f"{value:.0f}" if form == "whole" else f"{value:.0%}".rstrip("%")
