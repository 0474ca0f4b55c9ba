"""The commands of `uwcoop`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from uwcoop.cli.options import (
    ChartFileOption,
    FiguresOption,
    FolderOption,
    JsonOption,
    NavigatorsOption,
    ScenarioArgument,
    SeedOption,
    SetOption,
)
from uwcoop.cli.terminal import (
    OneLineErrors,
    names_of,
    needs_folder,
    print_notes,
    print_run,
    progress,
    say,
    say_written,
    terminal,
)

app = typer.Typer(
    cls=OneLineErrors,
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Cooperative localisation of underwater vehicles: simulate missions, replay them through navigators, "
    "compare.",
    epilog="Start with [bold]uwcoop demo[/bold]. Errors end in one line and exit code 2.",
)


def _print_version(wanted: bool) -> None:
    if wanted:
        import uwcoop

        typer.echo(f"uwcoop {uwcoop.__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


@app.command()
def demo(
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for the results.")
    ] = Path("uwcoop-demo"),
) -> None:
    """Localise three simulated AUVs by every navigator: table, pictures and a replay in a folder."""
    from uwcoop.experiment.demo import run_demo, steps

    with progress("simulating", steps()) as step:
        result, files = run_demo(output, step, say)
    print_run(result, terminal())
    say_written(files, output)
    say(f"`uwcoop view {output}` plays the mission; `uwcoop run {output / 'mission.mcap'}` replays its log")


@app.command()
def scenarios() -> None:
    """What is packaged: scenarios to fly and navigators to fly them with."""
    from uwcoop.navigators import NAVIGATORS
    from uwcoop.report.input_tables import packaged_tables
    from uwcoop.scenario import packaged

    terminal().print(packaged_tables(packaged(), {name: spec.summary for name, spec in NAVIGATORS.items()}))


@app.command()
def chart(
    file: Annotated[
        str,
        typer.Argument(
            metavar="FILE",
            help="GeoTIFF, NetCDF (CF, GMT, GEBCO), BAG, ESRI ASCII grid, soundings as CSV or XYZ; or "
            "synthetic:st-john.",
        ),
    ],
    picture: Annotated[
        Path | None, typer.Option(metavar="PNG", help="Write depths and where terrain helps as a picture.")
    ] = None,
    columns: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,DEPTH[,SURVEY[,TIME]]",
            help="Of soundings: their names in the header, e.g. lon,lat,depth.",
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
    max_gap: Annotated[
        float | None,
        typer.Option(metavar="M", help="Of soundings: nodes farther than this from all of them are holes."),
    ] = None,
    from_soundings: Annotated[
        bool,
        typer.Option(
            "--from-soundings",
            help="FILE holds soundings: compare each survey with the chart made of the others.",
        ),
    ] = False,
    align: Annotated[
        bool,
        typer.Option("--align", help="Of soundings: shift segments of 900 s until crossing ones agree."),
    ] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the facts as JSON on stdout, and nothing else there.")
    ] = False,
) -> None:
    """What a chart holds: extent, cell, depths, holes, slopes, and where terrain tells a position."""
    import json

    from uwcoop.charts import describe, load_sounded
    from uwcoop.report.input_tables import chart_table, residuals_table
    from uwcoop.report.run_folder import write_chart_picture
    from uwcoop.world.simulate import open_source

    options: dict[str, Any] = {
        "columns": columns,
        "cell_m": cell,
        "crs": crs,
        "positive": positive,
        "depth_unit": depth_unit,
        "max_gap_m": max_gap,
    }
    given = {key: value for key, value in options.items() if value is not None}
    made = load_sounded(file, align=align, **given) if from_soundings or align else None
    found = open_source(file, **given) if made is None else made.chart
    facts = describe(found) | ({} if made is None else made.as_dict())
    if picture is not None:
        write_chart_picture(found, picture)
    if as_json:
        typer.echo(json.dumps(facts, indent=2, allow_nan=False))
    else:
        terminal().print(chart_table(facts))
        if made is not None:
            terminal().print(residuals_table(facts))
    if picture is not None:
        say(f"wrote {picture}")


@app.command()
def simulate(
    scenario: ScenarioArgument,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="MISSION.mcap", help="The log to write.")],
    seed: SeedOption = None,
    chart: ChartFileOption = None,
    settings: SetOption = None,
) -> None:
    """Simulate a mission and write its log (MCAP, standard ROS 2 messages)."""
    from uwcoop.experiment.mission import LOG_SUFFIX, load_scenario
    from uwcoop.missionlog.mcap import write_log
    from uwcoop.world.simulate import simulate as fly

    if output.suffix != LOG_SUFFIX:
        raise typer.BadParameter(f"{output} must end in {LOG_SUFFIX}", param_hint="-o")
    log = fly(load_scenario(scenario, chart, settings or ()), seed)
    write_log(log, output)
    print_notes(log)
    say(
        f"wrote {output}: {len(log.vehicles)} vehicles, {log.duration_ns / 1e9:g} s, seed {log.seed}, "
        f"{output.stat().st_size / 1e6:.1f} MB"
    )


@app.command()
def run(
    mission: Annotated[
        str,
        typer.Argument(
            metavar="MISSION", help="A log (.mcap), or a scenario's name or file, simulated first."
        ),
    ],
    navigator: NavigatorsOption = None,
    output: FolderOption = None,
    as_json: JsonOption = False,
    seed: Annotated[
        int | None,
        typer.Option(
            min=0,
            metavar="N",
            help="Seed of the mission and the navigators; of a log, of the navigators only.",
        ),
    ] = None,
    chart: ChartFileOption = None,
    settings: SetOption = None,
    threads: Annotated[
        int,
        typer.Option(
            min=0, max=256, metavar="N", help="Navigators side by side, 0: all cores. Same results for any."
        ),
    ] = 1,
    figures: FiguresOption = False,
) -> None:
    """Replay a mission through navigators: a table and, with -o, tracks, pictures and a Rerun replay."""
    from uwcoop.evaluation.metrics import summary_text
    from uwcoop.experiment.run import run as replay
    from uwcoop.report.atomic_files import refuse_file
    from uwcoop.report.run_folder import write_run

    names = names_of(navigator) or None
    needs_folder(figures, output, "--figures")
    if output is not None:
        refuse_file(output)
    with progress(f"opening {mission}", len(names) if names else None) as step:
        result = replay(
            mission,
            names,
            seed=seed,
            chart=chart,
            overrides=settings or (),
            clouds=output is not None,
            threads=threads,
            progress=lambda name: step(f"replayed {name}"),
        )
    print_notes(result.log)
    if output is not None:
        files = write_run(result, output, say, figures=figures)
    print_run(result, terminal(err=as_json))
    if output is not None:
        say_written(files, output)
    if as_json:
        typer.echo(summary_text(result.summary))


@app.command()
def study(
    scenario: ScenarioArgument,
    runs: Annotated[
        int, typer.Option(min=1, metavar="N", help="Missions for each variant; run k has seed k.")
    ],
    navigator: NavigatorsOption = None,
    vary: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=V1,V2", help="Values of a scenario key to compare. Repeatable: all combinations."
        ),
    ] = None,
    output: FolderOption = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue the study in DIR: finished missions are skipped.")
    ] = False,
    as_json: JsonOption = False,
    settings: SetOption = None,
    first_seed: Annotated[int, typer.Option(min=0, metavar="N", help="Seed of the first run.")] = 0,
    processes: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="At most so many at a time; else all cores.")
    ] = None,
    figures: FiguresOption = False,
) -> None:
    """Many missions, the same for every navigator and variant: consistency and accuracy over all of them."""
    from uwcoop.evaluation.metrics import summary_text
    from uwcoop.experiment.study import study as compare
    from uwcoop.navigators import not_realisable
    from uwcoop.report.result_tables import study_table
    from uwcoop.report.run_folder import write_study_figures
    from uwcoop.scenario import alternatives

    needs_folder(resume, output, "--resume")
    needs_folder(figures, output, "--figures")
    varied = [alternatives(text) for text in vary or ()]
    with progress(f"flying {scenario}", None) as step:
        result = compare(
            scenario,
            runs,
            names_of(navigator),
            dict(varied),
            out=output,
            resume=resume,
            processes=processes,
            overrides=settings or (),
            first_seed=first_seed,
            keep_errors=figures,
            progress=lambda done, total: step("missions flown", done, total),
        )
    flown = [name for variant in result.summary["variants"] for name in variant["navigators"]]
    table = study_table(
        result.summary,
        settle_s=result.settle_s,
        vehicles=result.vehicles,
        not_realisable=not_realisable(flown),
    )
    terminal(err=as_json).print(table)
    if output is not None:
        files = ["summary.json", "runs.csv", "study.json"]
        if figures:
            files += ["errors.nc"] if result.errors is not None else []
            files += write_study_figures(result, output, say)
        say_written(files, output)
    if as_json:
        typer.echo(summary_text(result.summary))


@app.command()
def budget(
    scenario: ScenarioArgument, navigator: NavigatorsOption = None, settings: SetOption = None
) -> None:
    """What talking costs: fields, bytes, frames, air time, slot and cycle; what other teams and slots would do."""
    from uwcoop.experiment.mission import load_scenario
    from uwcoop.experiment.packet_budget import budget as count
    from uwcoop.report.budget_tables import budget_report

    terminal().print(budget_report(count(load_scenario(scenario, None, settings or ()), names_of(navigator))))


@app.command()
def view(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder that `run -o` or `demo` wrote.")],
    web: Annotated[bool, typer.Option("--web", help="In the browser instead of a window.")] = False,
) -> None:
    """Open a folder's replay in the Rerun viewer, which listens on this machine only."""
    from uwcoop.viewer import view as show

    show(folder, web=web)
