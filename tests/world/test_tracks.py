"""Recorded tracks as people have them: clocks, columns, encodings, and positions that cannot be."""

from __future__ import annotations

import datetime
import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from uwcoop import scenario
from uwcoop.charts import Chart
from uwcoop.errors import ScenarioError, UwcoopError
from uwcoop.frames import LocalFrame
from uwcoop.scenario.vehicle import Vehicle
from uwcoop.world.simulate import setup_notes, simulate
from uwcoop.world.tracks import read_tracks

pytest.importorskip("pyproj")

PLACE = (47.6, -122.4)
FRAME = LocalFrame.at(*PLACE)
T0 = 1_700_000_000
STEPS = 100
SLOW = settings(deadline=None, max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])


def seabed() -> Chart:
    axis = np.arange(-300, 301, 10.0)
    east, north = np.meshgrid(axis, axis)
    depth = 12 + 3 * np.sin(east / 40) * np.cos(north / 30)
    return Chart(depth.astype(np.float32), -300.0, -300.0, 10.0, origin=FRAME.origin)


CHART = seabed()
T = np.arange(0.0, 121.0)
LOCAL = np.column_stack([-250 + 1.2 * T, 0 * T])


def rows_of(local: np.ndarray[Any, Any] = LOCAL) -> list[dict[str, str]]:
    degrees = FRAME.to_geographic(local)
    depths = CHART.depth_at(local)
    return [
        {
            "time": f"{T0 + t:.1f}", "lon": f"{lon:.9f}", "lat": f"{lat:.9f}",
            "sounding": f"{depth:.2f}" if np.isfinite(depth) else "",
        }
        for t, (lat, lon), depth in zip(T, degrees, depths, strict=True)
    ]  # fmt: skip


def write(
    file: Path, rows: list[dict[str, str]], separator: str = ",", encoding: str = "utf-8", decimal: str = "."
) -> Path:
    lines = [separator.join(rows[0])]
    lines += [separator.join(cell.replace(".", decimal) for cell in row.values()) for row in rows]
    file.write_text("\n".join(lines) + "\n", encoding=encoding)
    return file


COLUMNS = {"time": "time", "longitude": "lon", "latitude": "lat", "sounding": "sounding"}


def vehicle(file: Path, name: str = "A", **track: Any) -> Vehicle:
    columns = track.pop("columns", COLUMNS)
    table = {"file": str(file), "columns": columns, **track}
    return Vehicle.model_validate({"name": name, "depth_m": 0.0, "track": table})


def read(*vehicles: Vehicle, steps: int = STEPS) -> dict[str, Any]:
    return read_tracks(vehicles, CHART, None, steps)


def changed(rows: list[dict[str, str]], lines: range, **values: Any) -> list[dict[str, str]]:
    return [{**row, **values} if k in lines else row for k, row in enumerate(rows)]


# --- clocks ---


def test_absolute_times_keep_two_boats_side_by_side(tmp_path: Path) -> None:
    late = 15
    a = write(tmp_path / "a.csv", rows_of())
    b = write(tmp_path / "b.csv", rows_of(np.add(LOCAL, [0, 20]))[late:])
    found = read(vehicle(a), vehicle(b, "B"))
    apart = found["B"].position_m - found["A"].position_m
    np.testing.assert_allclose(apart, np.tile([0.0, 20.0], (STEPS + 1, 1)), atol=1e-3)
    np.testing.assert_allclose(found["A"].position_m[0], LOCAL[late], atol=1e-3)
    assert any("15 s further on" in note for note in found["A"].notes)


@SLOW
@given(
    starts=st.lists(st.integers(0, 15), min_size=2, max_size=4),
    shifts=st.lists(st.integers(0, 5), min_size=4, max_size=4),
    unit=st.sampled_from(["s", "ms", "us", "ns", "iso"]),
)
def test_records_on_one_clock_stay_on_it(
    tmp_path: Path, starts: list[int], shifts: list[int], unit: str
) -> None:
    vehicles = []
    for k, start in enumerate(starts):
        rows = [{**row, "time": CLOCKS[unit](T0 + t)} for row, t in zip(rows_of(), T, strict=True)][start:]
        file = write(tmp_path / f"{k}.csv", rows)
        vehicles.append(vehicle(file, f"V{k}", start_s=float(shifts[k])))
    found = read(*vehicles)
    first = max(start + shift for start, shift in zip(starts, shifts, strict=False))
    for record in found.values():
        np.testing.assert_allclose(record.position_m, LOCAL[first : first + STEPS + 1], atol=1e-3)


