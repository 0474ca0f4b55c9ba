//! The particles of an acquisition: many, each for its neighbourhood, and one more hypothesis beside them.
//!
//! Liu–West regularisation with the covariance of the whole cloud pulls particles towards a mean that lies between the
//! hypotheses and jitters them by many times the distance over which terrain changes. Here nothing is shrunk. A sounding's
//! variance is widened by how much the chart varies within half the particles' spacing, and resampling moves each copy by
//! as much; both vanish as the particles concentrate. That the vehicle is at none of them has a share of its own, which
//! grows while a typical depth of the region explains the soundings better than the particles do.

use nalgebra::SMatrix;
use serde::{Deserialize, Serialize};

use super::TerrainOptions;
use super::search_region::{Seabed, SearchRegion};
use super::sounding::{SOFTENINGS, SoundingScratch};
use crate::chart::Chart;
use crate::cloud::Cloud;
use crate::error::Error;
use crate::kernels::likelihood::{OffsetModel, RangeBelief, add_range_gaussian};
use crate::kernels::particles::{cholesky_2x2, prepare_step};
use crate::navigator::drift::Drift;
use crate::navigator::particle_core::ParticleCore;
use crate::random::Purpose;

/// Side of the cells by which the occupied area is counted, m: terrain changes over about as much.
const CELL_M: f64 = 4.0;
/// Standard deviation on each axis of the neighbourhood that a particle stands for, in spacings.
const KERNEL_SPACINGS: f64 = 0.5;
/// Distance over which the misfit of a particle that is beside the truth stays itself, m.
const MISFIT_LENGTH_M: f64 = 4.0;
/// Particles for each square metre of the occupied area …
const PARTICLES_PER_M2: f64 = 4.0;
/// … but not fewer than this: modes may be as narrow as the noise.
const LEAST_PARTICLES: usize = 4000;
/// Probability that the vehicle is at none of the particles: at first, and at least.
const ELSEWHERE_AT_FIRST: f64 = 0.05;
const ELSEWHERE_AT_LEAST: f64 = 1e-4;
/// One sounding changes its log-odds by no more.
const MOST_EVIDENCE: f64 = 5.0;
/// The ordinary cloud can take over at a smaller probability, where its particles would lie so close that the depth between
/// two differs by less than the chart's error, or closer than this, m …
const ELSEWHERE_AT_HAND_OVER: f64 = 1e-3;
const NEAR_M: f64 = 1.0;
/// … for so many soundings in a row.
const SOUNDINGS_AT_HAND_OVER: u32 = 60;
/// A seabed that goes on from the last sounding may change by so many times the variance that is usual in the region: what is
/// known from the chart must explain a sounding better than what is known without, and does so by chance nowhere for long.
const UNUSUAL: f64 = 9.0;
/// Soundings that share an error when a vehicle hardly moves: enough to make one count for nothing.
const MOST_SHARED: f64 = 1e6;

/// An acquisition under way.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Acquisition<const K: usize> {
    cloud: Cloud<K>,
    covariance: SMatrix<f64, K, K>,
    /// Distance between neighbouring particles, m, and the area that they occupy.
    spacing_m: f64,
    area_m2: f64,
    /// Log-odds that the vehicle is at none of the particles.
    elsewhere: f64,
    /// What the charted seabed of the region is like.
    seabed: Seabed,
    /// The last sounding, m.
    last_m: Option<f64>,
    /// Whether the vehicle is taken to be on its chart.
    on_chart: bool,
    /// Soundings in a row at which the ordinary cloud could have taken over.
    ready: u32,
    #[serde(skip)]
    spare: Option<Box<Cloud<K>>>,
}

fn log_odds(probability: f64) -> f64 {
    (probability / (1.0 - probability)).ln()
}

