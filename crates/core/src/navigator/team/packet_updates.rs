//! A received report as a list of Kalman updates of its sender's block, in the order of time.

use super::Teammate;
use crate::event::seconds;
use crate::kernels::team::{Op, Prediction, RangeOp};
use crate::measurement::sounding::sharing_error;
use crate::navigator::drift::Drift;
use crate::packet::{FixContent, TeamReport};

/// A report with the model parameters that its updates need.
pub struct ReportModel<'a> {
    /// The packet.
    pub report: &'a TeamReport,
    /// Its launch.
    pub tol_ns: i64,
    /// Sender's drift.
    pub drift: &'a Drift,
    /// Walk of the datum offset for each sounding, m².
    pub offset_walk_m2: f64,
    /// Variance of a sounding, m²; none: its soundings cannot be weighed.
    pub sounding_m2: Option<f64>,
    /// Distance over which the chart's error stays itself, m.
    pub correlation_m: f64,
    /// Variance of a range, m².
    pub range_m2: f64,
    /// Walk of the clock difference, m²/s.
    pub clock_m2_per_s: f64,
}

/// One instant of a packet.
#[derive(Debug, Clone, Copy)]
enum What {
    Sounding(f64),
    Fix([f64; 2], f64),
    Range(f64, Target),
}

/// The other end of a reported range.
#[derive(Debug, Clone, Copy)]
pub enum Target {
    /// This vehicle at its last launch.
    Own,
    /// A block of the same group.
    Block(usize),
}

/// The updates of one packet; the memory is reused for the next one.
#[derive(Debug, Clone, Default)]
pub struct PacketUpdates {
    /// The updates, in the order of time.
    pub ops: Vec<Op>,
    /// Points of the sender's dead reckoning: time, position relative to the launch.
    track: Vec<(i64, [f64; 2])>,
    instants: Vec<(i64, What)>,
}

impl PacketUpdates {
    /// The sender's dead reckoning from where its block stands to the launch.
    pub fn trace(&mut self, report: &TeamReport, tol_ns: i64, mate: &Teammate) {
        let pieces = report.pieces_m.len().max(1);
        self.track.clear();
        self.track.push((tol_ns, [0.0; 2]));
        let mut at = [0.0; 2];
        for (j, piece) in report.pieces_m.iter().enumerate() {
            let age_s = report.window_s * (j + 1) as f64 / pieces as f64;
            let t_ns = tol_ns.saturating_sub((age_s * 1e9).round() as i64);
            if t_ns <= mate.tol_ns {
                break;
            }
            at = [at[0] - piece[0], at[1] - piece[1]];
            self.track.push((t_ns, at));
        }
        let from = [0, 1].map(|a| mate.position_m[a] - report.position_m[a]);
        self.track.push((mate.tol_ns.min(tol_ns), from));
        self.track.reverse();
    }

    /// Position relative to the launch at `t_ns`.
    #[must_use]
    pub fn at(&self, t_ns: i64) -> [f64; 2] {
        for pair in self.track.windows(2) {
            let ((t0, p0), (t1, p1)) = (pair[0], pair[1]);
            if t_ns <= t1 {
                let share = if t1 > t0 {
                    t_ns.max(t0).saturating_sub(t0) as f64 / t1.saturating_sub(t0) as f64
                } else {
                    1.0
                };
                return [0, 1].map(|a| p0[a] + share * (p1[a] - p0[a]));
            }
        }
        [0.0; 2]
    }

