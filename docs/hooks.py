"""MkDocs hook: tables that are made from the code, so that they cannot fall behind it, and equations as MathML.

A page asks for a table with a comment on a line of its own, `<!-- made from code: NAME -->`; `TABLES` holds the names.
Equations between dollar signs become MathML when the site is built: no script is fetched when it is read.
"""

from __future__ import annotations

import ast
import inspect
import json
import re
import textwrap
from collections.abc import Callable, Iterator
from typing import Any

from pydantic import BaseModel

ASKED = re.compile(r"^<!-- made from code: ([a-z ]+) -->$", re.MULTILINE)
EQUATION = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)

UNITS = {
    "_mps_per_sqrt_s": "m/s/√s",
    "_m_per_sqrt_s": "m/√s",
    "_deg_per_sqrt_s": "°/√s",
    "_rad_per_sqrt_s": "rad/√s",
    "_m_per_sounding": "m",
    "_degps": "°/s",
    "_mps": "m/s",
    "_m2": "m²",
    "_hz": "Hz",
    "_ppm": "ppm",
    "_deg": "°",
    "_rad": "rad",
    "_sigmas": "σ",
    "_bytes": "byte",
    "_m": "m",
    "_s": "s",
}
"""Unit by the end of a key's name; longer endings first."""


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Put the tables in."""
    return ASKED.sub(lambda asked: TABLES[asked[1]](), markdown)


def on_page_content(html: str, **_: Any) -> str:
    """Turn equations into MathML."""
    from html import unescape

    from latex2mathml.converter import convert

    def mathml(found: re.Match[str]) -> str:
        return str(convert(unescape(found[2].strip()), display="block" if found[1] == "div" else "inline"))

    return EQUATION.sub(mathml, html)


# ------------------------------------------------------------------------------------------------- models


def scenario_tables() -> str:
    """A section for each table of a scenario file."""
    from uwcoop.scenario import Scenario

    schema = Scenario.model_json_schema()
    sections: list[str] = []
    done: set[str] = set()
    _section(_models_by_name(), schema["$defs"], "", schema, sections, done, "")
    return "\n\n".join(sections)


def navigator_tables() -> str:
    """A section for each navigator with the options that it adds to those above it."""
    from uwcoop.navigators import NAVIGATORS
    from uwcoop.navigators import options as home

    sections = [
        _navigator_section("All navigators", "`[navigator.all]`", home.DriftOptions, None),
        _navigator_section(
            "All particle filters", "`[navigator.all]`", home.FilterOptions, home.DriftOptions
        ),
    ]
    by_model: dict[type[BaseModel], list[str]] = {}
    for name, spec in NAVIGATORS.items():
        by_model.setdefault(spec.options, []).append(name)
    for model, names in by_model.items():
        title = ", ".join(f"`{name}`" for name in names)
        fixed = [
            f"`{name}` is fixed at `{key} = {_toml(value)}`."
            for name in names
            for key, value in NAVIGATORS[name].fixed.items()
        ]
        base = home.FilterOptions if issubclass(model, home.FilterOptions) else home.DriftOptions
        sections.append(_navigator_section(title, "", model, base, " ".join(fixed)))
    return "\n\n".join(sections)


def _navigator_section(
    title: str, where: str, model: type[BaseModel], base: type[BaseModel] | None, also: str = ""
) -> str:
    from uwcoop.navigators import options as home

    schema = model.model_json_schema()
    inherited = base.model_json_schema()["properties"] if base else {}
    own = {key: value for key, value in schema["properties"].items() if inherited.get(key) != value}
    said = [f"### {title}", where, also]
    by_preset = dict.fromkeys(home.DRIFT_PRESETS["dvl"], "by preset")
    said += [_table({"properties": own}, _meanings(model), {}, by_preset)] if own else ["No further options."]
    return "\n\n".join(part for part in said if part)


def _models_by_name() -> dict[str, type[BaseModel]]:
    from uwcoop.scenario.base import Table

    found: dict[str, type[BaseModel]] = {}
    pending: list[type[BaseModel]] = [Table]
    while pending:
        model = pending.pop()
        found[model.__name__] = model
        pending += model.__subclasses__()
    return found


def _section(
    models: dict[str, type[BaseModel]],
    definitions: dict[str, Any],
    path: str,
    schema: dict[str, Any],
    sections: list[str],
    done: set[str],
    heading: str,
) -> None:
    """Append the section of one table, then those of the tables in it."""
    name = schema["title"]
    done.add(name)
    model = models[name]
    inner: list[tuple[str, str, dict[str, Any]]] = []
    notes: dict[str, str] = {}
    for key, value in schema["properties"].items():
        at = f"{path}.{key}" if path else key
        for target, listed in _references(value):
            shape = definitions[target]
            if target in done:
                notes[key] = "a table as above"
                continue
            notes[key] = "table, below"
            choice = _choice(shape)
            inner.append((at, f"[[{at}]]" if listed else f"[{at}]{choice}", shape))
            done.add(target)
    said = [f"### `{heading}`" if heading else "### Top of the file", inspect.getdoc(model) or ""]
    said.append(_table(schema, _meanings(model), notes, _by_preset(name)))
    sections.append("\n\n".join(part for part in said if part))
    for at, title, shape in inner:
        _section(models, definitions, at, shape, sections, done, title)


def _choice(shape: dict[str, Any]) -> str:
    """` model = "constant"` of a table that is one of several."""
    told = (f' {key} = "{value["const"]}"' for key, value in shape["properties"].items() if "const" in value)
    return next(told, "")


def _references(value: Any, listed: bool = False) -> Iterator[tuple[str, bool]]:
    """Names of the tables that a key may hold, and whether as a list."""
    if isinstance(value, dict):
        if "$ref" in value:
            yield value["$ref"].rsplit("/", 1)[1], listed
        for key, inner in value.items():
            if key not in ("discriminator", "default"):
                yield from _references(inner, listed or key in ("items", "prefixItems"))
    elif isinstance(value, list):
        for inner in value:
            yield from _references(inner, listed)


def _by_preset(name: str) -> dict[str, str]:
    """Defaults that a validator fills in, which the schema cannot know."""
    if name != "Drift":
        return {}
    from uwcoop.scenario.vehicle import DRIFT_PRESETS, Drift

    preset = Drift.model_validate({}).preset
    return {**dict.fromkeys(DRIFT_PRESETS[preset], "by preset"), "preset": f"`{_toml(preset)}`"}


def _table(
    schema: dict[str, Any],
    meanings: dict[str, str],
    notes: dict[str, str],
    defaults: dict[str, str] | None = None,
) -> str:
    rows = ["| key | unit | default | bound | meaning |", "|---|---|---|---|---|"]
    for key, value in schema["properties"].items():
        default = (defaults or {}).get(key)
        if default is None and "default" in value and value["default"] is not None:
            default = "" if key in notes else f"`{_toml(value['default'])}`"
        elif default is None:
            required = key in schema.get("required", ())
            default = "**required**" if required else "" if key in notes else "–"
        bound = notes.get(key) or _bound(value)
        meaning = meanings.get(key, "") or value.get("description", "")
        cells = [f"`{key}`", _unit(key), default, bound, meaning]
        rows.append("| " + " | ".join(cell.replace("|", "\\|").replace("\n", " ") for cell in cells) + " |")
    return "\n".join(rows)


def _unit(key: str) -> str:
    return next((unit for ending, unit in UNITS.items() if key.endswith(ending)), "")


def _bound(value: dict[str, Any]) -> str:
    """What the schema admits, in a few words; None is left out, the default column shows it."""
    options = [o for o in value.get("anyOf", value.get("oneOf", [value])) if o.get("type") != "null"]
    return " or ".join(dict.fromkeys(filter(None, map(_one_bound, options))))


def _one_bound(value: dict[str, Any]) -> str:
    if "enum" in value:
        return ", ".join(f"`{_toml(v)}`" for v in value["enum"])
    if "const" in value:
        return f"`{_toml(value['const'])}`"
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


def _toml(value: Any) -> str:
    if isinstance(value, float):
        return repr(float(f"{value:.4g}"))
    return json.dumps(value, ensure_ascii=False)


def _number(value: float) -> str:
    return "2⁶³ − 1" if value == 2**63 - 1 else f"{value:,.10g}"


def _meanings(model: type[BaseModel]) -> dict[str, str]:
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


# ------------------------------------------------------------------------------------------------- other tables


def drift_of_the_world() -> str:
    """What `drift.preset` stands for in a simulated world."""
    from uwcoop.scenario.vehicle import DRIFT_PRESETS

    return _presets(DRIFT_PRESETS)


def drift_of_navigators() -> str:
    """What `drift` stands for in a navigator."""
    from uwcoop.navigators import DRIFT_PRESETS

    return _presets(DRIFT_PRESETS)


def _presets(presets: dict[str, Any]) -> str:
    names = list(presets)
    rows = [f"| key | unit | {' | '.join(f'`{n}`' for n in names)} |", "|---|---|" + "---|" * len(names)]
    for key in presets[names[0]]:
        values = [presets[n][key] for n in names]
        said = [f"{v:.4g}" if isinstance(v, float) else _toml(v) for v in values]
        rows.append(f"| `{key}` | {_unit(key)} | {' | '.join(said)} |")
    return "\n".join(rows)


def modems() -> str:
    """Modem profiles."""
    from uwcoop.acoustics import MODEMS

    rows = ["| modem | frame, byte | frames at once | bit/s | preamble, s | frame on the air, s |"]
    rows.append("|---|---|---|---|---|---|")
    for name, m in MODEMS.items():
        if m.bits_per_s:
            said = f"{m.frame_bytes} | {m.max_frames} | {m.bits_per_s:g} | {m.preamble_s:g} | {m.frame_s:.2f}"
        else:
            said = "no limit | 1 | no limit | 0 | 0"
        rows.append(f"| `{name}` | {said} |")
    return "\n".join(rows)


def navigators() -> str:
    """Packaged navigators."""
    from uwcoop.navigators import NAVIGATORS

    rows = [f"| `{name}` | {spec.summary} |" for name, spec in NAVIGATORS.items()]
    return "\n".join(["| navigator | what it is |", "|---|---|", *rows])


def scenarios() -> str:
    """Packaged scenarios."""
    from uwcoop.scenario import packaged

    rows = [f"| `{name}` | {text} |" for name, text in packaged()]
    return "\n".join(["| scenario | what it is |", "|---|---|", *rows])


def metrics_of_a_run() -> str:
    """Metrics of each run, navigator and vehicle."""
    from uwcoop.evaluation.metrics import METRICS

    where = {True: "`runs.csv`, `summary.json`", False: "`runs.csv`"}
    rows = [f"| `{k}` | {m.unit} | {m.text} | {where[m.in_summary]} |" for k, m in METRICS.items()]
    return "\n".join(["| metric | unit | meaning | in |", "|---|---|---|---|", *rows])


def metrics_of_a_study() -> str:
    """What a study makes of them."""
    from uwcoop.evaluation.metrics import METRICS

    rows = [f"| `{p.key}` | `{k}` | {p.text} |" for k, m in METRICS.items() for p in m.pooled]
    return "\n".join(["| figure | metric | over runs and vehicles |", "|---|---|---|", *rows])


def topics() -> str:
    """Topics of a log on disk, as the module that writes them states them."""
    from uwcoop.missionlog import mcap

    lines = (inspect.getdoc(mcap) or "").splitlines()
    table = [line for line in lines if line.startswith("|")]
    assert len(table) > 10, "the table of topics has moved"
    return "\n".join(table)


def messages() -> str:
    """Definitions of the project's own messages."""
    from uwcoop.missionlog.messages import DEFINITIONS

    return "\n\n".join(f"`uwcoop_msgs/{name}`\n\n```text\n{text}```" for name, text in DEFINITIONS.items())


