//! Acquisition: finds a vehicle that is known only to be somewhere in a wide region, or lost, on its chart.
//!
//! Many particles stand for the region, each for its neighbourhood: a sounding's variance is widened by what the chart
//! varies within half the particles' spacing, resampling moves each copy by that much, and nothing is shrunk towards a
//! mean that lies between hypotheses. Their number follows the area that they still occupy. Beside them stands one more
//! hypothesis, that the vehicle is at none of them: its share is in the estimate, and when it prevails the search begins
//! anew over the whole region. When few cells are left, the ordinary cloud takes over.

use nalgebra::SMatrix;
use serde::{Deserialize, Serialize};

use super::search_region::SearchRegion;
use super::sounding::SoundingScratch;
use super::{TerrainCore, TerrainOptions};
use crate::chart::Chart;
use crate::cloud::Cloud;
use crate::kernels::likelihood::OffsetModel;
use crate::kernels::particles::{cholesky_2x2, prepare_step};
use crate::navigator::drift::Drift;
use crate::navigator::particle_core::ParticleCore;
use crate::navigator::{Outcome, Status};
use crate::random::Purpose;

/// Side of the cells by which the occupied area is counted, m.
const CELL_M: f64 = 4.0;

pub fn knob(name: &str, default: f64) -> f64 {
    std::env::var(name).ok().and_then(|v| v.parse().ok()).unwrap_or(default)
}

/// An acquisition under way.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Acquisition<const K: usize> {
    cloud: Cloud<K>,
    #[serde(skip)]
    spare: Option<Box<Cloud<K>>>,
    covariance: SMatrix<f64, K, K>,
    /// Distance between neighbouring particles, m.
    spacing_m: f64,
    area_m2: f64,
    /// Log-odds that the vehicle is at none of the particles.
    elsewhere: f64,
    /// Mean and variance of the charted depth over the region.
    depths: [f64; 2],
    /// Soundings in a row after which a hand-over was due.
    due: u32,
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
        let depths = SearchRegion::depths(chart, &cloud)?;
        let mut acquisition = Self {
            cloud,
            spare: None,
            covariance,
            spacing_m: 0.0,
            area_m2: 0.0,
            elsewhere: logit(knob("ELSE0", 0.05)),
            depths,
            due: 0,
        };
        acquisition.measure();
        Some(acquisition)
    }

    /// Area that the particles occupy, and their spacing.
    fn measure(&mut self) {
        let mut cells: Vec<u64> = self
            .cloud
            .east
            .iter()
            .zip(&self.cloud.north)
            .map(|(e, n)| {
                let cell = |x: &f64| (x / CELL_M).floor() as i32 as u32;
                u64::from(cell(e)) << 32 | u64::from(cell(n))
            })
            .collect();
        cells.sort_unstable();
        cells.dedup();
        self.area_m2 = cells.len() as f64 * CELL_M * CELL_M;
        self.spacing_m = (self.area_m2 / self.cloud.ess()).sqrt();
    }

    pub fn advance(&mut self, velocity_mps: [f64; 2], dt_s: f64, drift: &Drift, core: &mut ParticleCore<K>) {
        let step = prepare_step(
            &mut self.covariance,
            velocity_mps,
            dt_s,
            drift.position_walk(dt_s),
            &drift.walk(dt_s),
        );
        let stream = core.next_stream(Purpose::Acquisition);
        self.cloud.propagate(&step, &stream);
    }

    /// Weighs the particles by a sounding of which `apart_m` metres were travelled since the last.
    fn weigh(
        &mut self,
        scratch: &mut SoundingScratch,
        chart: &Chart,
        options: &TerrainOptions,
        mut model: OffsetModel,
        apart_m: f64,
        water_depth_m: f64,
    ) {
        let kernel_m = knob("KERNEL", 0.5) * self.spacing_m;
        let rho = scratch.look_up_around(chart, &self.cloud, kernel_m, options.sigma_map_m);
        let noise = model.sigma_m.powi(2) + scratch.noise_of_map();
        let shared_m = knob("ELL", 4.0).max(kernel_m);
        let n_rho = (2.0 * shared_m / apart_m.max(1e-9)).clamp(1.0, 1e6).max(model.shared);
        model.shared = (model.shared * noise + n_rho * rho) / (noise + rho);
        let q = options.sigma_offset_m_per_sounding.powi(2);
        let mut column = self.cloud.likelihood_column();
        let generic = {
            let s = self.depths[1] + noise + options.sigma_offset0_m.powi(2);
            (-0.5 * (water_depth_m - self.depths[0]).powi(2) / s - 0.5 * s.ln()) / model.shared
        };
        for attempt in 0..=6 {
            scratch.weigh(&model, &self.cloud, water_depth_m, q, &mut column);
            column.iter_mut().filter(|l| l.is_nan()).for_each(|l| *l = generic);
            if attempt == 0 {
                let weights = self.cloud.weights();
                let top = column.iter().fold(f64::NEG_INFINITY, |a, b| a.max(*b));
                let sum: f64 = column.iter().zip(weights).map(|(l, w)| w * (l - top).exp()).sum();
                let against = generic - (top + sum.ln());
                let most = knob("CLAMP", 5.0);
                self.elsewhere = (self.elsewhere + against.clamp(-most, most)).max(logit(knob("FLOOR", 1e-4)));
            }
            if self.cloud.ess_after(&column) >= options.least_ess_share * self.cloud.len() as f64 {
                break;
            }
            model.sigma_m *= 2.0;
        }
        scratch.correct(&mut self.cloud);
        self.cloud.reweight(column);
    }

    fn resample(&mut self, options: &TerrainOptions, core: &mut ParticleCore<K>) {
        if self.cloud.ess() <= options.resample_share * self.cloud.len() as f64 {
            let most = options.acquisition_particles.max(core.cloud.len());
            let wanted = (self.area_m2 / knob("PERPART", 0.25)) as usize;
            let least = (knob("LEAST", 4000.0) as usize).max(core.cloud.len());
            let count = wanted.clamp(least, most.max(least));
            let mut spare = self.spare.take().unwrap_or_else(|| {
                let mut cloud = Cloud::new(0);
                cloud.add_offset();
                Box::new(cloud)
            });
            spare.draw_from(&self.cloud, count, &core.next_stream(Purpose::Acquisition));
            std::mem::swap(&mut *spare, &mut self.cloud);
            self.spare = Some(spare);
            self.measure();
            self.cloud.spread(
                knob("JITTER", 0.5) * self.spacing_m,
                [0.0; K],
                &core.next_stream(Purpose::Acquisition),
            );
        }
        self.measure();
    }

    /// Shows the search in the ordinary cloud: a draw of its particles, with the share that is elsewhere from the region.
    fn show(&self, region: &SearchRegion<K>, core: &mut ParticleCore<K>) {
        let stream = core.next_stream(Purpose::Acquisition);
        let count = core.cloud.len();
        core.cloud.draw_from(&self.cloud, count, &stream);
        core.covariance = self.covariance;
        let elsewhere = (count as f64 / (1.0 + (-self.elsewhere).exp())).round() as usize;
        let stream = core.next_stream(Purpose::Acquisition);
        let (mean, covariance) = region.position();
        let [l11, l21, l22] = cholesky_2x2(covariance);
        let (mut a, mut b) = (vec![0.0; elsewhere], vec![0.0; elsewhere]);
        stream.normal_pairs(0, &mut a, &mut b);
        for (k, (a, b)) in a.iter().zip(&b).enumerate() {
            let i = k * count / elsewhere;
            core.cloud.east[i] = mean[0] + l11 * a;
            core.cloud.north[i] = mean[1] + l21 * a + l22 * b;
        }
        core.status = Status::Acquiring;
    }
}

