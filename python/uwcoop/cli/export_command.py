"""`uwcoop export`: tracks in other programs' formats."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from uwcoop.cli.terminal import names_of, say


def export(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder that `run -o` or `demo` wrote.")],
    kind: Annotated[str, typer.Option("--to", metavar="geojson|gpx|kml|csv|tum|mcap", help="The format.")],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FILE", help="File (tum: folder); else tracks.FORMAT in DIR."),
    ] = None,
    navigator: Annotated[
        str | None,
        typer.Option(
            "--navigator",
            "-n",
            metavar="NAME,…",
            help="Navigators, separated by commas; else all. The truth comes along.",
        ),
    ] = None,
) -> None:
    """Write the tracks of a run for other programs: maps, spreadsheets, trajectory tools, Foxglove, Rerun."""
    from uwcoop.report.export import export_tracks

    target, routes = export_tracks(folder, kind, output, names_of(navigator) or ())
    dated = "seconds since the start (the epoch is not known)" if routes.epoch is None else "UTC"
    if routes.note:
        say(f"note: counterfactual: {routes.note}")
    say(f"wrote {target}: {len(routes.routes)} paths, times in {dated}")