def events() -> str:
    """Event kinds and their fields."""
    from uwcoop.missionlog import EVENT_COLUMNS

    rows = [
        f"| `{kind}` | {', '.join(f'`{c}`' for c in columns) or '–'} |"
        for kind, columns in EVENT_COLUMNS.items()
    ]
    return "\n".join(["| kind | fields |", "|---|---|", *rows])


def kernels() -> str:
    """The pure functions of `uwcoop.kernels` with the signatures of the stub and the texts of the binary."""
    import uwcoop
    from uwcoop import _native

    stub = ast.parse((_stub_path()).read_text(encoding="utf-8"))
    functions = {node.name: node for node in stub.body if isinstance(node, ast.FunctionDef)}
    said = []
    for name in uwcoop.kernels.__all__:
        node = functions[name]
        returns = ast.unparse(node.returns) if node.returns else "None"
        shown = f"{name}({ast.unparse(node.args)}) -> {returns}".replace("_F8", "f8").replace("_I8", "i8")
        text = inspect.getdoc(getattr(_native, name)) or ""
        said.append(
            f"### `{name}`\n\n```text\n{textwrap.fill(shown, 100, subsequent_indent='    ')}\n```\n\n{text}"
        )
    return "\n\n".join(said)


def _stub_path() -> Any:
    from importlib.resources import files

    return files("uwcoop") / "_native.pyi"


TABLES: dict[str, Callable[[], str]] = {
    "scenario": scenario_tables,
    "navigator options": navigator_tables,
    "drift of the world": drift_of_the_world,
    "drift of navigators": drift_of_navigators,
    "modems": modems,
    "navigators": navigators,
    "scenarios": scenarios,
    "metrics of a run": metrics_of_a_run,
    "metrics of a study": metrics_of_a_study,
    "topics": topics,
    "messages": messages,
    "events": events,
    "kernels": kernels,
}
"""What a page may ask for."""
