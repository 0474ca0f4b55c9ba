"""What the product is built of: licences, sources and versions, held against the files that state them."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import tomllib
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]
POLICY = tomllib.loads((ROOT / "deny.toml").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def crates() -> list[dict[str, Any]]:
    """Every crate of `Cargo.lock` that is not the workspace's own."""
    cargo = shutil.which("cargo")
    assert cargo is not None, "the package is built with cargo"
    told = subprocess.run(
        [cargo, "metadata", "--format-version", "1", "--locked", "--offline"],
        cwd=ROOT, capture_output=True, text=True, timeout=120, check=True,
    )  # fmt: skip
    found = [p for p in json.loads(told.stdout)["packages"] if p["source"] is not None]
    assert len(found) > 50, "the guard must find the dependencies"
    return found


def is_allowed(expression: str, allowed: set[str]) -> bool:
    """Whether one of the alternatives of a licence expression consists of allowed licences only."""
    expression = expression.replace("/", " OR ")
    if " AND " in expression:
        return all(is_allowed(part.strip("() "), allowed) for part in expression.split(" AND "))
    return any(part.strip("() ") in allowed for part in expression.split(" OR "))


def test_licence_expressions_are_understood() -> None:
    allowed = {"MIT", "Unicode-3.0", "Apache-2.0 WITH LLVM-exception"}
    for good in ("MIT", "MIT/Apache-2.0", "GPL-3.0 OR MIT", "(MIT OR Zlib) AND Unicode-3.0"):
        assert is_allowed(good, allowed)
    for bad in ("GPL-3.0", "MIT AND GPL-3.0", "Apache-2.0", "(GPL-2.0 OR GPL-3.0) AND MIT", ""):
        assert not is_allowed(bad, allowed)


def test_every_crate_has_an_allowed_licence(crates: list[dict[str, Any]]) -> None:
    allowed = set(POLICY["licenses"]["allow"])
    assert {p["name"]: p["license"] for p in crates if not is_allowed(p["license"] or "", allowed)} == {}


def test_every_crate_comes_from_the_registry_with_a_checksum(crates: list[dict[str, Any]]) -> None:
    sources = {p["source"] for p in crates}
    assert len(sources) == 1
    assert all(source.startswith("registry+") for source in sources), "no crate from git or from a folder"
    locked = tomllib.loads((ROOT / "Cargo.lock").read_text(encoding="utf-8"))["package"]
    assert [p["name"] for p in locked if "source" in p and "checksum" not in p] == []
    banned = {rule["name"] for rule in POLICY["bans"]["deny"]}
    assert banned
    assert not banned & {p["name"] for p in crates}


def test_no_dependency_of_the_workspace_takes_any_version() -> None:
    tables = tomllib.loads((ROOT / "Cargo.toml").read_text(encoding="utf-8"))["workspace"]["dependencies"]
    versions = {name: spec if isinstance(spec, str) else spec.get("version") for name, spec in tables.items()}
    assert {name for name, version in versions.items() if version == "*"} == set()
    assert len(versions) > 5


def test_the_wheel_carries_a_bill_of_its_crates(crates: list[dict[str, Any]]) -> None:
    files = distribution("uwcoop").files or []
    bills = [f for f in files if "sboms" in f.parts]
    assert len(bills) == 1
    bill = json.loads(bills[0].read_text(encoding="utf-8"))
    assert bill["bomFormat"] == "CycloneDX"
    named = {component["name"] for component in bill["components"]}
    assert {"hmac", "sha2", "nalgebra", "pyo3"} <= named <= {p["name"] for p in crates} | {"uwcoop-core"}


def test_pinned_python_packages_have_hashes_and_cover_what_is_declared() -> None:
    text = (ROOT / ".ci/requirements.txt").read_text(encoding="utf-8")
    pins = re.split(r"\n(?=\S)", text)
    hashed = {
        m[1].lower()
        for pin in pins
        if (m := re.match(r"([A-Za-z0-9._-]+)==", pin)) and "--hash=sha256:" in pin
    }
    assert len(hashed) > 50
    assert "http" not in text, "pins name no host"
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    extras = [line for lines in project["project"]["optional-dependencies"].values() for line in lines]
    declared = [*project["project"]["dependencies"], *extras, *project["dependency-groups"]["dev"]]
    names = {re.match(r"[A-Za-z0-9._-]+", line)[0].lower() for line in declared} - {"uwcoop"}  # type: ignore[index]
    assert names - hashed == set(), "make lock"
