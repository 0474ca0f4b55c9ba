"""The scenario: everything about a mission but its seed's draws. The only place for defaults of the world."""

from __future__ import annotations

import json
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, field_validator, model_validator

from uwcoop.scenario.acoustics import Acoustics
from uwcoop.scenario.area import Area
from uwcoop.scenario.base import NAME, Latitude, Longitude, NonNegative, Positive, Table, nearest
from uwcoop.scenario.chart import ChartSpec
from uwcoop.scenario.landmark import Deployment, Exchange, Hover, Kidnap, Mutual
from uwcoop.scenario.sensors import Sensors
from uwcoop.scenario.vehicle import AreaShare, Drift, Fleet, Lawnmower, Vehicle, Waypoints
from uwcoop.scenario.world import Current, NoCurrent, Tide, Waves

_NOT_OF_THE_WORLD = ("navigator", "navigators", "metrics")
"""Keys of a scenario that change how a mission is replayed and judged, not the mission."""


class Metrics(Table):
    """How results are judged."""

    settle_s: NonNegative = 50.0
    """Errors count from here on."""


class Place(Table):
    """`[origin]`: where on Earth the local frame's zero lies, for a scenario whose chart does not say it."""

    latitude_deg: Latitude
    longitude_deg: Longitude


class Diagnostics(Table):
    """What navigators work out beside their estimates; slows them down."""

    entropy: Literal["off", "at_reception", "at_updates"] = "off"
    """at_updates: the mutual information (19)-(21) of Tan, Chitre & Hover (2016) over each measurement update (18),
    soundings and ranges. at_reception: of the range alone, at each reception."""
    entropy_sigma_m: Positive = 5.0
    """Width of the kernel in (21); the paper gives none."""


def _team_or_list(value: Any) -> str:
    return "team" if isinstance(value, dict | Fleet) else "list"


Vehicles = Annotated[
    Annotated[Fleet, Tag("team")]
    | Annotated[tuple[Vehicle, ...], Field(strict=False, min_length=1), Tag("list")],
    Discriminator(_team_or_list),
]


