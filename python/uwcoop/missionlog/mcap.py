"""A mission log on disk: one MCAP file that ROS 2 tools play, Rerun opens, and uwcoop reads back bit for bit.

The profile is `ros2`: CDR messages, each type's full definition embedded (`ros2msg`), the log's times from 0
as header stamp, and as log time from its epoch on (from 0 where that is not known). World frame `map`: local ENU
metres, z up (REP 103, REP 105); body frame `{vehicle}/base_link`: x forward, y left. `{V}` is a vehicle's name made a
valid ROS namespace.

| topic | type | what it carries |
|---|---|---|
| `/{V}/commanded_velocity` | geometry_msgs/TwistStamped | motion: linear.x east, linear.y north |
| `/{V}/water_depth` | geometry_msgs/PoseWithCovarianceStamped | position.z = −depth, covariance[14] = σ² |
| `/{V}/depth` | geometry_msgs/PoseWithCovarianceStamped | the same, of the vehicle itself |
| `/{V}/ground_velocity` | geometry_msgs/TwistWithCovarianceStamped | linear.x, .y; covariance[0] = [7] = σ² |
| `/{V}/turn_rate` | sensor_msgs/Imu | angular_velocity.z, angular_velocity_covariance[8] = σ² |
| `/{V}/heading` | uwcoop_msgs/Heading | yaw and σ |
| `/{V}/odometry_increment` | uwcoop_msgs/OdometryIncrement | displacement, yaw change, 3 × 3 covariance |
| `/{V}/fix` | geometry_msgs/PoseWithCovarianceStamped | position.x, .y, covariance[0], [1] = [6], [7] |
| `/{V}/acoustic_fix` | uwcoop_msgs/AcousticFix | peer, launch, slant range, both bearings, depth of the peer |
| `/{V}/water_velocity` | geometry_msgs/TwistWithCovarianceStamped | as ground_velocity, through the water |
| `/{V}/beacon_range` | uwcoop_msgs/BeaconRange | when measured, the beacon's place and depth, slant range and σ |
| `/{V}/usbl` | uwcoop_msgs/UsblPosition | when measured, position and covariance |
| `/{V}/landed`, `/{V}/lifted_off` | std_msgs/Header | the stamp |
| `/{V}/role_taken` | uwcoop_msgs/RoleTaken | landmark or not |
| `/acoustics/slot` | uwcoop_msgs/AcousticSlot | sender, capacity; stamped TOL |
| `/acoustics/opportunity` | uwcoop_msgs/AcousticOpportunity | who, TOA, survival, draws; stamped TOL |
| `/acoustics/poll` | uwcoop_msgs/AcousticPoll | poller and sender, bytes, air time, whether heard; stamped launch |
| `/acoustics/reception` | uwcoop_msgs/AcousticReception | who, TOL, TOA, payload; stamped decode end |
| `/truth/{V}/odometry` | nav_msgs/Odometry | true position, z = −depth |
| `/truth/{V}/yaw` | uwcoop_msgs/Heading | true yaw, to the last bit |
| `/truth/{V}/current` | geometry_msgs/TwistStamped | true current: linear.x east, linear.y north |
| `/mission` | uwcoop_msgs/Mission | copy: the team, because messages name a peer by its index |
| `/{V}/orientation` | sensor_msgs/Imu | copy of heading as quaternion |
| `/{V}/odometry` | nav_msgs/Odometry | copy: increments summed up |
| `/{V}/navsat` | sensor_msgs/NavSatFix | copy of fix, where the origin is known and pyproj installed |

Why these: every value that is read back lies in a float64 field as it is, negated, or (σ) squared, all of
which give their bits back. sensor_msgs/Range was not taken for depths: it is float32, and its wire layout
changed between ROS 2 releases; the standard types above have one layout in all. A quaternion does not return
the yaw it was made of, hence Heading and OdometryIncrement; their standard twins are copies that reading
ignores. Truth goes into `log.truth` and nowhere else. A `ros2 bag play` without an installed uwcoop_msgs
package skips that package's topics with a warning.

The MCAP metadata record `uwcoop` holds name, seed, duration, vehicles, link, origin, resolved scenario, notes,
epoch (where it is known) and the number of rows of every table (JSON); the attachment `chart` holds the chart, with
its SHA-256 in the metadata.

Importers of other logs (a dive computer's CSV, a foreign bag) do not belong here: they build a `MissionLog`
with `model.event_columns` and `model.columns`, check it with `validate`, and may write it with `write_log`.
"""

from __future__ import annotations

import json
import os
from dataclasses import asdict
from heapq import merge
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from uwcoop.acoustics.link import Link
from uwcoop.errors import ChartError, LogError, ScenarioError
from uwcoop.frames import Origin
from uwcoop.importers.bounded import refuse_irregular, refused
from uwcoop.missionlog import acoustic_topics, container, copies, topics, truth
from uwcoop.missionlog.messages import definition, typestore
from uwcoop.missionlog.model import MissionLog
from uwcoop.missionlog.validate import validate
from uwcoop.report.atomic_files import atomic_write
from uwcoop.scenario.setup import MissionSetup

