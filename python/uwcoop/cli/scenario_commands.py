"""Commands about scenario files: packaged scenarios, keys, the budget of a schedule."""

from __future__ import annotations

from typing import Annotated

import typer

from uwcoop.cli.options import NavigatorsOption, ScenarioArgument, SetOption
from uwcoop.cli.terminal import names_of, show, terminal


def scenarios(
    name: Annotated[
        str | None,
        typer.Argument(metavar="[NAME]", help="Print this scenario's file, to start one of your own from."),
    ] = None,
    as_json: Annotated[
        bool,
        typer.Option("--json", help="Print names and descriptions as JSON on stdout; of NAME, its keys."),
    ] = False,
) -> None:
    """List the packaged scenarios and navigators, or print the file of one scenario."""
    from uwcoop.navigators import NAVIGATORS
    from uwcoop.report.input_tables import packaged_tables
    from uwcoop.scenario import load, packaged, packaged_text

    if name is not None:
        typer.echo(_as_json(load(name).resolved()) if as_json else packaged_text(name), nl=as_json)
        return
    navigators = {name: spec.summary for name, spec in NAVIGATORS.items()}
    if as_json:
        typer.echo(_as_json({"scenarios": dict(packaged()), "navigators": navigators}))
    else:
        show(packaged_tables(packaged(), navigators), terminal())


def _as_json(told: object) -> str:
    import json

    return json.dumps(told, indent=2, ensure_ascii=False, allow_nan=False)


def keys(
    prefix: Annotated[
        str, typer.Argument(metavar="[PREFIX]", help="Only keys that begin with it, e.g. acoustics.modem.")
    ] = "",
    as_json: Annotated[bool, typer.Option("--json", help="Print them as JSON on stdout.")] = False,
) -> None:
    """List the keys of a scenario file, as `--set` takes them: unit, default, bound and meaning."""
    from dataclasses import asdict

    from uwcoop.report.input_tables import keys_table
    from uwcoop.report.keys import all_keys

    found = all_keys(prefix)
    if as_json:
        typer.echo(_as_json([asdict(key) for key in found]))
    else:
        show(keys_table(found), terminal())


def budget(
    scenario: ScenarioArgument,
    navigator: NavigatorsOption = None,
    settings: SetOption = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the plan as JSON on stdout, and nothing else there.")
    ] = False,
) -> None:
    """Show the acoustic budget: fields, bytes, frames, air time, slot and cycle; the same for other teams and slots."""
    from dataclasses import asdict

    from uwcoop.experiment.mission import load_scenario
    from uwcoop.experiment.packet_budget import budget as count
    from uwcoop.report.budget_tables import budget_report

    plan = count(load_scenario(scenario, None, settings or ()), names_of(navigator))
    if as_json:
        typer.echo(_as_json(asdict(plan)))
    else:
        show(budget_report(plan), terminal())
