"""Tables of missions in which vehicles take turns as the landmark: how they move, position each other and hand over."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from uwcoop.scenario.base import NonNegative, Point, Positive, Probability, Table

LEAST_STATIC_FIXES = 6
"""With fewer fixes after landing the heading of the new landmark is too uncertain for an exchange of the roles."""


class Hover(Table):
    """`[hover]`: vehicles that move by surge, sway, heave and yaw, each on its own, and that land."""

    rate_hz: Annotated[int, Field(ge=1, le=50)] = 5
    """Steps of the world for each second: velocity and yaw rate are constant within a step."""
    seabed_depth_m: Positive = 30.0
    """Below the surface: how deep a landed vehicle is."""
    altitude_m: Positive = 2.0
    """Above the seabed, while moving."""
    heave_mps: Positive = 0.15
    yaw_rate_degps: Positive = 6.0
    """Of a turn on the spot, at each corner of the path."""
    hold_heading_deg: float | None = None
    """Heading that is held along the whole path, by surge and sway; None: the bow points along the path."""
    landing_shift_sigma_m: NonNegative = 0.03
    """On each axis: displacement at touchdown, when the DVL has no bottom track."""
    landing_turn_sigma_deg: NonNegative = 0.3
    """Turn at touchdown; the gyro measures it."""


class Deployment(Table):
    """`[deployment]`: the pose of the first landmark defines the frame; the mover lands near it, searches and finds
    it. Matsuda et al. (2017), section IV.A."""

    position_sigma_m: Positive = 1.0
    """On each axis: prior of every other vehicle."""
    heading_sigma_deg: Positive = 5.0
    search_s: NonNegative = 30.0
    """From landing until the mover has found the landmark: no fixes before."""
    static_fixes: Annotated[int, Field(ge=0)] = 3
    """Fixes of the landed mover before it starts its path."""
    latitude_deg: Annotated[float, Field(ge=-90, le=90)] | None = None
    longitude_deg: Annotated[float, Field(ge=-360, le=360)] | None = None
    """Of the first landmark, WGS 84, as a ship with USBL and GPS fixed it: results can then be placed on the globe."""

    @model_validator(mode="after")
    def _both_or_none(self) -> Deployment:
        if (self.latitude_deg is None) != (self.longitude_deg is None):
            raise ValueError("needs both latitude_deg and longitude_deg, or neither")
        return self


class Mutual(Table):
    """`[mutual]`: two-way positioning of one vehicle and the landmark, in both directions."""

    interval_s: Positive = 10.0
    """Of one vehicle's positioning; main vehicles start at a multiple of it, subs share out the rest."""
    range_sigma_m: NonNegative = 0.66
    own_bearing_sigma_deg: NonNegative = 6.0
    """Of the direction that the asking vehicle measures."""
    peer_bearing_sigma_deg: NonNegative = 1.0
    """Of the direction that the landmark measures and sends in its reply."""
    reply_bytes: Annotated[int, Field(ge=1, le=8)] = 4
    """Size of the reply's data: the landmark's bearing and depth. It takes one signal of the modem."""
    turnaround_s: NonNegative = 0.2
    """From the question's arrival to the reply's first signal; the chirp that is ranged on follows the signal."""
    max_range_m: Positive = 200.0
    """Beyond it no reply is heard."""
    dropout_share: Probability = 0.02
    """Share of questions that get no reply at all."""
    channel_dropout_share: Probability = 0.02
    """Share of each single measurement (range, either bearing) that is missing in a reply."""
    outlier_share: Probability = 0.0
    """Share of each single measurement that is an outlier."""
    outlier_range_m: Point = (0.5, 60.0)
    """An outlier's range is uniform between these, its bearing uniform over the circle."""

    @model_validator(mode="after")
    def _outliers_ascend(self) -> Mutual:
        low, high = self.outlier_range_m
        if not 0 < low < high:
            raise ValueError(
                f"outlier_range_m is [{low:g}, {high:g}]: must be two lengths above 0 in ascending order"
            )
        return self


class AtWaypoints(Table):
    """The mover lands at each waypoint of its path."""

    at: Literal["waypoints"] = "waypoints"


class AfterDistance(Table):
    """The mover lands after some distance along its path."""

    at: Literal["distance"]
    distance_m: Positive
    first_distance_m: Positive | None = None
    """Of the first leg of the mission; None: as every other."""


class OnSchedule(Table):
    """The mover begins to land at given times, wherever it is (earlier if its path has ended)."""

    at: Literal["times"]
    times_s: Annotated[tuple[Positive, ...], Field(strict=False, min_length=1)]

    @model_validator(mode="after")
    def _ascend(self) -> OnSchedule:
        if list(self.times_s) != sorted(set(self.times_s)):
            raise ValueError("times_s must ascend")
        return self


class Exchange(Table):
    """`[exchange]`: the vehicles that take turns, when the mover lands, and the packet that transfers the role.

    The roles are decided when the mission is simulated, with a packet of `packet_bytes`; a navigator's packet in the same
    slots may be longer, and may be lost where this one was not.
    """

    main: Annotated[tuple[str, str], Field(strict=False)] | None = None
    """The first landmark and the first mover; None: the first two vehicles. All others are subs: they never land."""
    land: Annotated[AtWaypoints | AfterDistance | OnSchedule, Field(discriminator="at")] = AtWaypoints()
    packet_bytes: Annotated[int, Field(ge=1, le=128)] = 32
    static_fixes: Annotated[int, Field(ge=LEAST_STATIC_FIXES)] = LEAST_STATIC_FIXES
    """Fixes with a range, after landing, before the packet is sent."""
    tries: Annotated[int, Field(ge=1)] = 3
    """Slots in a row in which the packet is sent until everyone has it. When all have failed the roles stay,
    positioning goes on, and a new series begins after as many fixes as before."""
    at_most: Annotated[int, Field(ge=0)] | None = None
    """Exchanges in the mission; None: as many as path and time allow."""


class Kidnap(Table):
    """`[kidnap]`: a turn or shift of a vehicle that none of its sensors measures."""

    time_s: Positive
    vehicle: str | None = None
    """None: the vehicle that moves then."""
    yaw_step_deg: float = 20.0
    """Counter-clockwise."""
    shift_m: Point = (0.0, 0.0)
    """Eastward and northward."""
