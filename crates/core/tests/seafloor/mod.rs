//! A small seafloor: two hovering vehicles that take turns as the landmark, and one that follows.
#![allow(dead_code, reason = "each test binary uses a part of it")]

use std::f64::consts::{PI, TAU};
use std::sync::Arc;

use uwcoop_core::event::{Event, Payload, VehicleId};
use uwcoop_core::measurement::angle::wrap;
use uwcoop_core::mixture::{Criterion, FitOptions};
use uwcoop_core::navigator::Navigator;
use uwcoop_core::navigator::landmark::consensus::ConsensusRule;
use uwcoop_core::navigator::landmark::jump_hypotheses::JumpRule;
use uwcoop_core::navigator::landmark::model::{Acoustics, Gate, MonitorRule, RatioReading};
use uwcoop_core::navigator::landmark::{
    BiasModelAverage, Landmark, LandmarkOptions, LandmarkPaper, PacketOptions, PaperOptions,
};
use uwcoop_core::packet::landmark::{ExchangeFormat, ExchangeSize};
use uwcoop_core::random::{Purpose, Streams};

pub const SECOND: i64 = 1_000_000_000;
const STEP: i64 = SECOND / 5;
const DEGREE: f64 = PI / 180.0;
/// Table 4.
pub const SIGMA: [f64; 3] = [0.66, 6.0 * DEGREE, DEGREE];
pub const SIGMA_TURN: f64 = 0.0745 * DEGREE;
pub const SPEED: f64 = 0.15;

pub fn packet(size: ExchangeSize) -> PacketOptions {
    PacketOptions {
        format: ExchangeFormat::Two,
        size,
        criterion: Criterion::Bic,
        fit: FitOptions { starts: 2, iterations: 40, tolerance: 1e-4, ridge_one: 1e-9, ridge_many: 1e-3 },
        search_points: 500,
    }
}

pub fn acoustics() -> Acoustics {
    Acoustics { sigma: SIGMA, threshold: [3.0; 3] }
}

pub fn jump_rule() -> JumpRule {
    JumpRule { window: 8, sigma_m: 0.2, sigma_rad: 30.0 * DEGREE, share: 1e-4, odds: 10.0 }
}

/// The options of recovery by a vote of the last positionings.
pub fn by_consensus() -> LandmarkOptions {
    let rule = ConsensusRule { window: 6, quorum: 4, agree: 7.8, disagree: 30.0 };
    LandmarkOptions { consensus: Some(rule), jump: None, ..robust_options() }
}

/// `landmark` as packaged.
pub fn robust_options() -> LandmarkOptions {
    LandmarkOptions {
        acoustics: acoustics(),
        outliers: Some((0.05, [60.0, TAU, TAU])),
        fix_correlation_s: 0.0,
        use_fixes: true,
        particles: 500,
        resample_share: 0.5,
        roughening: 0.2,
        bend_sigmas: 0.5,
        yaw_limit_rad: 20.0 * DEGREE,
        kurtosis_limit: 1.5,
        consensus: None,
        jump: Some(jump_rule()),
        bias_sigma: [0.0; 3],
        gyro_bias_walk: 0.0,
        landing_sigma: [0.0; 2],
        first_landmark: [0.0; 3],
        packet: packet(ExchangeSize::B32),
    }
}

/// `landmark-paper` with few particles.
pub fn paper_options(particles: usize) -> PaperOptions {
    PaperOptions {
        particles,
        acoustics: acoustics(),
        gate: Gate::Joint,
        sigma_velocity: [0.00084, 0.038],
        speed_bounds_mps: [0.05, 0.5],
        sigma_yaw_rate_radps: SIGMA_TURN,
        monitor: Some(MonitorRule { ratio: 0.6, trials: 2, reading: RatioReading::Log }),
        replace_share: 0.5,
        first_landmark: [0.0; 3],
        packet: packet(ExchangeSize::B32),
    }
}

/// Both navigators of vehicle `own`, by name.
pub fn navigators(own: VehicleId, vehicles: usize) -> Vec<(&'static str, Box<dyn Navigator>)> {
    let mut biased = robust_options();
    biased.bias_sigma = [0.01 * DEGREE, 0.01, 0.5 * DEGREE];
    vec![
        ("landmark", Box::new(Landmark::new(own, vehicles, robust_options(), 7).unwrap())),
        (
            "landmark averaged over biases",
            Box::new(BiasModelAverage::new(own, vehicles, biased, 7, 0.5).unwrap()),
        ),
        ("landmark with biases", Box::new(Landmark::new(own, vehicles, biased, 7).unwrap())),
        ("landmark-paper", Box::new(LandmarkPaper::new(own, vehicles, paper_options(300), 7).unwrap())),
    ]
}

