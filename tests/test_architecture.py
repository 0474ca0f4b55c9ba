"""The structure of the sources: what a reader relies on when looking for a thing."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "python" / "uwcoop"


def module_name(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {
    module_name(path): path for path in sorted(PACKAGE.rglob("*.py*")) if path.suffix in {".py", ".pyi"}
}


def imported(path: Path) -> set[str]:
    """Modules of the package that a file imports at its top level, for typing alone included."""
    found: set[str] = set()
    inside_function = {
        id(node)
        for function in ast.walk(ast.parse(path.read_text()))
        if isinstance(function, ast.FunctionDef)
        for node in ast.walk(function)
    }
    for node in ast.walk(ast.parse(path.read_text())):
        if id(node) in inside_function:
            continue
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("uwcoop"):
            for alias in node.names:
                whole = f"{node.module}.{alias.name}"
                found.add(whole if whole in MODULES else node.module)
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names if alias.name in MODULES}
    return found & set(MODULES)


def circles(edges: dict[str, set[str]]) -> list[set[str]]:
    """Strongly connected components of more than one module (Tarjan 1972)."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[set[str]] = []

    def visit(node: str) -> None:
        index[node] = low[node] = len(index)
        stack.append(node)
        for other in sorted(edges[node]):
            if other not in index:
                visit(other)
                low[node] = min(low[node], low[other])
            elif other in stack:
                low[node] = min(low[node], index[other])
        if low[node] == index[node]:
            component = set(stack[stack.index(node) :])
            del stack[stack.index(node) :]
            if len(component) > 1:
                found.append(component)

    for node in edges:
        if node not in index:
            visit(node)
    return found


def test_no_module_imports_itself_through_others() -> None:
    edges = {name: imported(path) - {name} for name, path in MODULES.items()}
    assert len(edges) > 100, "the guard must find the package"
    assert circles({"a": {"b"}, "b": {"a"}, "c": set()}) == [{"a", "b"}]
    assert circles(edges) == []


def test_every_package_can_be_imported_first() -> None:
    packages = [name for name, path in MODULES.items() if path.name == "__init__.py" and name != "uwcoop"]
    assert len(packages) > 10
    program = """
import importlib, sys
for package in sys.argv[1:]:
    for name in [n for n in sys.modules if n.startswith("uwcoop.") and n != "uwcoop._native"]:
        del sys.modules[name]
    importlib.import_module(package)
    for module in [n for n in MODULES if n.rpartition(".")[0] == package]:
        importlib.import_module(module)
"""
    subprocess.run([sys.executable, "-c", f"MODULES = {list(MODULES)!r}\n" + program, *packages], check=True)


def test_keys_of_a_scenario_are_read_in_its_package_alone() -> None:
    """Elsewhere a scenario is a `Scenario` or a `MissionSetup`; its tables go to files whole."""
    by_key = re.compile(r"(\.scenario|\.resolved\(\)|\.tables\(\))\s*(\[|\.get\()")
    assert by_key.search('log.scenario.get("acoustics")')
    assert by_key.search('scenario.resolved()["acoustics"]')
    outside = {name: path for name, path in MODULES.items() if not name.startswith("uwcoop.scenario")}
    assert len(outside) > 100
    assert [name for name, path in outside.items() if by_key.search(path.read_text())] == []


def test_few_modules_stand_beside_the_packages() -> None:
    beside = {path.name for path in PACKAGE.glob("*.py*")} - {"__init__.py"}
    assert beside >= {"frames.py", "errors.py", "kernels.py"}
    assert len(beside) <= 6, beside


@pytest.mark.parametrize("folder", ["python/uwcoop", "crates/core/src", "crates/python/src"])
def test_files_are_short_enough_to_be_read(folder: str) -> None:
    files = [p for p in (ROOT / folder).rglob("*") if p.suffix in {".py", ".rs"} and "kernels" not in p.parts]
    assert len(files) > 10
    long = {str(p.relative_to(ROOT)): n for p in files if (n := len(p.read_text().splitlines())) > 350}
    assert long == {}


@pytest.mark.parametrize("page", ["docs/architecture.md", "CONTRIBUTING.md"])
def test_every_file_that_a_page_names_exists(page: str) -> None:
    named = set(
        re.findall(
            r"`((?:crates|python|tests|docs|benches|studies|examples)/[\w./-]*)`", (ROOT / page).read_text()
        )
    )
    assert len(named) > 8
    assert {name for name in named if not (ROOT / name).exists() and "NAME" not in name} == set()


OLD_NAMES = (
    r"\bSealed\b", r"\bTeamFilter\b", r"\bTeamEstimator\b", r"\bCommonCurrent\b", r"\brefuse_misfits\b", r"\btrace_of\b",
    r"\bSEAL_BYTES\b", r"navigator::(common|news|sealed)\b", r"uwcoop\.(alternating|hovering|legs|positioning|recorded|"
    r"streams|missions|ledger|traces|poses|consistency|particles|tables|budget_report|output)\b", r"\brange_news\b",
)  # fmt: skip


@pytest.mark.parametrize("name", OLD_NAMES)
def test_names_that_were_given_up_do_not_come_back(name: str) -> None:
    files = [p for d in ("crates", "python", "docs", "studies", "benches") for p in (ROOT / d).rglob("*")]
    texts = {
        p: p.read_text() for p in files if p.suffix in {".rs", ".py", ".pyi", ".md", ".toml"} and p.is_file()
    }
    assert len(texts) > 250
    assert [str(p.relative_to(ROOT)) for p, text in texts.items() if re.search(name, text)] == []
