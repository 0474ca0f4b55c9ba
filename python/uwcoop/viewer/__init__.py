"""The replay: a mission as a Rerun recording, and how to open it. Only this package imports rerun."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from uwcoop.errors import LogError, MissingDependencyError, UwcoopError
from uwcoop.report.atomic_files import atomic_write, finish_swap
from uwcoop.report.interruption import forget
from uwcoop.viewer import current, earth, landmark, plots, posegraph, scene, traffic
from uwcoop.viewer.layout import blueprint
from uwcoop.viewer.stage import Stage

if TYPE_CHECKING:
    from collections.abc import Mapping

    import xarray as xr
    from numpy.typing import NDArray

    from uwcoop.charts import Chart
    from uwcoop.missionlog import MissionLog

__all__ = ["REPLAY_NAME", "view", "write_replay"]

REPLAY_NAME = "replay.rrd"


def write_replay(
    path: str | os.PathLike[str],
    tracks: xr.Dataset,
    packets: Mapping[str, NDArray[Any]],
    clouds: xr.Dataset | None,
    chart: Chart | None,
    log: MissionLog,
) -> None:
    """Write the mission as a Rerun recording with a layout; the file appears whole or not at all.

    Entities (lengths in metres, z up; under `scene_depth_xK` heights are drawn K times, the data are not
    changed): `chart`, `surface`, `truth/VEHICLE/{course,trail,body}`,
    `NAVIGATOR/VEHICLE/{trail,body/{position,cloud,ellipse_95}}`, `NAVIGATOR/packets/SENDER_to_RECEIVER`
    from launch until decoding ends, and for navigators with a pose graph
    `NAVIGATOR/graph/SENDER_at_RECEIVER/{nodes,edges,ranges,lost}` and `NAVIGATOR/graph/SENDER_origin`; beside
    the scene `error_m/VEHICLE/NAVIGATOR`, `nees/VEHICLE/NAVIGATOR` and the text log `acoustics/NAVIGATOR`; where they
    are estimated `current_mps/VEHICLE/{east,north}/{true,NAVIGATOR/{above,below}}` (twice its sigma above and below) and,
    where a health monitor alarmed, `alarms/VEHICLE/NAVIGATOR`.
    Where the mission's origin is known, `earth/truth/VEHICLE` and `earth/NAVIGATOR/VEHICLE/{path,now}` are on a map.
    Missions with a landmark also have the rays `fixes/VEHICLE/{landmark_sees,mover_sees}`, rings
    `truth/VEHICLE/landmark` and the text log `events`.
    Timeline `mission_time`: seconds since the mission's epoch. A cloud is logged where `clouds` has one and is
    carried along with the estimate until the next.

    Raises:
        MissingDependencyError: without rerun.
    """
    rr = _rerun()
    strict = rr.strict_mode()
    rr.set_strict_mode(True)  # otherwise a wrong column is a warning and a hole in the replay
    try:
        stage = Stage.of(tracks, chart, log)
        recording = rr.RecordingStream("uwcoop")
        with atomic_write(Path(path)) as partial:
            recording.save(
                partial,
                default_blueprint=blueprint(
                    stage,
                    tracks,
                    packets,
                    clouds,
                    posegraph.kept(stage, tracks, packets),
                    events="role_taken" in log.events,
                    on_earth=earth.known(log),
                ),
            )
            recording.send_recording_name(f"{tracks.attrs['mission']}, seed {tracks.attrs['seed']}")
            scene.send(recording, stage, tracks, chart, clouds)
            traffic.send(recording, stage, packets, log)
            landmark.send(recording, stage, log)
            posegraph.send(recording, stage, tracks, packets)
            plots.send(recording, stage, tracks)
            current.send(recording, stage, tracks, log)
            earth.send(recording, stage, tracks, log)
            recording.flush()
            recording.disconnect()
    finally:
        rr.set_strict_mode(strict)


def view(folder: str | os.PathLike[str], *, web: bool = False) -> None:
    """Open a folder's replay in the Rerun viewer (in the browser if `web`) and wait until it is closed.

    The viewer's servers listen on this machine only (127.0.0.1); Rerun's own default is every address.

    Raises:
        LogError: no replay in the folder.
        MissingDependencyError: without rerun.
        UwcoopError: the viewer cannot start, for instance for want of a display.
    """
    replay = Path(folder)
    if replay.suffix != ".rrd":
        if replay.is_dir():
            finish_swap(replay)
        replay /= REPLAY_NAME
    if not replay.is_file():
        raise LogError(f"no replay {replay}: `uwcoop run MISSION -o {folder}` writes one")
    _rerun()
    try:
        code = subprocess.run(viewer_command(replay, web=web), check=False).returncode
    except KeyboardInterrupt:  # the viewer got it too: this is how one closes the browser form
        forget()
        return
    if code:
        raise UwcoopError(
            f"the Rerun viewer ended with code {code}; without a display, use its browser form (web)"
        )


def viewer_command(replay: Path, *, web: bool) -> list[str]:
    """Command line of the viewer, bound to this machine only."""
    options = ["--bind", "127.0.0.1", "--port", "auto", *(["--web-viewer"] if web else [])]
    return [sys.executable, "-m", "rerun", *options, str(replay)]


def _rerun() -> Any:
    try:
        import rerun
    except ImportError as missing:
        raise MissingDependencyError("rerun-sdk", "viz") from missing
    return rerun
