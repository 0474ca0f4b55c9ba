"""Times in every form that recorders write: one instant, one number."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from uwcoop.errors import TableError
from uwcoop.importers.times import looks_like_time, parse_times, time_unit

T0_NS = 1_700_000_000_000_000_000
INSTANTS = st.lists(st.integers(400_000_000_000, 4_000_000_000_000), min_size=2, max_size=9)  # ms since 1970


def stamp(ms: int) -> datetime:
    return datetime.fromtimestamp(ms // 1000, UTC).replace(microsecond=ms % 1000 * 1000)


@given(
    INSTANTS, st.sampled_from(["s", "ms", "us", "ns", "iso", "space", "zone", "compact", "us-date", "german"])
)
def test_one_instant_in_every_form(instants: list[int], form: str) -> None:
    # A day above 12, so that month and day can be told apart.
    instants = [*instants, 1_700_000_000_000 + 86_400_000 * 12]
    write = {
        "s": lambda ms: f"{ms // 1000}.{ms % 1000:03d}",
        "ms": str,
        "us": lambda ms: f"{ms * 1000}",
        "ns": lambda ms: f"{ms * 1_000_000}",
        "iso": lambda ms: stamp(ms).isoformat().replace("+00:00", "Z"),
        "space": lambda ms: stamp(ms).strftime("%Y/%m/%d %H:%M:%S.%f"),
        "zone": lambda ms: stamp(ms + 9_000_000).isoformat().replace("+00:00", "+02:30"),
        "compact": lambda ms: stamp(ms).strftime("%Y%m%dT%H%M%S.%f"),
        "us-date": lambda ms: stamp(ms).strftime("%m/%d/%Y %I:%M:%S.%f %p"),
        "german": lambda ms: stamp(ms).strftime("%d.%m.%Y %H:%M:%S.%f"),
    }[form]
    found = parse_times([write(ms) for ms in instants])
    assert found.absolute
    np.testing.assert_array_equal(found.t_ns, np.array(instants) * 1_000_000)


def test_nanoseconds_are_kept_exactly() -> None:
    assert parse_times(["1700000000123456789"]).t_ns[0] == T0_NS + 123_456_789
    assert parse_times(["1700000000.123456789"]).t_ns[0] == T0_NS + 123_456_789
    assert parse_times(["2023-11-14T22:13:20.123456789Z"]).t_ns[0] == T0_NS + 123_456_789


def test_a_stated_unit_counts_and_a_contradiction_is_refused() -> None:
    relative = parse_times(["0", "1000", "2500"], label="time_ms")
    assert (relative.absolute, relative.seconds.tolist()) == (False, [0.0, 1.0, 2.5])
    assert parse_times(["5", "6"], unit="seconds since 1970-01-01").t_ns.tolist() == [5 * 10**9, 6 * 10**9]
    with pytest.raises(
        TableError, match="states seconds, but 1700000000000 since 1970 is a date in milliseconds"
    ):
        parse_times(["1700000000000"], label="time_s")
    assert [time_unit(t) for t in ("time_ms", "t [µs]", "Seconds", "time", "")] == ["ms", "us", "s", "", ""]


def test_numbers_from_a_zero_of_their_own_are_seconds_or_in_doubt() -> None:
    found = parse_times(["0", "0.5", "1.0"])
    assert (found.absolute, found.seconds.tolist()) == (False, [0, 0.5, 1.0])
    assert "seconds assumed" in found.how
    for cells in (["0", "1000", "2000"], ["738000.00001", "738000.00002"]):
        with pytest.raises(TableError, match="states no unit: name it, as time_s, time_ms"):
            parse_times(cells)


def test_a_time_of_day_runs_past_midnight_and_dates_may_stand_beside_it() -> None:
    clocks = parse_times(["23:59:59.5", "00:00:00.5"])
    assert (clocks.absolute, clocks.seconds.tolist()) == (False, [0.0, 1.0])
    assert "1 midnights passed" in clocks.how
    both = parse_times(["22:13:20", "22:13:21"], dates=["2023-11-14", "2023-11-14"])
    assert both.t_ns.tolist() == [T0_NS, T0_NS + 10**9]
    assert parse_times(["14-Nov-2023 22:13:20"]).t_ns[0] == T0_NS


@pytest.mark.parametrize(
    ("cells", "message"),
    [
        (["03/04/2024 10:00"], "does not tell day and month of 03/04/2024 apart"),
        (["13/04/2024 10:00", "04/13/2024 10:00"], "mixes dates of day/month and month/day"),
        (["2024-01-01T00:00:00Z", "2024-01-01T00:00:01"], "states a time zone in 1 of 2 rows"),
        (["2024-13-01"], "holds '2024-13-01' in data row 1: no time"),
        (["25:00:00"], "holds '25:00:00' in data row 1: no time of day"),
        (["1", "soon"], "holds '1' in data row 1: no time"),
        (["1", "nan"], "holds 'nan' in data row 2: no time"),
        (["1e400"], "holds 1E\\+400: no time"),
    ],
)
def test_what_is_no_time_is_refused(cells: list[str], message: str) -> None:
    with pytest.raises(TableError, match=message):
        parse_times(cells)


@given(st.lists(st.text(max_size=30), max_size=5))
def test_any_text_is_a_time_or_one_error(cells: list[str]) -> None:
    try:
        size = parse_times(cells).t_ns.size
    except TableError:
        size = len(cells)
    assert size == len(cells)


def test_numbers_are_no_times() -> None:
    assert [looks_like_time(c) for c in ("12.5", "-122", "2024-05-01", "12:30", "5/1/2024", "lon")] == [
        False, False, True, True, True, False
    ]  # fmt: skip
