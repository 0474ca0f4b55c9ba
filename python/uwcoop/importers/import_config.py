"""`import.toml`: which channel is which sensor of which vehicle, and how it is mounted, timed and trusted."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError, model_validator

from uwcoop.errors import ScenarioError
from uwcoop.importers.bounded import read_text, refused
from uwcoop.scenario.base import NAME, NonNegative, PlaceDeg, Point, Positive, Table, nearest
from uwcoop.scenario.validation_message import one_line

__all__ = [
    "ROLES",
    "Beacon",
    "ImportConfig",
    "RangeSource",
    "Sensor",
    "SensorTables",
    "VehicleConfig",
    "load_config",
]

Vector = Annotated[tuple[float, float, float], Field(strict=False)]
Names = Annotated[dict[str, str], Field(strict=False)]
Topics = Annotated[tuple[str, ...], Field(strict=False)]
PRESETS = Path(__file__).parent / "presets"


class Sensor(Table):
    """What all sensors have."""

    use: bool = True
    """False: leave it out, whatever the files offer."""
    topic: str | Topics | None = None
    """Name of the channel, or names of which the first that is there counts; `{vehicle}`: the vehicle's name."""
    source: str | None = None
    """Name of the file it is in, where several have such a channel."""
    columns: Names = Field(default_factory=dict)
    """Quantity to column, where the type does not say which it is: `{ depth = "data" }`."""
    unit: str | None = None
    """Of the quantity, where the file does not state it or states it wrongly: "deg", "hPa", "ft", "kn"."""
    frame: Literal["enu", "ned", "flu", "frd"] | None = None
    """enu or flu: east or forward first, z up, angles counter-clockwise; ned or frd: z down, angles clockwise."""
    lever_arm_m: Vector = (0.0, 0.0, 0.0)
    """Where it is on the vehicle: forward, left, up of the point that is navigated."""
    mounting_deg: Vector = (0.0, 0.0, 0.0)
    """How it is turned on the vehicle: roll, pitch, yaw, about forward, left and up."""
    offset_s: float = 0.0
    """Added to its stamps: negative for a sensor that stamps late."""
    clock: Literal["stamp", "received"] = "stamp"
    """Whose time counts: the message's own, or the recorder's."""
    valid: str | None = None
    """Condition on a column: "Status >= 3", "velocity_valid == 1"; rows that do not fulfil it are dropped."""
    within: Annotated[tuple[float, float], Field(strict=False)] | None = None
    """Least and greatest value in the quantity's SI unit (degrees for angles); others are dropped and counted."""
    max_rate_hz: Positive | None = None
    """At most so many readings a second; None: 5, for soundings 1."""


class PositionSensor(Sensor):
    """`fix`: GPS. `truth`: where the vehicle was, which no navigator is told."""

    sigma_m: Positive | None = None
    """On each axis; None: as the messages state, else 5 m (GPS)."""


class UsblSensor(PositionSensor):
    """A position by an ultra-short baseline: as such, or bearing, elevation and range from a transceiver."""

    age_s: NonNegative = 0.0
    """So long before its stamp it was measured."""
    sigma_range_m: Positive = 1.0
    sigma_bearing_deg: Positive = 1.0
    transceiver_deg: PlaceDeg | None = None
    """Where the transceiver is, latitude and longitude; or `ship`."""
    ship: str | None = None
    """The vehicle that carries it: its fixes and heading are used."""
    transceiver_depth_m: NonNegative = 0.0
    transceiver_heading_deg: float = 0.0
    """Of a transceiver that stands: bearings count from here, clockwise from north."""


class HeadingSensor(Sensor):
    """AHRS, gyrocompass, compass or magnetometer."""

    sigma_deg: Positive | None = None
    """None: as the messages state, else 2°."""
    declination_deg: float | Literal["wmm"] = 0.0
    """Of a magnetic heading, east positive; "wmm": by the World Magnetic Model; 0: the heading is a true one."""


class TurnRateSensor(Sensor):
    """Gyro."""

    sigma_degps: Positive | None = None
    """None: as the messages state, else 0.1 °/s."""


