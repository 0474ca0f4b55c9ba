//! A packet of a teammate: read, put in the order of time, run over every particle's Gaussian, weighed.

use super::group::Group;
use super::packet_updates::{ReportModel, Target};
use super::{Team, Teammate};
use crate::chart::{Chart, SigmaMap};
use crate::event::VehicleId;
use crate::kernels::lookup::{Grid, Paired, bilinear};
use crate::kernels::team::{BLOCK, BlockUpdates, Joints, MapSigma, Op, Own, Terrain, run};
use crate::kernels::weights::{known_share, weighted_covariance, weighted_mean};
use crate::link::{range_m, slant_to_horizontal};
use crate::navigator::Outcome;
use crate::navigator::radio::SLANT_GATES;
use crate::packet::{FixSays, TeamReport};

/// A packet that would leave too few particles has its weights quartered at most so many times.
const SOFTENINGS: usize = 6;
/// Share of the weight that must have a chart for a sounding to be weighed.
const CHART_SHARE: f64 = 0.2;

/// Mean and covariance [ee, en, nn] of a block's position over all particles.
pub fn position_moments(group: &Group, base: usize, weights: &[f64]) -> ([f64; 2], [f64; 3]) {
    let (east, north) = (group.mean_of(base), group.mean_of(base + 1));
    let mean = [weighted_mean(weights, east), weighted_mean(weights, north)];
    // Covariances may stand in another order than weights: their mean over particles is taken through it.
    let inner = |r: usize, c: usize| -> f64 {
        let column = group.covariance_of(r, c);
        weights.iter().zip(&group.order).map(|(w, o)| w * column[*o as usize]).sum()
    };
    let outer = [
        weighted_covariance(weights, east, mean[0], east, mean[0]),
        weighted_covariance(weights, east, mean[0], north, mean[1]),
        weighted_covariance(weights, north, mean[1], north, mean[1]),
    ];
    let (e, n) = (base, base + 1);
    (mean, [outer[0] + inner(e, e), outer[1] + inner(n, e), outer[2] + inner(n, n)])
}

/// The representative of `value` modulo `modulus` that is nearest to `reference`.
fn unwrap_near(value: f64, modulus: f64, reference: f64) -> f64 {
    if modulus.is_finite() { value + modulus * ((reference - value) / modulus).round() } else { value }
}

impl<const K: usize> Team<K> {
    pub(super) fn reception(&mut self, sender: VehicleId, tol_ns: i64, toa_ns: i64, bytes: &[u8]) -> Outcome {
        // While the own position is searched for, no particle lasts that could carry a teammate.
        if !self.options.use_ranges || self.terrain.acquiring() {
            return Outcome::Noted;
        }
        let Some(range_m) = self.read(sender, tol_ns, toa_ns, bytes) else {
            self.terrain.state.core.rejected += 1;
            return Outcome::Rejected;
        };
        let Some(mate) = self.known_or_joined(sender, tol_ns) else { return Outcome::Noted };
        self.fuse(sender, tol_ns, toa_ns, range_m, mate);
        Outcome::Fused
    }

    /// Decodes and admits a packet; its horizontal range. `None`, and nothing has changed, for one that is refused.
    fn read(&mut self, sender: VehicleId, tol_ns: i64, toa_ns: i64, bytes: &[u8]) -> Option<f64> {
        let report = &mut self.scratch.report;
        report.decode(bytes, &self.layout, sender, tol_ns).ok()?;
        let core = &self.terrain.state.core;
        core.displacement_since(toa_ns).filter(|_| core.started())?;
        // Local data in the past of what is known cannot be taken up any more.
        if self.state.mates.get(usize::from(sender))?.is_some_and(|m| tol_ns <= m.tol_ns) {
            return None;
        }
        let radio = &mut self.radio;
        let slant_m = range_m(tol_ns, toa_ns, radio.sound_speed_mps).ok()?;
        let sigma_m = self.options.sigma_range_m;
        let horizontal =
            slant_to_horizontal(slant_m, radio.depth_m, report.depth_m, sigma_m, SLANT_GATES).ok()?;
        radio.windows.get_mut(usize::from(sender))?.accept(report.sequence, tol_ns).ok()?;
        Some(horizontal.range_m)
    }

