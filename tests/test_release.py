"""What is published says one version, and its README leads somewhere outside the repository too."""

from __future__ import annotations

import importlib.util
import re
import tomllib
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import ModuleType

import pytest

import uwcoop

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def absolute_links() -> ModuleType:
    loader = SourceFileLoader("absolute_links", str(ROOT / ".ci" / "absolute-links"))
    spec = importlib.util.spec_from_loader("absolute_links", loader)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    loader.exec_module(module)
    return module


def test_links_of_the_readme_become_absolute_and_lead_to_files(absolute_links: ModuleType) -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    source = "https://example.org/uwcoop"
    text = absolute_links.absolute(readme, source, "9.9.9")
    targets = [found["target"] for found in absolute_links.LINK.finditer(text)]
    assert len(targets) > 10, "the guard must find links"
    for target in targets:
        assert re.match(r"https://|#", target), target
        if target.startswith(source):
            kind, tag, path = target.removeprefix(source + "/").split("/", 2)
            assert tag == "v9.9.9"
            assert (ROOT / path.partition("#")[0]).exists(), f"{target} leads nowhere"
            assert kind == ("raw" if path.endswith(".png") else "blob")


def test_links_that_lead_elsewhere_stay(absolute_links: ModuleType) -> None:
    for text in ("[a](https://example.org/x)", "[b](#there)", "[c](mailto:x@example.org)"):
        assert absolute_links.absolute(text, "https://s", "1") == text
    assert absolute_links.absolute("![p](a.png) [q](b.md#c)", "https://s", "1") == (
        "![p](https://s/raw/v1/a.png) [q](https://s/blob/v1/b.md#c)"
    )


def test_one_version_everywhere() -> None:
    cargo = tomllib.loads((ROOT / "Cargo.toml").read_text(encoding="utf-8"))["workspace"]["package"][
        "version"
    ]
    cited = re.search(r"^version: (.+)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE)
    assert cited is not None
    assert uwcoop.__version__ == cargo == cited[1]
    assert f"## [{cargo}]" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_the_promised_rust_is_the_one_that_is_checked() -> None:
    cargo = tomllib.loads((ROOT / "Cargo.toml").read_text(encoding="utf-8"))
    promised = cargo["workspace"]["package"]["rust-version"]
    for page in ("docs/install.md", "CONTRIBUTING.md", "Makefile"):
        assert promised in (ROOT / page).read_text(encoding="utf-8"), page
    assert f"rust-toolchain@{promised}" in (ROOT / ".github/workflows/ci.yml").read_text(encoding="utf-8")
