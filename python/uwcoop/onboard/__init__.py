"""On board: one vehicle's navigator as a program on that vehicle runs it.

`VehicleNavigator` is the navigator of vehicle k of a team, made from a scenario: feed it `uwcoop.Event`s in the order of
time, ask it for packets, save it and restore it. `Node` adds order, slots, a journal and alarms; `uwcoop node` runs one
with clocks and sockets, `uwcoop channel` is the simulated water between several.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from uwcoop.onboard.black_box import read_black_box, write_black_box
    from uwcoop.onboard.journal import Journal
    from uwcoop.onboard.messages import MessageError, event_message, event_of
    from uwcoop.onboard.node import Node
    from uwcoop.onboard.vehicle import Slot, VehicleNavigator

__all__ = [
    "Journal",
    "MessageError",
    "Node",
    "Slot",
    "VehicleNavigator",
    "event_message",
    "event_of",
    "read_black_box",
    "write_black_box",
]

_HOME = {
    "Journal": "uwcoop.onboard.journal",
    "MessageError": "uwcoop.onboard.messages",
    "Node": "uwcoop.onboard.node",
    "Slot": "uwcoop.onboard.vehicle",
    "VehicleNavigator": "uwcoop.onboard.vehicle",
    "event_message": "uwcoop.onboard.messages",
    "event_of": "uwcoop.onboard.messages",
    "read_black_box": "uwcoop.onboard.black_box",
    "write_black_box": "uwcoop.onboard.black_box",
}


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(_HOME[name]), name)
    raise AttributeError(f"module 'uwcoop.onboard' has no attribute {name!r}")
