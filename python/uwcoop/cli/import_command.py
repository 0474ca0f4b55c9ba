"""`uwcoop import`: recordings of real vehicles as a mission log."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from uwcoop.cli.terminal import print_notes, say

if TYPE_CHECKING:
    from collections.abc import Sequence

    from uwcoop.importers.mapping.proposal import ChannelLine


def import_(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE…",
            help="ROS 1 and ROS 2 bags, CSV, ArduPilot .bin, MAVLink .tlog, MOOS .alog, IMC .lsf; or a data set "
            "(MRCLAM, GOATS, Plaza, Labyrinth).",
        ),
    ],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="MISSION.mcap", help="The log to write.")
    ] = None,
    config: Annotated[
        Path | None,
        typer.Option(
            "--config", "-c", metavar="FILE.toml", help="Which channel is which sensor; see --inspect."
        ),
    ] = None,
    preset: Annotated[
        str | None,
        typer.Option(
            "--preset", metavar="NAME", help="A packaged mapping: bluerov2, cougars, holoocean, iver."
        ),
    ] = None,
    inspect: Annotated[
        bool,
        typer.Option(
            "--inspect", help="List what the files hold, and print the TOML that would import them."
        ),
    ] = False,
    truth: Annotated[
        list[str] | None,
        typer.Option(
            "--truth",
            metavar="[VEHICLE=]FILE|/TOPIC",
            help="Where the vehicles were: a table or a topic of the files. Repeatable.",
        ),
    ] = None,
) -> None:
    """Make a mission log of recordings: what was read, dropped, converted and assumed is printed and stays in the log."""
    from uwcoop.importers.recordings import import_recordings
    from uwcoop.missionlog.mcap import write_log
    from uwcoop.report.atomic_files import check_file

    overrides = {} if preset is None else {"preset": preset}
    if inspect:
        _inspect(files, config, overrides)
        return
    if output is None or output.suffix != ".mcap":
        raise typer.BadParameter(
            "must be a file that ends in .mcap, or --inspect lists what there is", param_hint="-o"
        )
    check_file(output)
    log = import_recordings(files, config, overrides=overrides, truth=truth or ())
    write_log(log, output)
    print_notes(log)
    say(
        f"wrote {output}: {len(log.vehicles)} vehicles, {log.duration_ns / 1e9:g} s, "
        f"{sum(len(t['t_ns']) for t in log.events.values()):,} events, {len(log.slots.get('tol_ns', ())):,} ranges, "
        f"{output.stat().st_size / 1e6:.1f} MB"
    )


def _inspect(files: Sequence[Path], config: Path | None, overrides: dict[str, str]) -> None:
    """The channels on stderr, the proposed TOML on stdout: `> import.toml` keeps it."""
    from uwcoop.importers.datasets.detect import is_dataset
    from uwcoop.importers.import_config import load_config
    from uwcoop.importers.mapping.proposal import channel_lines, proposed_toml
    from uwcoop.importers.recordings import read_sources

    if len(files) == 1 and is_dataset(files[0]):
        say(f"{files[0]} is a data set with a reader of its own: it needs no TOML")
        return
    told = load_config(config, overrides)
    sources = read_sources(files, told)
    for source in sources:
        say(f"{source.name}: {source.format}")
        for note in source.notes:
            say(f"note: {note}")
    for line in _listing(channel_lines(sources)):
        say(line)
    typer.echo(proposed_toml(sources, told), nl=False)


def _listing(lines: Sequence[ChannelLine]) -> list[str]:
    """Name, type, rows, rate, span and what it looks like, in columns; below each channel its values."""
    cells = [
        (
            line.name, line.kind, f"{line.count:,} rows", f"{line.rate_hz:.3g} Hz" if line.rate_hz else "", line.span,
            line.meaning or "not recognised",
        )
        for line in lines
    ]  # fmt: skip
    widths = [max((len(row[k]) for row in cells), default=0) for k in range(5)]
    listed = []
    for row, line in zip(cells, lines, strict=True):
        told = [
            cell.rjust(w) if k in (2, 3) else cell.ljust(w)
            for k, (cell, w) in enumerate(zip(row, widths, strict=False))
        ]
        listed.append("  ".join([*told, row[5]]).rstrip())
        listed += [f"    {column}" for column in line.columns]
    return listed