    /// The teammate as of its last packet, its dead reckoning unwrapped; one that is heard for the first time is taken in
    /// where its fix was. `None` while its packets do not say where it started.
    fn known_or_joined(&mut self, sender: VehicleId, tol_ns: i64) -> Option<Teammate> {
        let report = &mut self.scratch.report;
        let modulus = report.position_modulus_m;
        let reference = match &self.state.mates[usize::from(sender)] {
            Some(mate) => mate.position_m,
            None => self.terrain.state.core.cloud.position_moments().0,
        };
        for (position, reference) in report.position_m.iter_mut().zip(reference) {
            *position = unwrap_near(*position, modulus, reference);
        }
        if let Some(mate) = self.state.mates[usize::from(sender)] {
            return Some(mate);
        }
        let fix = report.fix?;
        let mut mate = Teammate {
            tol_ns: tol_ns.saturating_sub((fix.age_s * 1e9).round() as i64),
            position_m: report.position_m,
            sequence: report.sequence,
            since_sounding_m: None,
        };
        let residual_m = match fix.said {
            FixSays::Start(since_m) => {
                mate.position_m = [0, 1].map(|a| report.position_m[a] - since_m[a]);
                [0.0; 2]
            }
            FixSays::Residual(residual_m) => {
                let mut before = mate;
                before.tol_ns = i64::MIN;
                self.scratch.updates.trace(report, tol_ns, &before);
                let reckoned = self.scratch.updates.at(mate.tol_ns);
                mate.position_m = [0, 1].map(|a| report.position_m[a] + reckoned[a]);
                residual_m
            }
        };
        // What it said of itself before it was taken in is used up by that.
        self.scratch.report.fix = None;
        let drift = &self.options.drifts[usize::from(sender)];
        // One sea, one tide: each particle's own offset, with what it does not know of it.
        let cloud = &self.terrain.state.core.cloud;
        let doubt = weighted_mean(cloud.weights(), &cloud.offset_variance);
        let shared_m = (doubt + self.options.offset_difference_m.powi(2)).sqrt();
        let prior_m = self.options.terrain.sigma_offset0_m;
        let offset = (shared_m < prior_m).then_some(cloud.offset.as_slice());
        let sigmas: [f64; BLOCK] = [
            fix.sigma_m,
            fix.sigma_m,
            shared_m.min(prior_m),
            drift.sigma_current0_mps * self.options.current_difference,
            drift.sigma_current0_mps * self.options.current_difference,
            drift.sigma_heading_bias0_rad,
            drift.sigma_thrust_bias0_mps,
        ];
        let at = [0, 1].map(|a| mate.position_m[a] + residual_m[a]);
        let group = self.group_of(sender);
        self.state.groups[group].join(sender, at, offset, sigmas);
        Some(mate)
    }

    fn fuse(&mut self, sender: VehicleId, tol_ns: i64, toa_ns: i64, range_m: f64, mate: Teammate) {
        let index = self.group_of(sender);
        let Some(base) = self.state.groups[index].base_of(sender) else { return };
        self.scratch.updates.trace(&self.scratch.report, tol_ns, &mate);
        let shift_m = self.depth_shift(index, base, tol_ns, &mate);
        let mut drift = self.options.drifts[usize::from(sender)];
        let share = self.options.current_difference.min(1.0);
        drift.sigma_current_mps_per_sqrt_s *= share;
        if let (Some(current), Some(now_ns)) = (&mut self.state.current, self.terrain.state.core.now_ns()) {
            let linear = &self.terrain.state.core.cloud.linear;
            let ago_s = (now_ns - tol_ns) as f64 * 1e-9;
            let hidden = current.since(sender, linear, ago_s, &mut self.scratch.current);
            drift.sigma_position_m_per_sqrt_s = drift.sigma_position_m_per_sqrt_s.hypot(hidden.sqrt());
        }
        let correlation = self.terrain.chart.as_ref().map_or(0.0, |c| c.correlation_length_m());
        let model = ReportModel {
            report: &self.scratch.report,
            tol_ns,
            drift: &drift,
            offset_walk_m2: self.options.terrain.sigma_offset_m_per_sounding.powi(2),
            sounding_m2: self.options.terrain.sigma_depth_m.or(self.state.sigma_sounding_m).map(|s| s * s),
            correlation_m: self.options.terrain.correlation_length_m.unwrap_or(correlation),
            range_m2: self.options.sigma_range_m.powi(2),
        };
        let targets = targets(&self.scratch.report, &self.state, index, self.own);
        let speed = self.radio.sound_speed_mps;
        let ranges = targets.map(|(launch_ns, range_m, target)| {
            (launch_ns.saturating_add((range_m / speed * 1e9) as i64), range_m, target)
        });
        let since_sounding_m = self.scratch.updates.build(&model, &mate, shift_m, ranges);
        let sequence = self.scratch.report.sequence;
        let position_m = self.scratch.report.position_m;

        let mut column = self.terrain.state.core.cloud.likelihood_column();
        self.run(index, base, &mut column);
        self.own_positions(toa_ns);
        if self.contradicts(index, base, range_m) {
            self.terrain.state.core.rejected += 1;
        } else {
            let variance_m2 = self.options.sigma_range_m.powi(2);
            self.scratch.updates.ops.clear();
            self.scratch.updates.ops.push(Op::RangeToOwn { own: 1, range_m, variance_m2 });
            self.run(index, base, &mut column);
            self.state.outgoing.range(sender, sequence, range_m);
        }
        let mate = Teammate { tol_ns, position_m, sequence, since_sounding_m };
        self.state.mates[usize::from(sender)] = Some(mate);
        self.weigh(column);
    }

