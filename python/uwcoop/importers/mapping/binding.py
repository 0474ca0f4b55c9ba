"""Which channel is which sensor of which vehicle: by type where that is enough, by `import.toml` where it is not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from uwcoop.errors import LogError
from uwcoop.importers.import_config import ROLES
from uwcoop.importers.mapping.meanings import channel_meanings, is_acoustic_range
from uwcoop.importers.mapping.ownership import stem_of
from uwcoop.importers.quantities import NEEDS, Meaning
from uwcoop.scenario.base import nearest

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from uwcoop.importers.channels import Channel
    from uwcoop.importers.import_config import ImportConfig, Sensor, VehicleConfig
    from uwcoop.importers.mapping.ownership import Owners

__all__ = [
    "Binding",
    "bind_vehicle",
    "filled_columns",
    "find_channel",
    "refuse_idle",
    "stands_back",
    "unclaimed_ranges",
]

_NOT_BESIDE = {
    "pressure": ("depth",),
    "water_depth": ("altimeter",),
    "odometry": ("ground_velocity",),
    "command": ("ground_velocity", "water_velocity"),
}
"""What is left out where another source of the same is there, unless it is asked for: both would count twice."""
_ONLY_STATED = ("truth",)
_WITH_ARM = (
    "fix", "usbl", "truth", "ground_velocity", "water_velocity", "odometry", "depth", "pressure", "altimeter",
)  # fmt: skip
_WITH_MOUNTING = ("heading", "ground_velocity", "water_velocity", "odometry", "altimeter")


@dataclass(frozen=True)
class Binding:
    """A channel as a sensor."""

    vehicle: str
    role: str
    channel: Channel
    columns: Mapping[str, str]
    """Quantity to column."""
    units: Mapping[str, str]
    """Of quantities, where the type or the settings state one that the file does not."""
    frame: str
    valid: str
    settings: Sensor
    rows: NDArray[np.bool_] | None = None
    """(N,) rows that are the vehicle's; None: all."""

    @property
    def where(self) -> str:
        """How messages name it."""
        return f"vehicle {self.vehicle}: {self.role} of {self.channel.name}"


def bind_vehicle(
    config: ImportConfig, owners: Owners, vehicle: VehicleConfig
) -> tuple[list[Binding], list[str]]:
    """The sensors of one vehicle, and notes on channels that could be one and are not.

    Raises:
        LogError: a topic or column that is named and not there, or a choice that only the user can make; with what
            the files offer.
    """
    found: dict[str, Binding] = {}
    notes: list[str] = []
    for role in ROLES:
        settings = config.sensor(vehicle, role)
        if not settings.use:
            continue
        binding = _stated(config, owners, vehicle, role, settings)
        if binding is None and role not in _ONLY_STATED:
            binding = _by_type(owners, vehicle, role, settings, notes)
        if binding is not None:
            found[role] = binding
    for role in _NOT_BESIDE:
        if role in found and not config.is_stated(vehicle, role):
            other = stands_back(role, found)
            if other:
                dropped = found.pop(role)
                notes.append(
                    f"{vehicle.name}: {role} of {dropped.channel.name} is not used beside {other} of "
                    f"{found[other].channel.name}: [vehicles.{role}] would use it"
                )
    return list(found.values()), notes


def stands_back(role: str, found: Mapping[str, object]) -> str:
    """The role beside which this one is left out; "" for none."""
    return next((other for other in _NOT_BESIDE.get(role, ()) if found.get(other)), "")


def refuse_idle(where: str, role: str, settings: Sensor) -> None:
    """Refuse a lever arm or a mounting where nothing is computed with it.

    Raises:
        LogError: it is told and has no effect.
    """
    for name, roles in (("lever_arm_m", _WITH_ARM), ("mounting_deg", _WITH_MOUNTING)):
        if any(getattr(settings, name)) and role not in roles:
            raise LogError(f"{where}: {role}: {name} has no effect: it goes with {', '.join(roles)}")


def find_channel(
    owners: Owners, topic: str, source: str | None, vehicle: VehicleConfig | None = None
) -> Channel | None:
    """The channel of a name, in the file `source`; None: in the vehicle's own file, where it has one.

    Raises:
        LogError: several files hold one, and nothing says which is meant.
    """
    found = [c for c in owners.channels if topic in (c.name, c.name.lstrip("/"))]
    if source is not None:
        return next((c for c in found if source in (c.source, stem_of(c.source))), None)
    if vehicle is not None:
        if vehicle.source is not None:
            return next((c for c in found if vehicle.source in (c.source, stem_of(c.source))), None)
        found = [c for c in found if stem_of(c.source) == vehicle.name] or found
    if len(found) > 1:
        whose = "ranges" if vehicle is None else f"vehicle {vehicle.name}"
        files = ", ".join(c.source for c in found)
        raise LogError(f'{whose}: topic {topic!r} is in {files}: source = "…" says which is meant')
    return found[0] if found else None


def _stated(
    config: ImportConfig, owners: Owners, vehicle: VehicleConfig, role: str, settings: Sensor
) -> Binding | None:
    """The channel that the settings name, by its topic or by its columns."""
    if settings.topic is None:
        if not settings.columns:
            return None
        for channel in owners.channels:
            rows = owners.rows(vehicle, channel)
            if rows is not None and set(settings.columns.values()) <= set(channel.columns):
                return _bound(vehicle, role, channel, settings, rows)
        own = getattr(vehicle, role)
        if own is None or not own.columns:
            return None
        wanted = ", ".join(settings.columns.values())
        raise LogError(f"vehicle {vehicle.name}: {role}: no channel of it has the columns {wanted}")
    topics = (settings.topic,) if isinstance(settings.topic, str) else settings.topic
    for topic in topics:
        named = find_channel(owners, topic.replace("{vehicle}", vehicle.name), settings.source, vehicle)
        if named is not None:
            rows = owners.rows(vehicle, named) if named.kind == "table" else None
            return _bound(vehicle, role, named, settings, rows)
    own = getattr(vehicle, role)
    if own is None or own.topic is None:
        return None  # what holds for every vehicle need not be there for each
    names = [c.name for c in owners.channels]
    raise LogError(
        f"vehicle {vehicle.name}: {role}: there is no topic {topics[0].replace('{vehicle}', vehicle.name)!r}: "
        f"{nearest(topics[0], names)}"
    )


