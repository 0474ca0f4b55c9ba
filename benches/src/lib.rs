//! Inputs that the benches share: a rich synthetic seabed, the navigators' usual options, one vehicle on a circle.

use std::f64::consts::TAU;
use std::sync::Arc;

use uwcoop_core::chart::{Chart, SigmaMap};
use uwcoop_core::error::Error;
use uwcoop_core::event::{Event, Payload};
use uwcoop_core::navigator::clock::ClockOptions;
use uwcoop_core::navigator::dmpf::DmpfOptions;
use uwcoop_core::navigator::drift::Drift;
use uwcoop_core::navigator::mpf::MpfOptions;
use uwcoop_core::navigator::range::{RangeMethod, RangeOptions};
use uwcoop_core::navigator::terrain_core::TerrainOptions;
use uwcoop_core::packet::PacketKind;

/// Side of the chart, nodes of 1 m.
pub const SIDE: usize = 1000;
/// Radius of the vehicle's circle around the chart's middle, m.
const RADIUS_M: f64 = 300.0;
/// Speed along it, m/s.
const SPEED_MPS: f64 = 1.5;
/// Nanoseconds in a second.
pub const SECOND_NS: i64 = 1_000_000_000;

/// A seabed of 32 waves, 12 to 130 m long, that tells places apart everywhere.
///
/// # Errors
/// What [`Chart::new`] says.
pub fn chart() -> Result<Arc<Chart>, Error> {
    let waves: Vec<[f64; 4]> = (0..32)
        .map(|k| {
            let k = f64::from(k);
            let length_m = 12.0 * 1.08f64.powf(k);
            let (s, c) = (2.399_963 * k).sin_cos();
            [TAU * c / length_m, TAU * s / length_m, 1.7 * k, 0.012 * length_m.min(60.0)]
        })
        .collect();
    let depth = |r: usize, c: usize| -> f32 {
        let relief: f64 = waves
            .iter()
            .map(|[ke, kn, phase, height]| height * (ke * c as f64 + kn * r as f64 + phase).sin())
            .sum();
        (20.0 + relief) as f32
    };
    let depths = (0..SIDE * SIDE).map(|i| depth(i / SIDE, i % SIDE)).collect();
    Chart::new(depths, SIDE, SIDE, 0.0, 0.0, 1.0, SigmaMap::Uniform(0.0), 0.0).map(Arc::new)
}

/// Tan, Chitre & Hover (2016), Table 1.
#[must_use]
pub fn drift() -> Drift {
    Drift {
        sigma_position_m_per_sqrt_s: 0.05,
        sigma_current_mps_per_sqrt_s: 0.01,
        sigma_current0_mps: 0.3,
        sigma_heading_bias0_rad: 0.0175,
        sigma_heading_bias_rad_per_sqrt_s: 1e-5,
        sigma_thrust_bias0_mps: 0.1,
        sigma_thrust_bias_mps_per_sqrt_s: 1e-4,
        dvl: Default::default(),
    }
}

/// `dmpf` as packaged.
#[must_use]
pub fn dmpf_options(particles: usize) -> DmpfOptions {
    DmpfOptions {
        update_entropy_sigma_m: None,
        particles,
        window: 14,
        sigma_like_m: 0.2,
        resample_share: 2.0 / 3.0,
        roughening_m2: 2.0,
        range: Some(RangeOptions {
            method: RangeMethod::Eq17 { samples: 0 },
            sigma_m: 1.0,
            gate_sigmas: f64::INFINITY,
            entropy_sigma_m: None,
            clock: ClockOptions::default(),
        }),
        terrain: true,
        packet: PacketKind::Belief,
        modes: 2,
        drift: drift(),
    }
}

/// `mpf` as packaged, on a chart whose error is correlated over 10 m.
#[must_use]
pub fn mpf_options(particles: usize) -> MpfOptions {
    MpfOptions {
        terrain: TerrainOptions {
            update_entropy_sigma_m: None,
            particles,
            resample_share: 2.0 / 3.0,
            sigma_depth_m: None,
            sigma_offset0_m: 1.0,
            sigma_offset_m_per_sounding: 0.005,
            student_dof: 4.0,
            correlation_length_m: Some(10.0),
            sigma_map_m: Some(0.1),
            sounding_spacing_m: 0.0,
            least_ess_share: 0.02,
            depth_noise_factor_max: Some(4.0),
            acquisition_sigma_m: 1e6,
            acquisition_particles: particles,
            start_anywhere: false,
            monitor: None,
            drift: drift(),
        },
        range: Some(RangeOptions {
            method: RangeMethod::Gaussian { temper: 1.0 },
            sigma_m: 1.0,
            gate_sigmas: 6.0,
            entropy_sigma_m: None,
            clock: ClockOptions::default(),
        }),
        range_novelty: true,
        packet: PacketKind::Belief,
    }
}

/// A vehicle on a circle, and what its sensors say once a second.
pub struct Lap {
    chart: Arc<Chart>,
    second: i64,
}

impl Lap {
    /// At the circle's easternmost point.
    #[must_use]
    pub fn new(chart: Arc<Chart>) -> Self {
        Self { chart, second: 0 }
    }

    fn position_m(&self, second: i64) -> [f64; 2] {
        let angle = SPEED_MPS / RADIUS_M * second as f64;
        let middle = 0.5 * SIDE as f64;
        [middle + RADIUS_M * angle.cos(), middle + RADIUS_M * angle.sin()]
    }

    /// The fix at the start.
    #[must_use]
    pub fn fix(&self) -> Event {
        let payload = Payload::Fix { position_m: self.position_m(0), covariance_m2: [25.0, 0.0, 25.0] };
        Event { t_ns: 0, vehicle: 0, payload }
    }

    /// Depth, sounding and command of the next second; the sounding's error is a wave of 0.05 m that never repeats.
    pub fn next_events(&mut self) -> [Event; 3] {
        self.second += 1;
        let (here, ahead) = (self.position_m(self.second), self.position_m(self.second + 1));
        let noise_m = 0.05 * (1.618_034 * self.second as f64 * self.second as f64).sin();
        let water_depth_m = self.chart.depth_at(here[0], here[1]).unwrap_or(20.0) + noise_m;
        let event = |payload| Event { t_ns: self.second * SECOND_NS, vehicle: 0, payload };
        [
            event(Payload::Depth { depth_m: 2.0, sigma_m: 0.05 }),
            event(Payload::WaterDepth { water_depth_m, sigma_m: 0.05 }),
            event(Payload::Motion { velocity_mps: [ahead[0] - here[0], ahead[1] - here[1]] }),
        ]
    }
}
