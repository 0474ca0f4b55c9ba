"""Tracks as text tables: CSV, and poses in the form of the TUM RGB-D benchmark, which trajectory tools read."""

from __future__ import annotations

import csv
import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.report.export.routes import Route, Routes

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["CSV_COLUMNS", "file_name", "write_csv", "write_tum", "yaw_or_course"]

CSV_COLUMNS = (
    "navigator", "vehicle", "time_s", "time_utc", "east_m", "north_m", "depth_m", "latitude_deg", "longitude_deg",
    "yaw_rad", "cov_ee_m2", "cov_en_m2", "cov_nn_m2",
)  # fmt: skip


def write_csv(routes: Routes, path: Path) -> None:
    """One row for each instant of each path; what is not known is empty."""
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(CSV_COLUMNS)
        for route in routes.routes:
            optional = _optional_columns(route)
            for k, time_s in enumerate(route.time_s):
                rows.writerow(
                    [
                        route.navigator,
                        route.vehicle,
                        f"{time_s:.9f}",
                        routes.utc(float(time_s)) or "",
                        f"{route.position_m[k, 0]:.4f}",
                        f"{route.position_m[k, 1]:.4f}",
                        f"{route.depth_m[k]:.3f}",
                        *(_cell(column, k, form) for column, form in optional),
                    ]
                )


def _optional_columns(route: Route) -> list[tuple[NDArray[np.float64] | None, str]]:
    """The last columns, None for one that is not known, and how a number of each is written."""
    covariance = route.covariance_m2
    parts = [None if covariance is None else covariance[:, a, b] for a, b in ((0, 0), (0, 1), (1, 1))]
    return [
        (route.latitude_deg, ".9f"),
        (route.longitude_deg, ".9f"),
        (route.yaw_rad, ".6f"),
        *((part, ".9g") for part in parts),
    ]


def _cell(column: NDArray[np.float64] | None, k: int, form: str) -> str:
    return "" if column is None or not np.isfinite(column[k]) else f"{column[k]:{form}}"


def file_name(route: Route) -> str:
    """`team_V1.tum`."""
    return re.sub(r"[^A-Za-z0-9._-]+", "_", f"{route.navigator}_{route.vehicle}") + ".tum"


def write_tum(routes: Routes, folder: Path) -> None:
    """`NAVIGATOR_VEHICLE.tum` for each path: `t x y z qx qy qz qw`, metres east, north, up, a blank between, no header.

    Seconds since 1970 where the epoch is known, else since the start.
    """
    start_s = 0.0 if routes.epoch is None else routes.epoch.timestamp()
    for route in routes.routes:
        yaw = yaw_or_course(route)
        level = np.zeros((len(yaw), 2))
        table = np.column_stack(
            [
                start_s + route.time_s,
                route.position_m,
                -route.depth_m,
                level,
                np.sin(yaw / 2),
                np.cos(yaw / 2),
            ]
        )
        np.savetxt(folder / file_name(route), table, fmt=["%.9f", *["%.4f"] * 3, *["%.9f"] * 4])


def yaw_or_course(route: Route) -> NDArray[np.float64]:
    """Yaw, rad, (N,); the course over ground where it is not known."""
    course = np.zeros(len(route.time_s))
    if len(route.time_s) > 1:
        step = np.gradient(route.position_m, axis=0)
        course = np.arctan2(step[:, 1], step[:, 0])
    if route.yaw_rad is None:
        return course
    return np.asarray(np.where(np.isfinite(route.yaw_rad), route.yaw_rad, course))
