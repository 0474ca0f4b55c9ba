"""Where charts and soundings lie: projections, their scale, longitudes across ±180°, areas, stray positions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.errors import ChartError
from uwcoop.frames import LocalFrame, Origin, crs_of, crs_text, transformer

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Values = NDArray[np.float64]

NO_PROJECTION = "no projection: positions taken as local metres, place on Earth unknown"
LARGEST_SCALE_ERROR = 0.002
"""A projection whose metres differ by more than this from metres on the ground is not kept."""
METRES_PER_DEGREE = 111_195.0
_STRAY_SHARE = 0.02
_LEAST_GAP_M = 1000.0
_FEWEST_JUDGED = 10


@dataclass(frozen=True)
class Area:
    """What is wanted of a chart: a box of latitudes and longitudes, degrees; longitudes count modulo 360."""

    south_deg: float
    west_deg: float
    north_deg: float
    east_deg: float

    @classmethod
    def of(cls, corners: Sequence[float] | str) -> Area:
        """From latitude and longitude of two opposite corners, as numbers or as "47.60,-122.40,47.61,-122.38".

        Raises:
            ChartError: not four numbers, degrees out of range, or no extent.
        """
        text = corners.replace(" ", "") if isinstance(corners, str) else ",".join(map(str, corners))
        try:
            lat0, lon0, lat1, lon1 = (float(part) for part in text.split(","))
        except ValueError as error:
            raise ChartError(
                f"area {text!r} must be latitude,longitude,latitude,longitude of two opposite corners, degrees"
            ) from error
        for name, values, bound in (("latitude", (lat0, lat1), 90.0), ("longitude", (lon0, lon1), 360.0)):
            worst = max(values, key=abs)
            if not abs(worst) <= bound:
                raise ChartError(
                    f"area's {name} {worst:g} is outside -{bound:g} to {bound:g} deg: "
                    "an area is latitude,longitude of two opposite corners"
                )
        # The shorter way round: 179.9 to -179.9 spans 0.2 degrees.
        span = (lon1 - lon0 + 180.0) % 360.0 - 180.0
        if lat0 == lat1 or span == 0:
            raise ChartError(f"area {text!r} has no extent")
        west = lon0 if span > 0 else lon0 + span
        return cls(min(lat0, lat1), west, max(lat0, lat1), west + abs(span))

    def bounds(self, crs: Any, middle_x: float) -> tuple[float, float, float, float]:
        """Smallest x and y and largest x and y of the area on the axes of a pyproj CRS.

        Args:
            crs: None for local metres, which have no latitudes.
            middle_x: of the chart: its longitudes may count from -180 or from 0 degrees.
        """
        if crs is None:
            raise ChartError("area is in degrees, but the positions are local metres: give crs")
        if crs.is_geographic:
            turn = 360.0 * round((middle_x - (self.west_deg + self.east_deg) / 2) / 360.0)
            return self.west_deg + turn, self.south_deg, self.east_deg + turn, self.north_deg
        t = np.linspace(0.0, 1.0, 21)
        lon = self.west_deg + (self.east_deg - self.west_deg) * np.concatenate([t, t, 0 * t, 0 * t + 1])
        lat = self.south_deg + (self.north_deg - self.south_deg) * np.concatenate([0 * t, 0 * t + 1, t, t])
        x, y = transformer("EPSG:4326", crs).transform(lon, lat)
        if not (np.isfinite(x).all() and np.isfinite(y).all()):
            raise ChartError(f"area {self} lies outside of the projection {crs_text(crs)}")
        return float(np.min(x)), float(np.min(y)), float(np.max(x)), float(np.max(y))

    def __str__(self) -> str:
        return f"{self.south_deg:g},{self.west_deg:g} to {self.north_deg:g},{self.east_deg:g}"


def horizontal(crs: Any) -> Any:
    """The horizontal part of a pyproj CRS that may have a vertical one too."""
    if crs.is_compound:
        return horizontal(crs.sub_crs_list[0])
    if crs.is_bound:
        return horizontal(crs.source_crs)
    return crs.to_2d() if len(crs.axis_info) == 3 else crs


def middle_of(crs: Any, x: float, y: float) -> tuple[float, float]:
    """WGS 84 latitude and longitude, degrees, of a place in `crs`."""
    longitude, latitude = transformer(crs, "EPSG:4326").transform(x, y)
    if not (np.isfinite(latitude) and np.isfinite(longitude)):
        raise ChartError(f"position ({x:g}, {y:g}) is outside the projection {crs_text(crs)}")
    return float(latitude), float(longitude)


def is_metric(crs: Any) -> bool:
    """Whether a projection's axes are in metres."""
    return bool(crs.is_projected) and all(
        abs(axis.unit_conversion_factor - 1) < 1e-12 for axis in crs.axis_info
    )


