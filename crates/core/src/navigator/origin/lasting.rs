//! Errors that last from one range to the next, as states beside the nodes, and noise that fits the day.
//!
//! ```text
//! joint     [ own node | peer's node … | peer's range error [b, d, –, –] … | gyro [ω, –, –, –] ]
//! range     z = |x − x_p| + b_p + d_p + noise       b constant, d Gauss–Markov
//! heading   δψ' = δψ + ω Δt                         of a vehicle that integrates its heading
//! ```

use serde::{Deserialize, Serialize};

use crate::error::Error;
use crate::event::seconds;
use crate::information::{Gaussian, Joint, NODE, NodeMatrix, NodeVector};
use crate::kernels::math::exp;
use crate::navigator::settings::check_all;
use crate::navigator::settings::origin::LASTING_BOUNDS;

/// A single range tells at most this much of the noise: normalised innovation squared.
const SQUARED_MOST: f64 = 9.0;
/// Mean of χ² of one degree of freedom that is cut off there.
const SQUARED_MEAN: f64 = 0.973;

/// Priors of lasting errors of ranges, and how far the noise may grow.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LastingOptions {
    /// Prior of the constant error of all ranges to one teammate, m; 0: none.
    pub sigma_range_bias_m: f64,
    /// Standard deviation of the part of the error that changes slowly, m; 0: none.
    pub sigma_range_drift_m: f64,
    /// In this time its correlation falls to 1/e, s.
    pub range_drift_s: f64,
    /// Noise of ranges and of the own motion may grow to so many times what is stated (standard deviation); 1: it does
    /// not.
    pub noise_scale_max: f64,
    /// Share of one range in it.
    pub noise_scale_rate: f64,
}

impl LastingOptions {
    /// Every error is new at each range, and noise is as stated.
    pub const NONE: Self = Self {
        sigma_range_bias_m: 0.0,
        sigma_range_drift_m: 0.0,
        range_drift_s: 30.0,
        noise_scale_max: 1.0,
        noise_scale_rate: 0.05,
    };

    /// Refuses what is outside the bounds of the settings.
    ///
    /// # Errors
    /// [`Error::NotFinite`], [`Error::OutOfBound`].
    pub fn validate(&self) -> Result<(), Error> {
        check_all(
            &LASTING_BOUNDS,
            &[
                ("sigma_range_bias_m", self.sigma_range_bias_m),
                ("sigma_range_drift_m", self.sigma_range_drift_m),
                ("range_drift_s", self.range_drift_s),
                ("noise_scale_max", self.noise_scale_max),
                ("noise_scale_rate", self.noise_scale_rate),
            ],
        )
    }

    /// Whether ranges have an error that lasts.
    #[must_use]
    pub fn of_ranges(&self) -> bool {
        self.sigma_range_bias_m > 0.0 || self.sigma_range_drift_m > 0.0
    }
}

impl Default for LastingOptions {
    fn default() -> Self {
        Self::NONE
    }
}

/// What a range told of the noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// Normalised innovation squared.
    pub squared: f64,
    /// Probability that it did not come by a longer way.
    pub on_time: f64,
    /// Share of the range's own noise in the innovation's variance.
    pub range_share: f64,
    /// Share of the own position's.
    pub motion_share: f64,
}

/// Factors on the variances that are stated.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct NoiseScale {
    /// Of ranges.
    pub range: f64,
    /// Of the own motion.
    pub motion: f64,
}

impl Default for NoiseScale {
    fn default() -> Self {
        Self { range: 1.0, motion: 1.0 }
    }
}

impl NoiseScale {
    /// A step up the likelihood of the innovation: ∂ ln N/∂ ln k = ½ (share of k in S) (ν²/S − 1).
    pub fn learn(&mut self, seen: &Seen, options: &LastingOptions) {
        if options.noise_scale_max <= 1.0 {
            return;
        }
        let excess = seen.on_time * (seen.squared.min(SQUARED_MOST) / SQUARED_MEAN - 1.0);
        let most = options.noise_scale_max * options.noise_scale_max;
        let step = |factor: f64, share: f64| {
            (factor * exp(options.noise_scale_rate * share * excess)).clamp(1.0, most)
        };
        self.range = step(self.range, seen.range_share);
        self.motion = step(self.motion, seen.motion_share);
    }
}