def test_records_that_do_not_overlap_are_refused(tmp_path: Path) -> None:
    a = write(tmp_path / "a.csv", rows_of())
    late = [{**row, "time": f"{float(row['time']) + 86_400:.1f}"} for row in rows_of()]
    b = write(tmp_path / "b.csv", late)
    with pytest.raises(
        ScenarioError, match=r"^vehicle A: track .*a\.csv ends at 2023-11-14 .* must overlap$"
    ):
        read(vehicle(a), vehicle(b, "B"))


def iso(seconds: float) -> str:
    return datetime.datetime.fromtimestamp(seconds, datetime.UTC).isoformat().replace("+00:00", "Z")


CLOCKS = {
    "s": lambda s: f"{s:.1f}",
    "ms": lambda s: f"{int(s * 1e3)}",
    "us": lambda s: f"{int(s * 1e6)}",
    "ns": lambda s: f"{int(s) * 10**9}",
    "iso": iso,
    "hms": lambda s: iso(s)[11:19],
    "date": lambda s: iso(s)[:19].replace("T", " "),
}


@pytest.mark.parametrize("clock", CLOCKS)
def test_times_of_every_form_give_the_same_track(tmp_path: Path, clock: str) -> None:
    rows = [{**row, "time": CLOCKS[clock](T0 + t)} for row, t in zip(rows_of(), T, strict=True)]
    found = read(vehicle(write(tmp_path / "a.csv", rows)))["A"]
    np.testing.assert_allclose(found.position_m, LOCAL[: STEPS + 1], atol=1e-3)


def test_clocks_of_their_own_start_together_and_say_so(tmp_path: Path) -> None:
    rows = [{**row, "time": f"{t + 7:.1f}"} for row, t in zip(rows_of(), T, strict=True)]
    a, b = write(tmp_path / "a.csv", rows_of()), write(tmp_path / "b.csv", rows)
    found = read(vehicle(a), vehicle(b, "B"))
    np.testing.assert_allclose(found["A"].position_m, found["B"].position_m, atol=1e-3)
    assert any("a zero of its own" in note for note in found["B"].notes)


def test_times_of_day_of_two_records_are_one_clock(tmp_path: Path) -> None:
    rows = [{**row, "time": CLOCKS["hms"](T0 + t)} for row, t in zip(rows_of(), T, strict=True)]
    a, b = write(tmp_path / "a.csv", rows), write(tmp_path / "b.csv", rows[10:])
    found = read(vehicle(a), vehicle(b, "B"))
    np.testing.assert_allclose(found["A"].position_m, found["B"].position_m, atol=1e-3)
    assert any("taken for the same day" in note for note in found["A"].notes)


# --- positions ---


BROKEN = {
    "zero": (changed(rows_of(), range(8), lon="0.0", lat="0.0"),
             r"8 rows, the first in line 2, have no fix yet at \(0, 0\)"),
    "swapped": ([{**row, "lon": row["lat"], "lat": row["lon"]} for row in rows_of()],
                r"latitude -122\.4033\d+ in line 2 is outside ±90: columns swapped\?"),
    "sign": ([{**row, "lon": row["lon"].lstrip("-")} for row in rows_of()],
             r"track lies 7,7\d\d km from the chart; with the other sign of longitude it would lie near it"),
    "far": (rows_of(np.add(LOCAL, [20_000, 0])),
            r"track lies 19\.[45] km from the chart .*: none of 101 soundings is on it"),
    "glitch": (rows_of(LOCAL + [[0, 800 * (k == 60)] for k in range(121)]),
               r"moves 800\.0 m in 1 s to line 62, 800 m/s: must be at most track\.max_speed_mps = 15 \(1 of 2"),
    "one row elsewhere": (changed(rows_of(), range(50, 51), lon="10.0"),
                          r"position 47\.600000, 10\.000000 in line 52 lies 8,\d+ km from the chart \(1 such rows\)"),
}  # fmt: skip