    /// What to add to the packet's depths, which are known modulo something: by the depth expected under the sender.
    /// `None` without a chart there.
    fn depth_shift(&self, index: usize, base: usize, tol_ns: i64, mate: &Teammate) -> Option<f64> {
        let chart = self.terrain.chart.as_ref()?;
        let (report, updates) = (&self.scratch.report, &self.scratch.updates);
        if !report.depth_modulus_m.is_finite() {
            return Some(0.0);
        }
        let (group, weights) = (&self.state.groups[index], self.weights());
        let state = |k: usize| weighted_mean(weights, group.mean_of(base + k));
        let began = updates.at(mate.tol_ns);
        report.soundings.iter().find_map(|s| {
            let t_ns = tol_ns.saturating_sub((s.age_s * 1e9).round() as i64);
            let (at, dt_s) = (updates.at(t_ns), (t_ns - mate.tol_ns) as f64 * 1e-9);
            let place = [0, 1].map(|a| state(a) + at[a] - began[a] + state(3 + a) * dt_s);
            let depth = bilinear(&filled_grid(self.filled.as_deref(), chart), place[0], place[1]);
            let whole = unwrap_near(s.water_depth_m, report.depth_modulus_m, depth + state(2));
            depth.is_finite().then_some(whole - s.water_depth_m)
        })
    }

    /// Runs the program in scratch and adds what it says of the particles.
    fn run(&mut self, index: usize, base: usize, column: &mut [f64]) {
        let n = column.len();
        let options = &self.options.terrain;
        let weighing = self.scratch.updates.ops.iter().filter(|op| op.weighs()).count();
        self.scratch.rows.resize(weighing * n, 0.0);
        self.scratch.innovation.iter_mut().for_each(|c| c.resize(n, 0.0));
        self.scratch.own.iter_mut().for_each(|c| c.resize(n, 0.0));
        let cloud = &self.terrain.state.core.cloud;
        let launch = self.state.history.launch.as_ref();
        let terrain = self.terrain.chart.as_deref().map(|chart| Terrain {
            chart: chart.grid(),
            filled: filled_grid(self.filled.as_deref(), chart),
            sigma: match (options.sigma_map_m, chart.sigma_map()) {
                (Some(sigma), _) | (None, &SigmaMap::Uniform(sigma)) => MapSigma::Uniform(sigma),
                (None, SigmaMap::PerNode { sigma_m, fallback }) => {
                    MapSigma::PerNode { sigma_m, fallback: *fallback }
                }
            },
            dof: options.student_dof,
        });
        let updates = BlockUpdates {
            base,
            ops: &self.scratch.updates.ops,
            terrain,
            own: Own {
                at: [
                    launch.map_or([&cloud.east, &cloud.north], |(_, l)| [&l.east, &l.north]),
                    [&self.scratch.own[0], &self.scratch.own[1]],
                ],
            },
            current: self
                .state
                .current
                .is_some()
                .then(|| [self.scratch.current[0].as_slice(), self.scratch.current[1].as_slice()]),
        };
        let (dim, mean, before, order, after) = self.state.groups[index].columns();
        let mut joints = Joints { dim, mean, before, order, after, scratch: &mut self.scratch.lanes };
        let [nu, s] = &mut self.scratch.innovation;
        run(&updates, &mut joints, &mut self.scratch.rows, &mut [nu, s]);
        self.state.groups[index].written();
        for row in self.scratch.rows.chunks(n).take(weighing) {
            add_row(row, cloud.weights(), column);
        }
    }

