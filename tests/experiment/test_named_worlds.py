"""Studies over worlds: the packaged faults and one's own, each navigator beside the one that sails alone."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

import uwcoop
from uwcoop import scenario
from uwcoop.cli import app
from uwcoop.errors import ScenarioError, StudyError
from uwcoop.experiment.named_worlds import World, packaged_worlds, worlds_of
from uwcoop.experiment.study_variants import variants_of

SHORT = ("duration_s=60", "navigator.all.particles=100")
PACKAGED = [name for name, _ in scenario.packaged()]


@pytest.mark.parametrize("listed", packaged_worlds())
@pytest.mark.parametrize("name", ["flat-bay", "st-john-drift", "poor-bay", "surveyed-bay", "rough-water"])
def test_every_packaged_world_can_be_put_on_a_scenario(listed: str, name: str) -> None:
    base = scenario.load(name)
    worlds = worlds_of(listed)
    assert len(worlds) >= 15
    for variant, world in zip(variants_of(name, (), {}, worlds), worlds, strict=True):
        assert variant.settings == {"world": world.name}
        assert world.name == "believed" or world.settings(base)
        if not world.settings(base):
            assert variant.scenario == base


def test_a_world_scales_and_tells_what_was_before() -> None:
    world = World(
        name="noisy", title="noisy", scale={"sensors.water_depth.sigma_m": 3.0},
        told_as_before={"sigma_depth_m": "sensors.water_depth.sigma_m"}, told={"sigma_range_m": 2.0},
    )  # fmt: skip
    assert world.settings(scenario.load("flat-bay")) == {
        "sensors.water_depth.sigma_m": pytest.approx(0.15),
        "navigator.all.sigma_depth_m": 0.05,
        "navigator.all.sigma_range_m": 2.0,
    }
    with pytest.raises(
        ScenarioError, match=r"world 'x' needs a number at tide\.height, the scenario has None"
    ):
        World(name="x", title="x", scale={"tide.height": 2.0}).settings(scenario.load("flat-bay"))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[[worlds]]\nname='a'\ntitle='a'\n[[worlds]]\nname='a'\ntitle='b'", "two worlds are named 'a'"),
        ("[[worlds]]\nname='a'\ntitle='a'\nsett={}", "did you mean 'set'"),
        ("[[worlds]]\nname='a b'\ntitle='a'", "name"),
        ("worlds = []", "worlds"),
        ("worlds = [", "cannot be read"),
        ("", "worlds"),
    ],
)
def test_a_list_that_is_wrong_is_refused_in_one_line(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "own.toml"
    path.write_text(text)
    with pytest.raises(ScenarioError, match=says) as refused:
        worlds_of(path)
    assert "\n" not in str(refused.value)
    with pytest.raises(ScenarioError, match="did you mean 'faults'"):
        worlds_of("fault")


def test_worlds_are_flown_on_the_same_seeds_kept_and_resumed(tmp_path: Path) -> None:
    worlds = [
        World(name="as-is", title="as is"),
        World(name="deaf", title="deaf", set={"acoustics.loss.probability": 1}),
    ]

    def flown(runs: int, listed: list[World], *, resume: bool = False) -> uwcoop.experiment.study.StudyResult:
        return uwcoop.study(
            "flat-bay", runs, ["mpf", "mpf-terrain-only"], out=tmp_path / "out", overrides=SHORT, processes=1,
            worlds=listed, resume=resume,
        )  # fmt: skip

    first = flown(1, worlds)
    assert [variant["set"] for variant in first.summary["variants"]] == [
        {"world": "as-is"},
        {"world": "deaf"},
    ]
    rows = {(row["world"], row["navigator"], row["vehicle"]): row["rmse_m"] for row in first.rows}
    for vehicle in ("V1", "V2", "V3"):  # without packets a vehicle is alone; alone nothing changes
        assert rows["as-is", "mpf-terrain-only", vehicle] == rows["deaf", "mpf-terrain-only", vehicle]
        assert rows["deaf", "mpf", vehicle] == rows["deaf", "mpf-terrain-only", vehicle]
    again = flown(
        2, [*worlds, World(name="more", title="more", set={"sensors.water_depth.sigma_m": 0.2})], resume=True
    )
    assert len(again.rows) == 2 * 3 * 2 * 3
    assert [row for row in again.rows if row["run"] == 0 and row["world"] != "more"] == first.rows
    with pytest.raises(StudyError, match="have changed for world=deaf"):
        flown(
            2,
            [worlds[0], World(name="deaf", title="deaf", set={"acoustics.loss.probability": 0.5})],
            resume=True,
        )


def test_the_command_prints_one_table_with_who_sails_alone(tmp_path: Path) -> None:
    own = tmp_path / "own.toml"
    own.write_text(
        "[[worlds]]\nname='believed'\ntitle='as believed'\n"
        "[[worlds]]\nname='deaf'\ntitle='nobody is heard'\nset={'acoustics.loss.probability'=1.0}\n"
    )
    command = ["study", "flat-bay", "--runs", "1", "--worlds", str(own), "--processes", "1", "--json"]
    command += ["--navigator", "mpf,mpf-terrain-only"]
    said = CliRunner().invoke(app, [*command, *(part for text in SHORT for part in ("--set", text))])
    assert said.exit_code == 0, said.output
    assert [v["set"]["world"] for v in json.loads(said.stdout)["variants"]] == ["believed", "deaf"]
    rows = [line for line in said.stderr.splitlines() if "·" in line]
    assert any(line.lstrip().startswith("nobody is heard") for line in rows)
    assert "a vehicle that sails alone" in " ".join(said.stderr.split())
