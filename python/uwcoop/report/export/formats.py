"""Which formats tracks are exported to, and where the file goes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from uwcoop.errors import TracksError
from uwcoop.report.atomic_files import atomic_folder, atomic_write
from uwcoop.report.export import places, ros_bag, tables
from uwcoop.report.export.routes import Routes, read_routes
from uwcoop.scenario.base import nearest

__all__ = ["FORMATS", "Format", "export_tracks"]


@dataclass(frozen=True)
class Format:
    """How tracks are written in one format."""

    text: str
    write: Callable[[Routes, Path], None]
    """To a file; of `folder` formats into a folder that exists."""
    geographic: bool = False
    """Needs latitude and longitude."""
    folder: bool = False


FORMATS: dict[str, Format] = {
    "geojson": Format("GeoJSON (RFC 7946): a line for each path", places.write_geojson, geographic=True),
    "gpx": Format("GPX 1.1: a track for each path", places.write_gpx, geographic=True),
    "kml": Format(
        "KML 2.2: a line for each path, with times where they are known", places.write_kml, geographic=True
    ),
    "csv": Format("a row for each instant of each path", tables.write_csv),
    "tum": Format("a folder with a file of poses for each path (TUM RGB-D)", tables.write_tum, folder=True),
    "mcap": Format("MCAP of ROS 2 messages: poses, odometry, positions on Earth", ros_bag.write_mcap),
}
"""Formats by name."""


def export_tracks(
    folder: Path, kind: str, target: Path | None = None, navigators: Sequence[str] = ()
) -> tuple[Path, Routes]:
    """Write the tracks of a run's folder in another format; the file appears whole or not at all.

    Args:
        folder: that `uwcoop run -o` wrote.
        kind: a key of `FORMATS`.
        target: file, of TUM a folder; None: `tracks.KIND` (or `tum/`) in the folder.
        navigators: whose tracks; none named: of all. The truth is always there, where it is known.

    Returns:
        Where it was written, and what.

    Raises:
        TracksError: an unknown format, no tracks, an unknown navigator, or no latitude and longitude for a format that
            needs them.
    """
    if kind not in FORMATS:
        raise TracksError(f"format {kind!r} is unknown: {nearest(kind, list(FORMATS))}")
    form = FORMATS[kind]
    routes = read_routes(folder, navigators)
    if not routes.routes:
        raise TracksError(f"tracks of {folder} hold no position")
    if form.geographic and any(route.latitude_deg is None for route in routes.routes):
        raise TracksError(
            f"tracks of {folder} have no latitude and longitude, which {kind} needs: the mission's origin is not known, "
            "or pyproj was not installed; csv, tum and mcap hold local metres"
        )
    target = target or folder / (kind if form.folder else f"tracks.{kind}")
    if form.folder:
        with atomic_folder(target, [tables.file_name(route) for route in routes.routes]) as partial:
            form.write(routes, partial)
    else:
        with atomic_write(target) as partial:
            form.write(routes, partial)
    return target, routes
