"""Sentences of navigation sensors, and what they measure in SI units: NMEA 0183, and the PD6 lines of DVLs.

| sentence | what is read of it |
|---|---|
| GGA, RMC | position (WGS 84), UTC; RMC also speed and course |
| VTG | speed over ground, course |
| HDT | true heading |
| HDG | magnetic heading, with the sensor's deviation added; variation where it is there |
| DBT, DPT | distance from the transducer to the seabed; DPT also the transducer's offset |
| PNORBT4 (Nortek) | speed over ground, its direction, distance to the seabed |
| DVPDL, DVPDX (Cerulean) | distance moved forward and right since the last one; confidence |
| :TS, :BS, :BE, :BD (PD6) | depth; velocity forward and to starboard; east and north; distance to the seabed |

NMEA sentences without a checksum, or with a wrong one, are refused. PD6 has none: a line must have its exact form.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import reduce
from operator import xor
from typing import Any

from uwcoop.errors import MissingDependencyError

__all__ = ["SENTENCES", "Reading", "SentenceError", "parse", "require_parser"]

KNOT_MPS = 1852 / 3600
FOOT_M = 0.3048
FATHOM_M = 1.8288
SENTENCES = (
    "GGA", "RMC", "VTG", "HDT", "HDG", "DBT", "DPT", "PNORBT4", "DVPDL", "DVPDX", ":TS", ":BS", ":BE", ":BD",
)  # fmt: skip


class SentenceError(ValueError):
    """A sentence that is damaged, or says that it measures nothing."""


@dataclass(frozen=True)
class Reading:
    """What one sentence says; NaN or "" where it says nothing."""

    sentence: str
    utc: str = ""
    """Time of day, HHMMSS.s."""
    latitude_deg: float = math.nan
    longitude_deg: float = math.nan
    hdop: float = math.nan
    speed_mps: float = math.nan
    course_deg: float = math.nan
    """Clockwise from true north."""
    heading_deg: float = math.nan
    magnetic: bool = False
    """Whether `heading_deg` is from magnetic north."""
    variation_deg: float = math.nan
    """Declination that the sensor states, positive to the east."""
    below_m: float = math.nan
    """From the transducer to the seabed."""
    offset_m: float = math.nan
    """Of the transducer: positive, below the surface; negative, above the keel."""
    forward_mps: float = math.nan
    left_mps: float = math.nan
    east_mps: float = math.nan
    north_mps: float = math.nan
    """By the north of the sensor."""
    depth_m: float = math.nan


def require_parser() -> None:
    """Raise `MissingDependencyError` unless pynmeagps is installed."""
    try:
        import pynmeagps  # noqa: F401
    except ImportError:
        raise MissingDependencyError("pynmeagps", "live") from None


def parse(line: str) -> Reading | None:
    """What a line says; None for a sentence that is not one of `SENTENCES`.

    Raises:
        SentenceError: no sentence, a checksum that is missing or wrong, a field that is none, or a sensor without a
            measurement.
    """
    if line.startswith(":"):
        return _pd6(line)
    body, star, checksum = line[1:].partition("*")
    if not line.startswith("$") or not star:
        raise SentenceError("no NMEA sentence with a checksum")
    found = f"{reduce(xor, body.encode('ascii', 'replace'), 0):02X}"
    if checksum.strip().upper() != found:
        raise SentenceError(f"checksum is {checksum.strip()[:4]!r}, of the content {found}")
    fields = body.split(",")
    if own := _OWN.get(fields[0]):
        return own(fields)
    kind = fields[0][-3:]
    if kind not in _STANDARD or fields[0].startswith("P") or len(fields[0]) != 5:
        return None
    return _STANDARD[kind](_standard(line), fields)


class _Said(dict[str, Any]):
    """Fields of a sentence by name; one that is not there is empty."""

    def __getattr__(self, name: str) -> Any:
        return self.get(name, "")


def _standard(line: str) -> _Said:
    from pynmeagps import NMEAReader
    from pynmeagps.exceptions import NMEAMessageError, NMEAParseError, NMEATypeError

    try:
        return _Said(vars(NMEAReader.parse(line.strip() + "\r\n")))
    except (NMEAMessageError, NMEAParseError, NMEATypeError, ValueError, IndexError, TypeError) as error:
        raise SentenceError(str(error)) from None


def _number(value: Any, what: str) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise SentenceError(f"{what} is {str(value)[:20]!r}") from None
    if not math.isfinite(number):
        raise SentenceError(f"{what} is {number}")
    return number


def _perhaps(value: Any, what: str) -> float:
    return math.nan if value in ("", None) else _number(value, what)


def _place(said: _Said) -> tuple[float, float]:
    latitude_deg, longitude_deg = _number(said.lat, "latitude"), _number(said.lon, "longitude")
    if abs(latitude_deg) > 90 or abs(longitude_deg) > 180:
        raise SentenceError(f"position {latitude_deg}, {longitude_deg} deg is not on the Earth")
    return latitude_deg, longitude_deg


def _gga(said: _Said, fields: list[str]) -> Reading:
    if _number(said.quality, "fix quality") == 0:
        raise SentenceError("no fix")
    return Reading("GGA", fields[1], *_place(said), hdop=_perhaps(said.HDOP, "HDOP"))


def _rmc(said: _Said, fields: list[str]) -> Reading:
    if said.status != "A":
        raise SentenceError("no fix")
    speed_mps, course_deg = _perhaps(said.spd, "speed") * KNOT_MPS, _perhaps(said.cog, "course")
    return Reading("RMC", fields[1], *_place(said), speed_mps=speed_mps, course_deg=course_deg)


def _vtg(said: _Said, fields: list[str]) -> Reading:
    if fields[9:10] == ["N"]:
        raise SentenceError("no fix")
    speed_mps = _number(said.sogn, "speed") * KNOT_MPS
    return Reading("VTG", speed_mps=speed_mps, course_deg=_number(said.cogt, "true course"))


def _hdt(said: _Said, fields: list[str]) -> Reading:
    return Reading("HDT", heading_deg=_number(said.headingT, "heading"))


def _hdg(said: _Said, fields: list[str]) -> Reading:
    deviation_deg = _signed(said.deviation, said.deviationEW, "deviation")
    heading_deg = _number(said.headingM, "heading") + (0.0 if math.isnan(deviation_deg) else deviation_deg)
    variation_deg = _signed(said.variation, said.variationEW, "variation")
    return Reading("HDG", heading_deg=heading_deg, magnetic=True, variation_deg=variation_deg)


def _signed(value: Any, side: str, what: str) -> float:
    """East is positive."""
    if value in ("", None):
        return math.nan
    if side not in ("E", "W"):
        raise SentenceError(f"{what} is to the side {side!r}: must be E or W")
    return _number(value, what) * (1 if side == "E" else -1)


def _dbt(said: _Said, fields: list[str]) -> Reading:
    for value, unit_m in ((said.depthm, 1.0), (said.depthf, FOOT_M), (said.depthfath, FATHOM_M)):
        if value not in ("", None):
            return Reading("DBT", below_m=_number(value, "depth below the transducer") * unit_m)
    raise SentenceError("no depth")


def _dpt(said: _Said, fields: list[str]) -> Reading:
    below_m = _number(said.depth, "depth below the transducer")
    return Reading("DPT", below_m=below_m, offset_m=_perhaps(said.offset, "offset"))


_STANDARD = {"GGA": _gga, "RMC": _rmc, "VTG": _vtg, "HDT": _hdt, "HDG": _hdg, "DBT": _dbt, "DPT": _dpt}


def _pnorbt4(fields: list[str]) -> Reading:
    if len(fields) != 7:
        raise SentenceError(f"PNORBT4 has {len(fields)} fields: must be 7")
    speed_mps, course_deg = _number(fields[3], "speed"), _number(fields[4], "direction")
    if speed_mps < 0:
        raise SentenceError("no bottom track")
    below_m = _number(fields[6], "distance")
    return Reading("PNORBT4", speed_mps=speed_mps, course_deg=course_deg, below_m=below_m or math.nan)


def _dvpd(fields: list[str]) -> Reading:
    wanted = 10 if fields[0] == "DVPDL" else 14
    if len(fields) != wanted:
        raise SentenceError(f"{fields[0]} has {len(fields)} fields: must be {wanted}")
    interval_s = _number(fields[2], "interval") * 1e-6
    if interval_s <= 0 or _number(fields[9], "confidence") <= 0:
        raise SentenceError("no bottom track")
    forward_mps, right_mps = (_number(fields[k], "position delta") / interval_s for k in (6, 7))
    return Reading(fields[0], forward_mps=forward_mps, left_mps=-right_mps)


_OWN = {"PNORBT4": _pnorbt4, "DVPDL": _dvpd, "DVPDX": _dvpd}

_INTEGER, _REAL = r"([+-]?\d{1,6})", r"([+-]?\d{1,9}\.\d{1,3})"
_PD6 = {
    ":TS": re.compile(rf":TS,(\d{{14,16}}),{_REAL},{_REAL},{_REAL},{_REAL},(\d{{1,3}})"),
    ":BS": re.compile(rf":BS,{_INTEGER},{_INTEGER},{_INTEGER},([AV])"),
    ":BE": re.compile(rf":BE,{_INTEGER},{_INTEGER},{_INTEGER},([AV])"),
    ":BD": re.compile(rf":BD,{_REAL},{_REAL},{_REAL},{_REAL},{_REAL}"),
}


def _pd6(line: str) -> Reading | None:
    """Teledyne RDI's PD6: velocities in mm/s; transverse is positive to starboard, status A is good."""
    kind = line[:3]
    if kind not in _PD6:
        return None
    squeezed = line.replace(" ", "")
    found = _PD6[kind].fullmatch(squeezed)
    if found is None or not line.isascii():
        raise SentenceError(f"{kind} has not its form")
    values = found.groups()
    if kind == ":TS":
        return Reading(":TS", depth_m=float(values[3]))
    if kind == ":BD":
        if float(values[3]) <= 0:
            raise SentenceError("no distance to the seabed")
        return Reading(":BD", below_m=float(values[3]))
    first_mps, second_mps = int(values[0]) / 1000, int(values[1]) / 1000
    if values[3] != "A" or abs(first_mps) > 30 or abs(second_mps) > 30:  # -32768: no bottom track
        raise SentenceError("no bottom track")
    if kind == ":BS":
        return Reading(":BS", forward_mps=second_mps, left_mps=-first_mps)
    return Reading(":BE", east_mps=first_mps, north_mps=second_mps)
