"""Scenario files: packaged ones by name, own ones by path, and overrides of single keys."""

from __future__ import annotations

import copy
import json
import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from uwcoop.errors import ScenarioError
from uwcoop.importers.bounded import read_text, refused
from uwcoop.scenario.base import nearest
from uwcoop.scenario.chart import SYNTHETIC, ChartSpec
from uwcoop.scenario.models import Scenario
from uwcoop.scenario.secrets import redact
from uwcoop.scenario.unread_options import without_unread
from uwcoop.scenario.validation_message import one_line

_PACKAGE = files("uwcoop.scenario") / "packaged_scenarios"
_SCENARIO_LIMIT_BYTES = 4 * 2**20  # tomllib takes up to 100 bytes of memory for each byte of nested brackets
_BARE_WORD = re.compile(r"[A-Za-z][\w:./-]*")


def packaged() -> list[tuple[str, str]]:
    """Name and description of every packaged scenario, by name."""
    return [(name, str(_packaged_table(name).get("description", ""))) for name in _packaged_names()]


def packaged_text(name: str) -> str:
    """The file of a packaged scenario, to start one's own from.

    Raises:
        ScenarioError: no scenario of this name is packaged.
    """
    known = _packaged_names()
    if name not in known:
        raise ScenarioError(f"scenario {name!r} is not packaged: {nearest(name, known)}")
    return (_PACKAGE / f"{name}.toml").read_text(encoding="utf-8")


def load(
    name_or_path: str | Path, overrides: Iterable[str] = (), settings: Mapping[str, Any] | None = None
) -> Scenario:
    """Read a packaged scenario by its name, or a scenario file (TOML, or JSON as `resolved` gives it) by its
    path.

    Relative paths inside a file start at the file's folder; in an override, at the working folder.

    Args:
        name_or_path: e.g. "st-john" or "missions/bay.toml".
        overrides: "dotted.key=value" each, values in TOML syntax.
        settings: values by dotted key, set after the overrides.

    Raises:
        ScenarioError: one line that names what is wrong.
    """
    text = str(name_or_path)
    if text in _packaged_names():
        table = _packaged_table(text)
    else:
        path = Path(name_or_path)
        if not path.is_file():
            known = _packaged_names()
            raise ScenarioError(f"scenario {text!r} is neither a file nor packaged: {nearest(text, known)}")
        table = _read(path)
        _resolve_paths(table, path.resolve().parent)
    return parse(apply_settings(apply_overrides(table, overrides), settings or {}), text)


def parse(table: Mapping[str, Any], where: str = "scenario") -> Scenario:
    """A scenario from its tables.

    Args:
        table: as read from TOML, or as `Scenario.resolved` gives it.
        where: names the source in the error's line.

    Raises:
        ScenarioError: one line that names what is wrong.
    """
    try:
        return Scenario.model_validate(dict(table))
    except ValidationError as error:
        raise ScenarioError(one_line(error, table, where)) from None


def apply_overrides(table: Mapping[str, Any], overrides: Iterable[str]) -> dict[str, Any]:
    """A copy of scenario tables with single keys set.

    Args:
        table: scenario tables.
        overrides: "dotted.key=value" each. The value is TOML (`3`, `0.5`, `true`, `"text"`, `[1, 2]`, `{a =
            1}`); a bare word is a text. Entries of a list are named by their number or, for tables, by their
            `name`: `vehicles.1.depth_m=3`, `vehicles.ship.depth_m=0`.

    Raises:
        ScenarioError: an override that is not of this form.
    """
    halves = [(override, *_halves(override)) for override in overrides]
    return _changed(table, [(dotted, _value(text, override), override) for override, dotted, text in halves])


def apply_settings(table: Mapping[str, Any], settings: Mapping[str, Any]) -> dict[str, Any]:
    """As `apply_overrides`, with values by dotted key.

    Raises:
        ScenarioError: a key that leads nowhere.
    """
    return _changed(table, [(dotted, value, f"{dotted}={value}") for dotted, value in settings.items()])


def _changed(table: Mapping[str, Any], changes: Sequence[tuple[str, Any, str]]) -> dict[str, Any]:
    """A copy of the tables with (dotted key, value, override as given) each set. Options of navigators that this leaves
    without effect are dropped with a warning."""
    changed: dict[str, Any] = copy.deepcopy(dict(table))
    for dotted, value, override in changes:
        _set(changed, dotted.split("."), value, override)
    keys = [dotted for dotted, _, _ in changes]
    before, after = table.get("navigator"), changed.get("navigator")
    if isinstance(before, Mapping) and isinstance(after, Mapping) and before != after:
        changed["navigator"] = without_unread(before, after, keys)
    return changed


def split_overrides(overrides: Iterable[str], table: str) -> tuple[list[str], list[str]]:
    """The overrides of one top-level table, and the others, both in their order."""
    own: list[str] = []
    others: list[str] = []
    for override in overrides:
        first, dot, _ = override.partition("=")[0].partition(".")
        (own if dot and first.strip() == table else others).append(override)
    return own, others


def table_of(overrides: Iterable[str], table: str) -> dict[str, Any]:
    """One top-level table with the keys that overrides set, and no others.

    Raises:
        ScenarioError: an override that is malformed.
    """
    found: dict[str, Any] = apply_overrides({table: {}}, overrides)[table]
    return found


