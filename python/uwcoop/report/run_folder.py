"""What a run leaves behind: its folder, each file whole or not at all."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from uwcoop.errors import ChartError, MissingDependencyError, TracksError
from uwcoop.evaluation.metrics import summary_text
from uwcoop.report.atomic_files import atomic_write, refuse_file

if TYPE_CHECKING:
    from uwcoop.charts import Chart
    from uwcoop.experiment.run import RunResult
    from uwcoop.experiment.study import StudyResult

__all__ = [
    "resolved_scenario",
    "write_chart_picture",
    "write_run",
    "write_study_figures",
]

_CHART_DPI = 130


def write_run(
    result: RunResult, folder: Path, note: Callable[[str], None], *, figures: bool = False
) -> list[str]:
    """Write `summary.json`, `scenario.json`, `tracks.nc`, `errors.png`, `map.png` and `replay.rrd`.

    Args:
        result: what was run.
        folder: made if it does not exist; files of an earlier run in it are replaced.
        note: called with one line for each file that could not be made, because an optional dependency is
            missing or because the mission does not hold what it shows.
        figures: also `covariance.png`, `traffic.png`, `setup.png`, `uncertainty.png` and, where they are recorded,
            information gains (`information.png`) and the origin state (`origin.png`); of missions with
            a landmark `trajectories.png`, `velocities.png`, `offsets.png` and `reconstruction.png`.

    Returns:
        Names of the files written.
    """
    refuse_file(folder)
    folder.mkdir(parents=True, exist_ok=True)
    writers: dict[str, Callable[[RunResult, Path], None]] = {
        "summary.json": lambda r, path: _write_json(r.summary, path),
        "scenario.json": lambda r, path: _write_json(resolved_scenario(r), path),
        "tracks.nc": _write_tracks,
        "errors.png": _write_errors,
        "map.png": _write_map,
        "replay.rrd": _write_replay,
    }
    if figures:
        writers |= {
            "covariance.png": _write_covariance,
            "traffic.png": _write_traffic,
            "information.png": _write_information,
            "setup.png": _write_setup,
            "uncertainty.png": _write_uncertainty,
            "origin.png": _write_origin,
        }
        if "role_taken" in result.log.events:
            writers |= {
                "trajectories.png": _write_trajectories,
                "velocities.png": _write_velocities,
                "offsets.png": _write_offsets,
                "reconstruction.png": _write_reconstruction,
            }
    written = []
    for name, write in writers.items():
        try:
            with atomic_write(folder / name) as partial:
                write(result, partial)
        except (MissingDependencyError, TracksError) as reason:
            note(f"{name} is left out: {reason}")
        else:
            written.append(name)
    return written


def resolved_scenario(result: RunResult) -> dict[str, Any]:
    """The mission's scenario with the seed of this run and every option of the navigators that took part.

    `scenario.load` reads it back, so that a result can be had again when defaults have changed.
    """
    from uwcoop.navigators import NAVIGATORS, options_of

    took_part = [str(name) for name in result.tracks["navigator"].values]
    setup = result.log.setup
    options = {
        name: options_of(name, setup).model_dump(exclude_none=True)
        for name in took_part
        if name in NAVIGATORS
    }
    return setup.resolved(result.log.seed, options)


def write_study_figures(result: StudyResult, folder: Path, note: Callable[[str], None]) -> list[str]:
    """Draw the pictures of a study that its data allow: `boxes.png`, `bytes.png`, `errors_over_time.png`,
    `information.png`.

    Args:
        result: of `uwcoop.study`.
        folder: of the study.
        note: called with one line for each picture that is not drawn, and why.

    Returns:
        Names of the files written.
    """
    from uwcoop.figures.study import study_figures

    keys = list(result.summary["variants"][0]["set"])
    drawn = study_figures(
        result.rows, keys, result.errors, title=result.summary["scenario"], settle_s=result.settle_s
    )
    written = []
    try:
        for name, figure in drawn:
            if isinstance(figure, str):
                note(f"{name} is not drawn: {figure}")
                continue
            with atomic_write(folder / name) as partial:
                figure.savefig(partial)
            written.append(name)
    except MissingDependencyError as reason:
        note(f"no picture is drawn: {reason}")
    return written


def write_chart_picture(chart: Chart, path: Path) -> None:
    """Write depths and where terrain helps as a picture; the suffix tells the format.

    Raises:
        MissingDependencyError: without matplotlib.
        ChartError: a suffix that matplotlib does not know.
    """
    from uwcoop.figures.chart import chart_figure

    figure = chart_figure(chart)
    known = figure.canvas.get_supported_filetypes()
    if path.suffix[1:].lower() not in known:
        raise ChartError(f"picture {path} must end in one of .{', .'.join(known)}")
    with atomic_write(path) as partial:
        figure.savefig(partial, dpi=_CHART_DPI)


def _write_json(content: Mapping[str, Any], path: Path) -> None:
    path.write_text(summary_text(content) + "\n", encoding="utf-8")


def _write_tracks(result: RunResult, path: Path) -> None:
    compressed = {
        name: {"zlib": True, "complevel": 4, "shuffle": True}
        for name, values in result.tracks.data_vars.items()
        if values.dtype.kind in "fib"
    }
    result.tracks.to_netcdf(path, engine="h5netcdf", encoding=compressed)


def _write_errors(result: RunResult, path: Path) -> None:
    from uwcoop.figures.errors import errors_figure

    errors_figure(result.tracks, result.packets).savefig(path)


def _write_map(result: RunResult, path: Path) -> None:
    from uwcoop.figures.map import map_figure

    map_figure(result.tracks, result.log.chart).savefig(path)


def _write_covariance(result: RunResult, path: Path) -> None:
    from uwcoop.figures.covariance import covariance_figure

    covariance_figure(result.tracks, result.packets, result.log.chart).savefig(path)


def _write_traffic(result: RunResult, path: Path) -> None:
    from uwcoop.figures.traffic import traffic_figure

    motion = result.log.events.get("motion")
    traffic_figure(result.tracks, result.packets, result.log.chart, motion).savefig(path)


def _write_information(result: RunResult, path: Path) -> None:
    from uwcoop.figures.information import information_figure

    title = f"{result.tracks.attrs['mission']}, seed {result.tracks.attrs['seed']}"
    information_figure(result.tracks, title=title).savefig(path)


def _write_trajectories(result: RunResult, path: Path) -> None:
    from uwcoop.figures.landmark import trajectories_figure

    trajectories_figure(result.log, result.tracks, result.clouds).savefig(path)


def _write_velocities(result: RunResult, path: Path) -> None:
    from uwcoop.figures.landmark import velocities_figure

    velocities_figure(result.log).savefig(path)


def _write_offsets(result: RunResult, path: Path) -> None:
    from uwcoop.figures.landmark_fixes import offsets_figure

    offsets_figure(result.log, result.tracks).savefig(path)


def _write_reconstruction(result: RunResult, path: Path) -> None:
    from uwcoop.experiment.particles_at_fixes import around_fixes
    from uwcoop.figures.landmark_fixes import reconstruction_figure

    count = result.tracks.get("reconstructions")
    counted = (
        [] if count is None else [n for n in count["navigator"].values if (count.sel(navigator=n) > 0).any()]
    )
    if not counted:
        raise TracksError("no navigator reconstructs particles in this mission")
    around = around_fixes(result.log, str(counted[0]))
    reconstruction_figure(result.log, around, str(counted[0])).savefig(path)


def _write_setup(result: RunResult, path: Path) -> None:
    from uwcoop.figures.setup import setup_figure

    setup_figure(result.log, result.tracks).savefig(path)


def _write_uncertainty(result: RunResult, path: Path) -> None:
    from uwcoop.figures.uncertainty import uncertainty_figure

    uncertainty_figure(result.tracks, result.packets).savefig(path)


def _write_origin(result: RunResult, path: Path) -> None:
    from uwcoop.figures.origin import origin_figure

    origin_figure(result.tracks).savefig(path)


def _write_replay(result: RunResult, path: Path) -> None:
    from uwcoop.viewer import write_replay

    write_replay(path, result.tracks, result.packets, result.clouds, result.log.chart, result.log)
