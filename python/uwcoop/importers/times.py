"""One parser of the times that files hold: numbers of any unit, ISO 8601, date and time of day, time of day alone.

    times = parse_times(["1700000000.5", "1700000001.5"])      # seconds since 1970, told by their size
    times = parse_times(cells, unit="ms")                      # as the column's name states
    times = parse_times(clocks, dates=days)                    # two columns
    times.t_ns, times.absolute, times.how

Numbers become nanoseconds exactly, through decimal arithmetic: a float64 of nanoseconds since 1970 is 256 ns coarse.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from decimal import Decimal, InvalidOperation
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.errors import TableError

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["Times", "looks_like_time", "parse_times", "time_unit"]

NS_PER_UNIT = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}
_NAMES = {"s": "seconds", "ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}
_UNIT_WORDS = {
    "s": {"s", "sec", "secs", "second", "seconds", "unix", "posix", "epoch"},
    "ms": {"ms", "msec", "msecs", "millisecond", "milliseconds", "millis"},
    "us": {"us", "µs", "μs", "usec", "usecs", "microsecond", "microseconds", "micros"},
    "ns": {"ns", "nsec", "nsecs", "nanosecond", "nanoseconds", "nanos"},
}
_FIRST_YEAR_S, _LAST_YEAR_S = 315_532_800, 4_102_444_800
"""1980 to 2100: numbers in this range since 1970 are instants; in no two of the four units is one number in it."""
_DAY_NS = 86_400 * 10**9
_LONGEST_STEP_S, _SHORTEST_STEP_S = 100.0, 1e-4
"""Median steps of a record in seconds; numbers without a unit that step by more or less are of another unit."""
_CLOCK = r"(\d{1,2}):(\d{2})(?::(\d{2})(?:[.,](\d+))?)?\s*([AaPp]\.?[Mm]\.?)?"
_TIME_OF_DAY = re.compile(_CLOCK + r"(Z|\s*UTC)?$")
_DATE = re.compile(r"(\d{1,4})([/.\-])(\d{1,2}|[A-Za-z]{3,9})\2(\d{1,4})$")
_COMPACT = re.compile(r"(\d{4})(\d{2})(\d{2})[T_ ]?(\d{2})(\d{2})(\d{2})(?:\.(\d+))?Z?$")
_ZONE = re.compile(r"\s*(Z|UTC|GMT|[+-]\d{2}:?\d{2})$")
_LOOKS = re.compile(
    r"\d{4}-\d\d?-\d\d?([T ]|$)|\d{1,4}[/.]\d{1,2}[/.]\d{1,4}([T ]|$)|\d{1,2}-\w{3,9}-\d{2,4}|\d{1,2}:\d{2}(:|$| )"
    r"|\d{8}T\d{4}"
)
_MONTHS = {
    "jan": 1, "feb": 2, "mar": 3, "apr": 4, "may": 5, "jun": 6,
    "jul": 7, "aug": 8, "sep": 9, "oct": 10, "nov": 11, "dec": 12,
}  # fmt: skip


@dataclass(frozen=True)
class Times:
    """Instants, as far as cells tell them."""

    t_ns: NDArray[np.int64]
    """(N,) nanoseconds since 1970-01-01 UTC if `absolute`, else since a zero of the file's own."""
    absolute: bool
    how: str
    """In which form they were, and what was assumed: one sentence for a note."""

    @property
    def seconds(self) -> NDArray[np.float64]:
        """(N,) seconds since the first instant in time."""
        return (self.t_ns - self.t_ns.min()) / 1e9 if self.t_ns.size else np.zeros(0)


def looks_like_time(cell: str) -> bool:
    """Whether a cell is a date or a time of day, which a number is not."""
    return bool(_LOOKS.match(cell))


def time_unit(text: str) -> str:
    """The unit "s", "ms", "us" or "ns" that a text states ("time_ms", "seconds since 1970-01-01"); "" for none."""
    words = re.split(r"[^a-zµμ]+", text.lower())
    return next((unit for unit, names in _UNIT_WORDS.items() if names & set(words)), "")


