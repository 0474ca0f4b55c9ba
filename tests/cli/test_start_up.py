"""What a command does not need is not imported: a command starts in the time that Python and its parser take."""

from __future__ import annotations

import subprocess
import sys

import pytest

HEAVY = (
    "xarray", "pandas", "matplotlib", "scipy", "dask", "distributed", "h5netcdf", "h5py", "pyarrow", "rerun", "rosbags",
    "mcap", "jinja2", "rasterio", "pyproj", "shapely",
)  # fmt: skip
RUN = ("run", "flat-bay", "-n", "mpf", "--set", "duration_s=60", "--set", "navigator.mpf.particles=100")
COMMAND = "import sys; from uwcoop.cli import main; sys.argv[0] = 'uwcoop'"


def imported(program: str, *arguments: str) -> set[str]:
    """Packages in `sys.modules` when a program ends."""
    whole = f"""
import atexit, sys
atexit.register(lambda: print(*sorted({{name.partition(".")[0] for name in sys.modules}}), file=sys.stderr))
{program}
"""
    ended = subprocess.run(
        [sys.executable, "-c", whole, *arguments], capture_output=True, text=True, check=True
    )
    return set(ended.stderr.splitlines()[-1].split())


@pytest.mark.parametrize(
    ("program", "arguments", "also"),
    [
        ("import uwcoop", (), ("numpy", "pydantic", "typer", "rich")),
        (f"{COMMAND}; main()", ("--help",), ("numpy", "pydantic")),
        (f"{COMMAND}; main()", ("study", "--help"), ("numpy",)),  # typer looks for pydantic's types itself
        (f"{COMMAND}; main()", RUN, ()),
        (f"{COMMAND}; main()", ("study", "flat-bay", "--runs", "1", *RUN[2:]), ()),
    ],
    ids=("import", "help", "study-help", "run", "study"),
)
def test_nothing_heavy_is_imported(program: str, arguments: tuple[str, ...], also: tuple[str, ...]) -> None:
    found = imported(program, *arguments)
    assert "uwcoop" in found
    assert found & {*HEAVY, *also} == set()


def test_the_guard_sees_what_is_imported() -> None:
    assert {"xarray", "pandas"} <= imported("import uwcoop, xarray")
