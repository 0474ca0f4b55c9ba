"""Tracks as maps read them: GeoJSON, GPX, KML; WGS 84, at the instants of the 1 Hz grid."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

from uwcoop.figures.style import OKABE_ITO
from uwcoop.report.export.routes import TRUTH, Route, Routes

__all__ = ["write_geojson", "write_gpx", "write_kml"]

_GPX = "http://www.topografix.com/GPX/1/1"
_KML, _GX = "http://www.opengis.net/kml/2.2", "http://www.google.com/kml/ext/2.2"


def _places(route: Route) -> list[tuple[float, float, float, float]]:
    """Time, latitude, longitude and depth on the grid; all instants where the path has none on it."""
    assert route.latitude_deg is not None
    assert route.longitude_deg is not None
    at = route.whole_seconds if route.whole_seconds.any() else slice(None)
    columns = (route.time_s, route.latitude_deg, route.longitude_deg, route.depth_m)
    return [
        (t, lat, lon, depth) for t, lat, lon, depth in zip(*(c[at].tolist() for c in columns), strict=True)
    ]


def write_geojson(routes: Routes, path: Path) -> None:
    """A LineString (a Point where there is one instant only) for each path.

    Its properties hold `times` or `times_s`.
    """
    features: list[dict[str, Any]] = []
    for route in routes.routes:
        rows = _places(route)
        line = [[round(lon, 9), round(lat, 9), round(-depth, 3)] for _, lat, lon, depth in rows]
        times: dict[str, Any] = (
            {"times_s": [row[0] for row in rows]}
            if routes.epoch is None
            else {"times": [routes.utc(row[0]) for row in rows]}
        )
        about = {"name": route.name, "navigator": route.navigator, "vehicle": route.vehicle}
        about |= {"mission": routes.mission} | ({"counterfactual": routes.note} if routes.note else {})
        shape: dict[str, Any] = (
            {"type": "LineString", "coordinates": line}
            if len(line) > 1
            else {"type": "Point", "coordinates": line[0]}
        )
        features.append({"type": "Feature", "properties": {**about, **times}, "geometry": shape})
    collection = {"type": "FeatureCollection", "features": features}
    path.write_text(json.dumps(collection, allow_nan=False) + "\n", encoding="utf-8")


def write_gpx(routes: Routes, path: Path) -> None:
    """A track for each path; `ele` is the height above the surface, so minus the depth."""
    ElementTree.register_namespace("", _GPX)
    root = ElementTree.Element(f"{{{_GPX}}}gpx", {"version": "1.1", "creator": "uwcoop"})
    about = ElementTree.SubElement(root, f"{{{_GPX}}}metadata")
    _text(about, _GPX, "name", routes.mission)
    if routes.note:
        _text(about, _GPX, "desc", f"counterfactual: {routes.note}")
    for route in routes.routes:
        track = ElementTree.SubElement(root, f"{{{_GPX}}}trk")
        _text(track, _GPX, "name", route.name)
        segment = ElementTree.SubElement(track, f"{{{_GPX}}}trkseg")
        for time_s, lat, lon, depth in _places(route):
            place = {"lat": f"{lat:.9f}", "lon": f"{lon:.9f}"}
            point = ElementTree.SubElement(segment, f"{{{_GPX}}}trkpt", place)
            _text(point, _GPX, "ele", f"{-depth:.3f}")
            if utc := routes.utc(time_s):
                _text(point, _GPX, "time", utc)
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def write_kml(routes: Routes, path: Path) -> None:
    """A folder for each navigator with a path for each vehicle, laid on the surface and coloured by vehicle.

    With a known epoch the paths are `gx:Track`s, which a viewer's time slider plays.
    """
    ElementTree.register_namespace("", _KML)
    ElementTree.register_namespace("gx", _GX)
    root = ElementTree.Element(f"{{{_KML}}}kml")
    document = ElementTree.SubElement(root, f"{{{_KML}}}Document")
    _text(document, _KML, "name", routes.mission)
    if routes.note:
        _text(document, _KML, "description", f"counterfactual: {routes.note}")
    vehicles = list(dict.fromkeys(route.vehicle for route in routes.routes))
    for k in range(len(vehicles)):
        _style(document, f"vehicle-{k}", OKABE_ITO[k % 8], 3)
        _style(document, f"{TRUTH}-{k}", "#FFFFFF", 2)
    folders: dict[str, ElementTree.Element] = {}
    for route in routes.routes:
        if route.navigator not in folders:
            folders[route.navigator] = ElementTree.SubElement(document, f"{{{_KML}}}Folder")
            _text(folders[route.navigator], _KML, "name", route.navigator)
        mark = ElementTree.SubElement(folders[route.navigator], f"{{{_KML}}}Placemark")
        _text(mark, _KML, "name", route.name)
        kind = TRUTH if route.navigator == TRUTH else "vehicle"
        _text(mark, _KML, "styleUrl", f"#{kind}-{vehicles.index(route.vehicle)}")
        _kml_path(mark, routes, route)
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def _kml_path(mark: ElementTree.Element, routes: Routes, route: Route) -> None:
    rows = _places(route)
    if routes.epoch is None:
        line = ElementTree.SubElement(mark, f"{{{_KML}}}LineString")
        _text(line, _KML, "tessellate", "1")
        _text(line, _KML, "coordinates", " ".join(f"{lon:.9f},{lat:.9f},0" for _, lat, lon, _ in rows))
        return
    track = ElementTree.SubElement(mark, f"{{{_GX}}}Track")
    _text(track, _KML, "altitudeMode", "clampToGround")
    for row in rows:
        _text(track, _KML, "when", routes.utc(row[0]) or "")
    for _, lat, lon, _ in rows:
        _text(track, _GX, "coord", f"{lon:.9f} {lat:.9f} 0")


def _style(document: ElementTree.Element, name: str, colour: str, width: int) -> None:
    style = ElementTree.SubElement(document, f"{{{_KML}}}Style", {"id": name})
    line = ElementTree.SubElement(style, f"{{{_KML}}}LineStyle")
    red, green, blue = colour[1:3], colour[3:5], colour[5:7]
    _text(line, _KML, "color", f"ff{blue}{green}{red}".lower())
    _text(line, _KML, "width", str(width))


def _text(parent: ElementTree.Element, space: str, name: str, text: str) -> None:
    ElementTree.SubElement(parent, f"{{{space}}}{name}").text = text
