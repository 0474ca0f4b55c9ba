"""`report.md` and `report.html` of a reproduced paper."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from pathlib import Path

from uwcoop.report.atomic_files import atomic_write
from uwcoop.reproduce.manifest import Paper
from uwcoop.reproduce.runner import Finding, Outcome

__all__ = ["html", "markdown", "write_report"]

HEAD = ("measured", "the paper", "here", "tolerance", "holds")


def write_report(paper: Paper, outcomes: Sequence[Outcome], out: Path, *, quick: bool) -> list[str]:
    """Write both; names of the files."""
    texts = {
        "report.md": markdown(paper, outcomes, quick=quick),
        "report.html": html(paper, outcomes, quick=quick),
    }
    for name, text in texts.items():
        with atomic_write(out / name) as partial:
            partial.write_text(text, encoding="utf-8")
    return list(texts)


def number(value: float | None) -> str:
    """Three digits."""
    return "-" if value is None else f"{value:.3g}"


def verdict(finding: Finding) -> str:
    """In a word."""
    return "yes" if finding.holds else "**no**"


def _counted(outcomes: Sequence[Outcome]) -> str:
    findings = [finding for outcome in outcomes for finding in outcome.findings]
    held = sum(finding.holds for finding in findings)
    return f"{len(outcomes)} figures and tables; {held} of {len(findings)} statements hold."


def _scope(paper: Paper, quick: bool) -> str:
    few = " With `--quick`: few missions, for a first look; the numbers are rough." if quick else ""
    return f"{paper.note}{few}"


def markdown(paper: Paper, outcomes: Sequence[Outcome], *, quick: bool) -> str:
    """The report as a page of the documentation."""
    command = f"uwcoop reproduce {paper.name}{' --quick' if quick else ''}"
    lines = [
        f"# {paper.cites}", "", _scope(paper, quick), "",
        "<!-- no-run: takes minutes -->", "```console", command, "```", "", _counted(outcomes), "",
    ]  # fmt: skip
    for outcome in outcomes:
        lines += [f"## {_heading(outcome)}", "", f"The paper: {outcome.states}", ""]
        if outcome.note:
            lines += [outcome.note, ""]
        if outcome.findings:
            lines += ["| " + " | ".join(HEAD) + " |", "|" + "---|" * len(HEAD)]
            for f in outcome.findings:
                lines.append(f"| {f.text} | {f.paper} | {number(f.ours)} | {f.bounds} | {verdict(f)} |")
            lines.append("")
            lines += [f"Why not: {f.text}: {f.why}\n" for f in outcome.findings if not f.holds and f.why]
        if outcome.picture:
            lines += [f"![{outcome.title}]({outcome.picture})", ""]
        else:
            lines += [f"Not drawn: {outcome.reason}", ""]
        lines += ["<!-- no-run: takes minutes -->", "```console", outcome.command, "```", ""]
    return "\n".join(lines)


def _heading(outcome: Outcome) -> str:
    kind, _, place = outcome.id.partition("-")
    return f"{'Table' if kind == 'table' else 'Fig.'} {place.lstrip('0')}: {outcome.title}"


def html(paper: Paper, outcomes: Sequence[Outcome], *, quick: bool) -> str:
    """The report as one page; pictures beside it."""
    parts = [
        "<!doctype html>", '<html lang="en"><head><meta charset="utf-8">',
        f"<title>{escape(paper.cites)}</title>", f"<style>{STYLE}</style></head><body>",
        f"<h1>{escape(paper.cites)}</h1>", f"<p>{escape(_scope(paper, quick))}</p>",
        f"<p>{escape(_counted(outcomes))}</p>",
    ]  # fmt: skip
    for outcome in outcomes:
        parts.append(f"<h2>{escape(_heading(outcome))}</h2><p>The paper: {escape(outcome.states)}</p>")
        if outcome.note:
            parts.append(f"<p>{escape(outcome.note)}</p>")
        if outcome.findings:
            parts.append("<table><tr>" + "".join(f"<th>{head}</th>" for head in HEAD) + "</tr>")
            for f in outcome.findings:
                cells = (f.text, f.paper, number(f.ours), f.bounds)
                mark = '<td class="yes">yes</td>' if f.holds else '<td class="no">no</td>'
                parts.append("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in cells) + mark + "</tr>")
                if not f.holds and f.why:
                    parts.append(f'<tr><td colspan="{len(HEAD)}">{escape(f.why)}</td></tr>')
            parts.append("</table>")
        if outcome.picture:
            parts.append(f'<img src="{escape(outcome.picture)}" alt="{escape(outcome.title)}">')
        else:
            parts.append(f"<p>Not drawn: {escape(outcome.reason)}</p>")
        parts.append(f"<pre>{escape(outcome.command)}</pre>")
    return "\n".join([*parts, "</body></html>", ""])


STYLE = (
    "body{font:15px/1.5 sans-serif;max-width:62em;margin:2em auto;padding:0 1em}"
    "table{border-collapse:collapse}td,th{border:1px solid #ccc;padding:.3em .6em;text-align:left}"
    "img{max-width:100%}pre{background:#f4f4f4;padding:.6em;overflow-x:auto}"
    ".yes{color:#006d2c}.no{color:#a50f15;font-weight:bold}"
)
