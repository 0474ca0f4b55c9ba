//! What a method says of itself reaches the record: a column for each name, NaN before it is said.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

mod world;

use std::sync::Arc;

use uwcoop_core::error::Error;
use uwcoop_core::event::{Event, Payload, VehicleId};
use uwcoop_core::link::LinkConfig;
use uwcoop_core::navigator::{CentralEstimator, Estimate, Kinds, Navigator, Outcome, Profile, Status};
use uwcoop_core::replay::{Estimators, Mission, Replay};
use world::*;

/// Counts what it is handed; says so from the second event on.
#[derive(Default)]
struct Counter {
    handled: [u32; 2],
}

impl Counter {
    fn said(&self, vehicle: usize) -> Vec<(&'static str, f64)> {
        match self.handled[vehicle] {
            0 | 1 => Vec::new(),
            n => vec![("events_handled", f64::from(n)), ("half_m", f64::from(n) / 2.0)],
        }
    }
}

fn nowhere(t_ns: i64) -> Estimate {
    let (mean_m, covariance_m2) = ([0.0; 2], [1.0, 0.0, 1.0]);
    Estimate { t_ns, mean_m, covariance_m2, yaw: None, ess: None, rejected: 0, status: Status::Navigating }
}

impl Navigator for Counter {
    fn handle(&mut self, _: &Event) -> Result<Outcome, Error> {
        self.handled[0] += 1;
        Ok(Outcome::Noted)
    }
    fn transmit(&mut self, _: i64, _: usize) -> Result<Option<Arc<[u8]>>, Error> {
        Ok(None)
    }
    fn estimate(&self, t_ns: i64) -> Estimate {
        nowhere(t_ns)
    }
    fn snapshot(&self) -> Result<Vec<u8>, Error> {
        Ok(vec![u8::try_from(self.handled[0]).unwrap()])
    }
    fn restore(&mut self, snapshot: &[u8]) -> Result<(), Error> {
        self.handled[0] = u32::from(snapshot[0]);
        Ok(())
    }
    fn profile(&self) -> Profile {
        Profile { takes_ranges: true, has_checksum: false, needs_delivery_oracle: false, uses: Kinds::all() }
    }
    fn diagnostics(&self) -> Vec<(&'static str, f64)> {
        self.said(0)
    }
}

impl CentralEstimator for Counter {
    fn handle(&mut self, vehicle: VehicleId, _: &Event) -> Result<Outcome, Error> {
        self.handled[usize::from(vehicle)] += 1;
        Ok(Outcome::Noted)
    }
    fn estimate(&self, _: VehicleId, t_ns: i64) -> Estimate {
        nowhere(t_ns)
    }
    fn launch(&mut self, _: VehicleId, _: i64) -> Result<bool, Error> {
        Ok(true)
    }
    fn assumed_packet_bytes(&self) -> usize {
        0
    }
    fn profile(&self) -> Profile {
        Profile { takes_ranges: true, has_checksum: false, needs_delivery_oracle: false, uses: Kinds::all() }
    }
    fn diagnostics(&self, vehicle: VehicleId) -> Vec<(&'static str, f64)> {
        self.said(usize::from(vehicle))
    }
    fn snapshot(&self) -> Result<Vec<u8>, Error> {
        Ok(Vec::new())
    }
    fn restore(&mut self, _: &[u8]) -> Result<(), Error> {
        Ok(())
    }
}

fn depth_at(second: i64, vehicle: VehicleId) -> Event {
    event(second * SECOND, vehicle, Payload::Depth { depth_m: 1.0, sigma_m: 0.1 })
}

/// Vehicle 0 has events at 1, 2, 3 s, vehicle 1 at 2 s.
fn mission() -> Arc<Mission> {
    let link = LinkConfig::new(32, 1, 1.0, 0.0, 1500.0).unwrap();
    let events = vec![depth_at(1, 0), depth_at(2, 0), depth_at(2, 1), depth_at(3, 0)];
    Arc::new(Mission::new(2, link, events, Vec::new(), Vec::new(), 4 * SECOND).unwrap())
}

fn samples() -> Arc<[i64]> {
    (0..4).map(|s| s * SECOND).collect()
}

const EXPECTED: [f64; 8] = [f64::NAN, f64::NAN, 2.0, 3.0, f64::NAN, f64::NAN, f64::NAN, f64::NAN];

fn same(found: &[f64], expected: &[f64]) -> bool {
    found.len() == expected.len()
        && found.iter().zip(expected).all(|(a, b)| a == b || (a.is_nan() && b.is_nan()))
}

#[test]
fn every_name_becomes_a_column_of_vehicles_by_samples() {
    let each = Estimators::Each(vec![Box::new(Counter::default()), Box::new(Counter::default())]);
    let central = Estimators::Central(Box::new(Counter::default()));
    for team in [each, central] {
        let mut replay = Replay::new(mission(), team, samples(), 0).unwrap();
        replay.run().unwrap();
        let tracks = replay.into_tracks();
        let names: Vec<_> = tracks.diagnostics.keys().map(String::as_str).collect();
        assert_eq!(names, ["events_handled", "half_m"]);
        assert!(same(&tracks.diagnostics["events_handled"], &EXPECTED));
        assert!(same(&tracks.diagnostics["half_m"], &EXPECTED.map(|n| n / 2.0)));
    }
}

#[test]
fn they_survive_a_snapshot_of_the_replay() {
    let team = || Estimators::Each(vec![Box::<Counter>::default(), Box::<Counter>::default()]);
    let mut first = Replay::new(mission(), team(), samples(), 0).unwrap();
    first.run_until(5 * SECOND / 2).unwrap();
    let mut second = Replay::new(mission(), team(), samples(), 0).unwrap();
    second.restore(&first.snapshot().unwrap()).unwrap();
    second.run().unwrap();
    assert!(same(&second.into_tracks().diagnostics["events_handled"], &EXPECTED));
}
