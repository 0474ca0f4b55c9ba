"""The tracks of a run's folder in the formats of other programs: GeoJSON, GPX, KML, CSV, TUM, MCAP."""

from uwcoop.report.export.formats import FORMATS, export_tracks

__all__ = ["FORMATS", "export_tracks"]
