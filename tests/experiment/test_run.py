"""Runs: one path for simulation, log and live; same bits; what a vehicle may know; navigators of one's own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import uwcoop
from uwcoop import _native, scenario
from uwcoop.charts.native import native_chart
from uwcoop.errors import LogError, NavigatorError
from uwcoop.experiment.navigator_choice import default_navigators
from uwcoop.experiment.run import native_mission, replay_for, sample_times_ns
from uwcoop.missionlog import MissionLog
from uwcoop.missionlog.mcap import write_log
from uwcoop.navigators import Context, Custom, build, options_of
from uwcoop.world.simulate import simulate

SHORT = ("duration_s=120", "navigator.all.particles=150")


@pytest.fixture(scope="module")
def log() -> MissionLog:
    return simulate(scenario.load("flat-bay", SHORT), seed=3)


def same(a: xr.Dataset, b: xr.Dataset) -> None:
    """Equal bit for bit, NaNs included."""
    assert set(a.variables) == set(b.variables)
    for name in a.variables:
        left, right = a[name].to_numpy(), b[name].to_numpy()
        assert left.dtype == right.dtype, name
        assert left.tobytes() == right.tobytes(), name


def test_the_same_seed_gives_the_same_bits_with_one_and_four_threads(log: MissionLog) -> None:
    one, four = uwcoop.run(log, threads=1), uwcoop.run(log, threads=4)
    same(one.tracks, four.tracks)
    assert one.clouds is not None
    assert four.clouds is not None
    same(one.clouds, four.clouds)
    other = uwcoop.run(log, ["mpf"], seed=4)
    assert not np.array_equal(other.tracks.position_m[0], one.tracks.position_m.sel(navigator="mpf"))


def test_a_log_from_a_file_gives_the_bits_of_the_log_in_memory(log: MissionLog, tmp_path: Path) -> None:
    write_log(log, tmp_path / "m.mcap")
    same(uwcoop.run(log).tracks, uwcoop.run(tmp_path / "m.mcap").tracks)


def test_resuming_from_a_snapshot_equals_the_uninterrupted_mission(log: MissionLog) -> None:
    mission, samples = native_mission(log), sample_times_ns(log)
    chart = native_chart(log.chart) if log.chart else None

    def fresh(name: str) -> _native.Replay:
        return replay_for(log, mission, name, chart, 7, samples, 10)

    for name in default_navigators(log.setup, len(log.vehicles)):
        whole = fresh(name)
        whole.run()
        expected = whole.tracks()
        for cut_s in (0.0, 4.2, 60.0, 119.5):
            first, second = fresh(name), fresh(name)
            first.run(round(cut_s * 1e9))
            second.restore(first.snapshot())
            second.run()
            got = second.tracks()
            for key in ("mean_m", "covariance_m2", "ess", "rejected"):
                assert got[key].tobytes() == expected[key].tobytes(), (name, cut_s, key)
            assert len(got["clouds"]) == len(expected["clouds"])


def test_a_live_vehicle_gets_what_the_replay_gets(log: MissionLog) -> None:
    """Events handed over one at a time from Python, without ranges: the recorded estimates to the bit."""
    context = Context(0, 3, log.link.sound_speed_mps, log.seed, log.chart)
    assert log.chart is not None
    options = options_of("mpf-terrain-only", log.setup)
    navigator = build("mpf-terrain-only", context, options, native_chart(log.chart))
    events = []
    for kind, table in log.events.items():
        payload = [c for c in table if c not in ("t_ns", "vehicle")]
        for row in np.flatnonzero(table["vehicle"] == 0):
            fields = {c: table[c][row] for c in payload}
            events.append((int(table["t_ns"][row]), kind, fields))
    order = list(log.events)
    for t_ns, kind, fields in sorted(events, key=lambda e: (e[0], order.index(e[1]))):
        navigator.handle(_native.Event(t_ns, 0, kind, **fields))
    end = navigator.estimate(log.duration_ns)
    replayed = uwcoop.run(log, ["mpf-terrain-only"], clouds=False).tracks
    np.testing.assert_array_equal(end.mean_m, replayed.position_m[0, 0, -1])
    np.testing.assert_array_equal(end.covariance_m2, replayed.covariance_m2[0, 0, -1])


def test_navigators_are_paired_and_a_vehicle_more_shifts_no_one(log: MissionLog) -> None:
    alone = uwcoop.run(log, ["terrain-only"], clouds=False).tracks
    together = uwcoop.run(log, ["dmpf", "terrain-only"], clouds=False).tracks
    np.testing.assert_array_equal(
        alone.position_m.sel(navigator="terrain-only"), together.position_m.sel(navigator="terrain-only")
    )
    more = simulate(scenario.load("flat-bay", (*SHORT, "vehicles.count=4", "acoustics.slot_s=3")), seed=3)
    bigger = uwcoop.run(more, ["terrain-only"], clouds=False).tracks
    grid = alone.time.values == np.round(alone.time.values)
    wide = bigger.time.values == np.round(bigger.time.values)
    np.testing.assert_array_equal(alone.position_m[0, :3, grid], bigger.position_m[0, :3, wide])


def test_truth_reaches_no_navigator(log: MissionLog) -> None:
    assert log.truth is not None
    blind = MissionLog(**{**vars(log), "truth": None})
    with_truth, without = uwcoop.run(log, clouds=False).tracks, uwcoop.run(blind, clouds=False).tracks
    np.testing.assert_array_equal(with_truth.position_m, without.position_m)
    assert np.isnan(without.truth_position_m).all()


class _Listener:
    """Sends the time and believes to stand still; counts what it is told."""

    def __init__(self, context: Context) -> None:
        self.context, self.kinds, self.packets = context, [], []

    def handle(self, event: _native.Event) -> None:
        self.kinds.append(event.kind)
        if event.kind == "reception":
            self.packets.append((event.t_ns, event.fields))

    def transmit(self, tol_ns: int, capacity_bytes: int) -> bytes:
        return tol_ns.to_bytes(8, "big")

    def estimate(self, t_ns: int) -> Any:
        class Still:
            mean_m = np.zeros(2)
            covariance_m2 = np.eye(2)

        return Still()


def test_a_navigator_in_python_takes_part(log: MissionLog) -> None:
    made: list[_Listener] = []

    def make(context: Context) -> _Listener:
        made.append(_Listener(context))
        return made[-1]

    result = uwcoop.run(log, [Custom("listener", make), "dead-reckoning"])
    assert result.tracks.navigator.values.tolist() == ["listener", "dead-reckoning"]
    assert [m.context.vehicle for m in made] == [0, 1, 2]
    assert {"motion", "depth", "water_depth", "fix", "reception"} <= set(made[0].kinds)
    for t_ns, fields in made[0].packets:
        assert int.from_bytes(fields["bytes"], "big") == fields["tol_ns"]
        assert t_ns == fields["toa_ns"] + round(1e9 * (log.link.preamble_s + log.link.frame_s))
    received = result.packets["received"][result.packets["navigator"] == 0]
    assert 0.6 < received.mean() < 0.95
    heard = sum(len(m.packets) for m in made)
    assert received.sum() - 2 <= heard <= received.sum()


def test_what_a_python_navigator_raises_comes_back(log: MissionLog) -> None:
    class Broken(_Listener):
        def handle(self, event: _native.Event) -> None:
            raise RuntimeError("no more battery")

    with pytest.raises(RuntimeError, match="no more battery"):
        uwcoop.run(log, [Custom("broken", Broken)])


def test_bad_options_are_one_line_that_names_them(log: MissionLog) -> None:
    for overrides, words in (
        (("navigator.dmpf.particels=5",), "did you mean 'particles'"),
        (("navigator.dmpf.particles=5",), "navigator.dmpf.particles is 5"),
        (("navigator.mpf.sigma_range_m=-1.0",), "navigator.mpf.sigma_range_m is -1.0"),
        (("navigator.mfp.particles=50",), "navigator.mfp"),
        (("navigator.all.partikel=50",), "navigator.all.partikel"),
        (("navigator.terrain-only.use_ranges=true",), "terrain-only.use_ranges"),
    ):
        loaded = scenario.load("st-john", overrides)
        with pytest.raises(NavigatorError, match=words) as caught:
            uwcoop.run(simulate(loaded, seed=0))
        assert "\n" not in str(caught.value)
    with pytest.raises(NavigatorError, match="did you mean 'dmpf'"):
        uwcoop.run(log, ["dmfp"])
    with pytest.raises(LogError, match="more than once"):
        uwcoop.run(log, ["dmpf", "dmpf"])


def test_a_log_with_impossible_numbers_is_refused_before_anything_runs(log: MissionLog) -> None:
    events = {kind: dict(table) for kind, table in log.events.items()}
    depths = events["water_depth"]["water_depth_m"].copy()
    depths[17] = np.nan
    events["water_depth"]["water_depth_m"] = depths
    with pytest.raises(LogError, match="water_depth_m"):
        uwcoop.run(MissionLog(**{**vars(log), "events": events}))
