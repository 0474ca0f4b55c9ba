"""Options of `team`: every particle carries its teammates, and only local data is broadcast."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from uwcoop import _native
from uwcoop.errors import NavigatorError
from uwcoop.navigators.options import DRIFT_KEYS, DRIFT_PRESETS, MpfOptions, NonNegative, Positive, Share

DriftName = Literal["table-1", "no-dvl", "dvl"]


class TeamOptions(MpfOptions):
    """Options of `team`: those of `mpf`'s core, and the following."""

    particles: Annotated[int, Field(ge=10, le=10_000_000)] = 1500
    packet: Literal["rounded", "f64"] = "rounded"
    """Own data since the last broadcast, in one frame; or the same as float64, for studies."""
    referee_nat: NonNegative = 10.0
    """Evidence by which `mpf` without ranges, run beside, must explain the own soundings better before the vehicle starts
    anew from it; a false alarm has a chance of e to the minus this. 0: it is not run."""
    frame_bytes: Annotated[int, Field(ge=16, le=256)] = 32
    """Bytes of a packet, tag or checksum included; larger teams thin their soundings to fit."""
    tag_bytes: Annotated[int, Field(ge=0, le=32)] = 4
    """Bytes of the frame that are kept for an authentication tag; it takes the checksum's place."""
    packet_spacing_m: NonNegative = 0.0
    """Least distance between the soundings that are sent."""
    team_drift: tuple[DriftName, ...] | None = None
    """Class of drift of each vehicle, in the team's order; None: all as `drift` and the options beside it."""
    group_size: Annotated[int, Field(ge=1, le=15)] = 4
    """Teammates whose cross-covariances are kept. Larger teams fall into groups of this size: ranges between groups are
    left out, everything else stays exact."""
    packet_least_ess_share: Annotated[float, Field(ge=0, le=0.5)] = 0.02
    """A packet that would leave a smaller effective share of the particles has its weight quartered, at most six times.
    """
    current_difference: Share = 1.0
    """How much of a teammate's current is its own: 1 where currents have nothing in common; below, prior and walk of the
    difference to this vehicle's own current are this share of the drift's."""
    offset_difference_m: NonNegative | None = None
    """Sigma of a teammate's datum offset (tide) minus this vehicle's own; None: they have nothing in common."""
    fill_reach_m: Positive = 60.0
    """Over holes no wider than this a teammate's sounding is linearised on a filled copy of the chart."""

    def native(self, correlation_length_m: float) -> dict[str, Any]:
        """As `mpf`, with the drift of each class of vehicle."""
        values = super().native(correlation_length_m)
        values["presets"] = {
            name: {key: preset.get(key, values[key]) for key in DRIFT_KEYS}
            for name, preset in DRIFT_PRESETS.items()
        }
        return values


def team(vehicle: int, vehicles: int, options: dict[str, Any], chart: _native.Chart | None, sound_speed_mps: float,
         seed: int) -> _native.Navigator:  # fmt: skip
    """The native navigator of one vehicle.

    Raises:
        NavigatorError: `team_drift` does not name every vehicle, or an option is outside its bounds.
    """
    names = options["team_drift"]
    if names is None:
        drifts = [{key: options[key] for key in DRIFT_KEYS}] * vehicles
    elif len(names) == vehicles:
        drifts = [options["presets"][name] for name in names]
    else:
        raise NavigatorError(
            f"navigator.team.team_drift names {len(names)} vehicles: the team has {vehicles}"
        )
    return _native.team_navigator(
        vehicle, vehicles, {**options, "drifts": drifts}, chart, sound_speed_mps, seed
    )
