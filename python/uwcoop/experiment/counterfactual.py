"""What would have been: a log with a vehicle left out, other losses, another modem or shorter packets.

What the sensors said and when signals were heard stays as it was. Every change is named in the log's `counterfactual`,
and from there in tables and `summary.json`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.acoustics.losses import Signals, survival
from uwcoop.acoustics.modem import frames_of, link_of
from uwcoop.acoustics.schedule import slot_capacity_bytes
from uwcoop.errors import LogError, ScenarioError
from uwcoop.scenario.base import nearest
from uwcoop.scenario.setup import MissionSetup
from uwcoop.world.random_streams import Purpose, stream

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from uwcoop.missionlog import Columns, MissionLog
    from uwcoop.scenario.acoustics import Acoustics

__all__ = ["CHANGEABLE", "with_acoustics", "with_capacity", "without_vehicles"]

CHANGEABLE = ("acoustics.loss", "acoustics.losses", "acoustics.modem")
"""Keys of `[acoustics]` that can be other than they were: when signals were heard is a fact."""
_NO_PLAN = {"modem": "unlimited", "slot_s": 1.0, "max_range_m": 1e5}
"""A log without a schedule gets its losses and modem read within this table."""
_PLACES = ("vehicle", "sender", "receiver", "peer", "poller")
"""Columns that hold a vehicle's index."""


def without_vehicles(log: MissionLog, names: Sequence[str]) -> MissionLog:
    """The log as if these vehicles had not been there: without their events, slots, polls and what was heard of them.

    Raises:
        LogError: an unknown vehicle, none left, or a mission whose roles are exchanged (they depend on all vehicles).
    """
    for name in names:
        if name not in log.vehicles:
            raise LogError(f"without {name!r}: {nearest(name, list(log.vehicles))}")
    kept = [k for k, name in enumerate(log.vehicles) if name not in names]
    if not names:
        return log
    if not kept:
        raise LogError(f"without {', '.join(names)}: mission {log.name!r} has no vehicle left")
    if "role_taken" in log.events:
        raise LogError(f"mission {log.name!r} exchanges roles: which vehicle is where depends on all of them")
    place = np.full(len(log.vehicles), -1)
    place[kept] = np.arange(len(kept))
    heard = _rows(log.receptions, place)
    payloads = [log.payloads[k] for k in heard] if log.receptions else log.payloads
    fuses = log.setup.fuses_ranges
    return replace(
        log,
        vehicles=tuple(log.vehicles[k] for k in kept),
        events={kind: _left(table, place) for kind, table in log.events.items()},
        slots=_left(log.slots, place),
        opportunities=_left(log.opportunities, place),
        receptions=_left(log.receptions, place),
        payloads=payloads,
        polls=_left(log.polls, place),
        truth=None if log.truth is None else log.truth.isel(vehicle=kept),
        setup=replace(log.setup, fuses_ranges=tuple(fuses[k] for k in kept) if fuses else ()),
        counterfactual=(*log.counterfactual, f"without {', '.join(dict.fromkeys(names))}"),
    )


def with_acoustics(log: MissionLog, overrides: Sequence[str]) -> MissionLog:
    """The log with other losses or another modem, by the overrides `acoustics.loss…`, `acoustics.losses…` and
    `acoustics.modem…`.

    A signal that no frame of could survive stays lost (a collision, half duplex, a blackout). The others survive by the
    new losses: instead of the old ones where the log has a schedule, else in addition to what was heard. A modem changes
    frames and air time; launches and arrivals stay.

    Raises:
        ScenarioError: a key that cannot be changed in a log, or a value outside its bound.
        ScheduleError: slots that are too short for a packet of the modem.
        LogError: a loss that depends on where the bow points.
    """
    if not overrides:
        return log
    changed = [override.partition("=")[0].strip() for override in overrides]
    for key in changed:
        if not any(key == known or key.startswith((f"{known}.", f"{known}[")) for known in CHANGEABLE):
            raise ScenarioError(
                f"override {key!r}: mission {log.name!r} is a log and has happened; of acoustics only "
                f"{', '.join(CHANGEABLE)} can be changed"
            )
    planned = log.setup.acoustics is not None
    tables = log.setup.tables()
    if not planned:
        tables = {**tables, "acoustics": {**_NO_PLAN}}
    setup = MissionSetup.parse(tables).with_overrides(overrides)
    plan = setup.acoustics
    assert plan is not None  # the overrides are of this table
    log = replace(log, counterfactual=(*log.counterfactual, *(o.strip() for o in overrides)))
    if any(key.startswith("acoustics.modem") for key in changed):
        log = _with_modem(log, plan, planned)
    if any(key.startswith("acoustics.loss") for key in changed):
        log = _with_losses(log, plan, planned)
    return replace(log, setup=setup if planned else log.setup)


