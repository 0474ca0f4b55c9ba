"""The mission log: in memory as columns, on disk as MCAP."""

from uwcoop.acoustics.link import Link
from uwcoop.missionlog.model import (
    EVENT_COLUMNS,
    OPPORTUNITY_COLUMNS,
    RECEPTION_COLUMNS,
    SLOT_COLUMNS,
    Columns,
    MissionLog,
    columns,
    event_columns,
)

__all__ = [
    "EVENT_COLUMNS",
    "OPPORTUNITY_COLUMNS",
    "RECEPTION_COLUMNS",
    "SLOT_COLUMNS",
    "Columns",
    "Link",
    "MissionLog",
    "columns",
    "event_columns",
]
