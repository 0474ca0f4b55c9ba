//! The method's equations as pure functions (Matsuda, Maki, Sato & Sakamaki 2017, section II).
//!
//! A pose is [x, y, yaw], yaw counter-clockwise from +x (east). M is the mover, L the landmark, D the delay from the
//! transmission of a positioning signal to the reception of its reply. Likelihoods are kept as logarithms: with three
//! channels at k = 3, L_max is e^13.5.

use std::f64::consts::{PI, TAU};

use serde::{Deserialize, Serialize};

use crate::error::Error;
use crate::kernels::landmark::systematic_resample;
use crate::measurement::angle::wrap;
use crate::navigator::settings::{LandmarkPaperSettings, Settings, check_all};

/// [x, y, yaw], m and rad.
pub type Pose = [f64; 3];

/// One mutual positioning; what was not measured is `None`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Measurement {
    /// r̂: mean of the ranges at transmission and at reception, m.
    pub range_m: Option<f64>,
    /// θ̂_ML: direction to the landmark in the mover's body frame at reception, rad.
    pub own_rad: Option<f64>,
    /// θ̂_LM: direction to the mover in the landmark's body frame at transmission, rad.
    pub peer_rad: Option<f64>,
}

impl Measurement {
    /// Channels that were measured, in the order range, θ_ML, θ_LM.
    #[must_use]
    pub fn present(&self) -> [bool; 3] {
        [self.range_m.is_some(), self.own_rad.is_some(), self.peer_rad.is_some()]
    }
}

/// Standard deviations of the three channels (Table 4) and the outlier thresholds k.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Acoustics {
    /// [σ_r in m, σ_θ of the mover in rad, σ_θ of the landmark in rad].
    pub sigma: [f64; 3],
    /// [k_r, k_θ^M, k_θ^L].
    pub threshold: [f64; 3],
}

impl Acoustics {
    /// Refuses what is outside the bounds of the settings.
    ///
    /// # Errors
    /// [`Error::NotFinite`], [`Error::OutOfBound`].
    pub fn validate(&self) -> Result<(), Error> {
        let [range_m, own_rad, peer_rad] = self.sigma;
        let [range, own, peer] = self.threshold;
        check_all(
            &LandmarkPaperSettings::bounds(),
            &[
                ("sigma_range_m", range_m),
                ("sigma_own_bearing_deg", own_rad.to_degrees()),
                ("sigma_peer_bearing_deg", peer_rad.to_degrees()),
                ("k_range", range),
                ("k_own_bearing", own),
                ("k_peer_bearing", peer),
            ],
        )
    }
}

/// What keeps an outlier from deciding.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Gate {
    /// (12) as printed: range and own direction count only if both are inside their thresholds; (14) alone.
    Joint,
    /// Each channel inside its own threshold.
    Separate,
    /// No gate.
    None,
    /// Per channel (1 − ε) N + ε/W, scaled to a peak of one.
    Mixture {
        /// ε.
        share: f64,
        /// W of the range, m, and of the two directions, rad.
        widths: [f64; 3],
    },
}

/// Offsets (10), (11), (13) of one particle: range, θ_ML, θ_LM; NaN where not measured.
#[must_use]
pub fn offsets(mover: Pose, at_transmit: Pose, landmark: Pose, measured: &Measurement) -> [f64; 3] {
    let (dx, dy) = (landmark[0] - mover[0], landmark[1] - mover[1]);
    let (tx, ty) = (at_transmit[0] - landmark[0], at_transmit[1] - landmark[1]);
    [
        measured.range_m.map_or(f64::NAN, |r| ((dx.hypot(dy) + tx.hypot(ty)) / 2.0 - r).abs()),
        measured.own_rad.map_or(f64::NAN, |a| wrap(dy.atan2(dx) - (mover[2] + a)).abs()),
        measured.peer_rad.map_or(f64::NAN, |a| wrap(ty.atan2(tx) - (landmark[2] + a)).abs()),
    ]
}

