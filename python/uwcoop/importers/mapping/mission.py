"""Recordings and `import.toml` → a mission log with its import report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.acoustics.link import Link
from uwcoop.acoustics.modem import MODEMS
from uwcoop.errors import LogError
from uwcoop.frames import Origin
from uwcoop.importers.import_config import ImportConfig, UsblSensor
from uwcoop.importers.mapping import heading, position, velocity, vertical
from uwcoop.importers.mapping.acoustic import (
    Ranges,
    add_beacon_ranges,
    opportunities_of,
    range_channels,
    read_ranges,
)
from uwcoop.importers.mapping.binding import Binding, bind_vehicle
from uwcoop.importers.mapping.clocks import clock_offsets, common_clock, utc_text
from uwcoop.importers.mapping.course_check import course_lines
from uwcoop.importers.mapping.ownership import Owners, stem_of
from uwcoop.importers.mapping.series import Series, interpolated, series_of
from uwcoop.importers.mapping.truth import truth_of
from uwcoop.importers.mapping.vehicle_data import Known, MissionParts
from uwcoop.importers.times import parse_times
from uwcoop.missionlog.model import Columns, MissionLog, event_columns
from uwcoop.missionlog.validate import validate
from uwcoop.scenario.base import nearest
from uwcoop.scenario.setup import MissionSetup

if TYPE_CHECKING:
    from uwcoop.importers.channels import SourceFile

__all__ = ["RIDE", "mission_of"]

RIDE = "packets ride on the ranges that were measured"
"""What of an imported mission is not as it happened."""
_LONGEST_SILENCE_NS = 6 * 3_600 * 10**9
Read = tuple[Binding, Series]
_ADD: dict[str, Any] = {
    "heading": heading.add_heading, "turn_rate": heading.add_turn_rate, "depth": vertical.add_depth,
    "pressure": vertical.add_pressure, "ground_velocity": velocity.add_velocity, "water_velocity": velocity.add_velocity,
    "command": velocity.add_command, "odometry": velocity.add_odometry, "fix": position.add_fix,
    "altimeter": vertical.add_altimeter, "water_depth": vertical.add_water_depth,
}  # fmt: skip
"""In this order: later ones use what earlier ones know of the vehicle."""


def mission_of(sources: Sequence[SourceFile], config: ImportConfig) -> MissionLog:
    """The mission that recordings hold, as the configuration says.

    Raises:
        LogError: what is missing, ambiguous or impossible; one line that says what there is.
    """
    link = _link(config)
    owners = Owners(config, sources)
    said = [note for source in sources for note in source.notes] + owners.notes
    bound: dict[str, list[Binding]] = {}
    for vehicle in owners.vehicles:
        bound[vehicle.name], notes = bind_vehicle(config, owners, vehicle)
        said += notes
    _refuse_nothing(bound, sources)
    channels = [b.channel for bindings in bound.values() for b in bindings] + range_channels(config, owners)
    offsets, notes = clock_offsets(list({id(c): c for c in channels}.values()), config.align_clocks)
    said += notes
    absolute, notes = common_clock(channels, offsets)
    said += notes
    read = {
        name: [(b, series_of(b, offsets.get(b.channel.key, 0))) for b in own] for name, own in bound.items()
    }
    ranges, claimed, range_said = read_ranges(config, owners, config.beacons, offsets)
    frame, how = position.local_frame(config, [item for own in read.values() for item in own])
    parts = MissionParts()
    known = [Known(k, vehicle.name, frame) for k, vehicle in enumerate(owners.vehicles)]
    for own in known:
        _add_vehicle(own, {b.role: (b, s) for b, s in read[own.name]}, parts)
    _add_usbl(known, read, parts)
    parts.said += range_said
    add_beacon_ranges(ranges, config.beacons, known, parts)
    parts.said.append(f"frame: {how}" + ("" if frame is None else f"; {frame.description}"))
    unused = _unused(sources, {c.key for c in channels} | claimed)
    said = [*said, *parts.said, *([unused] if unused else [])]
    return _assembled(config, link, sources, known, parts, ranges, read, absolute, said)


def _refuse_nothing(bound: Mapping[str, Sequence[Binding]], sources: Sequence[SourceFile]) -> None:
    held = [f"{c.name} ({c.kind})" for source in sources for c in source.channels]
    there = ", ".join(held[:8]) + (f" and {len(held) - 8} more" if len(held) > 8 else "")
    for name, own in bound.items():
        roles = {b.role for b in own} - {"truth"}
        if not roles:
            raise LogError(f"vehicle {name}: no channel is one of its sensors; the files hold {there}")
        if not roles & {"ground_velocity", "water_velocity", "command", "odometry", "fix", "usbl"}:
            raise LogError(
                f"vehicle {name}: it has {', '.join(sorted(roles))}, and nothing that says how it moves or where it is: "
                f"one of fix, usbl, ground_velocity, water_velocity, command, odometry is needed; the files hold {there}"
            )


def _add_vehicle(known: Known, read: Mapping[str, Read], parts: MissionParts) -> None:
    for role, add in _ADD.items():
        if role in read:
            add(*read[role], known, parts)
    if known.attitude is None and {"ground_velocity", "water_velocity"} & read.keys():
        parts.said.append(
            f"CHECK {known.name}: it has a velocity and no heading, so that nothing tells where it goes"
        )


def _add_usbl(known: Sequence[Known], read: Mapping[str, Sequence[Read]], parts: MissionParts) -> None:
    """USBL comes last: a ship's positions must be known."""
    names = [own.name for own in known]
    for own in known:
        for binding, series in read[own.name]:
            if binding.role != "usbl":
                continue
            settings = binding.settings
            assert isinstance(settings, UsblSensor)
            ship = None
            if settings.ship is not None:
                if settings.ship not in names:
                    raise LogError(
                        f"{binding.where}: ship {settings.ship!r}: {nearest(settings.ship, names)}"
                    )
                carrier = known[names.index(settings.ship)]
                fixes = _of_vehicle(parts.events.get("fix", []), carrier.index)
                if fixes is None:
                    raise LogError(f"{binding.where}: ship {carrier.name} has no fixes")
                series = series.thinned("usbl", settings.max_rate_hz)
                measured_ns = position.measured_ns(series, settings)
                at = [interpolated(measured_ns, fixes["t_ns"], fixes[axis]) for axis in ("e_m", "n_m")]
                ship = carrier, np.column_stack(at)
            position.add_usbl(binding, series, own, parts, ship)


