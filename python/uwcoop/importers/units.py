"""Units of recorded quantities, as factors to SI; angles to degrees, as people write them."""

from __future__ import annotations

from uwcoop.errors import LogError
from uwcoop.importers.column_roles import split_label
from uwcoop.scenario.base import nearest

__all__ = ["factor_of", "known_unit"]

FACTORS: dict[str, dict[str, float]] = {
    "length": {
        "m": 1.0, "meter": 1.0, "meters": 1.0, "metre": 1.0, "metres": 1.0, "km": 1000.0, "dm": 0.1, "cm": 0.01,
        "mm": 0.001, "ft": 0.3048, "feet": 0.3048, "foot": 0.3048, "us ft": 1200 / 3937, "fathom": 1.8288,
        "fathoms": 1.8288, "nmi": 1852.0,
    },
    "angle": {
        "deg": 1.0, "degree": 1.0, "degrees": 1.0, "°": 1.0, "dd": 1.0, "rad": 57.29577951308232,
        "radian": 57.29577951308232, "radians": 57.29577951308232, "cdeg": 0.01, "dge7": 1e-7, "dege7": 1e-7,
        "degrees north": 1.0, "degrees east": 1.0,
    },
    "rate": {"deg/s": 1.0, "degps": 1.0, "°/s": 1.0, "rad/s": 57.29577951308232, "radps": 57.29577951308232},
    "speed": {
        "m/s": 1.0, "mps": 1.0, "cm/s": 0.01, "mm/s": 0.001, "kn": 1852 / 3600, "kt": 1852 / 3600, "kts": 1852 / 3600,
        "knots": 1852 / 3600, "knot": 1852 / 3600, "km/h": 1 / 3.6, "ft/s": 0.3048,
    },
    "pressure": {
        "pa": 1.0, "hpa": 100.0, "mbar": 100.0, "kpa": 1e3, "mpa": 1e6, "bar": 1e5, "dbar": 1e4, "psi": 6894.757293168,
        "atm": 101_325.0,
    },
    "field": {"t": 1.0, "ut": 1e-6, "nt": 1e-9, "gauss": 1e-4, "mgauss": 1e-7},
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0},
    "number": {},
}  # fmt: skip
"""By dimension: unit in lower case to its factor."""


def known_unit(text: str, dimension: str) -> bool:
    """Whether a text names a unit of this dimension."""
    return text.strip().lower() in FACTORS[dimension]


def factor_of(unit: str, dimension: str, where: str) -> float:
    """The factor from a unit to the one that is used inside: metres, degrees, °/s, m/s, Pa, tesla, seconds.

    Raises:
        LogError: no unit of this dimension; with the nearest.
    """
    plain = unit.strip().lower()
    factors = FACTORS[dimension]
    if plain not in factors:
        raise LogError(f"{where}: unit {unit!r} is no unit of {dimension}: {nearest(plain, factors)}")
    return factors[plain]


def unit_of_label(label: str, dimension: str) -> str:
    """The unit that a column's name states, of this dimension; "" for none: "heading_deg", "vel (kn)", "alt [ft]"."""
    _, stated = split_label(label)
    if stated and known_unit(stated, dimension):
        return stated
    text = label.lower().replace("(", " ").replace(")", " ").replace("[", " ").replace("]", " ").strip()
    for last in (text.split()[-1:] or [""])[0], text.rsplit("_", 1)[-1]:
        if last != text and known_unit(last, dimension):
            return last
    return ""
