"""Charts of water depth: reading, synthesising, gridding, and what terrain says about position."""

from uwcoop.charts.chart import Chart, bilinear_depth
from uwcoop.charts.gridding import grid_soundings
from uwcoop.charts.information import describe, reachable_sigma
from uwcoop.charts.read import load_chart
from uwcoop.charts.synthetic import synthetic

__all__ = [
    "Chart",
    "bilinear_depth",
    "describe",
    "grid_soundings",
    "load_chart",
    "reachable_sigma",
    "synthetic",
]
