//! What particle navigators do with fixes and ranges that contradict them, before the first fix, and with slots too short.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

mod world;

use uwcoop_core::event::Payload;
use uwcoop_core::navigator::{Estimate, Navigator, Outcome, Status};
use world::*;

const OWN: u16 = 1;
const TEAM: usize = 3;
/// Where `warm_up` ends.
const NOW: i64 = 20 * SECOND;

/// An estimate's bits but for the count.
fn belief_bits(e: &Estimate) -> Vec<u64> {
    let mut bits: Vec<u64> =
        e.mean_m.iter().chain(&e.covariance_m2).chain(e.ess.iter()).map(|x| x.to_bits()).collect();
    bits.push(e.status as u64);
    bits
}

#[test]
fn without_a_fix_nothing_is_claimed() {
    let chart = rich();
    for (name, mut navigator) in navigators(OWN, TEAM, &chart) {
        let vehicle = Vehicle::new(OWN, |t| [120.0 + t, 150.0]);
        for second in 0..5 {
            for event in vehicle.second(second, rich_depth) {
                navigator.handle(&event).unwrap();
            }
        }
        let bytes = packet(0, 3 * SECOND, 0, [150.0, 200.0], 3.0);
        navigator.handle(&reception(5 * SECOND, OWN, 0, 3 * SECOND, 60.0, &bytes)).unwrap();
        let estimate = navigator.estimate(6 * SECOND);
        assert_eq!(estimate.status, Status::NotStarted, "{name}");
        assert!(estimate.mean_m.iter().all(|x| x.is_nan()), "{name}");
        assert_eq!(estimate.covariance_m2, [f64::INFINITY, 0.0, f64::INFINITY], "{name}");
        assert!(navigator.particles().is_none() && navigator.transmit(6 * SECOND, 1000).unwrap().is_none());
        // The first fix starts it, wherever it moved before.
        navigator.handle(&fix(7 * SECOND, OWN, [200.0, 210.0], 1.0)).unwrap();
        let started = navigator.estimate(7 * SECOND);
        assert_eq!(started.status, Status::Navigating, "{name}");
        assert!(distance(started.mean_m, [200.0, 210.0]) < 0.5, "{name} {started:?}");
    }
}

#[test]
fn a_fix_that_contradicts_is_gated_until_it_insists() {
    let chart = rich();
    for (name, mut navigator) in particle_navigators(OWN, TEAM, &chart) {
        warm_up(navigator.as_mut(), OWN);
        let before = navigator.estimate(NOW);
        for k in 1..=2 {
            let outcome = navigator.handle(&fix(NOW, OWN, [300.0, 60.0], 4.0)).unwrap();
            assert_eq!(outcome, Outcome::Gated, "{name}");
            let estimate = navigator.estimate(NOW);
            assert_eq!(estimate.rejected, before.rejected + k, "{name}");
            assert!(distance(estimate.mean_m, before.mean_m) < 1.0, "{name}: a gated fix moved the estimate");
        }
        assert_eq!(navigator.handle(&fix(NOW, OWN, [300.0, 60.0], 4.0)).unwrap(), Outcome::Fused, "{name}");
        assert!(distance(navigator.estimate(NOW).mean_m, [300.0, 60.0]) < 1.0, "{name}");
    }
}

#[test]
fn a_range_that_contradicts_is_gated_and_counted() {
    let chart = rich();
    let tol = NOW - SECOND;
    let bytes = packet(0, tol, 0, [170.0, 200.0], 3.0);
    let mut navigator = mpf::<2>(OWN, TEAM, mpf_options(200), &chart, 5);
    warm_up(&mut navigator, OWN);
    let before = navigator.estimate(NOW);
    // 35 m apart, and 400 m measured.
    assert_eq!(navigator.handle(&reception(NOW, OWN, 0, tol, 400.0, &bytes)).unwrap(), Outcome::Gated);
    let after = navigator.estimate(NOW);
    assert_eq!(after.rejected, before.rejected + 1);
    assert_eq!(belief_bits(&after), belief_bits(&before));
}

#[test]
fn a_packet_longer_than_its_slot_is_refused_and_takes_no_number() {
    let chart = rich();
    for (name, mut navigator) in particle_navigators(OWN, TEAM, &chart) {
        warm_up(navigator.as_mut(), OWN);
        let before = navigator.snapshot().unwrap();
        assert!(navigator.transmit(NOW, 14).is_err(), "{name}");
        assert_eq!(navigator.snapshot().unwrap(), before, "{name}");
        assert_eq!(navigator.transmit(NOW, 15).unwrap().unwrap().len(), 15, "{name}");
        assert_ne!(navigator.snapshot().unwrap(), before, "{name}: the packet's number is taken");
    }
}

#[test]
fn a_snapshot_of_another_size_is_refused_and_changes_nothing() {
    let chart = rich();
    let many: [Box<dyn Navigator>; 3] = [
        Box::new(dmpf(OWN, TEAM, dmpf_options(300), &chart, 5)),
        Box::new(mpf::<2>(OWN, TEAM, mpf_options(300), &chart, 5)),
        Box::new(mpf::<4>(OWN, TEAM, mpf_options(300), &chart, 5)),
    ];
    let larger_team = particle_navigators(OWN, TEAM + 1, &chart);
    let all = particle_navigators(OWN, TEAM, &chart);
    for (((name, mut navigator), other), (_, team)) in all.into_iter().zip(many).zip(larger_team) {
        warm_up(navigator.as_mut(), OWN);
        let before = navigator.snapshot().unwrap();
        let refused = navigator.restore(&other.snapshot().unwrap());
        let message = refused.unwrap_err().to_string();
        assert!(message.contains("300 particles, not 200"), "{name}: {message}");
        let message = navigator.restore(&team.snapshot().unwrap()).unwrap_err().to_string();
        assert!(message.contains("a team of 4"), "{name}: {message}");
        assert_eq!(navigator.snapshot().unwrap(), before, "{name}");
    }
}

/// Variance of the position along east after a range of 60 m from a teammate in the west, 30 m above the own depth.
fn after_a_range_at(own_depth_m: f64) -> f64 {
    let chart = rich();
    let mut navigator = mpf::<2>(OWN, TEAM, mpf_options(2000), &chart, 5);
    navigator.handle(&fix(0, OWN, [200.0, 200.0], 100.0)).unwrap();
    navigator.handle(&event(0, OWN, Payload::Depth { depth_m: own_depth_m, sigma_m: 0.1 })).unwrap();
    let bytes = packet(0, SECOND, 0, [140.0, 200.0], own_depth_m - 30.0);
    let slant_m = 60.0f64.hypot(30.0);
    let outcome = navigator.handle(&reception(2 * SECOND, OWN, 0, SECOND, slant_m, &bytes)).unwrap();
    assert_eq!(outcome, Outcome::Fused, "at {own_depth_m} m");
    navigator.estimate(2 * SECOND).covariance_m2[0]
}

#[test]
fn a_range_from_the_deep_sea_counts_less_as_its_depth_is_rounded() {
    // Steps of 0.1 m, 6.4 m (0.9 m in the range) and 25.6 m (3.7 m).
    let [shallow, deep, deepest] = [40.0, 640.0, 3000.0].map(after_a_range_at);
    assert!(shallow < 40.0, "the range tells something: {shallow} m²");
    assert!(deep > 1.02 * shallow && deepest > 1.5 * deep, "{shallow}, {deep}, {deepest} m²");
}
