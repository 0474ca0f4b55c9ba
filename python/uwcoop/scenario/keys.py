"""Keys of a scenario file as its models state them: unit, default, bound and meaning of each."""

from __future__ import annotations

import ast
import inspect
import json
import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

from pydantic import BaseModel

from uwcoop.errors import ScenarioError
from uwcoop.scenario.base import Table, nearest
from uwcoop.scenario.models import Scenario

UNITS = {
    "_mps_per_sqrt_s": "m/s/√s",
    "_m_per_sqrt_s": "m/√s",
    "_deg_per_sqrt_s": "°/√s",
    "_rad_per_sqrt_s": "rad/√s",
    "_m_per_sounding": "m",
    "_bits_per_s": "bit/s",
    "bits_per_s": "bit/s",
    "_degps": "°/s",
    "_mps": "m/s",
    "_m2": "m²",
    "_hz": "Hz",
    "_ppm": "ppm",
    "_psu": "psu",
    "_deg": "°",
    "_rad": "rad",
    "_sigmas": "σ",
    "_bytes": "byte",
    "_c": "°C",
    "_m": "m",
    "_s": "s",
}
"""Unit by the end of a key's name; longer endings first."""


@dataclass(frozen=True)
class Key:
    """One key of a scenario file."""

    name: str
    """Dotted, as `--set` takes it; `N` stands for an entry of a list."""
    unit: str
    default: str
    """In TOML; "required", "by preset", or empty where the key may be left out."""
    bound: str
    meaning: str
    case: str = ""
    """Of a table that is one of several: the key that chooses it, e.g. `kind = "waypoints"`."""


def scenario_keys(prefix: str = "") -> list[Key]:
    """Keys that begin with `prefix`, in the order of the models.

    Raises:
        ScenarioError: no key begins so.
    """
    schema = Scenario.model_json_schema()
    return beginning_with(prefix, list(_keys(schema, schema["$defs"], "", ())))


def keys_of(model: type[BaseModel], at: str) -> list[Key]:
    """Keys of a model of plain values, below a dotted name."""
    schema = model.model_json_schema()
    return list(_keys(schema, schema.get("$defs", {}), at, (), meanings(model)))


def beginning_with(prefix: str, keys: list[Key]) -> list[Key]:
    """Those of the keys that begin with a prefix.

    Raises:
        ScenarioError: there is none.
    """
    found = [key for key in keys if key.name.startswith(prefix)]
    if not found:
        names = [key.name for key in keys]
        close = [name for name in names if get_close_matches(prefix, [name, name[: len(prefix)]], n=1)]
        known = close[:1] or dict.fromkeys(name.partition(".")[0] for name in names)
        raise ScenarioError(f"no key begins with {prefix!r}: {nearest(prefix, known)}")
    return found


def _keys(
    schema: Mapping[str, Any],
    definitions: Mapping[str, Any],
    path: str,
    above: tuple[str, ...],
    texts: Mapping[str, str] | None = None,
) -> Iterator[Key]:
    name = schema["title"]
    said = meanings(models_by_name()[name]) if texts is None else texts
    preset = defaults_by_preset(name)
    case = choice_of(schema)
    for key, value in schema.get("properties", {}).items():
        at = f"{path}.{key}" if path else key
        inner = [
            (target, listed) for target, listed in references(value) if target not in above and target != name
        ]
        plain = _plain(value)
        if plain or not inner:
            default = preset.get(key) or default_of(key, value, schema, required="required")
            yield Key(at, unit_of(key), default, bound_of(plain or value), said.get(key, ""), case)
        for target, listed in inner:
            below = f"{at}.N" if listed else at
            yield from _keys(definitions[target], definitions, below, (*above, name))


def _plain(value: Mapping[str, Any]) -> dict[str, Any]:
    """Of a key that may be a table or a plain value, the plain values; empty where it may only be a table."""
    options = [
        option for option in value.get("anyOf", value.get("oneOf", ()))
        if option.get("type") not in (None, "null") and not any(references(option))
    ]  # fmt: skip
    return {"anyOf": options} if options else {}


def choice_of(schema: Mapping[str, Any]) -> str:
    """`kind = "waypoints"` of a table that is one of several; empty for others."""
    for key, value in schema["properties"].items():
        return f'{key} = "{value["const"]}"' if "const" in value else ""
    return ""


