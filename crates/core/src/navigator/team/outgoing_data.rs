//! Own data collected for the next broadcast: displacement, soundings, ranges, fixes. No estimate is among it.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

use super::super::trajectory::Trajectory;
use crate::event::{VehicleId, seconds};
use crate::packet::{
    FixContent, KNOTS_MAX, ReportedFix, ReportedRange, ReportedSounding, SPACINGS_S, TeamLayout, TeamReport,
};

/// Longest window of a packet, s: what its field holds, and what the trajectory keeps.
const WINDOW_MAX_S: f64 = 120.0;
/// Soundings kept until they are sent.
const SOUNDINGS_KEPT: usize = 256;
/// The oldest that the newest sounding of a packet may be, s.
const NEWEST_AGE_S: f64 = 7.75;
/// How far a sounding may lie from the packet's grid of times, s.
const OFF_GRID_S: f64 = 0.3;
/// Packets with the start: the first few, for everybody, and every so many, for who joins later.
const STARTS_AT_FIRST: u64 = 3;
const STARTS_EVERY: u64 = 8;

/// A range that this vehicle measured and has not broadcast yet.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct Measured {
    sequence: u8,
    range_m: f64,
}

/// Fixes since the last broadcast, as their mean disagreement with dead reckoning.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
struct Fixes {
    information: f64,
    residual_m: [f64; 2],
    time_s: f64,
}

/// Own data, kept until it is sent.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct OutgoingData {
    start: Option<Start>,
    track: Option<Trajectory>,
    soundings: VecDeque<(i64, f64)>,
    ranges: Vec<Option<Measured>>,
    fixes: Fixes,
    sent: u64,
    last_tol_ns: Option<i64>,
}

/// Where dead reckoning began.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct Start {
    t_ns: i64,
    position_m: [f64; 2],
    sigma_m: f64,
    /// Of the track at that time, m.
    displacement_m: [f64; 2],
}

impl OutgoingData {
    /// Empty, for a vehicle in a team of `vehicles`.
    #[must_use]
    pub fn new(vehicles: usize) -> Self {
        Self {
            start: None,
            track: None,
            soundings: VecDeque::with_capacity(SOUNDINGS_KEPT),
            ranges: vec![None; vehicles],
            fixes: Fixes::default(),
            sent: 0,
            last_tol_ns: None,
        }
    }

    /// Whether there was a fix that dead reckoning begins at.
    #[must_use]
    pub fn started(&self) -> bool {
        self.start.is_some()
    }

    /// Time passes with a commanded velocity.
    pub fn advance(&mut self, t_ns: i64, velocity_mps: [f64; 2]) {
        let Some(track) = &mut self.track else {
            self.track = Some(Trajectory::new(t_ns));
            return;
        };
        let dt_s = seconds(t_ns.saturating_sub(track.now_ns()));
        if dt_s > 0.0 {
            track.advance(t_ns, [velocity_mps[0] * dt_s, velocity_mps[1] * dt_s]);
        }
    }

    /// Odometry corrects where the vehicle has come to.
    pub fn shift(&mut self, by_m: [f64; 2]) {
        if let Some(track) = &mut self.track {
            track.shift(by_m);
        }
    }

    /// A sounding.
    pub fn sounding(&mut self, t_ns: i64, water_depth_m: f64) {
        if self.soundings.len() == SOUNDINGS_KEPT {
            self.soundings.pop_front();
        }
        self.soundings.push_back((t_ns, water_depth_m));
    }

    /// A range that was used.
    pub fn range(&mut self, vehicle: VehicleId, sequence: u8, range_m: f64) {
        if let Some(slot) = self.ranges.get_mut(usize::from(vehicle)) {
            *slot = Some(Measured { sequence: sequence & 3, range_m });
        }
    }

    /// A fix that was not gated.
    pub fn fix(&mut self, t_ns: i64, position_m: [f64; 2], [ee, en, nn]: [f64; 3]) {
        let Some(track) = &self.track else { return };
        let at = track.displacement_m();
        // The larger axis of the ellipse stands for both.
        let half = 0.5 * (ee - nn);
        let variance = (0.5 * (ee + nn) + half.hypot(en)).max(0.01);
        let Some(start) = &self.start else {
            self.start = Some(Start { t_ns, position_m, sigma_m: variance.sqrt(), displacement_m: at });
            return;
        };
        let fixes = &mut self.fixes;
        let weight = 1.0 / variance;
        let before = fixes.information;
        fixes.information += weight;
        let share = weight / (before + weight);
        for axis in 0..2 {
            let reckoned = start.position_m[axis] + at[axis] - start.displacement_m[axis];
            let residual = position_m[axis] - reckoned;
            fixes.residual_m[axis] += share * (residual - fixes.residual_m[axis]);
        }
        fixes.time_s += share * (seconds(t_ns.saturating_sub(start.t_ns)) - fixes.time_s);
    }