def chart_spec(table: Mapping[str, Any], overrides: Iterable[str] = ()) -> ChartSpec:
    """A `[chart]` table alone, with overrides "chart.key=value".

    Raises:
        ScenarioError: one line that names what is wrong.
    """
    changed = apply_overrides({"chart": dict(table)}, overrides)
    try:
        return ChartSpec.model_validate(changed["chart"])
    except ValidationError as error:
        raise ScenarioError(one_line(error, changed["chart"], "chart")) from None


def alternatives(override: str) -> tuple[str, list[Any]]:
    """The key and the values of "dotted.key=v1,v2": TOML values or bare words, at least one, no two the same.

    Raises:
        ScenarioError: not of this form.
    """
    dotted, text = _halves(override)
    try:
        parsed = tomllib.loads(f"value = [{text}]")
    except (tomllib.TOMLDecodeError, RecursionError):
        parsed = {}
    if parsed.keys() == {"value"}:
        values = list(parsed["value"])
    else:
        values = [_value(part.strip(), override) for part in text.split(",")]
    texts = [json.dumps(value, default=str) for value in values]
    if not values or len(set(texts)) < len(texts):
        raise ScenarioError(f"{redact(override)!r}: needs one value or more, no two the same")
    return dotted, values


def _halves(override: str) -> tuple[str, str]:
    dotted, equals, text = override.partition("=")
    keys = [key.strip() for key in dotted.split(".")]
    if not equals or not all(keys):
        raise ScenarioError(f"override {redact(override)!r} is not of the form dotted.key=value")
    return ".".join(keys), text.strip()


def _value(text: str, override: str) -> Any:
    try:
        parsed = tomllib.loads(f"value = {text}")
    except (tomllib.TOMLDecodeError, RecursionError):
        parsed = {}
    if parsed.keys() == {"value"}:
        return parsed["value"]
    if _BARE_WORD.fullmatch(text):
        return text
    raise ScenarioError(
        f'override {redact(override)!r}: {redact(text)!r} is no TOML value (a text needs quotes: "...")'
    )


def _set(table: dict[str, Any], keys: list[str], value: Any, override: str) -> None:
    at: Any = table
    for depth, key in enumerate(keys):
        last = depth == len(keys) - 1
        if isinstance(at, dict):
            index: Any = key
            if not last:
                at.setdefault(key, {})
        elif isinstance(at, list):
            index = _entry(at, key, ".".join(keys[:depth]), override)
        else:
            above = ".".join(keys[:depth])
            raise ScenarioError(
                f"override {redact(override)!r}: '{above}' is {redact(repr(at))}, not a table"
            )
        if last:
            at[index] = value
        else:
            at = at[index]


def _entry(entries: list[Any], key: str, above: str, override: str) -> int:
    if key.isdigit() and int(key) < len(entries):
        return int(key)
    names = [entry.get("name") if isinstance(entry, dict) else None for entry in entries]
    if key in names:
        return names.index(key)
    known = ", ".join(str(name) for name in names if name is not None)
    raise ScenarioError(
        f"override {redact(override)!r}: '{above}' has no entry {key!r}: "
        f"0 to {len(entries) - 1}{' or ' + known if known else ''}"
    )


def _packaged_names() -> list[str]:
    return sorted(
        entry.name.removesuffix(".toml") for entry in _PACKAGE.iterdir() if entry.name.endswith(".toml")
    )


def _packaged_table(name: str) -> dict[str, Any]:
    return tomllib.loads(packaged_text(name))


def _read(path: Path) -> dict[str, Any]:
    with refused(ScenarioError, f"scenario {path}"):
        text = read_text(path, _SCENARIO_LIMIT_BYTES)
        table = json.loads(text) if path.suffix == ".json" else tomllib.loads(text)
    if not isinstance(table, dict):
        raise ScenarioError(f"scenario {path} cannot be read: it is not a table")
    return table


def _resolve_paths(table: dict[str, Any], folder: Path) -> None:
    """Make the file's own relative paths absolute, in place. Validation names what is malformed."""
    chart = table.get("chart")
    source = chart.get("source") if isinstance(chart, dict) else None
    if isinstance(chart, dict) and isinstance(source, str) and not source.startswith(SYNTHETIC):
        chart["source"] = str(folder / source)
    area = table.get("area")
    if isinstance(area, dict) and isinstance(area.get("file"), str):
        area["file"] = str(folder / area["file"])
    acoustics = table.get("acoustics")
    given = [acoustics.get("loss"), acoustics.get("losses")] if isinstance(acoustics, dict) else []
    for loss in [given[0], *given[1]] if given and isinstance(given[1], list) else given:
        if isinstance(loss, dict) and isinstance(loss.get("file"), str):
            loss["file"] = str(folder / loss["file"])
    water = acoustics.get("sound_speed") if isinstance(acoustics, dict) else None
    if isinstance(water, dict) and isinstance(water.get("file"), str):
        water["file"] = str(folder / water["file"])
    tags = acoustics.get("authentication") if isinstance(acoustics, dict) else None
    if isinstance(tags, dict) and isinstance(tags.get("key_file"), str):
        tags["key_file"] = str(folder / tags["key_file"])
    vehicles = table.get("vehicles")
    for vehicle in vehicles if isinstance(vehicles, list) else []:
        track = vehicle.get("track") if isinstance(vehicle, dict) else None
        if isinstance(track, dict) and isinstance(track.get("file"), str):
            track["file"] = str(folder / track["file"])
