//! When the terrain core searches for its position: how a search begins, what it takes up, and how it ends.

use nalgebra::{Matrix2, Vector2};

use super::acquisition::{Acquisition, area_of_a_particle_m2};
use super::search_region::SearchRegion;
use super::{TerrainCore, TerrainState};
use crate::cloud::Cloud;
use crate::error::Error;
use crate::event::{Payload, seconds};
use crate::kernels::likelihood::{OffsetModel, RangeBelief};
use crate::kernels::particles::ParticleStep;
use crate::navigator::{Outcome, Status};
use crate::random::Purpose;

/// A cloud that grew is searched for anew beyond so many times the sigma from which on a start is …
const GROWN: f64 = 2.0;
/// … where it occupies so many times the area that its particles can hold …
const SPARSE: f64 = 8.0;
/// … by the slope of the chart over this distance, m.
const SLOPE_OVER_M: f64 = 2.0;

/// Standard deviation along the longer axis of a covariance [ee, en, nn].
fn largest_sigma([ee, en, nn]: [f64; 3]) -> f64 {
    (0.5 * (ee + nn) + (0.5 * (ee - nn)).hypot(en)).sqrt()
}

impl<const K: usize> TerrainCore<K> {
    /// Whether the position is being searched for.
    #[must_use]
    pub fn acquiring(&self) -> bool {
        self.state.acquisition.is_some()
    }

    /// Refuses a snapshot of another number of particles, or whose columns differ in length.
    ///
    /// # Errors
    /// [`Error::Snapshot`].
    pub fn check_same(&self, other: &TerrainState<K>) -> Result<(), Error> {
        self.state.core.check_same(&other.core)?;
        other.acquisition.as_ref().map_or(Ok(()), |a| a.check())
    }

    /// Advances the core, and a search with it; the step that the particles made, if any.
    ///
    /// Where the velocity in force ends to hold before `t_ns`, the last of two steps is given.
    pub fn advance(&mut self, t_ns: i64) -> Option<ParticleStep<K>> {
        if let Some(end_ns) = self.state.core.motion_ends_before(t_ns) {
            let step = self.step(end_ns);
            let widened = self.state.core.follow_motion(end_ns);
            self.widen_search(widened);
            if end_ns == t_ns {
                return step;
            }
        }
        self.step(t_ns)
    }

    /// What an event says of the motion: outcome, and by how much odometry moved the particles.
    pub fn take_motion(&mut self, t_ns: i64, payload: &Payload) -> (Outcome, Option<[f64; 2]>) {
        let (outcome, widened, shift) = self.state.core.take_motion(t_ns, payload);
        self.widen_search(widened);
        if let Some(by_m) = shift {
            if let Some(region) = &mut self.state.region {
                region.shift(by_m);
            }
            if let Some(acquisition) = &mut self.state.acquisition {
                acquisition.shift(by_m);
            }
        }
        (outcome, shift)
    }

    /// The error of the velocity may be larger than a search has learnt, by this on each axis, m²/s².
    fn widen_search(&mut self, widened: Option<f64>) {
        let Some(more) = widened else { return };
        if let Some(region) = &mut self.state.region {
            region.widen(more);
        }
        if let Some(acquisition) = &mut self.state.acquisition {
            acquisition.widen(more);
        }
    }

    fn step(&mut self, t_ns: i64) -> Option<ParticleStep<K>> {
        let before_ns = self.state.core.now_ns();
        let walk = self.state.core.position_walk_to(t_ns);
        let step = self.state.core.advance(t_ns);
        let dt_s = before_ns.map_or(0.0, |before_ns| seconds(t_ns.saturating_sub(before_ns)));
        if dt_s > 0.0 {
            let (velocity, drift) = (self.state.core.velocity_mps, *self.state.core.drift_in_force());
            if let Some(region) = &mut self.state.region {
                region.advance(velocity, dt_s, walk, &drift);
            }
            if let Some(acquisition) = &mut self.state.acquisition {
                acquisition.advance(velocity, dt_s, walk, &drift, &mut self.state.core);
            }
        }
        step
    }

    /// Begins a search over the region, if the chart has a depth in it.
    pub(super) fn acquire(&mut self, region: SearchRegion<K>) {
        let Some(chart) = &self.chart else { return };
        let core = &mut self.state.core;
        self.state.acquisition = Acquisition::over(&region, &self.options, chart, core).map(Box::new);
        if let Some(acquisition) = &self.state.acquisition {
            acquisition.draw_with_doubt(&region, core);
            core.status = Status::Acquiring;
        }
        self.state.region = Some(region);
    }

    /// Begins anew over the region; where it has left the chart, the ordinary cloud is where dead reckoning says.
    pub(super) fn acquire_anew(&mut self, region: SearchRegion<K>) {
        self.acquire(region);
        let state = &mut self.state;
        if let (None, Some(region), Some(chart)) = (&state.acquisition, &state.region, &self.chart) {
            let core = &mut state.core;
            let mut cloud = std::mem::replace(&mut core.cloud, Cloud::new(0));
            core.covariance = region.scatter(&mut cloud, chart, || core.next_stream(Purpose::Acquisition));
            cloud.equalise();
            cloud.offset_variance.fill(self.options.sigma_offset0_m.powi(2));
            core.cloud = cloud;
            core.status = Status::OffChart;
        }
    }

