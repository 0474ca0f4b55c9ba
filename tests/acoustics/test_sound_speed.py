"""Sound speed of lakes, rivers and the sea, and of casts: by independent equations and by integration."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uwcoop import acoustics, scenario
from uwcoop.acoustics.sound import sound_speed_between_mps
from uwcoop.acoustics.sound_profile import Profile
from uwcoop.errors import ScenarioError
from uwcoop.scenario.acoustics import Acoustics
from uwcoop.world.simulate import simulate

pytest.importorskip("gsw")

PURE_MPS = [1402.388, 5.03711, -5.80852e-2, 3.342e-4, -1.478e-6, 3.146e-9]
"""Chen and Millero (1977) at atmospheric pressure, as Fofonoff and Millard (1983) give it."""


def table(**changes: Any) -> Acoustics:
    return Acoustics.model_validate(
        {"modem": "micromodem-64", "slot_s": 5.0, "max_range_m": 750.0, **changes}
    )


@pytest.mark.parametrize("t", [0.0, 4.0, 10.0, 20.0, 30.0])
def test_fresh_water_agrees_with_chen_and_millero(t: float) -> None:
    expected = sum(c * t**k for k, c in enumerate(PURE_MPS))
    assert float(acoustics.teos10_mps(t, 0.0, 0.0)) == pytest.approx(expected, abs=0.1)


def test_fresh_water_at_20_degrees_is_del_grosso_and_maders() -> None:
    assert float(acoustics.teos10_mps(20.0, 0.0, 0.0)) == pytest.approx(1482.343, abs=0.02)


@settings(deadline=None, max_examples=100)
@given(t=st.floats(2, 30), s=st.floats(25, 40), d=st.floats(0, 2000))
def test_sea_water_agrees_with_mackenzie(t: float, s: float, d: float) -> None:
    assert float(acoustics.teos10_mps(t, s, d)) == pytest.approx(
        float(acoustics.mackenzie_mps(t, s, d)), abs=0.8
    )


@pytest.mark.parametrize(
    ("t", "s", "d", "says"),
    [
        (50.0, 0.0, 0.0, "temperature 50 °C is outside TEOS-10's -2 to 40 °C"),
        (5.0, 60.0, 0.0, "salinity 60 psu is outside TEOS-10's 0 to 42 psu"),
        (5.0, 0.0, -1.0, "depth -1 m is outside TEOS-10's 0 to 8000 m"),
        (np.nan, 0.0, 0.0, "temperature nan °C is outside"),
    ],
)
def test_water_that_cannot_be_is_refused(t: float, s: float, d: float, says: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        acoustics.teos10_mps(t, s, d)
    assert says in str(caught.value)


DEPTHS = st.integers(0, 600).map(lambda half: half / 2)
PROFILES = st.dictionaries(DEPTHS, st.floats(1400, 1560), min_size=2, max_size=12).map(
    lambda d: list(d.items())
)


@settings(deadline=None, max_examples=100)
@given(rows=PROFILES, a=st.floats(-20, 350), b=st.floats(-20, 350))
def test_a_profiles_mean_is_the_harmonic_one(rows: list[tuple[float, float]], a: float, b: float) -> None:
    profile = Profile(tuple(rows))
    found = float(profile.between(np.array([a]), np.array([b]))[0])
    edges = np.linspace(a, b, 40_001)
    speeds = profile.at((edges[1:] + edges[:-1]) / 2)
    expected = 1 / np.mean(1 / speeds) if abs(a - b) > 1e-6 else float(profile.at(np.array([a]))[0])
    assert found == pytest.approx(expected, rel=2e-5)
    assert found == pytest.approx(float(profile.between(np.array([b]), np.array([a]))[0]), rel=1e-9)


def test_a_scenarios_profile_is_what_sound_takes_between_two_depths() -> None:
    profile = {"model": "profile", "table": [[0, 1480], [10, 1500], [30, 1440]]}
    plan = table(sound_speed=profile, sound_speed_error_mps=2.0)
    depths = np.array([0.0, 10.0, 5.0]), np.array([0.0, 30.0, 5.0])
    found = sound_speed_between_mps(plan, 0, *depths)
    harmonic = 20 / (20 / 60 * np.log(1500 / 1440))
    np.testing.assert_allclose(found, [1482.0, harmonic / 1.0 * 60 / 60 + 2.0, 1492.0], rtol=1e-9)


def test_a_cast_of_speeds_becomes_part_of_the_scenario(tmp_path: Path) -> None:
    (tmp_path / "cast.csv").write_text(
        "depth_m;sound_speed_mps;flag\n10,0;1490,5;x\n0,0;1480,0;x\n10,0;1491,5;x\n"
    )
    (tmp_path / "bay.toml").write_text(
        scenario.packaged_text("flat-bay")
        + '\n[acoustics.sound_speed]\nmodel = "profile"\nfile = "cast.csv"\n'
    )
    made = scenario.load(tmp_path / "bay.toml")
    assert made.resolved()["acoustics"]["sound_speed"]["table"] == [[0.0, 1480.0], [10.0, 1491.0]]
    (tmp_path / "cast.csv").unlink()
    assert scenario.parse(made.resolved()).acoustics.sound_speed == made.acoustics.sound_speed


def test_a_cast_of_temperatures_is_converted(tmp_path: Path) -> None:
    (tmp_path / "ctd.csv").write_text("z,T,S\n0,18,0.2\n20,6,0.2\n")
    columns = "{depth='z', temperature='T', salinity='S'}"
    override = f"acoustics.sound_speed={{model='profile', file='{tmp_path / 'ctd.csv'}', columns={columns}}}"
    water = scenario.load("flat-bay", [override]).acoustics.sound_speed
    assert water is not None
    np.testing.assert_allclose([row[1] for row in water.table], acoustics.teos10_mps([18, 6], 0.2, [0, 20]))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("depth_m,speed\n0,1480\n5,1490\n", "has no column 'sound_speed_mps'"),
        ("depth_m,sound_speed_mps\n0,1480\n5,\n", "sound_speed_mps is empty in line 3: must be a number"),
        (
            "depth_m,sound_speed_mps\n0,1480\n5,4800\n",
            "table has a sound speed of 4800 m/s: must be within 1300 to 1700",
        ),
        ("depth_m,sound_speed_mps\n0,1480\n-5,1480\n", "table needs depths at least 0"),
    ],
)
def test_casts_that_cannot_be_used_are_refused(tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "cast.csv").write_text(text)
    with pytest.raises(ScenarioError) as caught:
        scenario.load(
            "flat-bay", [f"acoustics.sound_speed={{model='profile', file='{tmp_path / 'cast.csv'}'}}"]
        )
    assert says in str(caught.value)


def test_ranges_in_a_lake_are_wrong_by_the_lakes_speed() -> None:
    lake = "acoustics.sound_speed={model='teos-10', temperature_c=8.0}"
    base = ["duration_s=60", "acoustics.range_sigma_m=0"]
    plain, fresh = (simulate(scenario.load("flat-bay", [*base, *more]), 2) for more in ([], [lake]))
    travel = [log.opportunities["toa_ns"] - log.opportunities["tol_ns"] for log in (plain, fresh)]
    speed = float(acoustics.teos10_mps(8.0, 0.0, 2.0))
    np.testing.assert_allclose(travel[1] / travel[0], 1500.0 / speed, rtol=2e-3)


def test_vehicles_below_the_profile_are_noted() -> None:
    profile = "acoustics.sound_speed={model='profile', table=[[0, 1480], [1, 1481]]}"
    log = simulate(scenario.load("flat-bay", ["duration_s=60", profile]), 2)
    assert any("the profile covers 0 to 1 m, vehicles are at 2 to 2 m" in note for note in log.notes)