def with_capacity(log: MissionLog, capacity_bytes: int) -> MissionLog:
    """The log with slots of at most so many bytes, `log.capacity_bytes`.

    Raises:
        LogError: a capacity below 1 byte, or a log without slots.
    """
    if isinstance(capacity_bytes, bool) or not isinstance(capacity_bytes, int) or capacity_bytes < 1:
        raise LogError(f"log.capacity_bytes is {capacity_bytes!r}: must be a whole number of at least 1")
    if not log.slots:
        raise LogError(f"mission {log.name!r} has no slots: log.capacity_bytes changes nothing")
    fewer = np.minimum(log.slots["capacity_bytes"], capacity_bytes)
    return replace(
        log,
        slots={**log.slots, "capacity_bytes": fewer},
        counterfactual=(*log.counterfactual, f"slots of at most {capacity_bytes} bytes"),
    )


def _rows(table: Columns, place: NDArray[np.int64]) -> NDArray[np.intp]:
    """Rows in which no vehicle is named that is left out."""
    if not table:
        return np.zeros(0, dtype=np.intp)
    named = [place[table[name]] >= 0 for name in _PLACES if name in table]
    return np.flatnonzero(np.logical_and.reduce(named))


def _left(table: Columns, place: NDArray[np.int64]) -> Columns:
    rows = _rows(table, place)
    left = {name: column[rows] for name, column in table.items()}
    return {name: place[column] if name in _PLACES else column for name, column in left.items()}


def _with_modem(log: MissionLog, plan: Acoustics, planned: bool) -> MissionLog:
    link = replace(link_of(plan), sound_speed_mps=log.link.sound_speed_mps)
    most = slot_capacity_bytes(plan) if planned else link.frame_bytes * link.max_frames
    slots, opportunities = dict(log.slots), dict(log.opportunities)
    if slots:
        slots["capacity_bytes"] = (
            np.full_like(slots["capacity_bytes"], most)
            if planned
            else np.minimum(slots["capacity_bytes"], most)
        )
    if opportunities:
        longest = int(slots["capacity_bytes"].max()) if slots else most
        # A two-way reply spends bytes beside the packet's.
        frames = min(link.max_frames, frames_of(link, longest) + 1)
        opportunities["draws"] = _draws(log, frames)
    return replace(log, link=link, slots=slots, opportunities=opportunities)


def _with_losses(log: MissionLog, plan: Acoustics, planned: bool) -> MissionLog:
    if any(loss.model == "aspect" for loss in plan.all_losses):
        raise LogError(
            "acoustics.loss of model aspect depends on where each bow points at each launch, which a log does not hold"
        )
    if not log.opportunities:
        raise LogError(f"mission {log.name!r} has no opportunities to hear a signal: losses change nothing")
    table = log.opportunities
    before, survives = table["survive_probability"], np.zeros(len(table["tol_ns"]))
    for sender, receiver in _pairs(table):
        rows = np.flatnonzero((table["sender"] == sender) & (table["receiver"] == receiver))
        launch_s = table["tol_ns"][rows] / 1e9
        travel_s = (table["toa_ns"][rows] - table["tol_ns"][rows]) / 1e9
        none = np.zeros(rows.size)
        signals = Signals(
            sender, receiver, launch_s, launch_s, travel_s * log.link.sound_speed_mps, none, none
        )
        survives[rows] = survival(plan, signals, log.vehicles, log.seed)
    changed = np.where(before > 0, survives, 0.0) if planned else before * survives
    draws = _draws(log, table["draws"].shape[1])
    return replace(log, opportunities={**table, "survive_probability": changed, "draws": draws})


def _draws(log: MissionLog, frames: int) -> NDArray[np.float64]:
    """The log's draws for at least so many frames; a recording, which draws nothing, gets draws by its seed."""
    table = log.opportunities
    have = table["draws"]
    recorded = not have.any()
    if have.shape[1] >= frames and not recorded:
        return np.asarray(have)
    draws = np.empty((len(have), max(frames, have.shape[1])))
    for sender, receiver in _pairs(table):
        rows = np.flatnonzero((table["sender"] == sender) & (table["receiver"] == receiver))
        generator = stream(log.seed, sender, Purpose.LOSS, receiver)
        draws[rows] = generator.random((draws.shape[1], rows.size)).T
    if not recorded:
        draws[:, : have.shape[1]] = have
    return draws


def _pairs(table: Columns) -> Iterable[tuple[int, int]]:
    pairs: NDArray[Any] = np.unique(np.stack([table["sender"], table["receiver"]]), axis=1)
    return [(int(sender), int(receiver)) for sender, receiver in pairs.T]