pub fn event(t_ns: i64, vehicle: VehicleId, payload: Payload) -> Event {
    Event { t_ns, vehicle, payload }
}

/// Where vehicles truly are, and noise by the draw.
pub struct Seafloor {
    pub t_ns: i64,
    /// Poses by vehicle.
    pub truth: Vec<[f64; 3]>,
    noise: Vec<f64>,
    drawn: usize,
}

impl Seafloor {
    /// The landmark (vehicle 0) at the origin, the others 10 m off it, with a prior of 1 m and 5°.
    pub fn new(vehicles: usize, seed: u64) -> Self {
        let (mut a, mut b) = (vec![0.0; 60_000], vec![0.0; 60_000]);
        Streams::new(seed, 99).at(Purpose::Process, 0).normal_pairs(0, &mut a, &mut b);
        a.extend(b);
        let at = |v: usize| match v {
            0 => [0.0; 3],
            _ => [3.0 * (v as f64 - 1.0), -10.0, 0.3],
        };
        Self { t_ns: 0, truth: (0..vehicles).map(at).collect(), noise: a, drawn: 0 }
    }

    pub fn normal(&mut self) -> f64 {
        self.drawn += 1;
        self.noise[self.drawn % self.noise.len()]
    }

    /// Fix, heading and roles at the start.
    pub fn start(&mut self, team: &mut [Box<dyn Navigator>]) {
        for (v, navigator) in team.iter_mut().enumerate() {
            let id = v as VehicleId;
            let (sigma_m, sigma_rad) = if v == 0 { (1e-3, 1e-4) } else { (1.0, 5.0 * DEGREE) };
            let truth = self.truth[v];
            let fix = Payload::Fix {
                position_m: [truth[0] + sigma_m * self.normal(), truth[1] + sigma_m * self.normal()],
                covariance_m2: [sigma_m * sigma_m, 0.0, sigma_m * sigma_m],
            };
            let heading = Payload::Heading { yaw_rad: truth[2] + sigma_rad * self.normal(), sigma_rad };
            for payload in [fix, heading] {
                navigator.handle(&event(0, id, payload)).unwrap();
            }
            if v == 0 {
                navigator.handle(&event(0, id, Payload::Landed)).unwrap();
            }
            navigator.handle(&event(0, id, Payload::RoleTaken { landmark: v == 0 })).unwrap();
        }
    }

    /// One step of 0.2 s of vehicle `v` at a yaw rate, moving or not; its sensors speak before it.
    fn step(&mut self, v: usize, yaw_rate: f64, speed: f64, navigator: &mut dyn Navigator) {
        let sigma_mps = 0.00084 + 0.038 * speed.clamp(0.05, 0.5).sqrt();
        let dt_s = 0.2;
        let velocity_mps = [speed + sigma_mps * self.normal(), sigma_mps * self.normal()];
        let turn = Payload::TurnRate {
            yaw_rate_radps: yaw_rate + SIGMA_TURN * self.normal(),
            sigma_radps: SIGMA_TURN,
        };
        let id = v as VehicleId;
        navigator.handle(&event(self.t_ns, id, Payload::GroundVelocity { velocity_mps, sigma_mps })).unwrap();
        navigator.handle(&event(self.t_ns, id, turn)).unwrap();
        let pose = &mut self.truth[v];
        pose[0] += speed * pose[2].cos() * dt_s;
        pose[1] += speed * pose[2].sin() * dt_s;
        pose[2] = wrap(pose[2] + yaw_rate * dt_s);
    }

    /// A positioning of `v` with `landmark` at the present time.
    pub fn positioning(&mut self, v: usize, landmark: usize) -> Payload {
        let (own, other) = (self.truth[v], self.truth[landmark]);
        let (dx, dy) = (other[0] - own[0], other[1] - own[1]);
        Payload::AcousticFix {
            peer: landmark as VehicleId,
            transmit_ns: self.t_ns,
            range_m: Some((dx.hypot(dy) + SIGMA[0] * self.normal()).max(0.1)),
            own_bearing_rad: Some(wrap(dy.atan2(dx) - own[2] + SIGMA[1] * self.normal())),
            peer_bearing_rad: Some(wrap((-dy).atan2(-dx) - other[2] + SIGMA[2] * self.normal())),
            peer_depth_m: None,
        }
    }

