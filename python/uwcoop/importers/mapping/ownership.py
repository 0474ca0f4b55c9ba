"""Which vehicles a set of recordings holds, and whose each channel is."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import PurePath
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.errors import LogError
from uwcoop.importers.column_roles import split_label
from uwcoop.importers.import_config import VehicleConfig
from uwcoop.importers.mapping.meanings import channel_meanings, is_range_table
from uwcoop.scenario.base import nearest

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from uwcoop.importers.channels import Channel, SourceFile
    from uwcoop.importers.import_config import ImportConfig

__all__ = ["Owners", "stem_of"]

_VEHICLE_COLUMNS = {"vehicle", "auv", "robot", "platform", "vehicle name", "vehicle id"}
_DRIVERS = {
    "mavros", "dvl", "gps", "imu", "sensors", "sensor", "ping", "altimeter", "pressure", "usbl", "modem", "tf", "rosout",
    "navigation", "nav", "ekf", "localization", "camera", "sonar", "depth", "ahrs", "ins", "gnss", "diagnostics",
    "waterlinked", "ping1d", "microstrain", "clock",
}  # fmt: skip
"""First words of topics that are those of a driver, not of a vehicle."""
_OF_ONE = ("moos/", "mavlink/", "dataflash/")
"""Types of formats whose files are of one vehicle each: their names do not begin with it."""
_SELF_SUFFICIENT = (
    {"heading", "odometry"},
    {"ground_velocity", "fix", "odometry", "depth", "pressure", "usbl"},
)


def stem_of(source: str) -> str:
    """A file's name without its endings, as a name of a vehicle or mission may be."""
    stem = PurePath(source).name.split(".")[0] or "recording"
    return "".join(c if c.isalnum() or c in "_-" else "-" for c in stem)


