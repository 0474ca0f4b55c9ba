//! A small world for the tests: charts of known form, the navigators' usual options, a vehicle, packets.
#![allow(dead_code, reason = "each test binary uses a part of it")]

pub mod fleet;

use std::f64::consts::TAU;
use std::sync::Arc;

use nalgebra::{Matrix2, Vector2};
use uwcoop_core::chart::{Chart, SigmaMap};
use uwcoop_core::event::{Event, Payload, VehicleId};
use uwcoop_core::navigator::clock::ClockOptions;
use uwcoop_core::navigator::dead_reckoning::DeadReckoning;
use uwcoop_core::navigator::dmpf::{Dmpf, DmpfOptions};
use uwcoop_core::navigator::drift::Drift;
use uwcoop_core::navigator::mpf::{Mpf, MpfOptions};
use uwcoop_core::navigator::range::{RangeMethod, RangeOptions};
use uwcoop_core::navigator::terrain_core::{MonitorOptions, TerrainOptions};
use uwcoop_core::navigator::{Navigator, Outcome};
use uwcoop_core::packet::{Belief, BeliefPacket, Header, HeardBitmap, PacketKind};
use uwcoop_core::random::{Purpose, Streams};

/// Nanoseconds in a second.
pub const SECOND: i64 = 1_000_000_000;
/// What the world and its navigators agree on, m/s.
pub const SOUND_SPEED_MPS: f64 = 1500.0;
/// Side of a chart, nodes of 1 m; its south-west node is the frame's origin.
pub const SIDE: usize = 400;

/// A chart of `SIDE` × `SIDE` nodes with this depth (NaN: a hole), without error.
pub fn chart_of(depth: impl Fn(f64, f64) -> f64) -> Arc<Chart> {
    let depths = (0..SIDE * SIDE).map(|i| depth((i % SIDE) as f64, (i / SIDE) as f64) as f32).collect();
    Arc::new(Chart::new(depths, SIDE, SIDE, 0.0, 0.0, 1.0, SigmaMap::Uniform(0.0), 0.0).unwrap())
}

/// Depth of a seabed that tells places apart everywhere: 24 waves, 12 to 75 m long.
pub fn rich_depth(east: f64, north: f64) -> f64 {
    (0..24)
        .map(|k| {
            let k = f64::from(k);
            let length_m = 12.0 * 1.083f64.powf(k);
            let (s, c) = (2.399_963 * k).sin_cos();
            0.004 * length_m * (TAU / length_m * (c * east + s * north) + 1.7 * k).sin()
        })
        .sum::<f64>()
        + 20.0
}

/// That seabed.
pub fn rich() -> Arc<Chart> {
    chart_of(rich_depth)
}

/// Tan, Chitre & Hover (2016), Table 1.
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

pub const EQ17: RangeMethod = RangeMethod::Eq17 { samples: 0 };
pub const GAUSSIAN: RangeMethod = RangeMethod::Gaussian { temper: 0.25 };

pub fn range(method: RangeMethod, gate_sigmas: f64) -> Option<RangeOptions> {
    Some(RangeOptions {
        method,
        sigma_m: 1.0,
        gate_sigmas,
        entropy_sigma_m: None,
        clock: ClockOptions::default(),
    })
}

/// `dmpf` as packaged.
pub fn dmpf_options(particles: usize) -> DmpfOptions {
    DmpfOptions {
        update_entropy_sigma_m: None,
        particles,
        window: 14,
        sigma_like_m: 0.2,
        resample_share: 2.0 / 3.0,
        roughening_m2: 2.0,
        range: range(EQ17, f64::INFINITY),
        terrain: true,
        packet: PacketKind::Belief,
        modes: 2,
        drift: drift(),
    }
}

/// `mpf` as packaged for a perfect chart.
pub fn mpf_options(particles: usize) -> MpfOptions {
    MpfOptions {
        terrain: TerrainOptions {
            update_entropy_sigma_m: None,
            particles,
            resample_share: 2.0 / 3.0,
            sigma_depth_m: None,
            sigma_offset0_m: 1.0,
            sigma_offset_m_per_sounding: 0.002,
            student_dof: f64::INFINITY,
            correlation_length_m: None,
            sigma_map_m: None,
            sounding_spacing_m: 0.0,
            least_ess_share: 0.02,
            depth_noise_factor_max: Some(4.0),
            acquisition_sigma_m: 20.0,
            acquisition_particles: 20_000,
            start_anywhere: false,
            monitor: Some(MonitorOptions {
                forgetting: 0.05,
                clip: 25.0,
                alarm: 6.0,
                spread_m: 10.0,
                repeat_spread_m: 25.0,
                spread_current_mps: 0.1,
                quiet_s: 20.0,
                repeat_s: 100.0,
            }),
            drift: drift(),
        },
        range: range(GAUSSIAN, 6.0),
        range_novelty: true,
        packet: PacketKind::Belief,
    }
}

pub fn dmpf(own: VehicleId, vehicles: usize, options: DmpfOptions, chart: &Arc<Chart>, seed: u64) -> Dmpf {
    Dmpf::new(own, vehicles, options, Some(chart.clone()), SOUND_SPEED_MPS, seed).unwrap()
}

pub fn mpf<const K: usize>(
    own: VehicleId,
    vehicles: usize,
    options: MpfOptions,
    chart: &Arc<Chart>,
    seed: u64,
) -> Mpf<K> {
    Mpf::new(own, vehicles, options, Some(chart.clone()), SOUND_SPEED_MPS, seed).unwrap()
}

