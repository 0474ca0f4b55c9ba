//! What every navigator keeps: a refused event changes nothing, a rejected packet only its count, an estimate nothing.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests fail by panicking")]

mod world;

use std::sync::Arc;

use uwcoop_core::event::{Event, Payload};
use uwcoop_core::navigator::{Estimate, Navigator, Outcome, Status};
use world::*;

const OWN: u16 = 1;
const TEAM: usize = 3;
/// Where `warm_up` ends.
const NOW: i64 = 20 * SECOND;

const BAD: [f64; 3] = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY];
const BAD_OR_NEGATIVE: [f64; 4] = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -1e-9];

/// Payloads with one field spoilt at a time.
fn spoilt_sensors() -> Vec<Payload> {
    let mut all = Vec::new();
    for x in BAD {
        all.push(Payload::Motion { velocity_mps: [x, 0.0] });
        all.push(Payload::Motion { velocity_mps: [0.0, x] });
        all.push(Payload::Depth { depth_m: x, sigma_m: 0.1 });
        all.push(Payload::Heading { yaw_rad: x, sigma_rad: 0.1 });
        all.push(Payload::TurnRate { yaw_rate_radps: x, sigma_radps: 0.1 });
        all.push(Payload::GroundVelocity { velocity_mps: [x, 0.0], sigma_mps: 0.1 });
        all.push(Payload::GroundVelocity { velocity_mps: [0.0, x], sigma_mps: 0.1 });
        for field in 0..2 {
            let mut position_m = [1.0, 2.0];
            position_m[field] = x;
            all.push(Payload::Fix { position_m, covariance_m2: [1.0, 0.0, 1.0] });
        }
        for field in 0..3 {
            let mut covariance_m2 = [1.0, 0.0, 1.0];
            covariance_m2[field] = x;
            all.push(Payload::Fix { position_m: [1.0, 2.0], covariance_m2 });
        }
        for field in 0..9 {
            let mut f = [0.1, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 1.0];
            f[field] = x;
            let [e, n, yaw_change_rad, covariance @ ..] = f;
            all.push(Payload::Odometry { displacement_m: [e, n], yaw_change_rad, covariance });
        }
        all.push(acoustic_fix(Some(x), None, None));
        all.push(acoustic_fix(None, Some(x), None));
        all.push(acoustic_fix(None, None, Some(x)));
    }
    for x in BAD_OR_NEGATIVE {
        all.push(Payload::WaterDepth { water_depth_m: x, sigma_m: 0.1 });
        all.push(Payload::WaterDepth { water_depth_m: 10.0, sigma_m: x });
        all.push(Payload::Depth { depth_m: 1.0, sigma_m: x });
        all.push(Payload::Heading { yaw_rad: 0.0, sigma_rad: x });
        all.push(Payload::TurnRate { yaw_rate_radps: 0.0, sigma_radps: x });
        all.push(Payload::GroundVelocity { velocity_mps: [1.0, 0.0], sigma_mps: x });
        all.push(acoustic_fix(Some(x), None, None));
    }
    all.push(acoustic_fix(Some(0.0), None, None));
    for covariance_m2 in [[-1.0, 0.0, 1.0], [1.0, 0.0, -1.0], [1.0, 1.5, 1.0], [0.0, 0.1, 1.0]] {
        all.push(Payload::Fix { position_m: [0.0; 2], covariance_m2 });
    }
    for field in [0, 3, 5] {
        let mut covariance = [1.0, 0.0, 0.0, 1.0, 0.0, 1.0];
        covariance[field] = -1.0;
        all.push(Payload::Odometry { displacement_m: [0.0; 2], yaw_change_rad: 0.0, covariance });
    }
    all
}

fn acoustic_fix(range_m: Option<f64>, own: Option<f64>, peer: Option<f64>) -> Payload {
    Payload::AcousticFix { peer: 0, transmit_ns: NOW, range_m, own_bearing_rad: own, peer_bearing_rad: peer }
}

/// Events that no honest source sends, a second after `now_ns` but for the one from the past.
fn invalid_events(now_ns: i64) -> Vec<Event> {
    let later = now_ns + SECOND;
    let mut all: Vec<Event> = spoilt_sensors().into_iter().map(|p| event(later, OWN, p)).collect();
    let bytes = packet(0, now_ns, 3, [140.0, 160.0], 3.0);
    // It arrived before it was launched.
    all.push(reception(later, OWN, 0, now_ns, -1.0, &bytes));
    all.push(event(later, 0, Payload::Motion { velocity_mps: [1.0, 0.0] }));
    all.push(event(later, 7, Payload::Landed));
    all
}

