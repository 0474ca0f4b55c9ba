"""`[area]`: a polygon that vehicles with `path.kind = "area"` survey together."""

from __future__ import annotations

import json
from typing import Annotated, Any

from pydantic import Field, model_validator

from uwcoop.errors import MissingDependencyError
from uwcoop.importers.bounded import read_text
from uwcoop.scenario.base import NonNegative, PlaceDeg, Point, Positive, Table

_POLYGONS = ("polygon_deg", "polygon_m", "wkt")


class Area(Table):
    """A polygon to survey, and the lines to survey it with. The vehicles share the lines by their speeds."""

    polygon_deg: Annotated[tuple[PlaceDeg, ...], Field(strict=False, min_length=3)] | None = None
    """Corners as [latitude, longitude]."""
    polygon_m: Annotated[tuple[Point, ...], Field(strict=False, min_length=3)] | None = None
    """Corners as [east, north] in the local frame."""
    wkt: str | None = None
    """POLYGON of longitude and latitude, as GIS programs write it; may have holes."""
    file: str | None = None
    """GeoJSON or WKT, relative to the scenario file; read when there is no polygon, which it then gives."""
    line_spacing_m: Positive
    """Between lines: except for the margin, no point of the area is farther than half of it from a line."""
    heading_deg: float | None = None
    """Of the lines, clockwise from north; without it along the area's longest side."""
    margin_m: NonNegative = 0.0
    """Kept from the polygon's edge."""

    @model_validator(mode="before")
    @classmethod
    def _read_the_file(cls, data: Any) -> Any:
        # The polygon becomes part of the scenario, so that a log or a study does not depend on the file.
        if not isinstance(data, dict) or any(data.get(key) is not None for key in _POLYGONS):
            return data
        if not isinstance(data.get("file"), str):
            return data
        return {**data, "wkt": wkt_of_file(data["file"])}

    @model_validator(mode="after")
    def _one_polygon(self) -> Area:
        given = [key for key in _POLYGONS if getattr(self, key) is not None]
        if len(given) != 1:
            has = " and ".join(given) or "none of them"
            raise ValueError(f"has {has}: must have one of {', '.join(_POLYGONS)}, file")
        return self


def wkt_of_file(file: str) -> str:
    """The polygon of a GeoJSON or WKT file as WKT.

    Raises:
        ValueError: a file that cannot be read, or that does not hold one polygon.
        MissingDependencyError: shapely is not installed.
    """
    try:
        import shapely
        from shapely.geometry import shape
    except ImportError as error:
        raise MissingDependencyError("shapely", "maps") from error
    try:
        text = read_text(file, encoding="utf-8-sig").strip()
        found = shape(_geometry(json.loads(text))) if text.startswith("{") else shapely.from_wkt(text)
    except (OSError, ValueError, LookupError, TypeError, RecursionError, shapely.GEOSException) as error:
        raise ValueError(f"file {file} cannot be read: {' '.join(str(error).split())[:200]}") from error
    if found.geom_type == "MultiPolygon" and len(found.geoms) == 1:
        found = found.geoms[0]
    if found.geom_type != "Polygon" or found.is_empty:
        raise ValueError(f"file {file} holds a {found.geom_type}: must hold one Polygon")
    return str(found.wkt)


def _geometry(value: Any) -> Any:
    """The only geometry of a GeoJSON object."""
    kind = value.get("type")
    if kind == "Feature":
        return value["geometry"]
    if kind == "FeatureCollection":
        if len(value["features"]) != 1:
            raise ValueError(f"it has {len(value['features'])} features, must have 1")
        return value["features"][0]["geometry"]
    return value