/// Area that one particle can stand for, where the square of the slope is `slope2`: a square metre, or as much as the depth
/// varies in no more than the chart is wrong by.
pub fn area_of_a_particle_m2(map_m2: f64, slope2: f64) -> f64 {
    (map_m2 / (KERNEL_SPACINGS.powi(2) * slope2).max(f64::MIN_POSITIVE)).max(NEAR_M * NEAR_M)
}

impl<const K: usize> Acquisition<K> {
    /// Particles all over the region; `None` where the chart has no depth in it.
    pub fn over(
        region: &SearchRegion<K>,
        options: &TerrainOptions,
        chart: &Chart,
        core: &mut ParticleCore<K>,
    ) -> Option<Self> {
        let mut cloud = Cloud::new(options.acquisition_particles.max(core.cloud.len()));
        cloud.add_offset();
        cloud.offset_variance.fill(options.sigma_offset0_m.powi(2));
        let covariance = region.scatter(&mut cloud, chart, || core.next_stream(Purpose::Acquisition));
        let seabed = SearchRegion::seabed(chart, &cloud)?;
        let mut acquisition = Self {
            cloud,
            covariance,
            spacing_m: 0.0,
            area_m2: 0.0,
            elsewhere: log_odds(ELSEWHERE_AT_FIRST),
            seabed,
            last_m: None,
            on_chart: region.on_chart,
            ready: 0,
            spare: None,
        };
        acquisition.measure();
        Some(acquisition)
    }

    /// Refuses columns that differ in length: a snapshot's may.
    ///
    /// # Errors
    /// [`Error::Snapshot`].
    pub fn check(&self) -> Result<(), Error> {
        if self.cloud.is_consistent() && !self.cloud.is_empty() {
            return Ok(());
        }
        Err(Error::Snapshot("its particles of the acquisition differ in length".into()))
    }

    /// Moves its particles by `by_m`.
    pub fn shift(&mut self, by_m: [f64; 2]) {
        self.cloud.east.iter_mut().for_each(|e| *e += by_m[0]);
        self.cloud.north.iter_mut().for_each(|n| *n += by_m[1]);
    }

    /// The error of the velocity may be larger by `more`, m²/s² on each axis.
    pub fn widen(&mut self, more: f64) {
        self.covariance[(0, 0)] += more;
        self.covariance[(1, 1)] += more;
    }

    /// Area that the particles occupy, and their spacing.
    fn measure(&mut self) {
        let cell = |x: f64| u64::from((x / CELL_M).floor() as i32 as u32);
        let places = self.cloud.east.iter().zip(&self.cloud.north);
        let mut cells: Vec<u64> = places.map(|(e, n)| (cell(*e) << 32) | cell(*n)).collect();
        cells.sort_unstable();
        cells.dedup();
        self.area_m2 = cells.len() as f64 * CELL_M * CELL_M;
        self.spacing_m = (self.area_m2 / self.cloud.ess()).sqrt();
    }

    /// Propagates the particles; `walk_m2`: process noise of the position, [ee, en, nn].
    pub fn advance(
        &mut self,
        velocity_mps: [f64; 2],
        dt_s: f64,
        walk_m2: [f64; 3],
        drift: &Drift,
        core: &mut ParticleCore<K>,
    ) {
        let step = prepare_step(&mut self.covariance, velocity_mps, dt_s, walk_m2, &drift.walk(dt_s));
        self.cloud.propagate(&step, &core.next_stream(Purpose::Acquisition));
    }