#[test]
fn an_event_that_no_honest_source_sends_changes_nothing() {
    let chart = rich();
    for warm in [false, true] {
        for (name, mut navigator) in navigators(OWN, TEAM, &chart) {
            let mut events = invalid_events(NOW);
            if warm {
                warm_up(navigator.as_mut(), OWN);
                events.push(event(NOW - 1, OWN, Payload::Motion { velocity_mps: [1.0, 0.0] }));
                events.push(event(i64::MIN, OWN, Payload::Landed));
            }
            assert!(events.len() > 80, "there are events to refuse");
            let before = navigator.snapshot().unwrap();
            for event in &events {
                let refused = navigator.handle(event);
                assert!(refused.is_err(), "{name} took {event:?}: {refused:?}");
                assert_eq!(navigator.snapshot().unwrap(), before, "{name} changed by {event:?}");
            }
        }
    }
}

#[test]
fn a_sender_that_the_team_does_not_have_is_refused() {
    let chart = rich();
    for (name, mut navigator) in navigators(OWN, TEAM, &chart) {
        warm_up(navigator.as_mut(), OWN);
        let before = navigator.snapshot().unwrap();
        for sender in [3, 15, 16, u16::MAX] {
            let bytes = packet(sender, NOW, 0, [140.0, 160.0], 3.0);
            let refused = navigator.handle(&reception(NOW + SECOND, OWN, sender, NOW, 50.0, &bytes));
            assert!(refused.is_err(), "{name} heard vehicle {sender}: {refused:?}");
            assert_eq!(navigator.snapshot().unwrap(), before, "{name}");
        }
    }
}

#[test]
fn nobody_hears_themselves() {
    let chart = rich();
    for (name, mut navigator) in particle_navigators(OWN, TEAM, &chart) {
        warm_up(navigator.as_mut(), OWN);
        let before = navigator.snapshot().unwrap();
        let bytes = packet(OWN, NOW, 0, [140.0, 160.0], 3.0);
        let refused = navigator.handle(&reception(NOW + SECOND, OWN, OWN, NOW, 50.0, &bytes));
        assert!(refused.is_err(), "{name} heard itself: {refused:?}");
        assert_eq!(navigator.snapshot().unwrap(), before, "{name}");
    }
}

/// Receptions at `NOW` that must be rejected once the packet launched at `tol` was accepted.
fn bad_receptions(good: &Arc<[u8]>, tol: i64) -> Vec<Event> {
    let mut all = Vec::new();
    let spoilt = |bytes: Vec<u8>, sender, tol_ns| reception(NOW, OWN, sender, tol_ns, 41.0, &bytes.into());
    // Replayed.
    all.push(spoilt(good.to_vec(), 0, tol));
    // Another slot, another sender.
    all.push(spoilt(good.to_vec(), 0, tol + SECOND));
    all.push(spoilt(good.to_vec(), 2, tol));
    // Cut, lengthened, nothing at all.
    all.push(spoilt(good[..good.len() - 1].to_vec(), 0, tol + SECOND));
    all.push(spoilt([&good[..], &[0]].concat(), 0, tol + SECOND));
    all.push(spoilt(Vec::new(), 0, tol + SECOND));
    // Every single bit of the next, honest, packet.
    let next = packet(0, tol + SECOND, 4, [170.0, 200.0], 3.0);
    for bit in 0..8 * next.len() {
        let mut bytes = next.to_vec();
        bytes[bit / 8] ^= 1 << (bit % 8);
        all.push(spoilt(bytes, 0, tol + SECOND));
    }
    // Launched before all that are remembered, and a slant range far shorter than the depths' difference.
    let old = packet(0, tol - 5 * SECOND, 2, [170.0, 200.0], 3.0);
    all.push(spoilt(old.to_vec(), 0, tol - 5 * SECOND));
    let deep = packet(2, tol + SECOND, 0, [170.0, 200.0], 102.0);
    all.push(reception(NOW, OWN, 2, tol + SECOND, 10.0, &deep));
    all
}

