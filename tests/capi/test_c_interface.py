"""The C interface: the header is that of the sources, and a C program flies with it."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CAPI = ROOT / "crates" / "capi"
HEADER = CAPI / "include" / "uwcoop.h"


def declared(text: str) -> list[str]:
    """Functions of the header: name and number of arguments."""
    code = re.sub(r"//[^\n]*", "", text)
    found = re.findall(r"^[\w *]+?\*?(uwcoop_\w+)\(([^)]*)\);", code, re.MULTILINE)
    return sorted(
        f"{name}/{0 if arguments == 'void' else arguments.count(',') + 1}" for name, arguments in found
    )


def defined(text: str) -> list[str]:
    """Functions of the sources that C can call."""
    found = re.findall(r'#\[no_mangle\]\s*pub (?:unsafe )?extern "C" fn (uwcoop_\w+)\(([^)]*)\)', text)
    return sorted(
        f"{name}/{len([a for a in arguments.split(',') if a.strip()])}" for name, arguments in found
    )


def test_the_header_declares_what_the_sources_define() -> None:
    sources = "\n".join(path.read_text() for path in sorted((CAPI / "src").glob("*.rs")))
    header = HEADER.read_text()
    assert len(defined(sources)) >= 10
    assert declared(header) == defined(sources)
    values = re.findall(r"^ {4}(UWCOOP_\w+) = (\d+),", sources, re.MULTILINE)
    assert len(values) >= 20
    assert re.findall(r"^ {2}(UWCOOP_\w+) = (\d+),", header, re.MULTILINE) != []
    assert sorted(re.findall(r"^ {2}(UWCOOP_\w+) = (\d+),", header, re.MULTILINE)) == sorted(values)


@pytest.mark.skipif(shutil.which("cbindgen") is None, reason="cbindgen is not installed")
def test_the_header_is_what_cbindgen_makes(tmp_path: Path) -> None:
    made = tmp_path / "uwcoop.h"
    command = ["cbindgen", "--quiet", "--config", str(CAPI / "cbindgen.toml"), str(CAPI), "-o", str(made)]
    subprocess.run(command, check=True)
    assert made.read_text() == HEADER.read_text(), " ".join(command)


def test_a_c_program_flies_restarts_and_reads_errors(tmp_path: Path) -> None:
    if shutil.which("cc") is None:
        pytest.skip("no C compiler")
    build = ["cargo", "build", "--locked", "-q", "--profile", "checked", "-p", "uwcoop-capi"]
    subprocess.run(build, cwd=ROOT, check=True)
    program = tmp_path / "dive"
    flags = ["-std=c11", "-Wall", "-Wextra", "-Werror", f"-I{HEADER.parent}"]
    library = ROOT / "target" / "checked" / "libuwcoop.a"
    subprocess.run(
        [
            "cc",
            *flags,
            str(CAPI / "example" / "dive.c"),
            str(library),
            "-o",
            str(program),
            "-lm",
            "-lpthread",
            "-ldl",
        ],
        check=True,
    )
    done = subprocess.run([program], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    off_m = [float(found) for found in re.findall(r"([\d.]+) m off, status 1", done.stdout)]
    assert len(off_m) == 2
    assert max(off_m) < 5
    assert "24 packets fused, 24 replayed ones rejected" in done.stdout
    assert "water_depth_m is NaN" in done.stdout
    assert "landmark pair: mover fused 1 positionings" in done.stdout
    assert "role is 2: must be 0 (mover) or 1 (landmark)" in done.stdout
    assert "kind is 99: must be 0 to 11" in done.stdout
    (east_m,) = re.findall(r"stations: 2 fused, ([\d.]+) m east", done.stdout)
    assert float(east_m) == pytest.approx(20.0, abs=1.5)
