"""Missions in which two vehicles take turns as the landmark: legs, mutual positioning and exchanges of the role.

The mover lifts off, follows its path, lands, and stays until it has had enough fixes. Then it sends its belief to the
landmark and the subs in slot after slot, until all have it or its tries are used up. When the landmark has it, the
roles change. All of this follows from the scenario and the mission's own draws; no navigator takes part. A navigator's
own packets are lost by the draws that the log holds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from uwcoop import acoustics
from uwcoop.acoustics.losses import Signals, off_bow_rad, survival
from uwcoop.acoustics.sound import sound_speed_between_mps
from uwcoop.missionlog.model import (
    EVENT_COLUMNS,
    OPPORTUNITY_COLUMNS,
    SLOT_COLUMNS,
    Columns,
    columns,
    event_columns,
)
from uwcoop.world.landmark.deployment import priors
from uwcoop.world.landmark.hovering import Course, HoverMotion
from uwcoop.world.landmark.legs import Legs
from uwcoop.world.landmark.mutual_positioning import Luck, acoustic_fixes, delay_s
from uwcoop.world.random_streams import Purpose, stream

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from uwcoop.scenario.models import Scenario

    Seconds = NDArray[np.float64]

LIFT_OFF_S = 1.0
"""From taking the mover's role to lifting off."""
PAUSE_S = 2.0
"""From the last fix to the first slot, at the least."""
QUIET_S = 1.5
"""Before a slot nobody asks for a position any more: the reply would still be on the air."""


@dataclass(frozen=True)
class Alternation:
    """The course of a mission with roles."""

    motion: list[HoverMotion]
    slots: Columns
    opportunities: Columns
    events: dict[str, Columns]
    """Landings, roles, priors and fixes."""


def fly(scenario: Scenario, seed: int) -> Alternation:
    """Settle a mission of hovering vehicles that take turns as the landmark.

    Raises:
        ScheduleError: slots that do not hold the exchange's packet.
    """
    mission = _Mission(scenario, seed)
    mission.run()
    motion = [course.motion(mission.last_step) for course in mission.courses]
    events = mission.events()
    events |= priors(scenario, seed, mission.landmark_since[0][1], motion)
    if fixes := _fixes(mission, motion):
        events["acoustic_fix"] = fixes
    return Alternation(
        motion=motion,
        slots=columns(SLOT_COLUMNS, **_transposed(mission.slots, SLOT_COLUMNS)),
        opportunities=_opportunities(mission),
        events=events,
    )


