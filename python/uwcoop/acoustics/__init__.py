"""Acoustics: modem profiles, the slot schedule, travel times, sound speed, clocks and losses.

In one-way ranging a slot's signal is launched when the sender's clock shows the slot's time, travels to where
the receiver will be, and is stamped by the receiver's clock. In two-way ranging another vehicle polls first,
and the range is half the round trip in the poller's own clock. What a packet becomes is decided at replay: the
log holds, for every slot and vehicle that can hear it, the measured time of arrival, the probability that a
frame survives and one draw for each frame.
"""

from uwcoop.acoustics.channel import opportunities, polls, travel_time_s
from uwcoop.acoustics.losses import Signals, packet_survival, survival, survive_probability
from uwcoop.acoustics.modem import (
    MODEMS,
    NO_LIMIT_BYTES,
    ModemFigures,
    air_time_s,
    frames_of,
    link_of,
    poll_air_s,
)
from uwcoop.acoustics.reception import (
    ReceptionTable,
    fit_logistic,
    fit_monotone,
    logistic_share,
    monotone_share,
    read_reception,
)
from uwcoop.acoustics.schedule import (
    RESIDENCE_BYTES,
    check_fits,
    check_packet,
    packet_frames,
    pollers_of,
    schedule,
    slot_capacity_bytes,
    slot_frames,
    slot_needed_s,
)
from uwcoop.acoustics.sea_water import mackenzie_mps
from uwcoop.acoustics.sound import profile_note, true_sound_speed_mps
from uwcoop.acoustics.teos10 import teos10_mps

__all__ = [
    "MODEMS",
    "NO_LIMIT_BYTES",
    "RESIDENCE_BYTES",
    "ModemFigures",
    "ReceptionTable",
    "Signals",
    "air_time_s",
    "check_fits",
    "check_packet",
    "fit_logistic",
    "fit_monotone",
    "frames_of",
    "link_of",
    "logistic_share",
    "mackenzie_mps",
    "monotone_share",
    "opportunities",
    "packet_frames",
    "packet_survival",
    "poll_air_s",
    "pollers_of",
    "polls",
    "profile_note",
    "read_reception",
    "schedule",
    "slot_capacity_bytes",
    "slot_frames",
    "slot_needed_s",
    "survival",
    "survive_probability",
    "teos10_mps",
    "travel_time_s",
    "true_sound_speed_mps",
]
