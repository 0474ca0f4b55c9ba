"""The navigator of one vehicle of a team, made from the team's scenario: public, typed, without clock or sockets."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from uwcoop import acoustics
from uwcoop import scenario as scenarios
from uwcoop.acoustics.authentication import authenticator_of
from uwcoop.charts.native import native_chart
from uwcoop.errors import NavigatorError, ScenarioError
from uwcoop.missionlog.model import MissionLog
from uwcoop.navigators.protocol import Context
from uwcoop.navigators.registry import NAVIGATORS, build, options_of
from uwcoop.scenario.base import nearest
from uwcoop.scenario.setup import MissionSetup

if TYPE_CHECKING:
    from uwcoop._native import Estimate, Event
    from uwcoop.charts import Chart
    from uwcoop.scenario.models import Scenario

__all__ = ["Slot", "VehicleNavigator", "empty_mission"]

_MAGIC = b"uwcoop state 1\n"


@dataclass(frozen=True)
class Slot:
    """One chance of this vehicle to transmit."""

    tol_ns: int
    """Launch of the signal, ns since the mission's epoch."""
    capacity_bytes: int


def empty_mission(
    scenario: Scenario | str | Path, seed: int | None = None, chart: Chart | None = None
) -> MissionLog:
    """The mission of a scenario before anything has happened: team, link, slots, chart and setup, no events.

    Args:
        scenario: a `Scenario`, the name of a packaged one, or the path of a scenario file.
        seed: of the navigators; None takes the scenario's.
        chart: the chart on board instead of the scenario's.

    Raises:
        ScenarioError: a scenario that a node cannot run: vehicles that exchange roles, two-way ranging.
        ScheduleError, ChartError: as `uwcoop.simulate`.
    """
    from uwcoop.world.mission_area import mission_area
    from uwcoop.world.places import placed
    from uwcoop.world.simulate import open_chart, seabed_and_chart

    if isinstance(scenario, str | Path):
        scenario = scenarios.load(scenario)
    if scenario.exchange is not None:
        raise ScenarioError(
            f"scenario {scenario.name!r} has a table exchange: a node does not run role exchanges"
        )
    if scenario.acoustics.ranging != "one-way":
        raise ScenarioError(
            f"acoustics.ranging is {scenario.acoustics.ranging!r}: a node's slot timer needs 'one-way'"
        )
    seed = scenario.seed if seed is None else seed
    if seed < 0:
        raise ScenarioError(f"seed is {seed}: must be at least 0")
    if chart is None and (spec := scenario.chart) is not None:
        _, chart = seabed_and_chart(spec, open_chart(spec, partial(mission_area, scenario)), seed)
    names = tuple(vehicle.name for vehicle in scenario.team)
    return MissionLog(
        name=scenario.name,
        seed=seed,
        vehicles=names,
        duration_ns=round(scenario.duration_s) * 1_000_000_000,
        link=acoustics.link_of(scenario.acoustics),
        slots=acoustics.schedule(scenario.acoustics, names, scenario.duration_s),
        chart=chart,
        origin=placed(scenario, chart).origin,
        setup=MissionSetup.of(scenario),
        team_key=scenario.acoustics.authentication.key,
    )