@dataclass
class _Mission:
    """The mission while it is settled. Times in steps of the world."""

    scenario: Scenario
    seed: int
    courses: list[Course] = field(default_factory=list)
    landmark_since: list[tuple[float, int]] = field(default_factory=list)
    """Second, vehicle."""
    silent: list[tuple[float, float]] = field(default_factory=list)
    """From, to: exchanges are going on, nobody positions. Seconds."""
    happened: list[tuple[str, float, int, bool]] = field(default_factory=list)
    """Kind of event, second, vehicle, landmark."""
    slots: list[tuple[int, int, int]] = field(default_factory=list)
    heard: list[tuple[int, int, int, int, float]] = field(default_factory=list)
    draws: list[Seconds] = field(default_factory=list)

    def __post_init__(self) -> None:
        scenario, team = self.scenario, self.scenario.team
        assert scenario.exchange is not None
        self.exchange, self.hover = scenario.exchange, scenario.hover
        self.last_step = round(scenario.duration_s * self.hover.rate_hz)
        self.capacity = acoustics.slot_capacity_bytes(scenario.acoustics)
        acoustics.check_packet(scenario.acoustics, self.exchange.packet_bytes, "exchange packet")
        self.frames = acoustics.packet_frames(scenario.acoustics, self.exchange.packet_bytes)
        self.link = acoustics.link_of(scenario.acoustics)
        names = [vehicle.name for vehicle in team]
        landmark, mover = (names.index(name) for name in scenario.main)
        self.subs = [v for v in range(len(team)) if v not in (landmark, mover)]
        self.legs = [Legs(vehicle, self.exchange.land) for vehicle in team]
        self.luck = [Luck.drawn(scenario, self.seed, v) for v in range(len(team))]
        self.touch = [stream(self.seed, v, Purpose.LANDING) for v in range(len(team))]
        for v in range(len(team)):
            depth = self.hover.seabed_depth_m - (self.hover.altitude_m if v in self.subs else 0.0)
            yaw = 0.0 if v == landmark else self.legs[v].first_yaw_rad(self.hover.hold_heading_deg)
            self.courses.append(Course(self.hover, self.legs[v].start_m, yaw, depth))
        self.landmark_since.append((0.0, landmark))
        for v in (landmark, mover):
            self._note("landed", 0.0, v)
        for v in range(len(team)):
            self._note("role_taken", 0.0, v, landmark=v == landmark)
        kidnap = scenario.kidnap
        self._kidnap = kidnap
        if kidnap is not None and kidnap.vehicle is not None:
            self.courses[names.index(kidnap.vehicle)].kidnap(kidnap)
            self._kidnap = None

    # ------------------------------------------------------------------------------------------ the course

    def run(self) -> None:
        """Leg after leg until the mission, the paths or the exchanges end."""
        self._subs_go()
        landmark = self.landmark_since[0][1]
        mover = next(v for v in range(len(self.courses)) if v != landmark and v not in self.subs)
        deployment = self.scenario.deployment
        ready_s = self._fixes_after(mover, deployment.search_s, deployment.static_fixes)
        exchanges = 0
        while ready_s is not None:
            self._maybe_kidnapped(mover, self.landmark_since[-1][0])
            landed_s = self._leg(mover, ready_s, first=exchanges == 0)
            if landed_s is None or exchanges == self.exchange.at_most:
                return
            ready_s = self._hand_over(mover, landmark, landed_s)
            if ready_s is None:
                return
            exchanges += 1
            self._surely_kidnapped(mover, ready_s)
            for v, is_landmark in ((mover, True), (landmark, False)):
                self._note("role_taken", ready_s, v, landmark=is_landmark)
            self.landmark_since.append((ready_s, mover))
            mover, landmark = landmark, mover

    def _subs_go(self) -> None:
        start = math.ceil(self.scenario.deployment.search_s * self.hover.rate_hz)
        for v in self.subs:
            self.courses[v].rest(start)
            self.courses[v].follow(self.legs[v].all_points(), self.scenario.team[v].speed_mps, self.last_step)

    def _leg(self, mover: int, ready_s: float, *, first: bool) -> float | None:
        """The next leg of the mover. When it has landed, seconds; None: not within the mission, or no path is left."""
        course, legs, rate = self.courses[mover], self.legs[mover], self.hover.rate_hz
        start = math.ceil((ready_s + LIFT_OFF_S) * rate - 1e-9)
        if legs.ended or start >= self.last_step:
            return None
        course.rest(start)
        self._note("lifted_off", start / rate, mover)
        course.lift_off()
        points, until_s = legs.next_leg(course.steps / rate, first=first)
        until = self.last_step if until_s is None else math.floor(until_s * rate)
        legs.covered(course.follow(points, self.scenario.team[mover].speed_mps, max(until, course.steps)))
        if course.steps >= self.last_step:
            return None
        course.land(self.touch[mover])
        if course.steps > self.last_step:
            return None
        landed_s = course.steps / rate
        self._note("landed", landed_s, mover)
        return landed_s

    def _hand_over(self, mover: int, landmark: int, landed_s: float) -> float | None:
        """Series of tries until the landmark has the packet. When roles change, seconds; None: the mission ends."""
        after_s = landed_s
        while True:
            fixed_s = self._fixes_after(mover, after_s, self.exchange.static_fixes)
            if fixed_s is None:
                return None
            first_s = math.ceil(fixed_s) + PAUSE_S
            if first_s + self.scenario.acoustics.slot_s > self.scenario.duration_s:
                return None
            end_s, got_it = self._series(mover, landmark, first_s)
            self.silent.append((first_s, end_s))
            if got_it:
                return end_s
            after_s = end_s

    def _series(self, mover: int, landmark: int, first_s: float) -> tuple[float, bool]:
        """Slots in a row until everyone has the packet: end of the last, and whether the landmark has it."""
        slot_s = self.scenario.acoustics.slot_s
        missing, tries = {landmark, *self.subs}, 0
        while missing and tries < self.exchange.tries:
            tol_s = first_s + tries * slot_s
            if tol_s + slot_s > self.scenario.duration_s:
                break
            missing -= self._try(mover, landmark, tol_s)
            tries += 1
        return first_s + tries * slot_s, landmark not in missing

    def _try(self, sender: int, landmark: int, tol_s: float) -> set[int]:
        """One slot of the sender: what everyone can hear of it. Who gets the exchange's packet."""
        plan, tol_ns = self.scenario.acoustics, round(tol_s * 1e9)
        self.slots.append((tol_ns, sender, self.capacity))
        got = set()
        steps = math.ceil((tol_s + plan.slot_s) * self.hover.rate_hz)
        here = self.courses[sender].motion(steps)
        at = np.array([tol_s])
        for receiver in sorted([landmark, *self.subs]):
            there = self.courses[receiver].motion(steps)
            speed = sound_speed_between_mps(plan, self.seed, here.depth_at(at), there.depth_at(at))
            travel_s = acoustics.travel_time_s(here, there, at, speed)
            p, q = here.position_at(at), there.position_at(at + travel_s)
            signals = Signals(
                sender=sender, receiver=receiver, scheduled_s=at, launch_s=at, range_m=travel_s * speed,
                off_bow_sender_rad=off_bow_rad(here.yaw_at(at), p, q),
                off_bow_receiver_rad=off_bow_rad(there.yaw_at(at + travel_s), q, p),
            )  # fmt: skip
            names = tuple(vehicle.name for vehicle in self.scenario.team)
            chance = float(survival(plan, signals, names, self.seed)[0])
            attempt = len(self.slots)
            draws = stream(self.seed, sender, Purpose.EXCHANGE, receiver, attempt).random(
                self.link.max_frames
            )
            noise = float(
                stream(self.seed, sender, Purpose.EXCHANGE_TIME, receiver, attempt).standard_normal()
            )
            error_s = noise * plan.range_sigma_m / float(speed[0])
            toa_ns = max(tol_ns, tol_ns + round((float(travel_s[0]) + error_s) * 1e9))
            self.heard.append((tol_ns, sender, receiver, toa_ns, chance))
            self.draws.append(draws)
            if (draws[: self.frames] < chance).all():
                got.add(receiver)
        return got

    # ------------------------------------------------------------------------------------------ positioning

    def asking_s(self, vehicle: int) -> Seconds:
        """A vehicle's instants of positioning, (K,), whether or not it asks then."""
        interval = self.scenario.mutual.interval_s
        turn = self.subs.index(vehicle) + 1 if vehicle in self.subs else 0
        offset = interval * turn / (len(self.subs) + 1)
        return np.asarray(offset + interval * np.arange(len(self.luck[vehicle].replied)), dtype=np.float64)

    def _fixes_after(self, vehicle: int, after_s: float, count: int) -> float | None:
        """When the vehicle has had so many fixes with a range, seconds; None: not within the mission."""
        luck = self.luck[vehicle]
        asked_s = self.asking_s(vehicle)
        replies_s = asked_s + delay_s(self.scenario) + 2 * self._reach_s(vehicle)
        # The landed vehicle and the landmark do not move: all of these are of one distance.
        good = luck.replied & luck.measured[:, 0] & (asked_s >= after_s)
        good &= replies_s <= self.scenario.duration_s
        at = np.flatnonzero(good)
        if count == 0:
            return after_s
        if at.size < count or self._reach_s(vehicle) * self._speed > self.scenario.mutual.max_range_m:
            return None
        return float(replies_s[at[count - 1]])

    @property
    def _speed(self) -> float:
        return self.scenario.acoustics.sound_speed_mps

    def _reach_s(self, vehicle: int) -> float:
        """Travel time between a vehicle and the landmark where they stand now, seconds."""
        ends = [self.courses[v].pose() for v in (vehicle, self.landmark_since[-1][1])]
        return math.hypot(*(ends[0][0] - ends[1][0])) / self._speed

    # ------------------------------------------------------------------------------------------ small things

    def _maybe_kidnapped(self, mover: int, taken_s: float) -> None:
        """What nobody is named for happens to the mover; until when it is the mover shows later."""
        if self._kidnap is not None and self._kidnap.time_s >= taken_s:
            self.courses[mover].kidnap(self._kidnap)

    def _surely_kidnapped(self, mover: int, role_s: float) -> None:
        """The mover is one no longer: it has been kidnapped by now, or it will not be."""
        if self._kidnap is None:
            return
        if self._kidnap.time_s < role_s:
            self._kidnap = None
        else:
            self.courses[mover].spare()

    def _note(self, kind: str, second: float, vehicle: int, *, landmark: bool = False) -> None:
        self.happened.append((kind, second, vehicle, landmark))

    def events(self) -> dict[str, Columns]:
        """Landings and roles as tables of events."""
        tables = {}
        for kind in ("landed", "lifted_off", "role_taken"):
            rows = [row for row in self.happened if row[0] == kind]
            own = {"landmark": [row[3] for row in rows]} if "landmark" in EVENT_COLUMNS[kind] else {}
            t_ns = [round(row[1] * 1e9) for row in rows]
            tables[kind] = event_columns(kind, t_ns, [row[2] for row in rows], **own)
        return {kind: table for kind, table in tables.items() if table["t_ns"].size}

    def landmark_at(self, t_s: Seconds) -> NDArray[np.int64]:
        """Who is the landmark at times (K,)."""
        since = np.array([second for second, _ in self.landmark_since])
        return np.array([v for _, v in self.landmark_since])[np.searchsorted(since, t_s, side="right") - 1]


