"""Unit and sign of a file's depths.

A chart that is read upside down or in feet still looks like a chart, so nothing here is silent: what a file
states is used and noted, what it does not state is found or assumed and noted, and what contradicts itself is refused.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.charts.plausible import without_fills, without_impossible
from uwcoop.errors import ChartError

if TYPE_CHECKING:
    from numpy.typing import NDArray

METRES_PER_UNIT = {"m": 1.0, "ft": 0.3048, "fathom": 1.8288}
_UNIT_NAMES = {
    "m": {"m", "meter", "meters", "metre", "metres", "meters below sea level", "metres below sea level"},
    "ft": {
        "ft",
        "foot",
        "feet",
        "us survey foot",
        "us survey feet",
        "us ft",
        "ftus",
        "foot us",
        "international foot",
        "international feet",
    },
    "fathom": {"fathom", "fathoms", "fm", "ftm"},
}
_UP_NAMES = ("elevation", "altitude", "height", "topograph", "elev")
_DOWN_NAMES = ("depth", "sounding", "bathymetric depth")


@dataclass(frozen=True)
class Stated:
    """A file's statements on its vertical numbers, unchanged; empty strings where it states nothing.

    `positive` is the CF attribute "up" or "down" or a standard name, which are taken at their word; `hint` is
    a variable's name or long name, which the values' sign may overrule.
    """

    unit: str = ""
    positive: str = ""
    standard_name: str = ""
    hint: str = ""


def depths_from(
    values: NDArray[Any],
    stated: Stated,
    positive: str | None,
    depth_unit: str | None,
    *,
    nodata: float | None = None,
    counted: str = "nodes",
) -> tuple[NDArray[Any], tuple[str, ...]]:
    """Depths in metres, positive down, NaN where there is no water, and notes on how they were found.

    Args:
        values: the file's numbers, any shape; NaN where it has none.
        stated: what the file says about them.
        positive: "up" or "down" overrides the file; None believes it.
        depth_unit: "m", "ft" or "fathom" overrides the file; None believes it.
        nodata: a number of the file that means "no data", beside those that are found.
        counted: what a value belongs to, for notes.

    Raises:
        ChartError: no numbers; an unknown unit; nothing under water.
    """
    factor, unit_note = metres_per_unit(stated.unit, depth_unit)
    values, fill_notes = without_fills(values, factor, nodata, counted)
    downwards, sign_note = _is_downwards(values, stated, positive)
    depth = values * np.asarray(factor if downwards else -factor, dtype=values.dtype)
    depth, height_notes = without_impossible(depth, counted)
    notes = [unit_note, sign_note, *fill_notes, *height_notes]
    with np.errstate(invalid="ignore"):
        dry = depth <= 0
    if dry.any():
        share = dry.sum() / np.isfinite(depth).sum()
        if share == 1:
            raise ChartError(
                f"chart values {np.nanmin(values):g} to {np.nanmax(values):g} leave no depth below the "
                f"surface when read as positive {'down' if downwards else 'up'}: give positive='up' or 'down'"
            )
        depth = np.where(dry, np.nan, depth)
        notes.append(f"{100 * share:.2g} % of the {counted} lie at or above the surface: made holes")
    if not np.isfinite(depth).any():
        raise ChartError(f"chart of {values.size} values holds no depth: all are holes")
    return depth, tuple(notes)


def unit_of(text: str) -> str:
    """The unit as m, ft or fathom, however a file writes it; otherwise the text itself, lower case."""
    plain = re.sub(r"[^a-z ]+", " ", text.lower()).strip()
    return next((unit for unit, names in _UNIT_NAMES.items() if plain in names), plain)


def metres_per_unit(stated: str, asked: str | None) -> tuple[float, str]:
    """Metres of one unit of a file's numbers, as asked or as the file states, and a note on who said so.

    Raises:
        ChartError: a unit that is unknown.
    """
    unit = unit_of(stated)
    if asked is not None:
        if asked not in METRES_PER_UNIT:
            raise ChartError(f"depth_unit {asked!r} is unknown: choose m, ft or fathom")
        against = f", against the file's {stated!r}" if unit and unit != asked else ""
        return METRES_PER_UNIT[asked], f"depth unit {asked} as asked{against}"
    if not unit:
        return 1.0, "depth unit not stated: metres assumed"
    if unit == "m":
        return 1.0, "depth unit stated: metres"
    if unit in METRES_PER_UNIT:
        return METRES_PER_UNIT[unit], f"depth unit stated: {stated}, converted to metres"
    raise ChartError(f"depth unit {stated!r} is unknown: give depth_unit as m, ft or fathom")


def _is_downwards(values: NDArray[Any], stated: Stated, asked: str | None) -> tuple[bool, str]:
    """Whether numbers grow downwards, and a note on who said so."""
    if asked is not None:
        if asked not in ("up", "down"):
            raise ChartError(f"positive {asked!r} is unknown: choose up or down")
        return asked == "down", f"positive {asked} as asked"
    positive = stated.positive.strip().lower()
    if positive in ("up", "down"):
        return positive == "down", f"positive {positive}: stated by the attribute positive"
    standard = direction_of(stated.standard_name)
    if standard:
        return (
            standard == "down",
            f"positive {standard}: stated by the standard name {stated.standard_name!r}",
        )
    by_sign = "up" if float(np.nanmedian(values)) < 0 else "down"
    hint = direction_of(stated.hint)
    if hint == by_sign:
        return hint == "down", f"positive {hint}: named {stated.hint!r}, and the values agree"
    if hint == "up" and (values > 0).any() and (values < 0).any():
        return False, f"positive up: named {stated.hint!r}; most of it is land"
    because = f"the median value is {float(np.nanmedian(values)):.3g}"
    against = f", although it is named {stated.hint!r}" if hint else ""
    return by_sign == "down", f"positive {by_sign}: not stated, found because {because}{against}"


def direction_of(name: str) -> str:
    """ "up" or "down" as a quantity's name tells it: elevation, depth; "" for any other."""
    plain = name.lower()
    if any(word in plain for word in _UP_NAMES):
        return "up"
    return "down" if any(word in plain for word in _DOWN_NAMES) else ""