def parse_times(
    cells: Sequence[str], *, unit: str = "", dates: Sequence[str] | None = None, label: str = "time"
) -> Times:
    """Instants of cells, (N,).

    Numbers have the unit stated; where none is, the one in which they fall between 1980 and 2100, since those ranges
    do not overlap. Numbers outside of all of them count from a zero of their own, in seconds if they step as a record
    in seconds does, and are refused otherwise. A date without a zone is UTC. Of 3/4/2024 month and day are told by
    the column's other dates, and refused where none tells. A time of day alone runs on past midnight.

    Args:
        cells: as the file has them; none empty.
        unit: "s", "ms", "us" or "ns", or any text of which `time_unit` finds it; "": find it.
        dates: (N,) dates of `cells`, which are then times of day.
        label: the column's name, for messages.

    Raises:
        TableError: a cell that is no time, mixed forms, or a unit or order that the cells leave in doubt.
    """
    texts = [cell.strip() for cell in cells]
    if dates is not None:
        texts = [f"{day.strip()} {clock}" for day, clock in zip(dates, texts, strict=True)]
    if not texts:
        return Times(np.zeros(0, np.int64), False, "no times")
    try:
        numbers = [Decimal(text) for text in texts]
    except InvalidOperation:
        return _of_texts(texts, label)
    wrong = next((k for k, number in enumerate(numbers) if not number.is_finite()), None)
    if wrong is not None:
        raise TableError(f"column {label!r} holds {texts[wrong]!r} in data row {wrong + 1}: no time")
    return _of_numbers(numbers, unit, label)