/// An estimate's bits but for the count.
fn belief_bits(e: &Estimate) -> Vec<u64> {
    let mut bits: Vec<u64> =
        e.mean_m.iter().chain(&e.covariance_m2).chain(e.ess.iter()).map(|x| x.to_bits()).collect();
    bits.push(e.status as u64);
    bits
}

#[test]
fn a_packet_that_is_rejected_changes_its_count_and_nothing_else() {
    let chart = rich();
    let tol = NOW - 2 * SECOND;
    let good = packet(0, tol, 3, [170.0, 200.0], 3.0);
    let bad = bad_receptions(&good, tol);
    let twins =
        particle_navigators(OWN, TEAM, &chart).into_iter().zip(particle_navigators(OWN, TEAM, &chart));
    for ((name, mut navigator), (_, mut twin)) in twins {
        for n in [navigator.as_mut(), twin.as_mut()] {
            warm_up(n, OWN);
            assert_eq!(
                n.handle(&reception(NOW, OWN, 0, tol, 41.0, &good)).unwrap(),
                Outcome::Fused,
                "{name}"
            );
        }
        let before = (navigator.snapshot().unwrap(), navigator.estimate(NOW));
        for (k, event) in bad.iter().enumerate() {
            let outcome = navigator.handle(event).unwrap();
            assert_eq!(outcome, Outcome::Rejected, "{name} and {event:?}");
            let estimate = navigator.estimate(NOW);
            assert_eq!(estimate.rejected, before.1.rejected + k as u64 + 1);
            assert_eq!(belief_bits(&estimate), belief_bits(&before.1), "{name} changed by {event:?}");
        }
        // The count takes one byte up to 127 and two above.
        let after = navigator.snapshot().unwrap();
        assert_eq!(after.len(), before.0.len() + 1, "{name}");
        let same = after.iter().zip(&before.0).take_while(|(a, b)| a == b).count();
        assert_eq!(after[same + 2..], before.0[same + 1..], "{name}: more than the count changed");

        let vehicle = Vehicle::new(OWN, |t| [120.0 + 1.2 * t, 150.0 + 0.9 * t]);
        for second in 21..40 {
            for event in vehicle.second(second, rich_depth) {
                assert_eq!(navigator.handle(&event).unwrap(), twin.handle(&event).unwrap());
            }
        }
        assert_eq!(belief_bits(&navigator.estimate(40 * SECOND)), belief_bits(&twin.estimate(40 * SECOND)));
    }
}

#[test]
fn an_estimate_changes_nothing() {
    let chart = rich();
    for (name, mut navigator) in navigators(OWN, TEAM, &chart) {
        for _ in 0..2 {
            let before = navigator.snapshot().unwrap();
            for t_ns in [0, NOW - SECOND / 2, NOW, NOW + 7 * SECOND] {
                let first = format!("{:?}", navigator.estimate(t_ns));
                assert_eq!(first, format!("{:?}", navigator.estimate(t_ns)), "{name}");
                let _ = navigator.particles();
            }
            assert_eq!(navigator.snapshot().unwrap(), before, "{name}");
            if navigator.estimate(NOW).status == Status::NotStarted {
                warm_up(navigator.as_mut(), OWN);
            }
        }
    }
}

#[test]
fn a_covariance_is_one_at_any_time() {
    let chart = rich();
    for (name, mut navigator) in navigators(OWN, TEAM, &chart) {
        warm_up(navigator.as_mut(), OWN);
        for t_ns in [0, NOW / 2, NOW - 1, NOW, NOW + 1, NOW + 1000 * SECOND] {
            let [ee, en, nn] = navigator.estimate(t_ns).covariance_m2;
            assert!(ee >= 0.0 && nn >= 0.0 && en * en <= ee * nn * (1.0 + 1e-9), "{name} {ee} {en} {nn}");
        }
    }
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

#[test]
fn a_snapshot_of_something_else_is_refused_and_changes_nothing() {
    let chart = rich();
    for (name, mut navigator) in navigators(OWN, TEAM, &chart) {
        warm_up(navigator.as_mut(), OWN);
        let before = navigator.snapshot().unwrap();
        for spoilt in [&before[..before.len() / 2], &[], &[0xFF; 40]] {
            assert!(navigator.restore(spoilt).is_err(), "{name}");
            assert_eq!(navigator.snapshot().unwrap(), before, "{name}");
        }
        navigator.restore(&before).unwrap();
        assert_eq!(navigator.snapshot().unwrap(), before, "{name}");
    }
}
