"""A chart as a picture: depths with hillshade, and where terrain determines a vehicle's position."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.charts.information import Sounding, describe, reachable_sigma
from uwcoop.errors import MissingDependencyError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from uwcoop.charts.chart import Chart

HOLE_COLOUR = "0.85"
MOST_PIXELS = 1200
"""Charts with more nodes than this on a side are thinned for the picture: no printed page shows more."""


def chart_figure(chart: Chart, sounding: Sounding | None = None) -> Figure:
    """Depth with hillshade on the left; on the right the position that one crossing of terrain can fix.

    Metres east and north, equal scales, holes grey. The figure belongs to no window: save it with `savefig`.

    Raises:
        MissingDependencyError: matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise MissingDependencyError("matplotlib", "figures") from error
    sounding = sounding or Sounding()
    west, south, east, north = chart.extent
    tall = (north - south) / (east - west)
    beside = tall > 0.5  # a wide chart's two maps stand one above the other
    width = 12.0 if beside else 10.0
    panel = (width / 2 if beside else width) - 1.7
    height = panel * tall * (1 if beside else 2) + (1.5 if beside else 2.2)
    figure = Figure(figsize=(width, float(np.clip(height, 4.0, 14.0))), layout="constrained")
    axes = figure.subplots(*((1, 2) if beside else (2, 1)), sharex=True, sharey=True)
    draw_depth(axes[0], chart)
    _draw_information(axes[1], chart, sounding)
    facts = describe(chart, sounding)
    figure.suptitle(_title(facts))
    # One pass of the layout cuts labels off where maps of equal scales do not fill their places.
    figure.draw_without_rendering()
    return figure


def draw_depth(axes: Axes, chart: Chart, *, colour_bar: bool = True) -> None:
    """Depths, hillshade and contours of a chart on existing axes."""
    import matplotlib as mpl
    from matplotlib.colors import Normalize

    depth, extent = _thinned(chart.depth_m.astype(np.float64), chart)
    shallow, deep = np.nanquantile(depth, [0.002, 0.998])
    norm = Normalize(float(shallow), float(max(deep, shallow + 1e-6)))
    colours = mpl.colormaps["viridis_r"](norm(np.nan_to_num(depth, nan=float(shallow))))
    shade = _hillshade(depth, extent)
    colours[..., :3] = _soft_light(colours[..., :3], shade[..., None])
    colours[np.isnan(depth)] = mpl.colors.to_rgba(HOLE_COLOUR)
    axes.imshow(colours, origin="lower", extent=extent, interpolation="nearest")
    _contours(axes, depth, extent, norm)
    _frame(axes)
    axes.set_title("Water depth")
    if colour_bar:
        mappable = mpl.cm.ScalarMappable(norm, "viridis_r")
        bar = axes.figure.colorbar(mappable, ax=axes, label="depth (m)", shrink=0.85, extend="both")
        bar.ax.invert_yaxis()


def _draw_information(axes: Axes, chart: Chart, sounding: Sounding) -> None:
    import matplotlib as mpl
    from matplotlib.colors import BoundaryNorm

    sigma, extent = _thinned(reachable_sigma(chart, sounding), chart)
    bounds = [0.2, 0.5, 1, 2, 5, 10, 20]
    colour_map = mpl.colormaps["cividis_r"].resampled(len(bounds) + 1).with_extremes(bad=HOLE_COLOUR)
    norm = BoundaryNorm(bounds, colour_map.N, extend="both")
    shown = np.ma.masked_invalid(np.where(np.isposinf(sigma), 1e9, sigma))
    image = axes.imshow(
        shown, origin="lower", extent=extent, cmap=colour_map, norm=norm, interpolation="nearest"
    )
    axes.figure.colorbar(
        image, ax=axes, label="σ of position, worse direction (m)", shrink=0.85, ticks=bounds, format="%g"
    )
    _frame(axes)
    axes.set_title(f"Where terrain helps: one crossing of {sounding.window_m:g} m")


