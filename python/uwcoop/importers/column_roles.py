"""Which column of a table holds what, by its name: the name without its unit, and the unit that it states."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

__all__ = ["Roles", "assign_roles", "is_unit", "split_label"]

_UNITS = (
    "m", "meter", "meters", "metre", "metres", "km", "dm", "cm", "mm", "ft", "feet", "foot", "us ft", "fathom",
    "fathoms", "deg", "degree", "degrees", "decimal degrees", "dd", "degrees north", "degrees east",
    "degree north", "degree east", "rad", "radians", "s", "sec", "secs", "second", "seconds", "ms", "msec",
    "millisecond", "milliseconds", "us", "usec", "microsecond", "microseconds", "ns", "nsec", "nanosecond",
    "nanoseconds", "utc", "m s", "m s 1", "mps", "meters below sea level", "metres below sea level",
    "seconds since 1970 01 01t00:00:00z", "seconds since 1970 01 01 00:00:00", "days",
)  # fmt: skip
_KNOWN = frozenset(_UNITS)
_TRAILING = re.compile(
    r" (?:in )?("
    + "|".join(sorted((u for u in _UNITS if u not in ("dd", "utc")), key=len, reverse=True))
    + r")$"
)
_BRACKETS = re.compile(r"[(\[{]([^)\]}]*)[)\]}]")
_OF_OTHERS = {
    "sigma", "std", "stdev", "sd", "error", "err", "uncertainty", "accuracy", "precision", "quality", "qc",
    "qf", "flag", "count", "id", "index", "no", "number", "vehicle", "sensor", "auv", "own", "instrument",
    "transducer", "keel", "draft", "draught", "rate", "velocity", "speed", "min", "max", "start", "end",
    "first", "last", "hdop", "pdop", "type", "source", "datum", "offset", "correction", "corr", "tvu",
    "thu", "fix",
}  # fmt: skip
"""Words that make a name another quantity's: "depth sigma", "sensor depth"."""


@dataclass(frozen=True)
class Roles:
    """Which column plays which role."""

    place: dict[str, int]
    """Role to column, from 0."""
    guessed: dict[str, str]
    """Role to the label of which one word told it: to be said in a note."""


def split_label(label: str) -> tuple[str, str]:
    """A column's name without its unit, in lower case with single blanks, and the unit as it is written.

    "Depth (m)" gives ("depth", "m"), "Depth_in_Feet" ("depth", "feet"), "Longitude (°)" ("longitude", "°"),
    "WaterDepth" ("water depth", "").
    """
    unit = ""
    # "Longitude (°)": the brackets of a name hold its unit, if anything of it.
    for inside in _BRACKETS.findall(label):
        if is_unit(inside):
            unit = inside.strip()
    spaced = re.sub(r"(?<=[a-zà-ÿ])(?=[A-Z][a-z])", " ", _BRACKETS.sub(" ", label))
    plain = re.sub(r"[\s_.\-/:]+", " ", spaced.lower()).strip()
    plain = plain.replace("°", "").strip()
    if not unit and (found := _TRAILING.search(plain)):
        unit, plain = found.group(1), plain[: found.start()]
    return plain.strip(), unit


def is_unit(text: str) -> bool:
    """Whether a text is the name of a unit."""
    plain = re.sub(r"[\s_.\-/^]+", " ", text.lower().replace("µ", "u").replace("μ", "u")).strip()
    return plain in _KNOWN or text.strip() in ("°", "º", "'", "°N", "°E") or plain.startswith("seconds since")


def assign_roles(labels: Sequence[str], names: Mapping[str, Collection[str]]) -> Roles:
    """The columns of known names, whatever else a table holds.

    A name that is known, its unit aside, plays its role; the first of two for one role. For a role that nobody
    plays so, the only name that holds one of its words of three letters or more will do ("Corrected Depth"),
    unless another word says that it is something else ("depth sigma").

    Args:
        labels: the header's names.
        names: role to names in lower case with single blanks.
    """
    bare = [split_label(label)[0] for label in labels]
    place: dict[str, int] = {}
    for k, name in enumerate(bare):
        role = next((role for role, known in names.items() if name in known), None)
        if role is not None:
            place.setdefault(role, k)
    guessed: dict[str, str] = {}
    for role, known in names.items():
        words = {word for word in known if len(word) >= 3}
        others = {word for other, known in names.items() if other != role for word in known if len(word) >= 3}
        held = [
            k
            for k, name in enumerate(bare)
            if k not in place.values()
            and (parts := set(name.split())) & words
            and not parts & (_OF_OTHERS | others)
        ]
        if role not in place and len(held) == 1:
            place[role], guessed[role] = held[0], labels[held[0]]
    return Roles(place, guessed)