class VelocitySensor(Sensor):
    """`ground_velocity`: DVL, bottom lock. `water_velocity`: DVL, water lock, or a speed log. `command`: thrust model."""

    sigma_mps: Positive | None = None
    """On each axis; None: as the messages state, else 0.02 m/s."""


class OdometrySensor(Sensor):
    """Poses of an inertial or other odometry, of which displacements are made."""

    sigma_m_per_sqrt_s: Positive = 0.05
    sigma_yaw_deg_per_sqrt_s: Positive = 0.05


class DepthSensor(Sensor):
    """Own depth below the surface; `water_depth`: of the seabed below the surface."""

    sigma_m: Positive | None = None
    """None: as the messages state, else 0.1 m."""


class PressureSensor(DepthSensor):
    """Water pressure, which becomes depth."""

    density_kgpm3: Positive | None = None
    """None: the depth of a standard ocean (TEOS-10, or UNESCO 1983 without gsw)."""
    surface_pa: NonNegative | None = None
    """Pressure at the surface; None: 101,325 Pa for absolute readings, 0 for those of a gauge."""


class AltimeterSensor(DepthSensor):
    """Distance to the seabed along its beam, or of several beams."""

    beam_tilt_deg: Annotated[float, Field(ge=0, lt=80)] = 22.5
    """Of the beams of a DVL from its axis, where the messages do not state their directions."""
    beams: Literal["mean", "each"] = "mean"
    """One sounding of the mean of several beams, or one of each; those of a ping share the errors of depth and tilt."""


class SensorTables(Table):
    """The sensors of a vehicle, or (`[sensors]`) of all."""

    fix: PositionSensor | None = None
    usbl: UsblSensor | None = None
    heading: HeadingSensor | None = None
    turn_rate: TurnRateSensor | None = None
    ground_velocity: VelocitySensor | None = None
    water_velocity: VelocitySensor | None = None
    command: VelocitySensor | None = None
    odometry: OdometrySensor | None = None
    depth: DepthSensor | None = None
    pressure: PressureSensor | None = None
    altimeter: AltimeterSensor | None = None
    water_depth: DepthSensor | None = None
    truth: PositionSensor | None = None


MODELS: dict[str, type[Sensor]] = {
    "fix": PositionSensor, "usbl": UsblSensor, "heading": HeadingSensor, "turn_rate": TurnRateSensor,
    "ground_velocity": VelocitySensor, "water_velocity": VelocitySensor, "command": VelocitySensor,
    "odometry": OdometrySensor, "depth": DepthSensor, "pressure": PressureSensor, "altimeter": AltimeterSensor,
    "water_depth": DepthSensor, "truth": PositionSensor,
}  # fmt: skip
ROLES = tuple(MODELS)


class VehicleConfig(SensorTables):
    """One of `[[vehicles]]`."""

    name: Annotated[str, Field(pattern=NAME)]
    source: str | None = None
    """Name of its file; several vehicles may share one."""
    namespace: str | None = None
    """How the names of its topics begin; None: its name."""
    where: Names = Field(default_factory=dict)
    """Rows of a table that are its own: `{ vehicle = "iver" }`."""


class Beacon(Table):
    """One of `[[beacons]]`: a transponder that stands at a known place."""

    name: Annotated[str, Field(pattern=NAME)]
    place_deg: PlaceDeg | None = None
    """Latitude and longitude; or `place_m`."""
    place_m: Point | None = None
    """East and north of the origin."""
    depth_m: NonNegative = 0.0

    @model_validator(mode="after")
    def _has_one_place(self) -> Beacon:
        if (self.place_deg is None) == (self.place_m is None):
            raise ValueError("needs one of place_deg and place_m")
        return self


class RangeSource(Sensor):
    """One of `[[ranges]]`: acoustic ranges between two vehicles, or from a vehicle to a beacon."""

    kind: Literal["two-way", "one-way"] = "two-way"
    """two-way: `from` polled `to` and has the range. one-way: `to` heard `from`, by clocks that agree."""
    from_: str | None = None
    """`from` in the file. None: the vehicle in whose namespace the topic is; in a table its column `from`."""
    to: str | None = None
    """None: the only other vehicle; in a table its column `to`."""
    sigma_m: Positive | None = None
    """None: as the messages state, else 1 m."""
    stamp: Literal["arrival", "launch"] = "arrival"
    """What the stamp of a range is the time of."""

    @model_validator(mode="before")
    @classmethod
    def _from_is_a_word_of_python(cls, data: Any) -> Any:
        if isinstance(data, dict) and "from" in data:
            return {("from_" if key == "from" else key): value for key, value in data.items()}
        return data