    /// `seconds` of the movers' way with a positioning every 10 s; the landmark listens to its gyro at rest.
    pub fn go(
        &mut self,
        seconds: i64,
        landmark: usize,
        speed: f64,
        team: &mut [Box<dyn Navigator>],
        positions: bool,
    ) {
        for step in 0..seconds * 5 {
            for (v, navigator) in team.iter_mut().enumerate() {
                let moving = v != landmark;
                let yaw_rate = if moving && speed > 0.0 { 0.02 * (0.03 * step as f64).sin() } else { 0.0 };
                let speed = if moving { speed } else { 0.0 };
                self.step(v, yaw_rate, speed, navigator.as_mut());
            }
            self.t_ns += STEP;
            if positions && (step + 1) % 50 == 0 {
                for v in (0..team.len()).filter(|v| *v != landmark) {
                    let payload = self.positioning(v, landmark);
                    team[v].handle(&event(self.t_ns, v as VehicleId, payload)).unwrap();
                }
            }
        }
    }

    /// The usual leg.
    pub fn leg(&mut self, seconds: i64, landmark: usize, team: &mut [Box<dyn Navigator>]) {
        self.go(seconds, landmark, SPEED, team, true);
    }

    /// `mover` lands, takes six positionings, and hands over to all others; `lose` says to whom the packet is lost.
    pub fn exchange(
        &mut self,
        mover: usize,
        landmark: usize,
        team: &mut [Box<dyn Navigator>],
        lose: &[usize],
    ) -> Arc<[u8]> {
        let at = |payload, v: usize, t_ns| event(t_ns, v as VehicleId, payload);
        team[mover].handle(&at(Payload::Landed, mover, self.t_ns)).unwrap();
        // Followers hover on the spot meanwhile, which their DVLs and gyros say every second.
        let followers: Vec<usize> = (0..team.len()).filter(|v| *v != landmark && *v != mover).collect();
        let hover = |t_ns: i64, team: &mut [Box<dyn Navigator>]| {
            for v in &followers {
                for payload in [
                    Payload::GroundVelocity { velocity_mps: [0.0; 2], sigma_mps: 0.0 },
                    Payload::TurnRate { yaw_rate_radps: 0.0, sigma_radps: 0.0 },
                ] {
                    team[*v].handle(&at(payload, *v, t_ns)).unwrap();
                }
            }
        };
        hover(self.t_ns, team);
        for _ in 0..6 {
            for _ in 0..10 {
                self.t_ns += SECOND;
                hover(self.t_ns, team);
            }
            for v in (0..team.len()).filter(|v| *v != landmark) {
                let payload = self.positioning(v, landmark);
                team[v].handle(&at(payload, v, self.t_ns)).unwrap();
            }
        }
        self.t_ns += SECOND;
        let tol_ns = self.t_ns;
        let bytes = team[mover].transmit(tol_ns, 128).unwrap().expect("a landed mover has something to say");
        for _ in 0..3 {
            self.t_ns += SECOND;
            hover(self.t_ns, team);
        }
        for v in (0..team.len()).filter(|v| *v != mover && !lose.contains(v)) {
            let payload = Payload::Reception {
                sender: mover as VehicleId,
                tol_ns,
                toa_ns: tol_ns + SECOND / 100,
                bytes: bytes.clone(),
            };
            team[v].handle(&at(payload, v, self.t_ns)).unwrap();
        }
        team[mover].handle(&at(Payload::RoleTaken { landmark: true }, mover, self.t_ns)).unwrap();
        team[landmark].handle(&at(Payload::RoleTaken { landmark: false }, landmark, self.t_ns)).unwrap();
        team[landmark].handle(&at(Payload::LiftedOff, landmark, self.t_ns)).unwrap();
        bytes
    }

    /// (position error m, yaw error rad, NEES of the pose) of `v`.
    pub fn error(&self, v: usize, navigator: &dyn Navigator) -> (f64, f64, f64) {
        let estimate = navigator.estimate(self.t_ns);
        let (yaw, [ye, yn, yy]) = estimate.yaw.expect("landmark navigators estimate yaw");
        let [ee, en, nn] = estimate.covariance_m2;
        let p = nalgebra::Matrix3::new(ee, en, ye, en, nn, yn, ye, yn, yy);
        let truth = self.truth[v];
        let d = nalgebra::Vector3::new(
            estimate.mean_m[0] - truth[0],
            estimate.mean_m[1] - truth[1],
            wrap(yaw - truth[2]),
        );
        let nees = d.dot(&(p.try_inverse().expect("a covariance") * d));
        (d.x.hypot(d.y), d.z.abs(), nees)
    }
}
