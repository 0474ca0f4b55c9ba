"""The table of a study over worlds: every navigator in each, beside the one that sails alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rich.box import SIMPLE_HEAD
from rich.console import Group
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from uwcoop.experiment.named_worlds import World

__all__ = ["ALONE", "cell", "world_tables", "worse_than_alone"]

ALONE = "mpf-terrain-only"
"""Sails without teammates: cooperation must not be worse than this."""
_WORSE = 1.05
"""Times the error of `ALONE` from which on a navigator counts as worse."""
_OVERCONFIDENT = 4.0


def world_tables(summary: Mapping[str, Any], worlds: Sequence[World], *, settle_s: float) -> Group:
    """A study's `summary.json` as one table for each combination of varied values: worlds down, navigators across."""
    titles = {world.name: world.title for world in worlds}
    groups: dict[str, list[Mapping[str, Any]]] = {}
    for variant in summary["variants"]:
        varied = ", ".join(f"{key} = {value}" for key, value in variant["set"].items() if key != "world")
        groups.setdefault(varied, []).append(variant)
    runs = f"{summary['scenario']}, {summary['runs']} run{'s' if summary['runs'] != 1 else ''}"
    tables = []
    for varied, variants in groups.items():
        last = varied == list(groups)[-1]
        table = Table(
            title=f"{runs}: {varied}" if varied else runs, caption=_caption(settle_s) if last else None,
            caption_justify="left", header_style="bold", box=SIMPLE_HEAD, padding=0, pad_edge=False,
        )  # fmt: skip
        table.add_column("world", min_width=16)
        for name in variants[0]["navigators"]:
            table.add_column(name, justify="right", no_wrap=True)
        for variant in variants:
            alone = variant["navigators"].get(ALONE)
            cells = [_marked(pooled, alone) for pooled in variant["navigators"].values()]
            table.add_row(titles[variant["set"]["world"]], *cells)
        tables.append(table)
    return Group(*tables)


def cell(pooled: Mapping[str, Any]) -> str:
    """Median RMSE, m, median and mean NEES, and the share of vehicles that are lost where there are any."""
    figures = [_number(pooled[key]) for key in ("median_rmse_m", "anees_median", "anees")]
    lost = pooled["lost_share"] or 0.0
    return f"{figures[0]} m · {figures[1]}, {figures[2]}" + (f" · {lost:.0%} lost" if lost else "")


def worse_than_alone(pooled: Mapping[str, Any], alone: Mapping[str, Any] | None) -> bool:
    """Whether a navigator's median error exceeds that of a vehicle that sails alone by more than 5 %."""
    own, other = pooled["median_rmse_m"], None if alone is None else alone["median_rmse_m"]
    return own is not None and other is not None and own > _WORSE * other


def _marked(pooled: Mapping[str, Any], alone: Mapping[str, Any] | None) -> Text:
    text = cell(pooled)
    if (pooled["anees_median"] or 0.0) > _OVERCONFIDENT:
        return Text(f"▲ {text}", style="bold red")
    if worse_than_alone(pooled, alone):
        return Text(f"▼ {text}", style="yellow")
    return Text(text, style="bold red" if pooled["lost_share"] else "")


def _caption(settle_s: float) -> str:
    return (
        f"RMSE (median over runs and vehicles, after {settle_s:g} s) · NEES (median, mean; 2 is ideal) · vehicles more "
        f"than 30 m off at the end. ▲: median NEES above {_OVERCONFIDENT:g}, overconfident. ▼: more than 5 % worse than "
        f"{ALONE}, a vehicle that sails alone."
    )


def _number(value: float | None) -> str:
    if value is None:
        return "–"
    return f"{value:.0f}" if value >= 99.95 else f"{value:.1f}" if value >= 9.995 else f"{value:.2f}"
