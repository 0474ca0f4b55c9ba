//! Every navigator that there is, each with its packaged sets of options, in a mission that all of them can fly.
#![allow(dead_code, reason = "each test binary uses a part of it")]

use std::sync::Arc;

use uwcoop_core::chart::Chart;
use uwcoop_core::event::{BOUNDS, Bound, Event, Kind, Payload, VehicleId};
use uwcoop_core::information::replica::Methods;
use uwcoop_core::navigator::dead_reckoning::DeadReckoning;
use uwcoop_core::navigator::landmark::{BiasModelAverage, Landmark, LandmarkPaper};
use uwcoop_core::navigator::origin::belief::{BeliefNavigator, BeliefOptions, Correlation};
use uwcoop_core::navigator::origin::deif::{Deif, Repair};
use uwcoop_core::navigator::origin::interleaved::{Interleaved, InterleavedOptions};
use uwcoop_core::navigator::origin::lasting::LastingOptions;
use uwcoop_core::navigator::origin::local_options::LocalOptions;
use uwcoop_core::navigator::origin::mdeif::{Mdeif, MdeifOptions};
use uwcoop_core::navigator::team::TeamOptions;
use uwcoop_core::navigator::{Navigator, Outcome};
use uwcoop_core::packet::PacketKind;
use uwcoop_core::packet::graph::GraphForm;

use crate::seafloor;
use crate::world::fleet::{team_of, team_options};
use crate::world::*;

/// Vehicles of the mission: the first stands, the second moves.
pub const TEAM: usize = 2;
pub const CAPACITY: usize = 1 << 16;

/// A navigator by name.
pub struct Entry {
    pub name: &'static str,
    /// Whose navigator the tests look at: one that the other's packets reach.
    pub own: VehicleId,
    make: Box<dyn Fn(VehicleId) -> Box<dyn Navigator>>,
}

impl Entry {
    pub fn make(&self, own: VehicleId) -> Box<dyn Navigator> {
        (self.make)(own)
    }

    pub fn subject(&self) -> Box<dyn Navigator> {
        self.make(self.own)
    }

    pub fn other(&self) -> VehicleId {
        1 - self.own
    }
}

const LOCAL: LocalOptions = LocalOptions {
    process_noise_m2_per_s3: 1e-4,
    process_noise_dvl_m2_per_s3: 1e-2,
    sigma_velocity0_mps: 1.0,
    sigma_odometry_scale: 1e-3,
    sigma_gyro_bias_radps: 0.0,
    sigma_range_m: 1.0,
    gate_sigmas: 6.0,
    clock: uwcoop_core::navigator::clock::ClockOptions::NONE,
};

fn entry<N: Navigator + 'static>(
    name: &'static str,
    own: VehicleId,
    make: impl Fn(VehicleId) -> N + 'static,
) -> Entry {
    Entry { name, own, make: Box::new(move |vehicle| Box::new(make(vehicle))) }
}

fn terrain(chart: &Arc<Chart>) -> Vec<Entry> {
    let dmpf_entry = |name, change: fn(&mut uwcoop_core::navigator::dmpf::DmpfOptions)| {
        let chart = chart.clone();
        entry(name, 1, move |own| {
            let mut options = dmpf_options(60);
            change(&mut options);
            dmpf(own, TEAM, options, &chart, 5)
        })
    };
    let mpf_entry = |name, change: fn(&mut uwcoop_core::navigator::mpf::MpfOptions)| {
        let chart = chart.clone();
        entry(name, 1, move |own| {
            let mut options = mpf_options(60);
            change(&mut options);
            mpf::<2>(own, TEAM, options, &chart, 5)
        })
    };
    let team_entry = |name, change: fn(&mut TeamOptions)| {
        let chart = chart.clone();
        entry(name, 1, move |own| {
            let mut options = team_options(TEAM, 60);
            change(&mut options);
            team_of(own, options, Some(chart.clone()))
        })
    };
    let four = chart.clone();
    vec![
        dmpf_entry("dmpf", |_| ()),
        dmpf_entry("dmpf-unlimited", |o| o.packet = PacketKind::Cloud),
        dmpf_entry("dmpf in modes", |o| o.packet = PacketKind::Mixture),
        dmpf_entry("terrain-only", |o| o.range = None),
        dmpf_entry("ranging-only", |o| o.terrain = false),
        mpf_entry("mpf", |_| ()),
        mpf_entry("mpf-terrain-only", |o| o.range = None),
        mpf_entry("mpf, news of ranges", |o| o.range_novelty = true),
        entry("mpf with biases", 1, move |own| mpf::<4>(own, TEAM, mpf_options(60), &four, 5)),
        team_entry("team", |_| ()),
        team_entry("team, one current", |o| o.current_difference = 0.3),
        team_entry("team in f64", |o| o.packet_f64 = true),
        team_entry("team, ranges unused", |o| o.use_ranges = false),
    ]
}

