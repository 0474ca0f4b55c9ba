"""Tables of the documentation that are made from the code, and a MkDocs hook that renders equations as MathML.

A page asks for a table with a comment on a line of its own, `<!-- made from code: NAME -->`; `TABLES` holds the names.
The table stands below it in the page, up to `<!-- end of made from code -->`, so that a page reads whole in the
repository too. A test says when one is stale; this program writes them anew:

    python docs/hooks.py

Equations between dollar signs become MathML when the site is built: no script is fetched when it is read.
"""

from __future__ import annotations

import ast
import inspect
import re
import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from uwcoop.scenario.keys import (
    bound_of,
    choice_of,
    default_of,
    defaults_by_preset,
    meanings,
    models_by_name,
    references,
    toml,
    unit_of,
)

END = "<!-- end of made from code -->"
ASKED = re.compile(
    rf"^<!-- made from code: ([a-z ]+) -->$(?:\n(?:(?!^<!-- made from code: ).)*?^{END}$)?",
    re.MULTILINE | re.DOTALL,
)
EQUATION = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)


def filled(markdown: str) -> str:
    """A page with its tables as the code has them now."""
    return ASKED.sub(
        lambda asked: f"<!-- made from code: {asked[1]} -->\n\n{TABLES[asked[1]]().strip()}\n\n{END}",
        markdown,
    )


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Put the tables in, whether or not the page was written anew."""
    return filled(markdown)


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
    _section(models_by_name(), schema["$defs"], "", schema, sections, done, "")
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
            f"`{name}` is fixed at `{key} = {toml(value)}`."
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
    said += [_table({"properties": own}, meanings(model), {}, by_preset)] if own else ["No further options."]
    return "\n\n".join(part for part in said if part)


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
        for target, listed in references(value):
            shape = definitions[target]
            if target in done:
                notes[key] = "a table as above"
                continue
            notes[key] = "table, below"
            choice = choice_of(shape)
            inner.append((at, f"[[{at}]]" if listed else f"[{at}] {choice}".rstrip(), shape))
            done.add(target)
    said = [f"### `{heading}`" if heading else "### Top of the file", inspect.getdoc(model) or ""]
    said.append(_table(schema, meanings(model), notes, defaults_by_preset(name)))
    sections.append("\n\n".join(part for part in said if part))
    for at, title, shape in inner:
        _section(models, definitions, at, shape, sections, done, title)


def _table(
    schema: dict[str, Any],
    texts: dict[str, str],
    notes: dict[str, str],
    defaults: dict[str, str] | None = None,
) -> str:
    rows = ["| key | unit | default | bound | meaning |", "|---|---|---|---|---|"]
    for key, value in schema["properties"].items():
        stated = (defaults or {}).get(key) or default_of(key, value, schema, required="**required**")
        default = stated if stated in ("**required**", "by preset", "") else f"`{stated}`"
        if key in notes and default != "**required**":
            default = ""
        elif not default:
            default = "–"
        bound = notes.get(key) or bound_of(value)
        meaning = texts.get(key, "") or value.get("description", "")
        cells = [f"`{key}`", unit_of(key), default, bound, meaning]
        rows.append("| " + " | ".join(cell.replace("|", "\\|").replace("\n", " ") for cell in cells) + " |")
    return "\n".join(rows)


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
        said = [f"{v:.4g}" if isinstance(v, float) else toml(v) for v in values]
        rows.append(f"| `{key}` | {unit_of(key)} | {' | '.join(said)} |")
    return "\n".join(rows)


def modems() -> str:
    """Modem profiles."""
    from uwcoop.acoustics import MODEMS

    rows = ["| modem | frame, byte | frames at once | bit/s | preamble, s | frame on the air, s | source |"]
    rows.append("|---|---|---|---|---|---|---|")
    for name, m in MODEMS.items():
        if m.bits_per_s:
            said = f"{m.frame_bytes} | {m.max_frames} | {m.bits_per_s:g} | {m.preamble_s:g} | {m.frame_s:.2f}"
        else:
            said = "no limit | 1 | no limit | 0 | 0"
        rows.append(f"| `{name}` | {said} | {m.source} |")
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


if __name__ == "__main__":
    for page in sorted(Path(__file__).parent.rglob("*.md")):
        text = page.read_text(encoding="utf-8")
        if (anew := filled(text)) != text:
            page.write_text(anew, encoding="utf-8")
            print(f"{page.name}: tables written anew")