if TYPE_CHECKING:
    from uwcoop.charts import Chart

_FORMAT = "1"
_KINDS = {
    "name": str, "seed": int, "duration_ns": int, "vehicles": list, "namespaces": list, "link": dict,
    "origin": dict, "scenario": dict, "rows": dict, "draws": int,
}  # fmt: skip
_METADATA = "uwcoop"
_ATTACHMENT = "chart"
_MEDIA_TYPE = "application/x-uwcoop-chart"


def write_log(log: MissionLog, path: str | os.PathLike[str]) -> None:
    """Write a log as MCAP, whole or not at all; the same log gives the same bytes.

    Raises:
        LogError: the log does not pass `validate`, holds a value that a file would change, or the file cannot
            be written. Nothing is left behind then.
    """
    target = Path(path)
    validate(log)
    streams = [*topics.encode(log), *acoustic_topics.encode_acoustics(log)]
    streams += [*copies.encode_copies(log), *truth.encode_truth(log)]
    metadata = _metadata(log)
    try:
        with atomic_write(target) as partial, partial.open("xb") as file:
            _write(file, streams, metadata, log.chart, log.epoch_ns or 0)
    except OSError as error:
        raise LogError(f"log {target} cannot be written: {error.strerror or error}") from error


def load_log(path: str | os.PathLike[str], chart: Chart | None = None) -> MissionLog:
    """Read a log that `write_log` wrote, equal to it bit for bit.

    Args:
        chart: the chart that the caller means to use; it must be the one of the mission.

    Raises:
        LogError: the file is missing, cut off, changed, out of order, not ours, does not pass `validate`, or
            belongs to another chart. One line that names the file.
    """
    source = Path(path)
    with refused(LogError, f"log {source}"):
        refuse_irregular(source)
        # As long as it is: what a log holds in memory is bounded by what it is on disk (`container`).
        content = source.read_bytes()
        try:
            log = _assemble(container.parse(content), chart)
            validate(log)
        except LogError as error:
            raise LogError(f"log {source}: {error}") from error
    return log


def _write(
    file: IO[bytes],
    streams: list[topics.Stream],
    metadata: dict[str, str],
    chart: Chart | None,
    epoch_ns: int,
) -> None:
    from mcap.writer import CompressionType, Writer

    compression = CompressionType.ZSTD if container.zstd_available() else CompressionType.NONE
    writer = Writer(file, compression=compression, enable_data_crcs=True)
    writer.start(profile="ros2", library=_library())
    writer.add_metadata(_METADATA, metadata)
    if chart is not None:
        writer.add_attachment(0, 0, _ATTACHMENT, _MEDIA_TYPE, chart.to_bytes())
    schemas: dict[str, tuple[int, dict[str, str]]] = {}
    queues = []
    for stream in streams:
        if not len(stream.messages):
            continue
        if stream.msgtype not in schemas:
            text = definition(stream.msgtype).encode()
            # Keys that rosbag2 writes: the quality of service (none is asked for) and the type's hash.
            about = {
                "offered_qos_profiles": "",
                "topic_type_hash": typestore().hash_rihs01(stream.msgtype),
            }
            schemas[stream.msgtype] = writer.register_schema(stream.msgtype, "ros2msg", text), about
        schema, about = schemas[stream.msgtype]
        channel = writer.register_channel(stream.topic, "cdr", schema, about)
        count = len(stream.messages)
        queues.append(
            zip(stream.t_ns.tolist(), [channel] * count, range(count), stream.messages, strict=True)
        )
    for t_ns, channel, row, message in merge(*queues):
        writer.add_message(channel, epoch_ns + t_ns, message, epoch_ns + t_ns, row)
    writer.finish()  # type: ignore[no-untyped-call]


def _library() -> str:
    try:
        return f"uwcoop {version('uwcoop')}"
    except PackageNotFoundError:
        return "uwcoop"


def _metadata(log: MissionLog) -> dict[str, str]:
    """The log without its tables, as MCAP metadata: JSON in every value."""
    rows = {name: len(next(iter(table.values()))) for name, table in log.tables()}
    draws = log.opportunities["draws"].shape[1] if log.opportunities else 0
    values: dict[str, Any] = {
        "format": _FORMAT,
        "name": log.name,
        "seed": log.seed,
        "duration_ns": log.duration_ns,
        "vehicles": log.vehicles,
        "namespaces": topics.namespaces(log.vehicles),
        "link": asdict(log.link),
        "origin": asdict(log.origin),
        "scenario": log.setup.tables(),
        "rows": rows,
        "draws": draws,
        "truth": truth.describe(log),
        "chart": None if log.chart is None else {"name": log.chart.name, "sha256": log.chart.sha256},
    }
    for name in ("notes", "epoch_ns", "counterfactual"):
        if (value := getattr(log, name)) or value == 0:
            values[name] = value
    try:
        return {key: json.dumps(value) for key, value in values.items()}
    except (TypeError, ValueError) as error:
        raise LogError(f"attributes cannot be written as JSON: {error}") from error