fn graphs() -> Vec<Entry> {
    let mdeif = |name, form| {
        entry(name, 1, move |own| {
            let methods = Methods { joint: true, lags: 6, equation_6: true, loss_max: 1e-4 };
            let options =
                MdeifOptions { local: LOCAL, lasting: LastingOptions::NONE, form, exact_lags: 2, methods };
            Mdeif::new(own, &[form != GraphForm::Frame32, true], options, SOUND_SPEED_MPS).unwrap()
        })
    };
    let deif = |name, repair| {
        entry(name, 1, move |own| Deif::new(own, &[false, true], LOCAL, repair, SOUND_SPEED_MPS).unwrap())
    };
    let belief = |name, correlation, ranging| {
        entry(name, 1, move |own| {
            let options = BeliefOptions {
                local: LOCAL,
                correlation,
                process_noise_factor: 1.0,
                ranging,
                talking: ranging,
                packet: PacketKind::BeliefF64,
            };
            BeliefNavigator::new(own, TEAM, options, SOUND_SPEED_MPS).unwrap()
        })
    };
    vec![
        mdeif("mdeif in f64", GraphForm::F64),
        mdeif("mdeif in 32 bytes", GraphForm::Frame32),
        mdeif("mdeif in 64 bytes", GraphForm::Frame64),
        mdeif("mdeif in 256 bytes", GraphForm::Frame256),
        deif("deif", Repair::Oracle),
        deif("deif-redundant", Repair::Repeat(3)),
        belief("nekf", Correlation::Ignored, true),
        belief("covariance-intersection", Correlation::Unknown, true),
        belief("local-only", Correlation::Ignored, false),
        entry("interleaved", 1, |own| {
            let options = InterleavedOptions { local: LOCAL, ranging: true };
            Interleaved::new(own, TEAM, options, SOUND_SPEED_MPS).unwrap()
        }),
    ]
}

fn landmarks() -> Vec<Entry> {
    let mut robust = seafloor::robust_options();
    // Where vehicle 0 stands, facing east.
    robust.first_landmark = [STANDS_M[0], STANDS_M[1], 0.0];
    let mut paper = seafloor::paper_options(100);
    paper.first_landmark = robust.first_landmark;
    let mut biased = robust;
    biased.bias_sigma = [1e-4, 0.01, 0.01];
    let mut alone = robust;
    alone.use_fixes = false;
    vec![
        entry("landmark", 0, move |own| Landmark::new(own, TEAM, robust, 7).unwrap()),
        entry("landmark, positionings unused", 0, move |own| Landmark::new(own, TEAM, alone, 7).unwrap()),
        entry("landmark with biases", 0, move |own| Landmark::new(own, TEAM, biased, 7).unwrap()),
        entry("landmark averaged over biases", 0, move |own| {
            BiasModelAverage::new(own, TEAM, biased, 7, 0.5).unwrap()
        }),
        entry("landmark-paper", 0, move |own| LandmarkPaper::new(own, TEAM, paper, 7).unwrap()),
    ]
}

/// All of them.
pub fn registry() -> Vec<Entry> {
    let chart = rich();
    let mut all = vec![entry("dead-reckoning", 1, |own| DeadReckoning::new(own, TEAM, drift()).unwrap())];
    all.extend(terrain(&chart));
    all.extend(graphs());
    all.extend(landmarks());
    all
}

/// Where vehicle 0 stands, m.
const STANDS_M: [f64; 2] = [200.0, 200.0];
/// When vehicle 1 lands, s.
const LANDS_S: i64 = 30;
/// End of the mission, s.
pub const END_S: i64 = 48;

