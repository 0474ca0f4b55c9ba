"""Methods as the papers have them: equation (6), reconstruction when due, slant ranges, information of updates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import uwcoop
from uwcoop.errors import NavigatorError
from uwcoop.navigators import options_of
from uwcoop.scenario.setup import MissionSetup

TRIALS = 2


def largest_difference(name: str) -> dict[str, float]:
    tracks = uwcoop.run(name, ["mdeif-paper", "deif"], seed=3, clouds=False).tracks
    time = tracks["time"].values
    heard = tracks["heard"].values.all(axis=0)[1]
    off = np.hypot(*np.moveaxis(np.diff(tracks["position_m"].values[:, 1], axis=0)[0], -1, 0))
    windows = {"before": (0, 3400), "hold": (3400, 3700), "after": (4000, np.inf)}
    return {when: off[heard & (time >= a) & (time < b)].max(initial=0.0) for when, (a, b) in windows.items()}


def test_equation_6_before_in_and_after_a_hold() -> None:
    found = largest_difference("ship-and-auv-blackout")
    assert found["before"] < 1e-10, found
    assert 1e-5 < found["hold"] < 9e-3, found  # "several millimetres"
    assert found["after"] < found["hold"], found


def test_equation_6_breaks_in_a_long_hold() -> None:
    assert max(largest_difference("ship-and-auv-long-blackout").values()) > 0.05


def check_reconstructions(seed: int) -> int:
    """Every due reconstruction comes with the first complete low positioning; how many there were."""
    overrides = ["mutual.channel_dropout_share=0.3", "navigator.landmark-paper.particles=600"]
    result = uwcoop.run(
        "seafloor-survey-kidnap", ["landmark-paper"], seed=seed, overrides=overrides, clouds=False
    )
    fixes = result.log.events["acoustic_fix"]
    time = result.tracks["time"].values
    made = 0
    for vehicle in range(2):
        own = fixes["vehicle"] == vehicle
        complete = np.isfinite(
            [fixes[c][own] for c in ("range_m", "own_bearing_rad", "peer_bearing_rad")]
        ).all(axis=0)
        lows, counted = (
            np.nan_to_num(result.tracks[name].values[0, vehicle]) for name in ("lows", "reconstructions")
        )
        mean = result.tracks["likelihood_log_max"].values[0, vehicle]
        roles = result.log.events["role_taken"]
        changes = roles["t_ns"][~roles["landmark"] | (roles["vehicle"] != vehicle)] / 1e9
        row, since, last_s = 0, 10**6, -1.0
        for t_s, whole in zip(fixes["t_ns"][own] / 1e9, complete, strict=True):
            at = np.searchsorted(time, t_s)
            if at == 0 or at >= len(time) or not np.isfinite(mean[at]):
                continue
            if ((changes > last_s) & (changes <= t_s)).any():
                row, since = 0, 10**6
            last_s = t_s
            low, fired = lows[at] > lows[at - 1], counted[at] > counted[at - 1]
            row, since = row + 1 if low else 0, since + 1
            if row > TRIALS and since > TRIALS and whole:
                assert fired, (seed, vehicle, t_s)
            if fired:
                row, since, made = 0, 0, made + 1
    return made


def test_a_due_reconstruction_waits_for_a_complete_positioning() -> None:
    assert sum(check_reconstructions(seed) for seed in range(6)) >= 3


@pytest.mark.long
def test_a_due_reconstruction_waits_over_many_seeds() -> None:
    assert sum(check_reconstructions(seed) for seed in range(50)) >= 25


def test_mixture_gate_reconstructs() -> None:
    overrides = ["navigator.landmark-paper.gate=mixture", "navigator.landmark-paper.particles=600"]
    tracks = uwcoop.run(
        "seafloor-survey-kidnap", ["landmark-paper"], seed=0, overrides=overrides, clouds=False
    ).tracks
    assert np.nansum(tracks["reconstructions"].values[0, :, -1]) >= 1


@pytest.mark.parametrize("navigator", ["landmark", "landmark-paper"])
def test_slant_ranges_are_reduced_by_the_depths(navigator: str) -> None:
    log = uwcoop.simulate("seafloor-survey", seed=0)
    fixes, depths = log.events["acoustic_fix"], log.events["depth"]
    assert np.isfinite(fixes["peer_depth_m"]).all()
    # The landmark 5 m below: ranges become slant, what the reply tells says so.
    slant = {**fixes, "range_m": np.hypot(fixes["range_m"], 5.0)}
    slant["peer_depth_m"] = np.array([
        depths["depth_m"][(depths["vehicle"] == v) & (depths["t_ns"] <= t)][-1] + 5.0
        for v, t in zip(fixes["vehicle"], fixes["t_ns"], strict=True)
    ])  # fmt: skip
    untold = {**slant, "peer_depth_m": np.full(len(fixes["t_ns"]), np.nan)}

    def rmse(table: dict[str, np.ndarray]) -> float:
        changed = replace(log, events={**log.events, "acoustic_fix": table})
        error = uwcoop.run(changed, [navigator], seed=0, clouds=False).tracks
        off = error["position_m"].values[0] - error["truth_position_m"].values
        return float(np.sqrt(np.nanmean((off[:, 100:] ** 2).sum(axis=-1))))

    level, told, silent = rmse(fixes), rmse(slant), rmse(untold)
    assert told == pytest.approx(level, abs=0.05), (level, told)  # particles go other ways
    assert silent > told + 0.05, (told, silent)


def test_roughening_follows_the_cell() -> None:
    def positions(*overrides: str) -> np.ndarray:
        short = ["duration_s=60", *overrides]  # on a chart of 2 m
        run = uwcoop.run("surveyed-bay", ["dmpf"], seed=0, overrides=short, clouds=False)
        assert run.log.chart is not None
        assert run.log.chart.cell_m == 2.0
        return run.tracks["position_m"].values

    assert np.array_equal(positions(), positions("navigator.dmpf.roughening_m2=4.0"))
    assert not np.array_equal(positions(), positions("navigator.dmpf.roughening_m2=2.0"))


def test_variants_have_options_of_their_own() -> None:
    overrides = ["duration_s=30", "navigator.dmpf.window=10", "navigator.dmpf@2000.particles=2000"]
    result = uwcoop.study("st-john", 1, ["dmpf", "dmpf@2000"], overrides=overrides)
    assert {row["navigator"] for row in result.rows} == {"dmpf", "dmpf@2000"}
    setup = MissionSetup.of(uwcoop.scenario.load("st-john", overrides))
    chosen = options_of("dmpf@2000", setup).model_dump()
    assert (chosen["particles"], chosen["window"]) == (2000, 10)
    assert options_of("dmpf", setup).model_dump()["particles"] == 600
    with pytest.raises(NavigatorError, match="navigator 'dmfp@2000' is unknown; did you mean 'dmpf'"):
        options_of("dmfp@2000")


def test_information_of_updates() -> None:
    names = ["dmpf", "terrain-only", "mpf", "team", "ranging-only"]
    overrides = ["duration_s=40"]
    off = uwcoop.run("st-john", names, seed=0, overrides=overrides, clouds=False).tracks
    on = uwcoop.run(
        "st-john", names, seed=0, overrides=[*overrides, "diagnostics.entropy=at_updates"], clouds=False
    ).tracks
    assert "updates_information_nat" not in off
    assert np.array_equal(off["position_m"].values, on["position_m"].values, equal_nan=True)
    total = on["updates_information_nat"].values
    assert (total[:, :, -1] > 0).all(), total[:, :, -1]
    # Without soundings only ranges tell anything, each when its packet has been decoded.
    ranging = names.index("ranging-only")
    told = (np.diff(total[ranging], axis=-1) != 0).sum(axis=-1)
    heard = on["heard"].values[ranging].sum(axis=-1)
    assert ((told <= heard) & (told >= heard - 1)).all(), (told, heard)


def test_information_of_a_range_is_that_of_its_update() -> None:
    short = ["duration_s=40"]
    runs = [
        uwcoop.run(
            "st-john",
            ["ranging-only"],
            seed=0,
            overrides=[*short, f"diagnostics.entropy={how}"],
            clouds=False,
        )
        for how in ("at_reception", "at_updates")
    ]
    heard = np.nan_to_num(runs[0].tracks["mutual_information"].values[0])
    total = runs[1].tracks["updates_information_nat"].values[0, :, -1]
    decoded = [
        heard[:, : heard.shape[1] - late].sum(axis=-1) for late in (0, 1, 2, 3)
    ]  # the last may be on the air
    assert (heard > 0).sum() > 5
    assert all(min(abs(total[v] - some[v]) for some in decoded) < 1e-9 for v in range(len(total))), (
        total,
        decoded,
    )
