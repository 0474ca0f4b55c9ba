"""A bound channel as a series: quantities in SI units (angles in degrees), in order, of rows that can be used."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop.errors import LogError
from uwcoop.importers.quantities import DIMENSIONS, NEEDS
from uwcoop.importers.units import factor_of, known_unit, unit_of_label

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from uwcoop.importers.channels import Channel
    from uwcoop.importers.mapping.binding import Binding

    Floats = NDArray[np.float64]

__all__ = ["Series", "interpolated", "quantity", "series_of"]

_PLAUSIBLE: dict[str, tuple[float, float]] = {
    "latitude": (-90.0, 90.0), "longitude": (-180.0, 360.0), "heading": (-360.0, 720.0), "yaw": (-720.0, 720.0),
    "forward": (-15.0, 15.0), "left": (-15.0, 15.0), "right": (-15.0, 15.0), "speed": (-15.0, 15.0),
    "depth": (-50.0, 12_000.0), "up": (-12_000.0, 50.0), "altitude": (1e-6, 12_000.0), "water_depth": (1e-6, 12_000.0),
    "pressure": (-2e5, 1.3e8), "turn_rate": (-400.0, 400.0), "range": (1e-6, 100_000.0), "bearing": (-360.0, 720.0),
}  # fmt: skip
"""What no sensor of a vehicle says in earnest: a value that stands for "no reading"."""
_MOST_DROPPED = 0.5
"""More than this share outside the bounds is no noise but another unit or column."""
_CONDITION = re.compile(r"^\s*(.+?)\s*(==|!=|>=|<=|>|<)\s*(-?[\d.eE+-]+)\s*$")
_COMPARE: dict[str, Callable[[Any, Any], Any]] = {
    "==": operator.eq, "!=": operator.ne, ">=": operator.ge, "<=": operator.le, ">": operator.gt, "<": operator.lt,
}  # fmt: skip
_DEFAULT_RATE_HZ = {"water_depth": 1.0, "altimeter": 1.0, "fix": 1.0, "usbl": 1.0, "truth": 10.0}
_RATE_HZ = 5.0
_FIRST_NS, _LAST_NS = 315_532_800 * 10**9, 4_102_444_800 * 10**9


@dataclass(frozen=True)
class Series:
    """What a sensor said."""

    t_ns: NDArray[np.int64]
    """(N,) strictly ascending, nanoseconds since 1970 or the recording's own zero; time offset applied."""
    values: Mapping[str, Floats]
    """(N,) each by quantity; also what is stated of its errors: `variance`, `cov_ee`, … as the file has them."""
    total: int
    """Rows of the channel that are the vehicle's."""
    said: tuple[str, ...] = ()
    """What was dropped, converted or assumed, one phrase each."""

    def chosen(self, kept: NDArray[np.bool_], phrase: str = "") -> Series:
        """Of these rows; with the phrase, in which {} stands for the number of the others, if there are some."""
        left = int((~kept).sum())
        said = (*self.said, phrase.format(f"{left:,}")) if left and phrase else self.said
        return replace(
            self, t_ns=self.t_ns[kept], values={q: v[kept] for q, v in self.values.items()}, said=said
        )

    def thinned(self, role: str, rate_hz: float | None) -> Series:
        """At most so many rows a second: the first of each interval."""
        most = rate_hz or _DEFAULT_RATE_HZ.get(role, _RATE_HZ)
        if len(self.t_ns) < 2 or 1e9 / max(float(np.median(np.diff(self.t_ns))), 1.0) < 1.5 * most:
            return self
        bins = self.t_ns // round(1e9 / most)
        kept = np.concatenate([[True], np.diff(bins) > 0])
        return replace(self.chosen(kept), said=(*self.said, f"thinned to {most:g} Hz"))


def quantity(binding: Binding, name: str, label: str) -> Floats:
    """A column in SI units, angles in degrees."""
    channel = binding.channel
    values = channel.numbers(label)
    if name == "sigma":
        return values * _sigma_factor(binding, label)
    dimension = DIMENSIONS.get(name)
    if dimension is None or dimension == "number":
        return values
    return values * factor_of(_unit(binding, name, label, dimension), dimension, binding.where)


