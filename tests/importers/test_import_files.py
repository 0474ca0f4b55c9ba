"""The same dive from every kind of file is the same mission."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import uwcoop
from recorded_dive import (
    LAT0,
    LON0,
    SECONDS,
    T0,
    VEHICLES,
    degrees_of,
    distance_m,
    swim,
    write_alog,
    write_bags,
    write_dataflash,
    write_lsf,
    write_tables,
    write_tlog,
)  # fmt: skip
from uwcoop.cli import app
from uwcoop.errors import LogError
from uwcoop.importers.recordings import import_recordings
from uwcoop.missionlog import MissionLog
from uwcoop.missionlog.mcap import load_log, write_log

ORIGIN = {"origin_deg": [LAT0, LON0], "name": "dive"}
SENSORS = {
    "heading": {"sigma_deg": 1.0}, "pressure": {"density_kgpm3": 1025.0}, "fix": {"sigma_m": 2.0},
    "turn_rate": {"use": False},
}  # fmt: skip
RANGES = {"ranges": [{"topic": "/{vehicle}/modem/range", "sigma_m": 0.5}]}


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return write_bags(tmp_path_factory.mktemp("bags"))


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return write_tables(tmp_path_factory.mktemp("tables"))


def imported(path: Path | list[Path]) -> MissionLog:
    files = path if isinstance(path, list) else [path]
    told = {**ORIGIN, "sensors": SENSORS, **({} if isinstance(path, list) else RANGES)}
    return import_recordings(files, overrides=told)


def check_is_the_dive(log: MissionLog) -> None:
    """Against what was swum, whatever file it came from."""
    assert log.vehicles == VEHICLES
    assert log.epoch_ns == T0 * 10**9
    for index in range(2):
        own = swim(index)
        for kind, column, expected in (
            ("heading", "yaw_rad", own["yaw"]), ("depth", "depth_m", own["depth"]),
            ("ground_velocity", "forward_mps", own["forward"]),
            ("water_depth", "water_depth_m", own["depth"] + own["altitude"]),
        ):  # fmt: skip
            table = log.events[kind]
            mine = table["vehicle"] == index
            assert mine.sum() == SECONDS + 1, kind
            np.testing.assert_array_equal(table["t_ns"][mine], np.arange(SECONDS + 1) * 10**9)
            np.testing.assert_allclose(table[column][mine], expected, atol=2e-4, err_msg=kind)
        fix = {
            name: column[log.events["fix"]["vehicle"] == index] for name, column in log.events["fix"].items()
        }
        np.testing.assert_allclose(fix["e_m"], own["east"][::30], atol=0.3)
        np.testing.assert_allclose(fix["n_m"], own["north"][::30], atol=0.3)
    heard = log.opportunities
    assert len(heard["toa_ns"]) == 18
    for toa, tol, sender, receiver in zip(
        *(heard[c] for c in ("toa_ns", "tol_ns", "sender", "receiver")), strict=True
    ):
        k = round(toa / 1e9)
        assert receiver == (k % 10) // 5, "who polled has the range"
        assert sender == 1 - receiver, "who answered sent"
        assert (toa - tol) * 1500e-9 == pytest.approx(distance_m(0, 1, k), abs=2e-3)


@pytest.mark.parametrize("kind", ["mcap", "sqlite3", "ros1"])
def test_a_bag_of_every_kind_is_the_dive(bags: dict[str, Path], kind: str) -> None:
    check_is_the_dive(imported(bags[kind]))


def test_bags_of_all_kinds_hold_the_same_bits(bags: dict[str, Path]) -> None:
    first, *others = (replace(imported(bags[kind]), notes=()) for kind in ("mcap", "sqlite3", "ros1"))
    for other in others:
        assert first.difference(other) is None


def test_tables_are_the_dive(tables: list[Path]) -> None:
    check_is_the_dive(imported(tables))


def test_neither_the_order_of_files_nor_of_columns_counts(tables: list[Path], tmp_path: Path) -> None:
    whole = replace(imported(tables), notes=())
    for order in (1, 2, 3):
        folder = tmp_path / str(order)
        folder.mkdir()
        shuffled = write_tables(folder, order)
        if order < 3:
            log = import_recordings(shuffled[order:] + shuffled[:order], overrides={
                **ORIGIN, "sensors": SENSORS, "vehicles": [{"name": n} for n in VEHICLES],
            })  # fmt: skip
            told = replace(log, notes=(), setup=whole.setup)
            assert whole.difference(told) is None


def test_a_folder_and_its_file_are_the_same(bags: dict[str, Path]) -> None:
    part = next(bags["mcap"].glob("*.mcap"))
    assert replace(imported(part), notes=()).difference(replace(imported(bags["mcap"]), notes=())) is None


def test_the_report_is_printed_and_travels_in_the_log(bags: dict[str, Path], tmp_path: Path) -> None:
    out = tmp_path / "mission.mcap"
    toml = tmp_path / "import.toml"
    toml.write_text(f'origin_deg = [{LAT0}, {LON0}]\n[[ranges]]\ntopic = "/{{vehicle}}/modem/range"\n')
    shown = CliRunner().invoke(app, ["import", str(bags["mcap"]), "-c", str(toml), "-o", str(out)])
    assert shown.exit_code == 0, shown.output
    log = load_log(out)
    assert log.counterfactual == ("packets ride on the ranges that were measured",)
    for said in (
        "2025-10-09T08:53:20.000Z", "alpha heading: 91 of 91 rows of /alpha/imu; yaw from east (ENU); sigma 0.573 deg",
        "alpha pressure:", "sigma 0.1 m assumed", "ranges alpha - bravo: 9 of 9 rows", "origin as set",
    ):  # fmt: skip
        assert any(said in note for note in log.notes), said
    for note in log.notes:
        assert note in shown.stderr


def test_what_inspect_proposes_imports_the_same(
    bags: dict[str, Path], tables: list[Path], tmp_path: Path
) -> None:
    for files in ([bags["ros1"]], tables):
        shown = CliRunner().invoke(app, ["import", *map(str, files), "--inspect"])
        assert shown.exit_code == 0, shown.output
        toml = tmp_path / "proposed.toml"
        toml.write_text(shown.stdout)
        proposed = import_recordings(files, toml, overrides=ORIGIN)
        plain = import_recordings(files, overrides={**ORIGIN, **({} if files is tables else RANGES)})
        for kind, table in plain.events.items():
            for name, column in table.items():
                np.testing.assert_array_equal(column, proposed.events[kind][name], err_msg=f"{kind} {name}")
        np.testing.assert_array_equal(plain.opportunities["tol_ns"], proposed.opportunities["tol_ns"])
        assert "looks like" not in shown.stdout
    assert "alpha.csv" in shown.stderr
    assert "heading_deg" in shown.stderr


def test_a_bag_that_was_cut_gives_what_it_holds_and_says_so(bags: dict[str, Path], tmp_path: Path) -> None:
    from mcap.reader import make_reader
    from mcap.writer import Writer

    chunked = tmp_path / "chunked.mcap"
    with next(bags["mcap"].glob("*.mcap")).open("rb") as before, chunked.open("wb") as after:
        writer = Writer(after, chunk_size=20_000)
        writer.start(profile="ros2")
        known: dict[str, int] = {}
        for schema, channel, message in make_reader(before).iter_messages():
            assert schema is not None
            if channel.topic not in known:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                known[channel.topic] = writer.register_channel(
                    channel.topic, channel.message_encoding, number
                )
            writer.add_message(known[channel.topic], message.log_time, message.data, message.publish_time)
        writer.finish()  # type: ignore[no-untyped-call]
    told = {**ORIGIN, "vehicles": [{"name": n} for n in VEHICLES]}
    path = tmp_path / "cut.mcap"
    path.write_bytes(chunked.read_bytes()[: int(0.5 * chunked.stat().st_size)])
    log = import_recordings([path], overrides=told)
    assert any(
        "cut.mcap is cut off or damaged after" in note and "what comes before is read" in note
        for note in log.notes
    )
    kept = len(log.events["heading"]["t_ns"])
    assert 0.2 < kept / (2 * (SECONDS + 1)) < 0.8
    np.testing.assert_allclose(
        log.events["heading"]["yaw_rad"][log.events["heading"]["vehicle"] == 0],
        swim(0)["yaw"][: np.count_nonzero(log.events["heading"]["vehicle"] == 0)], atol=1e-9,
    )  # fmt: skip
    path.write_bytes(bags["ros1"].read_bytes()[:60_000])  # its only chunk is the one that is cut
    with pytest.raises(LogError, match="cut off or damaged after"):
        import_recordings([path], overrides=told)


def test_truth_of_a_table_and_of_a_topic(bags: dict[str, Path], tmp_path: Path) -> None:
    path = tmp_path / "truth.csv"
    lines = ["time,vehicle,lat,lon"]
    for index, name in enumerate(VEHICLES):
        latitude, longitude = degrees_of(swim(index))
        lines += [f"{T0 + k},{name},{latitude[k]:.8f},{longitude[k]:.8f}" for k in range(SECONDS + 1)]
    path.write_text("\n".join(lines) + "\n")
    by_table = import_recordings([bags["mcap"]], overrides=ORIGIN, truth=[str(path)])
    assert by_table.truth is not None
    np.testing.assert_allclose(by_table.truth["position_m"].values[1, :, 1], swim(1)["north"], atol=0.3)
    by_topic = import_recordings([bags["mcap"]], overrides=ORIGIN, truth=["/alpha/gps"])
    assert by_topic.truth is not None
    np.testing.assert_allclose(by_topic.truth["position_m"].values[0, :, 0], swim(0)["east"][::30], atol=0.3)


FORMATS: dict[str, tuple[Callable[[Path], Path], str, set[str]]] = {
    "a.tlog": (write_tlog, "pymavlink", {"heading", "depth", "water_depth", "fix", "turn_rate"}),
    "a.bin": (write_dataflash, "pymavlink", {"heading", "fix"}),
    "a.alog": (write_alog, "", {"heading", "depth", "water_depth", "fix", "motion"}),
    "a.lsf": (write_lsf, "imcpy", {"heading", "depth", "ground_velocity", "fix"}),
}


@pytest.mark.parametrize("name", FORMATS)
def test_logs_of_other_systems_are_the_dive(name: str, tmp_path: Path) -> None:
    write, package, kinds = FORMATS[name]
    if package and importlib.util.find_spec(package) is None:
        pytest.skip(f"{package} is not installed")
    path = write(tmp_path / name)
    log = import_recordings([path], overrides={**ORIGIN, "sensors": {"pressure": {"density_kgpm3": 1025.0}}})
    assert log.vehicles == ("a",)
    assert log.events.keys() == kinds
    own = swim(0)
    steps = log.events["heading"]["t_ns"] / 1e9
    assert steps[0] == pytest.approx(0, abs=0.01)
    np.testing.assert_allclose(np.diff(steps), 1.0, atol=0.01)
    np.testing.assert_allclose(log.events["heading"]["yaw_rad"], own["yaw"], atol=2e-4)
    np.testing.assert_allclose(log.events["fix"]["n_m"], own["north"][::30], atol=0.3)
    if "depth" in kinds:
        np.testing.assert_allclose(log.events["depth"]["depth_m"], own["depth"], atol=2e-3)
    if "water_depth" in kinds:
        # a.tlog: pitched by 0.05 rad, distances in centimetres.
        pitch = 0.05 if name == "a.tlog" else 0.0
        expected = own["depth"] + own["altitude"] * np.cos(pitch)
        np.testing.assert_allclose(log.events["water_depth"]["water_depth_m"], expected, atol=0.012)
    if "motion" in kinds:
        np.testing.assert_allclose(
            log.events["motion"]["velocity_e_mps"], own["forward"] * np.cos(own["yaw"]), atol=1e-4
        )
    write_log(log, tmp_path / "m.mcap")
    assert log.difference(load_log(tmp_path / "m.mcap")) is None


@pytest.mark.parametrize(
    ("name", "vehicles", "seconds"),
    [
        ("goats/goats_15.pyfg", 4, 4233), ("plaza/Plaza1_.mat", 5, 1934), ("labyrinth/Indoor_UWB_Input.txt", 5, 30),
        ("mrclam/MRCLAM_Dataset6", 4, 128),
    ],
)  # fmt: skip
def test_data_sets_come_through_the_same_door(
    reference: Path, tmp_path: Path, name: str, vehicles: int, seconds: int
) -> None:
    out = tmp_path / "mission.mcap"
    shown = CliRunner().invoke(app, ["import", str(reference / "data" / name), "-o", str(out)])
    assert shown.exit_code == 0, shown.output
    log = load_log(out)
    assert len(log.vehicles) == vehicles
    assert round(log.duration_ns / 1e9) == seconds


def test_one_session_of_a_table_of_many(reference: Path) -> None:
    path = reference / "data/aburatsubo/sessions_valid.csv.gz"
    with pytest.raises(LogError, match=r"nothing is recorded from 2022-04-09T23:01:54.*several missions"):
        import_recordings([path])
    boat = {
        "name": "boat",
        "where": {"f": "20240727_0717_stripped"},
        "water_depth": {"columns": {"water_depth": "z"}},
    }
    log = import_recordings([path], overrides={"vehicles": [boat]})
    assert len(log.events["water_depth"]["t_ns"]) == 2068
    assert log.epoch_ns == 1_722_032_248 * 10**9


def test_recorded_bags_are_navigated_better_than_by_dead_reckoning(reference: Path, tmp_path: Path) -> None:
    """Ten minutes of two vehicles as `make_bags.py` writes them, by eight lines of TOML, against their truth."""
    made = subprocess.run(
        [sys.executable, str(reference / "cases/make_bags.py"), str(tmp_path)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert made.returncode == 0, made.stderr
    toml = tmp_path / "import.toml"
    toml.write_text(
        'name = "dive"\norigin_deg = [41.9, -70.5]\n[sensors.altimeter]\nsigma_m = 0.05\n'
        '[[ranges]]\ntopic = "/{vehicle}/modem/range"\nsigma_m = 0.3\n'
    )
    logs = [import_recordings([tmp_path / name], toml) for name in ("ros2-mcap", "ros2-sqlite3", "ros1.bag")]
    for other in logs[1:]:
        assert replace(logs[0], notes=()).difference(replace(other, notes=())) is None
    summary = uwcoop.run(
        logs[0], ["dead-reckoning", "mpf", "team"], chart=tmp_path / "chart.xyz", truth=[str(tmp_path / "truth.csv")],
        clouds=False,
    ).summary["navigators"]  # fmt: skip

    def pooled(name: str) -> tuple[float, list[float]]:
        merits = summary[name]["vehicles"].values()
        return float(np.sqrt(np.mean([m["rmse_m"] ** 2 for m in merits]))), [m["anees"] for m in merits]

    reckoned, _ = pooled("dead-reckoning")
    for name, most_m, least_gain in (("team", 2.6, 1.6), ("mpf", 2.7, 1.4)):
        rmse, anees = pooled(name)
        assert rmse <= most_m
        assert reckoned / rmse >= least_gain, name
        assert all(0.4 < value < 5 for value in anees), "one mission: instants are correlated"
