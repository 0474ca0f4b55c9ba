"""The programs in `examples/` run and show what `docs/examples.md` says of them."""

from __future__ import annotations

import re
import runpy
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples"

Run = Callable[[str], str]


@pytest.fixture
def printed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Runs a program of `examples/` in an empty folder, as `python examples/NAME` would, and gives what it prints."""

    def run(name: str) -> str:
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr("sys.argv", [name])
        runpy.run_path(str(EXAMPLES / name), run_name="__main__")
        return capsys.readouterr().out

    return run


def _rmse_m(text: str) -> dict[str, list[float]]:
    """RMS errors by navigator, m, of the lines `navigator vehicle 1.23 m rms`."""
    found: dict[str, list[float]] = {}
    for navigator, rmse_m in re.findall(r"^\s*(\S+) +\S+ +(\d+\.\d+) m rms", text, re.MULTILINE):
        found.setdefault(navigator, []).append(float(rmse_m))
    return found


def test_one_s_own_navigator_is_better_than_dead_reckoning(printed: Run) -> None:
    errors = _rmse_m(printed("own_navigator.py"))
    assert {name: len(values) for name, values in errors.items()} == {
        "dead-reckoning": 3, "terrain-kalman": 3, "mpf": 3,
    }  # fmt: skip
    assert sum(errors["terrain-kalman"]) < sum(errors["dead-reckoning"])
    assert max(errors["mpf"]) < 5.0


def test_a_scenario_of_one_s_own_runs_as_stated_and_with_an_override(printed: Run, tmp_path: Path) -> None:
    text = printed("own_scenario.py")
    assert {path.name for path in (tmp_path / "own-scenario").iterdir()} == {"sound.nc", "sound.toml"}
    stated, slower = text.split("['current.speed_mps=0.05']")
    for part in (stated, slower):
        errors = _rmse_m(part)
        assert len(errors["dead-reckoning"]) == len(errors["mpf"]) == 2
        assert sum(errors["mpf"]) < sum(errors["dead-reckoning"])
    assert sum(_rmse_m(slower)["dead-reckoning"]) < sum(_rmse_m(stated)["dead-reckoning"])


def test_the_live_loop_exchanges_packets_and_survives_a_restart(printed: Run) -> None:
    text = printed("live_loop.py")
    at_the_end = re.findall(
        r"^ *300 s  vehicle [01]: +(\d+\.\d+) m off, sigma +(\d+\.\d+) m, navigating$", text, re.M
    )
    assert len(at_the_end) == 2, text
    for off_m, sigma_m in at_the_end:
        assert float(off_m) < 4 * float(sigma_m)
        assert float(off_m) < 15.0, "dead reckoning would be 54 m off"
    assert "vehicle 0 restarted from a snapshot" in text
    used = re.search(r"^(\d+) packets used$", text, re.MULTILINE)
    assert used is not None
    assert int(used[1]) > 30


def test_a_restart_in_the_live_loop_changes_no_bit(printed: Run) -> None:
    """The navigator that was restored goes on as the one that was saved would have."""
    with_restart = printed("live_loop.py")
    source = (EXAMPLES / "live_loop.py").read_text(encoding="utf-8")
    uninterrupted = source.replace("if second == 150:", "if second < 0:")
    assert uninterrupted != source
    Path("uninterrupted.py").write_text(uninterrupted, encoding="utf-8")
    without = printed(str(Path("uninterrupted.py").resolve()))
    assert [line for line in with_restart.splitlines() if "restarted" not in line] == without.splitlines()


def test_the_page_names_every_example() -> None:
    page = (ROOT / "docs/examples.md").read_text(encoding="utf-8")
    programs = [*EXAMPLES.glob("*.py"), *(ROOT / "crates/core/examples").glob("*.rs")]
    assert len(programs) >= 4
    for program in programs:
        assert f"`{program.relative_to(ROOT)}`" in page, program