    /// Searches where the cloud has grown too wide for its particles.
    pub(super) fn acquire_if_wide(&mut self) {
        let (core, options) = (&self.state.core, &self.options);
        let (_, covariance) = core.cloud.position_moments();
        let (false, Some(chart)) = (self.acquiring(), &self.chart) else { return };
        if largest_sigma(covariance) <= GROWN * options.acquisition_sigma_m {
            return;
        }
        let around = self.scratch.look_up_around(chart, &core.cloud, SLOPE_OVER_M, options.sigma_map_m);
        let slope2 = around.varies_m2 / (SLOPE_OVER_M * SLOPE_OVER_M);
        let [ee, en, nn] = covariance;
        let area_m2 = 4.0 * std::f64::consts::PI * (ee * nn - en * en).max(0.0).sqrt();
        let held_m2 = area_of_a_particle_m2(around.map_m2, slope2) * core.cloud.len() as f64;
        if area_m2 > SPARSE * held_m2 {
            self.acquire(SearchRegion::of_cloud(&core.cloud, &core.covariance));
        }
    }

    /// Begins anywhere on the chart where no fix says more.
    pub(super) fn start_anywhere(&mut self) {
        let Some(chart) = &self.chart else { return };
        let grid = chart.grid();
        let half = [(grid.cols - 1) as f64, (grid.rows - 1) as f64].map(|nodes| 0.5 * nodes * grid.cell_m);
        let centre = [grid.east0_m + half[0], grid.north0_m + half[1]];
        // An ellipse of twice the sigma that holds the whole rectangle.
        let covariance = [half[0] * half[0], 0.0, half[1] * half[1]];
        self.weigh_fix(centre, covariance);
    }

    /// The first fix, or one that restarted the core.
    pub(super) fn begin_at(&mut self, position_m: [f64; 2], covariance_m2: [f64; 3]) {
        self.state.acquisition = None;
        self.state.region = None;
        if largest_sigma(covariance_m2) > self.options.acquisition_sigma_m {
            self.acquire(SearchRegion::around_fix(position_m, covariance_m2, &self.options.drift));
        }
    }

    /// A later fix that the core took up: one that says where the vehicle is ends a search, others are weighed by it.
    pub(super) fn take_up_fix(&mut self, position_m: [f64; 2], covariance_m2: [f64; 3]) {
        let state = &mut self.state;
        if largest_sigma(covariance_m2) <= self.options.acquisition_sigma_m {
            state.region = None;
            if state.acquisition.take().is_some() {
                let stream = state.core.next_stream(Purpose::Acquisition);
                state.core.cloud.scatter_disc(position_m, covariance_m2, &stream);
                state.core.cloud.offset_variance.fill(self.options.sigma_offset0_m.powi(2));
                state.core.status = Status::Navigating;
            }
            return;
        }
        let Some(region) = &mut state.region else { return };
        region.fix(position_m, covariance_m2);
        let Some(acquisition) = &mut state.acquisition else { return };
        let [ee, en, nn] = covariance_m2;
        if let Some(inverse) = Matrix2::new(ee, en, en, nn).try_inverse() {
            acquisition.weigh_fix(|e, n| {
                let off = Vector2::new(position_m[0] - e, position_m[1] - n);
                -0.5 * (off.transpose() * inverse * off)[0]
            });
            acquisition.resample(&self.options, &mut state.core);
            acquisition.draw_with_doubt(region, &mut state.core);
        }
    }

    /// A range while the position is searched for, to where a teammate believed to be at its launch.
    pub fn acquire_range(&mut self, belief: RangeBelief, temper: f64) -> Outcome {
        let state = &mut self.state;
        let (Some(acquisition), Some(region)) = (&mut state.acquisition, &state.region) else {
            return Outcome::Noted;
        };
        acquisition.weigh_range(belief, temper, &self.options);
        acquisition.resample(&self.options, &mut state.core);
        acquisition.draw_with_doubt(region, &mut state.core);
        Outcome::Fused
    }

    /// A sounding while the position is searched for, `apart_m` metres after the last.
    pub(super) fn acquire_sounding(
        &mut self,
        model: OffsetModel,
        apart_m: f64,
        water_depth_m: f64,
    ) -> Outcome {
        let state = &mut self.state;
        let (Some(chart), Some(acquisition), Some(region)) =
            (&self.chart, &mut state.acquisition, &state.region)
        else {
            return Outcome::Noted;
        };
        let core = &mut state.core;
        let sounding = (water_depth_m, apart_m);
        acquisition.weigh_sounding(
            &mut self.scratch,
            chart,
            &self.options,
            model,
            sounding,
            core.cloud.len(),
        );
        if acquisition.failed() {
            let region = region.clone();
            self.acquire_anew(region);
            return Outcome::Fused;
        }
        acquisition.resample(&self.options, core);
        if acquisition.done() {
            acquisition.draw(core);
            let stream = core.next_stream(Purpose::Acquisition);
            core.cloud.liu_west(&stream);
            core.status = Status::Navigating;
            state.acquisition = None;
            state.health = 1.0;
        } else {
            acquisition.draw_with_doubt(region, core);
        }
        Outcome::Fused
    }
}