    /// Where each particle was when the packet arrived, into scratch. What is older than is kept is reckoned back.
    fn own_positions(&mut self, toa_ns: i64) {
        if self.state.history.at(toa_ns, &mut self.scratch.own) {
            return;
        }
        let core = &self.terrain.state.core;
        let back = core.displacement_since(toa_ns).unwrap_or_default();
        for (axis, now) in [&core.cloud.east, &core.cloud.north].into_iter().enumerate() {
            let at = &mut self.scratch.own[axis];
            at.clear();
            at.extend(now.iter().map(|x| x - back[axis]));
        }
    }

    /// Whether a range is further off than the gate of what cloud, block and sensor allow.
    fn contradicts(&self, index: usize, base: usize, range_m: f64) -> bool {
        let (group, weights) = (&self.state.groups[index], self.weights());
        let [east, north] = &self.scratch.own;
        let (mean, [ee, en, nn]) = position_moments(group, base, weights);
        let own = [weighted_mean(weights, east), weighted_mean(weights, north)];
        let (oe, on) = (
            weighted_covariance(weights, east, own[0], east, own[0]),
            weighted_covariance(weights, north, own[1], north, own[1]),
        );
        let (de, dn) = (mean[0] - own[0], mean[1] - own[1]);
        let d = de.hypot(dn).max(1e-9);
        let (ue, un) = (de / d, dn / d);
        let radial = ue * ue * (ee + oe) + 2.0 * ue * un * en + un * un * (nn + on);
        let across = un * un * (ee + oe) - 2.0 * ue * un * en + ue * ue * (nn + on);
        let curvature = across.max(0.0) / d;
        let off = range_m - d - 0.5 * curvature;
        let variance = self.options.sigma_range_m.powi(2) + radial + 0.5 * curvature * curvature;
        off * off > self.options.range_gate_sigmas.powi(2) * variance
    }

    /// Weighs the particles by a packet, softened if it would leave too few.
    fn weigh(&mut self, mut column: Vec<f64>) {
        let cloud = &mut self.terrain.state.core.cloud;
        let least = self.options.least_ess_share * cloud.len() as f64;
        for _ in 0..SOFTENINGS {
            if least <= 0.0 || cloud.ess_after(&column) >= least {
                break;
            }
            column.iter_mut().for_each(|l| *l *= 0.25);
        }
        cloud.reweight(column);
        self.resample();
    }
}

/// Adds one log-likelihood; particles without a chart take the mean likelihood of those that have one. A sounding that
/// too few can weigh says nothing.
fn add_row(row: &[f64], weights: &[f64], column: &mut [f64]) {
    let (top, share) = known_share(row, weights);
    if share < CHART_SHARE || !top.is_finite() {
        return;
    }
    if row.iter().any(|l| l.is_nan()) {
        let known = row.iter().zip(weights).filter(|(l, _)| !l.is_nan());
        let sum: f64 = known.map(|(l, w)| w * (l - top).exp()).sum();
        let neutral = top + (sum / share).ln();
        column.iter_mut().zip(row).for_each(|(c, l)| *c += if l.is_nan() { neutral } else { *l });
    } else {
        column.iter_mut().zip(row).for_each(|(c, l)| *c += l);
    }
}

/// Reported ranges that can be used: to this vehicle's last launch, or to a block of the same group that stands at the
/// launch which the range was measured to.
fn targets<'a, const K: usize>(
    report: &'a TeamReport,
    state: &'a super::TeamState<K>,
    index: usize,
    own: VehicleId,
) -> impl Iterator<Item = (i64, f64, Target)> + 'a {
    report.ranges.iter().filter_map(move |range| {
        if range.vehicle == own {
            let (_, launch) = state.history.launch.as_ref().filter(|(s, _)| s & 3 == range.sequence)?;
            return Some((launch.t_ns, range.range_m, Target::Own));
        }
        let mate =
            state.mates.get(usize::from(range.vehicle))?.filter(|m| m.sequence & 3 == range.sequence)?;
        let base = state.groups.get(index)?.base_of(range.vehicle)?;
        Some((mate.tol_ns, range.range_m, Target::Block(base)))
    })
}

/// The chart with its holes filled, where it has any.
fn filled_grid<'a>(filled: Option<&'a [Paired]>, chart: &'a Chart) -> Grid<'a, Paired> {
    let grid = chart.grid();
    Grid { values: filled.unwrap_or(grid.values), ..grid }
}