def _unit(binding: Binding, name: str, label: str, dimension: str) -> str:
    wanted = binding.settings.unit
    if wanted is not None and (known_unit(wanted, dimension) or name == _main_quantity(binding)):
        return wanted
    if name in binding.units:
        return binding.units[name]
    stated = binding.channel.units.get(label, "")
    if stated and known_unit(stated, dimension):
        return stated
    return unit_of_label(label, dimension) or _BASE[dimension]


def _sigma_factor(binding: Binding, label: str) -> float:
    """A standard deviation is in the unit that its column states, else in that of what it belongs to."""
    main = _main_quantity(binding)
    dimension = _SIGMA_OF.get(binding.role, DIMENSIONS.get(main, "length"))
    stated = binding.channel.units.get(label, "")
    unit = stated if stated and known_unit(stated, dimension) else unit_of_label(label, dimension)
    if not unit and main and DIMENSIONS[main] == dimension:
        unit = _unit(binding, main, binding.columns[main], dimension)
    return factor_of(unit or _BASE[dimension], dimension, binding.where)


_SIGMA_OF = {"fix": "length", "usbl": "length", "truth": "length", "range": "length", "heading": "angle"}
"""Dimension of a standard deviation by role, where it is not that of the quantity."""
_BASE = {
    "angle": "deg", "length": "m", "speed": "m/s", "rate": "rad/s", "pressure": "pa", "field": "t", "time": "s",
}  # fmt: skip


def _main_quantity(binding: Binding) -> str:
    return next(
        (need[0] for need in NEEDS[binding.role] if need[0] in binding.columns and need[0] in DIMENSIONS), ""
    )


def series_of(binding: Binding, offset_ns: int = 0) -> Series:
    """Read a bound channel.

    Args:
        binding: which columns of which channel.
        offset_ns: puts its stamps on the mission's clock, before the sensor's own offset.

    Raises:
        LogError: no row is left, a condition that cannot be read, or values of another unit or column.
    """
    channel, settings = binding.channel, binding.settings
    stamps = channel.t_ns
    if settings.clock == "received":
        if channel.received_ns is None:
            raise LogError(
                f'{binding.where}: clock = "received": {channel.source} holds no recorder\'s times'
            )
        stamps = channel.received_ns
    else:
        stamps = stamps + offset_ns
    rows = np.ones(channel.count, bool) if binding.rows is None else binding.rows
    values = {name: quantity(binding, name, label)[rows] for name, label in binding.columns.items()}
    found = Series(stamps[rows] + round(settings.offset_s * 1e9), values, int(rows.sum()))
    found = _valid(found, binding, rows)
    found = found.chosen(_dated(found.t_ns), "{} with a stamp of no mission")
    found = _known(found, binding)
    found = _plausible(found, binding)
    if settings.within is not None:
        name = _main_quantity(binding)
        low, high = settings.within
        if name in found.values:
            inside = (found.values[name] >= low) & (found.values[name] <= high)
            found = found.chosen(inside, f"{{}} with {name} outside {low:g} to {high:g}")
    if not len(found.t_ns):
        raise LogError(
            f"{binding.where}: none of its {found.total:,} rows can be used: {'; '.join(found.said) or 'empty'}"
        )
    return _in_order(found)


