"""What a run leaves behind: its folder, with all files of one run or of another, never of both."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from uwcoop.errors import ChartError, MissingDependencyError, TracksError
from uwcoop.evaluation.metrics import summary_text
from uwcoop.report.atomic_files import atomic_folder, atomic_write
from uwcoop.report.interruption import check

if TYPE_CHECKING:
    from uwcoop.charts import Chart
    from uwcoop.experiment.run import RunResult
    from uwcoop.experiment.study import StudyResult

__all__ = [
    "RUN_FILES",
    "resolved_scenario",
    "write_chart_picture",
    "write_run",
    "write_run_files",
    "write_study_figures",
]

_CHART_DPI = 130


def write_run(
    result: RunResult,
    folder: Path,
    note: Callable[[str], None],
    *,
    figures: bool = False,
    pictures: str = "png",
) -> list[str]:
    """Write `summary.json`, `scenario.json`, `tracks.nc`, `errors.png`, `map.png` and `replay.rrd`.

    Args:
        result: what was run.
        folder: made if it does not exist; all files of an earlier run in it are replaced at once, others stay.
        note: called with one line for each file that could not be made, because an optional dependency is
            missing or because the mission does not hold what it shows.
        figures: also `covariance.png`, `traffic.png`, `setup.png`, `uncertainty.png` and, where they are recorded,
            information gains (`information.png`) and the origin state (`origin.png`); of missions with
            a landmark `trajectories.png`, `velocities.png`, `offsets.png` and `reconstruction.png`.

        pictures: the format of all pictures, one of `PICTURES`, in place of `.png`.

    Returns:
        Names of the files written.

    Raises:
        OSError: the folder cannot be written; it is as it was then.
        ValueError: another format.
    """
    if pictures not in PICTURES:
        raise ValueError(f"format of pictures {pictures!r} must be one of {', '.join(PICTURES)}")
    with atomic_folder(folder, RUN_FILES) as partial:
        return write_run_files(result, partial, note, figures=figures, pictures=pictures)


def write_run_files(
    result: RunResult,
    folder: Path,
    note: Callable[[str], None],
    *,
    figures: bool = False,
    pictures: str = "png",
) -> list[str]:
    """As `write_run`, into a folder that exists and is put in its place by the caller."""
    writers = _writers(figures=figures, exchanges_roles="role_taken" in result.log.events)
    written = []
    for png_name, write in writers.items():
        name = _file_name(png_name, pictures)
        check()
        try:
            write(result, folder / name)
        except (MissingDependencyError, TracksError) as reason:
            (folder / name).unlink(missing_ok=True)
            note(f"{name} is left out: {reason}")
        else:
            written.append(name)
    return written


def resolved_scenario(result: RunResult) -> dict[str, Any]:
    """The mission's scenario with the seed of this run and every option that the navigators that took part read.

    `scenario.load` reads it back, so that a result can be had again when defaults have changed.
    """
    from uwcoop.navigators import is_packaged, options_of, read_options

    took_part = [str(name) for name in result.tracks["navigator"].values]
    setup = result.log.setup
    options = {name: read_options(name, options_of(name, setup)) for name in took_part if is_packaged(name)}
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
        ChartError: a suffix that matplotlib does not know, or that of a GeoTIFF, which a picture is not.
    """
    from uwcoop.figures.chart import chart_figure

    if path.suffix.lower() in (".tif", ".tiff"):
        raise ChartError(f"picture {path} would be a TIFF without positions: -o {path.name} writes a GeoTIFF")

    figure = chart_figure(chart)
    known = [kind for kind in figure.canvas.get_supported_filetypes() if not kind.startswith("tif")]
    if path.suffix[1:].lower() not in known:
        raise ChartError(f"picture {path} must end in one of .{', .'.join(known)}")
    with atomic_write(path) as partial:
        figure.savefig(partial, dpi=_CHART_DPI)


def _write_json(content: Mapping[str, Any], path: Path) -> None:
    path.write_text(summary_text(content) + "\n", encoding="utf-8")


def _write_tracks(result: RunResult, path: Path) -> None:
    from uwcoop.report.cf_tracks import cf_tracks

    tracks = cf_tracks(result.tracks, result.log)
    compressed: dict[str, dict[str, Any]] = {
        str(name): {"zlib": True, "complevel": 4, "shuffle": True}
        for name, values in tracks.variables.items()
        if values.dtype.kind in "fib" and values.ndim
    }
    for name in {"time", "time_utc"} & compressed.keys():  # coordinates have no missing values
        compressed[name]["_FillValue"] = None
    tracks.to_netcdf(path, engine="h5netcdf", encoding=compressed)


def _write_errors(result: RunResult, path: Path) -> None:
    from uwcoop.figures.errors import errors_figure

    errors_figure(result.tracks, result.packets, result.innovations, result.held_out or None).savefig(path)


def _write_map(result: RunResult, path: Path) -> None:
    from uwcoop.figures.map import map_figure

    fixes = result.log.events.get("fix")
    # A stream of fixes is a path of its own; where there is a truth, that shows it.
    shown = fixes if result.log.truth is None or fixes is None or len(fixes["t_ns"]) < 500 else None
    map_figure(result.tracks, result.log.chart, shown).savefig(path)


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


def _write_current(result: RunResult, path: Path) -> None:
    from uwcoop.figures.current import current_figure

    current_figure(result.tracks, result.log.truth).savefig(path)


def _write_origin(result: RunResult, path: Path) -> None:
    from uwcoop.figures.origin import origin_figure

    origin_figure(result.tracks).savefig(path)


def _write_replay(result: RunResult, path: Path) -> None:
    from uwcoop.viewer import write_replay

    write_replay(path, result.tracks, result.packets, result.clouds, result.log.chart, result.log)


def _writers(*, figures: bool, exchanges_roles: bool) -> dict[str, Callable[[RunResult, Path], None]]:
    """What writes each file of a run."""
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
            "current.png": _write_current,
        }
    if figures and exchanges_roles:
        writers |= {
            "trajectories.png": _write_trajectories,
            "velocities.png": _write_velocities,
            "offsets.png": _write_offsets,
            "reconstruction.png": _write_reconstruction,
        }
    return writers


def _file_name(name: str, pictures: str) -> str:
    return f"{name.removesuffix('.png')}.{pictures}" if name.endswith(".png") else name


PICTURES = ("png", "pdf", "svg")
"""Formats that pictures can have."""

RUN_FILES = tuple(
    dict.fromkeys(
        _file_name(name, kind) for kind in PICTURES for name in _writers(figures=True, exchanges_roles=True)
    )
)
"""Every file that `write_run` may write."""
