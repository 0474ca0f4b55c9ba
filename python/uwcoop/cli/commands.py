"""The commands of `uwcoop`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from uwcoop.cli.chart_command import chart as chart_command
from uwcoop.cli.export_command import export as export_command
from uwcoop.cli.import_command import import_ as import_command
from uwcoop.cli.onboard_commands import black_box, channel, node, watch
from uwcoop.cli.options import (
    ChartFileOption,
    FiguresOption,
    FolderOption,
    HoldOutOption,
    JsonOption,
    NavigatorsOption,
    PicturesOption,
    ScenarioArgument,
    SeedOption,
    SetOption,
    TruthOption,
    WithoutOption,
)
from uwcoop.cli.reproduce_command import reproduce
from uwcoop.cli.scenario_commands import budget, keys, scenarios
from uwcoop.cli.terminal import (
    OneLineErrors,
    names_of,
    needs_folder,
    print_notes,
    print_run,
    progress,
    say,
    say_written,
    show,
    terminal,
)

if TYPE_CHECKING:
    from rich.console import Group

    from uwcoop.experiment.named_worlds import World
    from uwcoop.experiment.study import StudyResult

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


EXAMPLES = {
    "demo": "uwcoop demo -o uwcoop-demo",
    "scenarios": "uwcoop scenarios flat-bay > bay.toml",
    "keys": "uwcoop keys acoustics.modem",
    "budget": "uwcoop budget flat-bay --navigator team,mpf",
    "chart": "uwcoop chart soundings.csv --columns lon,lat,depth --picture chart.png",
    "simulate": "uwcoop simulate poor-bay --seed 3 -o mission.mcap",
    "run": "uwcoop run flat-bay --navigator mpf,team -o out",
    "study": "uwcoop study flat-bay --runs 50 --navigator mpf,team --vary acoustics.loss.probability=0.0,0.4 -o loss",
    "reproduce": "uwcoop reproduce walls2012 --quick -o walls2012",
    "view": "uwcoop view out",
    "import": "uwcoop import dive.mcap --inspect > import.toml",
    "export": "uwcoop export out --to geojson --navigator team",
    "node": "uwcoop node --vehicle V1 --scenario flat-bay --state v1",
    "channel": "uwcoop channel --play mission.mcap --speed 20",
    "watch": "uwcoop watch --scenario flat-bay",
    "black-box": "uwcoop black-box --vehicle V1 --scenario flat-bay --state v1 -o dive.mcap",
}
"""One for each command, at the end of its help."""


def _example(name: str) -> str:
    return f"Example: [bold]{EXAMPLES[name]}[/bold]"


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


@app.command(epilog=_example("demo"))
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


for _command in (scenarios, keys, budget, chart_command, node, channel, watch, black_box):
    _name = _command.__name__.replace("_", "-")
    app.command(_name, epilog=_example(_name))(_command)


@app.command(epilog=_example("simulate"))
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
    from uwcoop.report.atomic_files import check_file
    from uwcoop.world.simulate import simulate as fly

    if output.suffix != LOG_SUFFIX:
        raise typer.BadParameter(f"{output} must end in {LOG_SUFFIX}", param_hint="-o")
    check_file(output)
    log = fly(load_scenario(scenario, chart, settings or ()), seed)
    write_log(log, output)
    print_notes(log)
    say(
        f"wrote {output}: {len(log.vehicles)} vehicles, {log.duration_ns / 1e9:g} s, seed {log.seed}, "
        f"{output.stat().st_size / 1e6:.1f} MB"
    )


@app.command(epilog=_example("run"))
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
    without: WithoutOption = None,
    hold_out: HoldOutOption = None,
    truth: TruthOption = None,
    figures: FiguresOption = False,
    pictures: PicturesOption = "png",
) -> None:
    """Replay a mission through navigators: a table and, with -o, tracks, pictures and a Rerun replay."""
    from uwcoop.evaluation.metrics import summary_text
    from uwcoop.experiment.run import run as replay
    from uwcoop.report.atomic_files import check_folder
    from uwcoop.report.run_folder import RUN_FILES, write_run

    names = names_of(navigator) or None
    needs_folder(figures, output, "--figures")
    needs_folder(pictures != "png", output, "--pictures")
    if output is not None:
        check_folder(output, RUN_FILES)
    with progress(f"opening {mission}", len(names) if names else None) as step:
        result = replay(
            mission,
            names,
            seed=seed,
            chart=chart,
            overrides=settings or (),
            without=without or (),
            hold_out=hold_out,
            truth=truth or (),
            clouds=output is not None,
            threads=threads,
            progress=lambda name: step(f"replayed {name}"),
        )
    print_notes(result.log)
    if output is not None:
        files = write_run(result, output, say, figures=figures, pictures=pictures)
    print_run(result, terminal(err=as_json))
    if output is not None:
        say_written(files, output)
    if as_json:
        typer.echo(summary_text(result.summary))


@app.command(epilog=_example("study"))
def study(
    scenario: ScenarioArgument,
    runs: Annotated[
        int, typer.Option(min=1, metavar="N", help="Missions for each variant; run k has seed k.")
    ],
    navigator: NavigatorsOption = None,
    vary: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=V1,V2",
            help="Values of a scenario key to compare; linspace(a,b,n); or n drawn values, uniform(a,b)|lhs(n) (also "
            "loguniform, integers), of all such keys together. Repeatable: all combinations.",
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
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Fly on the workers of a Dask scheduler, e.g. tcp://127.0.0.1:8786, or the file that it wrote.",
        ),
    ] = None,
    worlds: Annotated[
        str | None,
        typer.Option(
            metavar="faults|FILE",
            help="Fly each variant in every world of a list: the packaged faults (clocks, sound speed, multipath, "
            "losses, wrong beliefs), or a TOML file of your own.",
        ),
    ] = None,
    figures: FiguresOption = False,
) -> None:
    """Run many missions, the same for every navigator and variant: accuracy and consistency over all of them."""
    from contextlib import suppress

    from uwcoop.errors import ScenarioError
    from uwcoop.evaluation.metrics import summary_text
    from uwcoop.experiment.mission import load_scenario
    from uwcoop.experiment.named_worlds import worlds_of
    from uwcoop.experiment.study import study as compare
    from uwcoop.experiment.sweeps import sweep_of
    from uwcoop.report.run_folder import write_study_figures
    from uwcoop.world.simulate import setup_notes

    needs_folder(resume, output, "--resume")
    needs_folder(figures, output, "--figures")
    sweep = sweep_of(vary or ())
    listed = worlds_of(worlds) if worlds is not None else []
    with suppress(ScenarioError):  # a variant may mend it; what is wrong in all of them the study says
        for note in setup_notes(load_scenario(scenario, None, settings or ())):
            say(f"note: {note}")
    with progress(f"flying {scenario}", None) as step:
        result = compare(
            scenario,
            runs,
            names_of(navigator),
            sweep.grid,
            out=output,
            resume=resume,
            processes=processes,
            scheduler=scheduler,
            overrides=settings or (),
            first_seed=first_seed,
            keep_errors=figures,
            worlds=listed,
            samples=sweep.samples,
            progress=lambda done, total: step("missions flown", done, total),
        )
    show(_study_tables(result, listed), terminal(err=as_json))
    if output is not None:
        for note in result.notes:
            say(f"note: {note}")
        files = list(result.files)
        if figures:
            files += ["errors.nc"] if result.errors is not None else []
            files += write_study_figures(result, output, say)
        say_written(files, output)
    if as_json:
        typer.echo(summary_text(result.summary))


def _study_tables(result: StudyResult, worlds: Sequence[World]) -> Group:
    """A study's tables: one for each variant, or one over all worlds."""
    from uwcoop.navigators import not_realisable
    from uwcoop.report.result_tables import study_table
    from uwcoop.report.sensitivity_table import MOST_TABLES, sensitivity_table
    from uwcoop.report.world_table import world_tables

    if len(result.summary["variants"]) > MOST_TABLES and "sensitivity" in result.summary:
        return sensitivity_table(result.summary)
    if worlds:
        return world_tables(result.summary, worlds, settle_s=result.settle_s)
    flown = [name for variant in result.summary["variants"] for name in variant["navigators"]]
    return study_table(
        result.summary,
        settle_s=result.settle_s,
        vehicles=result.vehicles,
        not_realisable=not_realisable(flown),
    )


app.command(epilog=_example("reproduce"))(reproduce)


app.command("import", epilog=_example("import"))(import_command)


app.command("export", epilog=_example("export"))(export_command)


@app.command(epilog=_example("view"))
def view(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder that `run -o` or `demo` wrote.")],
    web: Annotated[bool, typer.Option("--web", help="In the browser instead of a window.")] = False,
) -> None:
    """Open a folder's replay in the Rerun viewer, which listens on this machine only."""
    from uwcoop.viewer import view as open_viewer

    open_viewer(folder, web=web)
