"""Errors over the runs of a study as boxes: one for each navigator and, where keys are varied, each variant."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.errors import TracksError
from uwcoop.evaluation import metrics
from uwcoop.figures.averages import quantiles
from uwcoop.figures.style import DPI, OKABE_ITO, matplotlib_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    Rows = Sequence[Mapping[str, Any]]

HATCHES = ("", "////", "....", "\\\\\\\\", "xxxx", "----", "||||", "oooo")
"""One for each navigator, so that boxes can be distinguished in greyscale."""

INK = "#111111"
PANELS = {"final_error_m": "error at the end (m)", "rmse_m": "RMS error of the mission (m)"}

_LOG_ABOVE = 12.0
"""When boxes' medians differ by more than this factor, the axis is logarithmic."""
_LEAST_M = 0.01
"""Bottom of a logarithmic axis."""


@dataclass(frozen=True)
class _Box:
    at: float
    navigator: int
    values: NDArray[np.float64]
    final: NDArray[np.float64]


def boxes_figure(rows: Rows, keys: Sequence[str] = (), *, title: str, settle_s: float) -> Figure:
    """Error at the end and RMS error of the mission, a box for each navigator and combination of values.

    Args:
        rows: of a study, one for each run, navigator and vehicle: `metrics.row_columns` and the varied keys.
        keys: dotted keys that are varied; each combination of their values is a group of boxes.
        title: scenario.
        settle_s: RMS errors count from here on, s.

    A box holds all runs and vehicles: quartiles and median; whiskers to the last value within 1.5 box
    heights, circles beyond. Over each box stands its median and, for the end, the share lost (more than
    `metrics.LOST_BEYOND_M` off). An infinite error is a triangle at the upper edge. The axis is logarithmic
    when medians differ by more than a factor 12.

    Raises:
        TracksError: no row has an error, because no truth is known.
    """
    figure_class = matplotlib_figure()
    navigators = list(dict.fromkeys(str(row["navigator"]) for row in rows))
    groups = list(dict.fromkeys(tuple(row[key] for key in keys) for row in rows))
    if not any(row["final_error_m"] is not None for row in rows):
        raise TracksError("no run has an error: the truth is unknown")
    width = float(np.clip(2.2 + (0.42 if keys else 1.0) * len(groups) * (len(navigators) + 1), 8.0, 22.0))
    figure = figure_class(figsize=(width, 8.2), dpi=DPI, layout="constrained")
    panels = figure.subplots(2, 1, sharex=True)
    for axes, (column, label) in zip(panels, PANELS.items(), strict=True):
        boxes = _boxes(rows, keys, groups, navigators, column)
        _draw(axes, boxes, label, lost=column == "final_error_m")
        _between(axes, len(groups), len(navigators), grouped=bool(keys))
    axes = panels[-1]
    if keys:
        axes.set_xticks(
            [_centre(g, len(navigators)) for g in range(len(groups))],
            [_group_text(keys, group) for group in groups],
        )
        axes.set_xlabel(keys[0] if len(keys) == 1 else "")
    else:
        axes.set_xticks(range(len(navigators)), navigators)
    figure.suptitle(f"{title}: {_count_text(rows, keys)}", fontsize=12)
    caption = (
        "Box: quartiles and median; whiskers: last value within 1.5 box heights. "
        f"RMS after {settle_s:g} s. Lost: more than {metrics.LOST_BEYOND_M:g} m off at the end."
    )
    if keys:
        _legend(figure, navigators, caption)
    else:
        figure.supxlabel(caption, fontsize=8, color="#444444")
    return figure