class Csv(Table):
    """`[csv]`: of text tables, where the names of their columns do not say it."""

    time: str | None = None
    date: str | None = None
    time_unit: str = ""
    """"s", "ms", "us" or "ns"; "": told by the column's name or the numbers."""


class ImportConfig(Table):
    """The whole file."""

    name: Annotated[str, Field(pattern=NAME)] | None = None
    """Of the mission; None: the first file's name."""
    preset: str | None = None
    """A packaged mapping that this one adds to: bluerov2, cougars, holoocean, iver."""
    origin_deg: PlaceDeg | None = None
    """Latitude and longitude of the local frame's zero; also that of positions in metres."""
    sound_speed_mps: Positive = 1500.0
    """With which ranges were computed from travel times."""
    modem: str = "unlimited"
    """A packaged modem, as which navigators' packets ride on the ranges."""
    align_clocks: bool = True
    """Sensors whose stamps count from a zero of their own are put on the recorder's clock."""
    start: str | None = None
    """UTC from which on data is used: "2025-10-09T08:53:20"; None: the first."""
    end: str | None = None
    sensors: SensorTables = SensorTables()
    """What holds for every vehicle."""
    vehicles: Annotated[tuple[VehicleConfig, ...], Field(strict=False)] = ()
    """None: those whose namespaces, tables or columns are in the files."""
    ranges: Annotated[tuple[RangeSource, ...], Field(strict=False)] = ()
    beacons: Annotated[tuple[Beacon, ...], Field(strict=False)] = ()
    csv: Csv = Csv()

    @model_validator(mode="after")
    def _names_differ(self) -> ImportConfig:
        names = [v.name for v in self.vehicles] + [b.name for b in self.beacons]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(
                    f"name {name!r} is given {names.count(name)} times: vehicles and beacons need one each"
                )
        return self

    def sensor(self, vehicle: VehicleConfig | None, role: str) -> Sensor:
        """The settings of a sensor: those of all vehicles, and over them its own."""
        model = MODELS[role]
        shared: Sensor | None = getattr(self.sensors, role)
        own: Sensor | None = None if vehicle is None else getattr(vehicle, role)
        told: dict[str, Any] = {}
        for table in (shared, own):
            if table is not None:
                told |= {name: getattr(table, name) for name in table.model_fields_set}
        return model(**told)

    def is_stated(self, vehicle: VehicleConfig | None, role: str) -> bool:
        """Whether the vehicle or `[sensors]` has a table of this sensor."""
        return getattr(self.sensors, role) is not None or (
            vehicle is not None and getattr(vehicle, role) is not None
        )


def load_config(path: str | Path | None, overrides: Mapping[str, Any] | None = None) -> ImportConfig:
    """The file, over the preset that it names.

    Raises:
        ScenarioError: a file that is no TOML, an unknown key (with the nearest known one) or a value outside its bound;
            one line.
    """
    told: dict[str, Any] = {}
    where = "import"
    if path is not None:
        where = str(path)
        with refused(ScenarioError, where):
            told = tomllib.loads(read_text(path))
    told = _merged(told, dict(overrides or {}))
    name = told.get("preset")
    if isinstance(name, str):
        known = sorted(p.stem for p in PRESETS.glob("*.toml"))
        if name not in known:
            raise ScenarioError(f"{where}: preset {name!r}: {nearest(name, known)}")
        told = _merged(tomllib.loads((PRESETS / f"{name}.toml").read_text(encoding="utf-8")), told)
    try:
        return ImportConfig.model_validate(told)
    except ValidationError as error:
        raise ScenarioError(one_line(error, told, where)) from None


def _merged(below: dict[str, Any], above: dict[str, Any]) -> dict[str, Any]:
    """Tables over tables; of lists and values the upper one."""
    whole = dict(below)
    for key, value in above.items():
        under = whole.get(key)
        whole[key] = _merged(under, value) if isinstance(under, dict) and isinstance(value, dict) else value
    return whole