def _dated(t_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Stamps within 1980 to 2100, or within thirty years of a zero of their own."""
    if not t_ns.size:
        return np.ones(0, dtype=bool)
    return (t_ns > -_FIRST_NS) & (t_ns < _LAST_NS) & ((np.median(t_ns) < _FIRST_NS) | (t_ns >= _FIRST_NS))


def _valid(found: Series, binding: Binding, rows: NDArray[np.bool_]) -> Series:
    if not binding.valid:
        return found
    match = _CONDITION.match(binding.valid)
    if match is None or match.group(1) not in binding.channel.columns:
        raise LogError(
            f"{binding.where}: valid = {binding.valid!r} must be a column, one of == != >= <= > < and a number; "
            f"columns are {', '.join(binding.channel.columns)}"
        )
    column, sign, number = match.groups()
    kept = _COMPARE[sign](binding.channel.numbers(column)[rows], float(number))
    return found.chosen(np.asarray(kept, bool), f"{{}} without {binding.valid}")


def _known(found: Series, binding: Binding) -> Series:
    """Rows in which every quantity that the role needs is a number."""
    need = next(n for n in NEEDS[binding.role] if set(n) <= found.values.keys())
    finite = np.ones(len(found.t_ns), dtype=bool)
    for name in need:
        finite &= np.isfinite(found.values[name])
    return found.chosen(finite, "{} without a value")


def _plausible(found: Series, binding: Binding) -> Series:
    for name in tuple(found.values):
        values = found.values[name]
        if name not in _PLAUSIBLE or not len(values):
            continue
        low, high = _PLAUSIBLE[name]
        inside = (values >= low) & (values <= high) | ~np.isfinite(values)
        if name in ("altitude", "water_depth", "range"):
            inside &= ~(values <= 0)
        if (~inside).mean() > _MOST_DROPPED and not _no_reading(values[~inside]):
            wrong = values[~inside]
            raise LogError(
                f"{binding.where}: {name} is {wrong.min():.6g} to {wrong.max():.6g} {_said_unit(name)} in "
                f"{wrong.size:,} of {len(values):,} rows, must be {low:g} to {high:g}: another unit (unit = …) or "
                "another column?"
            )
        found = found.chosen(
            inside, f"{{}} with {name} outside {low:g} to {high:g} {_said_unit(name)} (no reading)"
        )
    if {"latitude", "longitude"} <= found.values.keys():
        zero = (np.abs(found.values["latitude"]) < 1e-7) & (np.abs(found.values["longitude"]) < 1e-7)
        found = found.chosen(~zero, "{} at latitude and longitude 0 (no fix yet)")
    if {"least", "most", "altitude"} <= found.values.keys():
        least, most = found.values["least"], found.values["most"]
        inside = (found.values["altitude"] >= least) & (found.values["altitude"] <= most)
        found = found.chosen(inside | ~(most > least), "{} outside the instrument's own range")
    return found


def _no_reading(values: Floats) -> bool:
    """The one value, or infinities, by which an instrument says that it has none."""
    return len(np.unique(np.round(values, 3))) == 1


def _said_unit(name: str) -> str:
    return {"angle": "deg", "length": "m", "speed": "m/s", "rate": "deg/s", "pressure": "Pa"}.get(
        DIMENSIONS[name], ""
    )


def _in_order(found: Series) -> Series:
    """Sorted by time; of rows with one stamp the first."""
    back = int((np.diff(found.t_ns) < 0).sum())
    if back:
        order = np.argsort(found.t_ns, kind="stable")
        found = replace(
            found, t_ns=found.t_ns[order], values={q: v[order] for q, v in found.values.items()},
            said=(*found.said, f"{back:,} stamps before the one before them: sorted"),
        )  # fmt: skip
    fresh = np.concatenate([[True], np.diff(found.t_ns) > 0])
    return found.chosen(fresh, "{} with a stamp that is there already")


def interpolated(t_ns: NDArray[np.int64], known_ns: NDArray[np.int64], values: Floats) -> Floats:
    """Linear in between, the nearest outside; differences of times keep their nanoseconds."""
    base = known_ns[0]
    found: Floats = np.interp((t_ns - base).astype(np.float64), (known_ns - base).astype(np.float64), values)
    return found


def recorded_rate_hz(channel: Channel) -> float:
    """Median rate of a channel's rows, 1/s; 0 for a single one."""
    steps: Floats = np.diff(np.sort(channel.t_ns)).astype(np.float64)
    steps = steps[steps > 0]
    return 1e9 / float(np.median(steps)) if steps.size else 0.0