    /// Weighs the particles by a sounding `apart_m` metres after the last, and says whether `count` ordinary particles
    /// would now do.
    pub fn weigh_sounding(
        &mut self,
        scratch: &mut SoundingScratch,
        chart: &Chart,
        options: &TerrainOptions,
        mut model: OffsetModel,
        sounding: (f64, f64),
        count: usize,
    ) {
        let (water_depth_m, apart_m) = sounding;
        let kernel_m = KERNEL_SPACINGS * self.spacing_m;
        let around = scratch.look_up_around(chart, &self.cloud, kernel_m, options.sigma_map_m);
        let noise_m2 = model.sigma_m.powi(2) + around.map_m2;
        // Beside the truth, the misfit of one sounding is that of the next: they count as one.
        let same = (2.0 * MISFIT_LENGTH_M.max(kernel_m) / apart_m.max(1e-9)).clamp(model.shared, MOST_SHARED);
        model.shared = (model.shared * noise_m2 + same * around.varies_m2) / (noise_m2 + around.varies_m2);
        let (typical, goes_on) =
            self.without_chart(sounding, noise_m2, around.varies_m2, model.sigma_m, options);
        let (typical, goes_on) = (typical / model.shared, goes_on / model.shared);
        // After a start, particles off the chart must not outlive those that have one.
        let uncharted = if self.on_chart { typical } else { goes_on };
        self.last_m = Some(water_depth_m);
        let walk_m2 = options.sigma_offset_m_per_sounding.powi(2);
        let mut column = self.cloud.likelihood_column();
        for attempt in 0..=SOFTENINGS {
            scratch.weigh(&model, &self.cloud, water_depth_m, walk_m2, &mut column);
            column.iter_mut().filter(|l| l.is_nan()).for_each(|l| *l = uncharted);
            if attempt == 0 {
                self.doubt(goes_on - self.log_evidence(&column));
            }
            if self.cloud.ess_after(&column) >= options.least_ess_share * self.cloud.len() as f64 {
                break;
            }
            model.sigma_m *= 2.0;
        }
        scratch.correct(&mut self.cloud);
        self.cloud.reweight(column);
        let slope2 = around.varies_m2 / (kernel_m * kernel_m).max(f64::MIN_POSITIVE);
        let close = self.area_m2 <= area_of_a_particle_m2(around.map_m2, slope2) * count as f64;
        let sure = self.elsewhere < log_odds(ELSEWHERE_AT_HAND_OVER);
        self.ready = if close && sure { self.ready + 1 } else { 0 };
    }

    /// Log-likelihoods of a sounding without a chart: of a depth that is typical of the region, and of a seabed that goes on
    /// from the last sounding with a slope that is, widened as the particles' is. The second is what a vehicle explains
    /// that is at none of the particles, or over a hole: places on the chart that fit by chance must not win against
    /// it where a smooth seabed is hard to tell from another.
    fn without_chart(
        &self,
        (water_depth_m, apart_m): (f64, f64),
        noise_m2: f64,
        varies_m2: f64,
        sigma_m: f64,
        options: &TerrainOptions,
    ) -> (f64, f64) {
        let density = |off: f64, variance: f64| -0.5 * (off * off / variance + variance.ln());
        let seabed = &self.seabed;
        let typical_m2 = seabed.relief_m2 + noise_m2 + options.sigma_offset0_m.powi(2);
        let typical = density(water_depth_m - seabed.mean_m, typical_m2);
        let Some(last_m) = self.last_m.filter(|_| apart_m.is_finite()) else {
            return (typical, typical);
        };
        let changes_m2 = (seabed.slope2 * apart_m * apart_m).min(2.0 * seabed.relief_m2);
        let goes_on_m2 = varies_m2 + noise_m2 + UNUSUAL * (sigma_m * sigma_m + changes_m2);
        (typical, density(water_depth_m - last_m, goes_on_m2))
    }

    /// ln of the mean likelihood of the particles.
    fn log_evidence(&self, log_likelihood: &[f64]) -> f64 {
        let top = log_likelihood.iter().fold(f64::NEG_INFINITY, |a, b| a.max(*b));
        let terms = log_likelihood.iter().zip(self.cloud.weights());
        top + terms.map(|(l, w)| w * (l - top).exp()).sum::<f64>().ln()
    }

    fn doubt(&mut self, evidence: f64) {
        let changed = self.elsewhere + evidence.clamp(-MOST_EVIDENCE, MOST_EVIDENCE);
        self.elsewhere = changed.max(log_odds(ELSEWHERE_AT_LEAST));
    }