/// Where a vehicle is.
pub fn place(vehicle: VehicleId, t_ns: i64) -> [f64; 2] {
    let t = (t_ns as f64 / SECOND as f64).min(LANDS_S as f64);
    if vehicle == 0 { STANDS_M } else { [120.0 + 1.2 * t, 150.0 + 0.9 * t] }
}

/// What the sensors of one vehicle say in one second, of every kind.
fn sensed(vehicle: VehicleId, second: i64) -> Vec<Event> {
    let t_ns = second * SECOND;
    let here = place(vehicle, t_ns);
    let moves = vehicle == 1 && second < LANDS_S;
    let yaw_rad = if vehicle == 1 { 0.9f64.atan2(1.2) } else { 0.0 };
    let (speed, velocity) = if moves { (1.5, [1.2, 0.9]) } else { (0.0, [0.0; 2]) };
    let mut payloads = vec![
        Payload::Depth { depth_m: 3.0, sigma_m: 0.05 },
        Payload::Heading { yaw_rad, sigma_rad: 0.03 },
        Payload::TurnRate { yaw_rate_radps: 0.0, sigma_radps: 1e-3 },
        Payload::Motion { velocity_mps: velocity },
        Payload::WaterDepth { water_depth_m: rich_depth(here[0], here[1]), sigma_m: 0.05 },
    ];
    // A vehicle that knows fixes alone has x and y alike, as the shortest packet of `mdeif` asks for.
    if vehicle == 1 {
        payloads.push(Payload::GroundVelocity { velocity_mps: [speed, 0.0], sigma_mps: 0.05 });
    }
    if second % 10 == 0 && (vehicle == 0 || second == 0) {
        let variance_m2 = if vehicle == 0 { 1.0 } else { 25.0 };
        payloads.insert(0, Payload::Fix { position_m: here, covariance_m2: [variance_m2, 0.0, variance_m2] });
    }
    if second == 0 {
        payloads.push(Payload::RoleTaken { landmark: vehicle == 0 });
    }
    if (vehicle == 0 && second == 0) || (vehicle == 1 && second == LANDS_S) {
        payloads.push(Payload::Landed);
    }
    if vehicle == 1 && moves && second % 5 == 4 {
        let (de, dn) = (STANDS_M[0] - here[0], STANDS_M[1] - here[1]);
        payloads.push(Payload::AcousticFix {
            peer: 0,
            transmit_ns: t_ns - SECOND / 10,
            range_m: Some(de.hypot(dn)),
            own_bearing_rad: Some(dn.atan2(de) - yaw_rad),
            peer_bearing_rad: Some((-dn).atan2(-de)),
            peer_depth_m: None,
        });
    }
    payloads.into_iter().map(|payload| event(t_ns, vehicle, payload)).collect()
}

/// One thing that one vehicle's navigator is handed.
#[derive(Debug, Clone)]
pub enum Step {
    Event(Event),
    Transmit(i64),
}

/// Hands a step over; the packet, if it is one.
pub fn take(navigator: &mut dyn Navigator, step: &Step) -> Option<Arc<[u8]>> {
    match step {
        Step::Event(event) => {
            navigator.handle(event).unwrap();
            None
        }
        Step::Transmit(tol_ns) => navigator.transmit(*tol_ns, CAPACITY).unwrap(),
    }
}

/// A packet that reached the subject.
#[derive(Debug, Clone)]
pub struct Heard {
    /// Its reception.
    pub event: Event,
    pub outcome: Outcome,
}

/// The subject's half of the mission: its steps, and what it heard.
pub struct Flown {
    pub steps: Vec<Step>,
    pub heard: Vec<Heard>,
}

/// Both vehicles fly the mission; slots take turns every three seconds.
pub fn fly(entry: &Entry) -> Flown {
    let mut pair = [entry.make(0), entry.make(1)];
    let (mut steps, mut heard) = (Vec::new(), Vec::new());
    for second in 0..=END_S {
        for vehicle in 0..TEAM as VehicleId {
            for event in sensed(vehicle, second) {
                pair[usize::from(vehicle)].handle(&event).unwrap();
                if vehicle == entry.own {
                    steps.push(Step::Event(event));
                }
            }
        }
        if second % 3 != 2 {
            continue;
        }
        let sender = (second / 3 % 2) as VehicleId;
        let receiver = 1 - sender;
        let tol_ns = second * SECOND + SECOND / 10;
        let packet = pair[usize::from(sender)].transmit(tol_ns, CAPACITY).unwrap();
        if sender == entry.own {
            steps.push(Step::Transmit(tol_ns));
        }
        let Some(bytes) = packet else { continue };
        let range_m = distance(place(0, tol_ns), place(1, tol_ns));
        let event = reception(tol_ns + SECOND / 2, receiver, sender, tol_ns, range_m, &bytes);
        let outcome = pair[usize::from(receiver)].handle(&event).unwrap();
        if receiver == entry.own {
            steps.push(Step::Event(event.clone()));
            heard.push(Heard { event, outcome });
        } else if pair[usize::from(sender)].profile().needs_delivery_oracle {
            let delivered =
                self::event(tol_ns + SECOND / 2, sender, Payload::Delivered { tol_ns, to: receiver });
            pair[usize::from(sender)].handle(&delivered).unwrap();
        }
    }
    Flown { steps, heard }
}