class VehicleNavigator:
    """The navigator of one vehicle of a team.

    The same scenario, seed and events give the estimates of `uwcoop run`, bit for bit on one machine. With
    `[acoustics.authentication]`, packets are tagged and checked, and the counters against replayed packets are part of
    what `save` gives.
    """

    def __init__(self, mission: MissionLog, vehicle: str | int, navigator: str | None = None) -> None:
        """Make the navigator of `vehicle`.

        Args:
            mission: as `empty_mission` gives it; a whole log does, its events are not read.
            vehicle: name or index in the team.
            navigator: of `uwcoop.navigators.NAVIGATORS`; None takes the first that the scenario lists, else `team`.

        Raises:
            ScenarioError: an unknown vehicle, or tags without a key.
            NavigatorError: a navigator that cannot run on a vehicle, or an option outside its bound.
        """
        self.mission = mission
        self.index = _index(mission, vehicle)
        self.navigator = navigator or next(iter(mission.setup.navigators), "team")
        spec = NAVIGATORS.get(self.navigator)
        if spec is not None and not spec.realisable:
            raise NavigatorError(
                f"navigator {self.navigator!r} uses information that no vehicle has: it runs in `uwcoop run` only"
            )
        options = options_of(self.navigator, mission.setup)
        context = Context(
            self.index,
            len(mission.vehicles),
            mission.link.sound_speed_mps,
            mission.seed,
            mission.chart,
            mission.setup.fuses_ranges,
        )
        native = build(
            self.navigator, context, options, None if mission.chart is None else native_chart(mission.chart)
        )
        _refuse_public_key(mission)
        authenticator = authenticator_of(mission)
        if authenticator is not None:
            native = native.authenticated(self.index, len(mission.vehicles), authenticator)
        self._native = native
        self.late_lag_ns = 0 if options.late == "refuse" else round(options.lag_s * 1e9)
        """How old an event may be that comes after a later one, by the options `late` and `lag_s`; 0: none may."""
        self.slots = _own_slots(mission, self.index)
        """This vehicle's slots, earliest first."""
        self.digest = _digest(mission, self.index, self.navigator, options.stated())
        """SHA-256 of all that a saved state depends on beside itself."""

    @classmethod
    def from_scenario(
        cls,
        scenario: Scenario | str | Path,
        vehicle: str | int,
        navigator: str | None = None,
        *,
        seed: int | None = None,
        chart: Chart | None = None,
    ) -> VehicleNavigator:
        """As the constructor, with `empty_mission(scenario, seed, chart)`."""
        return cls(empty_mission(scenario, seed, chart), vehicle, navigator)

    @property
    def name(self) -> str:
        """Of the vehicle."""
        return self.mission.vehicles[self.index]

    def handle(self, event: Event) -> str:
        """Advance to the event's time and fuse it: "fused", "noted", "gated" or "rejected".

        Raises:
            NavigatorError: an event from the past, of another vehicle, or that no honest source sends; the state is as it
                was.
        """
        return self._native.handle(event)

    def transmit(self, tol_ns: int, capacity_bytes: int | None = None) -> bytes | None:
        """What to send in the slot that starts at `tol_ns`, with its tag; None: silence.

        Args:
            tol_ns: launch, ns since the mission's epoch.
            capacity_bytes: None takes that of the schedule's slot at `tol_ns`.

        Raises:
            ScenarioError: no slot of this vehicle starts then, and no capacity is given.
            NavigatorError: a packet that does not fit its fields or the slot.
        """
        if capacity_bytes is None:
            found = next((slot for slot in self.slots if slot.tol_ns == tol_ns), None)
            if found is None:
                raise ScenarioError(f"no slot of vehicle {self.name} starts at {tol_ns / 1e9:.9f} s")
            capacity_bytes = found.capacity_bytes
        return self._native.transmit(tol_ns, capacity_bytes)

    def estimate(self, t_ns: int) -> Estimate:
        """The belief predicted to `t_ns`, without changing anything."""
        return self._native.estimate(t_ns)

    def diagnostics(self) -> dict[str, float]:
        """Named numbers of the method's own, as they stand after the last event."""
        return self._native.diagnostics()

    def save(self) -> bytes:
        """Everything that determines what comes next, counters included; never the key."""
        return _MAGIC + bytes.fromhex(self.digest) + self._native.snapshot()

    def restore(self, state: bytes) -> None:
        """Take up what `save` gave.

        Raises:
            NavigatorError: not a state, or one of another scenario, vehicle, navigator, seed or chart; the state is as it
                was.
        """
        head = len(_MAGIC) + 32
        if not state.startswith(_MAGIC) or len(state) < head:
            raise NavigatorError("state: this is no state that a vehicle's navigator saved")
        if state[len(_MAGIC) : head].hex() != self.digest:
            raise NavigatorError(
                f"state: saved for another scenario, vehicle, navigator, seed or chart than {self.name}'s "
                f"{self.navigator} of {self.mission.name!r}"
            )
        self._native.restore(state[head:])


def _index(mission: MissionLog, vehicle: str | int) -> int:
    if isinstance(vehicle, str):
        if vehicle not in mission.vehicles:
            raise ScenarioError(
                f"vehicle {vehicle!r} is not in the team: {nearest(vehicle, mission.vehicles)}"
            )
        return mission.vehicles.index(vehicle)
    if not 0 <= vehicle < len(mission.vehicles):
        raise ScenarioError(f"vehicle {vehicle} is not in the team: must be 0 to {len(mission.vehicles) - 1}")
    return vehicle


def _refuse_public_key(mission: MissionLog) -> None:
    """A simulation makes a key of the mission's name, which anybody can; a vehicle must not."""
    plan = mission.setup.authentication
    if plan.tag_bytes and mission.team_key is None and plan.key_env is None and plan.key_file is None:
        raise ScenarioError(
            "acoustics.authentication has tags and no key: a vehicle needs the team's, in key_env or key_file"
        )


def _own_slots(mission: MissionLog, index: int) -> tuple[Slot, ...]:
    table = mission.slots
    rows = zip(
        table["tol_ns"].tolist(), table["sender"].tolist(), table["capacity_bytes"].tolist(), strict=True
    )
    return tuple(Slot(tol_ns, capacity) for tol_ns, sender, capacity in rows if sender == index)


def _digest(mission: MissionLog, index: int, navigator: str, stated: str) -> str:
    parts = [
        mission.name, mission.seed, mission.vehicles, index, navigator, stated, repr(mission.link),
        mission.setup.text, None if mission.chart is None else mission.chart.sha256,
    ]  # fmt: skip
    return hashlib.sha256(json.dumps(parts).encode()).hexdigest()
