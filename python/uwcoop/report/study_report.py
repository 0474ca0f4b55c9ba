"""A study's `report.html`: one file that stands alone, from the question to the command that replays a bad mission."""

from __future__ import annotations

import math
import os
import platform
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from importlib.resources import files
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.evaluation.intervals import CONFIDENCE, LEAST_MISSIONS, mission_rmse
from uwcoop.evaluation.nees import anees_bounds
from uwcoop.report import svg

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from uwcoop.experiment.study_results import Asked, StudyResult

    Floats = NDArray[np.float64]

__all__ = ["nees_shares", "running_mean", "study_report", "worst_missions"]

_BINS = 10
_MOST_GROUPS = 10
"""Variants in one picture of boxes."""
_MOST_VARIANTS = 40
"""Tables; beyond, those of `summary.json`."""
_WORST = 3
"""Missions of each navigator."""
_FOLDED_ABOVE = 6
"""Variants from which on their tables are folded."""

Rows = Sequence[Mapping[str, Any]]


def study_report(result: StudyResult, asked: Asked, command: Callable[[int, str, int], str]) -> str:
    """The page.

    Args:
        result: rows and summary.
        asked: what was asked for.
        command: flies a mission again; of a variant's index, a navigator and a seed.
    """
    import jinja2

    text = (files("uwcoop.report") / "templates" / "study_report.html.j2").read_text(encoding="utf-8")
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters |= {
        "figure": _figure,
        "interval": _interval,
        "percent": _percent,
        "percents": _percents,
    }
    summary = result.summary
    variants = summary["variants"]
    navigators = list(variants[0]["navigators"])
    rows_of = [_rows_of(result.rows, variant["set"]) for variant in variants]
    scenario = asked.variants[0].scenario
    safe = {name: _marked(shown) for name, shown in _pictures(result, rows_of, navigators).items()}
    page = environment.from_string(text).render(
        title=summary["scenario"],
        description=scenario.description,
        question=_question(summary, asked, navigators),
        legend=[(name, svg.colour(k)) for k, name in enumerate(navigators)],
        facts=_facts(asked),
        worlds=[(world.title, world.name) for world in asked.worlds],
        scenario_json=_scenario_json(asked),
        variants=[(_label(variant["set"]), variant) for variant in variants[:_MOST_VARIANTS]],
        folded=len(variants) > _FOLDED_ABOVE,
        left_out=max(0, len(variants) - _MOST_VARIANTS),
        few=summary["runs"] < LEAST_MISSIONS,
        least=LEAST_MISSIONS,
        confidence=CONFIDENCE,
        settle_s=result.settle_s,
        anees_interval=None
        if result.vehicles is None
        else anees_bounds(2, summary["runs"] * result.vehicles),
        sensitivity=summary.get("sensitivity", []),
        pictures=safe,
        worst=_worst(result, asked, variants, command),
        provenance=_provenance(result, asked),
    )
    return page + "\n"


def worst_missions(rows: Rows, keys: Sequence[str], count: int) -> list[Mapping[str, Any]]:
    """The rows of the missions with the largest RMSE of a vehicle, the largest first; a mission of a navigator once."""
    known = [row for row in rows if row["rmse_m"] is not None]
    known.sort(key=lambda row: (-row["rmse_m"], row["seed"], str(row["navigator"]), str(row["vehicle"])))
    worst: dict[Any, Mapping[str, Any]] = {}
    for row in known:
        worst.setdefault((*(str(row[key]) for key in keys), row["seed"], row["navigator"]), row)
        if len(worst) == count:
            break
    return list(worst.values())


def nees_shares(values: Floats) -> tuple[list[float], tuple[float, float]]:
    """Shares of NEES values (two degrees of freedom) in ten bins that χ² fills equally, and the band that 95 % of the
    bars of as many independent samples lie in (normal approximation of the binomial distribution)."""
    # The distribution function of χ² with two degrees of freedom is 1 - exp(-x / 2).
    at = np.minimum((-np.expm1(-values / 2) * _BINS).astype(int), _BINS - 1)
    shares = np.bincount(at, minlength=_BINS) / max(values.size, 1)
    spread = 1.96 * math.sqrt((1 - 1 / _BINS) / _BINS / max(values.size, 1))
    return [float(share) for share in shares], (max(0.0, 1 / _BINS - spread), 1 / _BINS + spread)


