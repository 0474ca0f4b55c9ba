"""NMEA 0183 and PD6 sentences to sensor events: values, norths, clocks, and what is refused."""

from __future__ import annotations

import math
import re
import socket
import time
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from onboard_dive import SECOND_NS, scenario
from uwcoop import Event
from uwcoop.errors import ScenarioError
from uwcoop.frames import LocalFrame, Origin
from uwcoop.onboard import VehicleNavigator
from uwcoop.onboard.lines import UdpLine
from uwcoop.onboard.micromodem import sentence
from uwcoop.onboard.service import NodeService, SystemClock
from uwcoop.onboard.transports import open_transport
from uwcoop.onboard.vehicle import empty_mission

pytest.importorskip("pynmeagps")
pytest.importorskip("pyproj")

from uwcoop.onboard.nmea import NmeaDriver
from uwcoop.onboard.nmea_map import NmeaMap, read_map
from uwcoop.onboard.nmea_sentences import KNOT_MPS, SENTENCES, SentenceError, parse

ORIGIN = Origin(48.117, 11.516)
NOW_NS = 100 * SECOND_NS
EPOCH_NS = 1_700_000_000 * SECOND_NS  # 22:13:20 UTC
GGA = sentence(
    "GPGGA", "221459.50", "4807.038", "N", "01131.000", "E", 4, "08", "1.5", 545.4, "M", 46.9, "M", "", ""
)
EXAMPLES = [
    GGA,
    sentence("GNRMC", "221459.00", "A", "4807.038", "N", "01131.000", "E", "2.0", "090.0", "141123", "", "", "A"),
    sentence("GPVTG", "030.0", "T", "", "M", "4.0", "N", "7.4", "K", "A"),
    sentence("HEHDT", "90.0", "T"),
    sentence("HCHDG", "101.1", "1.0", "W", "7.1", "E"),
    sentence("SDDBT", "7.8", "f", "2.4", "M", "1.3", "F"),
    sentence("SDDPT", "12.4", "0.5"),
    sentence("PNORBT4", 0, 0, "1.234", "23.4", "12.34567", "12.3"),
    sentence("DVPDL", 101234000, 50000, "0.001263", "-0.019663", "-0.745226", "-0.000", "0.001", "-0.005", 100),
    sentence("DVPDX", 101234000, 50000, 0, 0, 0, 0.075, 0.005, -0.005, 97, 1, 0.4, 0.2, 14.1),
    ":TS,26120104170012,35.0,+14.0,  12.3,1500.0,  0",
    ":BS,    -20,  +1500,     +3,A",
    ":BE,   +500,  -1000,     +3,A",
    ":BD,     +12.11,      +4.04,      +0.81,  18.25,  0.20",
]  # fmt: skip


class Script:
    def __init__(self, *lines: str) -> None:
        self.lines = list(lines)

    def write(self, line: str) -> None: ...

    def read(self) -> list[str]:
        lines, self.lines = self.lines, []
        return lines

    def close(self) -> None: ...


def driver(origin: Origin = ORIGIN, *lines: str, **tables) -> NmeaDriver:
    mapping = NmeaMap.model_validate(tables)
    return NmeaDriver(Script(*lines), mapping, 1, origin, lambda: NOW_NS, EPOCH_NS)


def one(line: str, origin: Origin = ORIGIN, **tables):
    (event,) = driver(origin, **tables).events(line)
    assert event.vehicle == 1
    return event


def test_every_kind_of_sentence_is_read() -> None:
    assert {parse(line).sentence for line in EXAMPLES} == set(SENTENCES)


def test_a_position_comes_into_the_local_frame_with_its_dilution_and_its_own_time() -> None:
    event = one(GGA, fix={"sentence": "GGA", "sigma_m": 2.0, "stamp": "utc"})
    assert event.kind == "fix"
    assert event.t_ns == 99_500_000_000  # 22:14:59.5 is 99.5 s after the epoch
    ((east, north),) = LocalFrame(ORIGIN).to_local([48 + 7.038 / 60], [11 + 31 / 60])
    assert (event.fields["e_m"], event.fields["n_m"]) == pytest.approx((east, north), abs=1e-3)
    assert event.fields["cov_nn_m2"] == pytest.approx(9.0)
    arrival = one(GGA, fix={"sentence": "GGA", "sigma_m": 2.0, "latency_s": 0.25})
    assert arrival.t_ns == NOW_NS - SECOND_NS // 4


