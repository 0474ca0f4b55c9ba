"""Error and consistency against packet length, by navigator and variant of a study."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.errors import TracksError
from uwcoop.figures.style import DPI, MARKERS, OKABE_ITO, matplotlib_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Rows = Sequence[Mapping[str, Any]]


def bytes_figure(rows: Rows, keys: Sequence[str] = (), *, title: str) -> Figure:
    """RMSE against the mean length of a packet, and the same as a table with ANEES.

    Silent navigators are lines across. One mark for each navigator and variant, over all runs and vehicles.

    Raises:
        TracksError: no navigator sends packets.
    """
    found = summarised(rows, keys)
    if not any(entry["bytes"] for entry in found):
        raise TracksError("no navigator sends packets")
    figure = matplotlib_figure()(
        figsize=(12.5, max(5.2, 0.27 * len(found) + 2.0)), dpi=DPI, layout="constrained"
    )
    axes, text = figure.subplots(1, 2, width_ratios=(1.25, 1))
    names = list(dict.fromkeys(entry["navigator"] for entry in found))
    variants = list(dict.fromkeys(entry["variant"] for entry in found))
    for entry in found:
        _mark(axes, entry, names.index(entry["navigator"]), variants.index(entry["variant"]))
    axes.set(xscale="log", xlabel="packet, mean (bytes)", ylabel="RMSE over all runs and vehicles (m)")
    axes.set_ylim(bottom=0)
    axes.xaxis.set_major_formatter("{x:g}")
    axes.grid(alpha=0.3, lw=0.6, which="both")
    handles, labels = axes.get_legend_handles_labels()
    once = dict(zip(labels, handles, strict=True))
    axes.legend(once.values(), once.keys(), fontsize=8, loc="best", framealpha=0.85)
    _table(text, found, with_variant=len(variants) > 1)
    figure.suptitle(f"{title}: bytes against accuracy", fontsize=12)
    return figure


def summarised(rows: Rows, keys: Sequence[str]) -> list[dict[str, Any]]:
    """For each variant and navigator: `rmse_m`, `anees`, `bytes` (mean over the packets of runs and vehicles; None if
    silent)."""
    found = []
    groups: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for row in rows:
        variant = ", ".join(f"{key.split('.')[-1]} {row[key]}" for key in keys)
        groups.setdefault((variant, str(row["navigator"])), []).append(row)
    for (variant, navigator), own in groups.items():
        known = [row for row in own if row["rmse_m"] is not None]
        means = [row.get("packet_bytes_mean") for row in own]
        sizes = [size for size in means if size is not None]
        anees = [value for value in (row.get("anees") for row in own) if value is not None]
        if known:
            found.append({
                "variant": variant,
                "navigator": navigator,
                "rmse_m": float(np.sqrt(np.mean([row["rmse_m"] ** 2 for row in known]))),
                "anees": float(np.mean(anees)) if anees else None,
                "bytes": float(np.mean(sizes)) if sizes else None,
            })  # fmt: skip
    return found


def _mark(axes: Axes, entry: Mapping[str, Any], navigator: int, variant: int) -> None:
    colour = OKABE_ITO[navigator % 8]
    if entry["bytes"] is None:
        if np.isfinite(entry["rmse_m"]):
            axes.axhline(entry["rmse_m"], color=colour, lw=1.0, ls=(0, (4, 2)), label=entry["navigator"])
        return
    axes.plot(
        entry["bytes"], entry["rmse_m"], ls="", marker=MARKERS[variant % 8], ms=8, mec=colour, mfc="none", mew=1.7,
        label=f"{entry['navigator']}{', ' + entry['variant'] if entry['variant'] else ''}",
    )  # fmt: skip


def _table(axes: Axes, found: Sequence[Mapping[str, Any]], *, with_variant: bool) -> None:
    axes.set_axis_off()
    head = [*(["variant"] if with_variant else []), "navigator", "RMSE (m)", "ANEES (2)", "bytes"]
    cells = [
        [
            *([entry["variant"]] if with_variant else []),
            entry["navigator"],
            f"{entry['rmse_m']:.2f}",
            "–" if entry["anees"] is None else f"{entry['anees']:.2f}",
            "–" if entry["bytes"] is None else f"{entry['bytes']:.0f}",
        ]
        for entry in found
    ]
    widths = [max(len(row[k]) for row in [head, *cells]) for k in range(len(head))]
    table = axes.table(
        cellText=cells, colLabels=head, loc="center", cellLoc="left",
        colWidths=[w / sum(widths) for w in widths], edges="horizontal",
    )  # fmt: skip
    table.auto_set_font_size(False)
    table.set_fontsize(8)
