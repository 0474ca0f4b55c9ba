"""Run the programs of `docs/gallery.md`: their pictures go to `docs/images/gallery`, what they print into the page.

python docs/gallery.py [NAME...]     all, or some of them (`lost_vehicle`)
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from pathlib import Path

from pages import written_anew

ROOT = Path(__file__).resolve().parents[1]
PAGE, PICTURES = ROOT / "docs/gallery.md", ROOT / "docs/images/gallery"
SHOWN = re.compile(
    r"^\$ python examples/gallery/(?P<name>\w+)\.py\n(?P<text>.*?)^```$", re.MULTILINE | re.DOTALL
)
COLOURS = 128
"""Of a picture's palette: a third of the bytes, and no difference to the eye."""


def shown() -> dict[str, str]:
    """What the page shows below the command of each program."""
    return {found["name"]: found["text"] for found in SHOWN.finditer(PAGE.read_text(encoding="utf-8"))}


def made(name: str) -> str:
    """Run a program in a folder of its own, keep its picture, and give what it prints."""
    from PIL import Image

    with tempfile.TemporaryDirectory() as folder:
        program = ROOT / f"examples/gallery/{name}.py"
        command = [sys.executable, str(program), folder]
        said = subprocess.run(command, check=True, capture_output=True, text=True).stdout
        PICTURES.mkdir(parents=True, exist_ok=True)
        with Image.open(Path(folder) / f"{name}.png") as picture:
            picture.convert("RGB").quantize(COLOURS).save(PICTURES / f"{name}.png", optimize=True)
    return said


def main(chosen: list[str]) -> None:
    for name in chosen or list(shown()):
        said, text = made(name), PAGE.read_text(encoding="utf-8")
        anew = SHOWN.sub(
            lambda found, name=name, said=said: (
                found[0]
                if found["name"] != name
                else found[0].replace(
                    found["text"] + "```",
                    (written_anew(found["text"], said) if found["text"] else said) + "```",
                )
            ),
            text,
        )
        PAGE.write_text(anew, encoding="utf-8")
        print(f"{name}: picture and text written", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