def test_headings_are_turned_to_the_frames_north() -> None:
    true = one(EXAMPLES[3], heading={"sentence": "HDT", "sigma_deg": 1.0})
    assert true.fields["yaw_rad"] == pytest.approx(0.0, abs=1e-9)
    assert true.fields["sigma_rad"] == pytest.approx(math.radians(1.0))
    # 101.1 deg by the sensor, 1.0 deg of deviation to the west, 7.1 deg of variation to the east: 107.2 deg true.
    for declination in ("sentence", 7.1):
        compass = {"sentence": "HDG", "sigma_deg": 2.0, "declination_deg": declination}
        found = one(EXAMPLES[4], heading=compass)
        assert found.fields["yaw_rad"] == pytest.approx(math.radians(90 - 107.2))
    utm = Origin(48.117, 11.516, "EPSG:32632")  # 2.5 deg east of its central meridian
    grid = one(EXAMPLES[3], utm, heading={"sentence": "HDT", "sigma_deg": 1.0})
    assert LocalFrame(utm).convergence_deg == pytest.approx(1.873, abs=0.01)
    assert grid.fields["yaw_rad"] == pytest.approx(math.radians(LocalFrame(utm).convergence_deg))


@pytest.mark.parametrize(
    ("line", "table", "east", "north"),
    [
        (EXAMPLES[1], {"sentence": "RMC"}, 2.0 * KNOT_MPS, 0.0),
        (EXAMPLES[2], {"sentence": "VTG"}, 2.0 * KNOT_MPS, 4.0 * KNOT_MPS * math.cos(math.radians(30))),
        (EXAMPLES[12], {"sentence": ":BE", "declination_deg": 0.0}, 0.5, -1.0),
        (EXAMPLES[12], {"sentence": ":BE", "declination_deg": 90.0}, -1.0, -0.5),  # its north is true east
        (EXAMPLES[7], {"sentence": "PNORBT4"}, 1.234 * math.sin(0.408407045), 1.234 * math.cos(0.408407045)),
    ],
)  # fmt: skip
def test_velocities_over_ground_become_motion(line, table, east, north) -> None:
    event = one(line, motion=table)
    assert event.kind == "motion"
    assert event.fields["velocity_e_mps"] == pytest.approx(east, abs=1e-9)
    assert event.fields["velocity_n_mps"] == pytest.approx(north, abs=1e-9)


def test_velocities_of_the_body_are_turned_by_mounting_and_heading() -> None:
    # 1.5 m/s forward, 20 mm/s from starboard to port.
    body = {"sentence": ":BS", "sigma_mps": 0.01}
    found = one(EXAMPLES[11], ground_velocity=body).fields
    assert (found["forward_mps"], found["left_mps"], found["sigma_mps"]) == pytest.approx((1.5, 0.02, 0.01))
    # A sensor that looks to starboard: its forward is the vehicle's right.
    turned = one(EXAMPLES[11], ground_velocity={**body, "mounting_deg": 90.0}).fields
    assert (turned["forward_mps"], turned["left_mps"]) == pytest.approx((0.02, -1.5))
    tables = {"heading": {"sentence": "HDT", "sigma_deg": 1.0}, "motion": {"sentence": "DVPDX"}}
    sensors = driver(**tables)
    assert sensors.events(EXAMPLES[9]) == []  # no heading yet: there is no way to turn it
    assert any("no heading" in reason for reason in sensors.counts)
    sensors.events(sentence("HEHDT", "0.0", "T"))
    (event,) = sensors.events(EXAMPLES[9])
    assert event.fields["velocity_n_mps"] == pytest.approx(1.5)
    assert event.fields["velocity_e_mps"] == pytest.approx(0.1)


def test_water_depth_is_the_distance_below_and_the_transducers_own_depth() -> None:
    ship = one(EXAMPLES[5], water_depth={"sentence": "DBT", "sigma_m": 0.1, "transducer": 0.6})
    assert ship.fields["water_depth_m"] == pytest.approx(3.0)
    feet = sentence("SDDBT", "10.0", "f", "", "", "", "")
    assert one(feet, water_depth={"sentence": "DBT", "sigma_m": 0.1, "transducer": 0.0}).fields[
        "water_depth_m"
    ] == pytest.approx(3.048)
    stated = one(EXAMPLES[6], water_depth={"sentence": "DPT", "sigma_m": 0.1, "transducer": "sentence"})
    assert stated.fields["water_depth_m"] == pytest.approx(12.9)
    auv = driver(
        depth={"sentence": ":TS", "sigma_m": 0.1},
        water_depth={"sentence": ":BD", "sigma_m": 0.2, "transducer": "depth"},
    )
    assert auv.events(EXAMPLES[13]) == []
    (depth,) = auv.events(EXAMPLES[10])
    (water,) = auv.events(EXAMPLES[13])
    assert depth.fields["depth_m"] == pytest.approx(12.3)
    assert water.fields["water_depth_m"] == pytest.approx(18.25 + 12.3)


