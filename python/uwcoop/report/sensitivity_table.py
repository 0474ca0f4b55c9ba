"""The table of a sweep: how the error follows each number that is varied."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Group
from rich.table import Table

from uwcoop.evaluation.intervals import CONFIDENCE, LEAST_MISSIONS

__all__ = ["MOST_TABLES", "sensitivity_table"]

MOST_TABLES = 8
"""Variants whose tables are printed one by one; of more, what follows from them."""


def sensitivity_table(summary: Mapping[str, Any]) -> Group:
    """The `sensitivity` of a study's `summary.json`: a row for each key and navigator."""
    variants, runs = len(summary["variants"]), summary["runs"]
    table = Table(
        title=f"{summary['scenario']}, {variants} variants, {runs} run{'s' if runs != 1 else ''} each",
        caption=(
            f"Spearman's rank correlation of the value and the RMSE of a mission; its {CONFIDENCE:.0%} interval by "
            f"bootstrap over seeds, from {LEAST_MISSIONS} of them on. RMSE: median over the missions in the lowest and "
            "in the highest third of the values. Every variant is in summary.json (-o DIR)."
        ),
        caption_justify="left", header_style="bold", box=SIMPLE_HEAD, padding=0, pad_edge=False,
    )  # fmt: skip
    table.add_column("key", overflow="fold")
    table.add_column("navigator", no_wrap=True)
    for heading in (
        "rank corre-\nlation",
        "interval",
        "low\nvalues",
        "RMSE\n(m)",
        "high\nvalues",
        "RMSE\n(m)",
    ):
        table.add_column(heading, justify="right", no_wrap=True)
    for entry in summary["sensitivity"]:
        interval = "" if entry["interval"] is None else "{:.2f} to {:.2f}".format(*entry["interval"])
        figures = [entry[k] for k in ("low", "rmse_low_m", "high", "rmse_high_m")]
        correlation = "–" if entry["rank_correlation"] is None else f"{entry['rank_correlation']:.2f}"
        table.add_row(
            entry["key"], entry["navigator"], correlation, interval,
            *("–" if value is None else f"{value:.3g}" for value in figures),
        )  # fmt: skip
    return Group(table)