def box_statistics(values: NDArray[np.float64]) -> dict[str, Any]:
    """Quartiles (linear between order statistics), whiskers within 1.5 interquartile ranges, and the rest.

    Keys as `matplotlib.axes.Axes.bxp` takes them. Infinite values count as largest.
    """
    ordered = np.sort(values)
    low, middle, high = (float(q) for q in quantiles(values, (0.25, 0.5, 0.75)))
    reach = 1.5 * (high - low) if math.isfinite(high) else math.inf
    within = ordered[(ordered >= low - reach) & (ordered <= high + reach)]
    return {
        "med": middle, "q1": low, "q3": high,
        # A quartile between two values may lie beyond the last one within reach.
        "whislo": min(float(within[0]), low), "whishi": max(float(within[-1]), high),
        "fliers": ordered[(ordered < within[0]) | (ordered > within[-1])],
    }  # fmt: skip


def _boxes(
    rows: Rows, keys: Sequence[str], groups: Sequence[tuple[Any, ...]], navigators: Sequence[str], column: str
) -> list[_Box]:
    found: dict[tuple[Any, str], list[list[float]]] = {}
    for row in rows:
        if row[column] is not None and row["final_error_m"] is not None:
            own = found.setdefault((tuple(row[key] for key in keys), str(row["navigator"])), [[], []])
            own[0].append(float(row[column]))
            own[1].append(float(row["final_error_m"]))
    return [
        _Box(g * (len(navigators) + 1) + i if keys else float(i), i, *map(np.array, found[group, name]))
        for g, group in enumerate(groups)
        for i, name in enumerate(navigators)
        if (group, name) in found
    ]


def _draw(axes: Axes, boxes: Sequence[_Box], label: str, *, lost: bool) -> None:
    log, limits = _scale([box.values for box in boxes])
    axes.set(ylim=limits, yscale="log" if log else "linear", ylabel=label)
    if log:
        axes.yaxis.set_major_formatter("{x:g}")
    axes.grid(axis="y", which="major", alpha=0.4, lw=0.6)
    if log:
        axes.grid(axis="y", which="minor", alpha=0.15, lw=0.5)
    for box in boxes:
        statistics = box_statistics(box.values)
        shown = {key: np.clip(value, limits[0], limits[1]) for key, value in statistics.items()}
        shown["fliers"] = statistics["fliers"][np.isfinite(statistics["fliers"])]
        _draw_box(axes, box, shown)
        beyond = box.values > limits[1]
        if beyond.any():
            axes.plot(
                [box.at], [limits[1]], ls="", marker="^", ms=6, color=INK, clip_on=False, zorder=5,
                label=f"{beyond.sum()} beyond",
            )  # fmt: skip
    _print_above(axes, boxes, lost=lost)
    if lost and limits[0] < metrics.LOST_BEYOND_M < limits[1]:
        axes.axhline(metrics.LOST_BEYOND_M, color="#666666", lw=0.9, ls="--", zorder=1)
        axes.annotate(
            f"{metrics.LOST_BEYOND_M:g} m", (1, metrics.LOST_BEYOND_M), (4, 0), fontsize=8, color="#444444",
            xycoords=axes.get_yaxis_transform(), textcoords="offset points", va="center", annotation_clip=False,
        )  # fmt: skip


def _draw_box(axes: Axes, box: _Box, statistics: dict[str, Any]) -> None:
    from matplotlib.colors import to_rgba

    colour = OKABE_ITO[box.navigator % 8]
    axes.bxp(
        [statistics],
        positions=[box.at],
        widths=0.62,
        patch_artist=True,
        manage_ticks=False,
        boxprops={
            "facecolor": to_rgba(colour, 0.45),
            "edgecolor": INK,
            "linewidth": 0.9,
            "hatch": HATCHES[box.navigator % 8],
            "hatch_linewidth": 0.5,
        },
        medianprops={"color": INK, "linewidth": 2.0, "solid_capstyle": "butt"},
        whiskerprops={"color": INK, "linewidth": 0.9},
        capprops={"color": INK, "linewidth": 0.9},
        flierprops={"marker": "o", "ms": 3.5, "mfc": "none", "mec": colour, "mew": 0.9},
        zorder=3,
    )


