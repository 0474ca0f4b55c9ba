"""What recordings hold, and the `import.toml` that would make a mission of them: `uwcoop import --inspect`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from uwcoop.errors import LogError
from uwcoop.importers.import_config import ROLES, ImportConfig, VehicleConfig
from uwcoop.importers.mapping.binding import stands_back
from uwcoop.importers.mapping.clocks import utc_text
from uwcoop.importers.mapping.meanings import (
    channel_meanings,
    is_acoustic_range,
    is_range_table,
    range_columns,
)
from uwcoop.importers.mapping.ownership import Owners
from uwcoop.importers.mapping.series import recorded_rate_hz

if TYPE_CHECKING:
    from collections.abc import Sequence

    from uwcoop.importers.channels import Channel, SourceFile
    from uwcoop.importers.quantities import Meaning

__all__ = ["ChannelLine", "channel_lines", "proposed_toml"]

_MOST_COLUMNS = 12
_FRAMES = {"heading": ("enu", "ned"), "ground_velocity": ("flu", "frd"), "water_velocity": ("flu", "frd")}


@dataclass(frozen=True)
class ChannelLine:
    """One channel as `--inspect` shows it."""

    source: str
    name: str
    kind: str
    count: int
    rate_hz: float
    span: str
    meaning: str
    columns: tuple[str, ...]
    """Label and least to greatest value, each."""


def channel_lines(sources: Sequence[SourceFile]) -> list[ChannelLine]:
    """All channels, with what each looks like and the ranges of its columns."""
    lines = []
    for source in sources:
        for channel in source.channels:
            meaning = ", ".join(m.role for m in channel_meanings(channel))
            if is_acoustic_range(channel) or is_range_table(channel):
                meaning = "acoustic ranges"
            lines.append(
                ChannelLine(
                    source.name, channel.name, channel.kind, channel.count, recorded_rate_hz(channel), _span(channel),
                    meaning, _columns(channel),
                )
            )  # fmt: skip
        lines += [
            ChannelLine(source.name, o.name, o.kind, o.count, 0.0, "", f"not read: {o.reason}", ())
            for o in source.omitted
        ]
    return lines


def _span(channel: Channel) -> str:
    if not channel.count:
        return ""
    first, last = int(channel.t_ns.min()), int(channel.t_ns.max())
    if channel.clock == "own":
        return f"{first / 1e9:.1f} to {last / 1e9:.1f} s"
    return f"{utc_text(first)} + {(last - first) / 1e9:.1f} s"


def _columns(channel: Channel) -> tuple[str, ...]:
    told = []
    constant = 0
    for label in channel.columns:
        if channel.is_text(label):
            held = sorted({str(v) for v in channel.columns[label].tolist()})
            if label.startswith("header.") or not any(held):
                continue
            told.append(f"{label}: {', '.join(held[:4])}{' …' if len(held) > 4 else ''}")
            continue
        if "stamp." in label or label == "header.seq":
            continue
        values = channel.numbers(label)
        values = values[np.isfinite(values)]
        if not values.size:
            continue
        if values.min() == values.max():
            constant += 1
            continue
        unit = channel.units.get(label, "")
        told.append(f"{label}: {values.min():.6g} to {values.max():.6g}{' ' + unit if unit else ''}")
    if len(told) > _MOST_COLUMNS:
        told = [*told[:_MOST_COLUMNS], f"{len(told) - _MOST_COLUMNS} more"]
    return (*told, *([f"{constant} constant"] if constant else []))


def proposed_toml(sources: Sequence[SourceFile], config: ImportConfig) -> str:
    """A file that imports these recordings: what is settled is stated, what is not is left as comments to choose from."""
    lines = [f'name = "{_name(config, sources)}"']
    try:
        owners = Owners(config, sources)
    except LogError as error:
        head = [*lines, f"# {error}", "# [[vehicles]]", '# name = "…"']
        return "\n".join([*head, *_unknown(sources, set())]) + "\n"
    lines += _origin(config, owners)
    claimed: set[str] = set()
    for vehicle in owners.vehicles:
        lines += ["", "[[vehicles]]", f'name = "{vehicle.name}"']
        if any(c.kind == "table" for c in _channels(owners, vehicle)):
            sourced = next(c for c in _channels(owners, vehicle) if c.kind == "table")
            lines.append(f'source = "{sourced.source}"')
        found = {role: _candidates(owners, vehicle, role) for role in ROLES}
        for role, candidates in found.items():
            claimed |= {c.name for c, _ in candidates}
            if candidates:
                lines += _sensor(vehicle, role, candidates, stands_back(role, found))
    lines += _ranges(owners, claimed)
    lines += _unknown(sources, claimed)
    return "\n".join(lines) + "\n"


def _name(config: ImportConfig, sources: Sequence[SourceFile]) -> str:
    from uwcoop.importers.mapping.ownership import stem_of

    return config.name or stem_of(sources[0].name)


def _channels(owners: Owners, vehicle: VehicleConfig) -> list[Channel]:
    return [c for c in owners.channels if owners.rows(vehicle, c) is not None]


def _candidates(owners: Owners, vehicle: VehicleConfig, role: str) -> list[tuple[Channel, Meaning]]:
    return [(c, m) for c in _channels(owners, vehicle) for m in channel_meanings(c) if m.role == role]


def _origin(config: ImportConfig, owners: Owners) -> list[str]:
    meanings = [(c, m) for c in owners.channels for m in channel_meanings(c)]
    metric = [c.name for c, m in meanings if "east" in m.columns]
    degrees = [(c, m) for c, m in meanings if "latitude" in m.columns]
    if config.origin_deg is not None:
        return [f"origin_deg = [{config.origin_deg[0]}, {config.origin_deg[1]}]"]
    if not metric or not degrees:
        return []
    channel, meaning = degrees[0]
    at = [channel.numbers(meaning.columns[q]) for q in ("latitude", "longitude")]
    first = [float(v[np.isfinite(v)][0]) for v in at if np.isfinite(v).any()]
    near = f" (first fix: {', '.join(f'{v:.5f}' for v in first)})" if len(first) == 2 else ""
    return [f"# origin_deg = [latitude, longitude]   # where the metres of {metric[0]} count from{near}"]


def _sensor(
    vehicle: VehicleConfig, role: str, candidates: list[tuple[Channel, Meaning]], beside: str
) -> list[str]:
    best = [c for c in candidates if "mag_x" not in c[1].columns] or candidates
    if beside:
        return ["", f"# {role}: {', '.join(c.name for c, _ in best)}, not used beside {beside}"]
    mark = "# " if len(best) > 1 else ""
    lines = ["", f"{mark}[vehicles.{role}]" + (f"   # {len(best)} can be it: choose one" if mark else "")]
    for channel, meaning in best:
        if channel.kind == "table":
            pairs = ", ".join(f'{q} = "{label}"' for q, label in meaning.columns.items())
            lines.append(f"{mark}columns = {{ {pairs} }}")
            continue
        lines.append(f'{mark}topic = "{channel.name}"   # {channel.kind}, {channel.count:,} rows')
        if role in _FRAMES and len(best) == 1 and "heading" not in meaning.columns:
            own = meaning.frame if meaning.frame in _FRAMES[role] else _FRAMES[role][0]
            other = next(f for f in _FRAMES[role] if f != own)
            lines.append(f'frame = "{own}"   # or "{other}"')
    return lines


def _ranges(owners: Owners, claimed: set[str]) -> list[str]:
    lines: list[str] = []
    names = [v.name for v in owners.vehicles]
    for channel in owners.channels:
        if is_range_table(channel):
            claimed.add(channel.name)
            told = ", ".join(f"{q} {label!r}" for q, label in range_columns(channel).items())
            lines += ["", f"# {channel.name}: acoustic ranges by its columns {told}"]
        elif is_acoustic_range(channel):
            claimed.add(channel.name)
            own = owners.namesake(channel.name)
            others = [n for n in names if n != own]
            lines += ["", "[[ranges]]", f'topic = "{channel.name}"']
            lines.append(f'from = "{own}"' if own else f'# from = "…"   # one of {", ".join(names)}')
            lines.append(
                f'to = "{others[0]}"' if len(others) == 1 else f'# to = "…"   # one of {", ".join(others)}'
            )
            lines.append('kind = "two-way"   # or "one-way"')
    return lines


def _unknown(sources: Sequence[SourceFile], claimed: set[str]) -> list[str]:
    """Channels that no type explains: a line would say what they are."""
    lines: list[str] = []
    for source in sources:
        for channel in source.channels:
            if channel.name in claimed:
                continue
            numbers = [n for n in channel.columns if "stamp" not in n and not channel.is_text(n)]
            if numbers:
                shown = ", ".join(numbers[:8]) + (" …" if len(numbers) > 8 else "")
                lines.append(f"# not used: {channel.name} ({channel.kind}): {shown}")
    return ["", *lines] if lines else []
