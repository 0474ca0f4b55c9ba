"""Whole missions: the log as agreed, the same bits for the same seed, dead reckoning as Table 1 makes it."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uwcoop import scenario
from uwcoop.charts import Chart
from uwcoop.errors import ChartError, ScenarioError, ScheduleError
from uwcoop.missionlog.model import EVENT_COLUMNS, OPPORTUNITY_COLUMNS, SLOT_COLUMNS, MissionLog
from uwcoop.world.random_streams import Purpose, stream
from uwcoop.world.simulate import open_chart, simulate

PACKAGED = ["flat-bay", "poor-bay", "st-john", "st-john-drift"]
"""Missions of three on random paths over 900 s; the others have tests of their own."""
EAST, NORTH = np.meshgrid(np.arange(1001.0), np.arange(1001.0))
CHART = Chart((15 + 5 * np.sin(EAST / 60) * np.cos(NORTH / 45)).astype(np.float32), 0.0, 0.0, 1.0)


def columns_of(log: MissionLog) -> dict[str, Any]:
    tables = {**log.events, "slots": log.slots, "opportunities": log.opportunities}
    flat = {f"{kind}.{name}": column for kind, table in tables.items() for name, column in table.items()}
    assert log.truth is not None
    return flat | {f"truth.{name}": log.truth[name].values for name in log.truth}


def final_dead_reckoning_errors(log: MissionLog) -> list[float]:
    """Distance from the truth at the end, by the fix and the commands alone, for each vehicle."""
    assert log.truth is not None
    errors = []
    for v in range(len(log.vehicles)):
        motion, fix = log.events["motion"], log.events["fix"]
        mine = motion["vehicle"] == v
        moved = [motion[name][mine][:-1].sum() for name in ("velocity_e_mps", "velocity_n_mps")]
        start = [fix[name][fix["vehicle"] == v][0] for name in ("e_m", "n_m")]
        errors.append(float(np.hypot(*(np.add(start, moved) - log.truth["position_m"].values[v, -1]))))
    return errors


@pytest.mark.parametrize("name", PACKAGED)
def test_packaged_scenarios_give_the_log_that_was_agreed(name: str) -> None:
    log = simulate(name, seed=1, chart=CHART)
    assert (log.name, log.seed, log.vehicles, log.duration_ns) == (name, 1, ("V1", "V2", "V3"), 900 * 10**9)
    assert (log.chart, log.origin) == (CHART, CHART.origin)
    assert set(log.events) == {"motion", "fix", "depth", "water_depth"}
    for table, expected in [
        *((log.events[kind], {"t_ns": "i8", "vehicle": "i8", **EVENT_COLUMNS[kind]}) for kind in log.events),
        (log.slots, SLOT_COLUMNS),
        (log.opportunities, {**OPPORTUNITY_COLUMNS, "draws": "f8"}),
    ]:
        assert {key: column.dtype for key, column in table.items()} == {
            k: np.dtype(v) for k, v in expected.items()
        }
        assert len({len(column) for column in table.values()}) == 1
        assert all(np.isfinite(column).all() for column in table.values())
    assert log.truth is not None
    assert log.truth["position_m"].dims == ("vehicle", "time", "axis")
    assert log.truth["yaw_rad"].dims == log.truth["depth_m"].dims == ("vehicle", "time")
    assert log.truth["time"].values.tolist() == list(range(901))
    assert log.truth["axis"].values.tolist() == ["east", "north"]
    assert log.truth["vehicle"].values.tolist() == list(log.vehicles)
    assert log.setup.tables() == scenario.load(name).resolved()
    assert len(log.slots["tol_ns"]) == 300
    assert 590 <= len(log.opportunities["tol_ns"]) <= 600
    assert log.opportunities["draws"].shape[1] == log.link.max_frames
    assert (log.link.modem, log.link.frame_bytes) == ("micromodem-64", 64)
    assert set(log.slots["capacity_bytes"]) == {64}


@pytest.mark.parametrize("name", PACKAGED)
def test_the_same_seed_gives_the_same_bits_and_another_one_another_mission(name: str) -> None:
    first, again = columns_of(simulate(name, 7, CHART)), columns_of(simulate(name, 7, CHART))
    other = columns_of(simulate(name, 8, CHART))
    assert first.keys() == again.keys()
    for key, column in first.items():
        assert column.tobytes() == again[key].tobytes(), key
    same = {"slots.tol_ns", "slots.sender", "slots.capacity_bytes", "truth.depth_m", "truth.current_mps"}
    for key in ("motion.velocity_e_mps", "water_depth.water_depth_m", "fix.e_m", "opportunities.toa_ns"):
        assert key not in same
        assert first[key].tobytes() != other[key].tobytes(), key


def test_the_scenarios_own_seed_is_the_default() -> None:
    s = scenario.load("st-john", ["seed=5", "duration_s=30"])
    assert (
        columns_of(simulate(s, chart=CHART))["fix.e_m"][0] == columns_of(simulate(s, 5, CHART))["fix.e_m"][0]
    )
    assert simulate(s, chart=CHART).seed == 5


def test_simulating_takes_well_under_a_second() -> None:
    s = scenario.load("st-john-drift")
    simulate(s, 0, CHART)
    start = time.process_time()
    simulate(s, 1, CHART)
    assert time.process_time() - start < 0.5  # 0.03 s measured


def test_dead_reckoning_of_st_john_ends_where_the_fix_left_it() -> None:
    errors = [e for seed in range(40) for e in final_dead_reckoning_errors(simulate("st-john", seed, CHART))]
    # A disc of 10 m has its median at 7.07 m; 1.5 m of noise on each axis after 900 s adds a little.
    assert np.median(errors) == pytest.approx(7.2, abs=0.8)
    assert np.max(errors) < 16


def test_dead_reckoning_of_the_drift_scenario_is_hundreds_of_metres_off() -> None:
    errors = [
        e for seed in range(40) for e in final_dead_reckoning_errors(simulate("st-john-drift", seed, CHART))
    ]
    # 0.01 m/s/sqrt(s) integrates to 0.01 x 900^1.5 / sqrt(3) = 156 m on each axis: median 1.18 x 156 m.
    assert np.median(errors) == pytest.approx(184, rel=0.25)


def test_dead_reckoning_of_poor_bay_is_its_current() -> None:
    logs = [simulate("poor-bay", seed, CHART) for seed in range(30)]
    errors = [e for log in logs for e in final_dead_reckoning_errors(log)]
    assert np.median(errors) == pytest.approx(90, rel=0.15)  # 0.1 m/s x 900 s
    assert logs[0].truth is not None
    np.testing.assert_allclose(np.hypot(*logs[0].truth["current_mps"].values[0, 0]), 0.1)
    survive = np.concatenate([log.opportunities["survive_probability"] for log in logs])
    assert set(np.round(survive, 12)) <= {0.8, 0.0}
    assert (survive == 0).mean() < 0.03  # beyond the schedule's range, signals collide


def test_a_further_vehicle_leaves_the_first_ones_mission_as_it_was() -> None:
    three = simulate("st-john-drift", 3, CHART)
    four = simulate(scenario.load("st-john-drift", ["vehicles.count=4"]), 3, CHART)
    assert three.truth is not None
    assert four.truth is not None
    np.testing.assert_array_equal(three.truth["position_m"].values, four.truth["position_m"].values[:3])
    for kind, table in three.events.items():
        mine = four.events[kind]["vehicle"] < 3
        for name, column in table.items():
            np.testing.assert_array_equal(column, four.events[kind][name][mine])


def test_loss_modem_and_noise_can_be_varied_on_paired_missions() -> None:
    base = columns_of(simulate("st-john-drift", 3, CHART))
    lossy = columns_of(simulate(scenario.load("st-john-drift", ["acoustics.loss.probability=0.6"]), 3, CHART))
    assert set(lossy.pop("opportunities.survive_probability")) <= {0.4, 0.0}
    del base["opportunities.survive_probability"]
    for key, column in base.items():
        np.testing.assert_array_equal(column, lossy[key])


def test_every_opportunity_belongs_to_its_slot() -> None:
    log = simulate("flat-bay", 2, CHART)
    sender_at = dict(zip(log.slots["tol_ns"].tolist(), log.slots["sender"].tolist(), strict=True))
    o = log.opportunities
    assert all(sender_at[t] == s for t, s in zip(o["tol_ns"].tolist(), o["sender"].tolist(), strict=True))
    assert (o["sender"] != o["receiver"]).all()
    ranges = 1500 * (o["toa_ns"] - o["tol_ns"]) / 1e9
    assert ((ranges >= 0) & (ranges < 1420)).all()


def test_synthetic_charts_follow_the_scenario_and_are_made_once() -> None:
    st_john, flat = scenario.load("st-john").chart, scenario.load("flat-bay").chart
    assert open_chart(st_john) is open_chart(st_john)
    deep, shallow = open_chart(st_john), open_chart(flat)
    assert shallow.depth_m.std() == pytest.approx(0.15 * deep.depth_m.std(), rel=1e-3)
    assert deep.correlation_length_m == shallow.correlation_length_m == 0
    assert open_chart(scenario.load("st-john", ["chart.seed=1"]).chart) != deep
    with pytest.raises(ChartError, match="st-jon"):
        open_chart(scenario.load("st-john", ["chart.source=synthetic:st-jon"]).chart)


@pytest.mark.parametrize("name", PACKAGED)
def test_packaged_scenarios_run_on_their_own_seabed(name: str) -> None:
    log = simulate(name, 0)
    assert log.chart is not None
    assert len(log.events["water_depth"]["t_ns"]) == 3 * 901  # random paths stay over the chart


def test_what_cannot_be_simulated_is_refused() -> None:
    with pytest.raises(ScenarioError, match=r"seed is -1: must be at least 0"):
        simulate("st-john", -1, CHART)
    with pytest.raises(ScenarioError, match="neither a file nor packaged"):
        simulate("st-jhon", 0, CHART)
    with pytest.raises(
        ScheduleError, match=r"slot of 3\.00 s is shorter than 1 frame x 3\.20 s \(micromodem-32\)"
    ):
        simulate(scenario.load("st-john", ["acoustics.modem=micromodem-32"]), 0, CHART)
    with pytest.raises(ScheduleError, match=r"packet of 70 bytes: slot of 3\.00 s is shorter than 2 frames"):
        simulate(scenario.load("st-john", ["acoustics.packet_bytes=70"]), 0, CHART)


def test_a_recorded_mission_delivers_its_soundings_beside_simulated_ranges(tmp_path: Path) -> None:
    rows = "".join(f"{t},{10 + t},{20 + 0.5 * t},{5 + 0.1 * t:.1f}\n" for t in range(0, 121, 3))
    (tmp_path / "a.csv").write_text("t,e,n,z\n" + rows)
    (tmp_path / "mine.toml").write_text(
        """
        name = "two-days"
        duration_s = 100
        drift = {preset = "dvl"}
        chart = {source = "synthetic:st-john"}
        acoustics = {modem = "aloc", slot_s = 5.0, max_range_m = 1000.0}
        [[vehicles]]
        name = "day-1"
        depth_m = 0
        track = {file = "a.csv", columns = {time = "t", east = "e", north = "n", sounding = "z"}}
        [[vehicles]]
        name = "auv"
        """
    )
    log = simulate(tmp_path / "mine.toml", 0, CHART)
    water = log.events["water_depth"]
    mine = water["vehicle"] == 0
    np.testing.assert_array_equal(water["t_ns"][mine], np.arange(0, 100, 3) * 10**9)
    np.testing.assert_allclose(water["water_depth_m"][mine], 5 + 0.1 * np.arange(0, 100, 3))
    assert (water["vehicle"] == 1).sum() == 101
    assert len(log.opportunities["tol_ns"]) >= 18
    assert log.truth is not None
    assert log.truth["depth_m"].values[:, 0].tolist() == [0.0, 2.0]


def test_streams_differ_in_every_part_of_their_name() -> None:
    names = [(0, 0, Purpose.PATH), (1, 0, Purpose.PATH), (0, 1, Purpose.PATH), (0, 0, Purpose.FIX)]
    draws = [stream(*name).random() for name in names] + [stream(0, 0, Purpose.PATH, 1).random()]
    assert len(set(draws)) == 5
    assert stream(0, 0, Purpose.PATH).random() == draws[0]


def test_a_chart_file_is_read_with_the_options_of_its_table(tmp_path: Path) -> None:
    pytest.importorskip("scipy")
    pytest.importorskip("scipy")
    east, north = np.meshgrid(np.arange(0, 301, 4.0), np.arange(0, 301, 4.0))
    up = -(10 + 0.02 * east + 0.01 * north)
    rows = "".join(f"{e},{n},{z}\n" for e, n, z in zip(east.flat, north.flat, up.flat, strict=True))
    (tmp_path / "soundings.csv").write_text("e,n,depth\n" + rows)
    (tmp_path / "mine.toml").write_text(
        """
        name = "surveyed"
        duration_s = 60
        vehicles = {count = 2}
        acoustics = {modem = "unlimited", slot_s = 5.0, max_range_m = 1000.0}
        sensors = {water_depth = {sigma_m = 0.0}}
        [chart]
        source = "soundings.csv"
        columns = "e,n,depth"
        crs = "local"
        positive = "up"
        cell_m = 4.0
        sigma_map_m = 0.2
        correlation_length_m = 12.0
        """
    )
    log = simulate(tmp_path / "mine.toml", 0)
    assert log.chart is not None
    assert log.truth is not None
    assert (log.chart.cell_m, log.chart.sigma_map_m, log.chart.correlation_length_m) == (4.0, 0.2, 12.0)
    at = log.truth["position_m"].values.transpose(1, 0, 2).reshape(-1, 2)
    water = log.events["water_depth"]["water_depth_m"]
    assert len(water) == len(at)
    # the chart's local zero is its own choice: the sounded plane is checked by its slope
    fitted, *_ = np.linalg.lstsq(np.column_stack([at, np.ones(len(at))]), water, rcond=None)
    np.testing.assert_allclose(fitted[:2], [0.02, 0.01], atol=2e-3)
    with pytest.raises(ChartError, match="does not exist"):
        simulate(scenario.load(tmp_path / "mine.toml", ["chart.source=none.tif"]))