/// The particle navigators of vehicle `own`, by name.
pub fn particle_navigators(
    own: VehicleId,
    vehicles: usize,
    chart: &Arc<Chart>,
) -> Vec<(&'static str, Box<dyn Navigator>)> {
    vec![
        ("dmpf", Box::new(dmpf(own, vehicles, dmpf_options(200), chart, 5))),
        ("mpf<2>", Box::new(mpf::<2>(own, vehicles, mpf_options(200), chart, 5))),
        ("mpf<4>", Box::new(mpf::<4>(own, vehicles, mpf_options(200), chart, 5))),
    ]
}

/// All navigators of vehicle `own`, by name.
pub fn navigators(
    own: VehicleId,
    vehicles: usize,
    chart: &Arc<Chart>,
) -> Vec<(&'static str, Box<dyn Navigator>)> {
    let mut all = particle_navigators(own, vehicles, chart);
    all.push(("dead-reckoning", Box::new(DeadReckoning::new(own, vehicles, drift()).unwrap())));
    all
}

pub fn event(t_ns: i64, vehicle: VehicleId, payload: Payload) -> Event {
    Event { t_ns, vehicle, payload }
}

pub fn fix(t_ns: i64, vehicle: VehicleId, position_m: [f64; 2], variance_m2: f64) -> Event {
    event(t_ns, vehicle, Payload::Fix { position_m, covariance_m2: [variance_m2, 0.0, variance_m2] })
}

/// A belief packet of `sender` at `position_m`, launched at `tol_ns` as its `sequence`-th packet.
pub fn packet(sender: VehicleId, tol_ns: i64, sequence: u8, position_m: [f64; 2], depth_m: f64) -> Arc<[u8]> {
    let header = Header { kind: PacketKind::Belief, sequence, depth_m, heard: HeardBitmap::default() };
    let belief =
        Belief { mean_m: Vector2::from(position_m), covariance_m2: Matrix2::new(4.0, 0.5, 0.5, 3.0) };
    BeliefPacket { header, belief }.encode(sender, tol_ns).unwrap().into()
}

/// Its reception by `receiver` at `t_ns`, with a travel time that says `range_m`.
pub fn reception(
    t_ns: i64,
    receiver: VehicleId,
    sender: VehicleId,
    tol_ns: i64,
    range_m: f64,
    bytes: &Arc<[u8]>,
) -> Event {
    let toa_ns = tol_ns + (range_m / SOUND_SPEED_MPS * 1e9) as i64;
    event(t_ns, receiver, Payload::Reception { sender, tol_ns, toa_ns, bytes: bytes.clone() })
}

/// Standard normals of the world, apart from the navigators' own.
pub fn world_noise(seed: u64, who: u16, count: usize) -> Vec<f64> {
    let (mut a, mut b) = (vec![0.0; count], vec![0.0; count]);
    Streams::new(seed ^ 0x5EED_0000, who).at(Purpose::Process, 0).normal_pairs(9, &mut a, &mut b);
    a
}

/// A vehicle whose track is given, and what its sensors say.
pub struct Vehicle<F> {
    pub index: VehicleId,
    /// Track, m, over time in seconds.
    pub track: F,
    /// Water current, m/s: what the command does not know.
    pub current_mps: [f64; 2],
    /// Water deeper than the chart, m.
    pub tide_m: f64,
    /// Errors of the soundings, m, one for each second.
    pub sounding_errors_m: Vec<f64>,
}

impl<F: Fn(f64) -> [f64; 2]> Vehicle<F> {
    pub fn new(index: VehicleId, track: F) -> Self {
        Self { index, track, current_mps: [0.0; 2], tide_m: 0.0, sounding_errors_m: Vec::new() }
    }

    /// Where it is.
    pub fn position_m(&self, t_ns: i64) -> [f64; 2] {
        (self.track)(t_ns as f64 / SECOND as f64)
    }

    /// Depth, sounding (none where the chart has no depth) and command at a whole second.
    pub fn second(&self, second: i64, depth: impl Fn(f64, f64) -> f64) -> Vec<Event> {
        let (here, ahead) = (self.position_m(second * SECOND), self.position_m((second + 1) * SECOND));
        let at = |payload| event(second * SECOND, self.index, payload);
        let error = self.sounding_errors_m.get(second as usize).copied().unwrap_or(0.0);
        let water_depth_m = depth(here[0], here[1]) + self.tide_m + error;
        let mut events = vec![at(Payload::Depth { depth_m: 3.0, sigma_m: 0.05 })];
        if water_depth_m.is_finite() {
            events.push(at(Payload::WaterDepth { water_depth_m, sigma_m: 0.05 }));
        }
        let velocity_mps = [0, 1].map(|a| ahead[a] - here[a] - self.current_mps[a]);
        events.push(at(Payload::Motion { velocity_mps }));
        events
    }
}

/// 20 seconds of an uneventful mission of vehicle `own`.
pub fn warm_up(navigator: &mut dyn Navigator, own: VehicleId) {
    let vehicle = Vehicle::new(own, |t| [120.0 + 1.2 * t, 150.0 + 0.9 * t]);
    assert_eq!(navigator.handle(&fix(0, own, vehicle.position_m(0), 25.0)).unwrap(), Outcome::Fused);
    for second in 0..=20 {
        for event in vehicle.second(second, rich_depth) {
            navigator.handle(&event).unwrap();
        }
    }
}

/// Distance of two points, m.
pub fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}
