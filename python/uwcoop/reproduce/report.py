"""`report.md` and `report.html` of a reproduced paper."""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence
from html import escape
from pathlib import Path

from uwcoop.report.atomic_files import atomic_write
from uwcoop.reproduce.runner import Finding, Outcome, Reproduced
from uwcoop.reproduce.tables import number

__all__ = ["html", "markdown", "write_report"]

HEAD = ("measured", "the paper", "here", "tolerance", "holds")


def write_report(report: Reproduced, out: Path) -> list[str]:
    """Write both; names of the files."""
    texts = {"report.md": markdown(report), "report.html": html(report)}
    for name, text in texts.items():
        with atomic_write(out / name) as partial:
            partial.write_text(text, encoding="utf-8")
    return list(texts)


def verdict(finding: Finding) -> str:
    """In a word."""
    return "yes" if finding.holds else "**no**"


def _counted(outcomes: Sequence[Outcome]) -> str:
    findings = [finding for outcome in outcomes for finding in outcome.findings]
    held = sum(finding.holds for finding in findings)
    return f"{len(outcomes)} figures and tables; {held} of {len(findings)} statements hold."


def _scope(report: Reproduced) -> str:
    text = report.paper.note
    if report.scope.quick:
        text += " With `--quick`: few missions, for a first look; the numbers are rough."
    elif report.scope.most_runs:
        text += f" At most {report.scope.most_runs} runs of each study."
    machine = f"{os.cpu_count()} cores, {platform.machine()}, Python {platform.python_version()}"
    return f"{text} Flown in {_time(report.seconds)} on {machine}."


def _time(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 120 else f"{seconds / 60:.0f} min"


def markdown(report: Reproduced, *, pictures: str = "") -> str:
    """The report as a page, its pictures in the folder `pictures` (a path that ends with a slash)."""
    command = f"uwcoop reproduce {report.paper.name}{report.scope.flags()}"
    lines = [
        f"# {report.paper.cites}", "", _scope(report), "", *_command(command), _counted(report.outcomes), "",
    ]  # fmt: skip
    for outcome in report.outcomes:
        lines += [f"## {_heading(outcome)}", "", f"The paper: {outcome.states}", ""]
        if outcome.note:
            lines += [outcome.note, ""]
        if outcome.findings:
            lines += ["| " + " | ".join(HEAD) + " |", "|" + "---|" * len(HEAD)]
            for f in outcome.findings:
                lines.append(f"| {f.text} | {f.paper} | {number(f.ours)} | {f.bounds} | {verdict(f)} |")
            lines.append("")
            lines += [f"Why not: {f.text}: {f.why}.\n" for f in outcome.findings if not f.holds and f.why]
        if outcome.picture:
            place = pictures + outcome.picture
            lines += [f"[![{outcome.title}]({place})]({place})", ""]
        else:
            lines += [f"Not drawn: {outcome.reason}", ""]
        for shown in outcome.flown:
            lines += _command(shown.command)
            if shown.table:
                head, *rows = shown.table
                lines += ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
                lines += ["| " + " | ".join(row) + " |" for row in rows] + [""]
    return "\n".join(lines)


def _command(command: str) -> list[str]:
    return ["<!-- no-run: takes minutes -->", "```console", command, "```", ""]


KINDS = {"fig": "Fig.", "table": "Table", "section": "Section"}


def _heading(outcome: Outcome) -> str:
    kind, _, place = outcome.id.partition("-")
    place = f" {place.lstrip('0')}" if place else ""
    return f"{KINDS[kind]}{place}: {outcome.title}" if kind in KINDS else outcome.title.capitalize()


def html(report: Reproduced) -> str:
    """The report as one page; pictures beside it."""
    paper = report.paper
    parts = [
        "<!doctype html>", '<html lang="en"><head><meta charset="utf-8">',
        f"<title>{escape(paper.cites)}</title>", f"<style>{STYLE}</style></head><body>",
        f"<h1>{escape(paper.cites)}</h1>", f"<p>{escape(_scope(report))}</p>",
        f"<p>{escape(_counted(report.outcomes))}</p>",
    ]  # fmt: skip
    for outcome in report.outcomes:
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
        for shown in outcome.flown:
            parts.append(f"<pre>{escape(shown.command)}</pre>")
            if shown.table:
                head, *rows = shown.table
                parts.append("<table><tr>" + "".join(f"<th>{escape(cell)}</th>" for cell in head) + "</tr>")
                parts += [
                    "<tr>" + "".join(f"<td>{escape(cell.strip('`'))}</td>" for cell in row) + "</tr>"
                    for row in rows
                ]
                parts.append("</table>")
    return "\n".join([*parts, "</body></html>", ""])


STYLE = (
    "body{font:15px/1.5 sans-serif;max-width:62em;margin:2em auto;padding:0 1em}"
    "table{border-collapse:collapse}td,th{border:1px solid #ccc;padding:.3em .6em;text-align:left}"
    "img{max-width:100%}pre{background:#f4f4f4;padding:.6em;overflow-x:auto}"
    ".yes{color:#006d2c}.no{color:#a50f15;font-weight:bold}"
)