/// Time of a step.
pub fn time_of(step: &Step) -> i64 {
    match step {
        Step::Event(event) => event.t_ns,
        Step::Transmit(tol_ns) => *tol_ns,
    }
}

/// The numbers that an event of a kind has.
pub fn bounds_of(kind: Kind) -> Vec<&'static Bound> {
    BOUNDS.iter().filter(|bound| bound.kind == kind).collect()
}

/// Kinds whose events hold numbers of the table.
pub fn kinds_with_numbers() -> Vec<Kind> {
    let mut kinds: Vec<Kind> = BOUNDS.iter().map(|bound| bound.kind).collect();
    kinds.dedup();
    kinds
}

/// An event of a kind with these numbers, in the order of the table.
pub fn payload_of(kind: Kind, numbers: &[f64], peer: VehicleId, transmit_ns: i64) -> Payload {
    match (kind, numbers) {
        (Kind::Motion, &[e, n]) => Payload::Motion { velocity_mps: [e, n] },
        (Kind::Odometry, &[f, l, yaw_change_rad, ff, fl, fy, ll, ly, yy]) => {
            Payload::Odometry { displacement_m: [f, l], yaw_change_rad, covariance: [ff, fl, fy, ll, ly, yy] }
        }
        (Kind::WaterDepth, &[water_depth_m, sigma_m]) => Payload::WaterDepth { water_depth_m, sigma_m },
        (Kind::Depth, &[depth_m, sigma_m]) => Payload::Depth { depth_m, sigma_m },
        (Kind::Heading, &[yaw_rad, sigma_rad]) => Payload::Heading { yaw_rad, sigma_rad },
        (Kind::TurnRate, &[yaw_rate_radps, sigma_radps]) => Payload::TurnRate { yaw_rate_radps, sigma_radps },
        (Kind::GroundVelocity, &[f, l, sigma_mps]) => {
            Payload::GroundVelocity { velocity_mps: [f, l], sigma_mps }
        }
        (Kind::Fix, &[e, n, ee, en, nn]) => Payload::Fix { position_m: [e, n], covariance_m2: [ee, en, nn] },
        (Kind::AcousticFix, &[range, own, peer_bearing, peer_depth]) => Payload::AcousticFix {
            peer,
            transmit_ns,
            range_m: Some(range),
            own_bearing_rad: Some(own),
            peer_bearing_rad: Some(peer_bearing),
            peer_depth_m: Some(peer_depth),
        },
        (Kind::WaterVelocity, &[f, l, sigma_mps]) => {
            Payload::WaterVelocity { velocity_mps: [f, l], sigma_mps }
        }
        (Kind::BeaconRange, &[e, n, beacon_depth_m, range_m, sigma_m]) => Payload::BeaconRange {
            measured_ns: transmit_ns,
            beacon_m: [e, n],
            beacon_depth_m,
            range_m,
            sigma_m,
            one_way: true,
        },
        (Kind::Usbl, &[e, n, ee, en, nn]) => {
            Payload::Usbl { measured_ns: transmit_ns, position_m: [e, n], covariance_m2: [ee, en, nn] }
        }
        _ => panic!("{kind:?} has other numbers than {numbers:?}"),
    }
}

/// Numbers that every kind of event takes: the middle of what is usual.
pub fn usual(bound: &Bound) -> f64 {
    let covariance = ["cov_en_m2", "cov_fl", "cov_fy", "cov_ly"].contains(&bound.field);
    if covariance { 0.0 } else { 1.0 }
}
