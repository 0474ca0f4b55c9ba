"""Truth that a log does not hold, from a file beside it or from another topic of the log: `uwcoop run --truth`.

A table has a time, and latitude and longitude, or east and north in the log's own frame; `vehicle` names whose row it is,
`depth` (positive down) may be there. Columns are found by their names. Times since 1970 need a log that knows its epoch;
others are seconds since the mission's zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.errors import LogError, ScenarioError, TableError
from uwcoop.scenario.base import nearest

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from uwcoop.missionlog import MissionLog

    Floats = NDArray[np.float64]

__all__ = ["LONGEST_GAP_S", "with_truth"]

_TYPES = {
    "nav_msgs/msg/Odometry": lambda m: m.pose.pose.position,
    "geometry_msgs/msg/PoseStamped": lambda m: m.pose.position,
    "geometry_msgs/msg/PoseWithCovarianceStamped": lambda m: m.pose.pose.position,
    "geometry_msgs/msg/PointStamped": lambda m: m.point,
}
_NAV_SAT_FIX = "sensor_msgs/msg/NavSatFix"
_NO_POSITION = ("depth", "water_depth")
"""Topics of uwcoop's logs whose poses hold a depth alone."""
LONGEST_GAP_S = 30.0
"""Within a longer gap of its source the truth is unknown; shorter ones are straight lines."""


@dataclass(frozen=True)
class _Path:
    """What is known of one vehicle: times since the mission's zero, (N,) ascending, position (N, 2), depth (N,)."""

    t_ns: NDArray[np.int64]
    position_m: Floats
    depth_m: Floats


def with_truth(log: MissionLog, sources: Sequence[str], log_file: str | Path | None = None) -> MissionLog:
    """The log with the truth of these sources in place of its own, and a note of what was read.

    Args:
        log: any.
        sources: `FILE` or `VEHICLE=FILE` (a table), `/TOPIC` or `VEHICLE=/TOPIC` (of `log_file`).
        log_file: the MCAP file that topics are read from.

    Raises:
        LogError: a source that cannot be read, names no vehicle of the log, or has no instant within the mission.
    """
    paths: dict[str, _Path] = {}
    notes = []
    for source in sources:
        name, place = _split(source, log)
        if place.startswith("/") and not Path(place).exists():
            if log_file is None:
                raise LogError(f"truth {place}: topics are read from a log file (.mcap), not from a scenario")
            found = {_only(name, log, place): _of_topic(log, Path(log_file), place)}
        else:
            found = _of_table(log, place, name)
        for vehicle, path in found.items():
            inside = (path.t_ns >= 0) & (path.t_ns <= log.duration_ns)
            if not inside.any():
                raise LogError(
                    f"truth {place}: vehicle {vehicle} has positions from {path.t_ns[0] / 1e9:g} to "
                    f"{path.t_ns[-1] / 1e9:g} s, the mission lasts from 0 to {log.duration_ns / 1e9:g} s"
                )
            paths[vehicle] = _Path(path.t_ns[inside], path.position_m[inside], path.depth_m[inside])
            notes.append(f"truth of {vehicle}: {inside.sum():,} positions of {place}")
    return replace(log, truth=_dataset(log, paths), notes=(*log.notes, *notes))


def _split(source: str, log: MissionLog) -> tuple[str | None, str]:
    name, equals, place = source.partition("=")
    if not equals or Path(source).exists():
        return None, source
    if name not in log.vehicles:
        raise LogError(f"truth of {name!r}: {nearest(name, list(log.vehicles))}")
    return name, place


def _only(name: str | None, log: MissionLog, place: str) -> str:
    if name is not None:
        return name
    inside = [vehicle for vehicle in log.vehicles if vehicle in place.split("/")]
    if len(inside) == 1:
        return inside[0]
    if len(log.vehicles) == 1:
        return log.vehicles[0]
    raise LogError(f"truth {place}: say whose it is: VEHICLE={place}")


def _of_table(log: MissionLog, place: str, name: str | None) -> dict[str, _Path]:
    from uwcoop.importers.column_roles import split_label
    from uwcoop.importers.text_table import open_table

    try:
        table = open_table(place)
        labels = {split_label(label)[0]: label for label in table.labels}
    except (OSError, TableError) as error:
        raise LogError(f"truth {place}: {error}") from error
    whose = next(
        (labels[known] for known in ("vehicle", "vehicle name", "name", "robot") if known in labels), None
    )
    if name is not None or whose is None:
        return {_only(name, log, place): _rows(log, place, {} if whose is None else {whose: str(name)})}
    names = {str(cell) for cell in table.read({}, {"vehicle": table.place(whose)}).texts["vehicle"]}
    unknown = sorted(names - set(log.vehicles))
    if not names & set(log.vehicles):
        raise LogError(
            f"truth {place}: its vehicles {', '.join(unknown) or '(none)'} are none of {', '.join(log.vehicles)}"
        )
    return {v: _rows(log, place, {whose: v}) for v in log.vehicles if v in names}


