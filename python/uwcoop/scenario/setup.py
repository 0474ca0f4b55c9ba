"""What a log keeps of the scenario that it was made from, parsed once: the keys that a replay reads, with their types."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from uwcoop.errors import ScenarioError
from uwcoop.scenario.acoustics import Acoustics
from uwcoop.scenario.authentication import Authentication
from uwcoop.scenario.base import NonNegative
from uwcoop.scenario.loading import apply_overrides
from uwcoop.scenario.models import Diagnostics, Metrics
from uwcoop.scenario.validation_message import one_line
from uwcoop.scenario.vehicle import Fleet

if TYPE_CHECKING:
    from uwcoop.scenario.models import Scenario

__all__ = ["MissionSetup", "NavigatorTables", "PositioningSigmas"]

Options = Mapping[str, Any]


@dataclass(frozen=True)
class NavigatorTables:
    """The tables `[navigator.*]`: options by navigator. The navigators check them when they are made."""

    common: Options = field(default_factory=dict)
    """`[navigator.all]`: for every navigator that has the option."""
    own: Mapping[str, Options] = field(default_factory=dict)
    """`[navigator.NAME]`, by name."""


@dataclass(frozen=True)
class PositioningSigmas:
    """Standard deviations of mutual positioning, as the scenario or the data set states them."""

    range_m: float
    own_bearing_deg: float
    """Of the direction that the asking vehicle measures."""
    peer_bearing_deg: float
    """Of the direction that the landmark measures."""


@dataclass(frozen=True)
class MissionSetup:
    """What a log keeps of its scenario. Every part is optional: a log of another origin may hold none of it.

    Made by `of` (a scenario) or `parse` (resolved tables, as a log file holds them).
    """

    acoustics: Acoustics | None = None
    """Modem, schedule and ranging; None: the log has no schedule."""
    navigators: tuple[str, ...] = ()
    """The navigators that the scenario lists; empty: it lists none."""
    navigator: NavigatorTables = field(default_factory=NavigatorTables)
    metrics: Metrics = field(default_factory=Metrics)
    diagnostics: Diagnostics = field(default_factory=Diagnostics)
    fuses_ranges: tuple[bool, ...] = ()
    """By vehicle, whether its navigator uses ranges; empty: all do."""
    sensors: frozenset[str] = frozenset()
    """Names of the sensors that the first vehicle carries."""
    exchanges_roles: bool = False
    """Vehicles take turns as the landmark."""
    positioning: PositioningSigmas | None = None
    """None: no vehicle is positioned by a landmark."""
    text: str = "{}"
    """The resolved tables as JSON: what a log file stores. Keys that no replay reads are kept here alone."""

    @property
    def authentication(self) -> Authentication:
        """How packets are tagged; off where the log has no schedule."""
        return Authentication() if self.acoustics is None else self.acoustics.authentication

    @classmethod
    def of(cls, scenario: Scenario) -> MissionSetup:
        """What a log of this scenario keeps. A key of the team is hidden, as in every output."""
        return cls.parse(scenario.resolved(), scenario.name)

    @classmethod
    def parse(cls, tables: Mapping[str, Any], where: str = "scenario") -> MissionSetup:
        """The setup in resolved tables.

        Args:
            tables: JSON-serialisable; keys that this class does not read are kept in `text`.
            where: names the source in the error's line.

        Raises:
            ScenarioError: a value that is no JSON, or outside its bound; one line.
        """
        try:
            text = json.dumps(tables)
        except (TypeError, ValueError) as error:
            raise ScenarioError(f"{where} cannot be written as JSON: {error}") from None
        read = _validated(_Tables, json.loads(text), where)
        options = dict(read.navigator)
        return cls(
            acoustics=read.acoustics,
            navigators=read.navigators,
            navigator=NavigatorTables(options.pop("all", {}), options),
            metrics=read.metrics,
            diagnostics=read.diagnostics,
            fuses_ranges=_fuses_ranges(read.vehicles, where),
            sensors=_sensor_names(read),
            exchanges_roles=bool(read.exchange),
            positioning=_positioning(read),
            text=text,
        )

    def with_overrides(self, overrides: Iterable[str]) -> MissionSetup:
        """The same with single keys set, "dotted.key=value" each.

        Raises:
            ScenarioError: an override that is malformed, or a value outside its bound; one line.
        """
        return MissionSetup.parse(apply_overrides(self.tables(), overrides))

    def tables(self) -> dict[str, Any]:
        """The resolved tables, for files; `parse` gives an equal setup."""
        tables: dict[str, Any] = json.loads(self.text)
        return tables

    def resolved(self, seed: int, options: Mapping[str, Options]) -> dict[str, Any]:
        """The resolved tables with a run's seed and its navigators' whole options: `scenario.json` of a run."""
        tables = self.tables()
        return {**tables, "seed": seed, "navigator": {**tables.get("navigator", {}), **options}}


class _Lenient(BaseModel):
    # Logs of other origins hold further keys; what is read is held to its type.
    model_config = ConfigDict(extra="ignore", frozen=True, strict=True, allow_inf_nan=False)


class _Mutual(_Lenient):
    range_sigma_m: NonNegative
    own_bearing_sigma_deg: NonNegative
    peer_bearing_sigma_deg: NonNegative


class _Mrclam(_Lenient):
    range_sigma_m: NonNegative
    bearing_sigma_deg: NonNegative


class _Vehicle(_Lenient):
    fuses_ranges: bool = True
    sensors: dict[str, Any] = Field(default_factory=dict)


class _Tables(_Lenient):
    """The keys of resolved tables that a replay reads."""

    acoustics: Acoustics | None = None
    navigators: Annotated[tuple[str, ...], Field(strict=False)] = ()
    navigator: dict[str, dict[str, Any]] = Field(default_factory=dict)
    metrics: Metrics = Metrics()
    diagnostics: Diagnostics = Diagnostics()
    vehicles: Any = None
    """One table for a fleet of equals, or one for each vehicle."""
    sensors: dict[str, Any] = Field(default_factory=dict)
    exchange: dict[str, Any] | None = None
    mutual: _Mutual | None = None
    mrclam: _Mrclam | None = None


Model = TypeVar("Model", bound=BaseModel)


def _validated(model: type[Model], tables: object, where: str) -> Model:
    try:
        return model.model_validate(tables)
    except ValidationError as error:
        raise ScenarioError(one_line(error, tables, where)) from None


def _fuses_ranges(vehicles: object, where: str) -> tuple[bool, ...]:
    if isinstance(vehicles, dict) and "count" in vehicles:
        fleet = _validated(Fleet, vehicles, f"{where}: vehicles")
        return () if fleet.fuses_ranges else (False,) * fleet.count
    if isinstance(vehicles, list):
        return tuple(_validated(_Vehicle, v, f"{where}: vehicles").fuses_ranges for v in vehicles)
    return ()


def _sensor_names(read: _Tables) -> frozenset[str]:
    team = read.vehicles
    first = _Vehicle.model_validate(team[0]) if isinstance(team, list) and team else _Vehicle()
    return frozenset(read.sensors) | frozenset(first.sensors)


def _positioning(read: _Tables) -> PositioningSigmas | None:
    if read.mutual is not None:
        mutual = read.mutual
        return PositioningSigmas(
            mutual.range_sigma_m, mutual.own_bearing_sigma_deg, mutual.peer_bearing_sigma_deg
        )
    if read.mrclam is not None:
        recorded = read.mrclam
        return PositioningSigmas(
            recorded.range_sigma_m, recorded.bearing_sigma_deg, recorded.bearing_sigma_deg
        )
    return None
