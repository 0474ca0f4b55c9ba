"""Studies: paired, the same for any number of processes, resumable, and refused when they are another's."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import pytest

import uwcoop
from uwcoop.errors import MissingDependencyError, ScenarioError, ScheduleError, StudyError
from uwcoop.evaluation import metrics
from uwcoop.experiment import study_flights
from uwcoop.experiment.study import StudyResult
from uwcoop.scenario import alternatives, load

SHORT = ("duration_s=60", "navigator.all.particles=100")
TWO = ("dead-reckoning", "mpf")
LOSS = "acoustics.loss.probability"


def small(runs: int = 2, vary: Any = None, **options: Any) -> StudyResult:
    given = {"overrides": SHORT, "processes": 1, **options}
    return uwcoop.study("flat-bay", runs, given.pop("navigators", TWO), vary, **given)


def timeless(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [{key: value for key, value in row.items() if key != "seconds"} for row in rows]


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> tuple[StudyResult, Path]:
    folder = tmp_path_factory.mktemp("study") / "out"
    return small(3, {LOSS: [0.0, 0.5]}, out=folder), folder


def copied(folder: Path, to: Path) -> Path:
    to.mkdir()
    for file in folder.iterdir():
        (to / file.name).write_bytes(file.read_bytes())
    return to


def test_one_row_for_each_variant_run_navigator_and_vehicle(done: tuple[StudyResult, Path]) -> None:
    result, folder = done
    assert [tuple(row[k] for k in (LOSS, "run", "seed", "navigator", "vehicle")) for row in result.rows] == [
        (loss, k, k, navigator, vehicle)
        for loss in (0.0, 0.5)
        for k in range(3)
        for navigator in TWO
        for vehicle in ("V1", "V2", "V3")
    ]
    with (folder / "runs.csv").open(encoding="utf-8", newline="") as file:
        header, *lines = csv.reader(file)
    assert header == [LOSS, *metrics.row_columns()]
    assert len(lines) == len(result.rows)
    at = header.index("rmse_m")
    assert [float(line[at]) for line in lines] == [row["rmse_m"] for row in result.rows]


def test_the_summary_pools_the_rows_of_each_variant(done: tuple[StudyResult, Path]) -> None:
    result, folder = done
    assert result.summary == json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    assert (result.summary["scenario"], result.summary["runs"]) == ("flat-bay", 3)
    assert (result.vehicles, result.settle_s) == (3, 50.0)
    for variant in result.summary["variants"]:
        own = [row for row in result.rows if row[LOSS] == variant["set"][LOSS]]
        assert variant["navigators"] == metrics.pool(own)


def test_variants_and_navigators_fly_the_same_missions(done: tuple[StudyResult, Path]) -> None:
    result, _ = done
    dead = [row["rmse_m"] for row in result.rows if row["navigator"] == "dead-reckoning"]
    assert dead[: len(dead) // 2] == dead[len(dead) // 2 :]
    alone = small(1, navigators=["mpf"], first_seed=2, overrides=[*SHORT, f"{LOSS}=0.5"])
    paired = [row for row in result.rows if (row[LOSS], row["seed"], row["navigator"]) == (0.5, 2, "mpf")]
    assert [row["rmse_m"] for row in alone.rows] == [row["rmse_m"] for row in paired]
    assert [(row["run"], row["seed"]) for row in alone.rows] == [(0, 2)] * 3


def test_any_number_of_processes_gives_the_same(done: tuple[StudyResult, Path], tmp_path: Path) -> None:
    one, folder = done
    seen: list[tuple[int, int]] = []
    two = small(
        3, {LOSS: [0.0, 0.5]}, out=tmp_path / "two", processes=2, progress=lambda *now: seen.append(now)
    )
    assert timeless(two.rows) == timeless(one.rows)
    assert seen[0] == (0, 6)
    assert seen[-1] == (6, 6)
    texts = [path.read_text().splitlines() for path in (folder / "runs.csv", tmp_path / "two" / "runs.csv")]
    cut = [[line.rsplit(",", 1)[0] for line in text] for text in texts]  # seconds come last
    assert cut[0] == cut[1]


def test_resume_flies_only_what_is_missing(
    done: tuple[StudyResult, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    result, folder = done
    again = copied(folder, tmp_path / "again")
    lines = (again / "runs.csv").read_text(encoding="utf-8").splitlines(keepends=True)
    # The last mission was being written when the machine went down: one whole row, and half of another.
    (again / "runs.csv").write_text("".join(lines[:-5]) + lines[-5][:20], encoding="utf-8")
    flown: list[int] = []
    fly = study_flights.fly

    def counted(plan: Any, unit: Any) -> Any:
        flown.extend([unit.seed] * len(unit.variants))
        return fly(plan, unit)

    monkeypatch.setattr(study_flights, "fly", counted)
    resumed = small(3, {LOSS: [0.0, 0.5]}, out=again, resume=True)
    assert flown == [2]
    assert timeless(resumed.rows) == timeless(result.rows)
    flown.clear()
    more = small(4, {LOSS: [0.5, 0.9]}, out=again, resume=True)  # a run and a value more
    assert sorted(flown) == [0, 1, 2, 3, 3]
    assert len(more.rows) == 2 * 4 * 2 * 3
    kept = {line.split(",")[0] for line in (again / "runs.csv").read_text().splitlines()[1:]}
    assert kept == {"0.0", "0.5", "0.9"}


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"resume": False}, "holds a study: continue it .--resume. or take another folder"),
        ({"navigators": ["mpf"]}, "of another study: its navigators"),
        ({"vary": {"acoustics.slot_s": [3.0]}}, "of another study: its vary"),
        ({"overrides": [SHORT[0]]}, "scenario, options or input files have changed for acoustics.loss"),
        ({"overrides": [*SHORT, "tide.offset_m=1"]}, "scenario, options or input files have changed"),
    ],
)
def test_another_studys_folder_is_left_alone(
    changes: dict[str, Any], says: str, done: tuple[StudyResult, Path], tmp_path: Path
) -> None:
    _, folder = done
    again = copied(folder, tmp_path / "again")
    options = {"vary": {LOSS: [0.0, 0.5]}, "out": again, "resume": True, **changes}
    with pytest.raises(StudyError, match=says):
        small(3, **options)
    for file in folder.iterdir():
        assert (again / file.name).read_bytes() == file.read_bytes()


def test_damaged_rows_are_refused(done: tuple[StudyResult, Path], tmp_path: Path) -> None:
    again = copied(done[1], tmp_path / "again")
    text = (again / "runs.csv").read_text(encoding="utf-8")
    (again / "runs.csv").write_text(text.replace("\n0.5,1,1,", "\n0.5,one,1,", 1), encoding="utf-8")
    with pytest.raises(StudyError, match=r"runs\.csv line \d+ is damaged"):
        small(3, {LOSS: [0.0, 0.5]}, out=again, resume=True)


def test_bad_studies_are_refused_before_anything_is_written(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with pytest.raises(ScenarioError, match="runs is 0"):
        small(0, out=out)
    with pytest.raises(ScheduleError, match=r"slot of 2\.00 s"):
        small(1, {"acoustics.slot_s": [3.0, 2.0]}, out=out)
    with pytest.raises(ScenarioError, match=r"unknown key 'acoustics\.lost'"):
        small(1, {"acoustics.lost": [1]}, out=out)
    with pytest.raises(ValueError, match=r"navigator\.mpf\.particles is 3"):
        small(1, {"navigator.mpf.particles": [3]}, out=out)
    assert not out.exists()


def test_what_fails_in_flight_names_its_seed(tmp_path: Path) -> None:
    shallow = ("chart.relief=0", "vehicles.depth_m=100")
    for processes in (1, 2):
        with pytest.raises(ValueError, match=r"\(seed [01]\)"):
            small(2, overrides=[*SHORT, *shallow], out=tmp_path / "out", processes=processes)
    assert not (tmp_path / "out").exists()


def test_a_scenario_object_and_varied_navigator_options_share_the_mission() -> None:
    scenario = load("flat-bay", SHORT)
    result = uwcoop.study(
        scenario, 1, ["mpf"], {"navigator.mpf.particles": [50, 100], "tide.offset_m": [0.0]}, processes=1
    )
    few, many = result.summary["variants"]
    assert few["set"] == {"navigator.mpf.particles": 50, "tide.offset_m": 0.0}
    assert few["navigators"]["mpf"]["rmse_m"] != many["navigators"]["mpf"]["rmse_m"]


def test_alternatives_are_toml_values_or_bare_words() -> None:
    assert alternatives("a.b=0,0.2") == ("a.b", [0, 0.2])
    assert alternatives("navigator.all.drift=dvl,no-dvl") == ("navigator.all.drift", ["dvl", "no-dvl"])
    assert alternatives("a = [1, 2],[3, 4]") == ("a", [[1, 2], [3, 4]])
    assert alternatives('a="x,y"') == ("a", ["x,y"])
    for bad in ("a", "a=", "=1", "a=1,1", "a=1,]\nb=[2"):
        with pytest.raises(ScenarioError):
            alternatives(bad)


def test_a_missing_dependency_comes_back_from_a_worker_as_itself() -> None:
    import pickle

    error = pickle.loads(pickle.dumps(MissingDependencyError("pyproj", "maps")))
    assert str(error) == 'pyproj is not installed: pip install "uwcoop[maps]"'


def test_the_digest_of_a_large_file_costs_no_memory(tmp_path: Path) -> None:
    import hashlib
    import tracemalloc

    from uwcoop.experiment.study_variants import _digest_of_file

    large = tmp_path / "chart.tif"
    with large.open("wb") as file:
        file.truncate(128 * 2**20)
    tracemalloc.start()
    try:
        digest = _digest_of_file(large)
        assert tracemalloc.get_traced_memory()[1] < 4 * 2**20
    finally:
        tracemalloc.stop()
    expected = hashlib.sha256()
    for _ in range(128):
        expected.update(bytes(2**20))
    assert digest == expected.hexdigest()
