"""Where on Earth a mission takes place, told before its chart is read: a large chart is read for this part alone."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from uwcoop.charts.places import Area
from uwcoop.frames import LocalFrame, crs_of, transformer
from uwcoop.scenario.vehicle import Adrift, AreaShare, Lawnmower, Waypoints
from uwcoop.world.paths import fixed_corners
from uwcoop.world.places import path_in_metres, polygon_in_metres, polygon_of_wkt
from uwcoop.world.track_file import read_rows

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from uwcoop.scenario.models import Scenario
    from uwcoop.scenario.vehicle import Vehicle

    Points = NDArray[np.float64]

MARGIN_M = 500.0
"""Around paths and tracks: vehicles drift off them, and estimates lie beside them."""


def mission_area(scenario: Scenario) -> Area | None:
    """The box around a scenario's paths, tracks and area with `chart.margin_m` on each side.

    Returns:
        None where a vehicle's place is in metres, whose zero is the middle of a chart that is not read yet.

    Raises:
        ScenarioError: a track or an area that cannot be read.
    """
    places = [_degrees(vehicle, scenario) for vehicle in scenario.team]
    if any(place is None for place in places):
        return None
    degrees = np.concatenate([place for place in places if place is not None])
    first = degrees[0]
    frame = LocalFrame.at(float(first[0]), float(first[1]))
    points = [frame.to_local(*degrees.T)]
    points += [_corners(vehicle, frame) for vehicle in scenario.team]
    if scenario.area is not None:
        west, south, east, north = polygon_in_metres(scenario.area, frame.origin).bounds
        points.append(np.array([[west, south], [east, north]]))
    every = np.concatenate(points)
    if not np.isfinite(every).all():
        return None
    margin_m = (
        MARGIN_M if scenario.chart is None or scenario.chart.margin_m is None else scenario.chart.margin_m
    )
    (west, south), (east, north) = every.min(axis=0) - margin_m, every.max(axis=0) + margin_m
    t = np.linspace(0.0, 1.0, 5)
    at_east, at_north = np.meshgrid(west + (east - west) * t, south + (north - south) * t)
    latitude, longitude = frame.to_geographic(np.column_stack([at_east.ravel(), at_north.ravel()])).T
    # On both sides of the date line the longitudes go on from the first one's.
    longitude = first[1] + np.mod(longitude - first[1] + 180.0, 360.0) - 180.0
    return Area(float(latitude.min()), float(longitude.min()), float(latitude.max()), float(longitude.max()))


def _degrees(vehicle: Vehicle, scenario: Scenario) -> Points | None:
    """Latitudes and longitudes that the vehicle's place is told by, (N, 2); None: it is told in metres."""
    if vehicle.track is not None:
        return _track_degrees(vehicle)
    path = vehicle.path
    if isinstance(path, Waypoints) and path.waypoints_deg is not None:
        return np.array(path.waypoints_deg)
    if isinstance(path, Lawnmower | Adrift) and path.start_deg is not None:
        return np.array([path.start_deg])
    if isinstance(path, AreaShare) and scenario.area is not None:
        if scenario.area.polygon_deg is not None:
            return np.array(scenario.area.polygon_deg)
        if scenario.area.wkt is not None:
            return np.array(polygon_of_wkt(scenario.area).exterior.coords)[:, 1::-1]
    return None


def _track_degrees(vehicle: Vehicle) -> Points | None:
    track = vehicle.track
    assert track is not None
    cells = read_rows(track, f"vehicle {vehicle.name}: track {track.file}").cells
    if "longitude" in cells:
        return np.column_stack([cells["latitude"], cells["longitude"]])
    if track.crs is None:
        return None
    longitude, latitude = transformer(crs_of(track.crs), "EPSG:4326").transform(cells["east"], cells["north"])
    return np.column_stack([latitude, longitude])


def _corners(vehicle: Vehicle, frame: LocalFrame) -> Points:
    """Corners of a path that is told by its start and lengths, local metres, (N, 2)."""
    path = vehicle.path
    if vehicle.track is not None or not isinstance(path, Lawnmower | Adrift):
        return np.zeros((0, 2))
    local = path_in_metres(path, frame.origin, f"vehicle {vehicle.name}")
    if isinstance(local, Lawnmower):
        return fixed_corners(local)
    assert isinstance(local, Adrift)
    assert local.start_m is not None
    # Three standard deviations of where it is in the long run.
    return np.array([local.start_m]) + 3.0 * local.spread_m * np.array([[-1.0, -1.0], [1.0, 1.0]])