def _bound(
    vehicle: VehicleConfig, role: str, channel: Channel, settings: Sensor, rows: NDArray[np.bool_] | None
) -> Binding:
    known = [m for m in channel_meanings(channel) if m.role == role] or _alike(channel, role)
    meaning = known[0] if known else Meaning(role, {}, frame="")
    columns = filled_columns(
        f"vehicle {vehicle.name}", role, channel, {**meaning.columns, **settings.columns}
    )
    return _made(vehicle, meaning, channel, columns, settings, rows)


def _alike(channel: Channel, role: str) -> list[Meaning]:
    """The same quantities in another role: a pose as truth, a twist through the water, a fix by USBL."""
    same = {
        "truth": ("fix", "usbl", "odometry"), "usbl": ("fix",), "fix": ("usbl",), "water_velocity": ("ground_velocity",),
        "ground_velocity": ("water_velocity",),
    }  # fmt: skip
    for meaning in channel_meanings(channel):
        if meaning.role in same.get(role, ()):
            columns = dict(meaning.columns)
            if meaning.role == "odometry":
                columns |= {"east": columns["x"], "north": columns["y"]}
            return [Meaning(role, columns, meaning.units, meaning.frame, meaning.valid)]
    return []


def filled_columns(where: str, role: str, channel: Channel, columns: Mapping[str, str]) -> dict[str, str]:
    """Columns that are there, which must fill what the role needs; a single number fills a single quantity."""
    for quantity, label in columns.items():
        if label not in channel.columns and quantity in {q for need in NEEDS.get(role, ()) for q in need}:
            raise LogError(
                f"{where}: {role}: {channel.name} has no column {label!r}: {nearest(label, channel.columns)}"
            )
    there = {quantity: label for quantity, label in columns.items() if label in channel.columns}
    if any(set(need) <= there.keys() for need in NEEDS[role]):
        return there
    numbers = [label for label in channel.columns if not channel.is_text(label) and "stamp" not in label]
    if len(numbers) == 1 and len(NEEDS[role][0]) == 1:
        return {**there, NEEDS[role][0][0]: numbers[0]}
    needs = " or ".join("(" + ", ".join(need) + ")" for need in NEEDS[role])
    raise LogError(
        f"{where}: {role} needs {needs}; {channel.name} ({channel.kind}) has the columns {', '.join(channel.columns)}: "
        f'columns = {{ {NEEDS[role][0][0]} = "…" }} names them'
    )


def _by_type(
    owners: Owners, vehicle: VehicleConfig, role: str, settings: Sensor, notes: list[str]
) -> Binding | None:
    """The only channel whose type, or whose columns' names, say that it is this sensor."""
    candidates: list[tuple[Channel, Meaning, NDArray[np.bool_]]] = []
    for channel in owners.channels:
        rows = owners.rows(vehicle, channel)
        if rows is None or (settings.source is not None and settings.source != channel.source):
            continue
        candidates += [(channel, m, rows) for m in channel_meanings(channel) if m.role == role]
    if not candidates:
        return None
    best = min(_rank(meaning) for _, meaning, _ in candidates)
    first = [candidate for candidate in candidates if _rank(candidate[1]) == best]
    if len(first) > 1:
        offers = ", ".join(f"{channel.name} ({channel.kind})" for channel, _, _ in first)
        raise LogError(
            f'vehicle {vehicle.name}: {role} may be any of {offers}: name one, [vehicles.{role}] topic = "…", '
            "or leave it out, use = false"
        )
    channel, meaning, rows = first[0]
    for other, lesser, _ in candidates:
        if _rank(lesser) > best:
            notes.append(
                f"{vehicle.name}: {other.name} ({other.kind}) could be {role} too: {channel.name} is used"
            )
    columns = {q: label for q, label in meaning.columns.items() if label in channel.columns}
    return _made(vehicle, meaning, channel, columns, settings, rows)


def _rank(meaning: Meaning) -> int:
    """0: the sensor itself; 1: what it can be computed from."""
    return int(meaning.role == "heading" and "mag_x" in meaning.columns)


def _made(
    vehicle: VehicleConfig,
    meaning: Meaning,
    channel: Channel,
    columns: Mapping[str, str],
    settings: Sensor,
    rows: NDArray[np.bool_] | None,
) -> Binding:
    refuse_idle(f"vehicle {vehicle.name}", meaning.role, settings)
    valid = settings.valid or meaning.valid
    if not settings.valid and valid and valid.rsplit(None, 2)[0] not in channel.columns:
        valid = ""
    return Binding(
        vehicle.name, meaning.role, channel, columns, meaning.units, settings.frame or meaning.frame or "enu", valid,
        settings, None if rows is None or rows.all() else rows,
    )  # fmt: skip


def unclaimed_ranges(owners: Owners, claimed: set[tuple[str, str]]) -> list[Channel]:
    """Channels of acoustic ranges that nobody asked for."""
    return [c for c in owners.channels if is_acoustic_range(c) and c.key not in claimed]
