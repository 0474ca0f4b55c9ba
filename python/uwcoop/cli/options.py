"""Arguments and options that several commands have."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

ScenarioArgument = Annotated[
    str,
    typer.Argument(
        metavar="SCENARIO", help="A packaged scenario's name (`uwcoop scenarios`), or a TOML file."
    ),
]


def _note_secrets(settings: list[str] | None) -> list[str] | None:
    if not settings:
        return settings
    from uwcoop.cli.terminal import say
    from uwcoop.scenario.secrets import sets_secret

    if any(sets_secret(setting) for setting in settings):
        say(
            "note: every user of this machine can see a key on a command line: key_env or key_file names a place for it"
        )
    return settings


SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        callback=_note_secrets,
        metavar="KEY=VALUE",
        help="Override a scenario key, e.g. acoustics.loss.probability=0.2 or navigator.mpf.particles=2000. "
        "Repeatable.",
    ),
]
SeedOption = Annotated[
    int | None, typer.Option(min=0, metavar="N", help="Seed of the mission; else the scenario's.")
]
ChartFileOption = Annotated[
    Path | None, typer.Option("--chart", metavar="FILE", help="Chart file, instead of the scenario's seabed.")
]
NavigatorsOption = Annotated[
    str | None,
    typer.Option(
        "--navigator",
        "-n",
        metavar="NAME,…",
        help="Navigators, separated by commas; else all that are packaged.",
    ),
]
FolderOption = Annotated[
    Path | None, typer.Option("-o", "--output", metavar="DIR", help="Folder for the results.")
]
JsonOption = Annotated[
    bool, typer.Option("--json", help="Print the content of summary.json on stdout, and nothing else there.")
]
FiguresOption = Annotated[
    bool, typer.Option("--figures", help="Draw further pictures into DIR, as far as there are data for them.")
]
PicturesOption = Annotated[
    Literal["png", "pdf", "svg"],
    typer.Option("--pictures", help="Format of the pictures: errors.pdf in place of errors.png."),
]
WithoutOption = Annotated[
    list[str] | None,
    typer.Option(
        "--without",
        metavar="VEHICLE",
        help="Leave a vehicle out, as if it had not been there (a counterfactual). Repeatable.",
    ),
]
HoldOutOption = Annotated[
    str | None,
    typer.Option(
        "--hold-out",
        metavar="fix[:SHARE][@VEHICLE,…]",
        help="Withhold fixes from the navigators and score them: all groups after a vehicle's first, or a share.",
    ),
]
TruthOption = Annotated[
    list[str] | None,
    typer.Option(
        "--truth",
        metavar="[VEHICLE=]FILE|/TOPIC",
        help="Truth from a table (time, latitude, longitude or east, north) or a topic of the log. Repeatable.",
    ),
]