@pytest.mark.parametrize("name", BROKEN)
def test_positions_that_cannot_be_are_refused_with_vehicle_file_and_line(tmp_path: Path, name: str) -> None:
    rows, says = BROKEN[name]
    rows = [{**row, "sounding": row["sounding"] or "12.0"} for row in rows]
    file = write(tmp_path / "a.csv", rows)
    with pytest.raises(ScenarioError, match=rf"^vehicle A: track {file}:? .*{says}|{file}: {says}"):
        read(vehicle(file))


def test_rows_without_a_fix_can_be_left_out_with_a_note(tmp_path: Path) -> None:
    rows = changed(rows_of(), range(8), lon="0", lat="0")
    found = read(vehicle(write(tmp_path / "a.csv", rows), drop_without_fix=True))["A"]
    np.testing.assert_allclose(found.position_m[0], LOCAL[8], atol=1e-3)
    assert any("8 rows, the first in line 2" in note and "left out" in note for note in found.notes)


def test_a_fast_boat_is_a_matter_of_the_bound_and_noise_within_a_second_is_none(tmp_path: Path) -> None:
    rows = rows_of(np.column_stack([-250 + 4 * T, 0 * T]))
    file = write(tmp_path / "a.csv", rows)
    with pytest.raises(ScenarioError, match=r"4 m/s: must be at most track\.max_speed_mps = 3"):
        read(vehicle(file, max_speed_mps=3.0))
    rng = np.random.default_rng(1)
    fine = np.repeat(LOCAL[:120], 10, axis=0) + np.clip(rng.standard_normal((1200, 2)), -2, 2)
    degrees = FRAME.to_geographic(fine)
    rows = [
        {"time": f"{T0 + k / 10:.1f}", "lon": f"{lon:.9f}", "lat": f"{lat:.9f}", "sounding": "12"}
        for k, (lat, lon) in enumerate(degrees)
    ]
    assert len(read(vehicle(write(tmp_path / "b.csv", rows)))["A"].position_m) == STEPS + 1


def test_a_track_partly_off_the_chart_says_how_much(tmp_path: Path) -> None:
    local = np.add(LOCAL, [490, 0])  # leaves the chart at east 300
    rows = [{**row, "sounding": row["sounding"] or "12.0"} for row in rows_of(local)]
    notes = read(vehicle(write(tmp_path / "a.csv", rows)))["A"].notes
    off = int((local[: STEPS + 1, 0] > 300).sum())
    assert any(f"{off} of 101 soundings" in note and "off the chart" in note for note in notes)


def test_metres_that_lie_like_degrees_are_refused(tmp_path: Path) -> None:
    file = write(tmp_path / "a.csv", rows_of())
    columns = {"time": "time", "east": "lon", "north": "lat"}
    with pytest.raises(ScenarioError, match=r"in line 2 look like degrees, all rows within 0\.00\d+ m"):
        read(vehicle(file, columns=columns))


# --- soundings ---


@pytest.mark.parametrize("value", ["-1", "0", "-1.0", "0.00"])
def test_no_echo_is_left_out_with_a_count(tmp_path: Path, value: str) -> None:
    file = write(tmp_path / "a.csv", changed(rows_of(), range(30, 39), sounding=value))
    found = read(vehicle(file))["A"]
    assert np.isnan(found.soundings_m[30:39]).all()
    assert np.isfinite(np.delete(found.soundings_m, np.s_[30:39])).all()
    assert any("9 of 121 soundings, the first in line 32, are 0 or -1 m" in note for note in found.notes)