    /// Builds the operations of a packet; `ranges` are the reported ones that can be used, with the time of arrival.
    /// Returns the distance travelled since the last sounding used.
    pub fn build(
        &mut self,
        model: &ReportModel<'_>,
        mate: &Teammate,
        depth_shift_m: Option<f64>,
        ranges: impl Iterator<Item = (i64, f64, Target)>,
    ) -> Option<f64> {
        let ReportModel { report, tol_ns, .. } = *model;
        let ago = |age_s: f64| tol_ns.saturating_sub((age_s * 1e9).round() as i64);
        let mut instants = std::mem::take(&mut self.instants);
        instants.clear();
        if let (Some(shift), Some(_)) = (depth_shift_m, model.sounding_m2) {
            instants.extend(
                report.soundings.iter().map(|s| (ago(s.age_s), What::Sounding(s.water_depth_m + shift))),
            );
        }
        if let Some(fix) = report.fix
            && let FixContent::Residual(residual) = fix.content
        {
            let t_ns = ago(fix.age_s);
            let reckoned = self.at(t_ns);
            let position = [0, 1].map(|a| report.position_m[a] + reckoned[a] + residual[a]);
            instants.push((t_ns, What::Fix(position, fix.sigma_m * fix.sigma_m)));
        }
        instants.extend(ranges.map(|(t_ns, range_m, target)| (t_ns, What::Range(range_m, target))));
        instants.retain(|(t_ns, _)| *t_ns > mate.tol_ns && *t_ns <= tol_ns);
        instants.sort_unstable_by_key(|i| i.0);
        let speed_mps = self.speed(report);
        self.ops.clear();
        let (mut now_ns, mut here) = (mate.tol_ns, self.at(mate.tol_ns));
        let mut since_m = mate.since_sounding_m;
        for (t_ns, what) in instants.iter().copied().chain([(tol_ns, What::Sounding(f64::NAN))]) {
            let there = self.at(t_ns);
            let step = [there[0] - here[0], there[1] - here[1]];
            if t_ns > now_ns {
                self.ops.push(Op::Predict(model.prediction(
                    step,
                    seconds(t_ns.saturating_sub(now_ns)),
                    speed_mps,
                )));
                since_m = since_m.map(|m| m + step[0].hypot(step[1]));
                (now_ns, here) = (t_ns, there);
            }
            match what {
                What::Sounding(depth) if depth.is_nan() => {}
                What::Sounding(water_depth_m) => {
                    let shared = sharing_error(model.correlation_m, since_m);
                    self.ops.push(Op::Sounding {
                        water_depth_m,
                        noise_m2: model.sounding_m2.unwrap_or(1.0) + report.depth_rounding_m2,
                        walk_m2: model.offset_walk_m2,
                        shared,
                    });
                    since_m = Some(0.0);
                }
                What::Fix(position_m, variance_m2) => self.ops.push(Op::Fix { position_m, variance_m2 }),
                What::Range(range_m, target) => {
                    let range = RangeOp { range_m, variance_m2: model.range_m2 + report.range_rounding_m2 };
                    self.ops.push(match target {
                        Target::Own => Op::RangeToOwn { own: 0, clock_sign: -1.0, range },
                        Target::Block(base) => Op::RangeToBlock { base, range },
                    });
                }
            }
        }
        self.instants = instants;
        since_m
    }

    /// The fastest piece is the one without a turn, m/s.
    #[must_use]
    pub fn speed(&self, report: &TeamReport) -> f64 {
        let piece_s = report.window_s / report.pieces_m.len().max(1) as f64;
        report.pieces_m.iter().map(|p| p[0].hypot(p[1]) / piece_s.max(1e-3)).fold(0.0, f64::max)
    }
}

impl ReportModel<'_> {
    fn prediction(&self, displacement_m: [f64; 2], dt_s: f64, speed_mps: f64) -> Prediction {
        let d = self.drift;
        Prediction {
            displacement_m,
            dt_s,
            speed_mps,
            position_m2_per_s: d.sigma_position_m_per_sqrt_s.powi(2),
            walk_per_s: [
                d.sigma_current_mps_per_sqrt_s.powi(2),
                d.sigma_heading_bias_rad_per_sqrt_s.powi(2),
                d.sigma_thrust_bias_mps_per_sqrt_s.powi(2),
            ],
            clock_m2_per_s: self.clock_m2_per_s,
        }
    }
}