def _rows(log: MissionLog, place: str, where: dict[str, str]) -> _Path:
    from uwcoop.scenario.vehicle import Track
    from uwcoop.world.track_file import read_rows

    try:
        rows = read_rows(Track(file=str(Path(place).resolve()), where=where), f"truth {place}")
    except (ScenarioError, ValueError) as error:
        raise LogError(str(error)) from error
    if rows.clock == "own":
        t_ns = rows.t_ns
    elif rows.clock == "absolute" and log.epoch_ns is not None:
        t_ns = rows.t_ns - log.epoch_ns
    else:
        raise LogError(
            f"truth {place}: its times are {'since 1970' if rows.clock == 'absolute' else 'times of day'}, mission "
            f"{log.name!r} {'has no epoch' if log.epoch_ns is None else 'counts from its epoch'}: "
            "give seconds since its start"
        )
    cells = rows.cells
    if "latitude" in cells:
        position = _local(log, cells["latitude"], cells["longitude"], place)
    else:
        position = np.column_stack([cells["east"], cells["north"]])
    return _Path(t_ns, position, cells.get("depth", np.full(len(t_ns), np.nan)))


def _local(log: MissionLog, latitude_deg: Floats, longitude_deg: Floats, place: str) -> Floats:
    from uwcoop.frames import LocalFrame

    if log.origin.latitude_deg is None:
        raise LogError(f"truth {place}: it is in degrees, mission {log.name!r} has no latitude and longitude")
    return LocalFrame(log.origin).to_local(latitude_deg, longitude_deg)


def _of_topic(log: MissionLog, file: Path, topic: str) -> _Path:
    from uwcoop.importers.bounded import refuse_irregular, refused
    from uwcoop.missionlog import container
    from uwcoop.missionlog.messages import typestore

    with refused(LogError, f"log {file}"):
        refuse_irregular(file)
        contents = container.parse(file.read_bytes())
    kind = contents.types.get(topic)
    if kind is None:
        can = sorted(
            topic
            for topic, k in contents.types.items()
            if (k in _TYPES or k == _NAV_SAT_FIX) and topic.rsplit("/", 1)[-1] not in _NO_POSITION
        )
        raise LogError(
            f"log {file} has no topic {topic}: positions are in {', '.join(can) or 'none of its topics'}"
        )
    if kind not in _TYPES and kind != _NAV_SAT_FIX:
        raise LogError(f"truth {topic} carries {kind}: must be one of {', '.join((*_TYPES, _NAV_SAT_FIX))}")
    store = typestore()
    messages: list[Any] = [store.deserialize_cdr(content, kind) for content in contents.messages[topic]]
    if not messages:
        raise LogError(f"truth {topic}: it has no messages")
    t_ns = np.array([m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in messages], dtype=np.int64)
    if log.epoch_ns is not None and t_ns[0] > log.epoch_ns // 2:
        t_ns = t_ns - log.epoch_ns
    if kind == _NAV_SAT_FIX:
        degrees = np.array([[m.latitude, m.longitude] for m in messages])
        position, depth = _local(log, degrees[:, 0], degrees[:, 1], topic), np.full(len(messages), np.nan)
    else:
        points = [_TYPES[kind](m) for m in messages]
        position = np.array([[p.x, p.y] for p in points])
        depth = np.array([-p.z for p in points])
    known = np.isfinite(position).all(axis=1)
    if not known.any() or topic.rsplit("/", 1)[-1] in _NO_POSITION:
        raise LogError(f"truth {topic}: it holds no horizontal position")
    t_ns, position, depth = t_ns[known], position[known], depth[known]
    order = np.argsort(t_ns, kind="stable")
    fresh = np.concatenate([[True], np.diff(t_ns[order]) > 0])
    return _Path(t_ns[order][fresh], position[order][fresh], depth[order][fresh])


def _dataset(log: MissionLog, paths: dict[str, _Path]) -> Any:
    """All paths on the instants of all of them, linear in between.

    NaN outside, in long gaps and for the other vehicles.
    """
    import xarray as xr

    gaps = {vehicle: _gaps(path.t_ns) for vehicle, path in paths.items()}
    middles = [gap.sum(axis=1) // 2 for gap in gaps.values()]
    t_ns = np.unique(np.concatenate([*(path.t_ns for path in paths.values()), *middles]))
    position = np.full((len(log.vehicles), len(t_ns), 2), np.nan)
    depth = np.full((len(log.vehicles), len(t_ns)), np.nan)
    for vehicle, path in paths.items():
        at = log.vehicles.index(vehicle)
        for axis in range(2):
            position[at, :, axis] = np.interp(
                t_ns, path.t_ns, path.position_m[:, axis], left=np.nan, right=np.nan
            )
        depth[at] = np.interp(t_ns, path.t_ns, path.depth_m, left=np.nan, right=np.nan)
        for begins, ends in gaps[vehicle]:
            inside = (t_ns > begins) & (t_ns < ends)
            position[at, inside] = depth[at, inside] = np.nan
    return xr.Dataset(
        {
            "position_m": (("vehicle", "time", "axis"), position, {"units": "m"}),
            "depth_m": (("vehicle", "time"), depth, {"units": "m"}),
        },
        coords={
            "vehicle": list(log.vehicles),
            "time": ("time", t_ns / 1e9, {"units": "s"}),
            "axis": ["east", "north"],
        },
    )


def _gaps(t_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """(G, 2) begin and end of each long gap."""
    at = np.flatnonzero(np.diff(t_ns) > LONGEST_GAP_S * 1e9)
    return np.stack([t_ns[at], t_ns[at + 1]], axis=1)
