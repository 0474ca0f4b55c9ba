//! Ranges of a packet: which of the reported ones can be used, and the receiver's own.

use super::group::Group;
use super::packet_updates::Target;
use super::{Team, TeamState};
use crate::event::VehicleId;
use crate::kernels::team::{Op, RangeOp};
use crate::kernels::weights::{weighted_covariance, weighted_mean};
use crate::link::{depth_rounding_m2, range_m, slant_to_horizontal};
use crate::navigator::radio::SLANT_GATES;
use crate::packet::{Header, ReportedRange, TeamReport};

/// A range is told to teammates, who take it with the variance of any range, if the rounding of the sender's depth adds
/// no more than this share of it.
const TOLD_SHARE: f64 = 0.25;

/// The range to the sender of a packet.
#[derive(Debug, Clone, Copy)]
pub(super) struct OwnRange {
    pub range: RangeOp,
    /// Whether teammates may take it for an ordinary one.
    pub worth_telling: bool,
}

impl OwnRange {
    pub fn op(&self) -> Op {
        Op::RangeToOwn { own: 1, clock_sign: 1.0, range: self.range }
    }
}

/// From a launch to the end of its reception at most, ns: a frame of 64 bytes at 80 bit/s and the way.
const RECEPTION_NS: i64 = 8_000_000_000;
/// Launches after which the counter of a reported range, two bits, begins again.
const COUNTER_LAUNCHES: i64 = 4;
/// Where one vehicle is about above the other, a clock difference weighs at most by this factor.
const STEEPEST: f64 = 10.0;

/// Reported ranges that can be used, with the launch that they were measured to: this vehicle's last one, or the one at
/// which a block of the same group stands. Returns how many are not, because their sender told all that it had heard
/// of that launch in its broadcast before: their counter has come round, and they belong to a later launch that this
/// vehicle has not heard.
pub(super) fn find_usable<const K: usize>(
    report: &TeamReport,
    tol_ns: i64,
    state: &TeamState<K>,
    (group, own): (&Group, VehicleId),
    usable: &mut Vec<(i64, f64, Target)>,
) -> u64 {
    let window_ns = (report.window_s * 1e9) as i64 + RECEPTION_NS;
    // A window in which the counter comes round within itself names no launch.
    let ambiguous = state.history.cycle_ns.is_some_and(|cycle| window_ns > COUNTER_LAUNCHES * cycle);
    let oldest_ns = tol_ns.saturating_sub(window_ns);
    let mut stale = 0;
    usable.clear();
    for range in &report.ranges {
        let Some((launch_ns, target)) = launch_of(range, state, group, own) else { continue };
        if ambiguous || launch_ns < oldest_ns {
            stale += 1;
        } else {
            usable.push((launch_ns, range.range_m, target));
        }
    }
    stale
}

/// The launch that a reported range names by its counter, where this vehicle knows it.
fn launch_of<const K: usize>(
    range: &ReportedRange,
    state: &TeamState<K>,
    group: &Group,
    own: VehicleId,
) -> Option<(i64, Target)> {
    if range.vehicle == own {
        let (_, launch) = state.history.launch.as_ref().filter(|(s, _)| s & 3 == range.sequence)?;
        return Some((launch.t_ns, Target::Own));
    }
    let mate = state.mates.get(usize::from(range.vehicle))?.filter(|m| m.sequence & 3 == range.sequence)?;
    Some((mate.tol_ns, Target::Block(group.base_of(range.vehicle)?)))
}

impl<const K: usize> Team<K> {
    /// Variance of a range, m²: what is told, or more where ranges show that they are noisier.
    pub(super) fn range_m2(&self) -> f64 {
        let told_m2 = self.options.sigma_range_m.powi(2);
        told_m2 * self.state.ranges.variance_factor(told_m2)
    }

