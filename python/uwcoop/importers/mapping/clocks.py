"""One clock for all channels: stamps since 1970 stay as they are; others are put on the recorder's clock."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.errors import LogError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from uwcoop.importers.channels import Channel

__all__ = ["clock_offsets", "common_clock", "utc_text"]

_JUMP_S = 1.0
_LEAST_DRIFT_S = 0.05
_LEAST_DRIFT_PPM = 20.0
_LEAST_ROWS = 20
_LATE_S = 2.0


def clock_offsets(channels: Sequence[Channel], align: bool) -> tuple[dict[tuple[str, str], int], list[str]]:
    """What is added to each channel's stamps, ns, by `Channel.key`, and what was found.

    Stamps that count from a zero of their own get the median difference to the recorder's times. A recorder writes a
    message some time after it was stamped: where that time jumps, or grows, the clocks differ, which is said and left
    as it is.
    """
    offsets: dict[tuple[str, str], int] = {}
    said: list[str] = []
    for channel in channels:
        if channel.received_ns is None or not channel.count:
            continue
        late = channel.received_ns - channel.t_ns
        if channel.clock == "own" and align:
            offsets[channel.key] = int(np.median(late))
            said.append(
                f"{channel.name}: its stamps count from a zero of their own: moved by "
                f"{offsets[channel.key] / 1e9:.3f} s to the recorder's clock"
            )
            late = late - offsets[channel.key]
        elif channel.clock == "utc" and abs(np.median(late)) > _LATE_S * 1e9:
            said.append(
                f"{channel.name}: stamps are {np.median(late) / 1e9:+.1f} s before the recorder's times "
                "(median): another clock, or old messages? offset_s corrects it"
            )
        said += _irregular(channel, late)
    return offsets, said


def _irregular(channel: Channel, late: NDArray[np.int64]) -> list[str]:
    """Jumps and drift of the time from stamp to recorder."""
    if len(late) < _LEAST_ROWS or channel.received_ns is None:
        return []
    seconds = (channel.received_ns - channel.received_ns[0]) / 1e9
    late_s = (late - late[0]) / 1e9
    # A median of five takes single late messages out; what stays is a step of the clock.
    smooth = np.median(np.lib.stride_tricks.sliding_window_view(late_s, 5), axis=1)
    steps = np.flatnonzero(np.abs(np.diff(smooth)) > _JUMP_S)
    if steps.size:
        first = int(steps[0]) + 2
        jump = float(smooth[-1] - smooth[0])
        return [
            f"{channel.name}: its clock jumps against the recorder's {_groups(steps)} times, first "
            f"{seconds[first]:.1f} s after the start; by {-jump:+.3f} s in all: stamps are kept as they are"
        ]
    span = float(seconds[-1] - seconds[0])
    if span <= 0:
        return []
    slope = float(np.polyfit(seconds, late_s, 1)[0])
    if abs(slope) * 1e6 > _LEAST_DRIFT_PPM and abs(slope) * span > _LEAST_DRIFT_S:
        return [
            f"{channel.name}: its clock drifts against the recorder's by {-slope * 1e6:+.0f} ppm, "
            f"{-slope * span:+.3f} s in all: stamps are kept as they are"
        ]
    return []


def _groups(steps: NDArray[np.int64]) -> int:
    """Steps that lie apart by more than a window are jumps of their own."""
    return 1 + int((np.diff(steps) > 5).sum())


def common_clock(channels: Sequence[Channel], offsets: dict[tuple[str, str], int]) -> tuple[bool, list[str]]:
    """Whether the channels that are used are on UTC, with a note where files share a zero of their own.

    Raises:
        LogError: some are and some are not, so that nobody knows how they lie to each other.
    """
    own = [c for c in channels if c.clock == "own" and c.key not in offsets]
    utc = [c for c in channels if c.clock == "utc" or c.key in offsets]
    if own and utc:
        raise LogError(
            f"{own[0].name} of {own[0].source} counts time from a zero of its own, {utc[0].name} of "
            f"{utc[0].source} from 1970: they cannot be put on one clock; leave one out, or give it absolute times"
        )
    if own and len({c.source for c in own}) > 1:
        files = ", ".join(sorted({c.source for c in own}))
        return False, [f"times of {files} count from a zero of their own: taken as the same instant"]
    return not own, []


def utc_text(t_ns: int) -> str:
    """An instant since 1970 as ISO 8601, to the millisecond."""
    whole, rest = divmod(t_ns, 10**9)
    return f"{datetime.fromtimestamp(whole, UTC):%Y-%m-%dT%H:%M:%S}.{rest // 10**6:03d}Z"
