"""Charts of water depth: reading, synthesising, gridding, and the terrain's information on position."""

from uwcoop.charts.chart import Chart, bilinear_depth
from uwcoop.charts.gridding import Gridded, Soundings, grid_and_judge, grid_soundings
from uwcoop.charts.information import describe, reachable_sigma
from uwcoop.charts.read import load_chart, load_sounded
from uwcoop.charts.residuals import ResidualReport
from uwcoop.charts.soundings import load_soundings
from uwcoop.charts.stored import write_chart
from uwcoop.charts.synthetic import synthetic

__all__ = [
    "Chart",
    "Gridded",
    "ResidualReport",
    "Soundings",
    "bilinear_depth",
    "describe",
    "grid_and_judge",
    "grid_soundings",
    "load_chart",
    "load_sounded",
    "load_soundings",
    "reachable_sigma",
    "synthetic",
    "write_chart",
]
