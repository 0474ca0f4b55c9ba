//! A packet of a teammate: read, put in the order of time, run over every particle's Gaussian, weighed.

use super::group::{Group, MemberPrior};
use super::packet_updates::ReportModel;
use super::ranges::find_usable;
use super::{Team, Teammate};
use crate::chart::{Chart, SigmaMap};
use crate::event::{VehicleId, seconds};
use crate::kernels::lookup::{Grid, Paired, bilinear};
use crate::kernels::team::{BLOCK, BlockUpdates, Joints, MapSigma, Op, Own, Terrain, run};
use crate::kernels::weights::{weighted_covariance, weighted_mean};
use crate::measurement::range::CloudInnovation;
use crate::measurement::sounding::neutral_log_likelihood;
use crate::navigator::Outcome;
use crate::packet::FixContent;

/// A packet that would leave too few particles has its weights quartered at most so many times.
const SOFTENINGS: usize = 6;

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
        if self.read(sender, tol_ns, toa_ns, bytes).is_none() {
            self.terrain.state.core.rejected += 1;
            return Outcome::Rejected;
        }
        let mate = match self.known_or_joined(sender, toa_ns, tol_ns) {
            Ok(mate) => mate,
            Err(outcome) => return outcome,
        };
        self.fuse(sender, tol_ns, toa_ns, mate);
        Outcome::Fused
    }

    /// Decodes and admits a packet. `None`, and nothing has changed, for one that is refused.
    fn read(&mut self, sender: VehicleId, tol_ns: i64, toa_ns: i64, bytes: &[u8]) -> Option<()> {
        let report = &mut self.scratch.report;
        report.decode(bytes, &self.layout, sender, tol_ns).ok()?;
        let core = &self.terrain.state.core;
        core.displacement_since(toa_ns).filter(|_| core.started())?;
        // Local data in the past of what is known cannot be taken up any more.
        if self.state.mates.get(usize::from(sender))?.is_some_and(|m| tol_ns <= m.tol_ns) {
            return None;
        }
        let radio = &mut self.radio;
        radio.windows.get_mut(usize::from(sender))?.accept(report.sequence, tol_ns).ok().map(|_| ())
    }

    /// The teammate as of its last packet, its dead reckoning unwrapped; one that is heard for the first time is taken in
    /// where its fix was. Noted while its packets do not say where it started, gated where it cannot have.
    fn known_or_joined(&mut self, sender: VehicleId, toa_ns: i64, tol_ns: i64) -> Result<Teammate, Outcome> {
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
            return Ok(mate);
        }
        let fix = report.fix.ok_or(Outcome::Noted)?;
        let prior = self.options.clock.prior(self.radio.sound_speed_mps, seconds(tol_ns));
        // Without a range nothing says whether it can have started there.
        let (_, range_m) = self.horizontal(tol_ns, toa_ns, 0.0, prior.difference_m2).ok_or(Outcome::Noted)?;
        if self.start_contradicts(sender, toa_ns, range_m, &fix) {
            self.terrain.state.core.rejected += 1;
            return Err(Outcome::Gated);
        }
        let report = &mut self.scratch.report;
        let mut mate = Teammate {
            tol_ns: tol_ns.saturating_sub((fix.age_s * 1e9).round() as i64),
            position_m: report.position_m,
            sequence: report.sequence,
            since_sounding_m: None,
            contradicting_fixes: 0,
        };
        let residual_m = match fix.content {
            FixContent::Start(since_m) => {
                mate.position_m = [0, 1].map(|a| report.position_m[a] - since_m[a]);
                [0.0; 2]
            }
            FixContent::Residual(residual_m) => {
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
        let sound_speed_mps = self.radio.sound_speed_mps;
        let sigmas: [f64; BLOCK] = [
            fix.sigma_m,
            fix.sigma_m,
            shared_m.min(prior_m),
            drift.sigma_current0_mps * self.current_difference(),
            drift.sigma_current0_mps * self.current_difference(),
            drift.sigma_heading_bias0_rad,
            drift.sigma_thrust_bias0_mps,
        ];
        let at = [0, 1].map(|a| mate.position_m[a] + residual_m[a]);
        let clock = &self.options.clock;
        let prior = MemberPrior {
            sigmas,
            clock: clock.prior(sound_speed_mps, seconds(mate.tol_ns)),
            scale_sigma: clock.scale_sigma(sound_speed_mps),
        };
        let group = self.group_of(sender);
        self.state.groups[group].join(sender, at, offset, &prior);
        Ok(mate)
    }

    fn fuse(&mut self, sender: VehicleId, tol_ns: i64, toa_ns: i64, mate: Teammate) {
        let index = self.group_of(sender);
        let Some(base) = self.state.groups[index].base_of(sender) else { return };
        self.scratch.updates.trace(&self.scratch.report, tol_ns, &mate);
        let contradicting_fixes = self.weigh_up_fix(index, base, sender, tol_ns, &mate);
        let shift_m = self.depth_shift(index, base, tol_ns, &mate);
        let mut drift = self.options.drifts[usize::from(sender)];
        let share = self.current_difference();
        drift.sigma_current_mps_per_sqrt_s *= share;
        if let (Some(current), Some(now_ns)) = (&mut self.state.current, self.terrain.state.core.now_ns()) {
            let linear = &self.terrain.state.core.cloud.linear;
            let ago_s = seconds(now_ns.saturating_sub(tol_ns));
            let hidden = current.since(sender, linear, ago_s, &mut self.scratch.current);
            drift.sigma_position_m_per_sqrt_s = drift.sigma_position_m_per_sqrt_s.hypot(hidden.sqrt());
        }
        let correlation = self.terrain.chart.as_ref().map_or(0.0, |c| c.correlation_length_m());
        // Teammates are taken to carry a sounder like the own one.
        let sigma_sounding_m = self.options.terrain.sigma_depth_m.or(self.state.sigma_sounding_m);
        let model = ReportModel {
            report: &self.scratch.report,
            tol_ns,
            drift: &drift,
            offset_walk_m2: self.options.terrain.sigma_offset_m_per_sounding.powi(2),
            sounding_m2: sigma_sounding_m.map(|s| (s * self.terrain.noise_factor()).powi(2)),
            correlation_m: self.options.terrain.correlation_length_m.unwrap_or(correlation),
            range_m2: self.range_m2(),
            clock_m2_per_s: self.options.clock.walk_m2_per_s(),
        };
        let members = (&self.state.groups[index], self.own);
        let usable = &mut self.scratch.usable;
        self.state.ranges.reported_stale +=
            find_usable(&self.scratch.report, tol_ns, &self.state, members, usable);
        let speed = self.radio.sound_speed_mps;
        let ranges = usable.iter().map(|&(launch_ns, range_m, target)| {
            (launch_ns.saturating_add((range_m / speed * 1e9) as i64), range_m, target)
        });
        let since_sounding_m = self.scratch.updates.build(&model, &mate, shift_m, ranges);
        let sequence = self.scratch.report.sequence;
        let position_m = self.scratch.report.position_m;

        self.own_positions(toa_ns);
        let own = self.own_range(index, base, tol_ns, toa_ns);
        self.scratch.updates.ops.extend(own.map(|own| own.op()));
        let mut column = self.terrain.state.core.cloud.likelihood_column();
        self.run_gated(index, base, &mut column);
        let used = self.scratch.updates.ops.iter().any(|op| matches!(op, Op::RangeToOwn { own: 1, .. }));
        if let Some(own) = own.filter(|own| used && own.worth_telling) {
            self.state.outgoing.range(sender, sequence, own.range.range_m);
        }
        let mate = Teammate { tol_ns, position_m, sequence, since_sounding_m, contradicting_fixes };
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
            let (at, dt_s) = (updates.at(t_ns), seconds(t_ns.saturating_sub(mate.tol_ns)));
            let place = [0, 1].map(|a| state(a) + at[a] - began[a] + state(3 + a) * dt_s);
            let depth = bilinear(&filled_grid(self.filled.as_deref(), chart), place[0], place[1]);
            let whole = unwrap_near(s.water_depth_m, report.depth_modulus_m, depth + state(2));
            depth.is_finite().then_some(whole - s.water_depth_m)
        })
    }

    /// Runs the program in scratch and adds what it says of the particles. A range that they contradict is taken out, and
    /// what is left runs again: what follows it must not have seen it.
    fn run_gated(&mut self, index: usize, base: usize, column: &mut [f64]) {
        let (n, late) = (column.len(), self.options.clock.late());
        let (told_m2, used_m2) = (self.options.sigma_range_m.powi(2), self.range_m2());
        self.scratch.mean.clone_from(&self.state.groups[index].mean);
        loop {
            self.run(index, base, n);
            let ops = self.scratch.updates.ops.iter().enumerate().filter(|(_, op)| op.weighs());
            let mut ranges = ops.enumerate().filter(|(_, (_, op))| op.is_range());
            let weights = self.terrain.state.core.cloud.weights();
            let [nu, s] = &self.scratch.innovation;
            let record = &mut self.state.ranges;
            let contradicting = ranges.find_map(|(row, (place, op))| {
                let of = |column: &'_ [f64], i: usize| column[row * n + i];
                let particles = weights.iter().enumerate().map(|(i, w)| (*w, of(nu, i), of(s, i)));
                let seen = CloudInnovation::of(particles);
                let own = matches!(op, Op::RangeToOwn { own: 1, .. });
                if own {
                    self.terrain.state.core.innovation.0 = Some(seen.into());
                    record.judged(&seen, late.as_ref(), told_m2, used_m2);
                }
                seen.contradicts(self.options.range_gate_sigmas, late.as_ref()).then_some((place, own))
            });
            let Some((place, own)) = contradicting else { break };
            *(if own { &mut record.gated } else { &mut record.reported_gated }) += 1;
            self.terrain.state.core.rejected += 1;
            self.scratch.updates.ops.remove(place);
            self.state.groups[index].mean.copy_from_slice(&self.scratch.mean);
        }
        self.state.groups[index].written();
        let cloud = &self.terrain.state.core.cloud;
        let weighing = self.scratch.updates.ops.iter().filter(|op| op.weighs()).count();
        for row in self.scratch.rows.chunks(n).take(weighing) {
            add_row(row, cloud.weights(), column);
        }
    }

    /// Runs the program in scratch on the means, and on a copy of the covariances.
    fn run(&mut self, index: usize, base: usize, n: usize) {
        let options = &self.options.terrain;
        let weighing = self.scratch.updates.ops.iter().filter(|op| op.weighs()).count();
        // At once for the fullest packet: later ones must not allocate.
        let most = self.layout.soundings() + self.state.mates.len() + 2;
        for column in self.scratch.innovation.iter_mut().chain([&mut self.scratch.rows]) {
            column.reserve((most * n).saturating_sub(column.len()));
            column.resize(weighing * n, 0.0);
        }
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
            layout: self.state.groups[index].layout,
            late: self.options.clock.late(),
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

    /// Weighs the particles by a packet, softened if it would leave too few.
    fn weigh(&mut self, mut column: Vec<f64>) {
        let cloud = &mut self.terrain.state.core.cloud;
        let least = self.options.least_ess_share * cloud.len() as f64;
        let mut softenings = 0..SOFTENINGS;
        while least > 0.0 && cloud.ess_after(&column) < least && softenings.next().is_some() {
            column.iter_mut().for_each(|l| *l *= 0.25);
        }
        cloud.reweight(column);
        self.resample();
    }
}

/// Adds one log-likelihood; particles without a chart take the mean likelihood of those that have one. A sounding that
/// too few can weigh says nothing.
fn add_row(row: &[f64], weights: &[f64], column: &mut [f64]) {
    let Some(neutral) = neutral_log_likelihood(row, weights) else { return };
    column.iter_mut().zip(row).for_each(|(c, l)| *c += if l.is_nan() { neutral } else { *l });
}

/// The chart with its holes filled, where it has any.
fn filled_grid<'a>(filled: Option<&'a [Paired]>, chart: &'a Chart) -> Grid<'a, Paired> {
    let grid = chart.grid();
    filled.map_or(grid, |values| grid.with_values(values))
}
