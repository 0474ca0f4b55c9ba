"""The pages of this documentation as stories: their blocks run in order; what they print is compared or written anew.

```` ```toml title="bay.toml" ```` and ```` ```python title="x.py" ```` are written to that file first,
```` ```console ```` holds `$ uwcoop ...` commands, each with what it prints; a ```` ```text ```` block right below a
```` ```python ```` block holds what that prints. A line `…` stands for lines that are left out. A block is not run when the line before its fence is
`<!-- no-run: why -->`.

    python docs/pages.py [PAGE...]     run the pages (all guides) and write what they print into them
"""

from __future__ import annotations

import contextlib
import io
import math
import os
import re
import shlex
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
#: Pages whose output is held against the program's; results pages are written by their studies.
GUIDES = [page for page in PAGES if "results" not in page.parts]
FENCE = re.compile(
    r"^(?P<before>[^\n]*)\n(?P<indent> *)```(?P<language>python|toml|console|text)(?P<options>[^\n]*)\n"
    r"(?P<text>.*?)^(?P=indent)```$",
    re.MULTILINE | re.DOTALL,
)
LEFT_OUT = "…"
NUMBER = re.compile(r"(?<![\w.])[-+]?\d[\d,]*(?:\.\d+)?(?:e[-+]?\d+)?(?![\w])")
#: What depends on the machine's speed, and marks that depend on the numbers.
SPEED = re.compile(r"[\d.,]+ s, × [\d.,]+")
MARKS = re.compile(r"[▲▽]")
RULE = re.compile(r"[─━]+")


@dataclass(frozen=True)
class Block:
    """A fenced block: what it holds, the line of its fence, and where its text starts in the page."""

    language: str
    title: str | None
    text: str
    line: int
    start: int
    follows_python: bool = False


@dataclass(frozen=True)
class Command:
    """One `$ ...` line, and the lines that the page shows below it."""

    line: str
    shown: str

    @property
    def arguments(self) -> list[str]:
        return shlex.split(self.line.replace("\\\n", " "), comments=True)


def blocks(page: Path) -> Iterator[Block]:
    """The blocks of a page in order, but for those that are not to be run."""
    content = "\n" + page.read_text(encoding="utf-8")
    python_ends = -1
    for found in FENCE.finditer(content):
        if "no-run" in found["before"] or "no-run" in found["options"]:
            continue
        title = re.search(r'title="([^"]+)"', found["options"])
        indent = len(found["indent"])
        text = "".join(line[indent:] or "\n" for line in found["text"].splitlines(keepends=True))
        below = python_ends >= 0 and not content[python_ends : found.start("indent")].strip()
        yield Block(
            found["language"],
            title[1] if title else None,
            text,
            content.count("\n", 0, found.start("language")),
            found.start("text") - 1,
            follows_python=below and found["language"] == "text",
        )
        python_ends = found.end() if found["language"] == "python" else -1


def commands(block: Block) -> list[Command]:
    """The commands of a console block; lines without `$` are commands that show nothing."""
    text = block.text
    if not text.startswith("$ "):
        text = "".join(f"$ {line}\n" for line in re.sub(r"\\\n", " ", text).splitlines() if line.strip())
    entries = re.split(r"^\$ ", text, flags=re.MULTILINE)[1:]
    told: list[Command] = []
    for entry in entries:
        whole = re.match(r"(?:[^\n]*\\\n)*[^\n]*", entry)
        assert whole is not None
        told.append(Command(whole[0], entry[whole.end() + 1 :]))
    return told


# ------------------------------------------------------------------------------------------------- comparison


def _skeleton(line: str) -> str:
    """The line without numbers, marks and widths."""
    line = MARKS.sub("", SPEED.sub("# s, × #", RULE.sub("─", line)))
    return " ".join(NUMBER.sub("#", line).split())


def _numbers(line: str) -> list[float]:
    return [float(found.replace(",", "")) for found in NUMBER.findall(MARKS.sub("", SPEED.sub("", line)))]


def _near(shown: list[float], said: list[float]) -> bool:
    """Within a quarter: processors round differently, and a particle filter carries that on."""
    return all(math.isclose(a, b, rel_tol=0.25, abs_tol=0.12) for a, b in zip(shown, said, strict=True))


def _lines(text: str) -> list[str]:
    return [line.rstrip() for line in text.splitlines() if line.strip()]


def differences(shown: str, said: str, *, digits: bool = True) -> list[str]:
    """Lines that a page shows and the program does not print, in this order; empty where the page is true.

    `digits=False` compares texts and columns alone, for a mission that was cut short.
    """
    found: list[str] = []
    printed = _lines(said)
    at, may_skip = 0, True  # messages before the first shown line need not be shown
    timed = False
    for line in _lines(shown):
        if line.strip() == LEFT_OUT:
            may_skip = True
            continue
        timed = timed or bool(re.search(r"\brun$", line))
        span = range(at, len(printed) if may_skip else min(at + 1, len(printed)))
        hit = next((k for k in span if _matches(line, printed[k], digits, timed)), None)
        if hit is None:
            found.append(line)
            may_skip = True
        else:
            at, may_skip = hit + 1, False
    return found