/// Log-likelihoods [ln L_ML (12), ln L_LM (14)] from offsets; a channel that is missing adds nothing.
#[must_use]
pub fn log_likelihoods(offsets: [f64; 3], acoustics: &Acoustics, gate: &Gate) -> [f64; 2] {
    let term = |c: usize| -> f64 {
        let (d, s, k) = (offsets[c], acoustics.sigma[c], acoustics.threshold[c]);
        if d.is_nan() { 0.0 } else { 0.5 * k * k - 0.5 * (d / s) * (d / s) }
    };
    // A missing channel does not close the gate of the other.
    let inside = |c: usize| offsets[c].is_nan() || offsets[c] < acoustics.threshold[c] * acoustics.sigma[c];
    let gated = |c: usize| if inside(c) { term(c) } else { 0.0 };
    match gate {
        Gate::Joint => [if inside(0) && inside(1) { term(0) + term(1) } else { 0.0 }, gated(2)],
        Gate::Separate => [gated(0) + gated(1), gated(2)],
        Gate::None => [term(0) + term(1), term(2)],
        Gate::Mixture { share, widths } => {
            let mixed = |c: usize| -> f64 {
                if offsets[c].is_nan() {
                    return 0.0;
                }
                let peak = (1.0 - share) / (acoustics.sigma[c] * TAU.sqrt());
                let floor = share / widths[c];
                let z = offsets[c] / acoustics.sigma[c];
                ((peak * (-0.5 * z * z).exp() + floor) / (peak + floor)).ln()
            };
            [mixed(0) + mixed(1), mixed(2)]
        }
    }
}

/// How far the peak of a mixture lies above an outlier, ln, over the channels that were measured; 0 for other gates.
///
/// The paper's likelihood is 1 for an outlier and e^(k²/2) at its peak; that of a mixture is 1 at its peak
/// ([`log_likelihoods`]). With this added, and as ln L_max, the monitor (15)–(18) and (19) read it on the paper's scale.
#[must_use]
pub fn mixture_scale(measured: &Measurement, acoustics: &Acoustics, gate: &Gate) -> f64 {
    let Gate::Mixture { share, widths } = gate else { return 0.0 };
    let above = |c: usize| {
        let peak = (1.0 - share) / (acoustics.sigma[c] * TAU.sqrt());
        // Without outliers nothing bounds the likelihood from below.
        (peak * widths[c] / share.max(f64::MIN_POSITIVE)).ln_1p()
    };
    (0..3).filter(|c| measured.present()[*c]).map(above).sum()
}

/// ln L_max (16)–(18): only the channels that were measured count.
#[must_use]
pub fn log_likelihood_max(measured: &Measurement, acoustics: &Acoustics, gate: &Gate) -> f64 {
    if matches!(gate, Gate::Mixture { .. }) {
        return 0.0;
    }
    let thresholds = acoustics.threshold.iter().zip(measured.present());
    thresholds.map(|(k, present)| if present { 0.5 * k * k } else { 0.0 }).sum()
}

/// The two readings of "the average likelihood drops below k L_max".
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum RatioReading {
    /// L̄ < k L_max, as printed.
    Linear,
    /// ln L̄ < k ln L_max.
    Log,
}

/// The monitor of section II.C.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MonitorRule {
    /// k: 0.85³ ≈ 0.6 in the paper.
    pub ratio: f64,
    /// a: lows before this one that it takes, and least positionings between reconstructions.
    pub trials: u32,
    /// How k is read.
    pub reading: RatioReading,
}

/// Where the monitor stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Monitor {
    lows: u32,
    since: u32,
}

impl Default for Monitor {
    fn default() -> Self {
        // Nothing was reconstructed yet, so nothing need be waited for.
        Self { lows: 0, since: u32::MAX }
    }
}

impl Monitor {
    /// Whether the average likelihood of one positioning is low, and whether a reconstruction is due.
    ///
    /// A positioning without any channel (ln L_max = 0) is none: it neither ends nor extends a row of lows. Particles can
    /// be drawn from a complete positioning only: what is due at another one stays due for as long as the row of lows lasts.
    pub fn observe(
        &mut self,
        log_mean: f64,
        log_max: f64,
        complete: bool,
        rule: &MonitorRule,
    ) -> (bool, bool) {
        if log_max <= 0.0 {
            return (false, false);
        }
        let low = match rule.reading {
            RatioReading::Linear => log_mean < rule.ratio.ln() + log_max,
            RatioReading::Log => log_mean < rule.ratio * log_max,
        };
        self.since = self.since.saturating_add(1);
        self.lows = if low { self.lows.saturating_add(1) } else { 0 };
        let fire = complete && self.lows > rule.trials && self.since > rule.trials;
        if fire {
            *self = Self { lows: 0, since: 0 };
        }
        (low, fire)
    }
}

