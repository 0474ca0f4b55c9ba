"""The only place where a convention is converted.

Inside the package: local ENU metres, `yaw_rad` counter-clockwise from east (REP 103). Outside it, in scenario
files and prints: `heading_deg` clockwise from north; in charts and recordings: WGS 84 or a map projection.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.errors import ChartError, MissingDependencyError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray


def yaw_from_heading(heading_deg: ArrayLike) -> NDArray[np.float64]:
    """`yaw_rad`, counter-clockwise from east in (-π, π], of `heading_deg`, clockwise from north."""
    return wrap_angle(np.pi / 2 - np.deg2rad(np.asarray(heading_deg, dtype=np.float64)))


def heading_from_yaw(yaw_rad: ArrayLike) -> NDArray[np.float64]:
    """`heading_deg`, clockwise from north in [0, 360), of `yaw_rad`, counter-clockwise from east."""
    heading = np.mod(90.0 - np.rad2deg(np.asarray(yaw_rad, dtype=np.float64)), 360.0)
    # A tiny negative angle rounds up to 360 itself.
    return np.asarray(np.where(heading >= 360.0, 0.0, heading))


def wrap_angle(angle_rad: ArrayLike) -> NDArray[np.float64]:
    """The same angle in (-π, π], radians."""
    return np.asarray(np.pi - np.mod(np.pi - np.asarray(angle_rad, dtype=np.float64), 2 * np.pi))


def turned(vectors: NDArray[np.float64], angle_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """Vectors (K, 2) turned counter-clockwise by angles (K,)."""
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    x, y = vectors.T
    return np.column_stack([cosine * x - sine * y, sine * x + cosine * y])


def crs_of(text: object) -> Any:
    """The pyproj CRS that `text` ("EPSG:32654", WKT, PROJ string, number) names.

    Raises:
        ChartError: nothing that pyproj knows.
        MissingDependencyError: pyproj is not installed.
    """
    try:
        from pyproj import CRS
        from pyproj.exceptions import CRSError
    except ImportError as error:
        raise MissingDependencyError("pyproj", "maps") from error
    try:
        return CRS.from_user_input(text)
    except CRSError as error:
        raise ChartError(f"projection {text!r} is unknown: give an EPSG code such as EPSG:32654") from error


def crs_text(crs: Any) -> str:
    """A text that names a pyproj CRS for good: "EPSG:32654" where it has a code, WKT otherwise."""
    authority = crs.to_authority()
    return ":".join(authority) if authority else str(crs.to_wkt())


def transformer(source: Any, target: Any) -> Any:
    """The pyproj transformer between two projections, x east and y north on both sides.

    Raises:
        ChartError: there is no way from one to the other, as for a planet other than the Earth.
    """
    from pyproj import Transformer
    from pyproj.exceptions import ProjError

    try:
        return Transformer.from_crs(source, target, always_xy=True)
    except ProjError as error:
        said = " ".join(str(error).split())[:200]
        raise ChartError(f"projection {source} cannot be converted to {target}: {said}") from error


def local_projection(latitude_deg: float, longitude_deg: float) -> str:
    """PROJ string of the conformal metric projection around a place: transverse Mercator, scale 1 there."""
    return (
        f"+proj=tmerc +lat_0={latitude_deg!r} +lon_0={longitude_deg!r} +k=1 +x_0=0 +y_0=0 "
        "+datum=WGS84 +units=m +no_defs"
    )


@dataclass(frozen=True)
class Origin:
    """WGS 84 position of the local frame's zero, and how it was projected (None: a purely local frame)."""

    latitude_deg: float | None = None
    longitude_deg: float | None = None
    crs: str | None = None


