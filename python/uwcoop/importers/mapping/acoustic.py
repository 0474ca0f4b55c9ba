"""Acoustic ranges of logs: between vehicles as opportunities with measured travel times, to beacons as events."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.acoustics.modem import MODEMS
from uwcoop.errors import LogError
from uwcoop.importers.import_config import RangeSource
from uwcoop.importers.mapping.binding import (
    Binding,
    filled_columns,
    find_channel,
    refuse_idle,
    unclaimed_ranges,
)
from uwcoop.importers.mapping.heading import stated_sigma
from uwcoop.importers.mapping.meanings import is_range_table, range_columns
from uwcoop.importers.mapping.series import Series, series_of
from uwcoop.missionlog.model import OPPORTUNITY_COLUMNS, SLOT_COLUMNS, Columns, columns
from uwcoop.scenario.base import nearest

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from uwcoop.importers.channels import Channel
    from uwcoop.importers.import_config import Beacon, ImportConfig
    from uwcoop.importers.mapping.ownership import Owners
    from uwcoop.importers.mapping.vehicle_data import Known, MissionParts

__all__ = ["Ranges", "add_beacon_ranges", "opportunities_of", "range_channels", "read_ranges"]

SIGMA_M = 1.0


@dataclass(frozen=True)
class Ranges:
    """Ranges of one direction between two names."""

    t_ns: NDArray[np.int64]
    """(N,) when the signal that was measured arrived."""
    range_m: NDArray[np.float64]
    sigma_m: NDArray[np.float64]
    sender: str
    """Of a two-way range who answered."""
    receiver: str
    """Who has the range."""
    one_way: bool


def read_ranges(
    config: ImportConfig, owners: Owners, beacons: Sequence[Beacon], offsets: Mapping[tuple[str, str], int]
) -> tuple[list[Ranges], set[tuple[str, str]], list[str]]:
    """All ranges that are asked for, and those of tables that say from whom and to whom; `Channel.key` of those that hold
    them, and what is to be said.

    Raises:
        LogError: a topic, vehicle or beacon that is not there, or a direction that only the user can tell.
    """
    names = [v.name for v in owners.vehicles] + [b.name for b in beacons]
    found: list[Ranges] = []
    claimed: set[tuple[str, str]] = set()
    said: list[str] = []
    for told in config.ranges:
        refuse_idle("ranges", "range", told)
        for channel, namesake in _channels(told, owners):
            claimed.add(channel.key)
            found += _read(
                told,
                channel,
                namesake,
                owners,
                names,
                said,
                offsets.get(channel.key, 0),
                config.sound_speed_mps,
            )
    for channel in owners.channels:
        if is_range_table(channel) and channel.key not in claimed:
            claimed.add(channel.key)
            found += _read(
                RangeSource(),
                channel,
                None,
                owners,
                names,
                said,
                offsets.get(channel.key, 0),
                config.sound_speed_mps,
            )
    for channel in unclaimed_ranges(owners, claimed):
        hint = f'[[ranges]] topic = "{channel.name}"'
        said.append(f"{channel.name} looks like acoustic ranges and is not used: {hint}")
    return found, claimed, said


def range_channels(config: ImportConfig, owners: Owners) -> list[Channel]:
    """The channels of which `read_ranges` reads.

    Raises:
        LogError: a topic that is not there.
    """
    told = [channel for table in config.ranges for channel, _ in _channels(table, owners)]
    return told + [channel for channel in owners.channels if is_range_table(channel)]


def _channels(told: RangeSource, owners: Owners) -> list[tuple[Channel, str | None]]:
    if not isinstance(told.topic, str):
        raise LogError('ranges: each of [[ranges]] needs topic = "…"')
    if "{vehicle}" not in told.topic:
        channel = find_channel(owners, told.topic, told.source)
        if channel is None:
            raise LogError(
                f"ranges: there is no topic {told.topic!r}: {nearest(told.topic, [c.name for c in owners.channels])}"
            )
        return [(channel, owners.namesake(channel.name))]
    pairs: list[tuple[Channel, str | None]] = []
    for vehicle in owners.vehicles:
        channel = find_channel(owners, told.topic.replace("{vehicle}", vehicle.name), told.source, vehicle)
        if channel is not None:
            pairs.append((channel, vehicle.name))
    if not pairs:
        raise LogError(f"ranges: no vehicle has the topic {told.topic!r}")
    return pairs


def _read(
    told: RangeSource,
    channel: Channel,
    namesake: str | None,
    owners: Owners,
    names: Sequence[str],
    said: list[str],
    offset_ns: int,
    speed_mps: float,
) -> list[Ranges]:
    defaults = {"range": "range", "variance": "variance"} if channel.kind == "sensor_msgs/msg/Range" else {}
    labels = range_columns(channel)
    tabled: dict[str, str] = {q: labels[q] for q in ("range", "travel", "sigma") if q in labels}
    columns_of = filled_columns("ranges", "range", channel, {**defaults, **tabled, **told.columns})
    binding = Binding("ranges", "range", channel, columns_of, {}, "", told.valid or "", told)
    texts = {
        role: np.asarray(channel.columns[labels[role]], dtype=object)
        for role in ("from", "to", "kind")
        if role in labels
    }
    rows = np.arange(channel.count)
    groups: list[tuple[str, str, bool, NDArray[np.bool_]]] = []
    if told.from_ is None and {"from", "to"} <= texts.keys():
        kinds = texts.get("kind", np.full(channel.count, _kind(told, labels), dtype=object))
        keys = list(
            zip(texts["from"].tolist(), texts["to"].tolist(), map(_is_one_way, kinds.tolist()), strict=True)
        )
        for key in dict.fromkeys(keys):
            own = np.array([k == key for k in keys])
            groups.append((str(key[0]), str(key[1]), key[2], own))
    else:
        start, end = _ends(told, channel, namesake, owners, names)
        groups.append((start, end, _kind(told, labels) == "one-way", rows >= 0))
    made = []
    for start, end, one_way, own in groups:
        for name in (start, end):
            if name not in names:
                raise LogError(
                    f"ranges of {channel.name}: {name!r} is no vehicle or beacon: {nearest(name, names)}"
                )
        single = Binding(
            binding.vehicle,
            "range",
            channel,
            columns_of,
            {},
            "",
            binding.valid,
            told,
            None if own.all() else own,
        )
        series = series_of(single, offset_ns)
        made.append(_ranges(told, series, (start, end), one_way, speed_mps))
        kind = "one-way" if one_way else "two-way"
        said.append(
            f"ranges {start} - {end}: {len(series.t_ns):,} of {series.total:,} rows of {channel.name}; {kind}; sigma "
            f"{np.median(made[-1].sigma_m):.3g} m" + "".join(f"; {phrase}" for phrase in series.said)
        )
    return made


def _ends(
    told: RangeSource, channel: Channel, namesake: str | None, owners: Owners, names: Sequence[str]
) -> tuple[str, str]:
    start = told.from_ or namesake
    if start is None:
        raise LogError(f'ranges of {channel.name}: from = "…" is missing: {", ".join(names)}')
    others = [name for name in names if name != start]
    end = told.to or (others[0] if len(others) == 1 else None)
    if end is None:
        raise LogError(
            f'ranges of {channel.name} from {start}: to = "…" is missing: {", ".join(others) or "nobody else"}'
        )
    return start, end


def _kind(told: RangeSource, labels: Mapping[str, str]) -> str:
    """As the settings say, else as the name of the column of travel times does, else two-way."""
    name = labels.get("travel", "").lower()
    if "kind" not in told.model_fields_set and ("owtt" in name or "one" in name):
        return "one-way"
    return told.kind


def _is_one_way(text: str) -> bool:
    plain = "".join(c for c in str(text).lower() if c.isalpha())
    return plain in ("oneway", "owtt", "ow")


def _ranges(
    told: RangeSource, series: Series, ends: tuple[str, str], one_way: bool, speed_mps: float
) -> Ranges:
    if "range" in series.values:
        range_m = series.values["range"]
    else:
        range_m = series.values["travel"] * speed_mps / (1 if one_way else 2)
    if told.sigma_m is not None:
        sigma = np.full(len(range_m), told.sigma_m)
    else:
        stated = stated_sigma(series)
        sigma = np.full(len(range_m), SIGMA_M) if stated is None else stated
    t_ns = series.t_ns
    if told.stamp == "launch":
        t_ns = t_ns + np.round((1 if one_way else 2) * range_m / speed_mps * 1e9).astype(np.int64)
    # One-way: `to` heard `from`. Two-way: `from` polled, `to` answered, and `from` has the range.
    sender, receiver = ends if one_way else ends[::-1]
    return Ranges(t_ns, range_m, sigma, sender, receiver, one_way)


def opportunities_of(
    config: ImportConfig, ranges: Sequence[Ranges], vehicles: Sequence[str]
) -> tuple[Columns, Columns]:
    """Slots and opportunities on absolute times: a packet rides on each range between two vehicles, for certain."""
    between = [r for r in ranges if r.sender in vehicles and r.receiver in vehicles]
    if not between:
        return {}, {}
    modem = MODEMS[config.modem]
    capacity = min(modem.frame_bytes * modem.max_frames, 2**31 - 1)
    toa = np.concatenate([r.t_ns for r in between])
    travel = np.round(np.concatenate([r.range_m for r in between]) / config.sound_speed_mps * 1e9).astype(
        np.int64
    )
    sender = np.concatenate([np.full(len(r.t_ns), vehicles.index(r.sender), np.int64) for r in between])
    receiver = np.concatenate([np.full(len(r.t_ns), vehicles.index(r.receiver), np.int64) for r in between])
    tol = toa - travel
    order = np.lexsort((receiver, sender, tol))
    tol, travel, sender, receiver = tol[order], travel[order], sender[order], receiver[order]
    for k in range(1, len(tol)):  # no two signals start together
        tol[k] = max(tol[k], tol[k - 1] + 1000)
    count = len(tol)
    slots = columns(
        SLOT_COLUMNS, tol_ns=tol, sender=sender, capacity_bytes=np.full(count, capacity, np.int64)
    )
    found = columns(
        OPPORTUNITY_COLUMNS, tol_ns=tol, sender=sender, receiver=receiver, toa_ns=tol + travel,
        survive_probability=np.ones(count),
    )  # fmt: skip
    found["draws"] = np.zeros((count, modem.max_frames))
    return slots, found


def add_beacon_ranges(
    ranges: Sequence[Ranges], beacons: Sequence[Beacon], known: Sequence[Known], parts: MissionParts
) -> None:
    """`beacon_range` events of the vehicle at the other end."""
    places = {beacon.name: beacon for beacon in beacons}
    by_name = {own.name: own for own in known}
    for found in ranges:
        ends = (found.receiver, found.sender)
        beacon = next((places[name] for name in ends if name in places), None)
        own = next((by_name[name] for name in ends if name in by_name), None)
        if beacon is None or own is None:
            continue
        if beacon.place_m is not None:
            east, north = beacon.place_m
        elif own.frame is not None:
            assert beacon.place_deg is not None
            east, north = own.frame.to_local([beacon.place_deg[0]], [beacon.place_deg[1]])[0].tolist()
        else:
            raise LogError(
                f"beacon {beacon.name}: place_deg needs a mission with latitude and longitude: origin_deg"
            )
        count = len(found.t_ns)
        parts.add(
            "beacon_range", own.index, found.t_ns, measured_ns=found.t_ns, beacon_e_m=np.full(count, east),
            beacon_n_m=np.full(count, north), beacon_depth_m=np.full(count, beacon.depth_m), range_m=found.range_m,
            sigma_m=found.sigma_m, one_way=np.full(count, found.one_way),
        )  # fmt: skip