/// n_new (19), 0 where nothing was measured; `log_mean` is ln L̄ before resampling.
#[must_use]
pub fn new_particles(count: usize, share: f64, log_mean: f64, log_max: f64) -> usize {
    if log_max <= 0.0 {
        return 0;
    }
    let most = (count as f64 * share).floor();
    let wanted = (count as f64 * share * (1.0 - log_mean / log_max) + 1e-9).floor();
    if wanted.is_nan() { 0 } else { wanted.clamp(0.0, most) as usize }
}

/// A new mover pose from the landmark's and one drawn positioning (20)–(25).
///
/// `normals` are the draws of r, θ_ML, θ_LM. Position (23)–(24) holds at transmission, yaw (25) at reception; the
/// position is carried to the reception by the displacement of the old particle over D.
#[must_use]
pub fn reconstruct(
    landmark: Pose,
    old: Pose,
    old_at_transmit: Pose,
    measured: [f64; 3],
    sigma: [f64; 3],
    normals: [f64; 3],
) -> Pose {
    let [r, own, peer] = std::array::from_fn(|c| measured[c] + sigma[c] * normals[c]);
    let direction = landmark[2] + peer;
    let yaw = wrap(landmark[2] + peer - own - PI);
    let (dx, dy) = (old[0] - old_at_transmit[0], old[1] - old_at_transmit[1]);
    // The displacement was made in the body frame; the new particle has another yaw.
    let (s, c) = (yaw - old[2]).sin_cos();
    [
        landmark[0] + r * direction.cos() + c * dx - s * dy,
        landmark[1] + r * direction.sin() + s * dx + c * dy,
        yaw,
    ]
}

/// ln of the mean of exp(x).
#[must_use]
pub fn log_mean_exp(values: &[f64]) -> f64 {
    let top = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if !top.is_finite() {
        return top;
    }
    let sum: f64 = values.iter().map(|v| (v - top).exp()).sum();
    top + (sum / values.len() as f64).ln()
}

/// The indices of the `count` least likely, ascending; of equals the first ones.
#[must_use]
pub fn least_likely(log_likelihood: &[f64], count: usize) -> Vec<u32> {
    let mut order: Vec<u32> = (0..log_likelihood.len() as u32).collect();
    order.sort_by(|a, b| log_likelihood[*a as usize].total_cmp(&log_likelihood[*b as usize]));
    order.truncate(count);
    order.sort_unstable();
    order
}

/// Polar form u = [x_L, y_L, ψ_L, ρ, β, γ] of a pair of poses: distance, bearing of M and yaw of M as L sees them.
#[must_use]
pub fn to_polar(mover: Pose, landmark: Pose) -> [f64; 6] {
    let (dx, dy) = (mover[0] - landmark[0], mover[1] - landmark[1]);
    let [x, y, yaw] = landmark;
    [x, y, yaw, dx.hypot(dy), wrap(dy.atan2(dx) - yaw), wrap(mover[2] - yaw)]
}

/// Poses (M, L) of a polar form.
#[must_use]
pub fn from_polar(u: [f64; 6]) -> (Pose, Pose) {
    let [x, y, yaw, rho, beta, gamma] = u;
    let (s, c) = (yaw + beta).sin_cos();
    ([x + rho * c, y + rho * s, wrap(yaw + gamma)], [x, y, wrap(yaw)])
}

/// Indices that are not in the ascending list `replaced`.
#[must_use]
pub fn survivors(count: usize, replaced: &[u32]) -> Vec<u32> {
    let mut gone = replaced.iter().peekable();
    (0..count as u32).filter(|i| gone.next_if_eq(&i).is_none()).collect()
}

/// Ancestors of all particles: survivors resampled among themselves into the survivors' places, the others themselves.
#[must_use]
pub fn ancestors_among(survivors: &[u32], logs: &[f64], u0: f64, count: usize) -> Vec<u32> {
    let top = survivors.iter().map(|i| logs[*i as usize]).fold(f64::NEG_INFINITY, f64::max);
    let weights: Vec<f64> = survivors.iter().map(|i| (logs[*i as usize] - top).exp()).collect();
    let mut picked = vec![0u32; survivors.len()];
    systematic_resample(&weights, u0, &mut picked);
    let mut ancestors: Vec<u32> = (0..count as u32).collect();
    for (place, pick) in survivors.iter().zip(picked) {
        ancestors[*place as usize] = survivors[pick as usize];
    }
    ancestors
}