/// Places of these states in a joint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Lasting {
    /// By vehicle: the node of its ranges' error, and the time that it stands for, ns.
    ranges: Vec<Option<(usize, i64)>>,
    gyro: Option<usize>,
    /// Of the last odometry, ns.
    moved_ns: Option<i64>,
    /// Noise of the day.
    pub scale: NoiseScale,
}

impl Lasting {
    /// None yet, in a team of `vehicles`.
    #[must_use]
    pub fn new(vehicles: usize) -> Self {
        Self { ranges: vec![None; vehicles], gyro: None, moved_ns: None, scale: NoiseScale::default() }
    }

    /// The node of the error of ranges to a teammate, brought to `t_ns`.
    pub fn range_error(
        &mut self,
        joint: &mut Joint,
        peer: usize,
        t_ns: i64,
        options: &LastingOptions,
    ) -> Option<usize> {
        if !options.of_ranges() {
            return None;
        }
        let drift_m2 = options.sigma_range_drift_m * options.sigma_range_drift_m;
        let slot = self.ranges.get_mut(peer)?;
        let node = match *slot {
            Some((node, at_ns)) => {
                let kept = exp(-seconds(t_ns.saturating_sub(at_ns)).max(0.0) / options.range_drift_s);
                let (mut transition, mut noise) = (NodeMatrix::identity(), NodeMatrix::zeros());
                transition[(1, 1)] = kept;
                noise[(1, 1)] = drift_m2 * (1.0 - kept * kept);
                joint.propagate(node, &transition, &NodeVector::zeros(), &noise);
                node
            }
            None => {
                let variance = [options.sigma_range_bias_m * options.sigma_range_bias_m, drift_m2, 0.0, 0.0];
                joint.push(&prior(variance))
            }
        };
        *slot = Some((node, t_ns));
        Some(node)
    }

    /// With the own vehicle's odometry: its heading turns by what its gyro is wrong, prior `sigma_radps`.
    pub fn turn(&mut self, joint: &mut Joint, own: usize, t_ns: i64, sigma_radps: f64) {
        let since_s = seconds(t_ns.saturating_sub(self.moved_ns.unwrap_or(t_ns)));
        self.moved_ns = Some(t_ns);
        if sigma_radps <= 0.0 {
            return;
        }
        let gyro =
            *self.gyro.get_or_insert_with(|| joint.push(&prior([sigma_radps * sigma_radps, 0.0, 0.0, 0.0])));
        let mut turn = NodeMatrix::zeros();
        turn[(2, 0)] = since_s;
        joint.couple(own, gyro, &turn);
    }

    /// Factors on sigmas, the ranges' error (root mean square over teammates, m) and the gyro's (rad/s) as they are known.
    #[must_use]
    pub fn by_name(&self, joint: &Joint) -> [(&'static str, f64); 4] {
        let error_m = |node: &(usize, i64)| joint.node_mean(node.0).fixed_rows::<2>(0).sum();
        let errors = || self.ranges.iter().flatten().map(error_m);
        let mean_square_m2 =
            errors().map(|error| error * error).sum::<f64>() / errors().count().max(1) as f64;
        [
            ("range_noise_scale", self.scale.range.sqrt()),
            ("motion_noise_scale", self.scale.motion.sqrt()),
            ("range_error_m", mean_square_m2.abs().sqrt()),
            ("gyro_bias_radps", self.gyro.map_or(0.0, |node| joint.node_mean(node)[0])),
        ]
    }
}

fn prior(variance: [f64; NODE]) -> Gaussian<NODE> {
    Gaussian { mean: NodeVector::zeros(), covariance: NodeMatrix::from_diagonal(&NodeVector::from(variance)) }
}