@dataclass(frozen=True)
class LocalFrame:
    """Local metres, east and north, around a place on Earth: what a person has in degrees, the program in metres.

        frame = LocalFrame.at(47.60, -122.40)
        frame.to_local([47.601], [-122.399])     # (1, 2): [[75.2, 111.2]]
        frame.to_geographic([[75.2, 111.2]])     # (1, 2): [[47.601, -122.399]]

    A chart's frame is `LocalFrame(chart.origin)`. Needs pyproj, of the extra `maps`.

    With a grid projection such as UTM, "north" is grid north and a metre is a grid metre, so a chart's nodes
    keep their places; `convergence_deg` says how far grid north lies from true north.

    Raises:
        ChartError: the origin has no latitude and longitude, or its projection is unknown.
    """

    origin: Origin

    def __post_init__(self) -> None:
        if self.origin.latitude_deg is None or self.origin.longitude_deg is None:
            raise ChartError("local frame has no geographic origin: its latitude and longitude are unknown")

    @classmethod
    def at(cls, latitude_deg: float, longitude_deg: float, crs: str | None = None) -> LocalFrame:
        """The frame around a place, in projection `crs` or (None) in a transverse Mercator of its own."""
        if not -90 <= latitude_deg <= 90:
            raise ChartError(f"latitude {latitude_deg} deg is outside -90 to 90 deg")
        if not -180 <= longitude_deg <= 360:
            raise ChartError(f"longitude {longitude_deg} deg is outside -180 to 360 deg")
        return cls(Origin(latitude_deg, longitude_deg, crs or local_projection(latitude_deg, longitude_deg)))

    @property
    def crs_text(self) -> str:
        """The frame's projection, as `crs_of` reads it."""
        latitude, longitude = self.origin.latitude_deg, self.origin.longitude_deg
        assert latitude is not None
        assert longitude is not None
        return self.origin.crs or local_projection(latitude, longitude)

    @cached_property
    def _crs(self) -> Any:
        return crs_of(self.crs_text)

    @cached_property
    def _transformer(self) -> Any:
        return transformer("EPSG:4326", self._crs)

    @cached_property
    def offset_m(self) -> tuple[float, float]:
        """Easting and northing of the origin in the projection, metres: projected = local + offset."""
        east, north = self._transformer.transform(self.origin.longitude_deg, self.origin.latitude_deg)
        return float(east), float(north)

    @cached_property
    def convergence_deg(self) -> float:
        """Clockwise angle from true north to the frame's north at the origin, degrees."""
        from pyproj import Proj

        factors = Proj(self._crs).get_factors(self.origin.longitude_deg, self.origin.latitude_deg)
        return float(factors.meridian_convergence)

    @property
    def description(self) -> str:
        """One line: the projection, where its zero lies, and how its north differs from true north."""
        place = f"{self.origin.latitude_deg:.6f} N, {self.origin.longitude_deg:.6f} E"
        if abs(self.offset_m[0]) < 1e-6 and abs(self.offset_m[1]) < 1e-6:
            return f"local frame: transverse Mercator around {place}; its north is true north there"
        turn = self.convergence_deg
        return (
            f"local frame: {self._crs.name} shifted to {place}; its north is grid north, "
            f"{abs(turn):.2f} deg {'east' if turn >= 0 else 'west'} of true north"
        )

    def local_from(self, crs: Any, x: ArrayLike, y: ArrayLike) -> NDArray[np.float64]:
        """Local [east, north] metres, (N, 2), of positions (N,) in another pyproj CRS, x east and y north."""
        there = transformer(crs, self._crs)
        east, north = there.transform(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
        return np.column_stack([east, north]) - self.offset_m

    def to_local(self, latitude_deg: ArrayLike, longitude_deg: ArrayLike) -> NDArray[np.float64]:
        """Local [east, north] metres, (N, 2), of WGS 84 positions in degrees, (N,) each."""
        longitude = np.atleast_1d(np.asarray(longitude_deg, dtype=np.float64))
        latitude = np.atleast_1d(np.asarray(latitude_deg, dtype=np.float64))
        east, north = self._transformer.transform(longitude, latitude)
        return np.column_stack([east, north]) - self.offset_m

    def to_geographic(self, points: ArrayLike) -> NDArray[np.float64]:
        """WGS 84 [latitude, longitude] degrees, (N, 2), of local [east, north] metres, (N, 2)."""
        projected = np.asarray(points, dtype=np.float64).reshape(-1, 2) + self.offset_m
        longitude, latitude = self._transformer.transform(
            projected[:, 0], projected[:, 1], direction="INVERSE"
        )
        return np.column_stack([latitude, longitude])