fn logit(p: f64) -> f64 {
    (p / (1.0 - p)).ln()
}

impl<const K: usize> TerrainCore<K> {
    /// Whether the position is being searched for.
    #[must_use]
    pub fn acquiring(&self) -> bool {
        self.state.acquisition.is_some()
    }

    /// Advances the core, and the search with it.
    pub fn advance(&mut self, t_ns: i64) -> Option<crate::kernels::particles::ParticleStep<K>> {
        let before_ns = self.state.core.now_ns();
        let step = self.state.core.advance(t_ns);
        let dt_s = before_ns.map_or(0.0, |before| crate::event::seconds(t_ns.saturating_sub(before)));
        if dt_s > 0.0 {
            let velocity = self.state.core.velocity_mps;
            let drift = &self.options.drift;
            if let Some(region) = &mut self.state.region {
                region.advance(velocity, dt_s, drift);
            }
            if let Some(acquisition) = &mut self.state.acquisition {
                acquisition.advance(velocity, dt_s, drift, &mut self.state.core);
            }
        }
        step
    }

    /// Begins a search over the region.
    pub(super) fn acquire(&mut self, region: SearchRegion<K>) {
        let Some(chart) = &self.chart else { return };
        let core = &mut self.state.core;
        self.state.acquisition = Acquisition::over(&region, &self.options, chart, core).map(Box::new);
        if let Some(acquisition) = &self.state.acquisition {
            acquisition.show(&region, core);
            if knob("TRACE", 0.0) > 0.0 {
                eprintln!("acquire {:?} at {:?}", region.position(), core.now_ns().map(|t| t as f64 * 1e-9));
            }
        }
        self.state.region = Some(region);
    }

    /// A sounding while the position is searched for.
    pub(super) fn acquire_sounding(&mut self, model: OffsetModel, apart_m: f64, water_depth_m: f64) -> Outcome {
        let state = &mut self.state;
        let (Some(chart), Some(acquisition), Some(region)) =
            (&self.chart, &mut state.acquisition, &state.region)
        else {
            return Outcome::Noted;
        };
        let core = &mut state.core;
        acquisition.weigh(&mut self.scratch, chart, &self.options, model, apart_m, water_depth_m);
        if acquisition.elsewhere > 0.0 {
            let region = region.clone();
            self.acquire(region);
            return Outcome::Fused;
        }
        acquisition.resample(&self.options, core);
        acquisition.show(region, core);
        let few = acquisition.area_m2 < knob("HAND", 1.0) * core.cloud.len() as f64;
        acquisition.due = if few && acquisition.elsewhere < logit(knob("SURE", 1e-3)) { acquisition.due + 1 } else { 0 };
        if f64::from(acquisition.due) >= knob("DUE", 10.0) {
            if knob("TRACE", 0.0) > 0.0 {
                eprintln!("hand over {:?} at {:?}", core.cloud.position_moments(), core.now_ns().map(|t| t as f64 * 1e-9));
            }
            let count = core.cloud.len();
            let stream = core.next_stream(Purpose::Acquisition);
            core.cloud.draw_from(&acquisition.cloud, count, &stream);
            let stream = core.next_stream(Purpose::Acquisition);
            core.cloud.liu_west(&stream);
            core.status = Status::Navigating;
            state.acquisition = None;
            state.health = 1.0;
        }
        Outcome::Fused
    }
}
