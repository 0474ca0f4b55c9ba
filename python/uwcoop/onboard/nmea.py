"""Sensors that speak NMEA 0183 or PD6, as a driver of a node: sentences in, sensor events out, by a mapping.

Converted to the conventions inside: headings from magnetic to true north by the declination and from true north to the
frame's north by the convergence, degrees clockwise from north to `yaw_rad`, positions to the local frame, knots, feet and
mm/s to m/s and m. An event is stamped on arrival, less the sensor's latency, or by the sentence's own time.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from uwcoop import _native
from uwcoop.errors import ScenarioError
from uwcoop.frames import LocalFrame, wrap_angle, yaw_from_heading
from uwcoop.onboard.nmea_map import (
    BODY,
    DepthMap,
    FixMap,
    HeadingMap,
    Mapped,
    NmeaMap,
    VelocityMap,
    WaterDepthMap,
)
from uwcoop.onboard.nmea_sentences import Reading, SentenceError, parse, require_parser
from uwcoop.onboard.times_of_day import mission_ns_of_day

if TYPE_CHECKING:
    from uwcoop._native import Event
    from uwcoop.frames import Origin
    from uwcoop.onboard.lines import Line

__all__ = ["NmeaDriver"]

_SECOND_NS = 1_000_000_000
_MOST_REASONS = 60
"""A line that is noise has a new reason each time: further ones are counted together."""
_LAST_NS = 2 * _SECOND_NS
"""Heading and depth that others are derived from are not older."""


class NmeaDriver:
    """The sensors of one vehicle on one line."""

    def __init__(
        self,
        line: Line,
        mapping: NmeaMap,
        vehicle: int,
        origin: Origin,
        now_ns: Callable[[], int],
        epoch_ns: int,
    ) -> None:
        """Take the sensors on a line.

        Args:
            line: where their sentences come in.
            mapping: which become which events.
            vehicle: index of the vehicle.
            origin: of the local frame.
            now_ns: mission time.
            epoch_ns: UNIX time of mission time 0.

        Raises:
            ScenarioError: positions, and a local frame that is nowhere on Earth.
            MissingDependencyError: pynmeagps, or pyproj for positions and grid north.
        """
        require_parser()
        self.counts: Counter[str] = Counter()
        """Sentences: `used`, `other` (of kinds that the mapping does not name), `refused: …` by reason."""
        self._line, self._mapping, self._vehicle = line, mapping, vehicle
        self._now_ns, self._epoch_ns = now_ns, epoch_ns
        self._frame = None if origin.latitude_deg is None else LocalFrame(origin)
        if mapping.fix is not None and self._frame is None:
            raise ScenarioError(
                "fix: the scenario's local frame has no latitude and longitude: give it a table [origin]"
            )
        self._convergence_deg = 0.0 if self._frame is None else self._frame.convergence_deg
        self._last: dict[str, tuple[int, float]] = {}

    def __call__(self) -> list[Event]:
        """The events of the sentences that have come since the last call; does not wait."""
        found: list[Event] = []
        for line in self._line.read():
            found += self.events(line)
        return found

    def events(self, line: str) -> list[Event]:
        """The events of one sentence, which has arrived now; what is refused is counted."""
        try:
            reading = parse(line)
        except SentenceError as error:
            self._refused(str(error))
            return []
        found: list[Event] = []
        refused = False
        for kind, table in self._mapping.kinds().items():
            if reading is None or getattr(table, "sentence", None) != reading.sentence:
                continue
            try:
                found.append(self._event(kind, table, reading))
            except ValueError as error:
                refused = True
                self._refused(f"{kind}: {error}")
        if found or not refused:
            self.counts["used" if found else "other"] += 1
        return found

    def _refused(self, reason: str) -> None:
        name = f"refused: {reason}"[:80]
        known = name in self.counts or len(self.counts) < _MOST_REASONS
        self.counts[name if known else "refused: for other reasons"] += 1

    def said(self) -> list[str]:
        """What is assumed and converted, one line each, for whoever starts the node."""
        lines = []
        for kind, table in self._mapping.kinds().items():
            stamped = "by its own time" if getattr(table, "stamp", "") == "utc" else "on arrival"
            text = f"nmea: {kind} from {getattr(table, 'sentence', '')}, stamped {stamped}"
            if table.latency_s:
                text += f" less {table.latency_s:g} s"
            declination = getattr(table, "declination_deg", None)
            if declination is not None:
                stated = "as the sentence states it" if declination == "sentence" else f"{declination:+g} deg"
                text += f", declination {stated}"
            lines.append(text)
        if self._convergence_deg:
            lines.append(f"nmea: the frame's north is {self._convergence_deg:+.3f} deg from true north")
        elif self._frame is None:
            lines.append("nmea: the local frame is nowhere on Earth: its north is taken for true north")
        return lines

    def _event(self, kind: str, table: Mapped, reading: Reading) -> Event:
        t_ns = self._now_ns() - round(table.latency_s * _SECOND_NS)
        if isinstance(table, FixMap) and table.stamp == "utc":
            t_ns = mission_ns_of_day(reading.utc, self._now_ns(), self._epoch_ns)
        fields: dict[str, Any]
        if isinstance(table, FixMap):
            fields = self._fix(table, reading)
        elif isinstance(table, HeadingMap):
            fields = self._heading(table, reading)
            self._last["heading"] = t_ns, fields["yaw_rad"]
        elif isinstance(table, DepthMap):
            fields = {"depth_m": reading.depth_m, "sigma_m": table.sigma_m}
            self._last["depth"] = t_ns, reading.depth_m
        elif isinstance(table, WaterDepthMap):
            below_m = _there(reading.below_m, "distance to the seabed")
            fields = {
                "water_depth_m": below_m + self._transducer_m(table, reading, t_ns),
                "sigma_m": table.sigma_m,
            }
        else:
            assert isinstance(table, VelocityMap)
            fields = self._velocity(kind, table, reading, t_ns)
        return _native.Event(t_ns, self._vehicle, kind, **fields)

    def _fix(self, table: FixMap, reading: Reading) -> dict[str, float]:
        assert self._frame is not None
        ((east_m, north_m),) = self._frame.to_local([reading.latitude_deg], [reading.longitude_deg]).tolist()
        dilution = 1.0 if math.isnan(reading.hdop) else max(reading.hdop, 1.0)
        variance_m2 = (table.sigma_m * dilution) ** 2
        return {
            "e_m": east_m, "n_m": north_m, "cov_ee_m2": variance_m2, "cov_en_m2": 0.0, "cov_nn_m2": variance_m2,
        }  # fmt: skip

    def _heading(self, table: HeadingMap, reading: Reading) -> dict[str, float]:
        declination_deg = 0.0
        if table.declination_deg == "sentence":
            declination_deg = _there(reading.variation_deg, "variation")
        elif table.declination_deg is not None:
            declination_deg = table.declination_deg
        heading_deg = reading.heading_deg + declination_deg + table.mounting_deg - self._convergence_deg
        return {"yaw_rad": float(yaw_from_heading(heading_deg)), "sigma_rad": math.radians(table.sigma_deg)}

    def _velocity(self, kind: str, table: VelocityMap, reading: Reading, t_ns: int) -> dict[str, float]:
        if table.sentence in BODY:
            turn = -math.radians(table.mounting_deg)
            forward = reading.forward_mps * math.cos(turn) - reading.left_mps * math.sin(turn)
            left = reading.forward_mps * math.sin(turn) + reading.left_mps * math.cos(turn)
            if kind == "ground_velocity":
                assert table.sigma_mps is not None
                return {"forward_mps": forward, "left_mps": left, "sigma_mps": table.sigma_mps}
            yaw = self._recent("heading", t_ns)
            return _turned(forward, left, yaw)
        if table.sentence == ":BE":
            assert table.declination_deg is not None
            return _turned(
                reading.east_mps,
                reading.north_mps,
                math.radians(self._convergence_deg - table.declination_deg),
            )
        course_deg = _there(reading.course_deg, "course") - self._convergence_deg
        yaw = float(wrap_angle(math.pi / 2 - math.radians(course_deg)))
        return _turned(_there(reading.speed_mps, "speed"), 0.0, yaw)

    def _transducer_m(self, table: WaterDepthMap, reading: Reading, t_ns: int) -> float:
        if table.transducer == "depth":
            return self._recent("depth", t_ns)
        if table.transducer == "sentence":
            if not reading.offset_m >= 0:
                raise ValueError(f"the transducer's offset is {reading.offset_m}: not from the surface")
            return reading.offset_m
        return table.transducer

    def _recent(self, kind: str, t_ns: int) -> float:
        known_ns, value = self._last.get(kind, (t_ns - _LAST_NS - 1, math.nan))
        if t_ns - known_ns > _LAST_NS:
            raise ValueError(f"no {kind} within {_LAST_NS / _SECOND_NS:g} s before")
        return value


def _turned(x: float, y: float, angle_rad: float) -> dict[str, float]:
    cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
    return {"velocity_e_mps": cosine * x - sine * y, "velocity_n_mps": sine * x + cosine * y}


def _there(value: float, what: str) -> float:
    if math.isnan(value):
        raise ValueError(f"{what} is missing")
    return value
