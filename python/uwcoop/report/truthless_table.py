"""The table of a run whose truth is not known: what navigators state, and how measurements fit it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

from rich.table import Table
from rich.text import Text

from uwcoop.evaluation.consistency_without_truth import DEGREES
from uwcoop.report.result_tables import (
    block_table,
    counterfactual_caption,
    number_text,
    run_title,
)

__all__ = ["truthless_lines", "truthless_table"]

OVERCONFIDENT_NIS, CONSERVATIVE_NIS = 2.0, 0.5
"""Twice and half the ideal 1: beyond, the stated variance is off by a factor two."""

Vehicle = Mapping[str, Any]
_NAMES = {"fix": "fixes", "sounding": "soundings", "range": "ranges"}


def truthless_table(
    summary: Mapping[str, Any], *, settle_s: float, not_realisable: Collection[str] = ()
) -> Table:
    """Stated sigma, normalised innovations by kind, jumps at fixes, what was gated, how far navigators are apart, and the
    score of fixes that were held out; a block for each navigator, a line in it for each vehicle. Columns without any
    value are left out.
    """
    navigators = summary["navigators"]
    blocks = {
        name: [
            {
                **navigator["consistency"][vehicle],
                "held_out": navigator.get("held_out", {}).get(vehicle),
                "apart": _apart(navigator.get("disagreement", {}).get(vehicle, {})),
            }
            for vehicle in navigator["vehicles"]
        ]
        for name, navigator in navigators.items()
    }
    every = [vehicle for block in blocks.values() for vehicle in block]
    columns = {
        heading: cell
        for heading, (cell, applies) in _COLUMNS.items()
        if any(applies(vehicle) for vehicle in every)
    }
    caption = (
        f"After {settle_s:g} s. σ: root of the trace of the stated covariance. NIS: normalised innovation squared by "
        f"degree of freedom, before use, gated ones included (how many): 1 is ideal, ▲ above {OVERCONFIDENT_NIS:g}, "
        f"▽ below {CONSERVATIVE_NIS:g}; neighbours share errors, so a mean scatters more than independent ones would."
    )
    if "apart" in columns:
        caption += " Apart: the navigator that is most often beyond both 95 % ellipses, and how often."
    if any(vehicle["held_out"] for vehicle in every):
        caption += (
            " Held out: rms distance of the withheld fixes (their own σ), "
            "and their NEES with the fix's noise, 2 is ideal."
        )
    return block_table(
        f"{run_title(summary)}: without truth",
        caption + counterfactual_caption(summary),
        navigators,
        {
            heading: {n: [cell(v) for v in block] for n, block in blocks.items()}
            for heading, cell in columns.items()
        },
        not_realisable,
    )


def truthless_lines(summary: Mapping[str, Any], unknown: Sequence[str]) -> list[str]:
    """What a run does not say, a line each: vehicles without truth, kinds that nobody compared or some navigators did
    not.

    `unknown`: the vehicles whose truth is not known.
    """
    lines = []
    if unknown:
        lines.append(f"no truth of {', '.join(unknown)}: no error, no NEES; --truth FILE gives one")
    navigators = summary["navigators"]
    for kind, name in _NAMES.items():
        compared = {
            navigator: sum(v[kind]["compared"] for v in values["consistency"].values())
            for navigator, values in navigators.items()
        }
        silent = [navigator for navigator, count in compared.items() if count == 0]
        if len(silent) == len(compared):
            lines.append(f"no {name} were compared with a belief after settling")
        elif silent:
            lines.append(f"no {name} were compared by {', '.join(silent)}: not used, or not stated")
    return lines


def _apart(others: Mapping[str, Mapping[str, float | None]]) -> tuple[str, float, float] | None:
    """The other navigator whose estimate is most often beyond both ellipses: name, share, rms distance."""
    known = [(n, v["apart_share"], v["rms_m"]) for n, v in others.items() if v["apart_share"] is not None]
    if not known:
        return None
    name, share, rms = max(known, key=lambda entry: (entry[1] or 0.0, entry[2] or 0.0))
    return name, float(share or 0.0), float(rms or 0.0)


def _fit_cell(kind: str) -> Callable[[Vehicle], Text]:
    def cell(vehicle: Vehicle) -> Text:
        fit = vehicle[kind]
        if not fit["compared"]:
            return Text("–")
        mean = fit["nis_per_dof"]
        text = f"{'∞' if mean is None else number_text(mean)} ({fit['compared']})"
        if mean is None or mean > OVERCONFIDENT_NIS:
            return Text(f"▲ {text}", style="bold red")
        return Text(f"▽ {text}", style="yellow") if mean < CONSERVATIVE_NIS else Text(text)

    return cell


def _jump_cell(vehicle: Vehicle) -> Text:
    fit = vehicle["fix"]
    if fit["median_jump_m"] is None:
        return Text("–")
    return Text(f"{number_text(fit['median_jump_m'])} / {number_text(fit['largest_jump_m'])}")


def _sigma_cell(vehicle: Vehicle) -> Text:
    sigma = vehicle["sigma_m"]
    return Text(f"{number_text(sigma['median'])} / {number_text(sigma['final'])}")


def _gated(vehicle: Vehicle) -> dict[str, int]:
    names = {"fix": "fix", "water_depth": "sounding", "reception": "packet", "acoustic_fix": "acoustic fix"}
    counts = {
        names.get(kind, kind): outcome["gated"] + outcome["rejected"]
        for kind, outcome in vehicle["outcomes"].items()
    }
    return {kind: count for kind, count in counts.items() if count}


def _gated_cell(vehicle: Vehicle) -> Text:
    return Text(", ".join(f"{count} {kind}" for kind, count in _gated(vehicle).items()) or "0")


def _apart_cell(vehicle: Vehicle) -> Text:
    apart = vehicle["apart"]
    return Text("–" if apart is None or apart[1] < 0.005 else f"{apart[1]:.0%} {apart[0]}")


def _held_out_cell(vehicle: Vehicle) -> Text:
    held = vehicle["held_out"]
    if not held:
        return Text("–")
    return Text(f"{number_text(held['rms_m'])} ({number_text(held['sigma_m'])})")


def _held_out_nees_cell(vehicle: Vehicle) -> Text:
    held = vehicle["held_out"]
    if not held or held["nees"] is None:
        return Text("–")
    text = number_text(held["nees"])
    if held["nees"] > 2 * OVERCONFIDENT_NIS:
        return Text(f"▲ {text}", style="bold red")
    return Text(f"▽ {text}", style="yellow") if held["nees"] < 2 * CONSERVATIVE_NIS else Text(text)


_COLUMNS: dict[str, tuple[Callable[[Vehicle], Text], Callable[[Vehicle], bool]]] = {
    "σ median\n/ final\n(m)": (_sigma_cell, lambda v: True),
    "held out\nrms (σ)\n(m)": (_held_out_cell, lambda v: bool(v["held_out"])),
    "held out\nNEES\n(2)": (_held_out_nees_cell, lambda v: bool(v["held_out"])),
    **{
        f"NIS\n{_NAMES[kind]}\n(1)": (_fit_cell(kind), lambda v, kind=kind: v[kind]["compared"] > 0)  # type: ignore[misc]
        for kind in DEGREES
    },
    "jump at fix\nmed. / max\n(m)": (_jump_cell, lambda v: v["fix"]["median_jump_m"] is not None),
    "gated or\nrejected": (_gated_cell, lambda v: bool(_gated(v))),
    "apart": (_apart_cell, lambda v: v["apart"] is not None and v["apart"][1] > 0),
}
