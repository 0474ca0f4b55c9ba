"""A mission log on disk and back: bit for bit, whatever the numbers."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sample_log import sample_log
from uwcoop._native import event_bounds
from uwcoop.errors import LogError
from uwcoop.frames import Origin
from uwcoop.missionlog import EVENT_COLUMNS, RECEPTION_COLUMNS, Link, MissionLog, columns, event_columns
from uwcoop.missionlog.mcap import load_log, write_log
from uwcoop.missionlog.topics import namespaces


@pytest.fixture(scope="module")
def log() -> MissionLog:
    return sample_log(seconds=12)


@pytest.fixture(scope="module")
def content(log: MissionLog, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("mcap") / "mission.mcap"
    write_log(log, path)
    return path.read_bytes()


def test_every_table_comes_back_bit_for_bit(log: MissionLog, content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "mission.mcap"
    path.write_bytes(content)
    back = load_log(path)
    assert set(dict(back.tables())) == {*EVENT_COLUMNS, "slots", "opportunities", "receptions"}
    assert log.difference(back) is None
    assert log.truth is not None
    assert log.truth.identical(back.truth)
    for name, table in back.tables():
        for column, values in table.items():
            assert values.dtype == dict(log.tables())[name][column].dtype
            assert values.flags.writeable


def test_the_same_log_gives_the_same_bytes(log: MissionLog, content: bytes, tmp_path: Path) -> None:
    write_log(log, tmp_path / "again.mcap")
    assert (tmp_path / "again.mcap").read_bytes() == content


def test_what_is_empty_or_absent_stays_so(tmp_path: Path) -> None:
    log = sample_log(seconds=5)
    empty = {name: column[:0] for name, column in log.events["fix"].items()}
    log.events = {"depth": log.events["depth"], "fix": empty}
    log.opportunities = {name: column[:0] for name, column in log.opportunities.items()}
    log.slots, log.receptions, log.payloads, log.chart, log.truth = {}, {}, [], None, None
    log.origin = Origin()
    write_log(log, tmp_path / "log.mcap")
    back = load_log(tmp_path / "log.mcap")
    assert log.difference(back) is None
    assert back.chart is None
    assert back.truth is None
    assert back.opportunities["draws"].shape == (0, 3)


def test_truth_may_be_partly_unknown(tmp_path: Path) -> None:
    log = sample_log(seconds=5)
    assert log.truth is not None
    log.truth = log.truth.drop_vars(["yaw_rad", "current_mps", "depth_m"])
    log.truth["position_m"].to_numpy()[1, 2:] = np.nan
    log.truth = log.truth.assign_coords(time=np.arange(5) / 10)
    write_log(log, tmp_path / "log.mcap")
    assert log.difference(load_log(tmp_path / "log.mcap")) is None


def test_any_vehicle_name_gets_a_topic_of_its_own(tmp_path: Path) -> None:
    names = ("auv-1", "auv 1", "2nd", "Ærø", "truth", "---")
    assert namespaces(names) == ("auv_1", "auv_1_2", "v2nd", "r", "truth", "v")
    log = sample_log(seconds=4, vehicles=len(names))
    log.vehicles = names
    assert log.truth is not None
    log.truth = log.truth.assign_coords(vehicle=list(names))
    write_log(log, tmp_path / "log.mcap")
    assert log.difference(load_log(tmp_path / "log.mcap")) is None


_ANY = st.floats(allow_nan=False, allow_infinity=False)
_SIGMA = st.one_of(st.just(0.0), st.floats(1e-150, 1e150))
_POSITIVE = st.floats(min_value=0, exclude_min=True, allow_infinity=False)


# What the core bounds, kept within it; a least value that is refused itself becomes the next number.
_WITHIN = {
    (kind, field): (np.nextafter(least, most) if above else least, most)
    for kind, field, least, most, above in event_bounds()
}


def _some(form: st.SearchStrategy[float]) -> st.SearchStrategy[list[float]]:
    return st.lists(form, min_size=1, max_size=8)


@settings(max_examples=30, deadline=None)
@given(
    free=_some(_ANY),
    sigmas=_some(_SIGMA),
    positive=_some(_POSITIVE),
    ranges=_some(st.one_of(_POSITIVE, st.just(np.nan))),
    times=st.lists(st.integers(7, 2**60), min_size=1, max_size=3),
    payload=st.binary(max_size=9),
)
def test_extreme_numbers_come_back_bit_for_bit(
    tmp_path_factory: pytest.TempPathFactory,
    free: list[float],
    sigmas: list[float],
    positive: list[float],
    ranges: list[float],
    times: list[int],
    payload: bytes,
) -> None:
    """Every kind of event with any numbers that pass validation."""
    count, events = len(times), {}
    for kind, spec in EVENT_COLUMNS.items():
        values: dict[str, Any] = {}
        for number, (name, dtype) in enumerate(spec.items()):
            source = free
            if name.startswith("sigma_"):
                source = sigmas
            elif name in ("cov_ff", "cov_ll", "cov_yy", "cov_ee_m2", "cov_nn_m2", "water_depth_m"):
                source = positive
            elif name.startswith("cov_"):
                source = [0.0, -0.0]
            elif name == "range_m":
                source = ranges
            # Each column starts elsewhere, so that neighbours differ.
            values[name] = np.resize(np.roll(source, number), count)
            if (kind, name) in _WITHIN:
                values[name] = np.clip(values[name], *_WITHIN[kind, name])
            if dtype == "bool":
                values[name] = values[name] > 0
        if kind == "acoustic_fix":
            values |= {"peer": np.ones(count, dtype=int), "transmit_ns": np.full(count, 7)}
        if "measured_ns" in spec:
            values["measured_ns"] = np.asarray(times)
        events[kind] = event_columns(kind, t_ns=times, vehicle=np.zeros(count, dtype=int), **values)
    link = Link("m", 1, 1, positive[0], positive[-1], positive[0])
    log = MissionLog("x", 0, ("A", "B"), 2**60, link, events=events)
    log.receptions = columns(
        RECEPTION_COLUMNS, t_ns=[2**60], receiver=[0], sender=[1], tol_ns=[2**59 + 1], toa_ns=[2**59 + 2]
    )
    log.payloads = [payload]
    path = tmp_path_factory.mktemp("extreme") / "log.mcap"
    write_log(log, path)
    assert log.difference(load_log(path)) is None


def test_a_sigma_comes_back_from_its_variance() -> None:
    """sqrt(s * s) is s in binary floating point, whatever s is, while the square stays in range."""
    rng = np.random.default_rng(5)
    sigma = np.concatenate([10 ** rng.uniform(-150, 150, 400_000), rng.uniform(0.5, 2.0, 400_000)])
    assert np.array_equal(np.sqrt(sigma * sigma), sigma)


@pytest.mark.parametrize("sigma", [1e-170, -0.0])
def test_a_sigma_that_would_not_come_back_is_refused(sigma: float, tmp_path: Path) -> None:
    log = sample_log(seconds=5)
    log.events["depth"]["sigma_m"][4] = sigma
    with pytest.raises(LogError, match=re.escape(f"depth: sigma_m {sigma} of vehicle 'V2' cannot be stored")):
        write_log(log, tmp_path / "log.mcap")
    assert not list(tmp_path.iterdir())
