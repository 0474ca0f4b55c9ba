"""A study's summary as a table of the report."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

__all__ = ["number", "study_table"]

COLUMNS = {
    "median_final_error_m": "final error, median (m)", "p95_final_error_m": "95 % (m)",
    "median_rmse_m": "RMSE, median (m)", "anees": "ANEES, mean", "anees_median": "median",
}  # fmt: skip


def study_table(summary: Mapping[str, Any]) -> list[list[str]]:
    """Head, then a row for each variant and navigator."""
    varied = list(summary["variants"][0]["set"])
    table = [[*varied, "navigator", *COLUMNS.values(), "lost", "packet (B)"]]
    for variant in summary["variants"]:
        for name, pooled in variant["navigators"].items():
            lost, size = pooled["lost_share"], pooled["packet_bytes_max"]
            table.append([
                *(str(variant["set"][key]) for key in varied), f"`{name}`",
                *(number(pooled[key]) for key in COLUMNS), "-" if lost is None else f"{100 * lost:.0f} %",
                f"{size:,.0f}" if size else "-",
            ])  # fmt: skip
    return table


def number(value: float | None) -> str:
    """Two decimals below ten, one below a hundred, none above; three digits where that leaves none."""
    if value is None:
        return "-"
    size = abs(value)
    if 0.01 <= size < 100 or value == 0:
        return f"{value:.2f}" if size < 10 else f"{value:.1f}"
    return f"{value:,.0f}" if 100 <= size < 1e6 else f"{value:.2g}"
