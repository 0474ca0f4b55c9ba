"""The documentation does what it says: its commands run, its Python runs, its TOML is read, its tables are complete, and
the guides show what the program prints.

How a page is read stands in `docs/pages.py`. Missions are cut to a minute here, so that texts and columns are compared;
the digits are compared with whole missions, in a test marked `long`, and `docs/pages.py` writes them anew.
"""

from __future__ import annotations

import pkgutil
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

import uwcoop
from uwcoop import scenario
from uwcoop.importers.import_config import load_config
from uwcoop.missionlog import EVENT_COLUMNS
from uwcoop.navigators import NAVIGATORS
from uwcoop.scenario import loading

ROOT = Path(__file__).parents[1]
EXAMPLES = sorted((ROOT / "examples").rglob("*.py"))
LONGEST_S = 60
sys.path.insert(0, str(ROOT / "docs"))
import pages  # noqa: E402 - a program of the documentation, not of the package

sys.path.remove(str(ROOT / "docs"))


@pytest.fixture
def short_missions(monkeypatch: pytest.MonkeyPatch) -> None:
    """Scenarios that are read from now on last a minute at most."""
    parse = loading.parse

    def shortened(table: Mapping[str, Any], where: str = "scenario") -> scenario.Scenario:
        duration_s = table.get("duration_s")
        if isinstance(duration_s, int | float) and duration_s > LONGEST_S:
            table = {**table, "duration_s": LONGEST_S}
        return parse(table, where)

    monkeypatch.setattr(loading, "parse", shortened)
    monkeypatch.setattr("uwcoop.experiment.demo.SCENARIO", scenario.load("st-john-drift"))


@pytest.fixture
def page_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An empty current folder, whose modules can be imported by the page's blocks and are forgotten afterwards."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    monkeypatch.setenv("MPLBACKEND", "agg")
    known = set(sys.modules)
    yield tmp_path
    for name in set(sys.modules) - known:
        if str(getattr(sys.modules[name], "__file__", None) or "").startswith(str(tmp_path)):
            del sys.modules[name]


