"""Options of packaged navigators: models and core agree, and what is not read is refused."""

from __future__ import annotations

from typing import Any, get_args

import pytest

from uwcoop import _native
from uwcoop.errors import NavigatorError
from uwcoop.navigators import NAVIGATORS, options_of, read_options
from uwcoop.navigators.base import METHODS
from uwcoop.navigators.registry import MODELS
from uwcoop.scenario.setup import MissionSetup, NavigatorTables


def setup(**tables: dict[str, Any]) -> MissionSetup:
    common = tables.pop("common", {})
    return MissionSetup(navigator=NavigatorTables(common=common, own=tables))


def test_every_method_of_the_core_has_a_model_with_its_options_and_defaults() -> None:
    assert set(MODELS) == set(METHODS)
    assert len(METHODS) >= 12
    for method, model in MODELS.items():
        assert model().model_dump(mode="json") == METHODS[method]["defaults"], method


def test_every_bound_of_the_core_is_the_models() -> None:
    seen = 0
    for method, model in MODELS.items():
        schema = model.model_json_schema()["properties"]
        words = {"gt": "exclusiveMinimum", "ge": "minimum", "lt": "exclusiveMaximum", "le": "maximum"}
        for option, bound in METHODS[method]["bounds"].items():
            said = schema[option].get("anyOf", [schema[option]])[0]
            for limit, value in bound.items():
                assert said[words[limit]] == value, f"{method}.{option}"
                seen += 1
    assert seen > 150


def test_words_of_the_models_are_those_of_the_core() -> None:
    """The core refuses an unknown word with the list of those that it knows."""
    seen = 0
    for name, spec in NAVIGATORS.items():
        for option, field in spec.options.model_fields.items():
            choices = get_args(field.annotation)
            if not choices or not all(isinstance(word, str) for word in choices) or option in spec.fixed:
                continue
            with pytest.raises(NavigatorError) as refused:
                _native.unread_options(name, f'{{"{option}": "?"}}')
            assert all(f"`{word}`" in str(refused.value) for word in choices), f"{name}.{option}"
            assert str(refused.value).count("`") == 2 * len(choices) + 2, f"{name}.{option}"
            seen += 1
    assert seen > 20


@pytest.mark.parametrize(
    ("name", "stated", "reason"),
    [
        ("team", {"range_temper": 0.5}, "tempers no range"),
        ("team", {"range_novelty": True}, "each is new"),
        ("team", {"range_method": "gaussian"}, "one range likelihood"),
        ("team", {"entropy_sigma_m": 1.0}, "whole packets"),
        ("team", {"team_drift": ("dvl",) * 3, "drift": "dvl"}, "team_drift states it"),
        ("dmpf", {"sigma_range_m": 2.0}, "(17) has no sigma"),
        ("dmpf", {"range_temper": 0.5}, "(17) has no exponent"),
        ("dmpf", {"range_method": "gaussian", "range_samples": 7}, "range_method is gaussian"),
        ("dmpf", {"modes": 3}, 'packet is not "modes"'),
        ("dmpf", {"sigma_heading_bias0_rad": 0.1}, "no bias states"),
        ("terrain-only", {"sigma_range_m": 2.0}, "use_ranges is false"),
        ("ranging-only", {"window": 3}, "use_terrain is false"),
        ("mpf", {"monitor": False, "monitor_alarm": 3.0}, "monitor is false"),
        ("mpf", {"range_method": "gaussian"}, "one range likelihood"),
        ("local-only", {"packet_form": "32"}, "use_ranges is false"),
        ("mdeif", {"use_equation_6": False, "health_loss_max": 0.1}, "use_equation_6 is false"),
        ("landmark-ekf", {"jump_odds": 3.0}, "recovery is false"),
        ("landmark", {"consensus_window": 3}, 'recovery_by is "odds"'),
        ("landmark-paper", {"outlier_share": 0.1}, 'gate is not "mixture"'),
    ],
)
def test_what_a_navigator_does_not_read_is_refused_with_the_reason(
    name: str, stated: dict[str, Any], reason: str
) -> None:
    with pytest.raises(NavigatorError) as refused:
        options_of(name, setup(**{name: stated}))
    said = str(refused.value)
    assert said.startswith(f"navigator.{name}.{list(stated)[-1]}: ")
    assert reason in said


def test_all_sets_what_a_navigator_reads_and_skips_the_rest() -> None:
    common = {"sigma_range_m": 2.0, "range_temper": 0.5, "window": 9, "gate_sigmas": 4.0}
    read = {name: read_options(name, options_of(name, setup(common=dict(common)))) for name in NAVIGATORS}
    assert read["mpf"]["sigma_range_m"] == 2.0
    assert read["mpf"]["range_temper"] == 0.5
    assert "range_temper" not in read["team"]
    assert read["team"]["sigma_range_m"] == 2.0
    assert "sigma_range_m" not in read["dmpf"]
    assert (read["dmpf"]["window"], read["terrain-only"]["window"]) == (9, 9)
    assert "window" not in read["ranging-only"]
    assert read["cekf"]["gate_sigmas"] == 4.0


def test_what_is_read_is_taken_again_and_changes_nothing() -> None:
    for name in NAVIGATORS:
        read = read_options(name, options_of(name))
        again = options_of(name, setup(**{name: read}))
        assert read_options(name, again) == read, name


def test_models_refuse_what_json_cannot_say() -> None:
    with pytest.raises(NavigatorError, match="finite"):
        options_of("mpf", setup(mpf={"monitor_alarm": float("inf")}))
