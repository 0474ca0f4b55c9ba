"""Every page can be reached, every link and anchor leads somewhere, and figures that pages share are the same."""

from __future__ import annotations

import re
import unicodedata
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))]
FENCED = re.compile(r"^ *```.*?^ *```$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\((?!https?:)(?P<target>[^)#\s]*)(?:#(?P<anchor>[^)\s]+))?\)")
NUMBER = re.compile(r"(?<![\w.])\d+(?:,\d{3})*(?:\.\d+)?(?:e[-+]\d+)?(?!\w)")


def prose(page: Path) -> str:
    """A page without its blocks of code."""
    return FENCED.sub("", page.read_text(encoding="utf-8"))


def slug(heading: str) -> str:
    """As the site makes anchors of headings."""
    text = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", heading).replace("`", "").replace("*", "")
    plain = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()
    return re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", plain).strip().lower())


def anchors(page: Path) -> set[str]:
    """Anchors of a page's headings and of the objects of its reference; a repeated heading is numbered."""
    text, found = prose(page), set()
    for heading in re.findall(r"^#+ (.+)$", text, re.MULTILINE):
        name, count = slug(heading), 0
        while (numbered := name if not count else f"{name}_{count}") in found:
            count += 1
        found.add(numbered)
    return found | set(re.findall(r"^::: (\S+)", text, re.MULTILINE))


def links(page: Path) -> list[tuple[Path, str | None]]:
    """Files, and anchors in them, that a page links to."""
    return [
        ((page.parent / found["target"]).resolve() if found["target"] else page, found["anchor"])
        for found in LINK.finditer(prose(page))
    ]


def test_slugs_are_those_of_the_site() -> None:
    assert slug("Rich terrain, no current (`st-john`)") == "rich-terrain-no-current-st-john"
    assert slug("10 % outliers – each") == "10-outliers-each"
    assert slug("The team's Cramér–Rao bound") == "the-teams-cramerrao-bound"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_link_and_anchor_leads_somewhere(page: Path) -> None:
    for target, anchor in links(page):
        assert target.exists(), f"{page.relative_to(ROOT)} links to {target}"
        if anchor is not None and target.suffix == ".md":
            assert anchor in anchors(target), f"{page.relative_to(ROOT)}: {target.name} has no #{anchor}"


def test_every_page_is_reached_from_the_index() -> None:
    reached, left = set(), [DOCS / "index.md"]
    while left:
        page = left.pop()
        if page in reached:
            continue
        reached.add(page)
        left += [target for target, _ in links(page) if target.suffix == ".md" and DOCS in target.parents]
    assert {str(page.relative_to(DOCS)) for page in PAGES[1:] if page not in reached} == set()


def test_every_page_is_in_the_navigation() -> None:
    navigation = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    named = set(re.findall(r": (\S+\.md)$", navigation, re.MULTILINE))
    assert named == {str(page.relative_to(DOCS)) for page in PAGES[1:]}


def test_every_picture_of_the_documentation_is_shown() -> None:
    shown = {target for page in PAGES for target, _ in links(page)}
    unused = [path.name for path in sorted((DOCS / "images").rglob("*.png")) if path not in shown]
    assert unused == []


# --------------------------------------------------------------------------------------- figures that pages share


def rows(text: str) -> list[list[str]]:
    """Cells of the tables in a text."""
    return [
        [cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line[:1] == "|"
    ]


def numbers(text: str) -> set[str]:
    return set(NUMBER.findall(text))


def test_the_figures_of_the_limits_are_on_the_pages_that_they_name() -> None:
    """Each number beside the link to a page of results stands on that page."""
    text = (DOCS / "limits.md").read_text(encoding="utf-8")
    section = text.split("## Where they fail")[1].split("## What is simulated")[0]
    checked = 0
    for _, said, where in rows(section)[2:]:
        page = re.search(r"\((results/[\w-]+\.md)", where)
        assert page is not None, where
        there = numbers((DOCS / page[1]).read_text(encoding="utf-8"))
        plain = re.sub(r"`[^`]*`", "", said)
        missing = numbers(plain) - there
        assert missing == set(), f"{page[1]} does not have {missing} of: {said}"
        checked += len(numbers(plain))
    assert checked > 40
    outcomes = [
        (cells[2], re.search(r"\((results/[\w-]+\.md)", cells[2]))
        for cells in rows(text.split("## Held against")[1])
    ]
    for said, page in outcomes:
        if page is not None and said.startswith(("`team`", "equal", "ratios", "1", "2")):
            there = numbers((DOCS / page[1]).read_text(encoding="utf-8"))
            assert numbers(said.split("(")[0]) <= there, said


def test_the_table_of_the_readme_is_that_of_the_comparison() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8").split("<!-- end of comparison -->")[0]
    sections = (DOCS / "results/comparison.md").read_text(encoding="utf-8").split("\n## ")[1:]
    there = [{row[0]: row for row in rows(section)} for section in sections]
    compared = 0
    for name, *cells in rows(readme):
        if not name.startswith("`"):
            continue
        for world, cell in enumerate(cells):
            row = there[world][name]
            said = re.fullmatch(r"([\d.]+) m · ([\d.]+)(?: · (\d+)% lost)?", cell)
            assert said is not None, cell
            assert (said[1], said[2]) == (row[1], row[4]), (name, world)
            assert abs(float(said[3] or 0) - float(row[6].rstrip("%"))) <= 0.5, (name, world)
            compared += 1
    assert compared == 5 * 6