def _frame(axes: Axes) -> None:
    axes.set_aspect("equal")
    axes.set_xlabel("east (m)")
    axes.set_ylabel("north (m)")
    axes.ticklabel_format(useOffset=False, style="plain")
    axes.locator_params(nbins=6)
    axes.label_outer()
    box = {"boxstyle": "round,pad=0.2", "facecolor": "white", "alpha": 0.75, "linewidth": 0}
    axes.annotate(
        "N",
        xy=(0.955, 0.97),
        xytext=(0.955, 0.87),
        xycoords="axes fraction",
        ha="center",
        va="center",
        bbox=box,
        arrowprops={"arrowstyle": "-|>", "color": "black", "linewidth": 1.2},
    )


def _contours(
    axes: Axes, depth: NDArray[np.float64], extent: tuple[float, float, float, float], norm: Any
) -> None:
    """Labelled depth lines, about eight of them, at round depths."""
    from matplotlib.ticker import MaxNLocator

    levels = [
        level for level in MaxNLocator(8).tick_values(norm.vmin, norm.vmax) if norm.vmin < level < norm.vmax
    ]
    if not levels or min(depth.shape) < 3:
        return
    rows, cols = depth.shape
    x = np.linspace(extent[0], extent[1], 2 * cols + 1)[1::2]
    y = np.linspace(extent[2], extent[3], 2 * rows + 1)[1::2]
    lines = axes.contour(x, y, np.ma.masked_invalid(depth), levels, colors="black", linewidths=0.5, alpha=0.5)
    axes.clabel(lines, fontsize=7, fmt="%g")


def _thinned(
    values: NDArray[np.float64], chart: Chart
) -> tuple[NDArray[np.float64], tuple[float, float, float, float]]:
    """Every k-th node, and the outer edges of the pixels around them: west, east, south, north."""
    step = max(1, int(np.ceil(max(chart.shape) / MOST_PIXELS)))
    part = values[::step, ::step]
    half, cell = step * chart.cell_m / 2, step * chart.cell_m
    rows, cols = part.shape
    return part, (
        chart.east0_m - half,
        chart.east0_m - half + cols * cell,
        chart.north0_m - half,
        chart.north0_m - half + rows * cell,
    )


def _hillshade(depth: NDArray[np.float64], extent: tuple[float, float, float, float]) -> NDArray[np.float64]:
    """Light from the north-west at 45°, 0 to 1, 0.5 on flat ground; relief raised until slopes show."""
    cell = (extent[1] - extent[0]) / depth.shape[1]
    north, east = np.gradient(-depth, cell)
    steep = np.hypot(north, east)
    usual = float(np.nanquantile(steep, 0.9)) if np.isfinite(steep).any() else 0.0
    raised = 0.6 / usual if usual > 0 else 0.0
    lit = (1 + raised * (east - north) / np.sqrt(2)) / np.sqrt(1 + (raised * steep) ** 2)
    return np.asarray(np.clip(np.nan_to_num(0.5 * lit, nan=0.5), 0.0, 1.0))


def _soft_light(colours: NDArray[Any], shade: NDArray[np.float64]) -> NDArray[Any]:
    """Shade over colour that leaves flat ground's colour as it is, so that the colour bar stays true."""
    strength = 0.7
    shade = 0.5 + strength * (shade - 0.5)
    return np.asarray(np.where(shade <= 0.5, colours * 2 * shade, 1 - (1 - colours) * 2 * (1 - shade)))


def _title(facts: dict[str, Any]) -> str:
    depth, terrain = facts["depth_m"], facts["terrain"]
    size = f"{facts['size_m']['east']:,.0f} × {facts['size_m']['north']:,.0f} m, cell {facts['cell_m']:.3g} m"
    helps = "unknown" if terrain["helps_share"] is None else f"{100 * terrain['helps_share']:.0f} %"
    return (
        f"{facts['name']}: {size}, {depth['min']:.1f}–{depth['max']:.1f} m deep, "
        f"holes {100 * facts['hole_share']:.0f} %\n"
        f"σ below {terrain['helps_below_m']:g} m on {helps} of the charted area "
        f"(soundings of {terrain['sounding_sigma_m']:g} m, chart error {facts['sigma_map_m']:g} m)"
    )