    /// Whether it is likelier that the vehicle is at none of the particles.
    pub fn failed(&self) -> bool {
        self.elsewhere > 0.0
    }

    /// Whether the ordinary cloud can take over.
    pub fn done(&self) -> bool {
        self.ready >= SOUNDINGS_AT_HAND_OVER
    }

    /// Weighs the particles by a fix.
    pub fn weigh_fix(&mut self, log_density: impl Fn(f64, f64) -> f64) {
        let mut column = self.cloud.likelihood_column();
        for ((l, e), n) in column.iter_mut().zip(&self.cloud.east).zip(&self.cloud.north) {
            *l = log_density(*e, *n);
        }
        self.cloud.reweight(column);
    }

    /// Weighs the particles by a range to where a teammate believed to be, each with the neighbourhood it stands for.
    pub fn weigh_range(&mut self, mut belief: RangeBelief, temper: f64, options: &TerrainOptions) {
        belief.sigma_m = belief.sigma_m.hypot(KERNEL_SPACINGS * self.spacing_m);
        let mut column = self.cloud.likelihood_column();
        for _ in 0..=SOFTENINGS {
            column.fill(0.0);
            add_range_gaussian(&belief, temper, &self.cloud.east, &self.cloud.north, &mut column);
            if self.cloud.ess_after(&column) >= options.least_ess_share * self.cloud.len() as f64 {
                break;
            }
            belief.sigma_m *= 2.0;
        }
        self.cloud.reweight(column);
    }

    /// Resamples where the weights call for it, to as many particles as the occupied area needs.
    pub fn resample(&mut self, options: &TerrainOptions, core: &mut ParticleCore<K>) {
        if self.cloud.ess() <= options.resample_share * self.cloud.len() as f64 {
            let most = options.acquisition_particles.max(core.cloud.len());
            let least = LEAST_PARTICLES.max(core.cloud.len()).min(most);
            let count = ((self.area_m2 * PARTICLES_PER_M2) as usize).clamp(least, most);
            let mut spare = self.spare.take().unwrap_or_else(|| Box::new(Cloud::new(0)));
            spare.draw_from(&self.cloud, count, &core.next_stream(Purpose::Acquisition));
            std::mem::swap(&mut *spare, &mut self.cloud);
            self.spare = Some(spare);
            self.measure();
            let jitter_m = KERNEL_SPACINGS * self.spacing_m;
            self.cloud.spread(jitter_m, [0.0; K], &core.next_stream(Purpose::Acquisition));
        }
        self.measure();
    }

    /// Makes the ordinary cloud a draw of the particles.
    pub fn draw(&self, core: &mut ParticleCore<K>) {
        let (stream, count) = (core.next_stream(Purpose::Acquisition), core.cloud.len());
        core.cloud.draw_from(&self.cloud, count, &stream);
        core.covariance = self.covariance;
    }

    /// As [`Acquisition::draw`], with the share that is elsewhere scattered over the region.
    pub fn draw_with_doubt(&self, region: &SearchRegion<K>, core: &mut ParticleCore<K>) {
        self.draw(core);
        let count = core.cloud.len();
        let elsewhere = (count as f64 / (1.0 + (-self.elsewhere).exp())).round() as usize;
        let (mean, covariance) = region.position();
        let [l11, l21, l22] = cholesky_2x2(covariance);
        let (mut a, mut b) = (vec![0.0; elsewhere], vec![0.0; elsewhere]);
        core.next_stream(Purpose::Acquisition).normal_pairs(0, &mut a, &mut b);
        for (k, (a, b)) in a.iter().zip(&b).enumerate() {
            let i = k * count / elsewhere;
            core.cloud.east[i] = mean[0] + l11 * a;
            core.cloud.north[i] = mean[1] + l21 * a + l22 * b;
        }
    }
}
