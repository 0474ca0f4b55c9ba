"""The documentation does what it says: its commands run, its Python runs, its TOML is read, its tables are complete.

A page is a story: its blocks run in order in one temporary folder. ```` ```toml title="bay.toml" ```` and
```` ```python title="x.py" ```` are written to that file first, ```` ```console ```` holds `$ uwcoop ...` commands with
(abridged) output. Missions are cut to a minute. A block is left out when the line before its fence is
`<!-- no-run: why -->`.
"""

from __future__ import annotations

import pkgutil
import re
import shlex
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from typer.testing import CliRunner

import uwcoop
from uwcoop import scenario
from uwcoop.cli import app
from uwcoop.missionlog import EVENT_COLUMNS
from uwcoop.navigators import NAVIGATORS
from uwcoop.scenario import loading

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
LONGEST_S = 60
FENCE = re.compile(
    r"^(?P<before>[^\n]*)\n(?P<indent> *)```(?P<language>python|toml|console)(?P<options>[^\n]*)\n"
    r"(?P<text>.*?)^(?P=indent)```$",
    re.MULTILINE | re.DOTALL,
)


@dataclass(frozen=True)
class Block:
    language: str
    title: str | None
    text: str
    line: int


def blocks(page: Path) -> Iterator[Block]:
    """The blocks to be run, in order."""
    content = "\n" + page.read_text(encoding="utf-8")
    for found in FENCE.finditer(content):
        if "no-run" in found["before"] or "no-run" in found["options"]:
            continue
        title = re.search(r'title="([^"]+)"', found["options"])
        indent = len(found["indent"])
        text = "".join(line[indent:] or "\n" for line in found["text"].splitlines(keepends=True))
        line = content.count("\n", 0, found.start("language"))
        yield Block(found["language"], title[1] if title else None, text, line)


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


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_what_a_page_shows_works(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, short_missions: None
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    monkeypatch.setenv("MPLBACKEND", "agg")
    namespace: dict[str, Any] = {"__name__": "__main__"}
    known = set(sys.modules)
    try:
        for block in blocks(page):
            where = f"{page.relative_to(ROOT)}:{block.line}"
            if block.title:
                Path(block.title).write_text(block.text, encoding="utf-8")
            if block.language == "toml":
                _read_toml(block)
            elif block.language == "python":
                exec(compile(block.text, where, "exec"), namespace)
            else:
                _run_commands(block, where)
    finally:
        for name in set(sys.modules) - known:
            if _is_in(tmp_path, sys.modules[name]):
                del sys.modules[name]


def _is_in(folder: Path, module: ModuleType) -> bool:
    return str(getattr(module, "__file__", None) or "").startswith(str(folder))


def _read_toml(block: Block) -> None:
    table = tomllib.loads(block.text)
    if "duration_s" in table and block.title:
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


def _run_commands(block: Block, where: str) -> None:
    """Run each `$ uwcoop ...`: exit code 0, or 2 where the block shows an error, and then that very line."""
    text = block.text.replace("\\\n", " ")
    if not text.startswith("$ "):  # commands alone, without what they print
        text = "".join(f"$ {line}\n" for line in text.splitlines() if line.strip())
    commands = re.split(r"^\$ ", text, flags=re.MULTILINE)
    for entry in commands[1:]:
        line, _, shown = entry.partition("\n")
        program, *arguments = shlex.split(line, comments=True)
        if program == "make":  # builds the project itself
            continue
        assert program == "uwcoop", f"{where}: {program!r} cannot be run here, mark the block `no-run`"
        if arguments[0] == "study":
            arguments += ["--processes", "1"]
        said = CliRunner().invoke(app, arguments, catch_exceptions=False)
        error = re.search(r"^error: .*", shown, re.MULTILINE)
        assert said.exit_code == (2 if error else 0), f"{where}: $ {line}\n{said.output}"
        if error:
            assert error[0] in said.stderr, f"{where}: $ {line} says {said.stderr!r}"


def test_what_a_page_shows_is_typed(tmp_path: Path) -> None:
    """All `python` blocks and `examples/` in one run of `mypy --strict`: a page is a module, a block with a title a file
    of its own."""
    sources: dict[str, str] = {}
    for page in PAGES:
        stem = str(page.relative_to(ROOT).with_suffix("")).replace("/", "_")
        for block in blocks(page):
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
    languages = [block.language for page in PAGES for block in blocks(page)]
    assert {language: languages.count(language) >= 5 for language in ("python", "toml", "console")} == {
        "python": True,
        "toml": True,
        "console": True,
    }


# ------------------------------------------------------------------------------------------------- generated tables


def test_every_table_that_is_asked_for_is_made_and_the_other_way_round(hooks: Any) -> None:
    asked = {name for page in PAGES for name in hooks.ASKED.findall(page.read_text(encoding="utf-8"))}
    assert asked == set(hooks.TABLES)
    for name in asked:
        assert "|" in (made := hooks.on_page_markdown(f"<!-- made from code: {name} -->")) or "```" in made, (
            name
        )


def test_the_scenario_reference_names_every_key(hooks: Any) -> None:
    from uwcoop.scenario.base import Table
    from uwcoop.scenario.keys import models_by_name

    tables = hooks.scenario_tables()
    models = [model for model in models_by_name().values() if model.model_fields]
    assert len(models) > 20
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


def test_links_between_pages_lead_somewhere() -> None:
    for page in PAGES:
        for target in re.findall(r"\]\((?!https?:)([^)#\s]+)", page.read_text(encoding="utf-8")):
            assert (page.parent / target).exists(), f"{page.relative_to(ROOT)} links to {target}"
