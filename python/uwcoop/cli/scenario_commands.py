"""Commands about scenario files: packaged scenarios, keys, the budget of a schedule."""

from __future__ import annotations

from typing import Annotated

import typer

from uwcoop.cli.options import NavigatorsOption, ScenarioArgument, SetOption
from uwcoop.cli.terminal import names_of, terminal


def scenarios(
    name: Annotated[
        str | None,
        typer.Argument(metavar="[NAME]", help="Print this scenario's file, to start one of your own from."),
    ] = None,
) -> None:
    """List the packaged scenarios and navigators, or print the file of one scenario."""
    from uwcoop.navigators import NAVIGATORS
    from uwcoop.report.input_tables import packaged_tables
    from uwcoop.scenario import packaged, packaged_text

    if name is not None:
        typer.echo(packaged_text(name), nl=False)
        return
    terminal().print(packaged_tables(packaged(), {name: spec.summary for name, spec in NAVIGATORS.items()}))


def keys(
    prefix: Annotated[
        str, typer.Argument(metavar="[PREFIX]", help="Only keys that begin with it, e.g. acoustics.modem.")
    ] = "",
    as_json: Annotated[bool, typer.Option("--json", help="Print them as JSON on stdout.")] = False,
) -> None:
    """List the keys of a scenario file, as `--set` takes them: unit, default, bound and meaning."""
    import json
    from dataclasses import asdict

    from uwcoop.report.input_tables import keys_table
    from uwcoop.report.keys import all_keys

    found = all_keys(prefix)
    if as_json:
        typer.echo(json.dumps([asdict(key) for key in found], indent=2, ensure_ascii=False))
    else:
        terminal().print(keys_table(found))


def budget(
    scenario: ScenarioArgument,
    navigator: NavigatorsOption = None,
    settings: SetOption = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the plan as JSON on stdout, and nothing else there.")
    ] = False,
) -> None:
    """Show the acoustic budget: fields, bytes, frames, air time, slot and cycle; the same for other teams and slots."""
    import json
    from dataclasses import asdict

    from uwcoop.experiment.mission import load_scenario
    from uwcoop.experiment.packet_budget import budget as count
    from uwcoop.report.budget_tables import budget_report

    plan = count(load_scenario(scenario, None, settings or ()), names_of(navigator))
    if as_json:
        typer.echo(json.dumps(asdict(plan), indent=2, ensure_ascii=False, allow_nan=False))
    else:
        terminal().print(budget_report(plan))
