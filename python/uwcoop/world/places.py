"""Places of a scenario in the local frame: degrees to metres, areas to paths, and what looks misplaced."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.errors import ScenarioError
from uwcoop.frames import LocalFrame, Origin, yaw_from_heading
from uwcoop.scenario.models import check_starts_at_zero
from uwcoop.scenario.vehicle import Adrift, AreaShare, Lawnmower, Waypoints
from uwcoop.world.area_lines import path_length_m, survey_paths
from uwcoop.world.paths import fixed_corners

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from uwcoop.charts import Chart
    from uwcoop.scenario.area import Area
    from uwcoop.scenario.models import Scenario
    from uwcoop.scenario.vehicle import Path, Vehicle
    from uwcoop.world.vehicles import Motion

STEP_S = 1.0
"""The world moves in steps of one second."""
_ZERO_M = 0.01
"""So near to the origin the first landmark's degrees count as the origin."""
_DEGREES_SPAN = 5.0
"""Paths in degrees span no more: a vehicle's mission of 500 km is none of this program's."""


@dataclass(frozen=True)
class Placed:
    """A scenario whose every place is in local metres."""

    scenario: Scenario
    origin: Origin
    notes: tuple[str, ...]


def placed(scenario: Scenario, chart: Chart | None) -> Placed:
    """Put every place of a scenario into the local frame.

    Raises:
        ScenarioError: degrees without an origin, two origins, an area that cannot be surveyed, a path that is
            shorter than its vehicle's step or that lies like degrees.
    """
    origin = _origin(scenario, chart)
    notes: list[str] = []
    paths: dict[str, Path | None] = {vehicle.name: vehicle.path for vehicle in scenario.team}
    if scenario.area is not None:
        paths |= _area_paths(scenario, scenario.area, origin, notes)
    for vehicle in scenario.team:
        where = f"vehicle {vehicle.name}"
        paths[vehicle.name] = path = path_in_metres(paths[vehicle.name], origin, where)
        _check_path(vehicle, path, where, notes)
    if scenario.exchange is not None:
        first = scenario.main[0]
        paths[first] = _at_the_origin(first, paths[first])
    if all(paths[vehicle.name] is vehicle.path for vehicle in scenario.team):
        return Placed(scenario, origin, tuple(notes))
    team = tuple(vehicle.model_copy(update={"path": paths[vehicle.name]}) for vehicle in scenario.team)
    # Drifts and sensors of the team are those of the scenario already: the copies change nothing but the paths.
    return Placed(scenario.model_copy(update={"vehicles": team}), origin, tuple(notes))


def _origin(scenario: Scenario, chart: Chart | None) -> Origin:
    of_chart = chart is not None and chart.origin.latitude_deg is not None
    place = scenario.origin or scenario.deployment
    if place.latitude_deg is None or place.longitude_deg is None:
        return chart.origin if chart is not None else Origin()
    if chart is not None and of_chart:
        raise ScenarioError(
            f"scenario {scenario.name!r} states an origin, and chart {chart.name!r} has one: leave out the scenario's"
        )
    return LocalFrame.at(place.latitude_deg, place.longitude_deg).origin


def _frame(origin: Origin, where: str) -> LocalFrame:
    if origin.latitude_deg is None:
        raise ScenarioError(
            f"{where}: latitude and longitude need an origin: a [chart] that lies somewhere on Earth, or a table "
            "[origin] with latitude_deg and longitude_deg"
        )
    return LocalFrame(origin)


def _local(points: Sequence[tuple[float, float]], origin: Origin, where: str) -> list[tuple[float, float]]:
    latitude, longitude = np.array(points).T
    local = _frame(origin, where).to_local(latitude, longitude)
    return [(float(east), float(north)) for east, north in local]


def path_in_metres(path: Path | None, origin: Origin, where: str) -> Path | None:
    """The path with metres around `origin` in place of degrees."""
    if isinstance(path, Waypoints) and path.waypoints_deg is not None:
        points = tuple(_local(path.waypoints_deg, origin, where))
        return path.model_copy(update={"waypoints_m": points, "waypoints_deg": None})
    if isinstance(path, Lawnmower | Adrift) and path.start_deg is not None:
        (start,) = _local([path.start_deg], origin, where)
        return path.model_copy(update={"start_m": start, "start_deg": None})
    return path


def _at_the_origin(name: str, path: Path | None) -> Path | None:
    """The first landmark's path, which starts at the origin: degrees do so but for rounding."""
    if isinstance(path, Waypoints) and path.waypoints_m and np.hypot(*path.waypoints_m[0]) < _ZERO_M:
        return path.model_copy(update={"waypoints_m": ((0.0, 0.0), *path.waypoints_m[1:])})
    if isinstance(path, Lawnmower) and path.start_m and np.hypot(*path.start_m) < _ZERO_M:
        return path.model_copy(update={"start_m": (0.0, 0.0)})
    assert isinstance(path, Waypoints | Lawnmower)
    try:
        check_starts_at_zero(name, path)
    except ValueError as error:
        raise ScenarioError(str(error)) from error
    return path