def unit_of(key: str) -> str:
    """Unit by a key's name."""
    return next((unit for ending, unit in UNITS.items() if key.endswith(ending)), "")


def default_of(key: str, value: Mapping[str, Any], schema: Mapping[str, Any], *, required: str) -> str:
    """A key's default in TOML; empty for none."""
    if value.get("default") is not None:
        return toml(value["default"])
    return required if key in schema.get("required", ()) and "default" not in value else ""


_HOMES = ("uwcoop.scenario.", "uwcoop.navigators.")
"""Where models of scenario files live; the importers have classes of the same names."""


def models_by_name() -> dict[str, type[BaseModel]]:
    """Every model of a scenario's tables by its class name; tables inside a navigator's options too."""
    found: dict[str, type[BaseModel]] = {}
    pending: list[type[BaseModel]] = [BaseModel, Table]
    while pending:
        model = pending.pop()
        if model.__module__.startswith(_HOMES):
            found.setdefault(model.__name__, model)
        pending += [inner for inner in model.__subclasses__() if inner is not Table]
    return found


def references(value: Any, listed: bool = False) -> Iterator[tuple[str, bool]]:
    """Names of the tables that a key may hold, and whether as a list."""
    if isinstance(value, dict):
        if "$ref" in value:
            yield value["$ref"].rsplit("/", 1)[1], listed
        for key, inner in value.items():
            if key not in ("discriminator", "default"):
                yield from references(inner, listed or key in ("items", "prefixItems"))
    elif isinstance(value, list):
        for inner in value:
            yield from references(inner, listed)


def defaults_by_preset(name: str) -> dict[str, str]:
    """Defaults that a validator fills in, which the schema cannot know."""
    if name != "Drift":
        return {}
    from uwcoop.scenario.vehicle import DRIFT_PRESETS, Drift

    preset = Drift.model_validate({}).preset
    return {**dict.fromkeys(DRIFT_PRESETS[preset], "by preset"), "preset": toml(preset)}


def bound_of(value: Mapping[str, Any]) -> str:
    """What the schema admits, in a few words; None is left out, the default shows it."""
    options = [o for o in value.get("anyOf", value.get("oneOf", [value])) if o.get("type") != "null"]
    return " or ".join(dict.fromkeys(filter(None, map(_one_bound, options))))


def _one_bound(value: Mapping[str, Any]) -> str:
    if "enum" in value:
        return ", ".join(f"`{toml(v)}`" for v in value["enum"])
    if "const" in value:
        return f"`{toml(value['const'])}`"
    kind = value.get("type", "")
    if kind in ("number", "integer"):
        words = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}
        limits = [f"{sign} {_number(value[word])}" for word, sign in words.items() if word in value]
        return ", ".join((["whole"] if kind == "integer" else []) + limits) or "number"
    if kind == "array":
        if "prefixItems" in value:
            return f"{len(value['prefixItems'])} numbers"
        least = f", at least {value['minItems']}" if "minItems" in value else ""
        return f"list of {_one_bound(value['items']) or 'tables'}{least}"
    if kind == "string":
        return f"text `{value['pattern']}`" if "pattern" in value else "text"
    return {"boolean": "true or false", "object": "table"}.get(kind, "")


def toml(value: Any) -> str:
    """A value as a scenario file writes it."""
    if isinstance(value, float):
        return repr(float(f"{value:.4g}"))
    return json.dumps(value, ensure_ascii=False)


def _number(value: float) -> str:
    return "2⁶³ − 1" if value == 2**63 - 1 else f"{value:,.10g}"


def meanings(model: type[BaseModel]) -> dict[str, str]:
    """The texts below the fields of a model and its bases, by field."""
    found: dict[str, str] = {}
    for base in reversed(model.__mro__):
        if not issubclass(base, BaseModel) or base is BaseModel:
            continue
        body = ast.parse(textwrap.dedent(inspect.getsource(base))).body[0]
        assert isinstance(body, ast.ClassDef)
        for field, text in zip(body.body, body.body[1:], strict=False):
            if isinstance(field, ast.AnnAssign) and isinstance(text, ast.Expr):
                assert isinstance(field.target, ast.Name)
                assert isinstance(text.value, ast.Constant)
                found[field.target.id] = inspect.cleandoc(str(text.value.value)).replace("\n", " ")
    return found