@pytest.mark.parametrize(
    "line",
    [
        "$GPGGA,221459.50,4807.038,N,01131.000,E,4,08,1.5,545.4,M,46.9,M,,",  # no checksum
        GGA[:-2] + "00",
        sentence("GPGGA", "221459", "", "", "", "", 0, "", "", "", "", "", "", "", ""),  # no fix
        sentence("GPRMC", "221459", "V", "", "", "", "", "", "", "141123", "", ""),
        sentence("GPGGA", "221459", "9907.038", "N", "01131.000", "E", 4, "08", "1.5", 1, "M", 1, "M", "", ""),
        sentence("HEHDT", "", "T"),
        sentence("HEHDT", "nan", "T"),
        sentence("HCHDG", "101.1", "1.0", "X", "7.1", "E"),
        sentence("DVPDL", 101234000, 50000, 0, 0, 0, 0.075, 0.005, 0, 0),  # confidence 0
        sentence("DVPDL", 101234000, 0, 0, 0, 0, 0.075, 0.005, 0, 100),
        ":BS, -32768, -32768, -32768,V",
        ":BS, -32768, -32768, -32768,A",
        ":BS,    -20,  +1500,     +3",
        ":BD,     +12.11,      +4.04,      +0.81,   0.00,  0.20",
        "", "$", "$*00", "$GPGGA*", ":", ":BS", "é" * 50,
    ],
)  # fmt: skip
def test_what_is_damaged_or_measures_nothing_is_refused(line) -> None:
    try:
        assert parse(line) is None
        assert line in {":", "$*00"}
    except SentenceError:
        pass


TABLES = {
    "fix": {"sentence": "GGA", "sigma_m": 2.0},
    "heading": {"sentence": "HDG", "sigma_deg": 2.0, "declination_deg": 3.0},
    "motion": {"sentence": "VTG"},
    "ground_velocity": {"sentence": ":BS", "sigma_mps": 0.01},
    "depth": {"sentence": ":TS", "sigma_m": 0.1},
    "water_depth": {"sentence": "DPT", "sigma_m": 0.1, "transducer": 0.5},
}
DRIVER = driver(**TABLES)


@settings(max_examples=300, deadline=None)
@given(st.sampled_from([line for line in EXAMPLES if line[0] == "$"]), st.data())
def test_a_changed_character_gives_no_event(line, data) -> None:
    star = line.index("*")
    at = data.draw(st.integers(1, star - 1))
    new = data.draw(st.characters(min_codepoint=32, max_codepoint=126).filter(lambda c: c != line[at]))
    assert DRIVER.events(line[:at] + new + line[at + 1 :]) == []


@settings(max_examples=400, deadline=None)
@given(
    st.one_of(
        st.text(max_size=120),
        st.lists(
            st.one_of(st.text(max_size=8), st.floats().map(str), st.integers().map(str)), min_size=1, max_size=16
        )
        .flatmap(lambda f: st.sampled_from(["GPGGA", "GPRMC", "GPVTG", "HEHDT", "HCHDG", "SDDBT", "SDDPT", "DVPDX"]).map(
            lambda name: sentence(name, *f)
        )),
        st.lists(st.text(alphabet="+-0123456789. AVx", max_size=9), max_size=7).map(lambda f: ":BS," + ",".join(f)),
    )
)  # fmt: skip
@example(sentence("GPGGA", "1e999", "1e999", "N", "1e999", "E", "1e999"))
@example(sentence("SDDPT", "1e308", "1e308"))
def test_nothing_that_comes_on_a_line_is_an_exception(line) -> None:
    for event in DRIVER.events(line):
        assert all(math.isfinite(value) for value in event.fields.values())


