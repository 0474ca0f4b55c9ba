"""Devices say times of day; a mission has one scale of time."""

from __future__ import annotations

__all__ = ["mission_ns_of_day"]

_SECOND_NS = 1_000_000_000
_DAY_NS = 86_400 * _SECOND_NS


def mission_ns_of_day(text: str, now_ns: int, epoch_ns: int) -> int:
    """Mission time of a time of day, HHMMSS or HHMMSS.s… UTC: the one that is nearest to now.

    Args:
        text: as the device says it.
        now_ns: mission time.
        epoch_ns: UNIX time of mission time 0.

    Raises:
        ValueError: not of this form.
    """
    whole, _, fraction = text.partition(".")
    digits = whole + fraction
    if len(whole) != 6 or not (digits.isascii() and digits.isdigit()):
        raise ValueError(f"time of day {text!r} is not HHMMSS.s")
    hours, minutes, seconds = int(whole[:2]), int(whole[2:4]), int(whole[4:])
    if hours > 23 or minutes > 59 or seconds > 60:
        raise ValueError(f"time of day {text!r} is outside 000000 to 235960")
    of_day_ns = (hours * 3600 + minutes * 60 + seconds) * _SECOND_NS
    of_day_ns += int(fraction[:9].ljust(9, "0") if fraction else 0)
    day_ns = (now_ns + epoch_ns - of_day_ns + _DAY_NS // 2) // _DAY_NS * _DAY_NS
    return day_ns + of_day_ns - epoch_ns