    /// Fills `report` for a launch at `tol_ns` with `velocity_mps` in force; false before the start.
    pub fn report(
        &self,
        tol_ns: i64,
        velocity_mps: [f64; 2],
        spacing_m: f64,
        layout: &TeamLayout,
        report: &mut TeamReport,
    ) -> bool {
        let (Some(start), Some(track)) = (&self.start, &self.track) else { return false };
        report.clear();
        let ahead_s = seconds(tol_ns.saturating_sub(track.now_ns())).max(0.0);
        let ahead = velocity_mps.map(|v| v * ahead_s);
        let began_ns = self.last_tol_ns.unwrap_or(start.t_ns);
        let window_s = seconds(tol_ns.saturating_sub(began_ns)).clamp(1.0, WINDOW_MAX_S).ceil();
        report.window_s = window_s;
        // From an instant to the launch.
        let since = |age_s: f64| -> [f64; 2] {
            let t_ns = tol_ns.saturating_sub((age_s * 1e9).round() as i64);
            let before_now = track.since(t_ns.min(track.now_ns())).unwrap_or(track.displacement_m());
            let later_s = seconds(t_ns.saturating_sub(track.now_ns())).max(0.0);
            [0, 1].map(|a| before_now[a] + ahead[a] - velocity_mps[a] * later_s)
        };
        let pieces = layout.pieces().min(KNOTS_MAX);
        let mut newer = [0.0; 2];
        for j in 1..=pieces {
            let older = since(window_s * j as f64 / pieces as f64);
            report.pieces_m.push([older[0] - newer[0], older[1] - newer[1]]);
            newer = older;
        }
        let gone = track.displacement_m();
        for axis in 0..2 {
            report.position_m[axis] =
                start.position_m[axis] + gone[axis] - start.displacement_m[axis] + ahead[axis];
        }
        self.report_fix(start, tol_ns, report);
        let speed = newer[0].hypot(newer[1]) / window_s;
        let room = if report.fix.is_some() { layout.soundings_beside_fix() } else { layout.soundings() };
        self.report_soundings(tol_ns, window_s, room, spacing_m / speed.max(0.1), report);
        for (vehicle, measured) in self.ranges.iter().enumerate() {
            if let Some(Measured { sequence, range_m }) = *measured {
                report.ranges.push(ReportedRange { vehicle: vehicle as u16, sequence, range_m });
            }
        }
        true
    }

    fn report_fix(&self, start: &Start, tol_ns: i64, report: &mut TeamReport) {
        let age = |time_s: f64| (seconds(tol_ns.saturating_sub(start.t_ns)) - time_s).max(0.0);
        let residual = self.fixes.residual_m;
        let tells = residual.iter().all(|r| r.abs() < 255.0);
        if self.fixes.information > 0.0 && tells && self.sent >= STARTS_AT_FIRST {
            let sigma_m = self.fixes.information.recip().sqrt();
            let content = FixContent::Residual(residual);
            report.fix = Some(ReportedFix { age_s: age(self.fixes.time_s), content, sigma_m });
        } else if self.sent < STARTS_AT_FIRST || self.sent.is_multiple_of(STARTS_EVERY) {
            let since = [0, 1].map(|a| report.position_m[a] - start.position_m[a]);
            if since.iter().all(|x| x.abs() < 8000.0) {
                let content = FixContent::Start(since);
                report.fix = Some(ReportedFix { age_s: age(0.0), content, sigma_m: start.sigma_m });
            }
        }
    }

    /// Soundings of the window, newest first, at the closest spacing that fits.
    fn report_soundings(
        &self,
        tol_ns: i64,
        window_s: f64,
        room: usize,
        least_s: f64,
        report: &mut TeamReport,
    ) {
        let after_ns = self.last_tol_ns.unwrap_or(i64::MIN);
        let fresh = |t_ns: i64| {
            let age_s = seconds(tol_ns.saturating_sub(t_ns));
            t_ns > after_ns && age_s >= 0.0 && age_s < window_s + 0.5
        };
        let Some(&(newest_ns, _)) = self.soundings.iter().rev().find(|s| fresh(s.0)) else { return };
        let newest_s = seconds(tol_ns.saturating_sub(newest_ns));
        if room == 0 || newest_s > NEWEST_AGE_S {
            return;
        }
        let wanted_s = least_s.max((window_s - newest_s) / room as f64);
        let spacing_s = SPACINGS_S
            .into_iter()
            .find(|s| *s >= wanted_s - 1e-9)
            .unwrap_or(SPACINGS_S[SPACINGS_S.len() - 1]);
        for (t_ns, water_depth_m) in self.soundings.iter().rev().filter(|s| fresh(s.0)) {
            let age_s = seconds(tol_ns.saturating_sub(*t_ns));
            let place = ((age_s - newest_s) / spacing_s).round();
            let off_s = (age_s - newest_s - place * spacing_s).abs();
            let taken = report
                .soundings
                .last()
                .is_some_and(|s: &ReportedSounding| ((s.age_s - newest_s) / spacing_s).round() >= place);
            if off_s <= OFF_GRID_S && !taken && place < room as f64 {
                report.soundings.push(ReportedSounding { age_s, water_depth_m: *water_depth_m });
            }
        }
    }

    /// The report was broadcast: its data is not sent again.
    pub fn sent(&mut self, tol_ns: i64) {
        self.sent += 1;
        self.last_tol_ns = Some(tol_ns);
        self.soundings.clear();
        self.ranges.fill(None);
        self.fixes = Fixes::default();
    }
}
