"""`team` as a user runs it: nobody heard, nobody harmed; mixed teams; packets of one frame; what is refused."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
import pytest

import uwcoop
from uwcoop import scenario
from uwcoop.errors import NavigatorError
from uwcoop.evaluation import metrics
from uwcoop.missionlog import MissionLog
from uwcoop.navigators import Context, build, options_of
from uwcoop.scenario import MissionSetup

ALONE = "mpf-terrain-only"
KNOWN = ("sigma_current0_mps", "sigma_heading_bias0_rad", "sigma_thrust_bias0_mps")
"""What the scenario tells dead reckoning of its world: no biases, and a current that starts at zero."""


def logged(name: str, *overrides: str, seed: int = 2) -> MissionLog:
    return uwcoop.simulate(scenario.load(name, overrides), seed=seed)


def rmse(result: uwcoop.RunResult) -> Any:
    """RMSE by (navigator, vehicle) after the first 50 s, metres."""
    return np.sqrt((metrics.errors(result.tracks).where(result.tracks.time > 50) ** 2).mean("time")).values


@pytest.mark.parametrize("name", ["flat-bay", pytest.param("surveyed-bay", marks=pytest.mark.long)])
def test_when_every_packet_is_lost_team_is_mpf_without_ranges_bit_for_bit(name: str) -> None:
    lost = ('acoustics.loss.model="independent"', "acoustics.loss.probability=1.0")
    log = logged(name, "duration_s=150", "navigator.all.particles=200", *lost)
    tracks = uwcoop.run(log, ["team", ALONE], clouds=False).tracks
    for variable in ("position_m", "covariance_m2", "ess", "off_chart", "rejected"):
        team, alone = tracks[variable].values
        assert team.tobytes() == alone.tobytes(), variable
    sent = tracks.packet_bytes.sel(navigator="team").values
    assert (sent > 0).sum() == 50


def test_packets_fit_one_frame_with_their_tag() -> None:
    for vehicles, modem in ((2, "micromodem-64"), (3, "micromodem-64"), (9, "micromodem-64")):
        log = logged(
            "st-john-drift", f"vehicles.count={vehicles}", "duration_s=100", "navigator.team.particles=50",
            f'acoustics.modem="{modem}"',
        )  # fmt: skip
        sent = uwcoop.run(log, ["team"], clouds=False).tracks.packet_bytes.values
        assert 0 < sent.max() <= 32 - 4 + 2, "28 bytes and the checksum that a tag of 4 replaces"


def test_heard_teammates_help_and_quantised_packets_are_as_good_as_f64() -> None:
    few = ("duration_s=300", "navigator.all.particles=300", 'acoustics.modem="unlimited"')
    log = logged("flat-bay", *few)
    rounded = rmse(uwcoop.run(log, ["team", ALONE], clouds=False))
    log = logged("flat-bay", *few, 'navigator.team.packet="f64"')
    whole = rmse(uwcoop.run(log, ["team"], clouds=False))
    assert np.median(rounded[0]) < np.median(rounded[1])
    assert np.median(rounded[0]) < 1.3 * np.median(whole[0])


def test_who_has_only_a_modem_is_led_by_those_who_know_more() -> None:
    log = logged("mixed-team", "duration_s=400", "navigator.team.particles=400")
    result = uwcoop.run(log, ["team", ALONE, "dead-reckoning"], clouds=False)
    team, alone, reckoned = rmse(result)
    names = list(log.vehicles)
    modem, surface = names.index("modem"), names.index("surface")
    assert team[modem] < 0.5 * min(alone[modem], reckoned[modem])
    assert team[surface] < 3.0
    final = metrics.nees(result.tracks).sel(navigator="team").isel(time=-1).values
    assert np.all(final < 16), "nobody is certain of a wrong place"


def without_a_chart(runs: int, *overrides: str) -> tuple[float, dict[str, Any]]:
    """Median of RMSE over dead reckoning's, and the pooled figures of `team`."""
    told = [f"navigator.team.{name}=0.0" for name in KNOWN]
    ratios, rows = [], []
    for seed in range(runs):
        log = replace(logged("st-john-drift", *told, *overrides, seed=seed), chart=None)
        result = uwcoop.run(log, ["team", "dead-reckoning"], clouds=False)
        team, reckoned = rmse(result)
        ratios.append(team / reckoned)
        rows += metrics.rows(result.tracks, seconds=result.seconds, packets=result.packets, run=seed)
    return float(np.median(ratios)), metrics.pool(rows)["team"]


def test_without_a_chart_ranges_do_no_harm() -> None:
    ratio, team = without_a_chart(4, "navigator.team.particles=400")
    assert ratio < 1.2
    assert team["anees"] < 4


@pytest.mark.long
def test_without_a_chart_team_is_consistent_and_not_worse_than_dead_reckoning() -> None:
    ratio, team = without_a_chart(50)
    assert ratio <= 1
    assert 1.2 <= team["anees_median"] <= 2.6
    assert team["anees"] <= 2.6


def refused(**options: Any) -> str:
    def make() -> None:
        chosen = options_of("team", MissionSetup.parse({"navigator": {"team": options}}))
        build("team", Context(0, 3, 1500.0, 1, None), chosen, None)

    with pytest.raises(NavigatorError) as error:
        make()
    return str(error.value)


def test_options_that_cannot_be_are_refused_in_one_line() -> None:
    assert "names 2 vehicles: the team has 3" in refused(team_drift=("dvl", "dvl"))
    assert "frame_bytes" in refused(frame_bytes=8)
    assert "expected" in refused(frame_bytes=20)
    assert "group_size" in refused(group_size=0)
    assert "current_difference" in refused(current_difference=2.0)
    assert "packet" in refused(packet="modes")


@lru_cache
def pooled(name: str, count: int, navigators: tuple[str, ...], overrides: tuple[str, ...] = ()) -> Any:
    rows: list[Any] = []
    for seed in range(count):
        result = uwcoop.run(logged(name, *overrides, seed=seed), navigators, clouds=False)
        rows += metrics.rows(result.tracks, seconds=result.seconds, packets=result.packets, run=seed)
    return metrics.pool(rows)


@pytest.mark.long
@pytest.mark.parametrize(("name", "low", "high", "lost"), [
    ("st-john-drift", 1.6, 2.5, 0.01), ("flat-bay", 1.4, 2.6, 0.03), ("poor-bay", 1.2, 2.6, 0.0),
])  # fmt: skip
def test_team_is_consistent_over_fifty_seeds(name: str, low: float, high: float, lost: float) -> None:
    found = pooled(name, 50, ("team", ALONE))
    assert low <= found["team"]["anees_median"] <= high
    assert found["team"]["lost_share"] <= lost
    assert found["team"]["median_rmse_m"] < found[ALONE]["median_rmse_m"]


@pytest.mark.long
def test_more_teammates_never_hurt() -> None:
    errors = [
        pooled("flat-bay", 50, ("team",), (f"vehicles.count={count}",))["team"]["median_rmse_m"]
        for count in (2, 3, 5)
    ]
    assert errors[1] < 1.05 * errors[0]
    assert errors[2] < 1.05 * errors[1]
