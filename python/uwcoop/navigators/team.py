"""Options of `team`: every particle carries its teammates, and only local data is broadcast."""

from __future__ import annotations

from typing import Literal

from uwcoop.navigators.base import FROM_CORE
from uwcoop.navigators.options import DriftName, TerrainOptions

__all__ = ["TeamOptions"]


class TeamOptions(TerrainOptions, method="team"):
    """Options of `team`: those of the terrain core, and the following."""

    packet: Literal["rounded", "f64"] = FROM_CORE
    """Own data since the last broadcast, in one frame; or the same as float64, for studies."""
    referee_nat: float = FROM_CORE
    """Evidence by which `mpf` without ranges, run beside, must explain the own soundings better before the vehicle starts
    anew from it; a false alarm has a chance of e to the minus this. 0: it is not run."""
    frame_bytes: int = FROM_CORE
    """Bytes of a packet, tag or checksum included; larger teams send fewer soundings, so that they fit."""
    tag_bytes: int = FROM_CORE
    """Bytes of the frame that are kept for an authentication tag; it takes the checksum's place."""
    packet_spacing_m: float = FROM_CORE
    """Least distance between the soundings that are sent."""
    team_drift: tuple[DriftName, ...] | None = FROM_CORE
    """Class of drift of each vehicle, in the team's order; None: all as `drift` and the options beside it."""
    group_size: int = FROM_CORE
    """Teammates whose cross-covariances are kept. Larger teams are divided into groups of this size: ranges between
    groups are not used, everything else stays exact."""
    packet_least_ess_share: float = FROM_CORE
    """A packet that would leave a smaller effective share of the particles has its log-weights divided by four, at most
    six times."""
    current_difference: float = FROM_CORE
    """Sigma of the difference between a teammate's current and this vehicle's own, prior and random walk, as a share of
    the drift model's: 1 for independent currents."""
    offset_difference_m: float | None = FROM_CORE
    """Sigma of a teammate's datum offset (tide) minus this vehicle's own; None: they are independent."""
    fill_reach_m: float = FROM_CORE
    """A teammate's sounding is linearised on a copy of the chart whose holes are filled up to this distance."""
