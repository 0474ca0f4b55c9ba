"""A reproduced paper as a page of a documentation: `results/PAPER.md` and its pictures in `images/`."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

from uwcoop.report.atomic_files import atomic_write
from uwcoop.reproduce.report import markdown
from uwcoop.reproduce.runner import Reproduced

__all__ = ["write_page"]


def write_page(report: Reproduced, out: Path, docs: Path) -> list[str]:
    """Write page and pictures; paths below `docs` of what was written.

    Args:
        report: what `reproduce` gave.
        out: the folder that it wrote to.
        docs: the folder of the documentation; `results` and `images` are made if need be.
    """
    page, written = Path("results") / f"{report.paper.name}.md", []
    for folder in ("results", "images"):
        (docs / folder).mkdir(parents=True, exist_ok=True)
    with atomic_write(docs / page) as partial:
        partial.write_text(markdown(report, pictures="../images/"), encoding="utf-8")
    for outcome in report.outcomes:
        if outcome.picture:
            with atomic_write(docs / "images" / outcome.picture) as partial:
                partial.write_bytes(_small(out / outcome.picture))
            written.append(f"images/{outcome.picture}")
    return [str(page), *written]


def _small(picture: Path) -> bytes:
    """The picture with a palette of 256 colours, a third of the bytes."""
    from PIL import Image

    with Image.open(picture) as whole:
        few = whole.convert("RGB").quantize(256)
    file = BytesIO()
    few.save(file, "PNG", optimize=True)
    return file.getvalue()
