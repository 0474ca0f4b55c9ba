"""Tables of the vehicles: their names, paths, sensors and errors of dead reckoning."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from uwcoop.scenario.base import NAME, NonNegative, PlaceDeg, Point, Positive, Table
from uwcoop.scenario.sensors import Sensors

DRIFT_PRESETS: dict[str, dict[str, float | bool]] = {
    # Tan, Chitre & Hover (2016), table 1: white position noise and nothing else.
    "table-1": {
        "compass_bias_sigma_deg": 0.0, "compass_noise_deg": 0.0,
        "thrust_bias_sigma_mps": 0.0, "thrust_noise_mps": 0.0,
        "velocity_noise_m_per_sqrt_s": 0.05,
        "velocity_bias_sigma_mps": 0.0, "velocity_bias_walk_mps_per_sqrt_s": 0.0,
        "ground_referenced": False,
    },
    # A thruster model and a low-cost compass: 900 s of dead reckoning are about 75 m off on average.
    "no-dvl": {
        "compass_bias_sigma_deg": 1.0, "compass_noise_deg": 0.5,
        "thrust_bias_sigma_mps": 0.05, "thrust_noise_mps": 0.0,
        "velocity_noise_m_per_sqrt_s": 0.05,
        "velocity_bias_sigma_mps": 0.12, "velocity_bias_walk_mps_per_sqrt_s": 0.006,
        "ground_referenced": False,
    },
    # Bottom-track velocity and an attitude reference, with what is left of their errors: about 23 m.
    "dvl": {
        "compass_bias_sigma_deg": 0.3, "compass_noise_deg": 0.1,
        "thrust_bias_sigma_mps": 0.005, "thrust_noise_mps": 0.0,
        "velocity_noise_m_per_sqrt_s": 0.03,
        "velocity_bias_sigma_mps": 0.04, "velocity_bias_walk_mps_per_sqrt_s": 0.0015,
        "ground_referenced": True,
    },
}  # fmt: skip
"""What `drift.preset` stands for; a key given beside it wins."""


class Drift(Table):
    """Difference between a vehicle's commanded and true velocity. Biases are drawn for each vehicle and mission."""

    preset: Literal["table-1", "no-dvl", "dvl"]
    compass_bias_deg: float = 0.0
    """Mean of the compass bias, clockwise: true heading = believed heading + bias."""
    compass_bias_sigma_deg: NonNegative
    compass_noise_deg: NonNegative
    """White, each second."""
    thrust_bias_mps: float = 0.0
    """Mean of the thrust bias: true speed through the water = commanded speed + bias."""
    thrust_bias_sigma_mps: NonNegative
    thrust_noise_mps: NonNegative
    """White, each second."""
    velocity_noise_m_per_sqrt_s: NonNegative
    """White velocity on each axis: standard deviation of position after one second."""
    velocity_bias_sigma_mps: NonNegative
    """A drift of the vehicle's own on each axis of the world, beside the current that the team shares."""
    velocity_bias_walk_mps_per_sqrt_s: NonNegative
    ground_referenced: bool
    """The commanded velocity is over ground (bottom track): the water current is already in it."""

    @model_validator(mode="before")
    @classmethod
    def _fill_from_preset(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        preset = data.get("preset", "table-1")
        filled = DRIFT_PRESETS.get(preset, {}) if isinstance(preset, str) else {}
        return {"preset": preset, **filled, **data}


class RandomLawnmower(Table):
    """Back and forth over a random rectangle in the chart: origin, orientation, legs and spacing drawn."""

    kind: Literal["random-lawnmower"] = "random-lawnmower"
    leg_m: Point = (150.0, 350.0)
    """Shortest and longest leg."""
    spacing_m: Point = (25.0, 60.0)
    """Smallest and largest distance between legs."""
    margin_m: NonNegative = 25.0
    """Kept from the chart's edge."""
    clearance_m: NonNegative = 1.0
    """Water kept under the vehicle along the planned path, tides aside."""

    @model_validator(mode="after")
    def _ranges_ascend(self) -> RandomLawnmower:
        for name in ("leg_m", "spacing_m"):
            low, high = getattr(self, name)
            if not 0 < low <= high:
                raise ValueError(
                    f"{name} is [{low:g}, {high:g}]: must be two lengths above 0 in ascending order"
                )
        return self


class Lawnmower(Table):
    """A given lawn mower. Legs alternate; each is to the right of the one before, seen along the first."""

    kind: Literal["lawnmower"]
    start_m: Point | None = None
    """East and north of the first leg's start."""
    start_deg: PlaceDeg | None = None
    """Its latitude and longitude, in place of start_m."""
    heading_deg: float
    """Of the first leg, clockwise from north."""
    leg_m: Positive
    spacing_m: Annotated[float, Field(description="negative: legs advance to the left")]
    legs: Annotated[int, Field(ge=1)]

    @model_validator(mode="after")
    def _one_start(self) -> Lawnmower:
        _one_of(self, "start_m", "start_deg")
        return self

    @model_validator(mode="after")
    def _legs_apart(self) -> Lawnmower:
        if self.spacing_m == 0 and self.legs > 1:
            raise ValueError("spacing_m is 0: must not be 0 for more than one leg")
        return self


class Waypoints(Table):
    """Straight lines from waypoint to waypoint."""

    kind: Literal["waypoints"]
    waypoints_m: Annotated[tuple[Point, ...], Field(strict=False, min_length=2)] | None = None
    """East and north."""
    waypoints_deg: Annotated[tuple[PlaceDeg, ...], Field(strict=False, min_length=2)] | None = None
    """Latitude and longitude, in place of waypoints_m."""

    @model_validator(mode="after")
    def _points_apart(self) -> Waypoints:
        _one_of(self, "waypoints_m", "waypoints_deg")
        for key in ("waypoints_m", "waypoints_deg"):
            points = getattr(self, key) or ()
            for k, (a, b) in enumerate(pairwise(points)):
                if a == b:
                    raise ValueError(f"{key} {k} and {k + 1} are the same point [{a[0]:.12g}, {a[1]:.12g}]")
        return self


class AreaShare(Table):
    """A share of the lines over the scenario's `[area]`, which all vehicles with this path survey together."""

    kind: Literal["area"]


class Adrift(Table):
    """Adrift: the velocity is random and decays, and the position stays near the start."""

    kind: Literal["adrift"]
    start_m: Point | None = None
    """East and north."""
    start_deg: PlaceDeg | None = None
    """Latitude and longitude, in place of start_m."""
    push_m2ps3: Positive = 1e-4
    """Spectral density of the white acceleration on each axis."""
    velocity_time_s: Positive = 500.0
    """Time in which a velocity decays to 1/e."""
    spread_m: Positive = 250.0
    """In the long run, standard deviation of the position around its start on each axis."""

    @model_validator(mode="after")
    def _one_start(self) -> Adrift:
        _one_of(self, "start_m", "start_deg")
        return self


def _one_of(table: Table, in_metres: str, in_degrees: str) -> None:
    if (getattr(table, in_metres) is None) == (getattr(table, in_degrees) is None):
        raise ValueError(f"needs {in_metres} or {in_degrees}, one of the two")


Path = Annotated[RandomLawnmower | Lawnmower | Waypoints | Adrift | AreaShare, Field(discriminator="kind")]


class TrackColumns(Table):
    """Names of a recorded track's columns. Position is `east` and `north`, or `longitude` and `latitude`."""

    time: str
    east: str | None = None
    north: str | None = None
    longitude: str | None = None
    latitude: str | None = None
    sounding: str | None = None
    """Water depth, metres, positive down; an empty cell is a missing sounding."""
    depth: str | None = None
    """The vehicle's own depth below the surface, metres."""

    @model_validator(mode="after")
    def _one_position(self) -> TrackColumns:
        local, geographic = (self.east, self.north), (self.longitude, self.latitude)
        complete = [None not in pair for pair in (local, geographic)]
        started = [any(name is not None for name in pair) for pair in (local, geographic)]
        if complete != started or sum(complete) != 1:
            raise ValueError("needs either east and north, or longitude and latitude")
        return self


class Track(Table):
    """A recorded track, followed exactly; its soundings, if it has any, replace the simulated ones."""

    file: str
    """Text table (CSV and its kin, gzipped or not), relative to the scenario file."""
    columns: TrackColumns | None = None
    """Names of its columns; without them what the header calls time, position, sounding."""
    crs: str | None = None
    """Projection of east and north, e.g. "EPSG:32654"; without it they are the chart's local metres."""
    time_unit: Literal["s", "ms", "us", "ns"] | None = None
    """Of a time that is a number; without it the column's name or the size of the numbers tells it."""
    where: dict[str, str] = {}  # noqa: RUF012 - pydantic copies it
    """Only rows in which these columns hold these values, e.g. one survey of a file with many."""
    start_s: NonNegative = 0.0
    """Time in the record at which the mission starts."""
    max_gap_s: Positive = 120.0
    """A longer gap in the record is refused; shorter ones become a straight line without soundings."""
    max_speed_mps: Positive = 15.0
    """A faster move from row to row is refused: the position is wrong."""
    drop_without_fix: bool = False
    """Leave out rows at latitude and longitude 0, as receivers write them before their first fix; else refuse them."""


class VehicleBase(Table):
    """Values of a vehicle, or of all vehicles of a team."""

    depth_m: Annotated[float, Field(ge=0, le=11_000)] = 2.0
    """Below the surface, held throughout; a recorded track may bring its own."""
    speed_mps: Positive = 1.5
    look_ahead_m: Positive = 6.0
    """Distance ahead on the path at which pure pursuit steers."""
    fuses_ranges: bool = True
    """False: its navigator uses packets and their acknowledgements, but no range (a support ship with GPS)."""


class Fleet(VehicleBase):
    """`[vehicles]` as one table: `count` vehicles alike, on random paths of their own."""

    count: Annotated[int, Field(ge=1, le=64)]
    prefix: Annotated[str, Field(min_length=1, pattern=NAME)] = "V"
    path: Annotated[RandomLawnmower | AreaShare, Field(discriminator="kind")] = RandomLawnmower()

    @model_validator(mode="before")
    @classmethod
    def _random_path_unless_told(cls, data: Any) -> Any:
        path = data.get("path") if isinstance(data, dict) else None
        return {**data, "path": {"kind": "random-lawnmower", **path}} if isinstance(path, dict) else data


class Vehicle(VehicleBase):
    """One of `[[vehicles]]`."""

    name: Annotated[str, Field(min_length=1, pattern=NAME)]
    path: Path | None = None
    track: Track | None = None
    drift: Drift | None = None
    """Instead of the scenario's `[drift]`."""
    sensors: Sensors | None = None
    """Sensors given here replace the scenario's of the same name; the others stay."""

    @model_validator(mode="before")
    @classmethod
    def _random_path_unless_told(cls, data: Any) -> Any:
        if isinstance(data, dict) and "path" not in data and "track" not in data:
            return {**data, "path": RandomLawnmower()}
        return data

    @model_validator(mode="after")
    def _path_or_track(self) -> Vehicle:
        if (self.path is None) == (self.track is None):
            raise ValueError(f"vehicle {self.name} has both a path and a track: must have one")
        return self
