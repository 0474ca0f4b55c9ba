"""Sweeps: what `--vary` says, samples that fill their ranges, and variants of a navigator by name."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

import uwcoop
from uwcoop.errors import NavigatorError, ScenarioError, StudyError
from uwcoop.experiment.sweeps import Range, latin_hypercube, sweep_of
from uwcoop.navigators import options_of
from uwcoop.scenario.setup import MissionSetup

SHORT = ("duration_s=60", "navigator.all.particles=100")
LOSS = "acoustics.loss.probability"


@given(st.integers(2, 40), st.floats(-1e3, 1e3), st.floats(0.1, 1e3))
def test_each_part_of_each_range_is_hit_once(count: int, low: float, width: float) -> None:
    ranges = {"a": Range(low, low + width), "b": Range(0.01, 100.0, "loguniform")}
    samples = latin_hypercube(ranges, count)
    assert samples == latin_hypercube(ranges, count)
    assert all(low <= s["a"] <= low + width and 0.01 <= s["b"] <= 100 for s in samples)
    parts = sorted(min(int((math.log10(s["b"]) + 2) / 4 * count), count - 1) for s in samples)
    # Six digits are kept: a value at the edge of its part may be rounded across.
    assert all(abs(part - k) <= 1 for k, part in enumerate(parts))
    assert len(set(parts)) >= count - 1


def test_what_is_varied_is_read() -> None:
    sweep = sweep_of(
        ["a.b=1,2", "c=linspace(0, 1, 3)", "d = uniform(0,2) | lhs(4)", "e=integers(5,9)|lhs(4)"]
    )
    assert sweep.grid == {"a.b": [1, 2], "c": [0.0, 0.5, 1.0]}
    assert [set(sample) for sample in sweep.samples] == [{"d", "e"}] * 4
    assert all(isinstance(sample["e"], int) and 5 <= sample["e"] <= 9 for sample in sweep.samples)
    assert sweep_of([]).samples == []
    assert sweep_of(["navigator.all.drift=dvl,no-dvl"]).grid == {"navigator.all.drift": ["dvl", "no-dvl"]}


@pytest.mark.parametrize(
    ("texts", "says"),
    [
        (["a=uniform(0,1)"], "must say how many"),
        (["a=uniform(1,0)|lhs(3)"], "from a lower to a higher"),
        (["a=uniform(0,1,2)|lhs(3)"], "needs 2 numbers"),
        (["a=uniform(0,x)|lhs(3)"], "needs 2 numbers"),
        (["a=uniform(0,inf)|lhs(3)"], "needs 2 numbers"),
        (["a=loguniform(0,1)|lhs(3)"], "above 0"),
        (["a=integers(0.5,3)|lhs(3)"], "whole numbers"),
        (["a=integers(1,2)|lhs(9)"], "two samples are the same"),
        (["a=uniform(0,1)|lhs(1)"], "2 to 100000"),
        (["a=linspace(0,1,2.5)"], "takes 2 to"),
        (["a=linspace(0,1,3)|lhs(3)"], "no lhs"),
        (["a=1,2", "a=uniform(0,1)|lhs(3)"], "varied twice"),
        (["a=uniform(0,1)|lhs(3)", "b=uniform(0,1)|lhs(4)"], "as many samples each: a 3, b 4"),
    ],
)
def test_what_makes_no_sense_is_refused(texts: list[str], says: str) -> None:
    with pytest.raises(ScenarioError, match=says):
        sweep_of(texts)


def test_samples_are_flown_with_every_value() -> None:
    samples = latin_hypercube({LOSS: Range(0, 0.9), "tide.offset_m": Range(-1, 1)}, 3)
    vary = {"navigator.mpf.range_temper": [0.5, 1.0]}
    result = uwcoop.study("flat-bay", 1, ["mpf"], vary, samples=samples, overrides=SHORT, processes=1)
    assert [v["set"] for v in result.summary["variants"]] == [
        {"navigator.mpf.range_temper": temper, **sample} for temper in (0.5, 1.0) for sample in samples
    ]
    keys = {entry["key"] for entry in result.summary["sensitivity"]}
    assert keys == {"navigator.mpf.range_temper", LOSS, "tide.offset_m"}
    with pytest.raises(StudyError, match=f"{LOSS} is varied twice"):
        uwcoop.study("flat-bay", 1, ["mpf"], {LOSS: [0.1]}, samples=samples, overrides=SHORT)
    with pytest.raises(StudyError, match="samples are of different keys"):
        uwcoop.study("flat-bay", 1, ["mpf"], samples=[{LOSS: 0.1}, {}], overrides=SHORT)


def test_a_variant_by_the_name_of_a_drift_preset() -> None:
    setup = MissionSetup()
    for preset in ("dvl", "no-dvl"):
        chosen = options_of(f"mpf@{preset}", setup).model_dump()
        assert chosen["drift"] == preset
        assert {**chosen, "drift": None} == {**options_of("mpf", setup).model_dump(), "drift": None}
    with pytest.raises(NavigatorError, match=r"'mpf@fast' has no options of its own: .* or take mpf@.*dvl"):
        options_of("mpf@fast", setup)
    same, stated = (
        uwcoop.study("flat-bay", 1, [name], overrides=[*SHORT, *more], processes=1).rows
        for name, more in (("mpf@no-dvl", ()), ("mpf", ("navigator.mpf.drift=no-dvl",)))
    )
    assert [row["rmse_m"] for row in same] == [row["rmse_m"] for row in stated]