    /// The range to a packet's sender, reduced to the horizontal; `None`, and counted, for one that is none.
    ///
    /// A slant range is reduced less what the sender's clock is thought to add, which is put back: what a clock difference
    /// adds to a slant range and to a horizontal one differs by the slope alone, and the rest of that is noise.
    pub(super) fn own_range(
        &mut self,
        index: usize,
        base: usize,
        tol_ns: i64,
        toa_ns: i64,
    ) -> Option<OwnRange> {
        let (clock_m, clock_m2) = self.clock_difference(index, base);
        let range_m2 = self.range_m2();
        let Some((slant_m, horizontal_m)) = self.horizontal(tol_ns, toa_ns, clock_m, clock_m2) else {
            self.state.ranges.impossible += 1;
            return None;
        };
        let slope = (slant_m / horizontal_m.max(f64::MIN_POSITIVE) - 1.0).min(STEEPEST);
        let sender_m = self.scratch.report.depth_m;
        let step_m = Header::coarse_depth_step_m(sender_m);
        let rounding_m2 = depth_rounding_m2(horizontal_m, self.radio.depth_m - sender_m, step_m);
        let variance_m2 = range_m2 + slope * slope * clock_m2 + rounding_m2;
        let range = RangeOp { range_m: horizontal_m + clock_m, variance_m2 };
        Some(OwnRange { range, worth_telling: rounding_m2 <= TOLD_SHARE * range_m2 })
    }

    /// Slant and horizontal range to the sender of the packet in scratch, m, less what its clock is thought to add; `None`
    /// for one that is not above zero, or shorter than the difference of the depths by more than its errors.
    pub(super) fn horizontal(
        &self,
        tol_ns: i64,
        toa_ns: i64,
        clock_m: f64,
        clock_m2: f64,
    ) -> Option<(f64, f64)> {
        let (radio, sender_depth_m) = (&self.radio, self.scratch.report.depth_m);
        let slant_m = range_m(tol_ns, toa_ns, radio.sound_speed_mps).ok()? - clock_m;
        let scale_m = self.options.clock.scale_sigma(radio.sound_speed_mps) * slant_m;
        let step_m = Header::coarse_depth_step_m(sender_depth_m);
        let sigma_m =
            (self.options.sigma_range_m.powi(2) + clock_m2 + scale_m * scale_m + step_m * step_m).sqrt();
        let reduced = slant_to_horizontal(slant_m, radio.depth_m, sender_depth_m, sigma_m, SLANT_GATES);
        reduced.ok().map(|horizontal| (slant_m, horizontal.range_m))
    }

    /// Mean, m, and variance, m², of a teammate's clock difference; zero where clocks agree.
    fn clock_difference(&self, index: usize, base: usize) -> (f64, f64) {
        let group = &self.state.groups[index];
        match group.layout.clock_of(base) {
            Some(clock) => state_moments(group, clock, self.weights()),
            None => (0.0, 0.0),
        }
    }

    /// What the clocks and the sound speed are thought to be: the most uncertain clock difference, and the scale error.
    pub(super) fn clock_diagnostics(&self) -> Vec<(&'static str, f64)> {
        let groups = || self.state.groups.iter().enumerate();
        let mut all = Vec::new();
        if self.options.clock.differ() {
            let clocks = groups().flat_map(|(index, group)| {
                let bases = group.members.iter().filter_map(|m| group.base_of(*m));
                bases.map(move |base| self.clock_difference(index, base).1.sqrt())
            });
            all.push(("clock_difference_sigma_m", clocks.fold(f64::NAN, f64::max)));
        }
        if self.options.clock.sound_speed_sigma_mps > 0.0 {
            let heard = groups().find(|(_, group)| group.dim() > 0);
            let (mean, variance) =
                heard.map_or((f64::NAN, f64::NAN), |(_, group)| state_moments(group, 0, self.weights()));
            let sound_speed_mps = self.radio.sound_speed_mps;
            all.push(("sound_speed_error_mps", -mean * sound_speed_mps));
            all.push(("sound_speed_error_sigma_mps", variance.sqrt() * sound_speed_mps));
        }
        all
    }
}

/// Mean and variance of one state over all particles.
fn state_moments(group: &Group, state: usize, weights: &[f64]) -> (f64, f64) {
    let column = group.mean_of(state);
    let mean = weighted_mean(weights, column);
    // Covariances may stand in another order than weights: their mean over particles is taken through it.
    let inner = group.covariance_of(state, state);
    let inner: f64 = weights.iter().zip(&group.order).map(|(w, o)| w * inner[*o as usize]).sum();
    (mean, inner + weighted_covariance(weights, column, mean, column, mean))
}