def _area_paths(scenario: Scenario, area: Area, origin: Origin, notes: list[str]) -> dict[str, Waypoints]:
    team = [vehicle for vehicle in scenario.team if isinstance(vehicle.path, AreaShare)]
    yaw = None if area.heading_deg is None else float(yaw_from_heading(area.heading_deg))
    polygon = polygon_in_metres(area, origin)
    speeds = [vehicle.speed_mps for vehicle in team]
    found = survey_paths(polygon, area.line_spacing_m, yaw, area.margin_m, speeds)
    paths = {}
    for vehicle, corners in zip(team, found, strict=True):
        length_m = path_length_m(corners)
        need_s = length_m / vehicle.speed_mps
        notes.append(
            f"area: {vehicle.name} gets {length_m:,.0f} m of {polygon.area:,.0f} m², {need_s:,.0f} s at "
            f"{vehicle.speed_mps:g} m/s; the mission lasts {scenario.duration_s:,.0f} s"
        )
        points = tuple((float(east), float(north)) for east, north in corners)
        paths[vehicle.name] = Waypoints(kind="waypoints", waypoints_m=points)
    return paths


def polygon_in_metres(area: Area, origin: Origin) -> Any:
    """The area's polygon in local metres."""
    shapely = _shapely()
    if area.polygon_m is not None:
        return shapely.Polygon(area.polygon_m)
    if area.polygon_deg is not None:
        return shapely.Polygon(_local(area.polygon_deg, origin, "area"))
    frame = _frame(origin, "area")
    return shapely.transform(polygon_of_wkt(area), lambda xy: frame.to_local(xy[:, 1], xy[:, 0]))


def _shapely() -> Any:
    from uwcoop.errors import MissingDependencyError

    try:
        import shapely
    except ImportError as error:
        raise MissingDependencyError("shapely", "maps") from error
    return shapely


def polygon_of_wkt(area: Area) -> Any:
    """The polygon of `area.wkt`, degrees, longitude first."""
    shapely = _shapely()
    assert area.wkt is not None
    try:
        found = shapely.from_wkt(area.wkt)
    except shapely.GEOSException as error:
        raise ScenarioError(f"area.wkt cannot be read: {' '.join(str(error).split())[:200]}") from error
    if found is None or found.geom_type != "Polygon" or found.is_empty:
        raise ScenarioError(f"area.wkt is {area.wkt[:60]!r}: must be one POLYGON")
    lowest, highest = np.array(found.bounds).reshape(2, 2)
    if lowest[0] < -180 or highest[0] > 360 or lowest[1] < -90 or highest[1] > 90:
        raise ScenarioError(
            f"area.wkt reaches from {lowest[0]:g}, {lowest[1]:g} to {highest[0]:g}, {highest[1]:g}: must be degrees, "
            "longitude first (metres go into polygon_m)"
        )
    return found


def _check_path(vehicle: Vehicle, path: Path | None, where: str, notes: list[str]) -> None:
    """Refuse a path that its vehicle passes in one step, or that lies like degrees."""
    if isinstance(path, Adrift):
        points = np.array([path.start_m])
    elif isinstance(path, Waypoints | Lawnmower):
        points = fixed_corners(path)
    else:
        return
    degrees = _like_degrees(points)
    hint = (
        f": [{points[0][0]:.10g}, {points[0][1]:.10g}] looks like latitude and longitude, which waypoints_deg and "
        "start_deg take"
        if degrees
        else ""
    )
    if isinstance(path, Waypoints):
        length_m = path_length_m(points)
        step_m = vehicle.speed_mps * STEP_S
        if length_m < step_m:
            raise ScenarioError(
                f"{where}: its path of {length_m:.3g} m is shorter than its step of {step_m:g} m{hint}"
            )
        if degrees and length_m < 100 * step_m and _decimals(points):
            raise ScenarioError(f"{where}: its path of {length_m:.3g} m{hint}")
    elif hint and _decimals(points[:1]):
        notes.append(f"{where}: start_m{hint}")


def _like_degrees(points: NDArray[np.float64]) -> bool:
    first, second = np.abs(points).max(axis=0)
    span = np.ptp(points, axis=0).max()
    return bool(
        first <= 90
        and second <= 360
        and np.abs(points).max() > 1
        and (len(points) == 1 or span < _DEGREES_SPAN)
    )


def _decimals(points: NDArray[np.float64]) -> bool:
    """Whether most numbers have three decimals or more, as degrees have and metres of a plan have not."""
    return bool(np.mean(np.abs(points - np.round(points, 2)) > 1e-9) > 0.5)


def coverage_notes(scenario: Scenario, chart: Chart | None, motion: Sequence[Motion]) -> list[str]:
    """How much of planned paths lies off the chart or over its holes, where it is more than nothing."""
    notes = []
    for vehicle, moved in zip(scenario.team, motion, strict=True):
        if chart is None or vehicle.track is not None:
            continue
        off = np.isnan(chart.depth_at(moved.position_m))
        if off.mean() >= 0.01:
            notes.append(
                f"vehicle {vehicle.name}: {100 * off.mean():.0f} % of its path lies off the chart {chart.name!r} or over "
                "holes: no soundings there"
            )
    return notes
