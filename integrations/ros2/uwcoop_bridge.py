"""A ROS 2 node beside `uwcoop node`: sensor topics in, estimate and alarms out.

    uwcoop node --vehicle V1 --scenario team.toml --epoch 1764547200 --peer ros=127.0.0.1:7450
    python3 uwcoop_bridge.py --vehicle V1 --scenario team.toml --epoch 1764547200

Topics, types and frames are those of a mission's log (`uwcoop.missionlog.topics.EVENT_TOPICS`). Out go
`/{namespace}/estimate` (`geometry_msgs/PoseWithCovarianceStamped`, frame `map`) and `/diagnostics`.
The bridge takes the place of `uwcoop watch`, whose port it listens to.
"""

from __future__ import annotations

import argparse
import sys
from functools import partial
from importlib import import_module
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data

from uwcoop import scenario as scenarios
from uwcoop.errors import UwcoopError
from uwcoop.missionlog.topics import EVENT_TOPICS, namespaces
from uwcoop.onboard.messages import MessageError, decode, encode, event_of
from uwcoop.onboard.ros_messages import event_message_of, fill_diagnostic, fill_estimate
from uwcoop.onboard.transports import BASE_PORT, UdpTransport, default_addresses

POLL_S = 0.05


class Bridge(Node):  # type: ignore[misc]
    """One vehicle's sensors and estimate."""

    def __init__(self, options: argparse.Namespace) -> None:
        team = tuple(vehicle.name for vehicle in scenarios.load(options.scenario).team)
        if options.vehicle not in team:
            raise UwcoopError(f"vehicle {options.vehicle!r} is not in the team: {', '.join(team)}")
        self.name, self.index = options.vehicle, team.index(options.vehicle)
        self.namespace = namespaces(team)[self.index]
        self.epoch_ns = round(options.epoch * 1e9)
        super().__init__(f"uwcoop_bridge_{self.namespace}")
        addresses = default_addresses(team, options.base_port)
        to_node = {self.name: addresses[self.name]}
        self.heard = UdpTransport(addresses["watch"], to_node)
        self.told = UdpTransport(("127.0.0.1", options.port), to_node)
        self.refused = 0
        self.estimates = self.create_publisher(PoseWithCovarianceStamped, f"/{self.namespace}/estimate", 10)
        self.alarms = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        for kind, topic in EVENT_TOPICS.items():
            if (message_type := _type_of(topic.msgtype)) is None:
                self.get_logger().warning(f"{kind}: type {topic.msgtype} is not built here: not bridged")
                continue
            name = f"/{self.namespace}/{topic.suffix}"
            self.create_subscription(message_type, name, partial(self.sensor, kind), qos_profile_sensor_data)
        self.create_timer(POLL_S, self.poll)

    def sensor(self, kind: str, message: Any) -> None:
        """One message of a sensor to the node."""
        try:
            event = event_message_of(kind, self.namespace, message, self.index, self.epoch_ns)
            event_of(event)
        except MessageError as error:
            self.refused += 1
            self.get_logger().warning(f"refused: {error}", throttle_duration_sec=10.0)
            return
        self.told.send(self.name, encode(event))

    def poll(self) -> None:
        """What the node has said since the last time."""
        for _, datagram in self.heard.receive(0.0):
            try:
                for said in decode(datagram):
                    self.publish(said)
            except (MessageError, KeyError, TypeError, ValueError) as error:
                self.get_logger().warning(f"malformed: {error}", throttle_duration_sec=10.0)

    def publish(self, said: dict[str, Any]) -> None:
        """One message of the node to its topic."""
        if said["type"] == "estimate":
            pose = PoseWithCovarianceStamped()
            if fill_estimate(pose, said, self.epoch_ns):
                self.estimates.publish(pose)
        elif said["type"] == "diagnostic":
            alarm = DiagnosticArray()
            fill_diagnostic(alarm, DiagnosticStatus(), said, self.name, self.epoch_ns)
            self.alarms.publish(alarm)


def _type_of(msgtype: str) -> Any:
    package, _, name = msgtype.split("/")
    try:
        return getattr(import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError):
        return None


def main() -> int:
    """Run until the node is shut down."""
    parser = argparse.ArgumentParser(description="bridge between ROS 2 and `uwcoop node`")
    parser.add_argument("--vehicle", required=True)
    parser.add_argument("--scenario", required=True, help="a packaged name, or a TOML file")
    parser.add_argument(
        "--epoch", type=float, required=True, help="UNIX time of mission time 0, s; as the node's"
    )
    parser.add_argument("--base-port", type=int, default=BASE_PORT)
    parser.add_argument(
        "--port", type=int, default=BASE_PORT + 50, help="of this bridge; the node's --peer ros="
    )
    options = parser.parse_args(rclpy.utilities.remove_ros_args(sys.argv)[1:])
    rclpy.init(args=sys.argv)
    try:
        rclpy.spin(Bridge(options))
    except UwcoopError as error:
        sys.stderr.write(f"error: {error}\n")
        return 2
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