@SLOW
@given(
    fill=st.floats(12_001, 1e38)
    | st.floats(-1e38, -9_001)
    | st.sampled_from([999.0, 9999.0, -9999.0, -32768.0]),
    count=st.integers(1, 60),
)
def test_fill_values_are_no_depths(tmp_path: Path, fill: float, count: int) -> None:
    file = write(tmp_path / "a.csv", changed(rows_of(), range(20, 20 + count), sounding=repr(fill)))
    found = read(vehicle(file))["A"]
    assert np.isnan(found.soundings_m[20 : 20 + count]).all()
    assert any(f"{count} of 121 soundings" in note and "fill values" in note for note in found.notes)


def test_a_stuck_sounder_is_noted(tmp_path: Path) -> None:
    found = read(vehicle(write(tmp_path / "a.csv", changed(rows_of(), range(20, 90), sounding="12.34"))))["A"]
    assert any("70 soundings in a row are 12.34 m, from line 22 on" in note for note in found.notes)
    assert not any(
        "in a row" in note for note in read(vehicle(write(tmp_path / "b.csv", rows_of())))["A"].notes
    )


# --- columns, units, encodings ---

NAMES = {
    "time": ["time", "timestamp", "UTC", "DateTime"],
    "lon": ["lon", "Longitude", "long (deg)", "Longitude (°)"],
    "lat": ["lat", "Latitude", "Latitude (°)"],
    "sounding": ["sounding", "Sounding (m)", "WaterDepth"],
}


@SLOW
@given(
    order=st.permutations(list(NAMES)),
    names=st.tuples(*[st.sampled_from(values) for values in NAMES.values()]),
    neighbours=st.integers(0, 3),
    separator=st.sampled_from([",", ";", "\t"]),
    encoding=st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "cp1252"]),
    decimal=st.sampled_from([".", ","]),
)
def test_columns_keep_their_roles_however_they_are_written(
    tmp_path: Path, order: list[str], names: tuple[str, ...], neighbours: int, separator: str, encoding: str, decimal: str
) -> None:  # fmt: skip
    if decimal == separator:
        separator = ";"
    called = dict(zip(NAMES, names, strict=True))
    rows = [
        {called[key]: row[key] for key in order} | {f"quality {k}": str(k) for k in range(neighbours)}
        for row in rows_of()
    ]
    file = write(tmp_path / "a.csv", rows, separator, encoding, decimal)
    found = read(Vehicle.model_validate({"name": "A", "track": {"file": str(file)}}))["A"]
    np.testing.assert_allclose(found.position_m, LOCAL[: STEPS + 1], atol=1e-3)
    np.testing.assert_allclose(found.soundings_m, CHART.depth_at(LOCAL[: STEPS + 1]), atol=0.006)


def test_soundings_in_feet_become_metres(tmp_path: Path) -> None:
    rows = [
        {
            **{key: row[key] for key in ("time", "lon", "lat")},
            "sounding (ft)": f"{float(row['sounding']) / 0.3048:.3f}",
        }
        for row in rows_of()
    ]
    file = write(tmp_path / "a.csv", rows)
    columns = {**COLUMNS, "sounding": "sounding (ft)"}
    found = read(vehicle(file, columns=columns))["A"]
    np.testing.assert_allclose(found.soundings_m, CHART.depth_at(LOCAL[: STEPS + 1]), atol=0.006)
    assert any("sounding in ft: converted" in note for note in found.notes)


def test_columns_that_nobody_can_tell_are_asked_for(tmp_path: Path) -> None:
    rows = [{"when": row["time"], "lon": row["lon"], "lat": row["lat"]} for row in rows_of()]
    file = write(tmp_path / "a.csv", rows)
    with pytest.raises(ScenarioError, match=r"no column is called time among when, lon, lat: name them"):
        read(Vehicle.model_validate({"name": "A", "track": {"file": str(file)}}))


# --- damage ---


