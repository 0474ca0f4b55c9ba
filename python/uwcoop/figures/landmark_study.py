"""Over many missions with a landmark: time against particles, and error against the exchange packet's bytes.

Matsuda et al. (2017), Figs. 16 and 17.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from uwcoop.figures.style import DPI, OKABE_ITO, matplotlib_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PAPER_COMPRESSION_S = 20.0
"""Compression of 10,000 particles at an exchange, on a computer of 2013 (Table 5)."""
PAPER_RATES = {3000: 10, 10000: 5}
"""Times real time by number of particles."""


def cost_figure(rows: Iterable[Mapping[str, Any]], *, parts: Sequence[str] = ("time", "rate")) -> Figure:
    """CPU time of a mission and of one compression (Fig. 16), and the mission's time over it (Fig. 17).

    Args:
        rows: `particles`, `mission_s`, `compression_s` and `rate` (times real time) each.
        parts: "time" is Fig. 16, "rate" Fig. 17.
    """
    table = sorted(rows, key=lambda row: row["particles"])
    count = [row["particles"] for row in table]
    figure = matplotlib_figure()(figsize=(1.4 + 4.1 * len(parts), 3.8), dpi=DPI, layout="constrained")
    for axes, part in zip(figure.subplots(1, len(parts), squeeze=False)[0], parts, strict=True):
        (_draw_time if part == "time" else _draw_rate)(axes, count, table)
        axes.set(xscale="log", yscale="log", xlabel="particles")
        axes.set_xticks(count, [f"{value:,}" for value in count])
        axes.minorticks_off()
        axes.grid(alpha=0.3, lw=0.6)
        axes.tick_params(labelsize=8)
    return figure


def _draw_time(axes: Axes, count: Sequence[int], table: Sequence[Mapping[str, Any]]) -> None:
    for key, name, colour, marker in (
        ("mission_s", "whole mission", OKABE_ITO[1], "o"),
        ("compression_s", "compression at one exchange", OKABE_ITO[2], "s"),
    ):
        axes.plot(count, [row[key] for row in table], color=colour, marker=marker, ms=5, label=name)
    axes.axhline(PAPER_COMPRESSION_S, color="#666666", lw=0.9, ls="--")
    axes.annotate(
        f"the paper: {PAPER_COMPRESSION_S:g} s for the compression of 10,000 particles",
        (count[0], PAPER_COMPRESSION_S), xytext=(0, -4), textcoords="offset points", fontsize=7, va="top",
    )  # fmt: skip
    axes.set_ylabel("CPU time (s)")
    axes.legend(fontsize=8, frameon=False, loc="center left", bbox_to_anchor=(0.0, 0.68))


def _draw_rate(axes: Axes, count: Sequence[int], table: Sequence[Mapping[str, Any]]) -> None:
    axes.plot(count, [row["rate"] for row in table], color=OKABE_ITO[0], marker="D", ms=5, label="here")
    axes.plot(*zip(*PAPER_RATES.items(), strict=True), ls="", marker="x", ms=8, mew=2, color="#111111",
              label="the paper")  # fmt: skip
    for particles, rate in PAPER_RATES.items():
        axes.annotate(f"the paper: {rate}×", (particles, rate), xytext=(-8, 8), textcoords="offset points",
                      ha="right", fontsize=7)  # fmt: skip
    axes.set_ylabel("mission time / CPU time")
    axes.legend(fontsize=8, frameon=False, loc="center left")


def bytes_figure(rows: Iterable[Mapping[str, Any]]) -> Figure:
    """Error and consistency against the bytes of the exchange packet.

    Args:
        rows: `bytes`, `rmse_m`, `yaw_deg` and `anees` (per degree of freedom) each.
    """
    table = sorted(rows, key=lambda row: row["bytes"])
    size = [row["bytes"] for row in table]
    figure = matplotlib_figure()(figsize=(11.0, 3.6), dpi=DPI, layout="constrained")
    panels = figure.subplots(1, 3)
    for axes, (key, label, colour) in zip(
        panels,
        (("rmse_m", "position, RMS (m)", OKABE_ITO[1]), ("yaw_deg", "yaw, RMS (deg)", OKABE_ITO[0]),
         ("anees", "state NEES / dof (ideal 1)", OKABE_ITO[2])),
        strict=True,
    ):  # fmt: skip
        values = [row[key] for row in table]
        axes.plot(size, values, color=colour, marker="o", ms=5)
        axes.set(xscale="log", xlabel="exchange packet (bytes)", ylabel=label, ylim=(0, 1.1 * max(values)))
        axes.set_xticks(size, [f"{value:.0f}" for value in size])
        axes.minorticks_off()
        axes.grid(alpha=0.3, lw=0.6)
        axes.tick_params(labelsize=8)
    panels[2].axhline(1, color="#666666", lw=0.8, ls="--")
    return figure