@pytest.mark.parametrize("page", pages.PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_what_a_page_shows_works(page: Path, page_folder: Path, short_missions: None) -> None:
    untrue: list[str] = []

    def compare(block: pages.Block, shown: str, said: str) -> None:
        if page in pages.GUIDES and not shown.startswith("error: "):
            untrue.extend(pages.differences(shown, said, digits=False))

    pages.run(page, compare, _read_toml)
    assert untrue == [], "not what the program prints; python docs/pages.py writes it anew"


@pytest.mark.long
@pytest.mark.parametrize("page", pages.GUIDES, ids=lambda page: str(page.relative_to(ROOT)))
def test_the_digits_of_a_page_are_those_of_the_program(page: Path, page_folder: Path) -> None:
    untrue: list[str] = []
    pages.run(page, lambda _, shown, said: untrue.extend(pages.differences(shown, said)))
    assert untrue == []


def test_an_untrue_output_is_found() -> None:
    said = "note: x\n  RMSE  run\n mpf  0.71 ▲ 5.1  0.10\n ekf  3.00  1.0  0.2\nwrote a: b\n"
    same = "RMSE run\n mpf 0.69 5.3 0.31\n…\nwrote a: b\n"
    assert pages.differences(same, said) == []
    for wrong in (same.replace("0.69", "1.69"), same.replace("RMSE", "Rmse"), same.replace("mpf", "team")):
        assert len(pages.differences(wrong, said)) == 1
    assert pages.differences(same.replace("0.69", "1.69"), said, digits=False) == []
    assert pages.differences("RMSE run\n ekf 3.00 1.0 0.2\n", said) == [" ekf 3.00 1.0 0.2"], (
        "a line is left out"
    )
    assert pages.differences(pages.written_anew(same.replace("0.69", "9"), said), said) == []


def _read_toml(block: pages.Block) -> None:
    table = tomllib.loads(block.text)
    if (block.title or "").startswith("import"):
        load_config(block.title)
    elif "duration_s" in table and block.title:
        scenario.load(block.title)
    elif not block.title:  # a part of a scenario: put into one that is whole, it must be a scenario still
        whole = scenario.load("st-john").resolved()
        scenario.parse(_merged(whole, table))


def _merged(whole: dict[str, Any], part: Mapping[str, Any]) -> dict[str, Any]:
    for key, value in part.items():
        one_of_several = key in ("chart", "current", "loss")  # keys of another kind would stay behind
        if isinstance(value, dict) and isinstance(whole.get(key), dict) and not one_of_several:
            whole[key] = _merged(whole[key], value)
        else:
            whole[key] = value
    return whole


def test_what_a_page_shows_is_typed(tmp_path: Path) -> None:
    """All `python` blocks and `examples/` in one run of `mypy --strict`: a page is a module, a block with a title a file
    of its own."""
    sources: dict[str, str] = {}
    for page in pages.PAGES:
        stem = str(page.relative_to(ROOT).with_suffix("")).replace("/", "_")
        for block in pages.blocks(page):
            if block.language != "python":
                continue
            module = f"{stem}_{Path(block.title).stem}" if block.title else stem
            text = sources.get(module, "")
            # At the line that it has on the page, so that a message leads there.
            sources[module] = text + "\n" * (block.line - text.count("\n")) + block.text
    assert len(sources) > 10
    assert len(EXAMPLES) >= 3
    for module, text in sources.items():
        (tmp_path / f"{module}.py").write_text(text, encoding="utf-8")
    files = [str(tmp_path / f"{module}.py") for module in sources]
    files += [str(path) for path in EXAMPLES]
    checked = subprocess.run(
        [sys.executable, "-m", "mypy", "--config-file", str(ROOT / "pyproject.toml"), "--strict", *files],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert checked.returncode == 0, checked.stdout + checked.stderr


def test_there_is_something_to_run() -> None:
    languages = [block.language for page in pages.PAGES for block in pages.blocks(page)]
    assert {language: languages.count(language) >= 5 for language in ("python", "toml", "console")} == {
        "python": True,
        "toml": True,
        "console": True,
    }


# ------------------------------------------------------------------------------------------------- generated tables


def test_every_table_that_is_asked_for_is_made_and_the_other_way_round(hooks: Any) -> None:
    asked = {name for page in pages.PAGES for name in hooks.ASKED.findall(page.read_text(encoding="utf-8"))}
    assert asked == set(hooks.TABLES)
    for name in asked:
        assert "|" in (made := hooks.filled(f"<!-- made from code: {name} -->")) or "```" in made, name


@pytest.mark.parametrize("page", pages.PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_no_table_of_a_page_is_stale(page: Path, hooks: Any) -> None:
    text = page.read_text(encoding="utf-8")
    assert hooks.filled(text) == text, "python docs/hooks.py writes the tables anew"


def test_the_scenario_reference_names_every_key(hooks: Any) -> None:
    from uwcoop.scenario.base import Table
    from uwcoop.scenario.keys import models_by_name

    tables = hooks.scenario_tables()
    models = [model for model in models_by_name().values() if model.model_fields]
    assert len(models) > 20
    # Loaded by now, with classes of the same names as the scenario's.
    assert not [model for model in models if model.__module__.startswith("uwcoop.importers")]
    for model in models:
        if model.__module__.startswith("uwcoop.scenario") and issubclass(model, Table):
            for key in model.model_fields:
                assert f"| `{key}` |" in tables, f"{model.__name__}.{key}"
    assert "Kept from the chart's edge." in tables, "texts below the fields are not found"


def test_the_reference_of_navigators_names_every_option(hooks: Any) -> None:
    tables = hooks.navigator_tables()
    for name, spec in NAVIGATORS.items():
        assert f"`{name}`" in tables
        for option in spec.options.model_fields:
            assert f"| `{option}` |" in tables, f"{name}.{option}"


def test_the_reference_of_kernels_has_a_text_for_each(hooks: Any) -> None:
    sections = hooks.kernels().split("### ")[1:]
    assert len(sections) == len(uwcoop.kernels.__all__)
    assert all(len(section.rsplit("```", 1)[1].strip()) > 20 for section in sections)


def test_topics_name_every_event(hooks: Any) -> None:
    from uwcoop.missionlog.topics import EVENT_TOPICS

    assert set(EVENT_TOPICS) == set(EVENT_COLUMNS)
    assert all(topic.suffix in hooks.topics() for topic in EVENT_TOPICS.values())


# ------------------------------------------------------------------------------------------------- pages


def test_public_names_are_in_the_reference() -> None:
    reference = (ROOT / "docs/reference.md").read_text(encoding="utf-8")
    for name in set(uwcoop.__all__) - {"kernels", "navigators"}:
        assert f"::: uwcoop.{name}" in reference, name


def test_the_reference_names_what_there_is() -> None:
    paths = re.findall(r"^::: (\S+)", (ROOT / "docs/reference.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert len(paths) > 20
    for path in paths:
        assert pkgutil.resolve_name(path) is not None, path