def _print_above(axes: Axes, boxes: Sequence[_Box], *, lost: bool) -> None:
    """Lines of numbers over the panel: each box's median and, for errors at the end, the share lost."""
    lines = [("median", [_number(box_statistics(box.values)["med"]) for box in boxes])]
    if lost:
        shares = [float((box.final > metrics.LOST_BEYOND_M).mean()) for box in boxes]
        lines.insert(0, ("lost", [f"{100 * share:.0f} %" for share in shares]))
    size = 8 if len(boxes) <= 14 else 6.5
    for k, (name, texts) in enumerate(reversed(lines)):
        offset: dict[str, Any] = {"textcoords": "offset points", "fontsize": size, "annotation_clip": False}
        axes.annotate(
            name, (0, 1), (-6, 4 + 11 * k), xycoords="axes fraction", ha="right", color="#444444", **offset
        )
        for box, text in zip(boxes, texts, strict=True):
            axes.annotate(
                text, (box.at, 1), (0, 4 + 11 * k), xycoords=axes.get_xaxis_transform(), ha="center", **offset
            )


def _number(value: float) -> str:
    if not math.isfinite(value):
        return "∞"
    return f"{value:.2f}" if value < 10 else f"{value:.1f}" if value < 100 else f"{value:.0f}"


def _scale(values: Sequence[NDArray[np.float64]]) -> tuple[bool, tuple[float, float]]:
    medians = np.array([np.median(v[np.isfinite(v)]) for v in values if np.isfinite(v).any()])
    every = np.concatenate([v[np.isfinite(v)] for v in values])
    if not every.size:
        return False, (0.0, 1.0)
    if medians.max() > _LOG_ABOVE * max(medians.min(), 1e-3):
        return True, (max(float(every.min()) / 1.5, _LEAST_M), 1.6 * float(every.max()))
    return False, (0.0, 1.08 * max(float(every.max()), 1e-3))


def _between(axes: Axes, groups: int, navigators: int, *, grouped: bool) -> None:
    """Limits, and thin lines between the groups."""
    if not grouped:
        axes.set_xlim(-0.7, navigators - 0.3)
        return
    axes.set_xlim(-1.0, groups * (navigators + 1) - 1)
    for g in range(1, groups):
        axes.axvline(g * (navigators + 1) - 1, color="#999999", lw=0.8)
    axes.tick_params(axis="x", length=0)


def _centre(group: int, navigators: int) -> float:
    return group * (navigators + 1) + (navigators - 1) / 2


def _group_text(keys: Sequence[str], group: Sequence[Any]) -> str:
    if len(keys) == 1:
        return str(group[0])
    return "\n".join(f"{key} = {value}" for key, value in zip(keys, group, strict=True))


def _count_text(rows: Rows, keys: Sequence[str]) -> str:
    """How many runs and vehicles there are: "20 runs, 3 vehicles each"; a range where variants differ."""
    runs: dict[Any, set[Any]] = {}
    vehicles: dict[Any, set[Any]] = {}
    for row in rows:
        group = tuple(row[key] for key in keys)
        runs.setdefault(group, set()).add(row["run"])
        vehicles.setdefault(group, set()).add(row["vehicle"])

    def spoken(sizes: set[int], noun: str) -> str:
        text = "–".join(str(n) for n in sorted({min(sizes), max(sizes)}))
        return f"{text} {noun}" + ("" if sizes == {1} else "s")

    counts = spoken({len(r) for r in runs.values()}, "run")
    return f"{counts} of {spoken({len(v) for v in vehicles.values()}, 'vehicle')}"


def _legend(figure: Figure, navigators: Sequence[str], caption: str) -> None:
    from matplotlib.colors import to_rgba
    from matplotlib.patches import Patch

    handles = [
        Patch(facecolor=to_rgba(OKABE_ITO[i % 8], 0.45), edgecolor=INK, hatch=HATCHES[i % 8], label=name)
        for i, name in enumerate(navigators)
    ]
    figure.legend(
        handles=handles, loc="outside lower center", ncols=min(len(handles), 6), fontsize=8, frameon=False,
        handlelength=2.4, handleheight=1.2, title=caption, title_fontproperties={"size": 8},
    )  # fmt: skip