def running_mean(values: Floats) -> tuple[Floats, Floats, Floats]:
    """The mean of the first 1, 2, … values, and its 95 % band by their standard deviation; the first has none."""
    count = np.arange(1, values.size + 1)
    mean = np.cumsum(values) / count
    with np.errstate(invalid="ignore", divide="ignore"):
        variance = np.maximum(np.cumsum(values**2) - count * mean**2, 0.0) / (count - 1)
        half = 1.96 * np.sqrt(variance / count)
    return mean, mean - half, mean + half


def _pictures(result: StudyResult, rows_of: Sequence[Rows], navigators: Sequence[str]) -> dict[str, Any]:
    """Every picture, or None where it has nothing to show."""
    variants = result.summary["variants"]
    some = list(zip(variants, rows_of, strict=True))[:_MOST_GROUPS]
    boxes: dict[str, str | None] = {}
    for column, label in (("rmse_m", "RMSE of a vehicle (m)"), ("final_error_m", "error at the end (m)")):
        groups = {
            _label(variant["set"]) or result.summary["scenario"]: {
                name: _column(own, name, column) for name in navigators
            }
            for variant, own in some
        }
        filled = any(values.size for group in groups.values() for values in group.values())
        boxes[column] = svg.boxes(groups, label) if filled and len(variants) <= _MOST_GROUPS else None
    nees = []
    for k, name in enumerate(navigators):
        values = _column(result.rows, name, "final_nees")
        if values.size:
            shares, band = nees_shares(values)
            nees.append((name, values.size, svg.bars(shares, 1 / _BINS, band, _edges(), k)))
    running = {
        name: running_mean(finite)
        for name in navigators
        if (finite := _finite(mission_rmse([r for r in rows_of[0] if r["navigator"] == name]))).size
        >= LEAST_MISSIONS
    }
    return {
        "rmse": boxes["rmse_m"],
        "final": boxes["final_error_m"],
        "nees": nees,
        "convergence": svg.lines(running, "missions", "mean RMSE (m)") if running else None,
        "convergence_of": _label(variants[0]["set"]),
        "scatter": _scatter(result, navigators),
    }


def _scatter(result: StudyResult, navigators: Sequence[str]) -> list[tuple[str, str]]:
    found = []
    for key in dict.fromkeys(entry["key"] for entry in result.summary.get("sensitivity", [])):
        series = {}
        for name in navigators:
            own = [r for r in result.rows if r["navigator"] == name and r["rmse_m"] is not None]
            if own:
                series[name] = (
                    np.array([float(r[key]) for r in own]),
                    np.array([float(r["rmse_m"]) for r in own]),
                )
        if series:
            found.append((key, svg.points(series, key, "RMSE of a vehicle (m)")))
    return found


def _marked(shown: Any) -> Any:
    """Pictures as markup that the template does not escape: they are made here, and their texts are escaped."""
    from markupsafe import Markup

    if isinstance(shown, str) and shown.startswith("<svg"):
        return Markup(shown)
    if isinstance(shown, list | tuple):
        return [_marked(part) for part in shown]
    return shown


def _question(summary: Mapping[str, Any], asked: Asked, navigators: Sequence[str]) -> str:
    keys = [key for key in asked.variants[0].settings if key != "world"]
    said = f"How accurate, and how honest about it, {'is' if len(navigators) == 1 else 'are'} {', '.join(navigators)}"
    said += f" over {asked.runs} missions of {summary['scenario']}"
    if keys:
        said += f" where {', '.join(keys)} {'varies' if len(keys) == 1 else 'vary'}"
    return said + (f", in each of {len(asked.worlds)} worlds?" if asked.worlds else "?")