def frame_for(crs: Any, x: float, y: float, origin: Origin | None) -> tuple[LocalFrame, tuple[str, ...]]:
    """The local frame of positions in `crs` around `origin` or, without one, around (x, y), and notes.

    The frame's projection is the origin's, else `crs` itself where its metres are metres on the ground, else a
    transverse Mercator of its own.
    """
    latitude, longitude = middle_of(crs, x, y)
    own: str | None = None
    notes: tuple[str, ...] = ()
    if is_metric(crs):
        error = _scale_error(crs, latitude, longitude)
        if abs(error) <= LARGEST_SCALE_ERROR:
            own = crs_text(crs)
        else:
            notes = (
                f"{crs.name}: its metres are {1 + error:.4g} times those on the ground here, "
                "so positions go to a local transverse Mercator",
            )
    notes += _outside_its_use(crs, latitude, longitude)
    if origin is not None and origin.latitude_deg is not None and origin.longitude_deg is not None:
        return LocalFrame.at(origin.latitude_deg, origin.longitude_deg, origin.crs or own), notes
    return LocalFrame.at(latitude, longitude, own), notes


def _scale_error(crs: Any, latitude: float, longitude: float) -> float:
    """Relative error of a projection's metres at a place, in the worse direction."""
    from pyproj import Proj
    from pyproj.exceptions import ProjError

    try:
        factors = Proj(crs).get_factors(longitude, latitude)
    except ProjError as error:
        raise ChartError(
            f"projection {crs_text(crs)} has no scale at {latitude:g} N, {longitude:g} E"
        ) from error
    scales = (
        factors.meridional_scale,
        factors.parallel_scale,
        factors.tissot_semimajor,
        factors.tissot_semiminor,
    )
    return float(max(scales, key=lambda k: abs(k - 1)) - 1)


def _outside_its_use(crs: Any, latitude: float, longitude: float) -> tuple[str, ...]:
    """A note where a place lies outside the area that a projection is made for: a wrong zone, swapped columns."""
    # The description that a file carries often lacks the area that its name in the register has.
    use = crs.area_of_use or crs_of(crs_text(crs)).area_of_use
    if use is None:
        return ()
    east = use.east + (360.0 if use.east < use.west else 0.0)
    over = (longitude - use.west) % 360.0
    if use.south - 1 <= latitude <= use.north + 1 and (over <= east - use.west + 1 or over >= 359.0):
        return ()
    return (
        f"{latitude:.3f} N, {longitude:.3f} E lies outside of the area that {crs.name} is made for "
        f"({use.name}): is it the right projection, are easting and northing in their places?",
    )


def check_degrees(longitude: Values, latitude: Values) -> None:
    """Refuse what is no longitude or latitude."""
    for name, values, bound in (("latitude", latitude, 90.0), ("longitude", longitude, 360.0)):
        worst = float(values[np.argmax(np.abs(values))])
        if abs(worst) > bound:
            raise ChartError(
                f"{name} {worst:g} deg is outside -{bound:g} to {bound:g} deg: are columns in another order?"
            )


def unwrapped(longitude: Values) -> Values:
    """Longitudes without a step of 360° between neighbours on Earth: all within 180° of their circular median."""
    turned = np.exp(1j * np.deg2rad(longitude))
    # The mean direction is enough to choose where the circle is cut; strays barely turn it.
    middle = float(np.rad2deg(np.angle(turned.mean())))
    near = middle + (longitude - middle + 180.0) % 360.0 - 180.0
    # Where nothing wraps, the numbers stay as the file has them, to the last bit.
    return longitude if np.abs(near - longitude).max() < 1e-6 else np.asarray(near)


def unwrapped_axis(longitude: Values) -> Values:
    """A grid's axis of longitudes that steps over ±180° made steady; any other as it is."""
    steps = np.diff(longitude)
    jumps = np.abs(steps) > 180.0
    if not jumps.any():
        return longitude
    return np.concatenate(
        [longitude[:1], longitude[0] + np.cumsum(np.where(jumps, steps - 360.0 * np.sign(steps), steps))]
    )


def strays(x: Values, y: Values, degrees: bool) -> NDArray[np.bool_]:
    """Which positions lie far from all others: at most one in fifty, beyond a gap wider than all the rest.

    Args:
        x, y: (N,) longitudes and latitudes, or metres.
        degrees: which of the two.
    """
    stray = np.zeros(x.size, dtype=bool)
    if x.size < _FEWEST_JUDGED:
        return stray
    most = max(1, int(_STRAY_SHARE * x.size))
    scale_y = METRES_PER_DEGREE if degrees else 1.0
    scale_x = scale_y * (max(0.01, float(np.cos(np.deg2rad(np.median(y))))) if degrees else 1.0)
    for values, scale in ((x, scale_x), (y, scale_y)):
        stray |= _beyond_a_gap(values * scale, most)
    return stray if np.count_nonzero(stray) <= most else np.zeros(x.size, dtype=bool)


def _beyond_a_gap(values: Values, most: int) -> NDArray[np.bool_]:
    """Which values of one axis, at most `most` on either side, lie beyond a gap wider than what lies between."""
    ordered = np.sort(values)
    low, high = 0, ordered.size - 1
    gaps = np.diff(ordered)
    core = max(_LEAST_GAP_M, float(ordered[-1 - most] - ordered[most]))
    if (below := np.flatnonzero(gaps[:most] > core)).size:
        low = int(below[-1]) + 1
    if (above := np.flatnonzero(gaps[::-1][:most] > core)).size:
        high = ordered.size - 2 - int(above[-1])
    return np.asarray((values < ordered[low]) | (values > ordered[high]))
