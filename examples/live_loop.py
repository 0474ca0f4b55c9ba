"""Two navigators fed event by event, as the computers of two vehicles would feed them, without a mission log.

A program on a vehicle makes each event when its sensor or modem delivers, asks for a packet at its slot, and saves a
snapshot from time to time. Here one program plays both vehicles, their sensors and the water between them.
"""

import numpy as np
from numpy.typing import NDArray

import uwcoop
from uwcoop.charts.native import native_chart
from uwcoop.navigators import Context, Navigator, build, options_of

Floats = NDArray[np.float64]
SOUND_SPEED_MPS = 1500.0
SECOND_NS = 10**9
AIR_TIME_NS = 2 * SECOND_NS  # from the start of a signal to the end of decoding
SLOT_S, CAPACITY_BYTES = 5, 32
COMMAND_MPS = np.array([[1.2, 0.0], [1.0, 0.4]])  # one row for each vehicle
START_M = np.array([[100.0, 150.0], [120.0, 400.0]])
CURRENT_MPS = np.array([-0.1, 0.15])  # no vehicle measures it


def seabed() -> uwcoop.Chart:
    north, east = np.mgrid[0:600:4.0, 0:800:4.0]
    return uwcoop.Chart(20 + 3 * np.sin(east / 31 + north / 80) + 2 * np.cos(north / 23), 0.0, 0.0, 4.0)


def true_position_m(vehicle: int, t_s: float) -> Floats:
    position: Floats = START_M[vehicle] + (COMMAND_MPS[vehicle] + CURRENT_MPS) * t_s
    return position


def sensor_events(
    vehicle: int, second: int, chart: uwcoop.Chart, noise: np.random.Generator
) -> list[uwcoop.Event]:
    """What one vehicle senses in this second: commanded velocity and water depth; a fix before it dives."""
    t_ns, (e_mps, n_mps) = second * SECOND_NS, COMMAND_MPS[vehicle]
    depth_m = chart.depth_at(true_position_m(vehicle, second)[None])[0] + 0.1 * noise.standard_normal()
    events = [
        uwcoop.Event(t_ns, vehicle, "motion", velocity_e_mps=e_mps, velocity_n_mps=n_mps),
        uwcoop.Event(t_ns, vehicle, "water_depth", water_depth_m=depth_m, sigma_m=0.1),
    ]
    if second == 0:
        e_m, n_m = START_M[vehicle] + 3 * noise.standard_normal(2)
        variances = {"cov_ee_m2": 9.0, "cov_en_m2": 0.0, "cov_nn_m2": 9.0}
        events.insert(0, uwcoop.Event(t_ns, vehicle, "fix", e_m=e_m, n_m=n_m, **variances))
    return events


def reception(packet: bytes, sender: int, tol_ns: int) -> uwcoop.Event:
    """The packet at the other vehicle: stamped when decoding ends, with the times of launch and arrival."""
    receiver = 1 - sender
    apart_m = true_position_m(sender, tol_ns * 1e-9) - true_position_m(receiver, tol_ns * 1e-9)
    toa_ns = tol_ns + round(float(np.hypot(*apart_m)) / SOUND_SPEED_MPS * 1e9)
    fields = {"sender": sender, "tol_ns": tol_ns, "toa_ns": toa_ns, "bytes": packet}
    return uwcoop.Event(toa_ns + AIR_TIME_NS, receiver, "reception", **fields)


def make(vehicle: int, chart: uwcoop.Chart) -> Navigator:
    context = Context(vehicle=vehicle, vehicles=2, sound_speed_mps=SOUND_SPEED_MPS, seed=1, chart=chart)
    return build("team", context, options_of("team"), native_chart(chart))


def show(second: int, navigators: list[Navigator]) -> None:
    for vehicle, navigator in enumerate(navigators):
        belief = navigator.estimate(second * SECOND_NS)
        off_m = np.hypot(*(belief.mean_m - true_position_m(vehicle, second)))
        sigma_m = np.sqrt(np.trace(belief.covariance_m2))
        print(f"{second:4} s  vehicle {vehicle}: {off_m:5.2f} m off, sigma {sigma_m:5.2f} m, {belief.status}")


def main() -> None:
    chart, noise = seabed(), np.random.default_rng(1)
    navigators = [make(vehicle, chart) for vehicle in (0, 1)]
    arriving: list[uwcoop.Event] = []
    used = 0
    for second in range(301):
        events = [event for vehicle in (0, 1) for event in sensor_events(vehicle, second, chart, noise)]
        due = [event for event in arriving if event.t_ns <= second * SECOND_NS]
        arriving = [event for event in arriving if event not in due]
        for event in sorted(
            [*due, *events], key=lambda event: event.t_ns
        ):  # each navigator's events in order of time
            outcome = navigators[event.vehicle].handle(event)
            used += event.kind == "reception" and outcome == "fused"
        if second % SLOT_S == 0:  # the vehicles take turns
            sender = second // SLOT_S % 2
            packet = navigators[sender].transmit(second * SECOND_NS, CAPACITY_BYTES)
            if packet is not None:
                arriving.append(reception(packet, sender, second * SECOND_NS))
        if second % 60 == 0:
            show(second, navigators)
        if second == 150:  # vehicle 0's computer restarts: a new navigator takes the state of the old one
            saved = navigators[0].snapshot()
            navigators[0] = make(0, chart)
            navigators[0].restore(saved)
            print(f"{second:4} s  vehicle 0 restarted from a snapshot of {len(saved)} bytes")
    print(f"{used} packets used")


if __name__ == "__main__":
    main()
