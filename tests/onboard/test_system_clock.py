"""A node on this machine's clock: slots in time, sensors of a driver, the water in real time."""

from __future__ import annotations

import threading
import time

import uwcoop
from onboard_dive import SECOND_NS, free_ports, scenario
from uwcoop.onboard import VehicleNavigator, event_message
from uwcoop.onboard.channel import Channel
from uwcoop.onboard.messages import encode
from uwcoop.onboard.service import NodeService, ServiceOptions, SystemClock
from uwcoop.onboard.transports import UdpTransport, default_addresses

DURATION_S = 12


class Driver:
    """Position, velocity and depth of a vehicle, once a second, from an address of its own."""

    def __init__(self, vehicle: int, address, to) -> None:
        self.wires = UdpTransport(address, {"node": to})
        self.vehicle, self.said = vehicle, -1

    def speak(self, now_ns: int) -> None:
        second = now_ns // SECOND_NS
        if second <= self.said or now_ns < 0:
            return
        self.said = second
        t_ns = second * SECOND_NS
        fix = {
            "e_m": 10.0 + second,
            "n_m": 200.0 * self.vehicle,
            "cov_ee_m2": 4.0,
            "cov_en_m2": 0.0,
            "cov_nn_m2": 4.0,
        }
        events = [
            uwcoop.Event(t_ns, self.vehicle, "fix", **fix),
            uwcoop.Event(t_ns, self.vehicle, "motion", velocity_e_mps=1.0, velocity_n_mps=0.0),
            uwcoop.Event(t_ns, self.vehicle, "depth", depth_m=3.0, sigma_m=0.1),
        ]
        self.wires.send("node", encode(*map(event_message, events)))


def test_two_nodes_hear_each_other_in_real_time() -> None:
    mission = scenario(f"duration_s={DURATION_S}", "acoustics.loss.probability=0.0", "vehicles.count=2")
    log = uwcoop.simulate(mission)
    base = free_ports(8)
    addresses = default_addresses(log.vehicles, base)
    clock = SystemClock(time.time_ns() + 2 * SECOND_NS)
    options = ServiceOptions(reorder_s=1.0, lead_s=0.4)
    nodes, drivers = [], []
    for k, name in enumerate(log.vehicles):
        driver = ("127.0.0.1", base + 4 + k)
        peers = {other: a for other, a in addresses.items() if other != name} | {"sensors": driver}
        made = VehicleNavigator.from_scenario(mission, name)
        nodes.append(NodeService(made, UdpTransport(addresses[name], peers), clock=clock, options=options))
        drivers.append(Driver(k, driver, addresses[name]))
    lines: list[str] = []
    water = Channel(
        log,
        UdpTransport(addresses["channel"], {name: addresses[name] for name in log.vehicles}),
        lines.append,
    )
    threads = [threading.Thread(target=node.run) for node in nodes]
    threads.append(threading.Thread(target=water.relay, args=(clock.now_ns,)))
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        for driver in drivers:
            driver.speak(clock.now_ns())
        time.sleep(0.02)
    for wires in (
        *(node.transport for node in nodes),
        *(driver.wires for driver in drivers),
        water.transport,
    ):
        wires.close()
    assert lines == []
    launched = sorted(water.water.launched)
    assert len(launched) >= 2, [node.node.counts for node in nodes]
    for k, node in enumerate(nodes):
        counts = node.node.counts
        assert counts["sent"] + counts["silent"] + counts["missed"] == len(node.node.vehicle.slots)
        assert counts["fused"] >= DURATION_S
        assert counts["malformed"] == counts["refused"] == 0
        assert sum(sender == k for _, sender in launched) == counts["sent"]
    assert any(node.node.heard_ns for node in nodes)
