"""What a run leaves behind: its folder, each file whole or not at all."""

from __future__ import annotations

import errno
import json
import secrets
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from uwcoop.errors import ChartError, MissingDependencyError, TracksError

if TYPE_CHECKING:
    from uwcoop.charts import Chart
    from uwcoop.run import RunResult
    from uwcoop.study import StudyResult

__all__ = [
    "refuse_file",
    "resolved_scenario",
    "summary_text",
    "whole",
    "write_chart_picture",
    "write_run",
    "write_study_figures",
]

_CHART_DPI = 130


@contextmanager
def whole(target: Path) -> Iterator[Path]:
    """A temporary path beside `target`, renamed to it when the block ends well and removed otherwise.

    The temporary name keeps the suffix, because writers tell the format by it.
    """
    partial = target.with_name(f".{target.stem}.{secrets.token_hex(4)}.part{target.suffix}")
    try:
        yield partial
        partial.replace(target)
    finally:
        partial.unlink(missing_ok=True)


def refuse_file(folder: Path) -> None:
    """Raise `NotADirectoryError` if something that is not a folder has this name; makes nothing."""
    if folder.exists() and not folder.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, "is a file, the output must be a folder", str(folder))


def summary_text(summary: Mapping[str, Any]) -> str:
    """A summary as the JSON that is written and printed."""
    return json.dumps(summary, indent=2, allow_nan=False, ensure_ascii=False)


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
            information gains (`information.png`) and the origin state (`origin.png`).

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
    written = []
    for name, write in writers.items():
        try:
            with whole(folder / name) as partial:
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
    options = {
        name: options_of(name, result.log.scenario).model_dump(exclude_none=True)
        for name in took_part
        if name in NAVIGATORS
    }
    scenario = result.log.scenario
    return {**scenario, "seed": result.log.seed, "navigator": {**scenario.get("navigator", {}), **options}}


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
            with whole(folder / name) as partial:
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
    with whole(path) as partial:
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
