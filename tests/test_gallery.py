"""The programs of the gallery run, print what the page shows, and draw the picture that it shows."""

from __future__ import annotations

import re
import runpy
import struct
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PROGRAMS = sorted((ROOT / "examples/gallery").glob("*.py"))
sys.path.insert(0, str(ROOT / "docs"))
import gallery  # noqa: E402 - a program of the documentation, not of the package
import pages  # noqa: E402

sys.path.remove(str(ROOT / "docs"))


def size_px(path: Path) -> tuple[int, int]:
    header = path.read_bytes()[:24]
    assert header[:8] == b"\x89PNG\r\n\x1a\n", path
    return struct.unpack(">II", header[16:24])


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda program: program.stem)
def test_a_program_prints_and_draws_what_the_gallery_shows(
    program: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", [program.name, str(tmp_path)])
    runpy.run_path(str(program), run_name="__main__")
    said = capsys.readouterr().out
    shown = gallery.shown()[program.stem]
    assert shown.strip(), f"python docs/gallery.py {program.stem}"
    assert pages.differences(shown, said) == [], f"python docs/gallery.py {program.stem}"
    width, height = size_px(tmp_path / f"{program.stem}.png")
    shown_px = size_px(gallery.PICTURES / f"{program.stem}.png")
    # Text of another font moves the layout by some pixels, nothing more.
    assert shown_px == pytest.approx((width, height), rel=0.05)


def test_the_gallery_has_every_program_with_its_picture() -> None:
    names = [program.stem for program in PROGRAMS]
    assert len(names) == 10
    assert sorted(gallery.shown()) == names
    text = gallery.PAGE.read_text(encoding="utf-8")
    pictures = re.findall(r"!\[[^]]{10,}\]\(images/gallery/(\w+)\.png\)", text)
    assert pictures == list(gallery.shown())


def test_programs_and_pictures_are_small() -> None:
    for program in PROGRAMS:
        assert len(program.read_text(encoding="utf-8").splitlines()) <= 75, program.name
        assert (gallery.PICTURES / f"{program.stem}.png").stat().st_size < 100_000, program.name