def _of_numbers(numbers: list[Decimal], stated: str, label: str) -> Times:
    unit = stated if stated in NS_PER_UNIT else time_unit(stated) or time_unit(label)
    middle = sorted(abs(n) for n in numbers)[len(numbers) // 2]
    fits = next((u for u, ns in NS_PER_UNIT.items() if _is_instant(middle, ns)), "")
    if unit and fits and fits != unit:
        raise TableError(
            f"column {label!r} states {_NAMES[unit]}, but {middle:f} since 1970 is a date in {_NAMES[fits]}"
        )
    absolute = bool(fits)
    if fits:
        how = f"{_NAMES[fits]} since 1970-01-01 UTC" + ("" if unit else ", told by their size")
    elif unit:
        how = f"{_NAMES[unit]} since a zero of the file's own"
    else:
        how = "unit of time not stated: seconds assumed, as their steps suggest"
        _refuse_odd_steps(numbers, label)
    scale = NS_PER_UNIT[fits or unit or "s"]
    try:
        t_ns = np.array([int((n * scale).to_integral_value()) for n in numbers], dtype=np.int64)
    except OverflowError as error:
        raise TableError(f"column {label!r} holds {max(numbers, key=abs)}: no time") from error
    return Times(t_ns, absolute, how)


def _is_instant(number: Decimal, ns_per_unit: int) -> bool:
    return _FIRST_YEAR_S <= number * ns_per_unit / 10**9 < _LAST_YEAR_S


def _refuse_odd_steps(numbers: list[Decimal], label: str) -> None:
    """A record steps by milliseconds to some seconds: other steps say that the unit is another."""
    values = np.array([float(n) for n in numbers])
    steps = np.abs(np.diff(values))
    steps = steps[steps > 0]
    middle = float(np.median(steps)) if steps.size else 1.0
    if not _SHORTEST_STEP_S <= middle <= _LONGEST_STEP_S:
        raise TableError(
            f"column {label!r} holds {values.min():g} to {values.max():g} in steps of {middle:g} and states no unit: "
            "name it, as time_s, time_ms, time_us or time_ns"
        )


def _of_texts(texts: list[str], label: str) -> Times:
    if all(_TIME_OF_DAY.match(text) for text in texts):
        return _times_of_day(texts, label)
    split = [_date_and_rest(text) for text in texts]
    month_first = _month_first([date for date, _ in split if date is not None], label)
    t_ns = np.empty(len(texts), dtype=np.int64)
    zoned = 0
    for k, (text, (date, rest)) in enumerate(zip(texts, split, strict=True)):
        try:
            t_ns[k], has_zone = _instant(text, date, rest, month_first)
        except (ValueError, OverflowError) as error:
            raise TableError(f"column {label!r} holds {text!r} in data row {k + 1}: no time") from error
        zoned += has_zone
    if 0 < zoned < len(texts):
        raise TableError(
            f"column {label!r} states a time zone in {zoned} of {len(texts)} rows: in all or none"
        )
    return Times(t_ns, True, "dates with times of day" + ("" if zoned else ", zone not stated: UTC assumed"))


Parts = tuple[str, str, str]


def _date_and_rest(text: str) -> tuple[Parts | None, str]:
    """The three parts of a date as written, and the time of day; None for what is no date of three parts."""
    first, _, rest = text.replace("T", " ", 1).partition(" ") if not text[:1].isalpha() else (text, "", "")
    found = _DATE.match(first.rstrip(","))
    return (None, text) if found is None else ((found.group(1), found.group(3), found.group(4)), rest.strip())


def _month_first(dates: list[Parts], label: str) -> bool:
    """Whether 3/4/2024 is the 4th of March; told by a part above 12 anywhere in the column."""
    open_ones = [date for date in dates if len(date[0]) < 3 and date[1].isdigit()]
    if not open_ones:
        return False
    first, second = (max(int(date[k]) for date in open_ones) for k in (0, 1))
    if first > 12 and second > 12:
        raise TableError(f"column {label!r} mixes dates of day/month and month/day")
    if first <= 12 and second <= 12:
        example = "/".join(open_ones[0])
        raise TableError(
            f"column {label!r} does not tell day and month of {example} apart: write dates as 2024-03-31"
        )
    return second > 12


def _instant(text: str, date: Parts | None, rest: str, month_first: bool) -> tuple[int, bool]:
    """Nanoseconds since 1970 UTC, and whether the text states its zone."""
    if date is None:
        compact = _COMPACT.match(text)
        if compact is None:
            raise ValueError(text)
        year, month, day, hour, minute, second = (int(part) for part in compact.groups()[:6])
        return _ns(datetime(year, month, day, hour, minute, second, tzinfo=UTC), compact.group(7)), text[
            -1
        ] == "Z"
    a, b, c = date
    if len(a) == 4:
        year, month_text, day = int(a), b, int(c)
    else:
        year = int(c) if len(c) == 4 else 2000 + int(c)
        month_text, day = (a, int(b)) if month_first else (b, int(a))
    month = int(month_text) if month_text.isdigit() else _MONTHS.get(month_text[:3].lower(), 0)
    zone = _ZONE.search(rest)
    clock = rest[: zone.start()] if zone else rest
    midnight = datetime(year, month, day, tzinfo=UTC)
    offset = 0
    if zone and zone.group(1)[0] in "+-":
        digits = zone.group(1).replace(":", "")
        offset = int(digits[0] + "1") * (int(digits[1:3]) * 3600 + int(digits[3:5]) * 60) * 10**9
    return _ns(midnight, None) + (_clock_ns(clock.strip()) if clock.strip() else 0) - offset, zone is not None


def _ns(instant: datetime, fraction: str | None) -> int:
    since = instant - datetime(1970, 1, 1, tzinfo=UTC)
    return (since.days * 86_400 + since.seconds) * 10**9 + int(((fraction or "") + "0" * 9)[:9])


def _clock_ns(text: str) -> int:
    """Nanoseconds since midnight of a time of day."""
    found = _TIME_OF_DAY.match(text)
    if found is None:
        raise ValueError(text)
    hour, minute, second = int(found.group(1)), int(found.group(2)), int(found.group(3) or 0)
    half = (found.group(5) or "").lower()[:1]
    if hour > (12 if half else 23) or minute > 59 or second > 60:
        raise ValueError(text)
    if half:
        hour = hour % 12 + (12 if half == "p" else 0)
    return (hour * 3600 + minute * 60 + second) * 10**9 + int(((found.group(4) or "") + "0" * 9)[:9])


def _times_of_day(texts: list[str], label: str) -> Times:
    t_ns = np.empty(len(texts), dtype=np.int64)
    for k, text in enumerate(texts):
        try:
            t_ns[k] = _clock_ns(text)
        except ValueError as error:
            raise TableError(
                f"column {label!r} holds {text!r} in data row {k + 1}: no time of day"
            ) from error
    # A step back of more than half a day is midnight; any other is the file's disorder, which its reader judges.
    midnights = np.concatenate([[0], np.cumsum(np.diff(t_ns) < -_DAY_NS // 2)])
    past = f", {midnights[-1]} midnights passed" if midnights[-1] else ""
    return Times(t_ns + midnights * _DAY_NS, False, f"times of day without a date{past}")
