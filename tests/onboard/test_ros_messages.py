"""Translation between ROS 2 messages and a node's, on rosbags' types; the bridge on stand-ins for rclpy's."""

from __future__ import annotations

import ast
import math
from pathlib import Path

import numpy as np
import pytest

import uwcoop
from onboard_dive import SECOND_NS, scenario
from uwcoop.missionlog.messages import typestore
from uwcoop.missionlog.topics import EVENT_TOPICS, encode, namespaces
from uwcoop.onboard import MessageError, event_of
from uwcoop.onboard.channel import sensor_messages
from uwcoop.onboard.ros_messages import event_message_of, fill_diagnostic, fill_estimate, stamp_ns

EPOCH_NS = 1_764_547_200 * SECOND_NS
BRIDGE = Path(__file__).parents[2] / "integrations" / "ros2" / "uwcoop_bridge.py"


def blank(msgtype: str):
    """A message with zeros, as rclpy's constructors give it."""
    store = typestore()
    fields = {}
    for name, (form, about) in store.get_msgdef(msgtype).fields:
        if int(form) == 2:
            fields[name] = blank(about)
        elif int(form) == 1:
            fields[name] = "" if about[0] == "string" else False if about[0] == "bool" else 0
        else:
            fields[name] = np.zeros(about[1]) if int(form) == 3 else []
    return store.types[msgtype](**fields)


@pytest.mark.parametrize("name", ["flat-bay", "seafloor-survey"])
def test_every_sensor_message_of_a_log_becomes_the_event_that_it_was(name) -> None:
    """The log's own CDR bytes, read as rosbags' classes, give the events to the last bit."""
    log = uwcoop.simulate(scenario() if name == "flat-bay" else name)
    names = namespaces(log.vehicles)
    kinds = {f"{topic.suffix}": kind for kind, topic in EVENT_TOPICS.items()}
    found: dict[int, list] = {k: [] for k in range(len(names))}
    for stream in encode(log):
        _, namespace, suffix = stream.topic.split("/")
        vehicle = names.index(namespace)
        for data in stream.messages:
            message = typestore().deserialize_cdr(data, stream.msgtype)
            found[vehicle].append(event_message_of(kinds[suffix], namespace, message, vehicle, 0))
    compared = 0
    for vehicle, messages in found.items():
        expected = [m for m in sensor_messages(log, vehicle) if m["kind"] in EVENT_TOPICS]
        assert sorted(messages, key=_order) == sorted(expected, key=_order)
        for message in messages:
            event_of(message)
        compared += len(messages)
    assert compared > 100


def _order(message) -> tuple[int, str]:
    return message["t_ns"], message["kind"]


def test_another_frame_and_values_that_are_none_are_refused() -> None:
    fix = blank("geometry_msgs/msg/PoseWithCovarianceStamped")
    fix.header.frame_id = "odom"
    with pytest.raises(MessageError, match="frame_id is 'odom': must be 'map'"):
        event_message_of("fix", "V1", fix, 0, EPOCH_NS)
    fix.header.frame_id = "map"
    fix.header.stamp.sec = EPOCH_NS // SECOND_NS + 7
    fix.pose.covariance[[0, 7]] = 4.0
    assert event_message_of("fix", "V1", fix, 0, EPOCH_NS)["t_ns"] == 7 * SECOND_NS
    fix.pose.covariance[1] = 1.0
    with pytest.raises(MessageError, match="cov_en_m2 is"):
        event_message_of("fix", "V1", fix, 0, EPOCH_NS)
    fix.pose.pose.position.x = math.nan
    with pytest.raises(MessageError, match="e_m is nan: must be finite"):
        event_message_of("fix", "V1", fix, 0, EPOCH_NS)
    depth = blank("geometry_msgs/msg/PoseWithCovarianceStamped")
    depth.header.frame_id = "map"
    depth.pose.covariance[14] = -1.0
    with pytest.raises(MessageError, match="sigma_m"):
        event_message_of("depth", "V1", depth, 0, EPOCH_NS)


@pytest.mark.parametrize(
    ("kind", "name"),
    [("usbl", "measured_ns"), ("beacon_range", "measured_ns"), ("acoustic_fix", "transmit_ns")],
)
def test_times_within_a_message_are_unix_time_too(kind, name) -> None:
    message = blank(EVENT_TOPICS[kind].msgtype)
    message.header.frame_id = "map" if EVENT_TOPICS[kind].frame == "map" else "V1/base_link"
    message.header.stamp.sec = EPOCH_NS // SECOND_NS + 7
    setattr(message, name, EPOCH_NS + 5 * SECOND_NS)
    event = event_message_of(kind, "V1", message, 0, EPOCH_NS)
    assert (event["t_ns"], event[name]) == (7 * SECOND_NS, 5 * SECOND_NS)


def test_estimates_and_alarms_become_messages_that_can_be_sent() -> None:
    estimate = {
        "type": "estimate", "vehicle": 0, "t_ns": 61 * SECOND_NS + 5, "mean_m": [120.0, -5.0],
        "covariance_m2": [9.0, 1.0, 1.0, 16.0], "yaw_rad": 1.0,
    }  # fmt: skip
    pose = blank("geometry_msgs/msg/PoseWithCovarianceStamped")
    assert fill_estimate(pose, estimate, EPOCH_NS)
    back = typestore().deserialize_cdr(
        typestore().serialize_cdr(pose, "geometry_msgs/msg/PoseWithCovarianceStamped"),
        "geometry_msgs/msg/PoseWithCovarianceStamped",
    )
    assert stamp_ns(back.header.stamp) == EPOCH_NS + 61 * SECOND_NS + 5
    assert (back.pose.pose.position.x, back.pose.pose.position.y) == (120.0, -5.0)
    assert back.pose.covariance[[0, 1, 6, 7, 14]].tolist() == [9.0, 1.0, 1.0, 16.0, 1e12]
    assert 2 * math.atan2(back.pose.pose.orientation.z, back.pose.pose.orientation.w) == pytest.approx(1.0)
    assert not fill_estimate(pose, {**estimate, "mean_m": [None, None]}, EPOCH_NS)
    array, status = (
        blank("diagnostic_msgs/msg/DiagnosticArray"),
        blank("diagnostic_msgs/msg/DiagnosticStatus"),
    )
    alarm = {"t_ns": SECOND_NS, "alarm": "depth silent", "raised": True, "text": "no depth since 0.5 s"}
    fill_diagnostic(array, status, alarm, "V1", EPOCH_NS)
    sent = typestore().serialize_cdr(array, "diagnostic_msgs/msg/DiagnosticArray")
    (said,) = typestore().deserialize_cdr(sent, "diagnostic_msgs/msg/DiagnosticArray").status
    assert (said.level, said.name, said.message) == (1, "V1: depth silent", "no depth since 0.5 s")
    fill_diagnostic(array, status, {**alarm, "raised": False}, "V1", EPOCH_NS)
    assert status.level == 0


def test_the_bridge_is_short_and_rclpy_is_imported_there_alone() -> None:
    source = BRIDGE.read_text()
    assert len(source.splitlines()) < 300
    imported = {
        name.split(".")[0]
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Import | ast.ImportFrom)
        for name in (
            [node.module or ""] if isinstance(node, ast.ImportFrom) else [a.name for a in node.names]
        )
    }
    assert "rclpy" in imported
    package = Path(uwcoop.__file__).parent
    files = list(package.rglob("*.py"))
    assert len(files) > 50
    assert not [
        path for path in files if "import rclpy" in path.read_text() or "from rclpy" in path.read_text()
    ]