def _assemble(file: container.Contents, chart: Chart | None) -> MissionLog:
    about = _about(file)
    try:
        names, rows = about["namespaces"], dict(about["rows"])
        log = MissionLog(
            name=about["name"],
            seed=about["seed"],
            vehicles=tuple(about["vehicles"]),
            duration_ns=about["duration_ns"],
            link=Link(**about["link"]),
            origin=Origin(**about["origin"]),
            setup=MissionSetup.parse(about["scenario"]),
            notes=_texts(about, "notes"),
            epoch_ns=_epoch(about.get("epoch_ns")),
            counterfactual=_texts(about, "counterfactual"),
        )
        _check_types(file, names)
        if "slots" in rows:
            log.slots = acoustic_topics.decode_slots(file.messages, rows.pop("slots"))
        if "opportunities" in rows:
            count, frames = rows.pop("opportunities"), about["draws"]
            log.opportunities = acoustic_topics.decode_opportunities(file.messages, count, frames)
        if "receptions" in rows:
            count = rows.pop("receptions")
            log.receptions, log.payloads = acoustic_topics.decode_receptions(file.messages, count)
        if "polls" in rows:
            log.polls = acoustic_topics.decode_polls(file.messages, rows.pop("polls"))
        log.events = topics.decode(file.messages, names, rows)
        if about["truth"] is not None:
            log.truth = truth.decode_truth(file.messages, names, about["truth"])
        log.chart = _chart(file, about["chart"], chart)
    except LogError:
        raise
    except ScenarioError as error:
        raise LogError(str(error)) from error
    except Exception as error:  # values of other kinds than ours, deep inside
        raise LogError(f"metadata is not what this version writes: {_what(error)}") from error
    return log


def _about(file: container.Contents) -> dict[str, Any]:
    """The metadata record's values."""
    record = file.metadata.get(_METADATA)
    if record is None:
        raise LogError(
            f"an MCAP file without uwcoop's metadata (library {file.library!r}): it is no mission log; "
            "`uwcoop import` makes one of it"
        )
    try:
        about = {key: json.loads(value) for key, value in record.items()}
    except (ValueError, RecursionError) as error:
        raise LogError(f"metadata is not JSON: {error}") from error
    if about.get("format") != _FORMAT:
        raise LogError(f"format {about.get('format')!r} is unknown: this version reads {_FORMAT!r}")
    for key, kind in _KINDS.items():
        if not isinstance(about.get(key), kind):
            raise LogError(f"metadata {key} is {about.get(key)!r:.60}, it must be {kind.__name__}")
    return about


def _texts(about: dict[str, Any], name: str) -> tuple[str, ...]:
    value = about.get(name, [])
    if not isinstance(value, list) or not all(isinstance(text, str) for text in value):
        raise LogError(f"metadata {name} is {value!r:.60}, it must be a list of texts")
    return tuple(value)


def _epoch(value: Any) -> int | None:
    if value is not None and (isinstance(value, bool) or not isinstance(value, int)):
        raise LogError(f"metadata epoch_ns is {value!r:.60}, it must be a whole number of nanoseconds")
    return value


def _check_types(file: container.Contents, names: list[str]) -> None:
    """The topics that are read carry the types that are read."""
    for topic, msgtype in {**topics.types(names), **acoustic_topics.TYPES, **truth.types(names)}.items():
        if (found := file.types.get(topic, msgtype)) != msgtype:
            raise LogError(f"{topic} carries {found}, it must be {msgtype}")


def _chart(file: container.Contents, about: dict[str, str] | None, chart: Chart | None) -> Chart | None:
    """The attached chart, checked against its digest; the given one if it is the same or there is none."""
    if about is None:
        return chart
    digest = about["sha256"]
    if chart is not None:
        if chart.sha256 != digest:
            raise LogError(
                f"belongs to chart {about['name']!r} with SHA-256 {digest}, "
                f"not to {chart.name!r} with SHA-256 {chart.sha256}"
            )
        return chart
    from uwcoop.charts import Chart

    attached = file.attachments.get(_ATTACHMENT)
    if attached is None:
        raise LogError(f"its chart {about['name']!r} with SHA-256 {digest} is not attached")
    try:
        found = Chart.from_bytes(attached)
    except ChartError as error:
        raise LogError(f"attached chart: {error}") from error
    if found.sha256 != digest:
        raise LogError(f"attached chart has SHA-256 {found.sha256}, the mission's is {digest}")
    return found


def _what(error: Exception) -> str:
    return f"no {error.args[0]!r}" if isinstance(error, KeyError) and error.args else str(error)
