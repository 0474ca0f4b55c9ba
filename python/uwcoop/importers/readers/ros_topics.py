"""Recorded ROS topics, of whichever bag, as channels."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.importers.channels import Channel, Omitted
from uwcoop.importers.readers.cdr import decode

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

__all__ = ["LONGEST_MESSAGE_BYTES", "RawTopic", "channels_of"]

LONGEST_MESSAGE_BYTES = 8192
"""Longer messages are pictures, scans and clouds, which no navigator here reads; they are counted."""
_FIRST_NS = 315_532_800 * 10**9
"""1980: an earlier stamp counts from a zero of its own."""


@dataclass
class RawTopic:
    """The messages of one topic as a bag holds them."""

    name: str
    msgtype: str
    """"sensor_msgs/msg/Imu"."""
    definition: str = ""
    """Of the type and all it depends on, as the bag holds it; "": it holds none."""
    idl: bool = False
    """The definition is OMG IDL; else the lines of `.msg` files."""
    messages: list[bytes] = field(default_factory=list)
    received_ns: list[int] = field(default_factory=list)
    too_long: int = 0
    """Messages that were counted and not kept."""

    def take(self, received_ns: int, message: bytes) -> None:
        """Keep a message, or count it."""
        if len(message) > LONGEST_MESSAGE_BYTES:
            self.too_long += 1
        else:
            self.messages.append(message)
            self.received_ns.append(received_ns)


def channels_of(
    topics: list[RawTopic], source: str, *, ros2: bool
) -> tuple[list[Channel], list[Omitted], list[str]]:
    """The topics as channels; those that cannot be read, with the reason; notes."""
    channels, omitted, notes = [], [], []
    for topic in sorted(topics, key=lambda t: t.name):
        if topic.too_long:
            reason = f"messages above {LONGEST_MESSAGE_BYTES // 1024} KiB"
            omitted.append(Omitted(topic.name, topic.msgtype, topic.too_long, reason))
        if not topic.messages:
            if not topic.too_long:
                omitted.append(Omitted(topic.name, topic.msgtype, 0, "no messages"))
            continue
        stores = _stores_of(topic, ros2)
        if not stores:
            reason = "its type is not defined in the bag and no standard one"
            omitted.append(Omitted(topic.name, topic.msgtype, len(topic.messages), reason))
            continue
        # The layout of a standard type may have changed between releases: the one that fits the most messages.
        tried = []
        for store in stores:
            tried.append(decode(store, topic.msgtype, topic.messages, aligned=ros2))
            if not tried[-1].damaged:
                break
        decoded = max(tried, key=lambda made: made.rows.size)
        if decoded.damaged:
            notes.append(
                f"{topic.name}: {decoded.damaged:,} of {len(topic.messages):,} messages are not what their type "
                f"{topic.msgtype} says: left out"
            )
        if not decoded.rows.size:
            reason = "no message is what its type says"
            omitted.append(Omitted(topic.name, topic.msgtype, len(topic.messages), reason))
            continue
        received = np.array(topic.received_ns, dtype=np.int64)[decoded.rows]
        stamps = decoded.stamps_ns
        if stamps is None:
            notes.append(f"{topic.name}: {topic.msgtype} has no stamp: the recorder's times are used")
        elif not stamps.any():
            notes.append(f"{topic.name}: all stamps are 0: the recorder's times are used")
            stamps = None
        t_ns = received if stamps is None else stamps
        channels.append(
            Channel(
                source, topic.name, topic.msgtype, t_ns, decoded.columns,
                clock="utc" if np.median(t_ns) > _FIRST_NS else "own",
                frame_id=decoded.frame_id,
                received_ns=received,
            )
        )  # fmt: skip
    return channels, omitted, notes


def _stores_of(topic: RawTopic, ros2: bool) -> tuple[Typestore, ...]:
    """Type stores that know the topic's type: of the bag's own definition, else of standard releases."""
    if topic.definition:
        own = _defined(topic.msgtype, topic.definition, topic.idl, ros2)
        if own is not None:
            return (own,)
    return tuple(store for store in _standard(ros2) if topic.msgtype in store.fielddefs)


@lru_cache
def _standard(ros2: bool) -> tuple[Typestore, ...]:
    from rosbags.typesys import Stores, get_typestore

    return tuple(
        map(get_typestore, (Stores.ROS2_JAZZY, Stores.ROS2_HUMBLE) if ros2 else (Stores.ROS1_NOETIC,))
    )


@lru_cache(maxsize=64)
def _defined(msgtype: str, definition: str, idl: bool, ros2: bool) -> Typestore | None:
    """The types of a definition, and below them the standard ones; None: it is no definition of the type."""
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    try:
        types = get_types_from_idl(definition) if idl else get_types_from_msg(definition, msgtype)
        own = get_typestore(Stores.EMPTY)
        own.register({**_standard(ros2)[0].fielddefs, **types})
    except Exception:  # what rosbags' parsers raise on a definition that is none is not listed anywhere
        return None
    return own if msgtype in own.fielddefs else None