def _facts(asked: Asked) -> list[tuple[str, str]]:
    scenario = asked.variants[0].scenario
    plan, chart = scenario.acoustics, scenario.chart
    return [
        ("mission", f"{scenario.duration_s:g} s"),
        ("vehicles", ", ".join(vehicle.name for vehicle in scenario.team)),
        ("chart", "none" if chart is None else str(chart.source)),
        ("slots", f"{plan.slot_s:g} s each, {plan.ranging} ranging"),
        (
            "missions of each variant",
            f"{asked.runs}, seeds {asked.first_seed} to {asked.first_seed + asked.runs - 1}",
        ),
        ("variants", str(len(asked.variants))),
        ("set for all", " ".join(asked.overrides) or "nothing"),
    ]


def _scenario_json(asked: Asked) -> str:
    import json

    return json.dumps(asked.variants[0].scenario.resolved(), indent=1, ensure_ascii=False)


def _provenance(result: StudyResult, asked: Asked) -> list[tuple[str, str]]:
    seconds = sum(
        {
            (r["seed"], r["navigator"], _label(_settings(r, asked))): r["seconds"] or 0.0 for r in result.rows
        }.values()
    )
    return [
        (
            "program",
            f"uwcoop {version('uwcoop')}, NumPy {version('numpy')}, Python {platform.python_version()}",
        ),
        ("machine", f"{platform.system()} {platform.machine()}, {_processor()}, {os.cpu_count()} cores"),
        ("flown by", asked.flown_by),
        ("time in navigators", f"{seconds:.1f} s in all"),
        (
            "seeds",
            f"{asked.first_seed} to {asked.first_seed + asked.runs - 1}, the same for all navigators and variants",
        ),
        ("written", datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")),
    ]


def _processor() -> str:
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            return next(line.partition(":")[2].strip() for line in file if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or "unknown processor"


def _worst(
    result: StudyResult,
    asked: Asked,
    variants: Sequence[Mapping[str, Any]],
    command: Callable[[int, str, int], str],
) -> list[dict[str, Any]]:
    index = {_label(variant["set"]): k for k, variant in enumerate(variants)}
    found = []
    names = list(variants[0]["navigators"])
    by_name = [[row for row in result.rows if row["navigator"] == name] for name in names]
    keys = list(asked.variants[0].settings)
    for row in (row for own in by_name for row in worst_missions(own, keys, _WORST)):
        label = _label(_settings(row, asked))
        found.append(
            {**row, "label": label, "command": command(index[label], str(row["navigator"]), int(row["seed"]))}
        )
    return found


def _settings(row: Mapping[str, Any], asked: Asked) -> dict[str, Any]:
    return {key: row[key] for key in asked.variants[0].settings}


def _rows_of(rows: Rows, settings: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    return [row for row in rows if all(row[key] == value for key, value in settings.items())]


def _label(settings: Mapping[str, Any]) -> str:
    if list(settings) == ["world"]:
        return str(settings["world"])
    return ", ".join(f"{key} = {value}" for key, value in settings.items())


def _column(rows: Rows, navigator: str, key: str) -> Floats:
    return np.array([float(r[key]) for r in rows if r["navigator"] == navigator and r[key] is not None])


def _finite(by_seed: Mapping[int, float]) -> Floats:
    values = np.array(list(by_seed.values()), dtype=np.float64)
    return values[np.isfinite(values)]


def _edges() -> list[str]:
    inner = [abs(-2 * math.log(1 - k / _BINS)) for k in range(_BINS)]
    return [*(f"{edge:.2g}" for edge in inner), "∞"]


def _figure(value: float | None) -> str:
    return "–" if value is None else svg.number(float(value))


def _percent(value: float | None) -> str:
    return "–" if value is None else f"{value:.0%}"


def _percents(bounds: Sequence[float | None] | None) -> str:
    low, high = bounds or (None, None)
    return "" if low is None or high is None else f"{100 * low:.0f} to {100 * high:.0f} %"


def _interval(bounds: Sequence[float | None] | None) -> str:
    if bounds is None:
        return ""
    low, high = ("∞" if bound is None else svg.number(bound) for bound in bounds)
    return f"{low} to {high}"