def _of_vehicle(tables: Sequence[Columns], vehicle: int) -> Columns | None:
    return next((t for t in tables if len(t["vehicle"]) and t["vehicle"][0] == vehicle), None)


def _unused(sources: Sequence[SourceFile], used: set[tuple[str, str]]) -> str:
    rest = [c.name for s in sources for c in s.channels if c.key not in used]
    rest += [f"{o.name} ({o.reason})" for s in sources for o in s.omitted if o.count]
    if not rest:
        return ""
    return f"not used: {', '.join(rest[:12])}" + (f" and {len(rest) - 12} more" if len(rest) > 12 else "")


def _assembled(
    config: ImportConfig,
    link: Link,
    sources: Sequence[SourceFile],
    known: Sequence[Known],
    parts: MissionParts,
    ranges: Sequence[Ranges],
    read: Mapping[str, Sequence[Read]],
    absolute: bool,
    said: list[str],
) -> MissionLog:
    names = tuple(own.name for own in known)
    slots, opportunities = opportunities_of(config, ranges, names)
    begin, end = _span(config, parts, opportunities, absolute)
    zero = begin // 10**9 * 10**9
    events, cut = {}, 0
    for kind, tables in parts.events.items():
        table = {name: np.concatenate([t[name] for t in tables]) for name in tables[0]}
        inside = (table["t_ns"] >= begin) & (table["t_ns"] <= end)
        cut += int((~inside).sum())
        if inside.any():
            events[kind] = _shifted(kind, {name: column[inside] for name, column in table.items()}, zero)
    if not events:
        raise LogError(f"nothing was recorded between start {config.start} and end {config.end}")
    slots, opportunities, lost = _acoustics(slots, opportunities, begin, end, zero)
    if cut or lost:
        said.append(f"outside start and end: {cut:,} events and {lost:,} ranges left out")
    for k, name in enumerate(names):
        said += course_lines(name, {kind: _own(table, k) for kind, table in events.items() if _own(table, k)})
    stamps = [table["t_ns"] for table in events.values()] + (
        [opportunities["toa_ns"]] if opportunities else []
    )
    _refuse_long_silence(np.unique(np.concatenate(stamps)), zero, absolute)
    duration = -(-max(int(t.max()) for t in stamps) // 10**9) * 10**9 + 10**9
    truth = truth_of(names, read, known, zero, duration, said)
    name = config.name or stem_of(sources[0].name)
    if absolute:
        files = ", ".join(f"{s.name} ({s.format})" for s in sources)
        said.insert(0, f"{name}: {files}; from {utc_text(zero)}, {duration / 1e9:g} s")
    log = MissionLog(
        name=name,
        seed=0,
        vehicles=names,
        duration_ns=duration,
        link=link,
        events=events,
        slots=slots,
        opportunities=opportunities,
        origin=Origin() if known[0].frame is None else known[0].frame.origin,
        setup=_setup(config, names, ranges, name),
        truth=truth,
        notes=tuple(dict.fromkeys(said)),
        epoch_ns=zero if absolute else None,
        counterfactual=(RIDE,) if opportunities else (),
    )
    validate(log)
    return log


def _span(config: ImportConfig, parts: MissionParts, heard: Columns, absolute: bool) -> tuple[int, int]:
    """First and last instant that is used."""
    stamps = [t["t_ns"] for tables in parts.events.values() for t in tables if len(t["t_ns"])]
    if not stamps:
        raise LogError("the recordings hold no event that can be used")
    stamps += [heard["tol_ns"], heard["toa_ns"]] if heard else []
    begin, end = min(int(t.min()) for t in stamps), max(int(t.max()) for t in stamps)
    for key in ("start", "end"):
        text = getattr(config, key)
        if text is None:
            continue
        if not absolute:
            raise LogError(
                f"{key} = {text!r} is a date, but the recordings' times count from a zero of their own"
            )
        try:
            instant = int(parse_times([text]).t_ns[0])
        except ValueError as error:
            raise LogError(f"{key} = {text!r}: {error}") from error
        begin, end = (max(begin, instant), end) if key == "start" else (begin, min(end, instant))
    return begin, end


def _refuse_long_silence(t_ns: Any, zero: int, absolute: bool) -> None:
    """A file of many dives is not one mission."""
    gaps = np.diff(t_ns)
    if not gaps.size or gaps.max() <= _LONGEST_SILENCE_NS:
        return
    k = int(np.argmax(gaps))
    ends = [utc_text(int(t) + zero) if absolute else f"{t / 1e9:.1f} s" for t in t_ns[k : k + 2]]
    raise LogError(
        f"nothing is recorded from {ends[0]} to {ends[1]}, {gaps[k] / 3.6e12:,.1f} hours: several missions? start and "
        'end, or of a table where = { column = "text" }, choose one'
    )


def _shifted(kind: str, table: Columns, zero: int) -> Columns:
    moved = {
        name: column - zero if name in ("t_ns", "measured_ns") else column for name, column in table.items()
    }
    return event_columns(kind, moved.pop("t_ns"), moved.pop("vehicle"), **moved)


def _own(table: Columns, vehicle: int) -> Columns:
    own = table["vehicle"] == vehicle
    return {name: column[own] for name, column in table.items()} if own.any() else {}


def _acoustics(
    slots: Columns, opportunities: Columns, begin: int, end: int, zero: int
) -> tuple[Columns, Columns, int]:
    if not slots:
        return slots, opportunities, 0
    inside = (slots["tol_ns"] >= begin) & (opportunities["toa_ns"] <= max(end, begin))
    if not inside.any():
        return {}, {}, len(inside)
    slots = {name: column[inside] for name, column in slots.items()}
    opportunities = {name: column[inside] for name, column in opportunities.items()}
    slots["tol_ns"] = slots["tol_ns"] - zero
    for name in ("tol_ns", "toa_ns"):
        opportunities[name] = opportunities[name] - zero
    return slots, opportunities, int((~inside).sum())


def _link(config: ImportConfig) -> Link:
    if config.modem not in MODEMS:
        raise LogError(f"modem {config.modem!r}: {nearest(config.modem, MODEMS)}")
    modem = MODEMS[config.modem]
    return Link(
        config.modem,
        modem.frame_bytes,
        modem.max_frames,
        modem.frame_s,
        modem.preamble_s,
        config.sound_speed_mps,
    )


def _setup(config: ImportConfig, names: Sequence[str], ranges: Sequence[Ranges], name: str) -> MissionSetup:
    between = [r for r in ranges if r.sender in names and r.receiver in names]
    tables: dict[str, Any] = {
        "name": name,
        "import": config.model_dump(mode="json", exclude_defaults=True, by_alias=True),
        "metrics": {"settle_s": 0.0},
        "vehicles": [{"name": vehicle} for vehicle in names],
    }
    if between:
        sigma = float(np.median(np.concatenate([r.sigma_m for r in between])))
        tables["navigator"] = {"all": {"sigma_range_m": round(sigma, 6)}}
    return MissionSetup.parse(tables)