def _matches(shown: str, said: str, digits: bool, timed: bool) -> bool:
    if _skeleton(shown) != _skeleton(said):
        return False
    a, b = _numbers(shown), _numbers(said)
    if timed:  # the last column of a study is its run time
        a, b = a[:-1], b[:-1]
    return not digits or _near(a, b)


def written_anew(shown: str, said: str) -> str:
    """What a page shows, with the program's own lines in place of the old ones.

    Where lines are left out, a line is taken for the one that has the same text but for its numbers; a line that the
    program prints no more is left out, and the next comparison says what is missing.
    """
    printed = [line.rstrip() for line in said.splitlines()]
    if LEFT_OUT not in shown:
        return "\n".join(printed).strip("\n") + "\n"
    kept: list[str] = []
    at = 0
    for line in shown.splitlines():
        if not line.strip() or line.strip() == LEFT_OUT:
            kept.append(line)
            continue
        hit = next((k for k in range(at, len(printed)) if _skeleton(printed[k]) == _skeleton(line)), None)
        if hit is not None:
            kept.append(printed[hit])
            at = hit + 1
    return "\n".join(kept).rstrip("\n") + "\n"


# ------------------------------------------------------------------------------------------------- running


@dataclass
class Story:
    """A page that is run in the current folder, block by block."""

    page: Path
    namespace: dict[str, Any] = field(default_factory=lambda: {"__name__": "__main__"})
    printed: str = ""  # what the last python block printed

    def where(self, block: Block) -> str:
        return f"{self.page.relative_to(ROOT)}:{block.line}"

    def run_python(self, block: Block) -> None:
        """Execute a block; what it prints is kept."""
        told = io.StringIO()
        with contextlib.redirect_stdout(told):
            exec(compile(block.text, self.where(block), "exec"), self.namespace)
        self.printed = told.getvalue()

    def run_command(self, block: Block, command: Command) -> str | None:
        """What a command prints; None for one that is not the program's. Its exit code must be 0, or 2 where the page
        shows an error."""
        from typer.testing import CliRunner

        from uwcoop.cli import app

        program, *arguments = command.arguments
        if program == "make":  # builds the project itself
            return None
        where = self.where(block)
        assert program == "uwcoop", f"{where}: {program!r} cannot be run here, mark the block `no-run`"
        if arguments[0] == "study":
            arguments += ["--processes", "1"]
        said = CliRunner().invoke(app, arguments, catch_exceptions=False)
        error = re.search(r"^error: .*", command.shown, re.MULTILINE)
        assert said.exit_code == (2 if error else 0), f"{where}: $ {command.line}\n{said.output}"
        if error:
            assert error[0] in said.stderr, f"{where}: $ {command.line} says {said.stderr!r}"
        return said.output


def run(
    page: Path, check: Callable[[Block, str, str], None], read: Callable[[Block], None] = lambda _: None
) -> None:
    """Run all blocks of a page in the current folder. `check(block, shown, said)` is called for each output, and
    `read(block)` for each TOML block."""
    story = Story(page)
    for block in blocks(page):
        if block.title:
            Path(block.title).write_text(block.text, encoding="utf-8")
        if block.language == "toml":
            read(block)
        elif block.language == "python":
            story.run_python(block)
        elif block.follows_python:
            check(block, block.text, story.printed)
        elif block.language == "console":
            for command in commands(block):
                said = story.run_command(block, command)
                if said is not None:
                    check(block, command.shown, said)


def update(page: Path) -> int:
    """Run a page and write what it prints into it; the number of outputs that changed."""
    text = page.read_text(encoding="utf-8")
    changes: list[tuple[int, str, str]] = []

    def note(block: Block, shown: str, said: str) -> None:
        if shown.strip() and not shown.startswith("error: ") and differences(shown, said):
            changes.append((block.start, shown, written_anew(shown, said)))

    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        sys.path.insert(0, folder)
        run(page, note)
        sys.path.remove(folder)
    for start, shown, anew in reversed(changes):
        head, tail = text[:start], text[start:]
        assert shown in tail, f"{page}: indented output cannot be written anew:\n{shown}"
        text = head + tail.replace(shown, anew, 1)
    page.write_text(text, encoding="utf-8")
    return len(changes)


if __name__ == "__main__":
    os.environ.setdefault("MPLBACKEND", "agg")
    for chosen in [Path(name).resolve() for name in sys.argv[1:]] or GUIDES:
        print(f"{chosen.relative_to(ROOT)}: {update(chosen)} outputs written anew", flush=True)