def _fixes(mission: _Mission, motion: list[HoverMotion]) -> Columns:
    """Mutual positioning of everyone who is not the landmark, outside of exchanges."""
    scenario = mission.scenario
    tables = []
    for vehicle, moved in enumerate(motion):
        at_s = mission.asking_s(vehicle)
        asks = (at_s >= scenario.deployment.search_s) & (at_s < scenario.duration_s)
        for first_s, end_s in mission.silent:
            asks &= (at_s < first_s - QUIET_S) | (at_s >= end_s)
        landmark = mission.landmark_at(at_s)
        for peer in np.unique(landmark[asks]):
            if peer == vehicle:
                continue
            index = np.flatnonzero(asks & (landmark == peer))
            pair, moving = (vehicle, int(peer)), (moved, motion[peer])
            tables.append(
                acoustic_fixes(
                    scenario, mission.seed, pair, moving, (index, at_s[index]), mission.luck[vehicle]
                )
            )
    whole = {name: np.concatenate([table[name] for table in tables]) for name in tables[0]} if tables else {}
    return event_columns("acoustic_fix", **whole) if whole and whole["t_ns"].size else {}


def _opportunities(mission: _Mission) -> Columns:
    table = columns(OPPORTUNITY_COLUMNS, **_transposed(mission.heard, OPPORTUNITY_COLUMNS))
    table["draws"] = np.array(mission.draws).reshape(len(mission.heard), mission.link.max_frames)
    return table


def _transposed(rows: list[Any], spec: dict[str, str]) -> dict[str, list[Any]]:
    return {name: [row[k] for row in rows] for k, name in enumerate(spec)}