def mutated(text: bytes, rng: np.random.Generator) -> bytes:
    """A file as damage leaves it: bytes changed, cut out, repeated, cells swapped for what is no number."""
    data = bytearray(text)
    for _ in range(int(rng.integers(1, 4))):
        at, length = int(rng.integers(len(data))), int(rng.choice([1, 3, 60]))
        kind = int(rng.integers(8))
        if kind == 0:
            data[at] = int(rng.integers(256))
        elif kind == 1:
            del data[at : at + length]
        elif kind == 2:
            data[at:at] = data[at : at + length]
        elif kind == 3:
            data[at:at] = rng.choice(
                [b",", b"\n", b'"', b"\x00", b";;", b"nan", b"1e400", b"-", b"\xff\xfe", b"9" * 40]
            )
        elif kind == 4:
            del data[at:]
        elif kind == 5:
            data[at : at + length] = bytes(rng.integers(0, 256, length, dtype=np.uint8))
        else:
            data[at] = int(rng.choice(list(b"0123456789")))
        data = data or bytearray(b"x")
    return bytes(data)


def one_line_or(file: Path) -> Any:
    """The record; None where it is refused in one line of our own. Anything else is a fault."""
    try:
        return read(vehicle(file, columns=None))["A"]
    except UwcoopError as error:
        if "\n" in str(error) or not str(error).startswith("vehicle A: track "):
            raise
        return None


def check_damaged(folder: Path, seeds: range) -> None:
    """A damaged record is read or refused in one line of our own, and what is read lies on the chart's part of Earth."""
    whole = {sep: write(folder / "whole.csv", rows_of(), sep).read_bytes() for sep in (",", ";", "\t")}
    read_ = refused = 0
    for seed in seeds:
        rng = np.random.default_rng(seed)
        file = folder / f"{seed}.csv"
        file.write_bytes(mutated(whole[str(rng.choice(list(whole)))], rng))
        record = one_line_or(file)
        file.unlink()
        if record is None:
            refused += 1
            continue
        read_ += 1
        assert np.isfinite(record.position_m).all()
        assert np.abs(record.position_m).max() < 200_000
        if record.soundings_m is not None:
            assert not (record.soundings_m < 0).any()
            assert not (record.soundings_m > 12_000).any()
    assert read_ > 0
    assert refused > 0


def test_damaged_records_are_read_or_refused(tmp_path: Path) -> None:
    check_damaged(tmp_path, range(150))


@pytest.mark.long
def test_many_damaged_records_are_read_or_refused(tmp_path: Path) -> None:
    check_damaged(tmp_path, range(1000, 4000))


# --- whole missions ---


def test_notes_of_tracks_are_in_the_log_and_the_cases_give_their_right_values(
    reference: Path, tmp_path: Path
) -> None:
    import runpy
    import sys

    maker = reference / "cases" / "make_tracks.py"
    argv = sys.argv
    try:
        sys.argv = [str(maker), str(tmp_path)]
        runpy.run_path(str(maker), run_name="__main__")
    finally:
        sys.argv = argv
    two = simulate(tmp_path / "two-clocks.toml", 0)
    assert two.truth is not None
    position = two.truth["position_m"].to_numpy()
    np.testing.assert_allclose(position[1] - position[0], np.tile([0.0, 20.0], (601, 1)), atol=2e-3)
    chart = two.chart
    plain = None
    for name in ("iso", "us", "ns", "hms", "minus-one"):
        log = simulate(scenario.load(tmp_path / f"{name}.toml"), 0, chart)
        assert log.truth is not None
        track = log.truth["position_m"].to_numpy()
        plain = track if plain is None else plain
        np.testing.assert_allclose(track, plain, atol=1e-6)
    assert any("9 of 901 soundings" in note for note in log.notes)
    again = setup_notes(scenario.load(tmp_path / "minus-one.toml"))
    assert set(again) <= set(log.notes)
    assert any("9 of 901 soundings" in note for note in again)
    for name, says in itertools.islice(
        {
            "zero": "have no fix yet at (0, 0)", "swapped": "columns swapped?", "sign": "7,740 km from the chart",
            "far": "19.5 km from the chart", "glitch": "to line 302",
        }.items(), None,
    ):  # fmt: skip
        with pytest.raises(ScenarioError) as caught:
            simulate(scenario.load(tmp_path / f"{name}.toml"), 0, chart)
        assert says in str(caught.value)
        assert str(caught.value).startswith(f"vehicle A: track {tmp_path / f'A-{name}.csv'}")