class Scenario(Table):
    """A mission to be simulated. Made by `load` or `parse`, which say what is wrong in one line."""

    name: Annotated[str, Field(min_length=1, pattern=NAME)]
    description: str = ""
    seed: Annotated[int, Field(ge=0, le=2**63 - 1)] = 0
    """Of the mission, unless the caller gives another."""
    duration_s: Positive
    """Whole seconds: the world moves in steps of one."""
    chart: ChartSpec | None = None
    """The seabed; None: there is none, for vehicles that navigate without it."""
    origin: Place | None = None
    """Of the local frame, WGS 84; without it the chart's."""
    area: Area | None = None
    """What vehicles with `path.kind = "area"` survey together."""
    vehicles: Vehicles
    drift: Drift = Field(default_factory=lambda: Drift.model_validate({}))
    current: Current = NoCurrent()
    tide: Tide = Tide()
    waves: Waves = Waves()
    sensors: Sensors = Sensors()
    acoustics: Acoustics
    exchange: Exchange | None = None
    """Vehicles hover and take turns as the landmark; None: none does, and the four tables below say nothing."""
    hover: Hover = Hover()
    deployment: Deployment = Deployment()
    mutual: Mutual = Mutual()
    kidnap: Kidnap | None = None
    metrics: Metrics = Metrics()
    diagnostics: Diagnostics = Diagnostics()
    navigators: Annotated[tuple[str, ...], Field(strict=False)] = ()
    """Which packaged navigators take part when nobody is asked for; empty: all for terrain that fit the modem."""
    navigator: dict[str, dict[str, Any]] = Field(default_factory=dict)
    """Options for navigators by name; the navigators check them."""

    @property
    def team(self) -> tuple[Vehicle, ...]:
        """The vehicles one by one, each with its drift and sensors: its own, or the scenario's."""
        if isinstance(self.vehicles, Fleet):
            shared = self.vehicles.model_dump(exclude={"count", "prefix", "path"})
            own = tuple(
                Vehicle(name=f"{self.vehicles.prefix}{k + 1}", path=self.vehicles.path, **shared)
                for k in range(self.vehicles.count)
            )
        else:
            own = self.vehicles
        return tuple(
            vehicle.model_copy(
                update={
                    "drift": vehicle.drift or self.drift,
                    "sensors": self.sensors.replaced_by(vehicle.sensors),
                }
            )
            for vehicle in own
        )

    def resolved(self) -> dict[str, Any]:
        """Every key with its value, defaults included, ready for JSON; `parse` makes the scenario of it."""
        unused = set() if self.exchange is not None else {"hover", "deployment", "mutual"}
        dump = self.model_dump(mode="json", exclude_none=True, exclude=unused)
        if not isinstance(self.vehicles, Fleet):
            team = [vehicle.model_dump(mode="json", exclude_none=True) for vehicle in self.team]
            for given, vehicle in zip(team, self.vehicles, strict=True):
                if vehicle.drift is None:
                    del given["drift"]
                del given["sensors"]
                if vehicle.sensors is not None:
                    # Only those of its own: the others are the scenario's, which stand above.
                    own = vehicle.sensors.model_fields_set
                    given["sensors"] = vehicle.sensors.model_dump(mode="json", exclude_none=True, include=own)
            dump["vehicles"] = team
        return dump

    def world_text(self) -> str:
        """The resolved keys that the simulated world depends on, as JSON: scenarios with the same text fly the same
        missions."""
        resolved = self.resolved()
        return json.dumps({key: value for key, value in resolved.items() if key not in _NOT_OF_THE_WORLD})

    @field_validator("duration_s")
    @classmethod
    def _whole_seconds(cls, value: float) -> float:
        if value != round(value) or value > 1e6:
            raise ValueError(f"is {value:g} s: must be a whole number of seconds up to 1000000")
        return value

    @model_validator(mode="after")
    def _names_are_known_and_unique(self) -> Scenario:
        names = [vehicle.name for vehicle in self.team]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"vehicle name {name!r} is used {names.count(name)} times: must be unique")
        for key, named in self.acoustics.named_vehicles.items():
            for name in named:
                if name not in names:
                    hint = nearest(name, names)
                    raise ValueError(f"acoustics.{key} names {name!r}: no such vehicle, {hint}")
        return self

    @model_validator(mode="after")
    def _area_has_vehicles(self) -> Scenario:
        shares = any(isinstance(vehicle.path, AreaShare) for vehicle in self.team)
        if shares != (self.area is not None):
            missing = "table area" if shares else 'vehicle with path.kind = "area"'
            there = 'a vehicle with path.kind = "area"' if shares else "a table area"
            raise ValueError(f"has {there} but no {missing}: must have both")
        return self

    @model_validator(mode="after")
    def _one_origin(self) -> Scenario:
        if self.origin is not None and self.deployment.latitude_deg is not None:
            raise ValueError("has origin and deployment.latitude_deg: the frame has one origin")
        return self

    @model_validator(mode="after")
    def _landmarks_can_alternate(self) -> Scenario:
        if self.exchange is None:
            given = {"hover", "deployment", "mutual", "kidnap"} & self.model_fields_set
            if given and any(getattr(self, name) not in (None, _default(name)) for name in given):
                raise ValueError(f"has a table {sorted(given)[0]} but no table exchange: must have both")
            return self
        names = [vehicle.name for vehicle in self.team]
        if len(names) < 2:
            raise ValueError(f"exchange needs 2 vehicles: there is {len(names)}")
        for vehicle in self.team:
            if not isinstance(vehicle.path, Waypoints | Lawnmower):
                raise ValueError(
                    f"vehicle {vehicle.name} needs waypoints or a lawnmower as its path: it hovers"
                )
        main = self.main
        if len(set(main)) < 2:
            raise ValueError(f"exchange.main names {main[0]!r} twice: must be two vehicles")
        named = {"exchange.main": main, "kidnap.vehicle": (self.kidnap.vehicle,) if self.kidnap else ()}
        for key, who in named.items():
            for name in who:
                if name is not None and name not in names:
                    raise ValueError(f"{key} names {name!r}: no such vehicle, {nearest(name, names)}")
        path = next(vehicle.path for vehicle in self.team if vehicle.name == main[0])
        assert isinstance(path, Waypoints | Lawnmower)
        check_starts_at_zero(main[0], path)
        if self.acoustics.ranging != "one-way":
            raise ValueError(
                "acoustics.ranging is 'two-way': with exchange the table mutual says how ranges are had"
            )
        return self

    @property
    def main(self) -> tuple[str, str]:
        """The first landmark and the first mover of a mission with `exchange`."""
        named = None if self.exchange is None else self.exchange.main
        return named or (self.team[0].name, self.team[1].name)


def check_starts_at_zero(name: str, path: Waypoints | Lawnmower) -> None:
    """Refuse a path in metres of the first landmark that does not start at [0, 0]; degrees are placed later."""
    first = path.start_m if isinstance(path, Lawnmower) else path.waypoints_m and path.waypoints_m[0]
    if first and first != (0.0, 0.0):
        raise ValueError(
            f"vehicle {name} starts at [{first[0]:g}, {first[1]:g}]: the first landmark's pose is the frame, "
            "its path must start at [0, 0]"
        )


def _default(table: str) -> object:
    return Scenario.model_fields[table].get_default()
