"""`uwcoop chart`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from uwcoop.cli.terminal import say, show, terminal

__all__ = ["chart"]


def chart(
    files: Annotated[
        list[str],
        typer.Argument(
            metavar="FILE…",
            help="GeoTIFF, NetCDF (CF, GMT, GEBCO), BAG, S-102, ESRI ASCII grid; soundings as CSV or XYZ, "
            "several files "
            "as surveys of one chart; or synthetic:st-john.",
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="CHART.tif|CHART.nc",
            help="Write depth, its sigma and the position sigma that terrain allows, as GeoTIFF or NetCDF.",
        ),
    ] = None,
    picture: Annotated[
        Path | None, typer.Option(metavar="PNG", help="Draw the depths and where terrain determines a position.")
    ] = None,
    area: Annotated[
        str | None,
        typer.Option(
            metavar="LAT,LON,LAT,LON",
            help="Read only this part: two opposite corners in degrees, e.g. --area=47.60,-122.40,47.61,-122.38.",
        ),
    ] = None,
    columns: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,DEPTH[,SURVEY[,TIME]]",
            help="Names of the columns of soundings in the header, e.g. lon,lat,depth.",
        ),
    ] = None,
    cell: Annotated[float | None, typer.Option(metavar="M", help="Distance between nodes.")] = None,
    crs: Annotated[
        str | None, typer.Option(metavar="EPSG:N", help='Projection of the positions, or "local" for metres.')
    ] = None,
    positive: Annotated[
        str | None, typer.Option(metavar="up|down", help="The way in which the file's numbers grow.")
    ] = None,
    depth_unit: Annotated[
        str | None, typer.Option(metavar="m|ft|fathom", help="Unit of the depths, which become metres.")
    ] = None,
    nodata: Annotated[
        float | None,
        typer.Option(metavar="VALUE", help="A number that means no data, where the file does not say so."),
    ] = None,
    max_gap: Annotated[
        float | None,
        typer.Option(metavar="M", help="Of soundings: nodes farther than this from all of them are holes."),
    ] = None,
    from_soundings: Annotated[
        bool,
        typer.Option(
            "--from-soundings",
            help="The files hold soundings: compare each survey with the chart made of the others.",
        ),
    ] = False,
    align: Annotated[
        bool,
        typer.Option("--align", help="Of soundings: shift segments of 900 s until crossing ones agree."),
    ] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the description as JSON on stdout, and nothing else there.")
    ] = False,
) -> None:  # fmt: skip
    """Describe a chart: extent, cell, depths, holes, slopes, and where terrain determines a position."""
    import json

    from uwcoop.charts import describe, load_sounded, write_chart
    from uwcoop.charts.stored import check_suffix
    from uwcoop.report.input_tables import chart_table, residuals_table
    from uwcoop.world.simulate import open_source

    options: dict[str, Any] = {
        "columns": columns, "cell_m": cell, "crs": crs, "positive": positive, "depth_unit": depth_unit,
        "nodata": nodata, "area": area, "max_gap_m": max_gap,
    }  # fmt: skip
    given = {key: value for key, value in options.items() if value is not None}
    if output is not None:
        check_suffix(output)  # before a minute of gridding
    made = load_sounded(files, align=align, **given) if from_soundings or align else None
    found = open_source(files if len(files) > 1 else files[0], **given) if made is None else made.chart
    facts = describe(found) | ({} if made is None else made.as_dict())
    if picture is not None:
        from uwcoop.report.run_folder import write_chart_picture

        write_chart_picture(found, picture)
    if output is not None:
        write_chart(found, output)
    if as_json:
        typer.echo(json.dumps(facts, indent=2, allow_nan=False))
    else:
        show(chart_table(facts), terminal())
        if made is not None:
            show(residuals_table(facts), terminal())
    for written in (picture, output):
        if written is not None:
            say(f"wrote {written}")