class Owners:
    """Tells for each channel and vehicle whether it is the vehicle's, and which of its rows.

    Raises:
        LogError: two files of one name, a vehicle whose file or rows are not there, or none at all.
    """

    def __init__(self, config: ImportConfig, sources: Sequence[SourceFile]) -> None:
        names = [source.name for source in sources]
        for name in names:
            if names.count(name) > 1:
                raise LogError(
                    f"two files are called {name!r}: rename one, since a vehicle is told by its file's name"
                )
        self.sources = sources
        self.channels = [channel for source in sources for channel in source.channels]
        self.notes: list[str] = []
        self.vehicles = tuple(config.vehicles) or self._found()
        for vehicle in config.vehicles:
            self._check(vehicle)
        self._prefixes = tuple(f"{_namespace(v)}/" for v in self.vehicles)

    def rows(self, vehicle: VehicleConfig, channel: Channel) -> NDArray[np.bool_] | None:
        """(N,) the rows of the channel that are the vehicle's; None: it is not the vehicle's at all."""
        if vehicle.source is not None and not _is_source(vehicle.source, channel):
            return None
        if channel.kind == "table":
            return self._rows_of_table(vehicle, channel)
        whole = np.ones(channel.count, dtype=bool)
        name = channel.name.lstrip("/")
        if name.startswith(f"{_namespace(vehicle)}/"):
            return whole
        if vehicle.namespace is not None or any(name.startswith(prefix) for prefix in self._prefixes):
            return None
        alone = len([v for v in self.vehicles if v.source is None or _is_source(v.source, channel)]) == 1
        return whole if alone else None

    def namesake(self, name: str) -> str | None:
        """The vehicle in whose namespace a topic is."""
        plain = name.lstrip("/")
        for vehicle, prefix in zip(self.vehicles, self._prefixes, strict=True):
            if plain.startswith(prefix):
                return vehicle.name
        return None

    def _rows_of_table(self, vehicle: VehicleConfig, channel: Channel) -> NDArray[np.bool_] | None:
        if vehicle.where:
            kept = np.ones(channel.count, dtype=bool)
            for label, text in vehicle.where.items():
                kept &= _texts(channel, label) == text
            return kept if kept.any() else None
        whole = np.ones(channel.count, dtype=bool)
        named = _vehicle_column(channel)
        if named is not None:
            kept = np.asarray(_texts(channel, named) == vehicle.name)
            return kept if kept.any() else None
        if vehicle.source is not None or stem_of(channel.source) == vehicle.name:
            return whole
        # A table of one vehicle may be called as it likes, where there is only one.
        return whole if len(self.vehicles) == 1 else None

    def _check(self, vehicle: VehicleConfig) -> None:
        names = sorted({channel.source for channel in self.channels})
        if vehicle.source is not None and not any(_is_source(vehicle.source, c) for c in self.channels):
            hint = nearest(vehicle.source, names)
            raise LogError(f"vehicle {vehicle.name}: source {vehicle.source!r} is none of the files: {hint}")
        tables = [c for c in self.channels if c.kind == "table"]
        for label in vehicle.where:
            if not any(label in c.columns for c in tables):
                known = list(dict.fromkeys(held for c in tables for held in c.columns))
                raise LogError(
                    f"vehicle {vehicle.name}: where: there is no column {label!r}: {nearest(label, known)}"
                )
        for channel in self.channels:
            for label, text in vehicle.where.items():
                if (
                    channel.kind == "table"
                    and label in channel.columns
                    and not (_texts(channel, label) == text).any()
                ):
                    held = ", ".join(sorted(set(_texts(channel, label).tolist()))[:8])
                    raise LogError(
                        f"vehicle {vehicle.name}: no row of {channel.source} has {label} = {text!r}: it holds {held}"
                    )

    def _found(self) -> tuple[VehicleConfig, ...]:
        names = dict.fromkeys([*self._of_tables(), *self._of_namespaces()])
        if not names and self.channels:
            usable = [c for c in self.channels if c.kind != "table" and channel_meanings(c)]
            if usable:
                names = dict.fromkeys([stem_of(usable[0].source)])
        if not names:
            raise LogError(
                f"{', '.join(source.name for source in self.sources)}: no vehicle's sensors are recognised: it holds "
                f"{_listed(self.channels)}; name them in a TOML file (--inspect proposes one)"
            )
        self.notes.append(f"vehicles found by the names of topics, files and rows: {', '.join(names)}")
        return tuple(VehicleConfig(name=name) for name in names)

    def _of_tables(self) -> Iterable[str]:
        for channel in self.channels:
            if channel.kind != "table" or is_range_table(channel) or not channel_meanings(channel):
                continue
            named = _vehicle_column(channel)
            if named is None:
                yield stem_of(channel.source)
            else:
                yield from sorted(set(_texts(channel, named).tolist()) - {""})

    def _of_namespaces(self) -> Iterable[str]:
        roles: dict[str, set[str]] = {}
        for channel in self.channels:
            parts = channel.name.strip("/").split("/")
            if channel.kind == "table" or channel.kind.startswith(_OF_ONE) or len(parts) < 2:
                continue
            if parts[0].lower() in _DRIVERS or parts[0].isdigit():
                continue
            roles.setdefault(parts[0], set()).update(m.role for m in channel_meanings(channel))
        return [name for name, own in roles.items() if all(own & need for need in _SELF_SUFFICIENT)]


def _listed(channels: Sequence[Channel]) -> str:
    shown = ", ".join(f"{c.name} ({c.kind})" for c in channels[:6])
    return (shown + (f" and {len(channels) - 6} more" if len(channels) > 6 else "")) or "nothing"


def _namespace(vehicle: VehicleConfig) -> str:
    return (vehicle.namespace or vehicle.name).strip("/")


def _is_source(name: str, channel: Channel) -> bool:
    return name in (channel.source, stem_of(channel.source))


def _vehicle_column(channel: Channel) -> str | None:
    return next((label for label in channel.columns if split_label(label)[0] in _VEHICLE_COLUMNS), None)


def _texts(channel: Channel, label: str) -> NDArray[np.object_]:
    if label not in channel.columns:
        return np.full(channel.count, "", dtype=object)
    column = channel.columns[label]
    if column.dtype.kind == "f":
        return np.array([*(f"{value:g}" for value in column.tolist()), None], dtype=object)[:-1]
    return np.asarray(column, dtype=object)