def test_a_mapping_says_what_it_lacks(tmp_path) -> None:
    path = tmp_path / "map.toml"
    for text, complaint in (
        ("", "no table"),
        ("[heading]\nsentence = 'HDG'\nsigma_deg = 2.0", "declination_deg"),
        ("[heading]\nsentence = 'HDT'\nsigma_deg = 2.0\ndeclination_deg = 3.0", "declination_deg"),
        ("[heading]\nsentence = 'HDT'\nsigma_deg = -2.0", "sigma_deg is -2: must be above 0"),
        ("[motion]\nsentence = ':BE'", "declination_deg"),
        ("[motion]\nsentence = ':BS'", "heading is missing"),
        ("[motion]\nsentence = 'VTG'\nmounting_deg = 3.0", "mounting_deg"),
        ("[ground_velocity]\nsentence = ':BS'", "sigma_mps is missing"),
        ("[ground_velocity]\nsentence = 'VTG'\nsigma_mps = 0.1", "must be of"),
        ("[water_depth]\nsentence = 'DBT'\nsigma_m = 0.1\ntransducer = 'sentence'", "states no offset"),
        ("[sonar]\n", "sonar"),
        ("fix = [", "no TOML"),
    ):
        path.write_text(text)
        with pytest.raises(ScenarioError, match=complaint):
            read_map(path)
    with pytest.raises(ScenarioError, match="cannot be read"):
        read_map(tmp_path / "none.toml")
    with pytest.raises(ScenarioError, match="no latitude"):
        driver(Origin(), fix={"sentence": "GGA", "sigma_m": 2.0})


def test_the_mapping_of_the_page_is_one(tmp_path) -> None:
    page = (Path(__file__).parents[2] / "docs" / "howto" / "vehicle.md").read_text()
    (text,) = re.findall(r"```toml\n(\[fix\].*?)```", page, re.DOTALL)
    (tmp_path / "nmea.toml").write_text(text)
    assert list(read_map(tmp_path / "nmea.toml").kinds()) == [
        "heading",
        "depth",
        "fix",
        "motion",
        "water_depth",
    ]


def test_a_node_hears_sensors_over_udp() -> None:
    """Sentences on loopback become the node's events, fused in order of time."""
    clock = SystemClock(time.time_ns() - 5 * SECOND_NS)
    made = VehicleNavigator(replace(empty_mission(scenario()), origin=ORIGIN), "V1")
    line = UdpLine("127.0.0.1", 0)
    mapping = NmeaMap.model_validate({k: TABLES[k] for k in ("fix", "motion", "water_depth", "depth")})
    sensors = NmeaDriver(line, mapping, made.index, made.mission.origin, clock.now_ns, clock.epoch_ns)
    wires = open_transport("udp", "V1", ("127.0.0.1", 0), {"watch": ("127.0.0.1", 9)})
    service = NodeService(made, wires, clock=clock, drivers=(sensors,))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        for text in (GGA, *EXAMPLES):
            out.sendto(text.encode() + b"\r\n", line._socket.getsockname())
    until_s = time.monotonic() + 5
    while sensors.counts["used"] < 5 and time.monotonic() < until_s:
        for event in sensors():
            assert service.node.take(event)
    service.node.advance(clock.now_ns())
    assert service.node.counts["fused"] >= 4
    assert made.estimate(clock.now_ns()).status != "not started"
    line.close()
    wires.close()


def test_a_line_that_is_noise_is_counted_in_bounded_memory() -> None:
    made = driver(heading={"sentence": "HDT", "sigma_deg": 1.0})
    for k in range(5000):
        assert made.events(f"$HEHDT,{k}.0,T*00" if k % 256 else f"$GPGGA,{k},{k:x}") == []
    assert len(made.counts) < 100
    assert sum(made.counts.values()) == 5000 - made.counts["used"]
    assert made.counts["other"] == 0


def test_a_sentence_that_is_refused_is_not_counted_as_one_of_no_use() -> None:
    made = driver(heading={"sentence": "HDG", "sigma_deg": 1.0, "declination_deg": "sentence"})
    assert made.events(sentence("HCHDG", "101.1", "", "", "", "")) == []
    assert dict(made.counts) == {"refused: heading: variation is missing": 1}


def test_a_driver_whose_stamps_are_far_ahead_does_not_fill_the_queue() -> None:
    """A receiver with another day's time: its events would wait for hours and shut out the others."""
    clock = SystemClock(time.time_ns() - 5 * SECOND_NS)
    made = VehicleNavigator(replace(empty_mission(scenario("duration_s=7200")), origin=ORIGIN), "V1")
    given = [
        Event(clock.now_ns() + ahead_s * SECOND_NS, 0, "depth", depth_m=2.0, sigma_m=0.1)
        for ahead_s in (3600, 1)
    ]
    wires = open_transport("udp", "V1", ("127.0.0.1", 0), {"watch": ("127.0.0.1", 9)})
    service = NodeService(made, wires, clock=clock, drivers=(lambda: given,))
    for event in service.drivers[0]():
        service._take_of_driver(event)
    assert service.node.counts["malformed"] == 1
    assert len(service.node._queue) == 1
    wires.close()
