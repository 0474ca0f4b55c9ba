//! The alternating landmark's costs: a whole mission of the paper's filter, and its cloud clustered into a packet.
#![allow(missing_docs, reason = "criterion's macros write an undocumented main")]

use std::f64::consts::PI;
use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use uwcoop_core::error::Error;
use uwcoop_core::event::{Event, Payload};
use uwcoop_core::measurement::angle::wrap;
use uwcoop_core::mixture::{Criterion as Choose, FitOptions};
use uwcoop_core::navigator::Navigator;
use uwcoop_core::navigator::landmark::model::{Acoustics, Gate, MonitorRule, RatioReading};
use uwcoop_core::navigator::landmark::{LandmarkPaper, PacketOptions, PaperOptions};
use uwcoop_core::packet::landmark::{ExchangeFormat, ExchangeSize};

const SECOND: i64 = 1_000_000_000;
const DEGREE: f64 = PI / 180.0;
/// The mission of the bar: 1070 s at 5 Hz with a positioning every 10 s.
const MISSION_S: i64 = 1070;

/// The paper's constants, as packaged.
fn options(particles: usize, size: ExchangeSize) -> PaperOptions {
    PaperOptions {
        particles,
        acoustics: Acoustics { sigma: [0.66, 6.0 * DEGREE, DEGREE], threshold: [3.0; 3] },
        gate: Gate::Joint,
        sigma_velocity: [0.00084, 0.038],
        speed_bounds_mps: [0.05, 0.5],
        sigma_yaw_rate_radps: 0.0745 * DEGREE,
        monitor: Some(MonitorRule { ratio: 0.6, trials: 2, reading: RatioReading::Log }),
        replace_share: 0.5,
        first_landmark: [0.0; 3],
        packet: PacketOptions {
            format: ExchangeFormat::Two,
            size,
            criterion: Choose::Bic,
            fit: FitOptions { starts: 3, iterations: 60, tolerance: 1e-5, ridge_one: 1e-9, ridge_many: 1e-3 },
            search_points: 1000,
        },
    }
}

/// A mover that circles the landmark at 0.15 m/s, and what its sensors say without noise.
fn events(seconds: i64) -> Vec<Event> {
    let at = |t_ns, payload| Event { t_ns, vehicle: 1, payload };
    let (radius, rate) = (12.0, 0.15 / 12.0);
    let pose = |t: f64| [radius * (rate * t).cos(), radius * (rate * t).sin(), wrap(rate * t + PI / 2.0)];
    let start = pose(0.0);
    let mut all = vec![
        at(0, Payload::Fix { position_m: [start[0], start[1]], covariance_m2: [1.0, 0.0, 1.0] }),
        at(0, Payload::Heading { yaw_rad: start[2], sigma_rad: 5.0 * DEGREE }),
    ];
    for step in 0..seconds * 5 {
        let t_ns = step * SECOND / 5;
        all.push(at(t_ns, Payload::GroundVelocity { velocity_mps: [0.15, 0.0], sigma_mps: 0.0156 }));
        all.push(at(t_ns, Payload::TurnRate { yaw_rate_radps: rate, sigma_radps: 0.0013 }));
        if step % 50 == 49 {
            let t = (t_ns + SECOND / 5) as f64 * 1e-9;
            let [x, y, yaw] = pose(t);
            all.push(at(
                t_ns + SECOND / 5,
                Payload::AcousticFix {
                    peer: 0,
                    transmit_ns: t_ns - SECOND / 2,
                    range_m: Some(radius),
                    own_bearing_rad: Some(wrap((-y).atan2(-x) - yaw)),
                    peer_bearing_rad: Some(wrap(pose(t - 0.7)[1].atan2(pose(t - 0.7)[0]))),
                    peer_depth_m: None,
                },
            ));
        }
    }
    all
}

fn fly(particles: usize, size: ExchangeSize, events: &[Event]) -> Result<LandmarkPaper, Error> {
    let mut navigator = LandmarkPaper::new(1, 2, options(particles, size), 3)?;
    for event in events {
        navigator.handle(event)?;
    }
    Ok(navigator)
}

fn missions(c: &mut Criterion) {
    let events = events(MISSION_S);
    let mut group = c.benchmark_group("landmark-paper/mission-1070s");
    group.sample_size(10);
    for particles in [300, 3000] {
        group.bench_function(BenchmarkId::from_parameter(particles), |b| {
            b.iter(|| black_box(fly(particles, ExchangeSize::B32, &events)).is_ok());
        });
    }
    group.finish();
}

fn compression(c: &mut Criterion) {
    let mut group = c.benchmark_group("landmark-paper/compress-10000");
    group.sample_size(10);
    // A cloud that two positionings have shaped, and one that has seen none: the wide one needs more modes.
    for (cloud, seconds) in [("settled", 30), ("wide", 5)] {
        let events = events(seconds);
        for (bytes, size) in [(32, ExchangeSize::B32), (128, ExchangeSize::B128)] {
            let flown = fly(10_000, size, &events).and_then(|mut n| {
                let t_ns = seconds * SECOND;
                let acoustic = Payload::AcousticFix {
                    peer: 0,
                    transmit_ns: t_ns,
                    range_m: None,
                    own_bearing_rad: None,
                    peer_bearing_rad: None,
                    peer_depth_m: None,
                };
                n.handle(&Event { t_ns, vehicle: 1, payload: acoustic })?;
                n.handle(&Event { t_ns, vehicle: 1, payload: Payload::Landed })?;
                Ok(n)
            });
            let Ok(mut navigator) = flown else { continue };
            let mut tol_ns = seconds * SECOND;
            group.bench_function(BenchmarkId::new(cloud, bytes), |b| {
                b.iter(|| {
                    tol_ns += SECOND;
                    black_box(navigator.transmit(tol_ns, 128)).is_ok()
                });
            });
        }
    }
    group.finish();
}

criterion_group!(benches, missions, compression);
criterion_main!(benches);
